"""Common parts of all reducer tests: limits, a check of the ratio, steady temperature."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import inf
from typing import Any, Protocol

import numpy as np
from bluesky.utils import Msg
from numpy.typing import NDArray

from torquebench.bench.devices import BenchDevices, Point, RampTo, SteadySettings
from torquebench.bench.roles import SIDES, Side
from torquebench.errors import BenchError, InputError, LimitError, SignalFault
from torquebench.message import Message
from torquebench.procedures.messages import again_after_pause, leg_checkpoint, move, progress, sleep
from torquebench.procedures.setup import REST_S, Plan, Setup, power_on, start_metadata
from torquebench.procedures.turning.profile import turn_s, whole_turns_s
from torquebench.units import DEG_PER_RAD, DEGREE, MINUTE, RAD_S_PER_RPM

REDUCER_SETUP = Setup("reducer_test", "input", "reducer", "free")
REDUCER_PROBE = "reducer"
SPEED_TOLERANCE = 0.02
"""Largest relative deviation of a drive's speed; beyond it, the drive counts as saturated."""
TURN_RPM = 300.0
"""Input speed for turning the output to another position, if the reducer allows it, 1/min."""
GENTLE_RPM_PER_S = 300.0
"""Rate of the input's speed between small torques, (1/min)/s. A faster change would load the
transducer with the shafts' inertia, and its parts would re-seat.
"""
RATIO_TOLERANCE = 0.01
RATIO_TOLERANCE_RAD = 0.25 * DEGREE


@dataclass(frozen=True)
class ReducerLimits:
    """Data of the reducer for a plan: its ratio and its data sheet's limits.

    Parameters
    ----------
    ratio : float
        Input turns for one output turn; negative where the output turns against the input.
    rated_torque_nm : float
        T_N at the output, N·m.
    largest_torque_nm : float
        Largest load of the output (acceleration torque), N·m.
    largest_input_rpm : float
        Largest input speed, 1/min.

    Raises
    ------
    InputError
        A number that isn't above 0, or a rated torque above the largest.
    """

    ratio: float
    rated_torque_nm: float
    largest_torque_nm: float
    largest_input_rpm: float

    def __post_init__(self) -> None:
        numbers = (
            abs(self.ratio),
            self.rated_torque_nm,
            self.largest_torque_nm,
            self.largest_input_rpm,
        )
        if not all(np.isfinite(number) and number > 0.0 for number in numbers):
            raise InputError(Message("limits of the reducer {numbers}", numbers), "numbers above 0")
        if self.rated_torque_nm > self.largest_torque_nm:
            raise InputError(
                Message("a rated torque of {rated_torque_nm:g} N·m", self.rated_torque_nm),
                Message(
                    "at most the acceleration torque, {largest_torque_nm:g} N·m",
                    self.largest_torque_nm,
                ),
                "check the reducer's description",
            )

    @property
    def turning_rpm(self) -> float:
        """Largest input speed for turning the output to another position, 1/min."""
        return min(TURN_RPM, self.largest_input_rpm)

    def reachable(self, speeds_rpm: Iterable[float]) -> tuple[float, ...]:
        """Return the input speeds that the data sheet allows."""
        return tuple(speed for speed in speeds_rpm if speed <= self.largest_input_rpm)

    def check_output_torque(self, torque_nm: float) -> None:
        """Refuse more torque at the output than the data sheet allows.

        Raises
        ------
        LimitError
        """
        if abs(torque_nm) > self.largest_torque_nm * (1 + 1e-9):
            raise LimitError(
                Message("{value:g} N·m at the reducer's output", abs(torque_nm)),
                Message("at most {limit:g} N·m by its data sheet", self.largest_torque_nm),
                "lower the torque of the test",
            )

    def check_input_speed(self, speed_rpm: float) -> None:
        """Refuse a higher input speed than the data sheet allows.

        Raises
        ------
        LimitError
        """
        if abs(speed_rpm) > self.largest_input_rpm * (1 + 1e-9):
            raise LimitError(
                Message("{value:g} rpm at the reducer's input", abs(speed_rpm)),
                Message("at most {limit:g} rpm by its data sheet", self.largest_input_rpm),
                "lower the speeds of the test",
            )

    def check_modules(self, devices: BenchDevices) -> None:
        """Refuse a rated torque that the output module can't measure.

        Raises
        ------
        LimitError
        """
        range_nm = devices.context.description.output.range_nm
        if self.rated_torque_nm > range_nm * (1 + 1e-9):
            raise LimitError(
                Message("a reducer rated for {value:g} N·m", self.rated_torque_nm),
                Message("at most the output module's range, {range:g} N·m", range_nm),
                "test it at a part of its rated torque, or on a larger bench",
            )


