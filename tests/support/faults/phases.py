"""Faults in every phase of a calibration, as its commands run it.

A child process runs `torquebench calibrate` (or `certificate`), and something happens to it in the
middle of a phase: SIGKILL, a disk that is full from then on, a database that is locked for 2 s or
for good; while it measures, also a transducer or a standard whose span changes. Then a person does
what the next start says: `records finish`, `resume latest`, `certificate`. In the end
there has to be one calibration with all its points, and what is in use has to state the true
torque.
"""

from __future__ import annotations

import contextlib
import os
import resource
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
from tests.support.faults.judging import Outcome, Status
from tests.system.command_line import laboratory

import torquebench.campaign.fitting
import torquebench.campaign.registering
import torquebench.cli
import torquebench.reports.certificate
from torquebench.bench.description import default_bench
from torquebench.bench.drivers import open_drivers
from torquebench.bench.drivers.simulated.driver import SimulatedBench
from torquebench.bench.roles import Side
from torquebench.campaign.fitting import feature_columns
from torquebench.compensation import features, load_model
from torquebench.errors import TorquebenchError
from torquebench.records import Registry, RunFolder, RunWriter
from torquebench.records.registry.database import REGISTRY_FILE

__all__ = ["PHASE_FAULTS", "PHASE_KINDS", "PhaseKind", "numbered_phase", "one_phase_fault"]

SIDE: Side = "output"
CALIBRATE = ("calibrate", SIDE, "--step", "25", "--yes")
POINTS = 16
"""Of such a calibration."""
WRONG_PERCENT = 0.1
"""How far what is in use may be from the truth, % of range."""
AWAY_S, LOST_S = 2.0, 3600.0
LONGEST_S = 300.0
"""How long one command may take, s of wall time."""
LOCKED_WITHIN_S = 3.0
HOLD = """
import os, sqlite3, sys, time
database, seconds, owner = sys.argv[1], float(sys.argv[2]), int(sys.argv[3])
connection = sqlite3.connect(database, timeout=30.0)
connection.execute("BEGIN EXCLUSIVE")
print("held", flush=True)
until = time.monotonic() + seconds
while time.monotonic() < until and os.getppid() == owner:
    time.sleep(0.01)
"""
"""Holds a database until its time is over or who has started it is gone."""
CRASHED = 3
LATEST_EVENT = 12
LATEST_CALL = 20_000
SPANS = {"standard's span changes": "reference", "transducer's span changes": "torque"}


def _kill(_child: _Child) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def _fill_disk(_child: _Child) -> None:
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))


