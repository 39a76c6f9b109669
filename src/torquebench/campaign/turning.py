"""Rotating chains: identification from empty runs, and from points at several temperatures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from torquebench.calibration import CalibrationData
from torquebench.chain import (
    LEAST_KELVIN,
    Effect,
    EmptyRun,
    TurningCalibration,
    identify,
)
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.progress import NO_PROGRESS, Progress


@dataclass(frozen=True)
class TurningChain:
    """The identified effects, and the points corrected for these.

    Parameters
    ----------
    points : CalibrationData
        Points with readings converted to standstill and to one temperature, for the static curve.
    remarks : tuple of str
        Effects that weren't identified, and the runs that would identify them.
    """

    points: CalibrationData
    effects: tuple[Effect, ...]
    remarks: tuple[str, ...]


def identify_turning(
    points: CalibrationData, runs: Sequence[EmptyRun], progress: Progress = NO_PROGRESS
) -> TurningChain:
    """Identify temperature, rotation and inertia, as far as points and empty runs allow.

    Without an empty run, points at several temperatures or speeds are used.

    Parameters
    ----------
    points : CalibrationData
        With the temperature and the speed of each point; without a speed they are at standstill.
    progress : Progress
        Receives one stage.

    Raises
    ------
    InputError
        Runs without information, or incompatible with the points.
    """
    if not runs and not _circumstances(points):
        return TurningChain(points, (), ())
    progress.start("Identifying temperature and rotation", 1)
    speed = np.zeros(len(points)) if points.speed_rpm is None else points.speed_rpm
    identified = identify(
        TurningCalibration(
            points.reading_nm,
            points.standard_nm,
            points.branch.astype(np.float64),
            speed,
            points.temperature_c,
            points.zero_temperature_c,
            points.standard_error_nm,
            points.zero_nm,
            points.unloaded,
        ),
        runs,
        points.range_nm,
    )
    progress.finish()
    _, series = np.unique(
        np.column_stack([points.series, identified.series]), axis=0, return_inverse=True
    )
    corrected = replace(
        points, reading_nm=identified.corrected_nm, series=1 + series.reshape(-1).astype(np.int64)
    )
    return TurningChain(corrected, identified.effects, identified.remarks)


def joined_tables(
    tables: Mapping[str, CalibrationData], remark: Callable[[str], object] = str
) -> CalibrationData:
    """Return the points of several tables of one chain, at several temperatures and speeds.

    If the tables have several standards, the larger U counts, also for a table that states none.

    Parameters
    ----------
    tables : mapping of str to CalibrationData
        Tables by their names in messages. One without a speed was measured at standstill.
    remark : callable
        Called with a sentence if the tables' standards differ.

    Raises
    ------
    InputError
        Tables of different chains, or of which only some have a temperature.
    """
    silent = [name for name, table in tables.items() if table.temperature_c is None]
    if 0 < len(silent) < len(tables):
        raise InputError(
            Message("{silent} has no column temperature_c, other tables have", silent[0]),
            "the temperature in all tables or in none",
            "add the column",
        )
    parts = list(tables.values())
    if any(part.speed_rpm is not None for part in parts):
        still = [np.zeros(len(part)) for part in parts]
        parts = [
            part if part.speed_rpm is not None else replace(part, speed_rpm=zeros)
            for part, zeros in zip(parts, still, strict=True)
        ]
    if len(parts) == 1:
        return parts[0]
    joined = CalibrationData.concatenate(parts)
    if joined.reference is not None:
        _remark_standards(tables, joined.reference.record, remark)
    return joined


def _remark_standards(
    tables: Mapping[str, CalibrationData], records: str, remark: Callable[[str], object]
) -> None:
    """Call `remark` if tables have different standards, or none."""
    unstated = [name for name, table in tables.items() if table.reference is None]
    stated = {table.reference.certified for table in tables.values() if table.reference is not None}
    if unstated:
        remark(
            Message(
                "{tables} without U of the standard; that of the other tables is used: {records}",
                ", ".join(unstated),
                records,
            )
        )
    if len(stated) > 1:
        remark(Message("tables of several standards, the larger U is used: {records}", records))


def _circumstances(points: CalibrationData) -> bool:
    """Return whether the points have several temperatures, or were measured on a turning chain."""
    warm, speed = points.temperature_c, points.speed_rpm
    warmed = warm is not None and np.ptp(warm) >= LEAST_KELVIN
    return bool(warmed or (speed is not None and np.max(np.abs(speed)) > 1.0))