@dataclass(frozen=True)
class WarmUp:
    """Conditions under which a reducer counts as warm: its temperature no longer changes.

    Parameters
    ----------
    speed_rpm : float
        Input speed while warming up, 1/min.
    rate_k_per_min : float
        Change below which the temperature is steady, K/min.
    window_s : float
        Time over which this change is evaluated, s.
    interval_s : float
        Time between two readings, s.
    longest_s : float
        Longest time until the temperature is steady; after it the test is refused, s; 0 skips the
        warm-up.
    """

    speed_rpm: float = 600.0
    rate_k_per_min: float = 0.1
    window_s: float = 120.0
    interval_s: float = 10.0
    longest_s: float = 3600.0

    def __post_init__(self) -> None:
        positive = (self.speed_rpm, self.rate_k_per_min, self.window_s, self.interval_s)
        if not all(number > 0.0 for number in positive) or self.longest_s < 0.0:
            raise InputError(
                Message("a warm-up of {value}", self),
                "speed, rate, window and interval above 0, no negative time",
            )

    def steady(self, seen: list[tuple[float, float]]) -> bool:
        """Return whether temperatures (time in s, °C) are steady over the last window.

        Examples
        --------
        >>> warm = WarmUp(window_s=60.0, interval_s=30.0)
        >>> warm.steady([(0.0, 20.0), (30.0, 20.04), (60.0, 20.08)])
        True
        >>> warm.steady([(0.0, 20.0), (30.0, 20.2), (60.0, 20.4)])
        False
        """
        return abs(self.rate(seen)) <= self.rate_k_per_min

    def rate(self, seen: list[tuple[float, float]]) -> float:
        """Return the slope over the last window, K/min; infinite until the window is full."""
        if not seen or seen[-1][0] - seen[0][0] < self.window_s - 1e-6:
            return float("inf")
        rows = [row for row in seen if row[0] >= seen[-1][0] - self.window_s - 1e-6]
        time_s, temperature = np.array(rows).T
        return MINUTE * float(np.polyfit(time_s - time_s[0], temperature, 1)[0])


def run_metadata(
    devices: BenchDevices, plan_name: str, limits: ReducerLimits, points: int, **settings: Any
) -> dict[str, Any]:
    """Return the start document's entries of a reducer test."""
    module = devices.context.description.module
    return start_metadata(
        devices,
        plan_name,
        points,
        transducers={side: module(side).transducer.serial for side in SIDES},
        ratio=limits.ratio,
        rated_torque_nm=limits.rated_torque_nm,
        **settings,
    )


# -- temperature ----------------------------------------------------------------------------


def temperature_c(devices: BenchDevices, probe: str = REDUCER_PROBE) -> Plan[float]:
    """Read a probe, °C; NaN if the bench has no probe of this name."""
    if probe not in devices.context.description.temperatures:
        return float("nan")
    reading = yield Msg("read", devices.temperatures)
    return float(reading[f"{devices.temperatures.name}-{probe}_c"]["value"])


def warm_up(devices: BenchDevices, limits: ReducerLimits, settings: WarmUp) -> Plan[float]:
    """Turn the input with the output free until the reducer's temperature is steady; return it, °C.

    The input must be driven and the output free; afterwards the input is at standstill with the
    drive on.

    Raises
    ------
    BenchError
        The temperature isn't steady after the longest time, or the bench has no probe for it.
    """
    if settings.longest_s == 0.0:
        return (yield from temperature_c(devices))
    if REDUCER_PROBE not in devices.context.description.temperatures:
        raise BenchError(
            Message(
                "no temperature probe {reducer_probe!r}, so its steadiness can't be checked",
                REDUCER_PROBE,
            ),
            Message("a probe named {reducer_probe!r} in the bench description", REDUCER_PROBE),
            "fit one, or test without warming up",
        )
    speed_rpm = min(settings.speed_rpm, limits.largest_input_rpm)
    warm = yield from again_after_pause(lambda: _warm_at(devices, settings, speed_rpm))
    yield from move(devices.input.drive.speed, 0.0)
    yield from sleep(REST_S)
    return warm


