"""Speed of a plant's registry in PostgreSQL with the records of a simulated fleet.

The benchmark starts a PostgreSQL server from Debian's package, with its default settings (fsync
on). ``--write`` puts the tables of the measured parts into ``docs/benchmarks.md``.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from benchmarks.reporting import BENCHMARKS, write_section
from plugins.plant.fleet import OPERATORS, TYPES, FleetBench, calibration_points
from sqlalchemy import text
from tests import postgresql_server

from torquebench.bench import default_bench
from torquebench.calibration.profile import load_profile
from torquebench.errors import RecordError
from torquebench.progress import NoProgress
from torquebench.records import REGISTERS, Registry, RunFolder, RunSummary
from torquebench_plant import (
    FolderStore,
    Plant,
    SpecimenFilter,
    charts,
    drift_of_kind,
    forward,
    reevaluate,
)
from torquebench_plant.forwarding import BenchLink

PARTS = ("day", "refits", "lists", "grow")
"""24 h without a link; refitting on one and two processes; lists alone; growth to all runs."""
SEED = 20261122
BENCHES = 500
LINKS = 5000
QUERIES = 300
BLOCK = 20_000
"""Rows that the database writes in one statement, which has to end within 10 s."""


def percentile(seconds: list[float]) -> float:
    """Return the 95th percentile of times, in ms."""
    return 1e3 * float(np.percentile(seconds, 95))


@contextmanager
def clocked(taken: list[float]) -> Iterator[None]:
    """Append the duration of the block to a list, s."""
    begin = time.perf_counter()
    yield
    taken.append(time.perf_counter() - begin)


def load(plant: Plant, store: FolderStore, benches: list[FleetBench]) -> tuple[int, float]:
    """Send the chains of benches, each by its own role; return entries, and seconds."""
    entries, spent = 0, 0.0
    for bench in benches:
        number, url = plant.register_bench(bench.name, bench.place)
        root = f"{store.url}/{number}-bench"
        links, arrived = bench.records(root)
        bench.write_points(store, root)
        begin = time.perf_counter()
        with BenchLink(url) as link:
            for k in range(0, len(links), LINKS):
                link.append(links[k : k + LINKS])
            link.arrived(arrived)
        spent += time.perf_counter() - begin
        entries += len(links)
    with plant.transaction() as connection:
        connection.execute(text("ANALYZE"))
    return entries, spent


def lists(plant: Plant, benches: int) -> list[float]:
    """Return how long lists of the newest 100 runs with up to two filters took, s."""
    random = np.random.default_rng(1)
    taken: list[float] = []
    newest = plant.runs(50)
    kinds = ("test-hysteresis", "test-no-load", "check-output", "verify-output", "calibrate-output")
    for k in range(QUERIES):
        some = newest[int(random.integers(len(newest)))]
        filters: dict[str, Any] = {
            "bench_key": int(random.integers(1, benches + 1)),
            "kind": str(random.choice(kinds)),
            "status": str(random.choice(["completed", "failed"])),
            "specimen_type": str(random.choice(TYPES)),
            "serial": some.serial or "S-000-00002",
            "operator": str(random.choice(OPERATORS)),
            "withdrawn": bool(random.integers(2)),
            "simulated": bool(random.integers(2)),
        }
        names = random.choice(list(filters), size=k % 3, replace=False)
        with clocked(taken):
            plant.runs(100, **{str(name): filters[str(name)] for name in names})
    return taken


_ROWS = """
INSERT INTO plant.runs (bench_key, id, run_id, kind, started, side, operator, simulated,
  profile_name, software_version, end_id, finished, status, manifest_sha256, specimen_type, serial)
SELECT n %% {benches} + 1, n, 'run-' || n, kind, started, 'output', 'operator-' || h %% 40, true,
  'rapid-in-situ', '0.2.0', n, started, CASE WHEN h %% 100 = 7 THEN 'failed' ELSE 'completed' END,
  md5(n::text) || md5('m' || n),
  CASE WHEN kind LIKE 'test-%%' THEN (ARRAY[{types}])[h / 7 %% 5 + 1] ELSE '' END,
  CASE WHEN kind LIKE 'test-%%' THEN 'S-' || n ELSE '' END
FROM (SELECT n, h, timestamptz '2024-01-01' + n * interval '1 minute' AS started,
    (ARRAY['test-hysteresis', 'test-hysteresis', 'test-hysteresis', 'test-no-load', 'test-no-load',
      'check-output', 'verify-output'])[h / 11 %% 7 + 1] AS kind
  FROM (SELECT n, abs(hashint8extended(n, {seed})) %% 1000000007 AS h
    FROM generate_series({first}, {last}) AS n) AS numbered) AS chosen
