"""Empty run of one module: speeds, ramps and swings with nothing mounted, at temperatures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.devices import BenchDevices, MeasuredZero
from torquebench.bench.roles import Side
from torquebench.errors import BenchError
from torquebench.message import Message
from torquebench.procedures.guarding import turning_limits
from torquebench.procedures.messages import (
    again_after_pause,
    checkpoint,
    leg_checkpoint,
    move,
    progress,
    sleep,
    take,
)
from torquebench.procedures.reducers.setup import (
    angle_rad,
    speed_ramp,
    stamp,
    temperature_c,
    turn_at,
)
from torquebench.procedures.setup import (
    REST_S,
    Plan,
    Setup,
    measured_in,
    power_on,
    start_metadata,
)
from torquebench.procedures.turning.profile import Leg, TurningProfile
from torquebench.procedures.zeroing import zero
from torquebench.signals import Record
from torquebench.units import DEG_PER_RAD, DEG_PER_TURN, HOUR, MINUTE

FloatArray = NDArray[np.float64]

LONGEST_PIECE_S = 30.0
"""Bench time of one interval of the recorder, s: acquisition keeps two minutes."""


@dataclass(frozen=True)
class EmptySummary:
    """Result of an empty run; its rows are in the table and in the run's raw stream.

    Parameters
    ----------
    side : {"input", "output"}
    zero : float
        Frequency of the zero that is subtracted from all readings.
    """

    side: Side
    series: int
    rows: int
    zero: float


@dataclass(kw_only=True)
class SeriesTable:
    """Rows of a run in series, one row per window of the counter; the first column is the time.

    Parameters
    ----------
    series_done : int
        Number of complete series; later rows belong to an incomplete one.
    shift_s : float
        Added to the bench time, so that rows of a resumed run follow the earlier ones.
    """

    COLUMNS: ClassVar[tuple[str, ...]]
    series_done: int = 0
    shift_s: float = 0.0
    _pieces: list[FloatArray] = field(default_factory=list)
    _complete: int = 0

    def end_series(self) -> None:
        """Count the current series as complete."""
        self.series_done += 1
        self._complete = len(self._pieces)

    def drop_incomplete(self) -> None:
        """Remove the rows of an incomplete series."""
        del self._pieces[self._complete :]

    def begin_with(self, rows: FloatArray, series_done: int) -> None:
        """Start with the rows of an interrupted run."""
        self._pieces, self._complete, self.series_done = [rows], 1, series_done

    @property
    def rows(self) -> FloatArray:
        """Rows with the columns `COLUMNS`."""
        return np.concatenate([np.empty((0, len(self.COLUMNS))), *self._pieces])


@dataclass
class EmptyTable(SeriesTable):
    """Rows of an empty run.

    Parameters
    ----------
    side : {"input", "output"}
    zero, zero_uncertainty_nm : float
        Frequency of the zero that is subtracted from all readings, and its standard uncertainty;
        NaN before it was measured.
    """

    COLUMNS: ClassVar = ("time_s", "reading_nm", "speed_rpm", "temperature_c", "angle_deg")
    side: Side
    zero: float = float("nan")
    zero_uncertainty_nm: float = float("nan")

    def add(self, recording: Record, before_c: float, after_c: float) -> None:
        """Add the rows of an interval, with the temperature linear between two readings."""
        warm = np.linspace(before_c, after_c, len(recording))
        rows = np.column_stack(
            [
                recording.time_s + self.shift_s,
                recording["reading_nm"],
                recording["speed_rpm"],
                warm,
                recording["angle_rad"] * DEG_PER_RAD % DEG_PER_TURN,
            ]
        )
        self._pieces.append(rows)

    def summary(self) -> EmptySummary:
        """Return the result of the run."""
        return EmptySummary(self.side, self.series_done, len(self.rows), self.zero)


def run_metadata(
    devices: BenchDevices, plan_name: str, side: Side, profile: TurningProfile, points: int
) -> dict[str, Any]:
    """Return the start document's entries of a run with a rotating module."""
    settings = profile.model_dump(mode="json")
    metadata = {"name": profile.name, "sha256": profile.sha256, "settings": settings}
    return start_metadata(devices, plan_name, points, side, profile=metadata)


def turn_empty(
    devices: BenchDevices,
    side: Side,
    profile: TurningProfile,
    table: EmptyTable,
    *,
    wait: bool = True,
    on_series: Callable[[EmptyTable], None] | None = None,
) -> Plan[EmptySummary]:
    """Turn a module with nothing mounted, and record its readings.

    The zero is measured once, at rest before the first series: later series show the influence of
    temperature on it. A leg that a pause interrupts is driven again from rest.

    Parameters
    ----------
    side : {"input", "output"}
    profile : TurningProfile
        Profile of kind "empty".
    table : EmptyTable
        Table for the rows; complete series in it are skipped.
    wait : bool
        Whether a series waits for its temperature; otherwise it starts at once.
    on_series : callable, optional
        Called with the table after every complete series.

    Raises
    ------
    LimitError
        A speed exceeds the limits of the bench; nothing has moved yet.
    BenchError
        A temperature isn't reached in time.
    """
    legs, series = profile.legs(side), profile.series()
    top = profile.top_rpm(side)
    metadata = run_metadata(devices, "turn_empty", side, profile, series * len(legs))
    runner = _Runner(devices, side, profile, table, series * len(legs))

    def measured() -> Plan[None]:
        """Measure the series that are left, each after a zero at the profile's temperature."""
        for number in range(table.series_done, series):
            if wait:
                done = (number * len(legs), runner.total)
                yield from reach_temperature(devices, side, profile, number, done)
            yield from runner.take_zero()
            if profile.warm_up is not None and number:
                yield from runner.warm_up()
            table.drop_incomplete()
            for place, leg in enumerate(legs):
                yield from runner.drive(number, place, leg)
            table.end_series()
            if on_series is not None:
                on_series(table)
        yield from progress(runner.total, runner.total, "done")

    limits = turning_limits(devices, side, top)
    setup = Setup("empty_run", side, "nothing", "free")
    yield from measured_in(setup, devices, measured(), metadata, limits)
    return table.summary()


