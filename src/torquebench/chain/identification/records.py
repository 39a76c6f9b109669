"""Input of an identification: empty runs, and a calibration with its conditions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from torquebench.chain.acceleration import AccelerationBySpeed
from torquebench.chain.readings import FloatArray
from torquebench.errors import InputError
from torquebench.message import Message

SAME_K = 2.0
"""Largest spread of the temperatures of points that count as measured at one temperature."""

_FEWEST_ROWS = 20


@dataclass(frozen=True, eq=False)
class EmptyRun:
    """A run with nothing mounted, in which only inertia causes a true torque.

    Parameters
    ----------
    source : str
        Name of the file, for messages and records.
    time_s, reading_nm, speed_rpm, temperature_c : float64 array of shape (n,)
        At an even rate.
    acceleration_rad_s2 : float64 array of shape (n,), optional
        Angular acceleration; from the speed by default.
    angle_rad : float64 array of shape (n,), optional
        Angle of the shaft in the middle of each window, from the same mark in all runs.
    zero_nm : float, optional
        Zero that was subtracted from the readings: its frequency, as a torque from the nominal
        zero.

    Raises
    ------
    InputError
        Too few samples, times that don't rise or aren't even, values that aren't finite.
    """

    source: str
    time_s: FloatArray
    reading_nm: FloatArray
    speed_rpm: FloatArray
    temperature_c: FloatArray
    acceleration_rad_s2: FloatArray | None = None
    zero_nm: float | None = None
    angle_rad: FloatArray | None = None

    def __post_init__(self) -> None:
        if self.time_s.size < _FEWEST_ROWS:
            raise InputError(
                Message("{source}: an empty run of {size} samples", self.source, self.time_s.size),
                Message("at least {fewest_rows}, over all working speeds", _FEWEST_ROWS),
            )
        step = np.diff(self.time_s)
        if not np.all(step > 0.0):
            row = int(np.argmin(step > 0.0)) + 1
            raise InputError(
                Message(
                    "{source}: time {time_s:.9g} s after {before_s:.9g} s",
                    self.source,
                    self.time_s[row],
                    self.time_s[row - 1],
                ),
                "rising times",
                "give every run its own file",
            )
        if np.mean(np.abs(step - np.median(step)) > 0.5 * np.median(step)) > 0.01:
            raise InputError(
                Message(
                    "{source}: steps of {shortest_s:.3g} to {longest_s:.3g} s",
                    self.source,
                    step.min(),
                    step.max(),
                ),
                "an even rate, single gaps at most",
                "record the run at a fixed rate",
            )

    @cached_property
    def acceleration(self) -> FloatArray:
        """Angular acceleration, from the speed if it wasn't recorded, rad/s²."""
        if self.acceleration_rad_s2 is not None:
            return self.acceleration_rad_s2
        by_speed = AccelerationBySpeed.of(self.time_s, self.speed_rpm)
        return by_speed(self.time_s, self.speed_rpm)[0]

    def __len__(self) -> int:
        return int(self.time_s.size)


@dataclass(frozen=True, eq=False)
class TurningCalibration:
    """Points of a calibration with speed and temperature.

    Parameters
    ----------
    reading_nm, standard_nm, branch : float64 array of shape (n,)
    speed_rpm : float64 array of shape (n,)
        Speed; 0 at standstill.
    temperature_c : float64 array of shape (n,) or None
        None where it wasn't measured.
    standard_error_nm : float64 array of shape (n,), optional
        Standard error of readings that are means; None for single readings.
    zero_nm : float64 array of shape (n,), optional
        Zero that was subtracted from each reading, as in `EmptyRun.zero_nm`.
    zero_temperature_c : float64 array of shape (n,), optional
        Temperature at the zero that was subtracted; by default that of the static curve.
    unloaded : bool array of shape (n,), optional
        Points at which no torque was commanded, because drives don't reach 0 exactly; None if
        unknown.
    """

    reading_nm: FloatArray
    standard_nm: FloatArray
    branch: FloatArray
    speed_rpm: FloatArray
    temperature_c: FloatArray | None
    zero_temperature_c: FloatArray | None = None
    standard_error_nm: FloatArray | None = None
    zero_nm: FloatArray | None = None
    unloaded: NDArray[np.bool_] | None = None


