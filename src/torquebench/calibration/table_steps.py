"""Steps of a table that doesn't follow its profile."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from torquebench.calibration.data import UNLOADED_SHARE, CalibrationData
from torquebench.calibration.deviations import Deviation, ladder_points
from torquebench.calibration.profile import Profile
from torquebench.calibration.series import STEP_TOLERANCE_PERCENT
from torquebench.message import Message

__all__ = ["EvaluablePoints", "evaluable_points", "own_steps"]

_NAMES = {1: "clockwise", -1: "counter-clockwise"}


@dataclass(frozen=True, eq=False)
class EvaluablePoints:
    """Points of a table that can be evaluated, step by step.

    Parameters
    ----------
    data : CalibrationData or None
        With nominal torques, each of which every series of its direction has; None if it can't be
        evaluated.
    of_profile : bool
        Whether those are the profile's steps; otherwise the table's own.
    remarks : tuple of str
        Omitted points, and why.
    """

    data: CalibrationData | None
    of_profile: bool
    remarks: tuple[str, ...] = ()


def evaluable_points(
    data: CalibrationData,
    nominal: CalibrationData,
    profile: Profile,
    deviations: Sequence[Deviation],
) -> EvaluablePoints:
    """Return the points by the profile's steps, or by the table's own if some are missing.

    Parameters
    ----------
    data : CalibrationData
        The table as read.
    nominal : CalibrationData
        The same with the profile's steps, as from `assign_nominal`.
    profile : Profile
    deviations : sequence of Deviation
        As from `find_deviations`.
    """
    if any(each.kind in ("missing_series", "missing_step") for each in deviations):
        return own_steps(data)
    return EvaluablePoints(nominal.subset(ladder_points(nominal, profile)), True)


def own_steps(data: CalibrationData) -> EvaluablePoints:
    """Return the points by the table's own steps; incomplete steps are left out.

    Reference torques within 0.5 % of their neighbour are one step, at their mean.

    Examples
    --------
    >>> data = CalibrationData(
    ...     [2, 4.1, 6, 2, 4.1], [2.001, 4, 6, 1.999, 4.002], [1, 1, 1, 2, 2], [1] * 5, 10.0
    ... )
    >>> found = own_steps(data)
    >>> found.data.nominal_nm.tolist()
    [2.0, 4.0, 2.0, 4.0]
    >>> found.remarks
    ('clockwise, series 2 lacks the step 6 N·m: the step is left out',)
    """
    if data.nominal_nm is None:
        data = replace(data, nominal_nm=_clusters(data.standard_nm, data.range_nm))
    assert data.nominal_nm is not None
    loaded = ~data.unloaded
    direction = data.loading_direction()
    kept = np.ones(len(data), dtype=np.bool_)
    remarks: list[str] = []
    for sign, name in _NAMES.items():
        here = loaded & (direction == sign)
        for step, reason in _lacking(data, here):
            kept &= ~(here & (np.abs(data.nominal_nm) == step))
            remarks.append(Message("{name}, {reason}: the step is left out", name, reason))
        if (repeated := _repeated(data, here & kept)).size:
            kept &= ~(here & np.isin(np.abs(data.nominal_nm), repeated))
            remarks.append(_left_out(name, repeated))
        if np.any(here) and np.unique(data.nominal_nm[here & kept]).size < 2:
            kept &= ~here
            remarks.append(
                Message("{name}, fewer than two steps that every series has: not evaluated", name)
            )
    left = np.any(kept & loaded)
    return EvaluablePoints(data.subset(kept) if left else None, False, tuple(remarks))


def _clusters(standard_nm: NDArray[np.float64], range_nm: float) -> NDArray[np.float64]:
    size = np.abs(standard_nm)
    order = np.argsort(size, kind="stable")
    rising = size[order]
    limit = np.maximum(STEP_TOLERANCE_PERCENT / 100.0 * rising[1:], UNLOADED_SHARE / 2.0 * range_nm)
    number = np.concatenate(([0], np.cumsum(np.diff(rising) > limit)))
    mean = np.bincount(number, rising) / np.bincount(number)
    mean[mean <= UNLOADED_SHARE * range_nm] = 0.0
    nominal = np.empty_like(size)
    nominal[order] = np.array([_plain(float(value)) for value in mean])[number]
    return np.where(standard_nm < 0, 0.0 - nominal, nominal)


def _plain(value: float) -> float:
    """Return the number with the fewest digits within 0.1 % of a step, as its name."""
    near = (float(f"{value:.{digits}g}") for digits in range(1, 8))
    return next((each for each in near if abs(each - value) <= 1e-3 * abs(value)), value)


def _repeated(data: CalibrationData, here: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the steps of a direction that a series has more than once on one branch."""
    assert data.nominal_nm is not None
    loaded = np.stack([np.abs(data.nominal_nm[here]), data.series[here], data.branch[here]])
    values, counts = np.unique(loaded, axis=1, return_counts=True)
    return np.unique(values[0, counts > 1])


def _left_out(name: str, steps: NDArray[np.float64]) -> Message:
    more = Message(" and {count} more", steps.size - 4) if steps.size > 4 else ""
    return Message(
        "{name}, more than once on one branch of a series, or too close to another step: "
        "{steps} N·m{more}; left out",
        name,
        ", ".join(f"{step:g}" for step in steps[:4]),
        more,
    )


def _lacking(data: CalibrationData, here: NDArray[np.bool_]) -> Iterator[tuple[float, str]]:
    """Yield steps of a direction that a series lacks, each with the first incomplete series."""
    assert data.nominal_nm is not None
    size = np.abs(data.nominal_nm)
    steps = np.unique(size[here])
    for step in steps:
        for number in np.unique(data.series[here]):
            for branch, word in ((1, ""), (-1, " with decreasing torque")):
                points = here & (data.series == number) & (data.branch == branch)
                turn = branch == -1 and step == steps[-1]  # read once for both branches
                if branch == -1 and (turn or not np.any(points)):
                    continue
                if not np.any(points & (size == step)):
                    yield (
                        float(step),
                        Message(
                            "series {number} lacks the step {step:g} N·m{word}", number, step, word
                        ),
                    )
                    break
            else:
                continue
            break
