"""`torquebench doctor`: check installation, configuration and instruments, and give remedies."""

from __future__ import annotations

import os
import platform
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from torquebench.cli.doctor.bench import Finding
from torquebench.cli.options import (
    DEFAULT_DATA,
    REGISTRY_URL,
    BenchOption,
    DataOption,
    bench_description,
    has_registry,
)
from torquebench.cli.reports import Told
from torquebench.cli.terminal.console import narrow_table, note, out, say
from torquebench.errors import TorquebenchError

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription

__all__ = ["doctor"]

LIBRARIES = (
    "numpy",
    "scipy",
    "scikit-learn",
    "numba",
    "bluesky",
    "ophyd-async",
    "pydantic",
    "sqlalchemy",
    "pyarrow",
    "matplotlib",
)
FREE_DISK_GB = 1.0
DOING = {
    "Installed": "checking the installation",
    "Configured": "reading the bench description and the records",
    "Reachable": "asking every instrument",
    "Clock": "comparing the counter's clock with the computer's",
    "Signals": "watching every signal",
    "Drives": "powering each drive at zero torque",
}
"""Messages before steps that may take seconds."""
NEEDED = ("Configured", "Reachable")
"""Steps that must succeed before the later ones."""


@dataclass(frozen=True, kw_only=True)
class Examined(Told):
    """Everything that was examined."""

    findings: Sequence[Finding]
    problems: int

    @property
    def failed(self) -> bool:
        """Whether a problem must be solved before work."""
        return self.problems > 0


def doctor(
    bench: BenchOption = None,
    data: DataOption = DEFAULT_DATA,
    test_drives: Annotated[
        bool,
        typer.Option(
            "--test-drives",
            help="Also power each drive at zero torque to test its stop and watchdog.",
        ),
    ] = False,
    record: Annotated[
        Path | None,
        typer.Option(
            "--record",
            help="Write everything that the instruments are asked and answer to this new file.",
        ),
    ] = None,
) -> Examined:
    """Check the installation, the bench description, the instruments and the records.

    Nothing is moved, and no drive is powered without `--test-drives`. Exit code 1 if a problem must
    be solved before work.
    """
    from torquebench.bench.drivers.recording import recorded
    from torquebench.cli.doctor import bench as doctor_bench

    findings: list[Finding] = []
    steps: list[tuple[str, Callable[[], Iterator[Finding]]]] = [
        ("Installed", installation),
        ("Configured", lambda: configuration(bench, data)),
        ("Reachable", lambda: doctor_bench.instruments(bench_description(bench), data)),
        ("Clock", lambda: doctor_bench.clock(bench_description(bench), data)),
        ("Signals", lambda: doctor_bench.signals(bench_description(bench), data)),
    ]
    if test_drives:
        steps.append(("Drives", lambda: doctor_bench.drives(bench_description(bench), data)))
    with recorded(record, _session(bench) if record else {}):
        for title, examine in steps:
            note(DOING[title])
            found = list(_guarded(examine))
            _print(title, found)
            findings += found
            if title in NEEDED and any(finding.state == "problem" for finding in found):
                note(f"the checks after {title!r} were omitted")
                break
    problems = sum(finding.state == "problem" for finding in findings)
    headline = (
        f"{problems} problem{'s' if problems > 1 else ''} to solve before you work."
        if problems
        else "Ready."
    )
    say(headline)
    return Examined(headline=headline, findings=findings, problems=problems)


def _session(bench: Path | None) -> dict[str, object]:
    """Return what the first line of a recorded session states."""
    from datetime import UTC, datetime

    from torquebench import __version__

    description = bench_description(bench)
    return {
        "torquebench": __version__,
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "bench": description.name,
        "serials": description.serials,
        "driver": dict(description.driver),
    }


def installation() -> Iterator[Finding]:
    """Check Python, the libraries and the terminal."""
    from importlib import metadata

    from torquebench import __version__

    yield Finding("torquebench", "ok", __version__)
    python = platform.python_version()
    recent = sys.version_info >= (3, 11)
    yield Finding(
        "Python", "ok" if recent else "problem", python, "" if recent else "install 3.11 or newer"
    )
    versions, missing = [], []
    for name in LIBRARIES:
        try:
            versions.append(f"{name} {metadata.version(name)}")
        except metadata.PackageNotFoundError:
            missing.append(name)
    if missing:
        yield Finding(
            "libraries",
            "problem",
            f"missing: {', '.join(missing)}",
            "pip install 'torquebench[panel]'",
        )
    else:
        yield Finding("libraries", "ok", ", ".join(versions))
    yield Finding("machine", "ok", f"{os.cpu_count()} cores, {platform.system()}")
    yield _priority()
    encoding = (sys.stdout.encoding or "").lower()
    if "utf" not in encoding:
        yield Finding(
            "terminal",
            "note",
            f"encoding {encoding or 'unknown'}",
            "set PYTHONUTF8=1 for N·m and ±",
        )


