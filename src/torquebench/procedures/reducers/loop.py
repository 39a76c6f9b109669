"""Torque-angle loops: input locked, output loaded in uniform ramps; and the bench's own twist."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from math import inf

import numpy as np

from torquebench.bench.active_chain import ActiveChain
from torquebench.bench.devices import BenchDevices, RampTo, SynchronousRecording
from torquebench.bench.roles import Side
from torquebench.chain import Inertia
from torquebench.errors import BenchError, InputError
from torquebench.message import Message
from torquebench.procedures.guarding import guarded, loading_limits
from torquebench.procedures.messages import (
    again_after_pause,
    checkpoint,
    leg_checkpoint,
    move,
    progress,
    read,
    sleep,
    take,
)
from torquebench.procedures.reducers.setup import (
    REDUCER_SETUP,
    ReducerLimits,
    angle_rad,
    run_metadata,
    stamp,
    temperature_c,
    turn_output,
)
from torquebench.procedures.setup import (
    REST_S,
    Plan,
    Setup,
    measured_in,
    power_off,
    power_on,
    set_mode,
    set_up,
    start_metadata,
)
from torquebench.procedures.zeroing import measure_zero, zero
from torquebench.reducers import FlangeInertia
from torquebench.units import DEG_PER_RAD, DEG_PER_TURN, DEG_S_PER_RPM

LOADING_SHARE = 0.0015
"""Largest deviation of a drive from the requested torque, as a share of its range."""
TURNS = 4
PHASE_DEG = 10.0
"""Tolerance of the input's phase, degrees."""


def even_positions(count: int) -> tuple[float, ...]:
    """Return a number of positions that divide one output turn evenly, degrees.

    Examples
    --------
    >>> even_positions(5)
    (0.0, 72.0, 144.0, 216.0, 288.0)
    """
    return tuple(DEG_PER_TURN * number / count for number in range(count))


@dataclass(frozen=True)
class HysteresisSettings:
    """Settings of the torque-angle loops.

    Parameters
    ----------
    loops : int
        Loops at each position after the preload.
    positions_deg : tuple of float
        Output positions, degrees. They also divide one turn of the input evenly, so that errors of
        the input's orders cancel, except multiples of the number of positions: five by default,
        because harmonic reducers have errors of the orders two and four.
    torque_share : float
        Largest torque of the loop, as a share of the rated torque.
    loop_s : float
        Time of one loop at a uniform rate of torque, s.
    steps : int
        Number of torque steps from zero to the largest torque, each held for its share of the
        loop's time; 0 for a uniform ramp.
    zero_s : float
        Length of the zero before the loops of a position, s.
    """

    loops: int = 3
    positions_deg: tuple[float, ...] = even_positions(5)
    torque_share: float = 1.0
    loop_s: float = 40.0
    steps: int = 0
    zero_s: float = 1.0

    def __post_init__(self) -> None:
        if self.loops < 1 or not self.positions_deg:
            raise InputError(
                Message("{loops} loops at {count} positions", self.loops, len(self.positions_deg)),
                "at least one of each",
            )
        if not (self.torque_share > 0.0 and 1.0 <= self.loop_s <= 240.0 and self.steps >= 0):
            raise InputError(
                Message(
                    "loops of {torque_share:g} T_N in {loop_s:g} s, {steps} steps",
                    self.torque_share,
                    self.loop_s,
                    self.steps,
                ),
                "a share above 0, 1 to 240 s, no negative number of steps",
            )


@dataclass(frozen=True, eq=False)
class Loop:
    """One closed loop −T → 0 → +T → 0 → −T at one output position.

    Parameters
    ----------
    position_deg : float
        Output position, degrees.
    number : int
        Number of the loop at this position, from 1.
    """

    position_deg: float
    number: int
    recording: SynchronousRecording


@dataclass(frozen=True, eq=False)
class LoopRecording:
    """Recorded data of the torque-angle loops.

    Parameters
    ----------
    torque_nm : float
        Largest commanded torque, N·m.
    compensated : mapping of side to bool
        Whether the side's active model was applied.
    temperature_c : float
        Temperature of the reducer, °C; NaN without a probe.
    flange : FlangeInertia or None
        Inertia from the output's active model (identified by empty runs), or as described.
    """

    loops: tuple[Loop, ...]
    torque_nm: float
    compensated: dict[Side, bool]
    temperature_c: float
    flange: FlangeInertia | None = None


