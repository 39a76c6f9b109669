"""Errors and coverage of verified points, binned by speed, temperature and torque."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from torquebench.calibration.data import CalibrationData
from torquebench.chain import Torque

_BINS = 3
_WHOLE = 10.0
"""Cells have round limits: multiples of 10 for speeds in 1/min, and a tenth of that for
temperatures in °C."""


@dataclass(frozen=True)
class Cell:
    """Error and coverage of the points in one cell.

    Parameters
    ----------
    speed_rpm, temperature_c, torque_share : tuple of float or None
        Limits of speed, temperature and torque over range; None where they aren't known.
    rms_percent_fs, worst_percent_fs : float
        Error against the standard, or the true torque where it is known.
    coverage : float
        Share of points whose error lies within U.
    """

    speed_rpm: tuple[float, float] | None
    temperature_c: tuple[float, float] | None
    torque_share: tuple[float, float]
    points: int
    rms_percent_fs: float
    worst_percent_fs: float
    coverage: float


def cells(data: CalibrationData, torque: Torque) -> tuple[Cell, ...]:
    """Return the cells that contain points, three bins for each quantity.

    Parameters
    ----------
    torque : Torque
        Torque of the measuring chain at its points.

    Examples
    --------
    >>> data = CalibrationData([1.0, 9.0], [1.0, 9.1], [1, 1], [1, 1], 10.0)
    >>> [(each.points, each.torque_share) for each in cells(data, Torque(data.reading_nm, ()))]
    [(1, (-0.33, 0.33)), (1, (0.33, 1.02))]
    """
    reference = data.standard_nm if data.true_torque_nm is None else data.true_torque_nm
    error = torque.value_nm - reference
    inside = np.abs(error) <= torque.expanded_uncertainty_nm
    share = reference / data.range_nm
    percent = 100.0 / data.range_nm
    filled = []
    for speed, warmth, load in product(
        _parts(data.speed_rpm, _WHOLE),
        _parts(data.temperature_c, 1.0 / _WHOLE),
        [(low, high, (share >= low) & (share < high)) for low, high in _LOADS],
    ):
        rows = load[2].copy()
        for _, _, member in (part for part in (speed, warmth) if part is not None):
            rows &= member
        if rows.any():
            filled.append(
                Cell(
                    None if speed is None else speed[:2],
                    None if warmth is None else warmth[:2],
                    load[:2],
                    int(np.sum(rows)),
                    percent * float(np.sqrt(np.mean(error[rows] ** 2))),
                    percent * float(np.max(np.abs(error[rows]))),
                    float(np.mean(inside[rows])),
                )
            )
    return tuple(filled)


def cell_rows(data: CalibrationData, torque: Torque) -> list[list[str]]:
    """Return a table row for each cell of speed, temperature and torque that contains points."""

    def limits(pair: tuple[float, float] | None, factor: float = 1.0) -> str:
        return "-" if pair is None else f"{factor * pair[0]:.4g} … {factor * pair[1]:.4g}"

    return [
        [
            limits(each.speed_rpm),
            limits(each.temperature_c),
            limits(each.torque_share, 100.0),
            str(each.points),
            f"{each.rms_percent_fs:.3g}",
            f"{each.worst_percent_fs:.3g}",
            f"{100.0 * each.coverage:.1f} %",
        ]
        for each in cells(data, torque)
    ]


_LOADS = ((-1.02, -0.33), (-0.33, 0.33), (0.33, 1.02))
_Part = tuple[float, float, NDArray[np.bool_]]


def _parts(values: NDArray[np.float64] | None, range_nm: float) -> Iterator[_Part | None]:
    """Yield the bins of a quantity and their rows; a single None if it is unknown or constant."""
    if values is None or np.ptp(values) < range_nm:
        yield None
        return
    limits = np.round(np.linspace(np.min(values), np.max(values), _BINS + 1) / range_nm) * range_nm
    for number in range(_BINS):
        low, high = float(limits[number]), float(limits[number + 1])
        above = values >= low if number else np.ones(values.size, dtype=bool)
        below = values < high if number < _BINS - 1 else np.ones(values.size, dtype=bool)
        yield low, high, above & below
