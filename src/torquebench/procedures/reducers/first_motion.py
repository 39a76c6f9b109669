"""Starting and back-driving torque: the torque of one side rises slowly until the reducer moves."""

from __future__ import annotations

from collections import deque
from dataclasses import asdict, dataclass, field

import numpy as np

from torquebench.bench.devices import BenchDevices, RampTo, SynchronousRecording
from torquebench.bench.roles import Side
from torquebench.errors import BenchError, InputError, LimitError
from torquebench.message import Message
from torquebench.procedures.guarding import torque_limits
from torquebench.procedures.messages import checkpoint, move, progress, sleep, take
from torquebench.procedures.reducers.setup import (
    REDUCER_SETUP,
    ReducerLimits,
    angle_rad,
    directions,
    run_metadata,
    stamp,
    temperature_c,
    turn_output,
)
from torquebench.procedures.setup import (
    REST_S,
    Plan,
    measured_in,
    other_side,
    power_off,
    power_on,
    set_mode,
)
from torquebench.procedures.zeroing import zero
from torquebench.units import DEG_PER_TURN, DEGREE

STEP_S = 0.1
"""Bench time between two checks for the first motion, s."""
LOOKS = 6
"""Number of checks within which a moving side advances by a fifth of the motion threshold."""


@dataclass(frozen=True)
class BreakawaySettings:
    """Settings of the search for the first motion.

    Parameters
    ----------
    positions : int
        Output positions, evenly over a revolution.
    clockwise, counter_clockwise : bool
        Directions in which the torque rises.
    ramp_s : float
        Time in which the torque rises to the expected value, s.
    expected_nm : float or None
        Torque at which motion is expected; by default from the data sheet or the reducer's size.
    largest_nm : float or None
        Torque at which a ramp without motion ends; by default five times the expected torque.
    motion_deg : float or None
        Angle, degrees, after which the driven side counts as moving, with a fifth of it within half
        a second; by default 5° of the input and 0.2° of the output.
    zero_s : float
        Length of the zero before each position, s.
    """

    positions: int = 6
    clockwise: bool = True
    counter_clockwise: bool = True
    ramp_s: float = 5.0
    expected_nm: float | None = None
    largest_nm: float | None = None
    motion_deg: float | None = None
    zero_s: float = 1.0

    def __post_init__(self) -> None:
        if self.positions < 1 or self.ramp_s <= 0.0:
            raise InputError(
                Message(
                    "{positions} positions, a ramp of {ramp_s:g} s", self.positions, self.ramp_s
                ),
                "at least one position and a ramp above 0 s",
            )
        directions(self)

    def expected(self, side: Side, limits: ReducerLimits) -> float:
        """Torque at which motion is expected, N·m.

        Examples
        --------
        >>> limits = ReducerLimits(100.0, 50.0, 100.0, 3000.0)
        >>> BreakawaySettings().expected("input", limits)
        0.02
        """
        if self.expected_nm is not None:
            return self.expected_nm
        return (0.04 / abs(limits.ratio) if side == "input" else 0.04) * limits.rated_torque_nm

    def largest(self, side: Side, limits: ReducerLimits) -> float:
        """Torque at which a ramp without motion ends, N·m."""
        return self.largest_nm or 5.0 * self.expected(side, limits)

    def motion_rad(self, side: Side) -> float:
        """Angle after which the driven side counts as moving, rad."""
        degrees = 5.0 if side == "input" else 0.2
        return float((degrees if self.motion_deg is None else self.motion_deg) * DEGREE)


@dataclass(frozen=True, eq=False)
class Breakaway:
    """One ramp until the first motion.

    Parameters
    ----------
    position_deg : float
        Output position, degrees.
    direction : int
        +1 clockwise.
    recording : SynchronousRecording
        Samples from before the ramp until after the motion.
    standing_nm : float
        Compensated torque for a reading of 0, to be subtracted, N·m.
    """

    position_deg: float
    direction: int
    recording: SynchronousRecording
    standing_nm: float = 0.0


@dataclass(frozen=True, eq=False)
class BreakawayRecording:
    """All ramps of one side.

    Parameters
    ----------
    side : {"input", "output"}
        The driven side: input for the starting torque, output for the back-driving torque.
    compensated : bool
        Whether the side's active model was applied.
    temperature_c : float
        Temperature of the reducer; NaN without a probe.
    """

    side: Side
    ramps: tuple[Breakaway, ...]
    compensated: bool
    temperature_c: float