def hysteresis_loops(
    devices: BenchDevices, limits: ReducerLimits, settings: HysteresisSettings | None = None
) -> Plan[LoopRecording]:
    """Lock the input and drive torque-angle loops at the output, at several output positions.

    Before the loops of each position, the output is turned to it, both torques are zeroed, and the
    output is preloaded to +T and −T, which isn't part of any loop. The torque exceeds T by the
    drive's largest deviation, if the reducer allows it. The positions also divide one turn of the
    input evenly, because the transmission error of the input's orders makes a reducer stiffer at
    some phases of the input than at others. A loop that a pause interrupts is preloaded and driven
    again.

    Raises
    ------
    LimitError
        The torque exceeds the limits of data sheet or bench; nothing has moved yet.
    BenchError
        The output doesn't turn by the reducer's ratio.
    """
    settings = settings or HysteresisSettings()
    torque = settings.torque_share * limits.rated_torque_nm
    limits.check_output_torque(torque)
    beyond = torque + LOADING_SHARE * devices.context.description.output.range_nm
    torque = max(torque, min(beyond, limits.largest_torque_nm))
    driver = _LoopDriver(devices, settings, torque)
    total = settings.loops * len(settings.positions_deg)
    metadata = run_metadata(
        devices, "hysteresis_loops", limits, total, settings=asdict(settings), side="output"
    )
    loading = loading_limits(devices, "output", torque)
    temperature: list[float] = []

    def measured() -> Plan[None]:
        """Measure the loops at each position of the output."""
        start = yield from angle_rad(devices, "input")
        for index, position in enumerate(settings.positions_deg):
            yield from progress(
                index * settings.loops, total, Message("output to {value:g}°", position)
            )
            yield from checkpoint()
            yield from set_mode(devices, "output", "free")
            yield from set_mode(devices, "input", "driven")
            phase = index / len(settings.positions_deg)
            yield from _turn_to(devices, limits, _near(position, limits.ratio, phase), start)
            yield from power_off(devices)
            yield from measure_zero(devices, "input", duration_s=settings.zero_s)
            yield from set_mode(devices, "input", "locked")
            yield from guarded(partial(driver.run, position, index, total), loading)
            temperature.append((yield from temperature_c(devices)))
        yield from progress(total, total, "done")

    yield from measured_in(REDUCER_SETUP, devices, measured(), metadata)
    compensation = devices.context.acquisition.compensation
    sides: tuple[Side, Side] = ("input", "output")
    return LoopRecording(
        loops=tuple(driver.found),
        torque_nm=torque,
        compensated={side: compensation(side) is not None for side in sides},
        temperature_c=float(np.mean(temperature)),
        flange=_flange(compensation("output")),
    )


def _flange(active: ActiveChain | None) -> FlangeInertia | None:
    """Return the inertia between transducer and flange, by the model of a side."""
    inertia = None if active is None else active.chain.find(Inertia)
    if inertia is None or not inertia.moment_nm_s2 > 0.0:
        return None
    share = inertia.uncertainty_nm_s2 / inertia.moment_nm_s2
    return FlangeInertia(inertia.moment_nm_s2, 200.0 * share)


def _near(position_deg: float, ratio: float, phase: float) -> float:
    """Return the output angle closest to a position at which the input has a given phase.

    Examples
    --------
    >>> round(_near(90.0, 121.0, 0.5), 4), round(_near(90.0, 121.0, 0.25), 4)
    (90.7438, 90.0)
    """
    off = phase - position_deg * ratio / DEG_PER_TURN
    return position_deg + (off - float(np.round(off))) * DEG_PER_TURN / ratio


def _turn_to(
    devices: BenchDevices, limits: ReducerLimits, output_deg: float, start_rad: float | None
) -> Plan[None]:
    """Turn the output to an angle from the start by the input's encoder, with decreasing speed."""
    seconds = 0.0
    for _ in range(TURNS):
        present = yield from angle_rad(devices, "input")
        turned = 0.0  # a rehearsal has no angles
        if present is not None and start_rad is not None:
            turned = float((present - start_rad) * DEG_PER_RAD) / limits.ratio
        remaining_deg = output_deg - turned
        if abs(remaining_deg * limits.ratio) < PHASE_DEG:
            return
        slow_rpm = abs(remaining_deg * limits.ratio) / DEG_S_PER_RPM / seconds if seconds else inf
        yield from turn_output(devices, limits, remaining_deg, speed_rpm=slow_rpm)
        if present is None:
            return
        seconds = 4.0


@dataclass
class _LoopDriver:
    """Drives the loops of all positions with the output's drive."""

    devices: BenchDevices
    settings: HysteresisSettings
    torque_nm: float
    found: list[Loop] = field(default_factory=list)

    def run(self, position_deg: float, index: int, total: int) -> Plan[None]:
        """Zero, preload and drive all loops of a position; leaves no torque, and the drive off."""
        yield from zero(self.devices, "output", duration_s=self.settings.zero_s)
        # started early, so that short windows are available
        yield from move(self.devices.recorder, "fine")
        yield from progress(index * self.settings.loops, total, "preload")
        yield from checkpoint()
        yield from self._preload()
        for number in range(1, self.settings.loops + 1):
            recording = yield from again_after_pause(
                partial(self._loop, position_deg, number, index, total), self._preload
            )
            self.found.append(Loop(position_deg, number, recording))
        yield from self._ramp(0.0)
        yield from power_off(self.devices)

    def _preload(self) -> Plan[None]:
        for target in (self.torque_nm, 0.0, -self.torque_nm):
            yield from self._ramp(target)

    def _loop(
        self, position_deg: float, number: int, index: int, total: int
    ) -> Plan[SynchronousRecording]:
        """Drive one loop."""
        done = index * self.settings.loops + number - 1
        yield from progress(
            done, total, Message("{position:g}°, loop {number}", position_deg, number)
        )
        yield from stamp(
            self.devices, series=index, step=number, position_deg=position_deg, group=number
        )
        yield from move(self.devices.recorder, "fine")
        parts: list[SynchronousRecording] = []
        for target in (0.0, self.torque_nm, 0.0, -self.torque_nm):
            yield from leg_checkpoint()
            yield from self._leg(target)
            yield from _take(self.devices, parts)
        return SynchronousRecording.joined(parts)

    def _leg(self, target_nm: float) -> Plan[None]:
        """Ramp to a torque, uniformly or in steps."""
        steps = self.settings.steps
        if not steps:
            yield from self._ramp(target_nm)
            return
        start = yield from read(self.devices.output.drive.torque.setpoint)
        hold_s = self.settings.loop_s / (4 * steps)
        for level in np.linspace(float(start), target_nm, steps + 1)[1:]:
            yield from move(self.devices.output.drive.torque, float(level))
            yield from sleep(hold_s)

    def _ramp(self, target_nm: float) -> Plan[None]:
        rate = 4.0 * self.torque_nm / self.settings.loop_s
        yield from move(self.devices.output.drive.torque, RampTo(target_nm, rate))


