"""Profiles of runs with a rotating module."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, inf, sin
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from torquebench.bench.roles import SIDES, Side
from torquebench.calibration.profile import profile_text
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.units import MINUTE, TURN
from torquebench.validation import parse_toml, validated

Share = Annotated[float, Field(gt=0, le=1)]
Seconds = Annotated[float, Field(gt=0, le=3600)]
_PIECES = 12  # as a share of a sine's period


def turn_s(speed_rpm: float) -> float:
    """Return the time of one turn at a speed in 1/min, s."""
    return MINUTE / abs(speed_rpm)


def whole_turns_s(shortest_s: float, speed_rpm: float) -> float:
    """Return the time of whole turns, at least a given time, s.

    Examples
    --------
    >>> whole_turns_s(0.4, -200.0)
    0.6
    """
    period_s = turn_s(speed_rpm)
    return round(period_s * ceil(shortest_s / period_s - 1e-9), 9)


def _sine(
    middle: float, size: float, period_s: float, cycles: int
) -> tuple[tuple[float, float], ...]:
    """Return a sine as line segments: the value at the end of each, and its rate."""
    ramps, before = [], middle
    for piece in range(1, _PIECES * cycles + 1):
        value = round(middle + size * sin(TURN * piece / _PIECES), 9)
        ramps.append((value, max(abs(value - before) * _PIECES / period_s, 1e-6)))
        before = value
    return tuple(ramps)


@dataclass(frozen=True)
class Leg:
    """Ramps to speeds, recorded as one interval, with the time for which the last speed is held.

    Parameters
    ----------
    ramps : tuple of (float, float)
        Speed, 1/min, and rate, (1/min)/s.
    what : str
        Description of the leg.
    """

    ramps: tuple[tuple[float, float], ...]
    hold_s: float
    what: str

    @property
    def speed_rpm(self) -> float:
        """Final speed."""
        return self.ramps[-1][0]


@dataclass(frozen=True)
class TorqueLeg:
    """A sequence of torques around a preload, against a fixed flange.

    Parameters
    ----------
    ramps : tuple of (float, float)
        Torque, N·m, and rate, N·m/s.
    hold_s : float
        Time after each step; 0 for a sine, which is recorded as one interval.
    period_s : float
        Period of a sine; 0 for steps.
    what : str
        Description of the leg.
    """

    preload_nm: float
    ramps: tuple[tuple[float, float], ...]
    hold_s: float
    period_s: float
    what: str


@dataclass(frozen=True)
class TurningPoint:
    """A steady torque at a steady speed.

    Parameters
    ----------
    branch : int
        +1 if the magnitude of the torque grows, -1 if it falls.
    series : int
        Number of the series, from 1. Each series begins at rest with a zero.
    """

    speed_rpm: float
    torque_nm: float
    branch: int
    series: int


class _Settings(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Ramps(_Settings):
    """Durations of the ramps from standstill to the largest speed, s."""

    gentle_s: Seconds = 20.0
    steep_s: Seconds = 4.0


class Temperatures(_Settings):
    """Temperatures of the transducer at which series are measured, °C."""

    wanted_c: Annotated[list[Annotated[float, Field(ge=-20, le=80)]], Field(min_length=1)]
    within_k: Annotated[float, Field(gt=0, le=10)] = 1.5
    longest_h: Annotated[float, Field(gt=0, le=1000)] = 24.0
    check_interval_s: Seconds = 60.0


class WarmUp(_Settings):
    """Turning between the series, so that the bench warms up."""

    share: Share = 1.0
    minutes: Annotated[float, Field(gt=0, le=1440)] = 20.0
    series: Annotated[int, Field(ge=2, le=100)] = 4


class Swings(_Settings):
    """Sines of the speed, with their middle and amplitude as shares of the largest speed."""

    around: Share = 0.5
    share: Share = 0.2
    periods_s: Annotated[list[Annotated[float, Field(ge=1, le=10)]], Field(min_length=1)]
    cycles: Annotated[int, Field(ge=1, le=6)] = 4


class RandomPoints(_Settings):
    """Random speeds of each series of a verification, and random torques at each speed."""

    speeds: Annotated[int, Field(ge=1, le=100)] = 5
    torques: Annotated[int, Field(ge=1, le=100)] = 5
    seed: Annotated[int, Field(ge=0)] = 1


class Steps(_Settings):
    """Steps of torque around a preload, as fast as the drive allows, as shares of the range."""

    preload_share: Share = 0.2
    shares: Annotated[list[Annotated[float, Field(gt=0, le=0.2)]], Field(min_length=1)]
    cycles: Annotated[int, Field(ge=5, le=1000)] = 30
    hold_s: Annotated[float, Field(ge=0.05, le=10)] = 0.15


class Sines(_Settings):
    """Sines of torque of one amplitude around the steps' preload, as shares of the range."""

    share: Share = 0.15
    periods_s: Annotated[list[Annotated[float, Field(ge=1, le=10)]], Field(min_length=2)]
    cycles: Annotated[int, Field(ge=1, le=6)] = 4