def _warm_at(devices: BenchDevices, settings: WarmUp, speed_rpm: float) -> Plan[float]:
    """Turn the input until the reducer's temperature is steady; return it in °C."""
    yield from power_on(devices, "input")
    yield from move(devices.input.drive.speed, speed_rpm * RAD_S_PER_RPM)
    temperatures: list[tuple[float, float]] = []
    for step in range(round(settings.longest_s / settings.interval_s) + 1):
        yield from leg_checkpoint()
        warm = yield from temperature_c(devices)
        temperatures.append((step * settings.interval_s, warm))
        if settings.steady(temperatures):
            return warm
        if step % 6 == 0:
            yield from progress(0, 0, Message("warming up: {value:.1f} °C", warm))
        yield from sleep(settings.interval_s)
    raise BenchError(
        Message(
            "the reducer's temperature ({value:.2f} °C) still changes by {rate:.3g} "
            "K/min after {minutes:g} min",
            temperatures[-1][1],
            settings.rate(temperatures),
            settings.longest_s / MINUTE,
        ),
        Message("at most {rate:g} K/min", settings.rate_k_per_min),
        "warm up for longer, at the speed of the test, or let the room temperature settle",
    )


# -- motion ---------------------------------------------------------------------------------


def angle_rad(devices: BenchDevices, side: Side) -> Plan[float | None]:
    """Read an encoder, rad; None in a rehearsal."""
    encoder = devices.module(side).encoder
    reading = yield Msg("read", encoder)
    if not reading:
        return None
    return float(reading[f"{encoder.name}-angle_rad"]["value"])


def turn_output(
    devices: BenchDevices, limits: ReducerLimits, output_deg: float, *, speed_rpm: float = inf
) -> Plan[None]:
    """Turn the output by an angle through the reducer, and check the ratio.

    The input must be driven and the output free; afterwards the input is at standstill with the
    drive on.

    Raises
    ------
    BenchError
        The output doesn't turn by the ratio: no or another reducer is mounted, the ratio is wrong,
        or an encoder slips.
    """
    if output_deg == 0.0:
        return
    before = yield from _angles(devices)
    context, axis = devices.context, devices.input.drive.speed
    began = context.commands.input.turned.until(context.clock.now())
    rate = context.description.input.drive.speed_rate_rad_per_s2
    path = abs(output_deg) * DEGREE * abs(limits.ratio)
    speed = min(speed_rpm, limits.turning_rpm) * RAD_S_PER_RPM
    speed = min(speed, float(np.sqrt(path * rate)))  # short movements never reach it
    ramp_rad = 0.5 * speed**2 / rate
    yield from power_on(devices, "input")
    yield from move(axis, float(np.copysign(speed, output_deg * limits.ratio)))
    turned_rad = ramp_rad
    if before is not None:  # a late command has left it turning for longer or for shorter
        present = context.commands.input.turned.until(context.clock.present())
        turned_rad = abs(present.angle_rad - began.angle_rad)
    yield from sleep(max(0.0, (path - turned_rad - ramp_rad) / speed))
    yield from move(axis, 0.0)
    yield from sleep(REST_S)
    after = yield from _angles(devices)
    if before is not None and after is not None:
        ended = context.commands.input.turned.until(context.clock.now())
        # a start may count a block later, which also lowers a short ramp
        slack_rad = 0.2 + 2.0 * speed * context.description.counter.block_s
        slack_rad += ended.uncertain_rad - began.uncertain_rad
        turned = after - before
        commanded_rad = ended.angle_rad - began.angle_rad
        _check_ratio(limits, float(turned[0]), float(turned[1]), commanded_rad, slack_rad)


def _angles(devices: BenchDevices) -> Plan[NDArray[np.float64] | None]:
    """Read both encoders, rad; None in a rehearsal."""
    first = yield from angle_rad(devices, "input")
    second = yield from angle_rad(devices, "output")
    if first is None or second is None:
        return None
    return np.array([first, second])


def _check_ratio(
    limits: ReducerLimits, input_rad: float, output_rad: float, told_rad: float, slack_rad: float
) -> None:
    """Compare the angles of both encoders over an unloaded movement with the commanded angle."""
    if abs(input_rad - told_rad) > 0.05 * abs(told_rad) + slack_rad:
        raise BenchError(
            Message(
                "the input turned by {found:.1f}° when {told:.1f}° were commanded",
                input_rad * DEG_PER_RAD,
                told_rad * DEG_PER_RAD,
            ),
            "the commanded angle within 5 %",
            "check the input drive for saturation and the input encoder",
        )
    expected = input_rad / limits.ratio
    if abs(output_rad - expected) > RATIO_TOLERANCE * abs(expected) + RATIO_TOLERANCE_RAD:
        raise BenchError(
            Message(
                "the output turned by {output:.3f}° while the input turned by {input:.1f}°",
                output_rad * DEG_PER_RAD,
                input_rad * DEG_PER_RAD,
            ),
            Message("{value:.3f}° with a ratio of {ratio:g}", expected * DEG_PER_RAD, limits.ratio),
            "check that this reducer is mounted and clamped, its ratio, and both encoders for slip",
        )


