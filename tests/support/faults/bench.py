"""A simulated bench whose instruments fail on command, for the fault campaign and its tests."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from tests.support.faults.procedures import Procedure

from torquebench.bench.blocks import Block
from torquebench.bench.drivers.base import Drive, DriverSet, DriveState, Temperature
from torquebench.bench.drivers.simulated.driver import SimulatedBench
from torquebench.bench.roles import Side
from torquebench.errors import BenchError
from torquebench.units import RAD_S_PER_RPM

__all__ = ["KINDS", "TRIES", "FaultyBench", "Kind"]

SETTLED_BLOCKS = 3
"""A drive has power for good after so many blocks; what comes before has nothing to compare."""
TRIES = 5
"""Attempts to cause a fault whose procedure ended before its moment."""


@dataclass(eq=False)
class FaultyBench:
    """Breaks one thing when bench time has come to it, and notes when both drives were safe.

    Parameters
    ----------
    drivers : DriverSet
        Of the simulated bench.
    """

    drivers: DriverSet

    def __post_init__(self) -> None:
        self.bench = cast(SimulatedBench, self.drivers.counter)
        self.faulty = replace(
            self.drivers,
            counter=cast(Any, _Counter(self)),
            drives={side: _Drive(self, drive) for side, drive in self.drivers.drives.items()},
            temperature=_Temperature(self, self.drivers.temperature),
        )
        self.heal()

    def heal(self) -> None:
        """Break nothing from now on."""
        self.due_s = float("inf")
        self.breaking: Callable[[], None] = lambda: None
        self.broken_s: float | None = None
        self.safe_s: float | None = None
        self.resting_s: float | None = None
        self.powered = self.wants_power = False
        self.side: Side = "output"
        self.on_blocks = 0
        self.drive_fault = ""
        self.insisting: Callable[[], None] | None = None
        self.mute = self.deaf = self.unfed = False
        self.stuck = self.reversed = self.keeps_power = False
        self.lost_probe = self.dead_probes = False
        self.heat_k = 0.0
        self.counter_error: Exception | None = None

    def plan(
        self, due_s: float, breaking: Callable[[], None], side: Side, *, powered: bool
    ) -> None:
        """Break something before the first block after a moment of bench time.

        With `powered` not before the drive of that side has power.
        """
        self.due_s, self.breaking, self.side, self.wants_power = due_s, breaking, side, powered

    def at_rest(self) -> bool:
        """Whether both drives are off without torque and speed, whatever they say."""
        states = [drive.state() for drive in self.bench.drives.values()]
        return not any(state.enabled or state.torque_nm or state.speed_rad_s for state in states)

    def tick(self) -> None:
        """Break what is due, or check whether both drives are off; before every block."""
        now = self.bench.twin.time_s
        on = self.bench.drives[self.side].state().enabled
        self.on_blocks = self.on_blocks + 1 if on else 0
        if self.broken_s is None:
            settled = not self.wants_power or self.on_blocks >= SETTLED_BLOCKS
            if now >= self.due_s and settled:
                self.powered = on
                self.broken_s = now
                self.breaking()
            return
        if self.insisting is not None and on:
            self.insisting()  # whatever the procedure commands meanwhile
        if not self.at_rest():
            self.resting_s = None
        elif self.resting_s is None:
            self.resting_s = now
        if self.safe_s is None:
            self.safe_s = self.resting_s


class _Counter:
    """The twin's counter, until its connection breaks."""

    def __init__(self, owner: FaultyBench) -> None:
        self._owner = owner

    def __getattr__(self, name: str) -> Any:
        return getattr(self._owner.bench, name)

    def read_block(self, duration_s: float) -> Block:
        self._owner.tick()
        if self._owner.counter_error is not None:
            raise self._owner.counter_error
        return self._owner.bench.read_block(duration_s)


