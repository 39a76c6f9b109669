"""Check installation, configuration and instruments, and give remedies."""

from __future__ import annotations

import os
import platform
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from torquebench.errors import TorquebenchError
from torquebench.message import Message
from torquebench.operations import bench_checks
from torquebench.operations.bench_checks import Finding, problem
from torquebench.operations.operation import Flag, Operation, Request, field
from torquebench.operations.place import REGISTRY_URL, Place, has_registry
from torquebench.operations.result import Result
from torquebench.progress import Progress
from torquebench.reports.page import Page, Section, Table

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription

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
"""Stages, some of which take seconds."""
NEEDED = ("Configured", "Reachable")
"""Steps that must succeed before the later ones."""


class DoctorRequest(Request):
    """Check the installation, the bench description, the instruments and the records.

    Nothing is moved, and no drive is powered without `--test-drives`. The check fails if a problem
    must be solved before work. On the panel, the signals of the open bench are checked; the command
    also asks each instrument.
    """

    bench: Annotated[
        Path | None,
        field("Bench description; without it the simulated bench.", local=True),
    ] = None
    test_drives: Annotated[
        Flag,
        field("Also power each drive at zero torque to test its stop and watchdog.", local=True),
    ] = False
    record: Annotated[
        Path | None,
        field(
            "Write everything that the instruments are asked and answer to this new file.",
            local=True,
        ),
    ] = None


@dataclass(frozen=True)
class Examined(Finding):
    """A finding and the step that found it."""

    step: str = ""


@dataclass(frozen=True, kw_only=True)
class Diagnosis(Result):
    """Everything that was examined."""

    findings: Sequence[Examined]
    problems: int

    @property
    def failed(self) -> bool:
        """Whether a problem must be solved before work."""
        return self.problems > 0

    def page(self) -> Page:
        """Return a table of findings for each step."""
        sections = []
        for step, found in groupby(self.findings, lambda finding: finding.step):
            rows = [
                (
                    each.state,
                    each.what,
                    Message("{found} → {remedy}", each.found, each.remedy)
                    if each.remedy
                    else each.found,
                )
                for each in found
            ]
            sections.append(
                Section(step, "", [Table(("state", "what", "found"), rows, words=True)])
            )
        return Page("Installation, bench and records", "", sections, simulated=self.simulated)


def run_doctor(place: Place, request: DoctorRequest, progress: Progress) -> Diagnosis:
    """Examine step by step; a problem in a step that others need ends it."""
    from torquebench.bench import default_bench, load_bench

    station, data = place.station, place.folder

    @cache
    def description() -> BenchDescription:
        if station is not None:
            return station.description
        return default_bench() if request.bench is None else load_bench(request.bench)

    steps: dict[str, Callable[[], Iterator[Finding]]] = {
        "Installed": installation,
        "Configured": lambda: configuration(description(), request.bench, data),
    }
    if station is not None:
        steps["Signals"] = lambda: bench_checks.signals_of(station)
    else:
        steps["Reachable"] = lambda: bench_checks.instruments(description(), data)
        steps["Clock"] = lambda: bench_checks.clock(description(), data)
        steps["Signals"] = lambda: bench_checks.signals(description(), data)
        if request.test_drives:
            steps["Drives"] = lambda: bench_checks.drives(description(), data)
    findings: list[Examined] = []
    remarks: list[str] = []
    session: AbstractContextManager[object] = nullcontext()
    if request.record is not None:
        from torquebench.bench.drivers.recording import recorded

        session = recorded(request.record, _session(description()))
    with session:
        for step, examine in steps.items():
            progress.start(DOING[step], None)
            found = [Examined(**vars(each), step=step) for each in _guarded(examine)]
            findings += found
            if step in NEEDED and any(each.state == "problem" for each in found):
                remarks.append(Message("the checks after {step!r} were omitted", step))
                break
        progress.finish()
    simulated = False
    with suppress(TorquebenchError):
        simulated = description().simulated
    problems = sum(each.state == "problem" for each in findings)
    headline = "1 problem to solve before you work."
    if problems != 1:
        headline = Message("{count} problems to solve before you work.", problems)
    return Diagnosis(
        headline=headline if problems else "Ready.",
        simulated=simulated,
        remarks=tuple(remarks),
        findings=findings,
        problems=problems,
    )


