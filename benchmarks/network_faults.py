"""Faults on the wire: the bench of examples/networked.toml over real sockets, broken on command.

Every simulated instrument is late, silent, cut short, garbled, gone, frozen or lies while a zero,
a calibration or a verification runs; `benchmarks.faults` calls it and counts what is left.
"""

from __future__ import annotations

import contextlib
import re
import tempfile
import threading
import time
import tomllib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.faults import PROCEDURES, TRIES, Outcome, Procedure, checked, line_of
from torquebench.bench.description import BenchDescription
from torquebench.bench.description_errors import validated
from torquebench.bench.drivers.base import Side
from torquebench.bench.safety import Alarm
from torquebench.errors import TorquebenchError
from torquebench.procedures import rehearse
from torquebench.records import RunFolder
from torquebench.simulators import KINDS, MisbehaviourKind, Simulators
from torquebench.station import Station

__all__ = ["WireFault", "network_campaign", "networked", "wire_faults"]

EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "networked.toml"
ENDPOINTS = ("counter", "input_drive", "output_drive", "reference", "temperature", "modes", "clamp")
SET_UP_ONLY = ("modes", "clamp")
"""Asked while a procedure sets up the bench; they misbehave from its start."""
MAY_DO_NO_HARM: tuple[MisbehaviourKind, ...] = ("freeze", "lie")
"""An answer in the right form that nobody can doubt may go unnoticed, if it makes nothing wrong."""
AT_REST_S = 15.0
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

    def fits(self, procedure: str, side: Side) -> bool:
        """Whether a procedure needs this instrument."""
        if self.endpoint in ("counter", "temperature", *SET_UP_ONLY):
            return procedure.startswith(("calibrate", "verify")) or (
                procedure == "zero" and self.endpoint == "counter"
            )
        if not procedure.startswith(("calibrate", "verify")):
            return False
        return self.endpoint == "reference" or self.endpoint == f"{side}_drive"


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
        lasts_s = rehearse(station.devices, procedure.plan(station)).duration_s
        due_s = moment(fault, simulators.plant.now_s, lasts_s, draw)
        powered = procedure.name != "zero" and fault.endpoint not in SET_UP_ONLY
        error: BaseException | None = None
        with Breaker(simulators, fault, procedure.side, due_s, powered=powered) as breaker:
            try:
                station.run(procedure.plan(station), kind="fault")
            except Exception as raised:
                error = raised
            station.supervisor.wait_safe(AT_REST_S)
        alarms = station.supervisor.history
        if breaker.broken_s is None:
            return Outcome(fault.name, procedure.name, "too late", "", float("nan"), 0, ())
        run = station.registry.runs(limit=1)[0]
        folder = RunFolder.open(run.folder)
        points, wrong = checked(folder, station.description, stopped=error is not None)
        problems = [*_problems(fault, breaker, error, alarms), *wrong]
        if error is not None and run.status != "failed":
            problems.append(f"the run is {run.status}")
    status = "harmless" if error is None else "stopped" if alarms else "refused"
    named = alarms[0].name if alarms else type(error).__name__ if error is not None else ""
    safe_s = breaker.wall_s if error is not None and breaker.was_on else float("nan")
    return Outcome(fault.name, procedure.name, status, named, safe_s, points, tuple(problems))


def _problems(
    fault: WireFault, breaker: Breaker, error: BaseException | None, alarms: Sequence[Alarm]
) -> list[str]:
    """Say what is wrong with the way it ended, the record apart."""
    found = []
    if not breaker.at_rest():
        found.append("a drive isn't off")
    if error is not None and not isinstance(error, TorquebenchError):
        found.append(f"unforeseen {type(error).__name__}: {error}")
    if fault.must_be_noticed and error is None:
        found.append("nobody noticed it")
    if error is not None and breaker.was_on and not alarms:
        found.append(f"no alarm, only {type(error).__name__}: {error}")
    return found


def network_campaign(
    number: int, seed: int, *, told: Callable[[str], None] = lambda _line: None
) -> list[Outcome]:
    """Go through so many faults on the wire; each gets a bench of its own."""
    draw = np.random.default_rng(seed)
    outcomes = []
    with tempfile.TemporaryDirectory() as scratch:
        for index, fault in enumerate(wire_faults()[:number]):
            fitting = [each for each in PROCEDURES if fault.fits(each.name, each.side)]
            for attempt in range(TRIES):  # until it comes before the procedure's end
                procedure = fitting[int(draw.integers(len(fitting)))]
                folder = Path(scratch, f"{index}-{attempt}")
                outcome = one_wire_fault(fault, procedure, seed + index, folder, draw)
                if outcome.status != "too late":
                    break
            outcomes.append(outcome)
            told(line_of(outcome))
    return outcomes