def breakaway(
    devices: BenchDevices,
    limits: ReducerLimits,
    side: Side,
    settings: BreakawaySettings | None = None,
) -> Plan[BreakawayRecording]:
    """Raise the torque of one side slowly until it turns, at several positions; the other is free.

    Parameters
    ----------
    side : {"input", "output"}
        Input: starting torque. Output: back-driving torque.

    Raises
    ------
    LimitError
        The largest torque exceeds the limits of data sheet or bench; nothing has moved yet.
    BenchError
        Nothing moves up to the largest torque, or the output doesn't turn by the ratio.
    """
    settings = settings or BreakawaySettings()
    largest = settings.largest(side, limits)
    _check(limits, side, largest)
    finder = _Finder(devices, limits, side, settings)
    count = settings.positions * len(directions(settings))
    metadata = run_metadata(
        devices, f"breakaway_{side}", limits, count, settings=asdict(settings), side=side
    )
    warm: list[float] = []

    def measured() -> Plan[None]:
        """Find the first motion at each position of the output."""
        step = DEG_PER_TURN / settings.positions
        for number in range(settings.positions):
            yield from checkpoint()
            yield from set_mode(devices, "output", "free")
            yield from set_mode(devices, "input", "driven")
            yield from turn_output(devices, limits, step if number else 2.0)
            yield from power_off(devices)
            yield from set_mode(devices, other_side(side), "free")
            yield from finder.at(number * step, number, count)
        warm.append((yield from temperature_c(devices)))
        yield from progress(count, count, "done")

    torque = torque_limits(devices, side, largest)
    yield from measured_in(REDUCER_SETUP, devices, measured(), metadata, torque)
    compensated = devices.context.acquisition.compensation(side) is not None
    return BreakawayRecording(side, tuple(finder.found), compensated, float(np.mean(warm)))


def _check(limits: ReducerLimits, side: Side, largest_nm: float) -> None:
    """Refuse a ramp beyond the data sheet, on either side."""
    at_output = largest_nm * (abs(limits.ratio) if side == "input" else 1.0)
    if at_output > limits.largest_torque_nm:
        raise LimitError(
            Message("a ramp up to {value:g} N·m at the {side}", largest_nm, side),
            Message("at most {limit:g} N·m at the reducer's output", limits.largest_torque_nm),
            "lower the torque at which motion is expected",
        )


@dataclass
class _Finder:
    """Ramps the torque of one side until it moves."""

    devices: BenchDevices
    limits: ReducerLimits
    side: Side
    settings: BreakawaySettings
    found: list[Breakaway] = field(default_factory=list)

    def at(self, position_deg: float, index: int, total: int) -> Plan[None]:
        """Find the first motion in each direction at one position; the drive is off afterwards."""
        signs = directions(self.settings)
        for number, sign in enumerate(signs):
            done = index * len(signs) + number
            yield from progress(
                done,
                total,
                Message("{position_deg:g}°, {value}", position_deg, "+" if sign > 0 else "-"),
            )
            yield from checkpoint()
            yield from zero(self.devices, self.side, duration_s=self.settings.zero_s)
            standing = self._standing()
            yield from stamp(
                self.devices, series=sign, step=index, branch=sign, position_deg=position_deg
            )
            recording = yield from self._ramp(sign)
            self.found.append(Breakaway(position_deg, sign, recording, standing))
        yield from power_off(self.devices)

    def _standing(self) -> float:
        """Return the compensated torque at the last measured zero, N·m."""
        context = self.devices.context
        active = context.acquisition.compensation(self.side)
        if active is None:
            return 0.0
        return float(active.standing().value_nm[0])

    def _ramp(self, sign: int) -> Plan[SynchronousRecording]:
        """Ramp up, detect motion, unload."""
        devices = self.devices
        largest = self.settings.largest(self.side, self.limits)
        rate = self.settings.expected(self.side, self.limits) / self.settings.ramp_s
        yield from power_on(devices, self.side)
        yield from move(devices.recorder, "mark")
        yield from sleep(REST_S)
        moved = yield from self._until_motion(sign * largest, rate)
        yield from move(devices.module(self.side).drive.torque, 0.0)
        yield from sleep(REST_S)
        yield from take(devices.recorder, devices.point, stream="points")
        yield from power_off(devices)  # its own friction stops it
        yield from sleep(REST_S)
        if not moved:
            raise BenchError(
                Message("nothing moved up to {value:g} N·m at the {side}", largest, self.side),
                "motion below the largest torque of the ramp",
                "check that the reducer is mounted and the other side free, or raise the "
                "expected torque",
            )
        return devices.recorder.taken or SynchronousRecording.joined([])

    def _until_motion(self, target_nm: float, rate: float) -> Plan[bool]:
        """Raise the torque in one uniform ramp with checks for motion; return whether it moved."""
        devices, module = self.devices, self.devices.module(self.side)
        start = yield from angle_rad(devices, self.side)
        enough = self.settings.motion_rad(self.side)
        steps = int(np.ceil(abs(target_nm) / (rate * STEP_S)))
        seen: deque[float] = deque(maxlen=LOOKS)
        for step in range(1, steps + 1):
            yield from move(module.drive.torque, RampTo(target_nm * step / steps, rate))
            present = yield from angle_rad(devices, self.side)
            if start is None or present is None:  # a rehearsal covers the whole ramp
                continue
            # A contact creeps under torque and may move as far with time: only a fast movement
            # counts as motion.
            seen.append(present)
            if abs(present - start) > enough and abs(present - seen[0]) > 0.2 * enough:
                return True
        return start is None
