"""Faults on the wire: the bench of examples/networked.toml over real sockets, broken on command.

Every simulated instrument is late, silent, cut short, garbled, gone, frozen, lies, disobeys, has a
wrong scale or a clock of its own while some procedure runs that needs it, in simulated and in real
time.
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
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from tests.support.faults.bench import TRIES
from tests.support.faults.judging import (
    Outcome,
    await_safe,
    differing,
    ended_badly,
    record_of,
    slipped,
    status_of,
    unsafe_end,
)
from tests.support.faults.procedures import PROCEDURES, Procedure
from tests.support.faults.served import Served, moves, served

from torquebench.bench.description import BenchDescription
from torquebench.bench.roles import Side
from torquebench.bench.safety import Alarm
from torquebench.campaign.reducers.results import ReducerTestRecord
from torquebench.errors import BenchError
from torquebench.procedures.reducers.turning import TransmissionRecording
from torquebench.simulators import MisbehaviourKind
from torquebench.station import Station
from torquebench.validation import validated

__all__ = ["WireFault", "networked", "numbered_real", "numbered_wire", "opened", "wire_faults"]

Time = Literal["on-demand", "real"]
EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "networked.toml"
ENDPOINTS = ("counter", "input_drive", "output_drive", "reference", "temperature", "modes", "clamp")
DRIVES = ("input_drive", "output_drive")
MODBUS = ("input_drive", "temperature", "modes", "clamp")
ASKED_AGAIN = (*DRIVES, "reference", "temperature", "modes", "clamp")


@dataclass(frozen=True)
class Order:
    """One misbehaviour that is ordered; see `torquebench.simulators.misbehaviour`."""

    kind: MisbehaviourKind
    amount: float | None = None
    replies: int | None = None


KINDS: dict[str, tuple[tuple[str, ...], tuple[Order, ...]]] = {
    "delay": (ENDPOINTS, (Order("delay", 3.0),)),  # after every time-out
    "drop": (ENDPOINTS, (Order("drop"),)),
    "cut": (ENDPOINTS, (Order("cut"),)),
    "garble": (ENDPOINTS, (Order("garble"),)),
    "disconnect": (ENDPOINTS, (Order("disconnect"),)),
    "freeze": (ENDPOINTS, (Order("freeze"),)),
    "lie": (ENDPOINTS, (Order("lie"),)),
    "ignore": ((*DRIVES, "modes", "clamp"), (Order("ignore"),)),
    "stay on": (DRIVES, (Order("ignore"), Order("unguarded"))),
    "scale": (("counter", *DRIVES, "reference", "temperature"), (Order("scale", 1.03),)),
    "jitter": (("counter", "reference"), (Order("jitter", 0.1),)),
    "busy": (MODBUS, (Order("busy"),)),
    "local": (("output_drive",), (Order("local"),)),
    "not yet": (("output_drive",), (Order("not yet", replies=3),)),
    "latency": (ENDPOINTS, (Order("delay", 0.003),)),
    "slow": (DRIVES, (Order("slow", 0.3),)),
    "drop once": (ASKED_AGAIN, (Order("drop", replies=1),)),
    "busy once": (MODBUS, (Order("busy", replies=1),)),
}
"""What is ordered of which instruments."""
SET_UP_ONLY = ("modes", "clamp")
"""RunningPoint while a procedure sets up the bench; they misbehave from its start."""
MAY_DO_NO_HARM = ("freeze", "lie", "ignore", "scale", "jitter")
"""An answer in the right form that nobody can doubt may go unnoticed, if it makes nothing wrong."""
DOES_NO_HARM = ("latency", "slow", "drop once", "busy once", "not yet")
"""An instrument that is a little slow, or fails once, is no reason to stop."""
AT_REST_S = 15.0
"""How long both drives may take to go off, s of wall time, with every time-out on the way."""
SAFE_S: dict[Time, float] = {"on-demand": 2.0, "real": 5.0}
"""Longest time until both drives are off, s of bench time: the drive's own watchdog included, and
in real time every time-out. It begins with the fault, or with the alarm where nobody can doubt the
answers of an instrument before."""
POLL_S = 0.002
"""How often it looks what the drives do, s of wall time."""
STANDS_S = 0.1
"""A look that takes longer says that the computer was taken away, s of wall time."""
LASTING_S = 120.0
"""Until an instrument is itself again, s of wall time."""
PROBES_S = 5.0
"""The same where probes don't answer, wall time: heat is slow, and they are asked once a second."""
SLOW = ("calibrate output staircase", "calibrate output small-torques")
"""Left out: over sockets they take long to compute."""
LONG = (
    "calibrate input reversing",
    "calibrate output staircase",
    "efficiency map",
    "test no-load",
    "test efficiency",
)
"""Left out in real time: they last longer than 45 s on the bench."""
KEPT_POWER_S = 3.0
"""How long to wait for a drive that doesn't go off whatever it is told, s of wall time."""
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
        A key of `KINDS`.
    """

    endpoint: str
    kind: str

    @property
    def name(self) -> str:
        """What it is called in the report."""
        return f"wire: {self.endpoint} {self.kind}"

    @property
    def must_be_noticed(self) -> bool:
        """Whether an answer is missing or unreadable, or power stays on."""
        return self.kind not in (*MAY_DO_NO_HARM, *DOES_NO_HARM)

    @property
    def from_the_start(self) -> bool:
        """Whether it is met before power is on, if at all."""
        return self.endpoint in SET_UP_ONLY or self.kind == "slow"

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
    return [
        WireFault(endpoints[(round_ + index) % len(endpoints)], kind)
        for round_ in range(len(ENDPOINTS))
        for index, (kind, (endpoints, _)) in enumerate(KINDS.items())
        if round_ < len(endpoints)
    ]


def networked(seed: int, time: Time = "on-demand") -> BenchDescription:
    """Describe the bench of examples/networked.toml on free ports."""
    text = re.sub(r'"127\.0\.0\.1:\d+"', '"127.0.0.1:0"', EXAMPLE.read_text(encoding="utf-8"))
    values = tomllib.loads(text)
    values["driver"]["output_drive"]["bus"]["port"] = 0
    values["driver"]["simulation"] |= {"seed": seed, "time": time}
    for endpoint in ENDPOINTS:
        if endpoint.endswith("_drive"):
            continue  # its time-out follows from its watchdog
        values["driver"][endpoint]["timeout_s"] = TIMEOUT_S.get(endpoint, 0.5)
    return validated(BenchDescription, values, EXAMPLE.name)


@contextlib.contextmanager
def opened(seed: int, data: Path, time: Time) -> Iterator[tuple[Station, Served]]:
    """Serve all instruments and open a station on them."""
    with served(networked(seed, time)) as instruments:
        station = Station.open(instruments.description, data)
        try:
            yield station, instruments
        finally:
            with contextlib.suppress(BenchError):  # what isn't off in the end was judged before
                station.close()


class Breaker:
    """Has an instrument misbehave at a moment of bench time, and times the way to rest.

    Both drives were off for the first time at `safe_s`, and are since `resting_s`. On the way a
    busy computer was taken away for `stood_s` of wall time.

    Parameters
    ----------
    bench : Served
    fault : WireFault
    side : {"input", "output"}
        The side that the procedure drives.
    due_s : float
        Bench time of the plant, s.
    powered : bool
        Not before that side's drive has power.
    """

    def __init__(
        self,
        bench: Served,
        fault: WireFault,
        side: Side,
        due_s: float,
        *,
        powered: bool = True,
    ) -> None:
        self._bench = bench
        self._fault = fault
        self._side: Side = side
        self._due_s = due_s
        self._powered = powered
        self._over = threading.Event()
        self.broken_s: float | None = None
        self.was_on = False
        self.safe_s: float | None = None
        self.resting_s: float | None = None
        self.wall_s = float("nan")
        self.stood_s = 0.0
        self._thread = threading.Thread(target=self._watch, name="breaker", daemon=True)

    def at_rest(self) -> bool:
        """Whether both drives are off without torque and speed, whatever they say."""
        return not moves(self._bench.status())

    def __enter__(self) -> Breaker:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        self._bench.heal()

    def await_rest(self) -> None:
        """Wait until both drives are off."""
        deadline = time.monotonic() + AT_REST_S
        while self.broken_s is not None and self.resting_s is None and time.monotonic() < deadline:
            time.sleep(0.01)

    def _watch(self) -> None:
        began, looked = 0.0, time.monotonic()
        while not self._over.wait(POLL_S):
            status = self._bench.status()
            before, looked = looked, time.monotonic()
            if self.broken_s is not None and self.resting_s is None and looked - before > STANDS_S:
                self.stood_s += looked - before
            now_s, is_on = float(status["time_s"]), status["drives"][self._side]["enabled"]
            if self.broken_s is None:
                if now_s < self._due_s or (self._powered and not is_on):
                    continue
                self.was_on = is_on
                self.broken_s, began = now_s, time.monotonic()
                for order in KINDS[self._fault.kind][1]:
                    self._bench.misbehave(
                        self._fault.endpoint,
                        order.kind,
                        amount=order.amount,
                        replies=order.replies,
                        duration_s=LASTING_S,
                    )
            elif moves(status):
                self.resting_s = None
            elif self.resting_s is None:
                self.resting_s = now_s
                if self.safe_s is None:
                    self.safe_s, self.wall_s = now_s, time.monotonic() - began


def moment(fault: WireFault, start_s: float, lasts_s: float, draw: np.random.Generator) -> float:
    """Draw when it comes: at once where the instrument is only asked at the beginning."""
    if fault.from_the_start:
        return start_s
    return start_s + float(draw.uniform(0.05, 0.6)) * lasts_s


def one_wire_fault(
    fault: WireFault,
    procedure: Procedure,
    seed: int,
    data: Path,
    draw: np.random.Generator,
    time: Time = "on-demand",
) -> Outcome:
    """Run a procedure over the sockets, spoil the answers meanwhile, and look what is left."""
    with opened(seed, data, time) as (station, bench):
        due_s = moment(fault, bench.now_s, procedure.lasts_s(station), draw)
        powered = procedure.loads and not fault.from_the_start
        error: BaseException | None = None
        result: object = None
        with Breaker(bench, fault, procedure.side, due_s, powered=powered) as breaker:
            try:
                result = procedure.go(station)
            except Exception as raised:
                error = raised
            stays_on = fault.kind == "stay on"
            station.supervisor.wait_safe(KEPT_POWER_S if stays_on else AT_REST_S)
            if not stays_on:
                breaker.await_rest()
            unsafe = list(unsafe_end(station, breaker.at_rest()))
        await_safe(station, AT_REST_S)  # it is itself again, and says that it is off
        alarms = station.supervisor.history
        safe_s = time_to_rest(fault, breaker, error, alarms)
        if breaker.broken_s is None:
            return Outcome(fault.name, procedure.name, "too late", "", float("nan"), 0)
        points, wrong = record_of(station, error, spoilt=fault.kind == "scale")
        problems = [*unsafe, *_problems(fault, breaker, error, alarms, safe_s, time), *wrong]
        if isinstance(result, TransmissionRecording):
            problems += slipped(result)
        if isinstance(result, ReducerTestRecord):
            undisturbed = procedure.go(station)
            assert isinstance(undisturbed, ReducerTestRecord)
            problems += differing(result, undisturbed)
    status, named = status_of(error, alarms)
    timed = fault.must_be_noticed and np.isfinite(safe_s)
    return Outcome(
        fault.name,
        procedure.name,
        status,
        named,
        safe_s,
        points,
        tuple(problems),
        wall_s=breaker.wall_s if timed else float("nan"),
    )


def time_to_rest(
    fault: WireFault, breaker: Breaker, error: BaseException | None, alarms: Sequence[Alarm]
) -> float:
    """Return how long both drives took to be off, s of bench time; NaN where that says nothing.

    Answers in the right form that nobody can doubt count from the alarm that they end with: until
    then the bench does what it is told. Without an alarm a procedure refuses what it has read, and
    has taken the power off before it says so.
    """
    broken_s, safe_s, resting_s = breaker.broken_s, breaker.safe_s, breaker.resting_s
    if error is None or not breaker.was_on or broken_s is None or safe_s is None:
        return float("nan")
    if fault.must_be_noticed:
        return safe_s - broken_s
    if not alarms or resting_s is None:
        return float("nan")
    return max(0.0, resting_s - max(broken_s, alarms[0].time_s))


def _problems(
    fault: WireFault,
    breaker: Breaker,
    error: BaseException | None,
    alarms: Sequence[Alarm],
    safe_s: float,
    time: Time,
) -> Iterator[str]:
    """Say what is wrong with the way it ended, power and record apart."""
    yield from ended_badly(error, alarms, disk=False)
    if fault.kind in DOES_NO_HARM and (error is not None or alarms):
        yield f"false alarm: {alarms[0].name if alarms else error}"
        return
    if fault.must_be_noticed and error is None:
        yield "unsafe: nobody noticed it"
    if error is None or not breaker.was_on:
        return
    if not alarms and fault.must_be_noticed:  # else the procedure may refuse what it read
        yield f"other: no alarm, only {type(error).__name__}: {error}"
    if fault.endpoint == "temperature":
        if fault.must_be_noticed and breaker.wall_s > PROBES_S:
            yield f"unsafe: safe only after {breaker.wall_s:.2f} s"
    elif safe_s > SAFE_S[time] + (breaker.stood_s if time == "real" else 0.0):
        yield f"unsafe: safe only after {safe_s:.2f} s of bench time"


def drawn_wires(
    number: int, seed: int, left_out: Sequence[str] = SLOW
) -> list[tuple[WireFault, list[Procedure]]]:
    """Take wire faults in turn, each with the procedures that fit it, rarest first."""
    draw = np.random.default_rng(seed)
    counts: Counter[str] = Counter()
    plan = []
    quick = [each for each in PROCEDURES if each.name not in left_out]
    for fault in wire_faults()[:number]:
        fitting = [each for each in quick if fault.fits(each)]
        order = draw.permutation(len(fitting))
        fitting = sorted((fitting[place] for place in order), key=lambda each: counts[each.name])
        counts[fitting[0].name] += 1
        plan.append((fault, fitting))
    return plan


def numbered_wire(index: int, seed: int, time: Time = "on-demand") -> Outcome:
    """Go through one fault on the wire; with another procedure where it came after the end."""
    left_out = SLOW if time == "on-demand" else LONG
    fault, fitting = drawn_wires(index + 1, seed, left_out)[-1]
    draw = np.random.default_rng([seed, index])
    with tempfile.TemporaryDirectory() as scratch:
        for attempt in range(TRIES):
            procedure, folder = fitting[attempt % len(fitting)], Path(scratch, str(attempt))
            outcome = one_wire_fault(fault, procedure, seed + index, folder, draw, time)
            if outcome.status != "too late":
                break
    return outcome


def numbered_real(index: int, seed: int) -> Outcome:
    """Go through the same fault in real time, beside other procedures."""
    return numbered_wire(index, seed, "real")
