"""A kill, a full disk and a restart of the database at every phase of a module's calibration.

One bench calibrates, fits, registers, verifies, checks and certifies. Something happens where a
phase begins, or a moment after. Then the next start has to find what isn't finished, name it and
finish it: no measured point may be lost, measured twice or registered twice, and in the end the
calibration is certified.
"""

from __future__ import annotations

import contextlib
import logging
import os
import resource
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from tests.support.faults.judging import Outcome

from torquebench.bench.description import BenchDescription, default_bench
from torquebench.calibration import Profile, load_profile
from torquebench.campaign import calibrating, registering
from torquebench.campaign.calibrating import CALIBRATION, measure_calibration
from torquebench.campaign.checking import check_module
from torquebench.campaign.finishing import finish_recorded_run
from torquebench.campaign.fitting import ModelChoice
from torquebench.campaign.registering import registers_calibration
from torquebench.campaign.resuming import read_interrupted, resume_calibration
from torquebench.campaign.verifying import verify_on_bench
from torquebench.errors import TorquebenchError
from torquebench.records import (
    REGISTRY_URL,
    Registry,
    RunFolder,
    RunState,
    RunWriter,
    unfinished_runs,
)
from torquebench.records.streams import raw_stream
from torquebench.reports.certificate import Issue, build_record, issue_certificate
from torquebench.reports.certificate import issuing as certificates
from torquebench.station import Station, entering, recover_unfinished

MODEL = "polynomial"
SERIAL = "SIM-T2000"
PHASES: dict[str, tuple[Any, str, int]] = {
    "begin": (Registry, "add_run", 1),
    "prepare": (RunWriter, "document", 4),
    "measure": (RunWriter, "document", 12),
    "results": (RunWriter, "write_results", 1),
    "seal": (raw_stream, "seal_raw", 1),
    "sealed": (Registry, "end_run", 1),
    "zeros": (entering, "_zeroings", 1),
    "fit": (calibrating, "fit_models", 1),
    "model file": (registering, "save_model", 1),
    "register": (Registry, "add_calibration", 1),
    "register model": (Registry, "add_model", 1),
    "put into use": (Registry, "activate", 1),
    "verify": (RunWriter, "write_results", 2),
    "register verification": (Registry, "add_verification", 1),
    "check": (RunWriter, "write_results", 3),
    "register check": (Registry, "add_check", 1),
    "certificate": (certificates, "certificate_files", 1),
    "archive": (certificates, "atomic_write", 2),
    "register certificate": (Registry, "add_certificate", 1),
}
"""Where each phase begins: the function of the program, and which call of it."""
EVENTS = ("killed", "disk full", "database restarts")
DOWN_S = 2.0
"""How long a restart of the database takes, s."""
LONGEST_S = 250.0
LATE_S = 0.05
"""How long after the beginning of its phase something happens at most, s."""


@contextlib.contextmanager
def at_phase(phase: str, happens: Callable[[], None]) -> Iterator[None]:
    """Have something happen once where a phase begins; nothing of the program is replaced."""
    owner, name, count = PHASES[phase]
    original: Callable[..., Any] = getattr(owner, name)
    left = count

    def entered(*arguments: Any, **options: Any) -> Any:
        nonlocal left
        left -= 1
        if left == 0:
            happens()
        return original(*arguments, **options)

    setattr(owner, name, entered)
    try:
        yield
    finally:
        setattr(owner, name, original)


def calibration() -> Profile:
    """Return the calibration that is gone through: 16 points in two series."""
    return load_profile("rapid-in-situ").with_options(step_percent=25.0)


def certified(data: Path, seed: int) -> None:
    """Calibrate, fit, register, verify, check and certify the output of a simulated bench."""
    text = default_bench().model_dump()
    text["driver"]["seed"] = seed
    with Station.open(BenchDescription.model_validate(text), data) as station:
        registry, profile = station.registry, calibration()
        known = registers_calibration([ModelChoice(MODEL)], MODEL)
        measured = measure_calibration(station, "output", profile, metadata=known)
        done = CALIBRATION.evaluate_and_register(registry, measured)
        fresh = load_profile("verification").with_options(groups=1, points=8)
        verify_on_bench(station, "output", fresh, done.registered.models, seed)
        check_module(station, "output", load_profile("check"), 0.5)
        certify(registry)