class TurningProfile(_Settings):
    """Speeds, ramps, temperatures and torques of a run.

    Parameters
    ----------
    kind : {"empty", "calibration", "verification", "dynamics"}
        "empty": nothing mounted; "calibration" and "verification": steady torques against the
        turning calibrator, at stated or at random values; "dynamics": steps and sines of torque
        against the calibrator at rest.
    speed_shares : list of float
        Rising shares of the largest speed; each in both directions. A verification draws speeds
        between the first and the last.
    hold_s, settle_s : float
        Shortest time at a speed, lengthened to whole revolutions, and settling time before it.
    ramps, temperatures, warm_up, swings
        Parts of an empty run.
    torque_shares : list of float
        Rising shares of the range for a calibration. A verification draws torques up to the last.
    random : RandomPoints, optional
        Points of each series of a verification.
    steps, sines
        Parts of a dynamics run.
    repeats : int
        Number of series at each temperature.
    """

    name: str
    title: str = ""
    kind: Literal["empty", "calibration", "verification", "dynamics"] = "empty"
    speed_shares: list[Share] = []
    largest_rpm: dict[Side, Annotated[float, Field(gt=0)]] = {}
    hold_s: Seconds = 2.0
    settle_s: Seconds = 0.5
    zero_s: Seconds = 1.0
    ramps: Ramps = Ramps()
    temperatures: Temperatures | None = None
    warm_up: WarmUp | None = None
    swings: Swings | None = None
    torque_shares: list[Share] = []
    random: RandomPoints | None = None
    steps: Steps | None = None
    sines: Sines | None = None
    repeats: Annotated[int, Field(ge=1, le=100)] = 1

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        """Refuse keys that don't belong to the profile's kind, and shares that don't rise."""
        for name in ("speed_shares", "torque_shares"):
            values = getattr(self, name)
            if any(b <= a for a, b in pairwise(values)):
                raise ValueError(
                    Message("{name} {values}: rising shares are allowed", name, values)
                )
        turns = self.kind != "dynamics"
        if turns != bool(self.speed_shares) or turns != bool(self.largest_rpm):
            raise ValueError(
                "speed_shares and largest_rpm belong to all kinds except 'dynamics', and to those"
            )
        if turns == bool(self.steps) or (turns and self.sines):
            raise ValueError("steps and sines belong to kind = 'dynamics'; it needs steps")
        if self.kind == "dynamics" and (self.temperatures or self.torque_shares):
            raise ValueError("temperatures and torque_shares don't belong to kind = 'dynamics'")
        if self.steps is not None and self.largest_share > 1.0:
            raise ValueError("steps or sines beyond the range")
        loaded = self.kind in ("calibration", "verification")
        if loaded != bool(self.torque_shares):
            raise ValueError(
                "torque_shares belong to kind = 'calibration' and 'verification', and to them only"
            )
        if (self.kind == "verification") != (self.random is not None):
            raise ValueError("random belongs to kind = 'verification', and to it only")
        if self.kind != "empty" and (self.warm_up or self.swings):
            raise ValueError("warm_up and swings belong to kind = 'empty'")
        if self.kind == "calibration" and self.temperatures:
            raise ValueError("temperatures belong to kind = 'empty' and 'verification'")
        if self.temperatures is not None and self.warm_up is not None:
            raise ValueError("temperatures are waited for, or come by warming up: not both")
        if self.swings is not None and self.swings.around + self.swings.share > 1.0:
            raise ValueError("swings beyond the largest speed")
        return self

    def with_seed(self, seed: int) -> TurningProfile:
        """Return the profile with random points of another seed.

        Raises
        ------
        InputError
            If its points aren't random.
        """
        if self.random is None:
            raise InputError(
                Message("a seed for profile {name}", self.name),
                "a seed for random points: kind = 'verification'",
                "give --profile turning-verification, or no seed",
            )
        return self.model_copy(update={"random": self.random.model_copy(update={"seed": seed})})

    @property
    def sha256(self) -> str:
        """Hash of all settings."""
        text = json.dumps(self.model_dump(mode="json"), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    def top_rpm(self, side: Side) -> float:
        """Return the largest speed of a side.

        Raises
        ------
        InputError
            The profile states no speed.
        """
        if side not in self.largest_rpm:
            raise InputError(
                Message("profile {name} states no largest speed of the {side}", self.name, side),
                Message("largest_rpm.{side} above 0", side),
                "add it to the profile",
            )
        return self.largest_rpm[side]

    @property
    def largest_share(self) -> float:
        """Largest torque of sines, and of steps with their vibration, as a share of the range."""
        assert self.steps is not None
        most = 2.0 * max(self.steps.shares)
        return self.steps.preload_share + max(most, 0.0 if self.sines is None else self.sines.share)

    def torque_legs(self, range_nm: float) -> list[TorqueLeg]:
        """Return the legs of one series of a dynamics run.

        Examples
        --------
        >>> legs = load_turning_profile("dynamics").torque_legs(50.0)
        >>> [(leg.what, len(leg.ramps)) for leg in legs[:2]]
        [('steps of 0.25 N·m', 60), ('steps of 0.5 N·m', 60)]
        """
        assert self.steps is not None
        low = self.steps.preload_share * range_nm
        legs: list[TorqueLeg] = []
        for share in self.steps.shares:
            size = share * range_nm
            both = ((round(low + size, 9), inf), (low, inf))
            legs.append(
                TorqueLeg(
                    low,
                    self.steps.cycles * both,
                    self.steps.hold_s,
                    0.0,
                    Message("steps of {size:g} N·m", size),
                )
            )
        for period_s in [] if self.sines is None else self.sines.periods_s:
            assert self.sines is not None
            size = self.sines.share * range_nm
            ramps = _sine(low, size, period_s, self.sines.cycles)
            what = Message("sine of {size:g} N·m, period {period_s:g} s", size, period_s)
            legs.append(TorqueLeg(low, ramps, 0.0, period_s, what))
        return legs

    def turning_s(self, speed_rpm: float) -> float:
        """Return the time for which a speed is held, in whole revolutions."""
        return whole_turns_s(self.hold_s, speed_rpm)

    def series(self) -> int:
        """Return the number of series."""
        if self.warm_up is not None:
            return self.warm_up.series * self.repeats
        temperatures = 1 if self.temperatures is None else len(self.temperatures.wanted_c)
        return temperatures * self.repeats

    def wanted_c(self, series: int) -> float | None:
        """Return the temperature for a series (from 0), if it has one."""
        if self.temperatures is None:
            return None
        return self.temperatures.wanted_c[series // self.repeats]

    def legs(self, side: Side) -> list[Leg]:
        """Return the legs of one series of an empty run.

        Examples
        --------
        >>> legs = load_turning_profile("empty-run").legs("input")
        >>> [leg.speed_rpm for leg in legs][:6]
        [120.0, 360.0, 660.0, 960.0, 1200.0, 0.0]
        >>> sorted({rate for leg in legs for _, rate in leg.ramps})
        [60.0, 300.0]
        """
        top = self.top_rpm(side)
        gentle, steep = top / self.ramps.gentle_s, top / self.ramps.steep_s
        legs: list[Leg] = []
        for sign, way in ((1.0, "clockwise"), (-1.0, "counter-clockwise")):
            for share in self.speed_shares:
                speed = round(sign * share * top, 9)
                hold = self.settle_s + self.turning_s(speed)
                legs.append(
                    Leg(((speed, gentle),), hold, Message("{speed:g} rpm {way}", abs(speed), way))
                )
            legs.append(Leg(((0.0, gentle),), 1.0, Message("gentle ramp to rest, {way}", way)))
            turn = self.turning_s(sign * top)
            legs.append(
                Leg(
                    ((sign * top, steep),),
                    turn,
                    Message("steep ramp to {top:g} rpm {way}", top, way),
                )
            )
            legs.append(Leg(((0.0, steep),), 1.0, Message("steep ramp to rest, {way}", way)))
            if self.swings is not None:
                legs += self._swung(top, sign, gentle)
                legs.append(Leg(((0.0, gentle),), 1.0, Message("gentle ramp to rest, {way}", way)))
        return legs

    def _swung(self, top: float, sign: float, gentle: float) -> Iterator[Leg]:
        """Yield a run-up at a gentle rate, 1/min per s, then sines of the speed about its end."""
        assert self.swings is not None
        middle, size = sign * self.swings.around * top, self.swings.share * top
        yield Leg(((middle, gentle),), 1.0, Message("{middle:g} rpm", abs(middle)))
        for period_s in self.swings.periods_s:
            ramps = _sine(middle, size, period_s, self.swings.cycles)
            yield Leg(ramps, 0.0, Message("swings of {period_s:g} s", period_s))

    def points(self, side: Side, range_nm: float) -> list[TurningPoint]:
        """Return the steady torques of a calibration or verification.

        A calibration has a series at each speed, a verification `repeats` series at each
        temperature. The last torque at each speed is zero.

        Examples
        --------
        >>> profile = load_turning_profile("turning-calibration")
        >>> [point.torque_nm for point in profile.points("input", 50.0)][:6]
        [0.0, 12.5, 25.0, 37.5, 50.0, 37.5]
        """
        if self.random is not None:
            return self._random_points(self.random, side, range_nm)
        top, turning_points, series = self.top_rpm(side), list[TurningPoint](), 0
        up = [(share * range_nm, 1) for share in self.torque_shares]
        down = [(torque, -1) for torque, _ in reversed(up[:-1])]
        for _ in range(self.repeats):
            for sign in (1.0, -1.0):
                for share in self.speed_shares:
                    speed, series = round(sign * share * top, 9), series + 1
                    turning_points.append(TurningPoint(speed, 0.0, 1, series))
                    for load in (1.0, -1.0):
                        steps = [*up, *down, (0.0, -1)]
                        turning_points += [
                            TurningPoint(speed, load * t, b, series) for t, b in steps
                        ]
        return turning_points

    def _random_points(
        self, drawn: RandomPoints, side: Side, range_nm: float
    ) -> list[TurningPoint]:
        """Return the points of all series, drawn with the profile's seed."""
        top, largest = self.top_rpm(side), self.torque_shares[-1] * range_nm
        lowest, highest = self.speed_shares[0], self.speed_shares[-1]
        drawn_points = list[TurningPoint]()
        for series in range(1, self.series() + 1):
            generator = np.random.default_rng([drawn.seed, SIDES.index(side), series])
            for _ in range(drawn.speeds):
                speed = generator.uniform(lowest, highest) * generator.choice((-1.0, 1.0))
                loads = [*generator.uniform(-largest, largest, drawn.torques).tolist(), 0.0]
                before = 0.0
                for load in loads:
                    grows = load * before <= 0.0 or abs(load) > abs(before)
                    branch = 1 if load and grows else -1
                    torque = round(load, 6)
                    drawn_points.append(TurningPoint(round(speed * top, 6), torque, branch, series))
                    before = load
        return drawn_points


def load_turning_profile(name: str | Path) -> TurningProfile:
    """Return a profile by its name, or a file by a path that ends in ``.toml``.

    Raises
    ------
    InputError
        Where there is no such profile or file, or it isn't a valid profile.
    """
    content, text = profile_text(name, __package__), str(name)
    settings = {"name": Path(text).stem, **parse_toml(content, text)}
    return validated(TurningProfile, settings, f"profile {text}")