class _Drive:
    """A drive that may not answer, may not do or do something else, and may not be fed."""

    def __init__(self, owner: FaultyBench, drive: Drive) -> None:
        self._owner = owner
        self._drive = drive

    def __getattr__(self, name: str) -> Any:
        return getattr(self._drive, name)

    def command_torque(self, torque_nm: float, ramp_nm_per_s: float) -> None:
        if self._obeys():
            sign = -1.0 if self._owner.reversed else 1.0
            self._drive.command_torque(sign * torque_nm, ramp_nm_per_s)

    def command_speed(self, speed_rad_s: float, ramp_rad_per_s2: float) -> None:
        if self._obeys():
            sign = -1.0 if self._owner.reversed else 1.0
            self._drive.command_speed(sign * speed_rad_s, ramp_rad_per_s2)

    def disable(self) -> None:
        if not self._owner.keeps_power:
            self._drive.disable()

    def ramp_to_zero(self, duration_s: float) -> None:
        if self._obeys():
            self._owner.insisting = None
            self._drive.ramp_to_zero(duration_s)

    def feed_watchdog(self) -> None:
        if not self._owner.unfed:
            self._drive.feed_watchdog()

    def state(self) -> DriveState:
        if self._owner.mute:
            raise BenchError("the drive doesn't answer", "an answer", "check its connection")
        state = self._drive.state()
        fault = self._owner.drive_fault
        return replace(state, fault=fault) if fault else state

    def _obeys(self) -> bool:
        if self._owner.deaf:
            raise BenchError("the drive refuses the command", "an answer", "check the drive")
        return not self._owner.stuck


class _Temperature:
    """Probes that get lost, fail or get hot."""

    def __init__(self, owner: FaultyBench, probes: Temperature) -> None:
        self._owner = owner
        self._probes = probes

    def temperatures(self) -> Mapping[str, float]:
        if self._owner.dead_probes:
            raise BenchError("the probes don't answer", "an answer", "check their connection")
        found = {name: t + self._owner.heat_k for name, t in self._probes.temperatures().items()}
        if self._owner.lost_probe:
            found = {name: t for name, t in found.items() if not name.endswith("transducer")}
        return found


@dataclass(frozen=True)
class Kind:
    """A kind of fault.

    Parameters
    ----------
    name : str
    breaking : callable
        Takes the bench, the driven side and a generator, and breaks something for good.
    needs_power : bool
        Whether it only matters, and is only noticed, while a drive has power.
    """

    name: str
    breaking: Callable[[FaultyBench, Side, np.random.Generator], None]
    needs_power: bool = True

    def fits(self, procedure: Procedure) -> bool:
        """Whether it can happen in a procedure: a zero has no power, a reducer no standard."""
        if self.needs_power and not procedure.loads:
            return False
        if self.name == "encoder slips":
            return procedure.angles
        if self.name == "drive turns too fast":
            return not procedure.waits_for_motion
        compared = self.spoils or self.name.startswith("standard")
        return procedure.standard or not compared

    @property
    def spoils(self) -> bool:
        """Whether readings are wrong from then on, in a way that no single one of them shows."""
        return self.name.endswith("span changes")


def _signal(kind: str, channel: str, amount: float | None = None) -> Callable[..., None]:
    def breaking(faulty: FaultyBench, side: Side, _draw: np.random.Generator) -> None:
        name = cast(Any, f"{side}_{channel}")
        faulty.bench.twin.inject_fault(name, cast(Any, kind), duration_s=3.0, amount=amount)

    return breaking


def _lasting(kind: str, channel: str, amount: float) -> Callable[..., None]:
    """Break a signal until the bench is closed."""

    def breaking(faulty: FaultyBench, side: Side, _draw: np.random.Generator) -> None:
        name = cast(Any, f"{side}_{channel}")
        faulty.bench.twin.inject_fault(name, cast(Any, kind), duration_s=1e5, amount=amount)

    return breaking


def _set(name: str, value: object) -> Callable[..., None]:
    def breaking(faulty: FaultyBench, _side: Side, _draw: np.random.Generator) -> None:
        setattr(faulty, name, value)

    return breaking


def _slip(faulty: FaultyBench, side: Side, draw: np.random.Generator) -> None:
    counts = (
        float(draw.uniform(0.5, 1.0))
        * faulty.bench.description.needed_encoder(side).counts_per_revolution
    )
    faulty.bench.twin.inject_fault(side, "encoder_slip", duration_s=3.0, amount=counts)


def _keeps_power(faulty: FaultyBench, _side: Side, _draw: np.random.Generator) -> None:
    """Have the drives acknowledge everything and do nothing, their watchdogs dead."""
    faulty.stuck = faulty.keeps_power = True
    for drive in faulty.bench.drives.values():
        drive.unguarded = lambda: faulty.keeps_power


def _goes_off(faulty: FaultyBench, side: Side, _draw: np.random.Generator) -> None:
    faulty.bench.drives[side].disable()


