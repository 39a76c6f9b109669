"""Faults on the wire: the bench of examples/networked.toml over real sockets, broken on command.

Every simulated instrument is late, silent, cut short, garbled, gone, frozen or lies while some
procedure runs that needs it; `benchmarks.faults` calls it and counts what is left.
"""

from __future__ import annotations

import contextlib
import re
import tempfile
import threading
import time
import tomllib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.fault_judging import (
    Outcome,
    differing,
    ended_badly,
    record_of,
    slipped,
    status_of,
)
from benchmarks.fault_procedures import PROCEDURES, Procedure
from benchmarks.faults import TRIES
from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.base import Side
from torquebench.bench.safety import Alarm
from torquebench.campaign.reducers.results import ReducerTestRecord
from torquebench.procedures.reducers.turning import TransmissionRecording
from torquebench.simulators import MisbehaviourKind, Simulators
from torquebench.station import Station
from torquebench.validation import validated

__all__ = ["WireFault", "networked", "numbered_wire", "wire_faults"]

EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "networked.toml"
ENDPOINTS = ("counter", "input_drive", "output_drive", "reference", "temperature", "modes", "clamp")
KINDS: tuple[MisbehaviourKind, ...] = (
    "delay",
    "drop",
    "cut",
    "garble",
    "disconnect",
    "freeze",
    "lie",
)
"""What an instrument's answers may suffer."""
SET_UP_ONLY = ("modes", "clamp")
"""Asked while a procedure sets up the bench; they misbehave from its start."""
MAY_DO_NO_HARM: tuple[MisbehaviourKind, ...] = ("freeze", "lie")
"""An answer in the right form that nobody can doubt may go unnoticed, if it makes nothing wrong."""
AT_REST_S = 15.0
"""How long both drives may take to go off, s of wall time, with every time-out on the way."""
SAFE_S = 2.0
"""Longest time until both drives are off, s of bench time: the drive's own watchdog included."""
PROBES_S = 5.0
"""The same where probes don't answer, wall time: heat is slow, and they are asked once a second."""
SLOW = ("calibrate output staircase", "calibrate output small-torques")
"""Left out: over sockets they take long to compute."""
DELAY_S = 3.0
"""A late answer comes after every time-out."""
TIMEOUT_S = {"counter": 2.0}
"""How long an instrument is waited for, s of wall time; 0.5 s for all others."""


@dataclass(frozen=True)
class WireFault:
    """One way in which one instrument misbehaves.

    Parameters
    ----------
    endpoint : str
        As the sections of ``[driver]`` are called.
    kind : str
        See `torquebench.simulators.misbehaviour`.
    """

    endpoint: str
    kind: MisbehaviourKind

    @property
    def name(self) -> str:
        """What it is called in the report."""
        return f"wire: {self.endpoint} {self.kind}"

    @property
    def must_be_noticed(self) -> bool:
        """Whether an answer is missing or unreadable."""
        return self.kind not in MAY_DO_NO_HARM

    def fits(self, procedure: Procedure) -> bool:
        """Whether a procedure needs this instrument."""
        if self.endpoint == "counter":
            return True
        if self.endpoint == "reference":
            return procedure.standard
        drive = self.endpoint.removesuffix("_drive")
        return procedure.loads and (drive == self.endpoint or drive == procedure.side)


def wire_faults() -> list[WireFault]:
    """Every kind at every instrument, in an order that mixes both."""
    number = len(ENDPOINTS)
    return [
        WireFault(ENDPOINTS[(index + round_) % number], kind)
        for round_ in range(number)
        for index, kind in enumerate(KINDS)
    ]


def networked(seed: int) -> BenchDescription:
    """Describe the bench of examples/networked.toml on free ports."""
    text = re.sub(r'"127\.0\.0\.1:\d+"', '"127.0.0.1:0"', EXAMPLE.read_text(encoding="utf-8"))
    values = tomllib.loads(text)
    values["driver"]["output_drive"]["bus"]["port"] = 0
    values["driver"]["simulation"]["seed"] = seed
    for endpoint in ENDPOINTS:
        values["driver"][endpoint]["timeout_s"] = TIMEOUT_S.get(endpoint, 0.5)
    return validated(BenchDescription, values, EXAMPLE.name)


@contextlib.contextmanager
def opened(seed: int, data: Path) -> Iterator[tuple[Station, Simulators]]:
    """Serve all instruments and open a station on them."""
    with (
        Simulators(networked(seed)) as simulators,
        Station.open(simulators.description, data) as station,
    ):
        yield station, simulators


