"""Chains that turn: what empty runs and points at other speeds and temperatures tell of one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from torquebench.calibration import CalibrationData
from torquebench.campaign.progress import NO_PROGRESS, Progress
from torquebench.chain import Effect, EmptyRun, Readings, TurningCalibration, identify

__all__ = ["TurningChain", "identify_turning", "recorded_readings"]

_STREAM_S = 1.0
"""Rows farther apart than this are steady points, not a record whose speed has a slope."""


@dataclass(frozen=True)
class TurningChain:
    """What was identified, and the points without it.

    Parameters
    ----------
    points : CalibrationData
        Readings as they would be at standstill and at one temperature, for the static curve.
    effects : tuple of Effect
    remarks : tuple of str
        What wasn't identified, and what would do it.
    """

    points: CalibrationData
    effects: tuple[Effect, ...]
    remarks: tuple[str, ...]


def identify_turning(
    points: CalibrationData, runs: Sequence[EmptyRun], progress: Progress = NO_PROGRESS
) -> TurningChain:
    """Identify temperature, rotation and inertia; nothing where there is no empty run.

    Parameters
    ----------
    points : CalibrationData
        With the temperature and the speed of each point; without a speed they are at standstill.
    runs : sequence of EmptyRun
    progress : Progress
        Told one stage.

    Raises
    ------
    InputError
        Runs that say nothing, or that can't be put together with the points.
    """
    if not runs:
        return TurningChain(points, (), _unused(points))
    progress.start("Identifying temperature and rotation", 1)
    speed = np.zeros(len(points)) if points.speed_rpm is None else points.speed_rpm
    found = identify(
        TurningCalibration(
            points.reading_nm,
            points.standard_nm,
            points.branch.astype(np.float64),
            speed,
            points.temperature_c,
        ),
        runs,
        points.range_nm,
    )
    progress.finish()
    _, series = np.unique(
        np.column_stack([points.series, found.series]), axis=0, return_inverse=True
    )
    corrected = replace(
        points, reading_nm=found.corrected_nm, series=1 + series.reshape(-1).astype(np.int64)
    )
    return TurningChain(corrected, found.effects, found.remarks)


def _unused(points: CalibrationData) -> tuple[str, ...]:
    """Say that speeds and temperatures of points aren't used without an empty run."""
    warm, speed = points.temperature_c, points.speed_rpm
    said = []
    if warm is not None and np.ptp(warm) > 4.0:
        said.append(f"{np.min(warm):.3g} to {np.max(warm):.3g} °C")
    if speed is not None and np.max(np.abs(speed)) > 1.0:
        said.append(f"up to {np.max(np.abs(speed)):.4g} 1/min")
    if not said:
        return ()
    return (
        f"the points were taken at {' and '.join(said)}: give the chain's empty runs with --empty, "
        "or that counts as scatter",
    )


def recorded_readings(points: CalibrationData, zero_temperature_c: float | None) -> Readings:
    """Return points of a record as readings whose zero is that of the calibration.

    Parameters
    ----------
    points : CalibrationData
    zero_temperature_c : float or None
        Temperature at which the record's own zero was taken.
    """
    readings = replace(points.readings(), zero_temperature_c=zero_temperature_c)
    time_s, speed = points.time_s, points.speed_rpm
    if time_s is None or speed is None or points.acceleration_rad_s2 is not None:
        return readings
    step = np.diff(time_s)
    if step.size and np.all(step > 0.0) and np.median(step) <= _STREAM_S:
        readings = replace(readings, time_s=time_s, acceleration_rad_s2=None)
    return readings
