"""A calibration's results before and after compensation, side by side."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from torquebench.calibration.classes import Classification, classify
from torquebench.calibration.data import CalibrationData
from torquebench.calibration.evaluation import StaticEvaluation, evaluate_static
from torquebench.calibration.series import ZeroHysteresis, loading_series, zero_hysteresis
from torquebench.calibration.verification import ErrorSummary, summarise_errors
from torquebench.errors import InputError
from torquebench.uncertainty import CertifiedUncertainty

__all__ = ["CalibrationResults", "DirectionResults", "SideBySide", "calibration_results"]


@dataclass(frozen=True, eq=False)
class SideBySide:
    """One evaluation with its class.

    Parameters
    ----------
    evaluation : StaticEvaluation
        All quantities, with the fixed scale of 1 N·m per N·m.
    classification : Classification or None
        By |f_q| against the fixed scale; None where a quantity that a class needs wasn't measured.
    unclassified : str
        The reason, if there is no class.
    """

    evaluation: StaticEvaluation
    classification: Classification | None
    unclassified: str = ""


@dataclass(frozen=True, eq=False)
class DirectionResults:
    """Results of one direction.

    Parameters
    ----------
    direction : int
        +1 clockwise, -1 counter-clockwise.
    before, after : SideBySide
        Of the reading, and of the compensated torque; `after` is None without a compensation.
    """

    direction: int
    before: SideBySide
    after: SideBySide | None

    @property
    def name(self) -> str:
        """The direction in words."""
        return "clockwise" if self.direction > 0 else "counter-clockwise"


@dataclass(frozen=True, eq=False)
class CalibrationResults:
    """Results of a calibration's points for a certificate.

    Parameters
    ----------
    directions : tuple of DirectionResults
        Clockwise first.
    errors_before, errors_after : ErrorSummary
        Of all points against the standard; `errors_after` is None without a compensation.
    zero_before, zero_after : ZeroHysteresis or None
        Only of cycles that go through zero.
    """

    directions: tuple[DirectionResults, ...]
    errors_before: ErrorSummary
    errors_after: ErrorSummary | None
    zero_before: ZeroHysteresis | None
    zero_after: ZeroHysteresis | None


def calibration_results(
    data: CalibrationData,
    *,
    resolution_nm: float,
    reference: CertifiedUncertainty,
    torque_nm: ArrayLike | None = None,
    degree: int = 3,
) -> CalibrationResults:
    """Evaluate a calibration before and after compensation.

    Steps that are off are evaluated too, normalised to their nominal torque; `find_deviations`
    names them.

    Parameters
    ----------
    data : CalibrationData
        In steps, with nominal torques.
    resolution_nm : float
        Resolution of the indication, in N·m.
    reference : CertifiedUncertainty
        Expanded uncertainty (k = 2) of the reference torque.
    torque_nm : array of float, shape (n,), optional
        Compensated torque at every point.
    degree : int, default 3
        Degree of the interpolation; lower with too few steps.

    Raises
    ------
    InputError
        Where there are no nominal torques or a series lacks a step.

    Examples
    --------
    >>> data = CalibrationData(
    ...     [5.01, 10.02], [5.0, 10.0], [1, 1], [1, 1], 10.0, nominal_nm=[5.0, 10.0]
    ... )
    >>> reference = CertifiedUncertainty.of_torque(2e-4)
    >>> found = calibration_results(
    ...     data, resolution_nm=0.001, reference=reference, torque_nm=[5.0, 10.0]
    ... )
    >>> (clockwise,) = found.directions
    >>> [round(float(side.evaluation.indication_deviation_percent[1]), 6)
    ...  for side in (clockwise.before, clockwise.after)]
    [0.2, 0.0]
    """
    compensated = None
    if torque_nm is not None:
        torque = np.asarray(torque_nm, dtype=np.float64)
        compensated = replace(data, reading_nm=torque)
    here = data.loading_direction()
    directions = []
    for sign in (1, -1):
        if not np.any(here[data.direction != 0] == sign):
            continue
        sides = [
            None if points is None else _side(points, sign, resolution_nm, reference, degree)
            for points in (data, compensated)
        ]
        before, after = sides
        assert before is not None
        directions.append(DirectionResults(sign, before, after))
    return CalibrationResults(
        directions=tuple(directions),
        errors_before=_errors(data),
        errors_after=None if compensated is None else _errors(compensated),
        zero_before=_zero(data),
        zero_after=None if compensated is None else _zero(compensated),
    )


def _side(
    data: CalibrationData,
    sign: int,
    resolution_nm: float,
    reference: CertifiedUncertainty,
    degree: int,
) -> SideBySide:
    torque, series = loading_series(data, sign, tolerance_percent=None)
    evaluation = evaluate_static(
        torque,
        series,
        resolution=resolution_nm,
        reference_uncertainty_percent=100.0 * reference.at(sign * torque) / torque,
        scale=1.0,
    )
    decreasing = evaluation.reversibility_percent is not None
    possible = min(degree, max(evaluation.interpolations))
    try:
        found = classify(evaluation, degree=possible, decreasing=decreasing, fixed_scale=True)
    except InputError as error:
        return SideBySide(evaluation, None, error.found)
    return SideBySide(evaluation, found)


def _errors(data: CalibrationData) -> ErrorSummary:
    return summarise_errors(data.reading_nm, data.standard_nm, data.range_nm)


def _zero(data: CalibrationData) -> ZeroHysteresis | None:
    try:
        return zero_hysteresis(data)
    except InputError:  # no cycles through zero
        return None
