"""A calibration's results before and after compensation, side by side."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.calibration.data import CalibrationData
from torquebench.calibration.evaluation import (
    Classification,
    Interpolation,
    Regression,
    StaticEvaluation,
    classify,
    evaluate_static,
    regression,
)
from torquebench.calibration.series import (
    DIRECTIONS,
    Loading,
    ZeroHysteresis,
    loading_series,
    own_steps,
    tare,
    zero_hysteresis,
)
from torquebench.calibration.verification import ErrorSummary, summarise_errors
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.uncertainty import CertifiedUncertainty

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SideBySide:
    """One evaluation with its class.

    Parameters
    ----------
    evaluation : StaticEvaluation
        All quantities, with the fixed scale of 1 N·m per N·m.
    interpolation : Interpolation
        Curve that f_a and W refer to.
    expanded_percent, interval_percent : array of float, shape (m,)
        W (k = 2) and W′ = |f_q| + W at each step, %; with decreasing torque, where measured.
    classification : Classification or None
        By |f_q| against the fixed scale; None where a quantity that a class needs wasn't measured.
    unclassified : str
        The reason, if there is no class.
    """

    evaluation: StaticEvaluation
    interpolation: Interpolation
    expanded_percent: FloatArray
    interval_percent: FloatArray
    classification: Classification | None
    unclassified: str = ""

    @property
    def columns(self) -> dict[str, FloatArray | None]:
        """Quantities in % of reading at each step by their symbols; None where not measured."""
        e = self.evaluation
        return {
            "f_q": e.indication_deviation_percent,
            "b′": e.repeatability_percent,
            "b": e.reproducibility_range_percent,
            "f_a": self.interpolation.deviation_percent,
            "h": e.reversibility_percent,
            "r": e.resolution_percent,
            "W": self.expanded_percent,
        }

    @property
    def class_words(self) -> str:
        """The class in words, or the reason why there is none."""
        if self.classification is None:
            return Message("no class: {reason}", self.unclassified)
        return str(self.classification)


@dataclass(frozen=True, eq=False)
class DirectionResults:
    """Results of one direction.

    Parameters
    ----------
    direction : int
        +1 clockwise, -1 counter-clockwise.
    before, after : SideBySide
        Results of the reading, and of the compensated torque; `after` is None without a
        compensation.
    """

    direction: int
    before: SideBySide
    after: SideBySide | None

    @property
    def name(self) -> str:
        """The direction in words."""
        return DIRECTIONS[self.direction]


@dataclass(frozen=True, eq=False)
class CalibrationResults:
    """Results of a calibration's points.

    Parameters
    ----------
    data : CalibrationData
        The evaluated points: with the steps as nominal torques, the zero of each series subtracted.
    torque_nm : array of float, shape (n,), or None
        Compensated torque of these points, less its zero.
    directions : tuple of DirectionResults
        Clockwise first; without those that weren't loaded in steps.
    errors_before, errors_after : ErrorSummary
        Errors of all points against the standard; `errors_after` is None without a compensation.
    regression : mapping of str to Regression
        Straight line of the deflections over the standard, for all points and for each direction.
    zero_before, zero_after : ZeroHysteresis or None
        Zero hysteresis; only for cycles that go through zero.
    remarks : tuple of str
        Remarks on subtracted zeros, and on points that were left out or deviate from their step by
        more than 0.5 %.
    """

    data: CalibrationData
    torque_nm: FloatArray | None
    directions: tuple[DirectionResults, ...]
    errors_before: ErrorSummary
    errors_after: ErrorSummary | None
    regression: Mapping[str, Regression]
    zero_before: ZeroHysteresis | None
    zero_after: ZeroHysteresis | None
    remarks: tuple[str, ...]


def calibration_results(
    data: CalibrationData,
    *,
    resolution_nm: float,
    reference: CertifiedUncertainty,
    torque_nm: ArrayLike | None = None,
    degree: int = 3,
) -> CalibrationResults:
    """Evaluate a calibration before and after compensation.

    All rows are used: series, positions and steps of any number are pooled and normalised to the
    nearest step. `find_deviations` reports missing or deviating steps of the profile.

    Parameters
    ----------
    data : CalibrationData
        Points in measuring order; without nominal torques, steps are derived from the standard's
        values.
    resolution_nm : float
        Resolution of the indication, in N·m.
    reference : CertifiedUncertainty
        Expanded uncertainty (k = 2) of the reference torque.
    torque_nm : array of float, shape (n,), optional
        Compensated torque at every point.
    degree : int, default 3
        Degree of the interpolation; lower with too few steps.

    Examples
    --------
    >>> data = CalibrationData([5.01, 10.02], [5.0, 10.0], [1, 1], [1, 1], 10.0)
    >>> reference = CertifiedUncertainty.of_torque(2e-4)
    >>> results = calibration_results(
    ...     data, resolution_nm=0.001, reference=reference, torque_nm=[5.0, 10.0]
    ... )
    >>> (clockwise,) = results.directions
    >>> [round(float(side.evaluation.indication_deviation_percent[1]), 6)
    ...  for side in (clockwise.before, clockwise.after)]
    [0.2, 0.0]
    """
    points = own_steps(data)
    tared = tare(points)
    compensated = None
    if torque_nm is not None:
        compensated = replace(points, reading_nm=np.asarray(torque_nm, dtype=np.float64))
    remarks = list(tared.remarks)
    directions = []
    for sign in DIRECTIONS:
        loading = loading_series(points, sign)
        if loading is None:
            continue
        remarks += loading.remarks
        if not loading.series:
            continue
        before = _side(loading, sign, resolution_nm, reference, degree)
        after = None if compensated is None else loading_series(compensated, sign)
        directions.append(
            DirectionResults(
                sign,
                before,
                None if after is None else _side(after, sign, resolution_nm, reference, degree),
            )
        )
    corrected = None if compensated is None else tare(compensated).data
    return CalibrationResults(
        data=tared.data,
        torque_nm=None if corrected is None else corrected.reading_nm,
        directions=tuple(directions),
        errors_before=_errors(tared.data),
        errors_after=None if corrected is None else _errors(corrected),
        regression=_regressions(tared.data),
        zero_before=zero_hysteresis(points),
        zero_after=None if compensated is None else zero_hysteresis(compensated),
        remarks=tuple(remarks),
    )


def _side(
    loading: Loading,
    sign: int,
    resolution_nm: float,
    reference: CertifiedUncertainty,
    degree: int,
) -> SideBySide:
    """Evaluate one direction of the loading beside its classification."""
    torque = loading.torque_nm
    evaluation = evaluate_static(
        torque,
        loading.series,
        resolution=resolution_nm,
        reference_uncertainty_percent=100.0 * reference.at(sign * torque) / torque,
        scale=1.0,
    )
    decreasing = evaluation.reversibility_percent is not None
    possible = min(degree, max(evaluation.interpolations))
    reason, classification = "", None
    try:
        classification = classify(
            evaluation, degree=possible, decreasing=decreasing, fixed_scale=True
        )
    except InputError as error:
        reason = error.found
    return SideBySide(
        evaluation,
        evaluation.interpolation(possible),
        evaluation.uncertainty_percent(possible, "range", decreasing=decreasing),
        evaluation.interval_percent(possible, "range", decreasing=decreasing),
        classification,
        reason,
    )


def _errors(data: CalibrationData) -> ErrorSummary:
    return summarise_errors(data.reading_nm, data.standard_nm, data.range_nm)


def _regressions(data: CalibrationData) -> dict[str, Regression]:
    """Return straight lines through all points and through those of each direction."""
    direction = data.loading_direction()
    parts = {"all points": np.ones(len(data), dtype=np.bool_)}
    if np.unique(direction).size > 1:
        parts |= {name: direction == sign for sign, name in DIRECTIONS.items()}
    lines = {
        name: regression(data.standard_nm[rows], data.reading_nm[rows])
        for name, rows in parts.items()
    }
    return {name: line for name, line in lines.items() if line is not None}