def certify(registry: Registry) -> None:
    """Issue the certificate of the newest calibration."""

    def issue() -> None:
        newest = registry.calibrations(limit=1)[0]
        issue_certificate(
            registry, build_record(registry, newest, Issue(["A. Boss"], refuse_unreviewed=False))
        )

    registry.patiently(issue)


def stopped(event: str, phase: str, data: Path, seed: int, late_s: float) -> str:
    """Go through it in a process of its own, which is killed or whose disk gets full."""
    # Forked from a process without threads, since this one may have some.
    context = get_context("forkserver")
    context.set_forkserver_preload([__name__])
    child = context.Process(target=_child, args=(event, phase, data, seed, late_s))
    child.start()
    child.join(LONGEST_S)
    if child.exitcode is None:
        child.kill()
        child.join()
        return "it hangs"
    return "" if child.exitcode in (0, -signal.SIGKILL) else f"it ended with {child.exitcode}"


def _child(event: str, phase: str, data: Path, seed: int, late_s: float) -> None:
    """Go through it until something happens; anything but an error of torquebench is a fault."""
    logging.getLogger("torquebench").addHandler(logging.NullHandler())

    def happens() -> None:
        if event == "killed":
            os.kill(os.getpid(), signal.SIGKILL)
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))

    def begins() -> None:
        if late_s:
            timer = threading.Timer(late_s, happens)
            timer.daemon = True
            timer.start()
        else:
            happens()

    with at_phase(phase, begins), contextlib.suppress(TorquebenchError, OSError):
        certified(data, seed)


def _restarted(server: Any, phase: str, data: Path, seed: int, late_s: float) -> str:
    """Go through it here while the registry's server restarts; it has to come to its end."""
    starting: list[threading.Thread] = []

    def restart() -> None:
        time.sleep(late_s)
        server.stop()
        time.sleep(DOWN_S)
        server.start()

    def begins() -> None:
        thread = threading.Thread(target=restart)
        starting.append(thread)
        thread.start()
        if not late_s:
            time.sleep(0.3)  # it is down when the phase goes on

    problem = ""
    try:
        with at_phase(phase, begins):
            certified(data, seed)
    except (TorquebenchError, OSError) as error:
        problem = f"not survived: {error}"
    for thread in starting:
        thread.join()
    return problem if starting else "the phase never came"


def one_phase(
    event: str, phase: str, data: Path, seed: int, *, late_s: float = 0.0, server: Any = None
) -> Outcome:
    """Let one thing happen at one phase, and look what the next start makes of it.

    Parameters
    ----------
    event : str
        One of `EVENTS`.
    phase : str
        One of `PHASES`.
    data : pathlib.Path
        The data directory, empty.
    seed : int
        Of the bench.
    late_s : float
        How long after the phase begins, s.
    server : object, optional
        The PostgreSQL server that restarts; it has `stop`, `start` and `url`.
    """
    with _registry_at(server):
        if event == "database restarts":
            problems = [_restarted(server, phase, data, seed, late_s)]
        else:
            problems = [stopped(event, phase, data, seed, late_s)]
        before, named = _acknowledged(data), ""
        try:
            named, wrong = _finished(data, seed)
            problems += wrong
        except (TorquebenchError, OSError, AssertionError) as error:
            problems.append(f"can't be finished: {type(error).__name__}: {error}")
        if any(len(_points(data / "runs" / run)) < count for run, count in before.items()):
            problems.append("an acknowledged point is lost")
    return Outcome(
        f"{event}: {phase}",
        "calibrate, verify, check, certify",
        "recovered" if named else "harmless",
        named,
        float("nan"),
        sum(before.values()),
        tuple(problem for problem in problems if problem),
    )