def _take(devices: BenchDevices, parts: list[SynchronousRecording]) -> Plan[None]:
    """End the recorder's present interval, and append its samples."""
    yield from take(devices.recorder, devices.point, stream="points")
    if devices.recorder.taken is not None:
        parts.append(devices.recorder.taken)


# -- the bench's own twist ------------------------------------------------------------------


@dataclass(frozen=True)
class BenchTwistSettings:
    """Settings of the measurement of the bench's twist, by cycles against the mounted calibrator.

    Parameters
    ----------
    torque_share : float or None
        Largest torque as a share of the module's range; by default the torque of the following
        loops, because a chain's additional torque depends on it.
    cycles : int
        Cycles 0 → +T → −T → 0.
    cycle_s : float
        Time of one cycle, s.
    """

    torque_share: float | None = None
    cycles: int = 2
    cycle_s: float = 20.0

    def __post_init__(self) -> None:
        share = 1.0 if self.torque_share is None else self.torque_share
        if not (0.0 < share <= 1.0 and self.cycles >= 1 and self.cycle_s >= 1.0):
            raise InputError(
                Message("a bench twist by {value}", self), "a share up to 1, a cycle, 1 s or more"
            )


@dataclass(frozen=True, eq=False)
class BenchTwistRecording:
    """Torque and angle of each side against the fixed flange.

    Parameters
    ----------
    standard_serial : str
        Serial number of the part that fixed the flanges.
    """

    recordings: dict[Side, SynchronousRecording]
    standard_serial: str


def bench_twist(
    devices: BenchDevices,
    settings: BenchTwistSettings | None = None,
    sides: Sequence[Side] = ("output", "input"),
    *,
    loops_nm: Mapping[Side, float] | None = None,
) -> Plan[BenchTwistRecording]:
    """Load each side against the clamped calibrator, which fixes its flange, and record the angle.

    The encoder then measures the twist of shaft, coupling and transducer between it and the flange,
    which is subtracted from torque-angle loops at the loaded output and the locked input.
    `loops_nm` is the largest torque of those loops at each side, used if the settings have none.
    """
    settings = settings or BenchTwistSettings()
    recordings: dict[Side, SynchronousRecording] = {}
    points = len(sides) * settings.cycles
    metadata = start_metadata(devices, "bench_twist", points, settings=asdict(settings))

    def side_of(side: Side) -> Plan[None]:
        """Record the twist of one side against the standard."""
        range_nm = devices.context.description.module(side).range_nm
        torque = range_nm if loops_nm is None else min(loops_nm[side], range_nm)
        if settings.torque_share is not None:
            torque = settings.torque_share * range_nm
        yield from set_up(devices, Setup("calibration", side, "calibrator", "locked"))
        yield from zero(devices, side)
        yield from power_on(devices, side)
        parts: list[SynchronousRecording] = []
        rate = 4.0 * torque / settings.cycle_s
        ramp = devices.module(side).drive.torque
        for cycle in range(settings.cycles):
            yield from checkpoint()
            yield from stamp(devices, series=cycle, step=cycle, position_deg=0.0)
            yield from move(devices.recorder, "mark")
            for target in (torque, -torque, 0.0):
                yield from move(ramp, RampTo(target, rate))
            yield from _take(devices, parts)
        yield from sleep(REST_S)
        yield from power_off(devices)
        recordings[side] = SynchronousRecording.joined(parts)

    def measured() -> Plan[None]:
        for number, side in enumerate(sides):
            yield from progress(number, len(sides), Message("twist of the {side} side", side))
            yield from side_of(side)
        yield from progress(len(sides), len(sides), "done")

    setup = Setup("calibration", sides[0], "calibrator", "locked")
    serial = yield from measured_in(setup, devices, measured(), metadata)
    if set(recordings) != set(sides):
        raise BenchError(
            "a bench twist without recordings", Message("both of {sides}", ", ".join(sides))
        )
    return BenchTwistRecording(recordings, serial)
