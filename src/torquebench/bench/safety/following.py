"""Whether the drives follow their commands: command and reading are compared.

A drive that turns the wrong way, keeps its torque or turns without a command may report "enabled,
no fault", and so may a drive whose torque transducer reads another value. The expected state is
computed from the commands and their ramps. A drive may lag, and a shaft that is free to turn takes
less torque than commanded, so that the reading is compared with a band.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.blocks import Block
from torquebench.bench.description import BenchDescription
from torquebench.bench.roles import SIDES, Side, reference_channel
from torquebench.bench.safety.alarms import AlarmKind, Violation
from torquebench.bench.state import CommandState, Quantity, SetPoint
from torquebench.message import Message
from torquebench.units import RPM_PER_RAD_S

DEVIATING_S = 0.1
"""Longest time for which a drive may be outside its band, s of bench time; at least one block."""


class _Ramp:
    """Expected state of a drive, without delay and with the largest allowed delay.

    It is an interval: a drive may start the ramp of a newly controlled quantity at zero or at its
    present value, and goes on with its former ramp until it has received a command. `time_s` is the
    time from which it controls the quantity, with this reading.
    """

    def __init__(self, quantity: Quantity, time_s: float, reading: float) -> None:
        self.quantity = quantity
        self._point = SetPoint()
        self._rate = math.inf
        self._time_s = time_s
        self._ends = min(reading, 0.0), max(reading, 0.0)
        self._former: tuple[float, float, tuple[float, float]] | None = None
        """Target, rate and ends of the former ramp, while the drive may not know the new one."""
        self._before = deque([(time_s, *self._ends)])
        self.deviating_s = 0.0

    def go_on(self, point: SetPoint, stop_s: float, late_s: float) -> None:
        """Advance to a time towards a set point that the drive may follow with a delay."""
        resumed = replace(point, told_s=math.inf)  # a repeated command doesn't restart the ramp
        if resumed != self._point:
            self._time_s = max(self._time_s, point.asked_s)
            ends = self._ends if self._former is None else _widest(self._ends, self._former[2])
            known = point.told_s <= self._time_s
            self._former = None if known else (self._point.value, self._rate, ends)
            self._set_rate(point)
            self._point = resumed
        widest = self._ends = self._after(point.value, self._rate, self._ends, stop_s)
        if self._former is not None:
            target, rate, ends = self._former
            ends = self._after(target, rate, ends, min(stop_s, max(point.told_s, self._time_s)))
            widest = _widest(widest, ends)
            self._former = target, rate, ends
            if point.told_s <= stop_s:
                self._former, self._ends = None, widest
                self._set_rate(point)
        self._time_s = stop_s
        self._before.append((stop_s, *widest))
        while self._before[0][0] < stop_s - late_s:
            self._before.popleft()

    def _set_rate(self, point: SetPoint) -> None:
        """Take the rate of the ramp from the present ends to a set point."""
        distance = max(abs(point.value - end) for end in self._ends)
        slowest = distance / point.within_s if point.within_s > 0.0 else math.inf
        self._rate = min(point.rate, slowest)

    def _after(
        self, target: float, rate: float, ends: tuple[float, float], stop_s: float
    ) -> tuple[float, float]:
        """Return both ends after ramping from the present ones until a time."""
        low, high = (_towards(target, end, rate, stop_s - self._time_s) for end in ends)
        return low, high

    def band(self) -> tuple[float, float]:
        """Return the allowed range of the drive's value."""
        return min(low for _, low, _ in self._before), max(high for _, _, high in self._before)


def _towards(target: float, present: float, rate: float, lasts_s: float) -> float:
    """Return a value after ramping from the present one for some time."""
    distance = target - present
    way = rate * lasts_s if distance else 0.0
    return target if abs(distance) <= way else present + math.copysign(way, distance)


def _widest(first: tuple[float, float], second: tuple[float, float]) -> tuple[float, float]:
    """Return the range that holds both."""
    return min(first[0], second[0]), max(first[1], second[1])