"""
_FOLDERS = """
INSERT INTO plant.folders SELECT bench_key, run_id, manifest_sha256, 'file:///plant/' || run_id,
  NULL, 150000, '{{}}', started FROM plant.runs WHERE id BETWEEN {first} AND {last}
"""


def listed(server: postgresql_server.Server, place: Path, runs: int) -> list[dict[str, Any]]:
    """Measure lists and withdrawals alone; rows are written by the database itself."""
    rows = []
    url = postgresql_server.create_database(server.socket, "lists")
    with Plant.create(url, f"file://{place}/none") as plant:
        for number in range(BENCHES):
            with plant.transaction() as connection:
                query = text("INSERT INTO plant.benches (name, registered) VALUES (:name, now())")
                connection.execute(query, {"name": f"Bench {number % 50 + 1}"})
        known = 0
        for stage in (runs // 100, runs // 10, runs):
            types = ", ".join(f"'{name}'" for name in TYPES)
            given: dict[str, Any] = {"types": types, "benches": BENCHES, "seed": SEED}
            for first in range(known + 1, stage + 1, BLOCK):
                given |= {"first": first, "last": min(first + BLOCK - 1, stage)}
                with plant.transaction() as connection:
                    for statement in (_ROWS, _FOLDERS):
                        connection.exec_driver_sql(statement.format(**given).replace("%%", "%"))
            with plant.transaction() as connection:
                connection.execute(text("ANALYZE plant.runs, plant.folders"))
            known = stage
            lists(plant, BENCHES)  # once in advance, so that the database's pages are in memory
            row = {
                "runs": stage,
                "newest_100_ms": percentile(lists(plant, BENCHES)),
                "withdraw_ms": percentile(withdrawals(plant)),
            }
            print(json.dumps(row), flush=True)
            rows.append(row)
    return rows


def withdrawals(plant: Plant) -> list[float]:
    """Return how long withdrawing a run took, s."""
    taken: list[float] = []
    for run in plant.runs(60, withdrawn=False)[::2]:
        with clocked(taken):
            plant.withdraw(run, by="benchmark", reason="measured")
    return taken


def size_gb(plant: Plant) -> float:
    """Return the size of the database."""
    with plant.transaction() as connection:
        return (
            float(connection.scalar(text("SELECT pg_database_size(current_database())")) or 0) / 1e9
        )


def grow(server: postgresql_server.Server, place: Path, runs: int) -> list[dict[str, Any]]:
    """Measure a plant's registry at every power of ten up to a number of runs."""
    rows = []
    url = postgresql_server.create_database(server.socket, "fleet")
    with Plant.create(url, f"file://{place}/share") as plant:
        store = FolderStore(plant.folders_url)
        per_bench, known = runs // BENCHES, 0
        for stage in (runs // 100, runs // 10, runs):
            benches = [
                FleetBench(SEED, number, per_bench)
                for number in range(known, max(stage // per_bench, 1))
            ]
            entries, seconds = load(plant, store, benches)
            known += len(benches)
            count = known * per_bench
            memory = psutil.Process().memory_info().rss / 1e6
            row = {
                "runs": count,
                "benches": known,
                "entries_a_second": entries / seconds,
                "newest_100_ms": percentile(lists(plant, known)),
                "withdraw_ms": percentile(withdrawals(plant)),
                "memory_mb": memory,
            }
            taken: list[float] = []
            with clocked(taken):
                found = drift_of_kind(plant, "T40B")
            files = len(set(zip(found.columns["serial"], found.columns["when"], strict=True)))
            row |= {"files": files, "drift_s": taken[-1]}
            row["drift_percent_a_year"] = found.facts.get("span drift, % a year")
            with clocked(taken):
                specimens = len(charts(plant, SpecimenFilter("RV-40E", "backlash")))
            row |= {"specimens": specimens, "charts_s": taken[-1], "size_gb": size_gb(plant)}
            print(json.dumps(row), flush=True)
            rows.append(row)
        state = plant.benches()[0]
        checked, wrong = plant.verify_chain(state)
        assert wrong == [], wrong
        print(f"chain of bench 1: {checked} entries as they were entered", flush=True)
    return rows


def day_without_link(server: postgresql_server.Server, place: Path) -> dict[str, Any]:
    """Let benches record for 24 h without the server, then send; count lost and doubled runs."""
    url = postgresql_server.create_database(server.socket, "day")
    with Plant.create(url, f"file://{place}/day") as plant:
        urls = [plant.register_bench("Bench")[1] for _ in range(3)]
    server.stop()
    refused, runs = 0, 144
    for number, link in enumerate(urls):
        with Registry.open(place / f"bench-{number}") as registry:
            for k in range(runs):
                started = datetime(2026, 1, 5, tzinfo=UTC) + timedelta(minutes=10 * k)
                run_id = f"{started:%Y%m%dT%H%M%SZ}-calibrate-output-{k:04x}"
                folder = RunFolder.create(
                    registry.root / "runs",
                    {"simulated": True},
                    kind="calibrate-output",
                    run_id=run_id,
                )
                registry.add_run(
                    RunSummary(
                        run_id=run_id,
                        kind="calibrate-output",
                        started=started,
                        simulated=True,
                        software_version="0.2.0",
                        folder=folder.path,
                    )
                )
                folder.write_results(calibration_points(0.1, f"T-{number}", k))
                registry.end_run(folder.seal(), started + timedelta(minutes=8))
                if k % 48 == 0:
                    try:
                        forward(registry, link)
                    except RecordError:
                        refused += 1
    server.start()
    begin, lost, twice = time.perf_counter(), 0, 0
    with Plant.open(url) as plant:
        for number, link in enumerate(urls):
            with Registry.open(place / f"bench-{number}") as registry:
                done = forward(registry, link)
                assert done.head == registry.head()
        seconds = time.perf_counter() - begin
        listed = [(run.bench_key, run.run_id) for run in plant.runs(10_000)]
        twice = len(listed) - len(set(listed))
        arrived = 0
        for state in plant.benches():
            assert plant.verify_chain(state)[1] == []
            assert plant.verify_folders(state.number) == []
            arrived += state.folders
        lost = runs * len(urls) - arrived
    return {
        "benches": len(urls),
        "runs": runs * len(urls),
        "refused": refused,
        "seconds": seconds,
        "lost": lost,
        "twice": twice,
    }


class _Watch(NoProgress):
    """Records when runs are evaluated, and the memory of this process and its workers."""

    def __init__(self) -> None:
        self.moments: list[float] = []
        self.done: list[int] = []
        self.memory_mb: list[float] = []

    def reach(self, done: int, detail: str = "") -> None:  # noqa: ARG002 - Progress has it
        """Record time, number of runs and memory."""
        self.moments.append(time.perf_counter())
        self.done.append(done)
        me = psutil.Process()
        everybody = [me, *me.children(recursive=True)]
        own = [each for each in everybody if "python" in each.name()]
        self.memory_mb.append(sum(each.memory_info().rss for each in own) / 1e6)

    def rate(self) -> float:
        """Return runs per second without the first tenth, during which processes start."""
        first = len(self.moments) // 10
        return (self.done[-1] - self.done[first]) / (self.moments[-1] - self.moments[first])


def refits(server: postgresql_server.Server, place: Path, count: int) -> dict[str, Any]:
    """Refit calibrations on one process and on two."""
    url = postgresql_server.create_database(server.socket, "refits")
    metadata = {
        "bench": default_bench().model_dump(mode="json"),
        "simulated": True,
        REGISTERS: {"models": [{"name": "hybrid"}], "active": None},
    }
    profile = load_profile("rapid-in-situ").model_dump(mode="json")
    with (
        Plant.create(url, f"file://{place}/refits") as plant,
        Registry.open(place / "refits-bench") as registry,
    ):
        for k in range(count):
            run_id = f"calibrate-{k:05}"
            folder = RunFolder.create(
                registry.root / "runs", metadata, kind="calibrate-output", run_id=run_id
            )
            folder("start", {"uid": run_id, "time": 0.0, "profile": {"settings": profile}})
            started = datetime(2026, 1, 5, tzinfo=UTC) + timedelta(hours=k)
            registry.add_run(
                RunSummary(
                    run_id=run_id,
                    kind="calibrate-output",
                    started=started,
                    simulated=True,
                    software_version="0.2.0",
                    folder=folder.path,
                )
            )
            folder.write_results(calibration_points(0.1, "T-1", k))
            registry.end_run(folder.seal(), started)
        _, link = plant.register_bench("Bench")
        assert forward(registry, link).problems == []
        found: dict[str, Any] = {"calibrations": count}
        memory = []
        for workers in (1, 2):
            watch = _Watch()
            begin = time.perf_counter()
            done = reevaluate(
                plant,
                "processes",
                workers=workers,
                label=f"{workers} processes",
                progress=watch,
            )
            found[f"seconds_{workers}"] = time.perf_counter() - begin
            found[f"a_second_{workers}"] = watch.rate()
            assert (done.done, done.problems) == (count, 0), done
            memory.append([round(watch.memory_mb[0]), round(watch.memory_mb[-1])])
        with plant.transaction() as connection:
            query = text(
                'SELECT count(DISTINCT "values") - count(DISTINCT run_id) FROM plant.reevaluations'
            )
            found["different"] = int(connection.scalar(query) or 0)
        found["ratio"] = found["a_second_2"] / found["a_second_1"]
        found["memory_mb"] = memory
    return found


def table(rows: Sequence[Mapping[str, Any]], lines: Sequence[Line]) -> str:
    """Return a table with a column for each number of runs, and the aim."""
    head = [f"{rows[0]['runs']:,} runs", *(f"{row['runs']:,}" for row in rows[1:]), "aim"]
    cells = [["", *head], ["---"] * (len(head) + 1)]
    cells += [[name, *(shown(row) for row in rows), aim] for name, shown, aim in lines]
    return "\n".join("| " + " | ".join(line) + " |" for line in cells).replace("|  |", "| |")


Line = tuple[str, Callable[[Mapping[str, Any]], str], str]
LISTS: tuple[Line, ...] = (
    (
        f"newest 100 of none, one or two of eight filters, 95 % of {QUERIES}, ms",
        lambda row: f"{row['newest_100_ms']:.0f}",
        "≤ 50",
    ),
    ("withdrawing a run, 95 % of 30, ms", lambda row: f"{row['withdraw_ms']:.0f}", "≤ 50"),
)
GROWTH: tuple[Line, ...] = (
    ("sending, entries a second", lambda row: f"{row['entries_a_second']:,.0f}", "–"),
    ("size of the database, GB", lambda row: f"{row['size_gb']:.2f}", "–"),
    ("memory of the asking process, MB", lambda row: f"{row['memory_mb']:.0f}", "flat"),
)
"""Lines of the tables, and their aims."""


def load_words() -> str:
    """Return the number of processors and the load, on which all times depend."""
    return f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}"


def lists_section(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the table of lists and withdrawals."""
    return (
        f"{table(rows, LISTS)}\n\nMeasured with {load_words()}; the database wrote the rows itself."
    )


def growth_section(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the table of growth."""
    return (
        f"{table(rows, GROWTH)}\n\nMeasured with {load_words()}; each bench sent with its own role."
    )


def drift_section(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a sentence about how long the drift of one kind took."""
    last = rows[-1]
    return (
        f"Drift of one kind over {last['files']:,} Parquet files (81 points each): "
        f"{last['drift_s']:.1f} s ({load_words()}); aim 3 s on two free cores."
    )


def day_section(found: Mapping[str, Any]) -> str:
    """Return a paragraph about 24 h without a connection."""
    return (
        f"24 h without a connection: {found['benches']} benches recorded {found['runs']} runs "
        f"while the server was stopped ({found['refused']} attempts to send were refused), then "
        f"sent their folders in {found['seconds']:.0f} s ({load_words()}). {found['lost']} were "
        f"lost and {found['twice']} duplicated, and every chain and every file was unchanged."
    )


def refits_section(found: Mapping[str, Any]) -> str:
    """Return a paragraph about how long refitting took."""
    (_, first), (_, last) = found["memory_mb"]
    same = "the results are identical" if not found["different"] else "THE RESULTS DIFFER"
    return (
        f"{found['calibrations']:,} calibrations refitted with Dask ({load_words()}): one process "
        f"{found['a_second_1']:.1f} per second, two processes {found['a_second_2']:.1f} "
        f"({found['ratio']:.2f} times; aim 1.8); memory {first} MB with one and {last} MB with two "
        f"at the end; {same}."
    )


def main() -> None:
    """Measure, and write the tables if `--write` is given."""
    parser = argparse.ArgumentParser(
        prog="python -m plugins.plant.benchmark",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}")
    parser.add_argument("--runs", type=int, default=1_000_000, help="of the fleet")
    parser.add_argument("--quick", action="store_true", help="a hundredth of the runs")
    parser.add_argument("--write", action="store_true", help=f"put the tables into {BENCHMARKS}")
    options = parser.parse_args()
    if unknown := sorted(set(options.parts) - set(PARTS)):
        parser.error(f"parts {', '.join(unknown)}; allowed: {', '.join(PARTS)}")
    if options.quick and options.write:
        parser.error("--write with --quick; the tables are those of the whole fleet")
    runs = options.runs // 100 if options.quick else options.runs
    parts = options.parts or PARTS

    def write(name: str, text: str) -> None:
        print(text, flush=True)
        if options.write:
            write_section(BENCHMARKS, f"plant-{name}", text)

    with (
        tempfile.TemporaryDirectory(prefix="torquebench-plant-") as folder,
        postgresql_server.restartable(durable=True) as server,
    ):
        place = Path(folder)
        if "day" in parts:
            write("day", day_section(day_without_link(server, place)))
        if "refits" in parts:
            write("refits", refits_section(refits(server, place, min(runs // 100, 1000))))
        if "lists" in parts:
            write("lists", lists_section(listed(server, place, runs)))
        if "grow" in parts:
            rows = grow(server, place, runs)
            write("growth", growth_section(rows))
            write("drift", drift_section(rows))


if __name__ == "__main__":
    main()
