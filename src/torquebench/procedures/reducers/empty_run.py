"""The empty run: both shafts turn uncoupled, and their readings are subtracted from later tests."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from torquebench.bench.devices import BenchDevices
from torquebench.message import Message
from torquebench.procedures.guarding import turning_limits
from torquebench.procedures.messages import checkpoint, move, progress, sleep
from torquebench.procedures.reducers.running_table import (
    RunningPoint,
    RunningRecording,
    RunningTable,
)
from torquebench.procedures.reducers.setup import (
    GENTLE_RPM_PER_S,
    ReducerLimits,
    check_speeds,
    over_turns,
    speed_ramp,
    stamp,
)
from torquebench.procedures.setup import REST_S, Plan, Setup, measured_in, start_metadata


@dataclass(frozen=True)
class EmptyRunSettings:
    """Settings of the empty run.

    Parameters
    ----------
    speeds_rpm : tuple of float
        Rising input speeds above 0, 1/min; each in both directions. The output's speed is the
        input's divided by the ratio.
    repeats : int
        Number of passes over all speeds. The subtracted values scatter like those of the test, so
        that too few repeats here make many repeats there useless.
    settle_s, window_s : float
        Time after a speed is reached, and the shortest window, which is lengthened to whole input
        turns, s.
    zero_s : float
        Length of the zeros before every series and after the last, s.
    rate_rpm_per_s : float
        Rate of the input's speed as in the test, (1/min)/s; that of the output follows by the
        ratio.
    """

    speeds_rpm: tuple[float, ...] = (100.0, 400.0, 700.0, 1000.0, 1200.0)
    repeats: int = 8
    settle_s: float = 0.5
    window_s: float = 1.0
    zero_s: float = 1.0
    rate_rpm_per_s: float = GENTLE_RPM_PER_S

    def __post_init__(self) -> None:
        check_speeds(self.speeds_rpm, self.repeats, self.rate_rpm_per_s)

    def within(self, limits: ReducerLimits) -> EmptyRunSettings:
        """Return the settings without speeds that the reducer's limits don't allow."""
        return replace(self, speeds_rpm=limits.reachable(self.speeds_rpm))

    def points(self) -> list[RunningPoint]:
        """Return all points in the order in which they are driven.

        Examples
        --------
        >>> settings = EmptyRunSettings(speeds_rpm=(100.0, 200.0), repeats=1)
        >>> [point.speed_rpm for point in settings.points()]
        [100.0, 200.0, -100.0, -200.0]
        """
        return [
            RunningPoint(sign * speed, 0.0, 1, repeat)
            for repeat in range(1, self.repeats + 1)
            for sign in (1.0, -1.0)
            for speed in self.speeds_rpm
        ]


def empty_run(
    devices: BenchDevices, limits: ReducerLimits, settings: EmptyRunSettings | None = None
) -> Plan[RunningRecording]:
    """Turn both shafts with nothing mounted, and record both readings at each speed.

    Like the readings of a test, these contain the transducer's zero over speed, and the drag of the
    bearings between transducer and flange.

    Parameters
    ----------
    limits : ReducerLimits
        Limits of the reducer that is tested afterwards; its ratio gives the output's speeds.

    Raises
    ------
    LimitError
        A speed exceeds the limits of the bench; nothing has moved yet.
    SignalFault
        A drive doesn't reach its speed.
    """
    settings = settings or EmptyRunSettings()
    points = settings.points()
    table = RunningTable(devices, ("output", "input"))
    metadata = start_metadata(devices, "empty_run", len(points), settings=asdict(settings))
    fastest = settings.speeds_rpm[-1]
    speeds = (
        turning_limits(devices, "input", fastest),
        turning_limits(devices, "output", fastest / abs(limits.ratio)),
    )
    setup = Setup("empty_run", "input", "nothing", "driven")
    turned = _turned(devices, limits, settings, points, table)
    yield from measured_in(setup, devices, turned, metadata, *speeds)
    return table.recording()


def _turned(
    devices: BenchDevices,
    limits: ReducerLimits,
    settings: EmptyRunSettings,
    points: list[RunningPoint],
    table: RunningTable,
) -> Plan[None]:
    """Turn at each point's speed, and zero at rest before each series."""

    def turn(speed_rpm: float) -> Plan[None]:
        yield from _turn(devices, limits.ratio, speed_rpm, settings.rate_rpm_per_s)

    series = present = None
    for number, point in enumerate(points):
        yield from progress(
            number, len(points), Message("empty run, {speed_rpm:g} rpm", point.speed_rpm)
        )
        yield from checkpoint()
        if (point.repeat, np.sign(point.speed_rpm)) != series:
            series = (point.repeat, np.sign(point.speed_rpm))
            if present is not None:
                yield from turn(0.0)
            yield from sleep(REST_S)
            yield from table.zero(settings.zero_s)
        yield from stamp(devices, series=point.repeat, step=number, branch=1)
        present = point.speed_rpm
        yield from turn(present)
        window = over_turns(point.speed_rpm, settings.settle_s, settings.window_s)
        yield from table.take(point, window)
    yield from turn(0.0)
    yield from sleep(REST_S)
    yield from table.zero(settings.zero_s)
    yield from progress(len(points), len(points), "done")


def _turn(
    devices: BenchDevices, ratio: float, speed_rpm: float, rate_rpm_per_s: float
) -> Plan[None]:
    """Ramp both shafts to their speeds together, the output's by the reducer's ratio."""
    towards: list[Any] = []
    for module, part in ((devices.input, 1.0), (devices.output, ratio)):
        ramp = speed_ramp(speed_rpm / part, rate_rpm_per_s / abs(part))
        towards += [module.drive.speed, ramp]
    yield from move(*towards)