@dataclass(frozen=True, eq=False)
class Zeros:
    """Zeros that were taken before series and empty runs.

    Parameters
    ----------
    zero_nm : float64 array of shape (n,)
        Zeros as torques, relative to the same zero as the readings.
    temperature_c : float64 array of shape (n,)
    """

    zero_nm: FloatArray
    temperature_c: FloatArray


def related_to_one_zero(
    calibration: TurningCalibration, runs: Sequence[EmptyRun]
) -> tuple[TurningCalibration, list[EmptyRun], Zeros | None]:
    """Return points and runs with readings relative to one common zero, and the zeros taken.

    A zero is taken once, with one seating of the parts, while the points after it average over many
    loadings. If all tables state their zeros, the points thus show the zero at their temperature
    better than single zeros do: all readings are then related to the zero of the most points.
    Otherwise the points keep their zeros, and the runs are related to the zero of the first run.

    Raises
    ------
    InputError
        Some runs state their zero and others don't.
    """
    known = [run for run in runs if run.zero_nm is not None]
    if known and len(known) < len(runs):
        silent = next(run.source for run in runs if run.zero_nm is None)
        raise InputError(
            Message("{source} states its zero, {silent} doesn't", known[0].source, silent),
            "zero_nm in all empty runs, or one zero for all of them and no zero_nm",
            "record all of them with `torquebench turn`, or give one run only",
        )
    zero_nm, warm = calibration.zero_nm, calibration.temperature_c
    if zero_nm is None or warm is None or len(known) < len(runs):
        first_nm = known[0].zero_nm if known else None
        return calibration, [_from_zero(run, first_nm) for run in runs], None
    common_nm = float(np.mean(zero_nm[usual_points(calibration.speed_rpm, warm)]))
    zeroed = warm if calibration.zero_temperature_c is None else calibration.zero_temperature_c
    first = np.concatenate([[0], np.flatnonzero(np.diff(zero_nm)) + 1])
    zeros = Zeros(
        np.array([*zero_nm[first], *(run.zero_nm for run in known)]) - common_nm,
        np.array([*zeroed[first], *(run.temperature_c[0] for run in known)]),
    )
    related = replace(
        calibration,
        reading_nm=calibration.reading_nm + (zero_nm - common_nm),
        zero_temperature_c=None,
        zero_nm=None,
    )
    return related, [_from_zero(run, common_nm) for run in runs], zeros


def _from_zero(run: EmptyRun, zero_nm: float | None) -> EmptyRun:
    """Return a run whose readings count from another zero, if both zeros are known."""
    if run.zero_nm is None or zero_nm is None:
        return run
    return replace(run, reading_nm=run.reading_nm + (run.zero_nm - zero_nm), zero_nm=zero_nm)


def usual_points(speed_rpm: FloatArray, temperature_c: FloatArray) -> NDArray[np.bool_]:
    """Return the points at standstill, if there are any, and at the most frequent temperature."""
    from torquebench.chain.effects.rotation import STANDSTILL_RPM  # imported late: heavy

    still = np.abs(speed_rpm) <= STANDSTILL_RPM
    usual = still if still.any() else np.ones(still.size, dtype=bool)
    ordered = np.sort(temperature_c[usual])
    above, below = (
        np.searchsorted(ordered, temperature_c[usual] + offset_k) for offset_k in (SAME_K, -SAME_K)
    )
    most = float(temperature_c[usual][np.argmax(above - below)])
    return np.asarray(usual & (np.abs(temperature_c - most) <= SAME_K))


def stretches(speed_rpm: FloatArray | None, temperature_c: FloatArray | None) -> NDArray[np.int64]:
    """Return a number for each point that rises whenever temperature or speed changed.

    Equal numbers follow each other in time. All numbers are 1 if neither speed nor temperature is
    known.

    Examples
    --------
    >>> stretches(np.array([0.0, 0.0, 300.0, 301.0]), None)
    array([1, 1, 2, 2])
    """
    measured = [condition for condition in (speed_rpm, temperature_c) if condition is not None]
    changed = np.zeros(measured[0].size - 1 if measured else 0, dtype=bool)
    if speed_rpm is not None:
        changed |= np.abs(np.diff(speed_rpm)) > np.maximum(0.05 * np.abs(speed_rpm[1:]), 1.0)
    if temperature_c is not None:
        changed |= np.abs(np.diff(temperature_c)) > SAME_K
    return np.concatenate([[1], 1 + np.cumsum(changed)]).astype(np.int64)