@contextlib.contextmanager
def _registry_at(server: Any) -> Iterator[None]:
    """Keep the registry on a server, where there is one."""
    if server is None:
        yield
        return
    before = os.environ.get(REGISTRY_URL)
    os.environ[REGISTRY_URL] = server.url
    try:
        yield
    finally:
        os.environ.pop(REGISTRY_URL)
        if before is not None:
            os.environ[REGISTRY_URL] = before


def _finished(data: Path, seed: int) -> tuple[str, list[str]]:
    """Start again, finish everything as the messages say; say what was found and what is wrong."""
    problems: list[str] = []
    with Registry.open(data) as registry:
        recovered = recover_unfinished(registry)
        problems += [each.problem for each in recovered if each.problem]
        unfinished = unfinished_runs(registry)
        found = [each.state.value for each in unfinished] or ["entered"] * bool(recovered)
        for run in unfinished:
            if run.state is not RunState.INTERRUPTED:
                finish_recorded_run(registry, run)
        interrupted = [run for run in unfinished if run.state is RunState.INTERRUPTED]
        known = registry.calibrations()
        begun = sum(run.kind == "calibrate-output" for run in registry.runs())
    if not known:
        _measured_on(data, seed, bool(interrupted))
        found += [] if interrupted else ["begun again"]
    with Registry.open(data) as registry:
        problems += [f"still there: {each.found}" for each in unfinished_runs(registry)]
        entries = registry.calibrations()
        if len(entries) != 1 or entries[0].points != 16:
            problems.append(f"calibrations of {[each.points for each in entries]} points")
        used = registry.activations(SERIAL)
        if len(used) != 1 or len(registry.models()) != 1:
            problems.append(f"{len(registry.models())} models, put into use {len(used)} times")
        runs = registry.runs()
        if known and sum(run.kind == "calibrate-output" for run in runs) != begun:
            problems.append("the calibration was measured again")
        checks = [run for run in runs if run.kind == "check-output" and run.status == "completed"]
        if len(registry.checks(SERIAL)) != len(checks):
            problems.append("a check isn't registered once")
        zeroed = {zeroing.run_id for zeroing in registry.zeroings(SERIAL)}
        lost = [r.run_id for r in runs if r.status == "completed" and r.run_id not in zeroed]
        problems += [f"no zero of {run_id}" for run_id in lost]
        if not registry.certificates():
            certify(registry)
        if len(registry.certificates()) != 1:
            problems.append("certified twice")
        for each in runs:
            if each.finished is None:
                problems.append(f"run {each.run_id} has no end")
            RunFolder.open(each.folder).verify()
    return ", ".join(dict.fromkeys(found)), problems


def _measured_on(data: Path, seed: int, goes_on: bool) -> None:
    """Go on with the interrupted calibration, or begin it again where nothing of it is there."""
    text = default_bench().model_dump()
    text["driver"]["seed"] = seed
    known, profile = registers_calibration([ModelChoice(MODEL)], MODEL), calibration()
    with Station.open(BenchDescription.model_validate(text), data) as station:
        registry = station.registry
        if goes_on:
            (left,) = unfinished_runs(registry)
            before = read_interrupted(registry, registry.run(left.run_id))
            measured = resume_calibration(station, before, metadata=known)
        else:
            measured = measure_calibration(station, "output", profile, metadata=known)
        CALIBRATION.evaluate_and_register(registry, measured)


def _acknowledged(data: Path) -> dict[str, int]:
    """Count the whole events of every run, from outside."""
    return {path.name: len(_points(path)) for path in data.glob("runs/*")}


def _points(folder: Path) -> Sequence[bytes]:
    file = folder / "events.jsonl"
    lines = file.read_bytes().rpartition(b"\n")[0].split(b"\n") if file.exists() else []
    return [line for line in lines if line.startswith(b'{"name": "event"')]
