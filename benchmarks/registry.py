"""Time to open a long registry, list its runs and verify it, on SQLite and PostgreSQL."""

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

from torquebench.records import Registry, check_records
from torquebench.records.registry.entries import RunSummary

BATCH = 5000
REPEATS = 20


def fill(registry: Registry, folder: Path, runs: int) -> None:
    """Enter finished runs with their hash chain, in batches of one transaction."""
    start = datetime(2025, 1, 31, tzinfo=UTC)
    kinds = ("calibrate-output", "verify-output", "zero", "no-load-friction")
    for begin in range(0, runs, BATCH):
        numbers = range(begin, min(begin + BATCH, runs))
        with registry.writing():
            for number in numbers:
                begun = start + timedelta(minutes=number)
                registry.add_run(
                    RunSummary(
                        run_id=f"run-{number:07}",
                        kind=kinds[number % len(kinds)],
                        started=begun,
                        side="output",
                        operator="Ana",
                        bench="Bench 1",
                        simulated=True,
                        profile_name="rapid-in-situ",
                        profile_sha256="ab" * 32,
                        software_version="0.1.0",
                        folder=folder / "runs" / f"run-{number:07}",
                        finished=begun,
                        status="completed",
                        manifest_sha256="cd" * 32,
                    )
                )


def milliseconds(work: Callable[[], object]) -> tuple[float, float]:
    """Return median and longest duration of a function, in ms."""
    taken = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        work()
        taken.append(1e3 * (time.perf_counter() - begin))
    return statistics.median(taken), max(taken)


def measure(folder: Path, url: str | None, runs: int) -> None:
    """Print the durations on one database."""
    begin = time.perf_counter()
    with Registry.open(folder, url) as registry:
        fill(registry, folder, runs)
        print(f"{registry.name}: {runs} runs entered in {time.perf_counter() - begin:.0f} s")

    def opened() -> None:
        with Registry.open(folder, url) as registry:
            assert len(registry.runs(limit=100)) == 100

    with Registry.open(folder, url) as registry:
        for what, work in (
            ("open the registry and list the newest 100 runs", opened),
            ("list the newest 100 runs", lambda: registry.runs(limit=100)),
            ("list the newest 100 runs of a kind", lambda: registry.runs(limit=100, kind="zero")),
            ("find runs by the beginning of a name", lambda: registry.runs_beginning("run-00420")),
        ):
            median, longest = milliseconds(work)
            print(f"  {what:<50} {median:7.1f} ms, at most {longest:.1f} ms")
        begin = time.perf_counter()
        report = check_records(registry, folders=False)
        assert report.intact
        took = time.perf_counter() - begin
        print(f"  verify {report.records} records along the chain: {took:.1f} s")


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure on SQLite, and on PostgreSQL where a URL is given."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a tenth of the runs")
    parser.add_argument("--runs", type=int, default=100_000)
    parser.add_argument("--postgresql", metavar="URL", help="of an empty database")
    options = parser.parse_args(arguments)
    runs = options.runs // 10 if options.quick else options.runs
    for url in filter(None, ("sqlite", options.postgresql)):
        with tempfile.TemporaryDirectory() as folder:
            measure(Path(folder), None if url == "sqlite" else url, runs)
    return 0