class Breaker:
    """Has an instrument misbehave at a moment of bench time, and times the way to rest.

    Parameters
    ----------
    simulators : Simulators
    fault : WireFault
    side : {"input", "output"}
        The side that the procedure drives.
    due_s : float
        Bench time of the plant, s; not before that side's drive has power, unless the instrument
        is only asked while the bench is set up, or `powered` is False.
    powered : bool
    """

    def __init__(
        self,
        simulators: Simulators,
        fault: WireFault,
        side: Side,
        due_s: float,
        *,
        powered: bool = True,
    ) -> None:
        self._simulators = simulators
        self._fault = fault
        self._side: Side = side
        self._due_s = due_s
        self._powered = powered
        self._over = threading.Event()
        self.broken_s: float | None = None
        self.was_on = False
        self.safe_s: float | None = None
        self.wall_s = float("nan")
        self._thread = threading.Thread(target=self._watch, name="breaker", daemon=True)

    def at_rest(self) -> bool:
        """Whether both drives are off without torque and speed, whatever they say."""
        states = [drive.state() for drive in self._simulators.plant.bench.drives.values()]
        return not any(state.enabled or state.torque_nm or state.speed_rad_s for state in states)

    def __enter__(self) -> Breaker:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        deadline = time.monotonic() + AT_REST_S
        while self.broken_s is not None and self.safe_s is None and time.monotonic() < deadline:
            time.sleep(0.01)
        self._over.set()
        self._thread.join()
        self._simulators.misbehaviour.heal()

    def _watch(self) -> None:
        plant = self._simulators.plant
        began = 0.0
        while not self._over.wait(0.001):
            if self.broken_s is None:
                if plant.now_s < self._due_s or (self._powered and not self._is_on()):
                    continue
                self.was_on = self._is_on()
                self.broken_s, began = plant.now_s, time.monotonic()
                self._simulators.misbehaviour.start(
                    self._fault.endpoint, self._fault.kind, amount=DELAY_S, duration_s=60.0
                )
            elif self.at_rest():
                self.safe_s, self.wall_s = plant.now_s, time.monotonic() - began
                return

    def _is_on(self) -> bool:
        return self._simulators.plant.bench.drives[self._side].state().enabled


def moment(fault: WireFault, start_s: float, lasts_s: float, draw: np.random.Generator) -> float:
    """Draw when it comes: at once where the instrument is only asked at the beginning."""
    if fault.endpoint in SET_UP_ONLY:
        return start_s
    return start_s + float(draw.uniform(0.05, 0.6)) * lasts_s


def one_wire_fault(
    fault: WireFault, procedure: Procedure, seed: int, data: Path, draw: np.random.Generator
) -> Outcome:
    """Run a procedure over the sockets, spoil the answers meanwhile, and look what is left."""
    with opened(seed, data) as (station, simulators):
        due_s = moment(fault, simulators.plant.now_s, procedure.lasts_s(station), draw)
        powered = procedure.loads and fault.endpoint not in SET_UP_ONLY
        error: BaseException | None = None
        result: object = None
        with Breaker(simulators, fault, procedure.side, due_s, powered=powered) as breaker:
            try:
                result = procedure.go(station)
            except Exception as raised:
                error = raised
            station.supervisor.wait_safe(AT_REST_S)
        alarms = station.supervisor.history
        if breaker.broken_s is None:
            return Outcome(fault.name, procedure.name, "too late", "", float("nan"), 0)
        points, wrong = record_of(station, error)
        problems = [*_problems(fault, breaker, error, alarms), *wrong]
        if isinstance(result, TransmissionRecording):
            problems += slipped(result)
        if isinstance(result, ReducerTestRecord):
            undisturbed = procedure.go(station)
            assert isinstance(undisturbed, ReducerTestRecord)
            problems += differing(result, undisturbed)
    status, named = status_of(error, alarms)
    timed = error is not None and breaker.was_on and breaker.safe_s is not None
    return Outcome(
        fault.name,
        procedure.name,
        status,
        named,
        (breaker.safe_s or 0.0) - breaker.broken_s if timed else float("nan"),
        points,
        tuple(problems),
        wall_s=breaker.wall_s if timed else float("nan"),
    )


def _problems(
    fault: WireFault, breaker: Breaker, error: BaseException | None, alarms: Sequence[Alarm]
) -> Iterator[str]:
    """Say what is wrong with the way it ended, the record apart."""
    yield from ended_badly(error, alarms, breaker.at_rest(), disk=False)
    if fault.must_be_noticed and error is None:
        yield "nobody noticed it"
    if error is not None and breaker.was_on and not alarms:
        yield f"no alarm, only {type(error).__name__}: {error}"
    if error is not None and breaker.was_on and breaker.safe_s is not None:
        bench_s = breaker.safe_s - (breaker.broken_s or 0.0)
        if fault.endpoint == "temperature":
            if breaker.wall_s > PROBES_S:
                yield f"safe only after {breaker.wall_s:.2f} s"
        elif bench_s > SAFE_S:
            yield f"safe only after {bench_s:.2f} s of bench time"


def drawn_wires(number: int, seed: int) -> list[tuple[WireFault, list[Procedure]]]:
    """Take wire faults in turn, each with the procedures that fit it, rarest first."""
    draw = np.random.default_rng(seed)
    counts: Counter[str] = Counter()
    plan = []
    quick = [each for each in PROCEDURES if each.name not in SLOW]
    for fault in wire_faults()[:number]:
        fitting = [each for each in quick if fault.fits(each)]
        order = draw.permutation(len(fitting))
        fitting = sorted((fitting[place] for place in order), key=lambda each: counts[each.name])
        counts[fitting[0].name] += 1
        plan.append((fault, fitting))
    return plan


def numbered_wire(index: int, seed: int) -> Outcome:
    """Go through one fault on the wire; with another procedure where it came after the end."""
    fault, fitting = drawn_wires(index + 1, seed)[-1]
    draw = np.random.default_rng([seed, index])
    with tempfile.TemporaryDirectory() as scratch:
        for attempt in range(TRIES):
            procedure, folder = fitting[attempt % len(fitting)], Path(scratch, str(attempt))
            outcome = one_wire_fault(fault, procedure, seed + index, folder, draw)
            if outcome.status != "too late":
                break
    return replace(outcome, index=index, seed=seed)