class FollowingJudge:
    """Comparison of a drive's commands with the bench's readings; called by acquisition's thread.

    With a standard mounted the flanges are fixed, so that the reading must equal the commanded
    torque, even while the standard's shaft changes its speed. With a reducer, which may turn, the
    controlled quantity (torque or speed) must be between zero and the command.
    """

    def __init__(self, description: BenchDescription, commands: CommandState) -> None:
        self._description = description
        self._share = description.safety.following_percent / 100.0
        self._late_s = description.safety.following_s
        self._commands = commands
        self._ramps: dict[Side, _Ramp] = {}

    def forget(self) -> None:
        """Restart the comparison after an acknowledgement."""
        self._ramps.clear()

    def judge(self, block: Block) -> Violation | None:
        """Check a block; return a violation if a drive deviates from its commands."""
        for side in SIDES:
            commands = self._commands.side(side)
            if not (self._share and commands.enabled):
                self._ramps.pop(side, None)
                continue
            held = reference_channel(side) in block.records
            # with a standard, this is the speed of its shaft, not of the drive
            quantity: Quantity = "torque" if held else commands.controls
            violation = self._judge(side, quantity, commands.set_points[quantity], block, held=held)
            if violation is not None:
                return violation
        return None

    def _judge(
        self, side: Side, quantity: Quantity, point: SetPoint, block: Block, *, held: bool
    ) -> Violation | None:
        """Compare a drive's quantity in a block with the range that its commands allow."""
        values = _values(quantity, side, block)
        known = values[np.isfinite(values)]
        if known.size == 0:
            return None  # a missing signal is checked by `SignalJudge`
        last = float(known[-1])
        ramp = self._ramps.get(side)
        if ramp is None or ramp.quantity != quantity:
            ramp = self._ramps[side] = _Ramp(quantity, block.start_s, last)
        lasts_s = block.stop_s - block.start_s
        # A command within a block shows at the block's end, and a speed is a mean over the block.
        ramp.go_on(point, block.stop_s, self._late_s + 2.0 * lasts_s)
        low, high = ramp.band()
        if not held:
            low, high = min(low, 0.0), max(high, 0.0)
        allowed = self._share * self._range(side, quantity)
        deviation = float(np.min(np.maximum(low - known, known - high)))
        if deviation <= allowed:
            ramp.deviating_s = 0.0
            return None
        before_s, ramp.deviating_s = ramp.deviating_s, ramp.deviating_s + lasts_s
        if before_s == 0.0 or ramp.deviating_s < DEVIATING_S:
            return None
        return _violation(side, quantity, last, point.value, allowed)

    def _range(self, side: Side, quantity: Quantity) -> float:
        module = self._description.module(side)
        return module.range_nm if quantity == "torque" else module.limits.speed_rpm / RPM_PER_RAD_S


def _values(quantity: Quantity, side: Side, block: Block) -> NDArray[np.float64]:
    """Return the bench's readings of a quantity."""
    if quantity == "speed":
        return np.array([block.speed_rad_s(side)])
    record = block.torque(side)
    return np.empty(0) if record is None else record["reading_nm"]


def _violation(
    side: Side, quantity: Quantity, measured: float, set_point: float, allowed: float
) -> Violation:
    """Return the violation of a drive that doesn't follow its command."""
    scale, unit = (1.0, "N·m") if quantity == "torque" else (RPM_PER_RAD_S, "rpm")
    measured, set_point, allowed = scale * measured, scale * set_point, scale * allowed
    return Violation(
        AlarmKind.FOLLOWING,
        side,
        Message(
            "{side} drive: {found:.1f} {unit} instead of {told:.1f} {unit}",
            side,
            measured,
            unit,
            set_point,
        ),
        Message("at most {allowed:g} {unit} apart", allowed, unit),
        "find out whether the drive or its transducer is wrong before you continue",
    )