def _insist(faulty: FaultyBench, command: Callable[[], None]) -> None:
    """Command a drive again and again, until the supervisor stops it."""
    faulty.insisting = command
    command()


def _runs_away(faulty: FaultyBench, side: Side, draw: np.random.Generator) -> None:
    drive, module = faulty.bench.drives[side], faulty.bench.description.module(side)
    sign = float(draw.choice((-1.0, 1.0)))
    if drive.state().enabled:
        torque_nm = sign * 1.5 * module.limits.torque_nm

        def pull() -> None:
            drive.command_speed(drive.state().speed_rad_s or 0.0, 1e9)  # no speed ramp goes on
            other_nm = torque_nm * float(draw.uniform(0.999, 1.0))  # the same again is no command
            drive.command_torque(other_nm, 50.0 * module.range_nm)

        _insist(faulty, pull)


def _spins(faulty: FaultyBench, side: Side, draw: np.random.Generator) -> None:
    drive, module = faulty.bench.drives[side], faulty.bench.description.module(side)
    sign = float(draw.choice((-1.0, 1.0)))
    if drive.state().enabled:
        speed = sign * 1.2 * module.limits.speed_rpm * RAD_S_PER_RPM
        _insist(faulty, lambda: drive.command_speed(speed, 1e4))


def _turns_round(faulty: FaultyBench, side: Side, _draw: np.random.Generator) -> None:
    """Have a drive do the opposite of what it is told, from now on."""
    drive, module = faulty.bench.drives[side], faulty.bench.description.module(side)
    faulty.reversed = True
    state = drive.state()
    if state.enabled and state.torque_nm:
        drive.command_torque(-state.torque_nm, module.drive.torque_rate_nm_per_s)
    elif state.enabled and state.speed_rad_s:
        drive.command_speed(-state.speed_rad_s, module.drive.speed_rate_rad_per_s2)


def _counter_error(faulty: FaultyBench, _side: Side, _draw: np.random.Generator) -> None:
    faulty.counter_error = BenchError("the counter's connection is lost", "samples", "check it")


def _nothing(_faulty: FaultyBench, _side: Side, _draw: np.random.Generator) -> None:
    """Something that the campaign does to the station itself."""


KINDS: tuple[Kind, ...] = (
    Kind("transducer silent", _signal("silent", "torque"), needs_power=False),
    Kind("every tenth pulse missing", _signal("missing_pulses", "torque", 10.0), False),
    Kind("every tenth pulse doubled", _signal("doubled_pulses", "torque", 10.0), False),
    Kind("frequency out of modulation", _signal("out_of_modulation", "torque"), False),
    Kind("frequency frozen", _signal("frozen", "torque"), needs_power=False),
    Kind("outlier reading", _signal("outlier", "torque", 0.6), needs_power=False),
    Kind("standard silent", _signal("silent", "reference")),
    Kind("standard frozen", _signal("frozen", "reference")),
    Kind("standard's span changes", _lasting("wrong_span", "reference", 1.03)),
    Kind("transducer's span changes", _lasting("wrong_span", "torque", 1.03)),
    Kind("encoder slips", _slip),
    Kind("drive goes off", _goes_off),
    Kind("drive reports a fault", _set("drive_fault", "overcurrent")),
    Kind("drive doesn't answer", _set("mute", True)),
    Kind("drive refuses commands", _set("deaf", True)),
    Kind("drive pulls too much", _runs_away),
    Kind("drive turns too fast", _spins),
    Kind("drive keeps what it does", _set("stuck", True)),
    Kind("drive does the opposite", _turns_round),
    Kind("drive acknowledges and stays on", _keeps_power),
    Kind("watchdog isn't fed", _set("unfed", True)),
    Kind("probes lost", _set("lost_probe", True)),
    Kind("probes fail", _set("dead_probes", True), needs_power=False),
    Kind("overheated", _set("heat_k", 60.0), needs_power=False),
    Kind("counter lost", _counter_error, needs_power=False),
    Kind("stop from another thread", _nothing, needs_power=False),
    Kind("disk full for samples", _nothing, needs_power=False),
    Kind("disk full for documents", _nothing),
    Kind("heartbeat missing", _nothing),
    Kind("killed", _nothing, needs_power=False),
)
"""Kinds that the campaign draws from; the last six are done to the station."""


def on_thread(work: Callable[[], object]) -> None:
    """Do something from another thread, and wait for it."""
    other = threading.Thread(target=work)
    other.start()
    other.join()