def _lock_database(seconds: float) -> Callable[[_Child], None]:
    """Return what has another process hold the registry's database."""

    def lock(child: _Child) -> None:
        database, owner = str(child.data / REGISTRY_FILE), str(os.getpid())
        holder = subprocess.Popen(
            [sys.executable, "-c", HOLD, database, str(seconds), owner],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        # In the middle of a transaction it gets the lock after it, while the command goes on.
        assert holder.stdout is not None
        select.select([holder.stdout], [], [], LOCKED_WITHIN_S)

    return lock


def _change_span(channel: str) -> Callable[[_Child], None]:
    def change(child: _Child) -> None:
        for bench in child.benches:
            name: Any = f"{SIDE}_{channel}"
            bench.twin.inject_fault(name, "wrong_span", duration_s=1e5, amount=1.03)

    return change


@dataclass(frozen=True)
class PhaseKind:
    """Something that happens to a command in a phase.

    Parameters
    ----------
    phase : {"measure", "seal", "fit", "register", "certificate"}
    what : str
    act : callable
        Does it, in the child.
    harmless : bool
        Whether the command has to go on.
    """

    phase: str
    what: str
    act: Callable[[_Child], None]
    harmless: bool = False

    @property
    def name(self) -> str:
        """What it is called in the report."""
        return f"{self.phase}: {self.what}"


PHASES = ("measure", "seal", "fit", "register", "certificate")
PHASE_KINDS: tuple[PhaseKind, ...] = (
    *(PhaseKind(phase, "killed", _kill) for phase in PHASES),
    *(PhaseKind(phase, "disk full", _fill_disk) for phase in PHASES),
    *(PhaseKind(phase, "database away", _lock_database(AWAY_S), True) for phase in PHASES),
    *(PhaseKind(phase, "database lost", _lock_database(LOST_S)) for phase in PHASES),
    *(PhaseKind("measure", what, _change_span(channel)) for what, channel in SPANS.items()),
)
REPEATS = 3
PHASE_FAULTS = REPEATS * len(PHASE_KINDS)
"""Every kind three times, once of them in real time."""


class _Child:
    """What goes on in the process that runs a command, and when it is broken."""

    def __init__(self, data: Path, kind: PhaseKind | None, when: int) -> None:
        self.data = data
        self.benches: list[SimulatedBench] = []
        self._kind = kind
        self._when = when
        self._count = 0
        self._done = kind is None
        self._lock = threading.Lock()

    def run(self, arguments: Sequence[str]) -> int:
        """Run a command to its end and return its exit code."""
        if self._kind is not None:
            self._arm(self._kind.phase)
        sys.argv = ["torquebench", *arguments, "--data", str(self.data)]
        try:
            torquebench.cli.main()
        except SystemExit as end:
            return int(end.code or 0)
        return 0

    def _arm(self, phase: str) -> None:
        # The program itself is watched in its own process: methods are replaced on their classes,
        # which type checkers take for a mistake.
        child, opened = self, SimulatedBench.__init__

        def remember(bench: SimulatedBench, *arguments: Any, **keys: Any) -> None:
            opened(bench, *arguments, **keys)
            child.benches.append(bench)

        SimulatedBench.__init__ = remember  # type: ignore[method-assign,assignment]
        if phase == "measure":
            document = RunWriter.document

            def noting(writer: RunWriter, name: str, *arguments: Any) -> Any:
                result = document(writer, name, *arguments)
                if name == "event":
                    child._go_on()
                return result

            RunWriter.document = noting  # type: ignore[method-assign,assignment]
        elif phase == "seal":
            RunWriter.seal = child._watched(RunWriter.seal)  # type: ignore[method-assign]
        else:
            module, function = {
                "fit": (torquebench.campaign.fitting, "fit_models"),
                "register": (torquebench.campaign.registering, "register_calibration"),
                "certificate": (torquebench.reports.certificate, "issue_certificate"),
            }[phase]
            original: Callable[..., Any] = getattr(module, function)
            for each in list(sys.modules.values()):
                if getattr(each, function, None) is original:
                    setattr(each, function, child._watched(original))

    def _go_on(self) -> None:
        with self._lock:
            self._count += 1
            due = not self._done and self._count >= self._when
            self._done |= due
        if due:
            assert self._kind is not None
            self._kind.act(self)

    def _watched(self, original: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function that is broken in the middle, after so many calls of any other."""

        def calls(_frame: FrameType, event: str, _argument: object) -> None:
            if event == "call":
                self._go_on()
                if self._done:
                    sys.setprofile(None)

        def watched(*arguments: Any, **keys: Any) -> Any:
            sys.setprofile(calls)
            try:
                return original(*arguments, **keys)
            finally:
                sys.setprofile(None)
                self._when = 0
                self._go_on()  # right after it, where it was shorter

        return watched


@dataclass(frozen=True)
class _Ended:
    """How a command ended: its exit code, negative for a signal, and what it printed."""

    code: int
    said: str


def _command(
    data: Path, arguments: Sequence[str], kind: PhaseKind | None = None, when: int = 0
) -> _Ended:
    """Run a command in a process of its own."""
    printed, output = os.pipe()
    process = os.fork()
    if process == 0:
        code = CRASHED
        with contextlib.suppress(BaseException):
            os.dup2(output, 1)
            os.dup2(output, 2)
            # Both stay open until the process ends: no block could hold them.
            sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
            sys.stderr = open(2, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
            code = _Child(data, kind, when).run(arguments)
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)
    os.close(output)
    deadline, said = time.monotonic() + LONGEST_S, b""
    with os.fdopen(printed, "rb", buffering=0) as pipe:
        while select.select([pipe], [], [], max(0.0, deadline - time.monotonic()))[0]:
            part = pipe.read(65536)
            if not part:
                break
            said += part
        else:
            os.kill(process, signal.SIGKILL)
    status = os.waitpid(process, 0)[1]
    return _Ended(os.waitstatus_to_exitcode(status), said.decode("utf-8", "replace"))


def one_phase_fault(kind: PhaseKind, when: int, data: Path, *, real_time: bool = False) -> Outcome:
    """Break a calibration or its certificate once, do what the next start says, and judge."""
    laboratory(data)  # its certificates state that nobody has verified or checked
    measured = (*CALIBRATE, "--real-time") if real_time else CALIBRATE
    certificate = ("certificate", "latest")
    problems: list[str] = []
    if kind.phase == "certificate":
        undisturbed = _command(data, CALIBRATE)
        if undisturbed.code:
            problems.append(f"other: calibrate: {_last(undisturbed)}")
        broken = _command(data, certificate, kind, when)
    else:
        broken = _command(data, measured, kind, when)
    if kind.harmless and broken.code:
        problems.append(f"false alarm: {_last(broken)}")
    if broken.code not in (0, 1, 2, -signal.SIGKILL):
        problems.append(f"other: exit code {broken.code}: {_last(broken)}")
    if kind.what in SPANS:
        points, wrong = _points(data), list(_in_use(data))
        status: Status = "stopped" if broken.code else "harmless"
        return Outcome(
            kind.name, " ".join(measured), status, _last(broken), float("nan"), points,
            (*problems, *wrong),
        )  # fmt: skip
    finished = _command(data, ("records", "finish"))
    if _interrupted(data):
        resumed = _command(data, ("resume", "latest", "--yes"))
        if resumed.code:
            problems.append(f"stranded: resume: {_last(resumed)}")
    issued = _command(data, certificate)
    if issued.code:
        problems.append(f"stranded: certificate: {_last(issued)}; finish: {_last(finished)}")
    verified = _command(data, ("records", "verify"))
    kept_aside = list(data.glob("certificates/*.unregistered-*"))  # named, with a way back
    if verified.code and not kept_aside:
        problems.append(f"stranded: records verify: {_last(verified)}")
    points = _points(data)
    if points != POINTS:
        problems.append(f"stranded: {points} points are calibrated instead of {POINTS}")
    problems += _in_use(data)
    text = _last(broken) if broken.code > 0 else "found at the next start"
    status = "harmless" if broken.code == 0 else "recovered"
    command = " ".join(certificate if kind.phase == "certificate" else measured)
    return Outcome(kind.name, command, status, text, float("nan"), points, tuple(problems))


def _last(ended: _Ended) -> str:
    lines = [line.strip() for line in ended.said.splitlines() if line.strip()]
    return " ".join(lines[-3:])[-200:] if lines else f"exit code {ended.code}"


def _serial() -> str:
    return default_bench().module(SIDE).transducer.serial


def _points(data: Path) -> int:
    """Return how many points all calibrations have that are registered."""
    with contextlib.suppress(TorquebenchError), Registry.open(data) as registry:
        return sum(each.points for each in registry.calibrations(_serial()))
    return 0


def _interrupted(data: Path) -> bool:
    """Tell whether a calibration has to be gone on with: none of its kind was completed."""
    with contextlib.suppress(TorquebenchError), Registry.open(data) as registry:
        ends = {run.status for run in registry.runs()}
        return bool(ends) and "completed" not in ends
    return False


def _in_use(data: Path) -> Iterator[str]:
    """Say where what is in use doesn't state the true torque."""
    description = default_bench()
    with Registry.open(data) as registry:
        entry = registry.active_model(_serial(), description.counter.identity)
        for run in registry.runs():
            if run.status == "completed":
                RunFolder.open(run.folder).verify()
    if entry is None:
        return
    model = load_model(entry.check_file()).model
    range_nm = description.module(SIDE).range_nm
    drivers = open_drivers(description)
    try:
        assert drivers.truth is not None
        path = range_nm * np.concatenate((np.linspace(0, 1, 21), np.linspace(1, -1, 41)))
        reading, branch = drivers.truth.dense_sweep(SIDE, path)
    finally:
        drivers.close()
    rows = features(reading, branch, 0, 0.0, 23.0)[:, : feature_columns(model)]
    worst_nm = float(np.max(np.abs(model.predict(rows) - path)))
    if worst_nm > WRONG_PERCENT / 100.0 * range_nm:
        yield f"wrong: model-{entry.model_id} in use is {worst_nm:.2f} N·m from the truth"


def numbered_phase(index: int, seed: int) -> Outcome:
    """Go through one fault; every third round in real time."""
    kind = PHASE_KINDS[index % len(PHASE_KINDS)]
    draw = np.random.default_rng([seed, index])
    latest = LATEST_EVENT if kind.phase == "measure" else LATEST_CALL
    if kind.what in SPANS:
        when = int(draw.integers(4, LATEST_EVENT))
    else:
        when = max(1, round(latest ** float(draw.uniform())))
    with tempfile.TemporaryDirectory() as scratch:
        data = Path(scratch) / "data"
        outcome = one_phase_fault(
            kind, when, data, real_time=index // len(PHASE_KINDS) == REPEATS - 1
        )
        shutil.rmtree(data, ignore_errors=True)
    return outcome