def _priority() -> Finding:
    """Check whether the threads for safety have priority over other programs."""
    from torquebench.bench.safety.priority import PRIORITY, Priority, available_priority

    granted = available_priority()
    if granted is Priority.REAL_TIME:
        return Finding("priority", "ok", f"{granted.description} for acquisition and supervisor")
    return Finding(
        "priority",
        "note",
        f"{granted.description}: other programs may delay a stop",
        f"unset {PRIORITY}, which asks for no more"
        if os.environ.get(PRIORITY) == "usual"
        else "on Linux allow the account `rtprio 1` and `nice -10` in /etc/security/limits.conf",
    )


def configuration(bench: Path | None, data: Path) -> Iterator[Finding]:
    """Check the bench description and the data directory."""
    from torquebench.bench.roles import SIDES

    description = bench_description(bench)
    name = f"{description.name} ({bench or 'the packaged simulated bench'})"
    yield Finding("bench", "ok", name)
    for side in SIDES:
        module = description.module(side)
        yield Finding(
            side,
            "ok",
            f"{module.range_nm:g} N·m, transducer {module.transducer.serial}, "
            f"{module.transducer.signal_text}",
        )
    yield Finding("counter", "ok", description.counter.identity)
    yield from _records(data)
    yield from _doubts(description, data)


def _doubts(description: BenchDescription, data: Path) -> Iterator[Finding]:
    """Check the dates of the standards' certificates, and the clock against the newest record."""
    from torquebench.campaign.doubts import CALIBRATOR, VERIFICATION_STANDARD, expired_standards
    from torquebench.records import Registry
    from torquebench.records.runs.time_check import clock_behind

    if not has_registry(data):
        return
    with Registry.open(data) as registry:
        for said in expired_standards(registry, description, CALIBRATOR, VERIFICATION_STANDARD):
            found, _, remedy = said.partition(": ")
            yield Finding("standard", "problem", found, remedy)
        behind = clock_behind(registry)
        if behind:
            yield Finding("clock", "problem", behind, "set this computer's clock")


def _records(data: Path) -> Iterator[Finding]:
    from torquebench.records import Registry, unfinished_runs

    parent = data if data.is_dir() else data.resolve().parent
    if not os.access(parent, os.W_OK):
        yield Finding("records", "problem", f"{parent} can't be written", "choose another --data")
        return
    free_gb = shutil.disk_usage(parent).free / 1e9
    if free_gb < FREE_DISK_GB:
        yield Finding("disk", "problem", f"{free_gb:.1f} GB free", "make room for the raw data")
    else:
        yield Finding("disk", "ok", f"{free_gb:.0f} GB free")
    if not has_registry(data):
        yield Finding("records", "note", f"none in {data} yet", "the first run creates them")
        return
    with Registry.open(data) as registry:
        runs, models = registry.number_of_runs(), len(registry.models())
        where = data if os.environ.get(REGISTRY_URL) is None else registry.name
        yield Finding("records", "ok", f"{runs} runs and {models} models in {where}")
        for run in unfinished_runs(registry):
            yield Finding("unfinished", "note", run.found, run.remedy)
        if not (registry.root / "certificates").is_dir():
            return
        from torquebench.reports.certificate import unregistered_certificates

        for path in unregistered_certificates(registry):
            found = f"certificate {path.name} was written and not registered"
            yield Finding(
                "unfinished", "note", found, "issue it again; the interrupted issue isn't valid"
            )


def _guarded(examine: Callable[[], Iterator[Finding]]) -> Iterator[Finding]:
    """Convert an error of a check to a finding, so that the other checks still run."""
    try:
        yield from examine()
    except TorquebenchError as error:
        remedy = "; ".join(part for part in (error.allowed, error.remedy) if part)
        yield Finding("stopped", "problem", error.found, remedy)


def _print(title: str, findings: list[Finding]) -> None:
    table = narrow_table(title, headings=False)
    table.add_column(width=8)
    table.add_column(width=14, overflow="fold")
    table.add_column(overflow="fold")
    marks = {"ok": "[green]ok[/green]", "note": "[yellow]note[/yellow]"}
    for finding in findings:
        text = finding.found + (f"\n-> {finding.remedy}" if finding.remedy else "")
        table.add_row(marks.get(finding.state, "[red]problem[/red]"), finding.what, text)
    out().print(table)
    out().print()