def _session(description: BenchDescription) -> dict[str, object]:
    """Return what the first line of a recorded session states."""
    from torquebench import __version__

    return {
        "torquebench": __version__,
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "bench": description.name,
        "serials": description.serials,
        "driver": dict(description.driver),
    }


def _guarded(examine: Callable[[], Iterator[Finding]]) -> Iterator[Finding]:
    """Convert an error of a check to a finding, so that the other checks still run."""
    try:
        yield from examine()
    except TorquebenchError as error:
        yield problem("stopped", error)


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
            Message("missing: {libraries}", ", ".join(missing)),
            "pip install 'torquebench[panel]'",
        )
    else:
        yield Finding("libraries", "ok", ", ".join(versions))
    yield Finding(
        "machine", "ok", Message("{count} cores, {system}", os.cpu_count(), platform.system())
    )
    yield _priority()
    encoding = (sys.stdout.encoding or "").lower()
    if "utf" not in encoding:
        yield Finding(
            "terminal",
            "note",
            Message("encoding {name}", encoding or "unknown"),
            "set PYTHONUTF8=1 for N·m and ±",
        )


def _priority() -> Finding:
    """Check whether the threads for safety have priority over other programs."""
    from torquebench.bench.safety.priority import PRIORITY, Priority, available_priority

    granted = available_priority()
    if granted is Priority.REAL_TIME:
        return Finding(
            "priority",
            "ok",
            Message("{description} for acquisition and supervisor", granted.description),
        )
    return Finding(
        "priority",
        "note",
        Message("{description}: other programs may delay a stop", granted.description),
        Message("unset {name}, which asks for no more", PRIORITY)
        if os.environ.get(PRIORITY) == "usual"
        else "on Linux allow the account `rtprio 1` and `nice -10` in /etc/security/limits.conf",
    )


def configuration(
    description: BenchDescription, bench: Path | None, data: Path
) -> Iterator[Finding]:
    """Check the bench description and the data directory."""
    from torquebench.bench.roles import SIDES

    origin = bench or "the packaged simulated bench"
    yield Finding("bench", "ok", Message("{name} ({origin})", description.name, origin))
    for side in SIDES:
        module = description.module(side)
        yield Finding(
            side,
            "ok",
            Message(
                "{range_nm:g} N·m, transducer {serial}, {signal_text}",
                module.range_nm,
                module.transducer.serial,
                module.transducer.signal_text,
            ),
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
        yield Finding(
            "records",
            "problem",
            Message("{parent} can't be written", parent),
            "choose another --data",
        )
        return
    free_gb = shutil.disk_usage(parent).free / 1e9
    if free_gb < FREE_DISK_GB:
        yield Finding(
            "disk",
            "problem",
            Message("{free_gb:.1f} GB free", free_gb),
            "make room for the raw data",
        )
    else:
        yield Finding("disk", "ok", Message("{free_gb:.0f} GB free", free_gb))
    if not has_registry(data):
        yield Finding(
            "records", "note", Message("none in {data} yet", data), "the first run creates them"
        )
        return
    with Registry.open(data) as registry:
        runs, models = registry.number_of_runs(), len(registry.models())
        where = data if os.environ.get(REGISTRY_URL) is None else registry.name
        yield Finding(
            "records",
            "ok",
            Message("{runs} runs and {models} models in {where}", runs, models, where),
        )
        for run in unfinished_runs(registry):
            yield Finding("unfinished", "note", run.found, run.remedy)
        if not (registry.root / "certificates").is_dir():
            return
        from torquebench.reports.certificate import unregistered_certificates

        for path in unregistered_certificates(registry):
            found = Message("certificate {name} was written and not registered", path.name)
            yield Finding(
                "unfinished", "note", found, "issue it again; the interrupted issue isn't valid"
            )


DOCTOR = Operation(
    "doctor", DoctorRequest, run_doctor, lambda _request: "Check the bench", where="folder"
)