def reach_temperature(
    devices: BenchDevices, side: Side, profile: TurningProfile, series: int, done: tuple[int, int]
) -> Plan[None]:
    """Wait until the transducer has the temperature of a series (from 0), if it has one.

    Parameters
    ----------
    done : (int, int)
        Number of completed steps and of all steps, for the progress.

    Raises
    ------
    BenchError
        The temperature isn't reached in time.
    """
    wanted, settings = profile.wanted_c(series), profile.temperatures
    if wanted is None or settings is None:
        return
    # A rehearsal doesn't wait for temperatures.
    if (yield from angle_rad(devices, side)) is None:
        return
    probe, warm = devices.context.description.module(side).temperature_probe, float("nan")
    for _ in range(round(settings.longest_h * HOUR / settings.check_interval_s) + 1):
        warm = yield from temperature_c(devices, probe or "")
        if abs(warm - wanted) <= settings.within_k:
            return
        yield from progress(
            *done, Message("waiting for {wanted:g} °C, {warm:.1f} °C now", wanted, warm)
        )
        yield from checkpoint()
        yield from sleep(settings.check_interval_s)
    raise BenchError(
        Message(
            "the {side} transducer has {warm:.1f} °C after {longest_h:g} h",
            side,
            warm,
            settings.longest_h,
        ),
        Message("{wanted:g} °C ± {within_k:g} K", wanted, settings.within_k),
        "heat or cool the room, or measure at its present temperature: --no-wait",
    )


@dataclass
class _Runner:
    """Drives the legs of an empty run."""

    devices: BenchDevices
    side: Side
    profile: TurningProfile
    table: EmptyTable
    total: int
    speed_rpm: float = 0.0

    def _temperature(self) -> Plan[float]:
        probe = self.devices.context.description.module(self.side).temperature_probe
        return (yield from temperature_c(self.devices, probe or ""))

    def take_zero(self) -> Plan[None]:
        """Measure the zero that is subtracted from all readings, once; the drive stays on."""
        module = self.devices.module(self.side)
        if np.isnan(self.table.zero):
            measured = yield from zero(self.devices, self.side, duration_s=self.profile.zero_s)
            self.table.zero = measured.signal
            self.table.zero_uncertainty_nm = measured.standard_uncertainty_nm
            return
        taken = MeasuredZero(self.table.zero, self.table.zero_uncertainty_nm)
        yield from move(module.transducer.zero, taken)
        yield from power_on(self.devices, self.side)

    def warm_up(self) -> Plan[None]:
        """Turn for some time, so that the bench warms up."""
        settings = self.profile.warm_up
        assert settings is not None
        yield from self._turn(settings.share * self.profile.top_rpm(self.side))
        left_s = MINUTE * settings.minutes
        while left_s > 0.0:
            piece_s = min(left_s, LONGEST_PIECE_S)
            yield from again_after_pause(partial(sleep, piece_s), self._turn_again)
            left_s -= piece_s
        yield from self._turn(0.0)
        yield from sleep(REST_S)

    def _turn(self, speed_rpm: float) -> Plan[None]:
        """Ramp the shaft to a speed at the profile's gentle rate."""
        rate = self.profile.top_rpm(self.side) / self.profile.ramps.gentle_s
        yield from power_on(self.devices, self.side)
        yield from turn_at(self.devices, self.side, speed_rpm, rate)
        self.speed_rpm = speed_rpm

    def _turn_again(self) -> Plan[None]:
        """Ramp the shaft back to its speed before a pause."""
        yield from self._turn(self.speed_rpm)
        yield from sleep(REST_S)

    def drive(self, series: int, number: int, leg: Leg) -> Plan[None]:
        """Drive one leg, and repeat it after a pause."""
        yield from progress(self._done(series, number), self.total, leg.what)
        pieces = yield from again_after_pause(
            partial(self._leg, series, number, leg), self._turn_again
        )
        for stretch in pieces:
            self.table.add(*stretch)
        self.speed_rpm = leg.speed_rpm

    def _leg(self, series: int, number: int, leg: Leg) -> Plan[list[tuple[Record, float, float]]]:
        """Drive one leg; return its recorded pieces with the temperatures before and after each."""
        pieces: list[tuple[Record, float, float]] = []
        yield from stamp(self.devices, series=series + 1, step=number, branch=1)
        yield from move(self.devices.recorder, "mark")
        before = yield from self._temperature()
        drive = self.devices.module(self.side).drive
        for speed, rate in leg.ramps:
            yield from move(drive.speed, speed_ramp(speed, rate))
        left_s = leg.hold_s
        while True:
            if left_s > 0.0:
                yield from sleep(min(left_s, LONGEST_PIECE_S))
                left_s -= LONGEST_PIECE_S
            after = yield from self._temperature()
            yield from take(self.devices.recorder, self.devices.point, stream="points")
            recording = self.devices.recorder.modules.get(self.side)
            if recording is not None:  # a rehearsal records nothing
                pieces.append((recording, before, after))
            before = after
            if left_s <= 0.0:
                return pieces
            yield from leg_checkpoint()

    def _done(self, series: int, number: int) -> int:
        """Return the number of legs before a leg of a series."""
        return series * (self.total // self.profile.series()) + number
