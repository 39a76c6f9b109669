"""Steps and sines of torque against the calibrator at rest, in short windows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.devices import BenchDevices, RampTo
from torquebench.bench.roles import Side
from torquebench.errors import LimitError
from torquebench.message import Message
from torquebench.procedures.guarding import loading_limits
from torquebench.procedures.messages import (
    again_after_pause,
    checkpoint,
    leg_checkpoint,
    move,
    progress,
    sleep,
    take,
)
from torquebench.procedures.reducers.setup import stamp
from torquebench.procedures.setup import REST_S, Plan, Setup, measured_in, power_on
from torquebench.procedures.turning.empty import SeriesTable, run_metadata
from torquebench.procedures.turning.profile import TorqueLeg, TurningProfile
from torquebench.procedures.zeroing import zero
from torquebench.signals import Record
from torquebench.units import MS_PER_S, TURN

FloatArray = NDArray[np.float64]

_PRELOADED_S = 1.0
_LONGEST_STEP_S = 0.05
"""Longest duration of a step, s: half a period of the slowest vibration that is searched for."""
_Stretch = tuple[Record, float]


@dataclass
class StepTable(SeriesTable):
    """Rows of a dynamics run."""

    COLUMNS: ClassVar = ("time_s", "reading_nm", "standard_nm", "segment", "period_s")

    def add(self, recording: Record, period_s: float) -> None:
        """Add the samples of an interval: a step, or a sine with its period."""
        count = len(recording)
        number = 1.0 + (self._pieces[-1][-1, 3] if self._pieces else 0.0)
        rows = [recording.time_s + self.shift_s, recording["reading_nm"], recording["standard_nm"]]
        self._pieces.append(np.column_stack([*rows, np.full(count, number),
                                             np.full(count, period_s)]))  # fmt: skip


def check_drive(devices: BenchDevices, side: Side, profile: TurningProfile) -> None:
    """Refuse steps and sines that the drive can't follow.

    Raises
    ------
    LimitError
        Step or period isn't possible; the message states the largest step or the shortest period.
    """
    module = devices.context.description.module(side)
    full, rate = module.range_nm, module.drive.torque_rate_nm_per_s
    assert profile.steps is not None
    step = max(profile.steps.shares) * full
    if step > _LONGEST_STEP_S * rate:
        raise LimitError(
            Message(
                "a step of {step_nm:g} N·m, which takes the drive {duration_ms:.3g} ms"
                " at {rate:g} N·m/s",
                step,
                MS_PER_S * step / rate,
                rate,
            ),
            Message(
                "at most {longest_ms:g} ms (steps up to {largest_nm:.3g} N·m): "
                "slower ones don't make a shaft vibrate",
                MS_PER_S * _LONGEST_STEP_S,
                _LONGEST_STEP_S * rate,
            ),
            "use smaller steps",
        )
    if profile.sines is None:
        return
    size = profile.sines.share * full
    shortest_s = TURN * size / rate
    if min(profile.sines.periods_s) < shortest_s:
        raise LimitError(
            Message(
                "a sine of {size:g} N·m with a period of {periods_s:g} s",
                size,
                min(profile.sines.periods_s),
            ),
            Message(
                "{shortest_s:.3g} s or more: the drive changes the torque by {rate:g} N·m/s",
                shortest_s,
                rate,
            ),
            "use a smaller sine or longer periods",
        )


def step_torques(
    devices: BenchDevices,
    side: Side,
    profile: TurningProfile,
    table: StepTable,
    *,
    on_series: Callable[[StepTable], None] | None = None,
) -> Plan[StepTable]:
    """Load a module at rest with steps and sines of torque against the calibrator.

    The drive makes the steps as fast as it can. A leg that a pause interrupts is repeated.

    Parameters
    ----------
    side : {"input", "output"}
    profile : TurningProfile
        Profile of kind "dynamics".
    table : StepTable
        Table for the rows; complete series in it are skipped.
    on_series : callable, optional
        Called with the table after every complete series.

    Raises
    ------
    LimitError
        A torque or its rate exceeds the limits of the bench; nothing has moved yet.
    """
    module = devices.context.description.module(side)
    legs, series = profile.torque_legs(module.range_nm), profile.series()
    largest = profile.largest_share * module.range_nm
    limits = loading_limits(devices, side, largest)
    check_drive(devices, side, profile)
    total = series * len(legs)
    metadata = run_metadata(devices, "step_torques", side, profile, total)
    runner = _Stepper(devices, side, table, total)

    def measured() -> Plan[None]:
        """Load all legs of all series that the table lacks; a new zero precedes each series."""
        for number in range(table.series_done, series):
            yield from checkpoint()
            yield from zero(devices, side, duration_s=profile.zero_s, standard=True)
            table.drop_incomplete()
            for place, leg in enumerate(legs):
                yield from runner.load(number, number * len(legs) + place, leg)
            table.end_series()
            if on_series is not None:
                on_series(table)
        yield from progress(total, total, "done")

    setup = Setup("calibration", side, "calibrator", "locked")
    yield from measured_in(setup, devices, measured(), metadata, limits)
    return table


@dataclass
class _Stepper:
    """Drives the legs of a dynamics run."""

    devices: BenchDevices
    side: Side
    table: StepTable
    total: int

    def load(self, series: int, done: int, leg: TorqueLeg) -> Plan[None]:
        """Drive one leg, and repeat it after a pause."""
        yield from progress(done, self.total, leg.what)
        stretches = yield from again_after_pause(partial(self._leg, series, done, leg))
        for stretch in stretches:
            self.table.add(*stretch)

    def _leg(self, series: int, done: int, leg: TorqueLeg) -> Plan[list[_Stretch]]:
        """Drive one leg of steps or sines after its preload; return the recorded stretches."""
        drive, recorder = self.devices.module(self.side).drive, self.devices.recorder
        stretches: list[_Stretch] = []
        yield from power_on(self.devices, self.side)
        yield from stamp(self.devices, series=series + 1, step=done, branch=1)
        yield from move(drive.torque, leg.preload_nm)
        yield from move(recorder, self.side)
        yield from sleep(_PRELOADED_S)
        yield from move(recorder, self.side)  # by now short windows are being counted
        for torque_nm, rate in leg.ramps:
            yield from move(drive.torque, RampTo(torque_nm, rate))
            if leg.hold_s:
                yield from sleep(leg.hold_s)
                yield from self._take(stretches, leg)
            yield from leg_checkpoint()
        if not leg.hold_s:
            yield from sleep(REST_S)
            yield from self._take(stretches, leg)
        return stretches

    def _take(self, stretches: list[_Stretch], leg: TorqueLeg) -> Plan[None]:
        """Record the samples of a leg."""
        recorder = self.devices.recorder
        yield from take(recorder, self.devices.point, stream="points")
        if recorder.fast is not None:  # a rehearsal records nothing
            stretches.append((recorder.fast, leg.period_s))
