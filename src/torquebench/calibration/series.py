"""From the table of a calibration to the series of a static evaluation, and its zero hysteresis."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torquebench.calibration.data import CalibrationData
from torquebench.calibration.evaluation import LoadingSeries
from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["STEP_TOLERANCE_PERCENT", "ZeroHysteresis", "loading_series", "zero_hysteresis"]

STEP_TOLERANCE_PERCENT = 0.5
"""A step is refused if its reference torque deviates from its nominal torque by more than this."""


@dataclass(frozen=True)
class ZeroHysteresis:
    """Difference of the zero after loading from either side.

    Parameters
    ----------
    cycles : int
        Number of cycles with both zeros.
    mean_nm, worst_nm : float
        Mean and largest difference, zero after clockwise minus zero after counter-clockwise.
    mean_percent_fs, worst_percent_fs : float
        The same in % of full scale.
    """

    cycles: int
    mean_nm: float
    worst_nm: float
    mean_percent_fs: float
    worst_percent_fs: float


def loading_series(
    data: CalibrationData,
    direction: int,
    *,
    tolerance_percent: float | None = STEP_TOLERANCE_PERCENT,
) -> tuple[NDArray[np.float64], list[LoadingSeries]]:
    """Return steps and series of one direction, as `evaluate_static` takes them.

    A reference transducer never shows the nominal step exactly, so each deflection is normalised
    to it first: X* = X · M_nom/M_ref.

    Parameters
    ----------
    data : CalibrationData
        A calibration in steps, with nominal torques; a series is one rise and, where the branch
        says so, the fall after it. Points at a nominal torque of 0 on the falling branch are the
        zero after the series.
    direction : {+1, -1}
        +1 clockwise, -1 counter-clockwise.
    tolerance_percent : float or None, default 0.5
        Largest distance of the reference from the nominal torque, in % of it; None for any.

    Returns
    -------
    torque_nm : array of float, shape (m,)
        Magnitudes of the steps, rising.
    series : list of LoadingSeries
        Deflections as magnitudes.

    Raises
    ------
    InputError
        Where there are no nominal torques or no points, a step lies too far off, is missing in a
        series or occurs in it twice.
    """
    if data.nominal_nm is None:
        raise InputError(
            "a calibration without nominal torques",
            "a column nominal_nm",
            "add the target torque of each step",
        )
    here = data.loading_direction() == direction
    loaded = ~data.unloaded
    if not np.any(here & loaded):
        name = "clockwise" if direction > 0 else "counter-clockwise"
        raise InputError(Message("no {name} points", name), "a calibration of this direction")
    torque = np.unique(np.abs(data.nominal_nm[here & loaded]))
    if tolerance_percent is not None:
        _check_steps(data, here & loaded, tolerance_percent)
    series = []
    for number in np.unique(data.series[here & loaded]):
        member = here & (data.series == number)
        series.append(_one_series(data, member, loaded, torque, direction))
    return torque, series


def _one_series(
    data: CalibrationData,
    member: NDArray[np.bool_],
    loaded: NDArray[np.bool_],
    torque: NDArray[np.float64],
    direction: int,
) -> LoadingSeries:
    assert data.nominal_nm is not None
    columns: dict[int, NDArray[np.float64]] = {}
    number = int(data.series[member][0])
    for branch in (1, -1):
        points = np.flatnonzero(member & loaded & (data.branch == branch))
        if branch == -1 and points.size == 0:
            continue
        column = np.full(torque.size, np.nan)
        for point in points:
            step = int(np.searchsorted(torque, abs(data.nominal_nm[point])))
            if np.isfinite(column[step]):
                raise InputError(
                    Message(
                        "series {number} has the step {nominal_nm:.6g} N·m twice on one branch",
                        number,
                        data.nominal_nm[point],
                    ),
                    "each step once",
                    "number repeated series differently",
                )
            normalised = data.nominal_nm[point] / data.standard_nm[point]
            column[step] = direction * data.reading_nm[point] * normalised
        if branch == -1 and np.isnan(column[-1]):
            column[-1] = columns[1][-1]  # the reversal: the largest step is read once for both
        missing = np.flatnonzero(np.isnan(column))
        if missing.size:
            raise InputError(
                Message(
                    "series {number} lacks the step {torque:.6g} N·m with {value} torque",
                    number,
                    torque[missing[0]],
                    "increasing" if branch > 0 else "decreasing",
                ),
                "every step in every series",
                "measure the series again",
            )
        columns[branch] = column
    returns = data.reading_nm[member & ~loaded & (data.branch < 0)]
    position = 0.0 if data.position_deg is None else float(data.position_deg[member][0])
    return LoadingSeries(
        position_deg=position,
        increasing=columns[1],
        decreasing=columns.get(-1),
        zero_return=float(returns[-1]) if returns.size else None,
    )


def _check_steps(data: CalibrationData, where: NDArray[np.bool_], tolerance_percent: float) -> None:
    assert data.nominal_nm is not None
    for point in np.flatnonzero(where):
        nominal, standard = data.nominal_nm[point], data.standard_nm[point]
        off = 100.0 * abs(standard - nominal) / abs(nominal)
        if off > tolerance_percent:
            raise InputError(
                Message(
                    "the step {nominal:.6g} N·m of series {series} was loaded with "
                    "{standard:.6g} N·m, deviation {off:.2g} %",
                    nominal,
                    data.series[point],
                    standard,
                    off,
                ),
                Message("a deviation of at most {tolerance_percent:g} %", tolerance_percent),
                "load the step again",
            )


def zero_hysteresis(data: CalibrationData) -> ZeroHysteresis:
    """Return the difference of the zero of reversing cycles after loading from either side.

    Parameters
    ----------
    data : CalibrationData
        Cycles 0 → +FS → 0 → −FS → 0, one a series, with a point at each zero.

    Raises
    ------
    InputError
        Where no series has both zeros.

    Examples
    --------
    >>> data = CalibrationData(
    ...     [10.0, 0.03, -10.0, -0.01], [10.0, 0.0, -10.0, 0.0], [1] * 4, [1, -1, 1, -1], 10.0
    ... )
    >>> round(zero_hysteresis(data).mean_percent_fs, 6)
    0.4
    """
    unloaded = data.unloaded & (data.branch < 0)
    side = data.loading_direction()
    differences = []
    for number in np.unique(data.series):
        zeros = {
            sign: data.reading_nm[unloaded & (data.series == number) & (side == sign)]
            for sign in (1, -1)
        }
        if zeros[1].size and zeros[-1].size:
            differences.append(float(zeros[1].mean() - zeros[-1].mean()))
    if not differences:
        raise InputError(
            "no series with a zero after either direction",
            "cycles through both directions",
            "calibrate by the profile reversing",
        )
    mean = float(np.mean(differences))
    worst = max(differences, key=abs)
    return ZeroHysteresis(
        cycles=len(differences),
        mean_nm=mean,
        worst_nm=worst,
        mean_percent_fs=100.0 * mean / data.range_nm,
        worst_percent_fs=100.0 * worst / data.range_nm,
    )