def check_followed(
    row: Mapping[str, Any],
    speed_rpm: float,
    torque_nm: float,
    side: Side,
    *,
    slack_nm: float = 0.0,
) -> None:
    """Refuse a point whose drive doesn't reach its set point because it saturates.

    Parameters
    ----------
    row : mapping
        Fields of a steady value.
    speed_rpm, torque_nm : float
        Set points; 0 isn't checked.
    side : {"input", "output"}
    slack_nm : float
        Allowed deviation of drive and uncompensated reading, in addition to a share of the torque.

    Raises
    ------
    SignalFault
    """
    reached = float(row["speed_rpm"])
    if speed_rpm != 0.0 and abs(reached - speed_rpm) > SPEED_TOLERANCE * abs(speed_rpm) + 0.1:
        raise SignalFault(
            Message(
                "the {side} drive saturates: {found:.5g} rpm instead of {asked:g} rpm",
                side,
                reached,
                speed_rpm,
            ),
            Message("within {percent:g} % of the speed", 100 * SPEED_TOLERANCE),
            "lower the speed or the load, or check the drive",
        )
    measured_nm = float(row["reading_nm"])
    if torque_nm != 0.0 and abs(measured_nm - torque_nm) > 0.1 * abs(torque_nm) + slack_nm:
        raise SignalFault(
            Message(
                "the {side} drive saturates: {found:.5g} N·m instead of {asked:g} N·m",
                side,
                measured_nm,
                torque_nm,
            ),
            Message("within 10 % of the torque and {slack_nm:g} N·m", slack_nm),
            "lower the load, or check the drive",
        )


def over_turns(
    speed_rpm: float, settle_s: float, shortest_s: float, limit_s: float = 0.0
) -> SteadySettings:
    """Return settings that average a torque over whole input turns, for at least a given time."""
    window_s = whole_turns_s(shortest_s, speed_rpm)
    return SteadySettings(settle_s, window_s, limit_s, turn_s(speed_rpm))


class Directed(Protocol):
    """Settings that state which directions are driven."""

    @property
    def clockwise(self) -> bool:
        """Whether to drive clockwise."""

    @property
    def counter_clockwise(self) -> bool:
        """Whether to drive counter-clockwise."""


def directions(settings: Directed) -> tuple[int, ...]:
    """Return the directions that are driven, +1 clockwise.

    Raises
    ------
    InputError
        There is none.
    """
    signs = (1,) * settings.clockwise + (-1,) * settings.counter_clockwise
    if not signs:
        raise InputError("no direction", "clockwise, counter-clockwise or both")
    return signs


def stamp(devices: BenchDevices, **fields: Any) -> Plan[None]:
    """Stamp the following events with a point."""
    yield from move(devices.point, Point(**fields))


def turn_at(
    devices: BenchDevices, side: Side, speed_rpm: float, rate_rpm_per_s: float
) -> Plan[None]:
    """Ramp a shaft to a speed, 1/min, at a rate, (1/min)/s, at most at the drive's rate."""
    yield from move(devices.module(side).drive.speed, speed_ramp(speed_rpm, rate_rpm_per_s))


def speed_ramp(speed_rpm: float, rate_rpm_per_s: float) -> RampTo:
    """Return the ramp to a speed in 1/min at a rate in (1/min)/s."""
    return RampTo(speed_rpm * RAD_S_PER_RPM, rate_rpm_per_s * RAD_S_PER_RPM)


def check_speeds(speeds_rpm: tuple[float, ...], repeats: int, rate_rpm_per_s: float) -> None:
    """Refuse a sweep whose speeds don't rise from above 0, or that has no repeats or no rate.

    Raises
    ------
    InputError
        Speeds, repeats or rate are refused; the message states them.
    """
    if not rate_rpm_per_s > 0.0:
        raise InputError(
            Message("a change of speed by {rate_rpm_per_s:g} rpm/s", rate_rpm_per_s),
            "above 0 rpm/s",
        )
    if not speeds_rpm or any(b <= a for a, b in pairwise((0.0, *speeds_rpm))):
        raise InputError(Message("speeds {speeds_rpm} rpm", speeds_rpm), "speeds above 0 that rise")
    if repeats < 1:
        raise InputError(Message("{most} repeats", repeats), "at least 1")
