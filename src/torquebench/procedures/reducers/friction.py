"""No-load friction of a mounted reducer against its input speed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.devices import BenchDevices, Point, SteadySettings
from torquebench.message import Message
from torquebench.procedures.guarding import turning_limits
from torquebench.procedures.messages import checkpoint, move, prepare, progress, take
from torquebench.procedures.reducers.setup import (
    GENTLE_RPM_PER_S,
    REDUCER_SETUP,
    check_speeds,
    directions,
    over_turns,
    turn_at,
)
from torquebench.procedures.setup import Plan, measured_in, start_metadata
from torquebench.procedures.zeroing import zero


@dataclass(frozen=True)
class FrictionSettings:
    """Speeds, repeats and durations.

    Parameters
    ----------
    speeds_rpm : tuple of float
        Rising input speeds above 0, 1/min; driven upwards, then downwards without repeating the
        largest.
    repeats : int
        Number of repeats of the sweep.
    clockwise, counter_clockwise : bool
        Directions to be driven.
    settle_s : float
        Time from a speed command until the window may begin, s.
    window_s : float
        Shortest averaging window, s; it is lengthened to whole revolutions.
    limit_s : float
        Additional waiting time for a settled reading, s.
    zero_s : float
        Length of the zero before the first point, s.
    rate_rpm_per_s : float
        Rate of the speed between points, (1/min)/s, limited by the drive's.
    """

    speeds_rpm: tuple[float, ...] = (20.0, 50.0, *(100.0 * k for k in range(1, 13)))
    repeats: int = 3
    clockwise: bool = True
    counter_clockwise: bool = True
    settle_s: float = 0.4
    window_s: float = 0.4
    limit_s: float = 1.0
    zero_s: float = 1.0
    rate_rpm_per_s: float = GENTLE_RPM_PER_S

    def __post_init__(self) -> None:
        check_speeds(self.speeds_rpm, self.repeats, self.rate_rpm_per_s)
        directions(self)

    def points(self) -> Iterator[FrictionPoint]:
        """Return all points in the order in which they are driven.

        Examples
        --------
        >>> settings = FrictionSettings(speeds_rpm=(100.0, 200.0), repeats=1)
        >>> [(point.speed_rpm, point.branch) for point in settings.points()]
        [(100.0, 1), (200.0, 1), (100.0, -1), (-100.0, 1), (-200.0, 1), (-100.0, -1)]
        """
        for repeat in range(1, self.repeats + 1):
            yield from self.repeat(repeat)

    def repeat(self, number: int) -> Iterator[FrictionPoint]:
        """Return the points of one repeat: in each direction speeds rise, then fall."""
        path = [(speed, 1) for speed in self.speeds_rpm]
        path += [(speed, -1) for speed in self.speeds_rpm[-2::-1]]
        for series, sign in enumerate(directions(self), start=1):
            for place, (speed, branch) in enumerate(path):
                yield FrictionPoint(number, series, place, sign * speed, branch)

    def steady(self, speed_rpm: float) -> SteadySettings:
        """Return the settings for averaging the torque at one speed over whole revolutions.

        Examples
        --------
        >>> FrictionSettings().steady(-200.0).window_s
        0.6
        """
        return over_turns(speed_rpm, self.settle_s, self.window_s, self.limit_s)


@dataclass(frozen=True)
class FrictionPoint:
    """One point of the sweep."""

    repeat: int
    series: int
    number: int
    speed_rpm: float
    branch: int


@dataclass(frozen=True)
class FrictionSweep:
    """No-load friction torque of a mounted reducer against its input speed.

    Parameters
    ----------
    speed_rpm : float64[n]
        Mean input speed of each point, clockwise positive, 1/min.
    nominal_rpm : float64[n]
        Commanded speed.
    torque_nm : float64[n]
        Input torque, compensated where `compensated`, N·m.
    standard_error_nm : float64[n]
        Standard error of the mean reading, N·m.
    true_torque_nm : float64[n] or None
        The twin's true input torque, N·m; None on a real bench.
    repeat : int64[n]
        1, 2, 3.
    branch : int8[n]
        +1 while the speed's magnitude rises, -1 while it falls.
    temperature_c : float64[n]
        Temperature of the input transducer, °C.
    compensated : bool
        Whether the module's active model was applied.
    unsettled : int
        Number of points whose reading still drifted.
    """

    speed_rpm: NDArray[np.float64]
    nominal_rpm: NDArray[np.float64]
    torque_nm: NDArray[np.float64]
    standard_error_nm: NDArray[np.float64]
    true_torque_nm: NDArray[np.float64] | None
    repeat: NDArray[np.int64]
    branch: NDArray[np.int8]
    temperature_c: NDArray[np.float64]
    compensated: bool
    unsettled: int


def friction_sweep(
    devices: BenchDevices, settings: FrictionSettings | None = None
) -> Plan[FrictionSweep]:
    """Drive the input of a mounted reducer, output free, and read the friction at each speed.

    Parameters
    ----------
    settings : FrictionSettings, optional
        By default 20 to 1200 rpm up and down in both directions, three repeats.

    Raises
    ------
    LimitError
        A speed exceeds the drive's limit; nothing has moved yet.
    """
    settings = settings or FrictionSettings()
    points = list(settings.points())
    rows: list[Mapping[str, Any]] = []
    metadata = start_metadata(
        devices,
        "friction_sweep",
        len(points),
        "input",
        speeds_rpm=list(settings.speeds_rpm),
        repeats=settings.repeats,
    )
    limits = turning_limits(devices, "input", settings.speeds_rpm[-1])
    measuring = _sweep(devices, settings, points, rows)
    yield from measured_in(REDUCER_SETUP, devices, measuring, metadata, limits)
    return _result(points, rows)


def _sweep(
    devices: BenchDevices,
    settings: FrictionSettings,
    points: list[FrictionPoint],
    rows: list[Mapping[str, Any]],
) -> Plan[None]:
    """Measure the friction torque at each point."""
    yield from progress(0, len(points), "zero")
    yield from move(devices.point, Point())
    yield from zero(devices, "input", duration_s=settings.zero_s)
    for number, point in enumerate(points):
        text = Message("repeat {repeat}, {speed_rpm:g} rpm", point.repeat, point.speed_rpm)
        yield from progress(number, len(points), text)
        yield from checkpoint()
        rows.append((yield from _point(devices, settings, point)))
    yield from progress(len(points), len(points), "done")


def _point(
    devices: BenchDevices, settings: FrictionSettings, point: FrictionPoint
) -> Plan[Mapping[str, Any]]:
    """Turn the input at a point's speed, and return the values of its steady torque."""
    module = devices.input
    yield from prepare(module.steady, settings.steady(point.speed_rpm), wait=True)
    stamp = Point(series=point.series, step=point.number, branch=point.branch, group=point.repeat)
    yield from move(devices.point, stamp)
    yield from turn_at(devices, "input", point.speed_rpm, settings.rate_rpm_per_s)
    return (yield from take(module.steady, devices.point, stream="points"))


def _result(points: list[FrictionPoint], rows: list[Mapping[str, Any]]) -> FrictionSweep:
    """Return the sweep's columns, compensated if all rows are."""
    compensated = all("torque_nm" in row for row in rows)
    simulated = all("true_torque_nm" in row for row in rows)

    def column(name: str) -> NDArray[np.float64]:
        return np.array([row[name] for row in rows], dtype=np.float64)

    return FrictionSweep(
        speed_rpm=column("speed_rpm"),
        nominal_rpm=np.array([point.speed_rpm for point in points]),
        torque_nm=column("torque_nm" if compensated else "reading_nm"),
        standard_error_nm=column("reading_standard_error_nm"),
        true_torque_nm=column("true_torque_nm") if simulated else None,
        repeat=np.array([point.repeat for point in points], dtype=np.int64),
        branch=np.array([point.branch for point in points], dtype=np.int8),
        temperature_c=column("temperature_c"),
        compensated=compensated,
        unsettled=sum(not row["settled"] for row in rows),
    )
