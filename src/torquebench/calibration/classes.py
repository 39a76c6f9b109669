"""Accuracy classes: limits in % of reading, and the range over which a calibration meets them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torquebench.calibration.evaluation import Reproducibility, StaticEvaluation
from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["CLASSES", "ClassLimits", "Classification", "classify", "limits_of_class"]

CLASSES = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)


@dataclass(frozen=True)
class ClassLimits:
    """Limits of one class, in %.

    Parameters
    ----------
    reproducibility, repeatability, interpolation, indication, reversibility : float
        Limits of b, b′, |f_a|, |f_q| and h, of reading.
    zero_residual : float
        Limit of f₀, of the span.
    resolution : float
        Limit of r/X̄: the range starts at M_A ≥ (200/class)·r.
    reference : float
        Limit of the expanded uncertainty of the reference torque.
    """

    reproducibility: float
    repeatability: float
    interpolation: float
    indication: float
    zero_residual: float
    reversibility: float
    resolution: float
    reference: float


@dataclass(frozen=True, eq=False)
class Classification:
    """Range over which a calibration meets each class.

    Parameters
    ----------
    starts_nm : dict of float to float or None
        By class: the smallest step from which on every step up to the largest meets every limit;
        None where not even the largest does.
    whole_range : float or None
        Best class over all steps.
    """

    starts_nm: dict[float, float | None]
    whole_range: float | None


def limits_of_class(accuracy_class: float) -> ClassLimits:
    """Return the limits of a class.

    Raises
    ------
    InputError
        Where there is no such class.

    Examples
    --------
    >>> limits = limits_of_class(0.05)
    >>> limits.repeatability, limits.zero_residual, limits.reversibility
    (0.025, 0.0125, 0.063)
    """
    if accuracy_class not in CLASSES:
        raise InputError(
            Message("class {accuracy_class}", accuracy_class), ", ".join(map(str, CLASSES))
        )
    c = accuracy_class
    rounded_up = {0.05: 0.063, 0.5: 0.63}
    return ClassLimits(
        reproducibility=c,
        repeatability=c / 2,
        interpolation=c / 2,
        indication=c / 2,
        zero_residual=c / 4,
        reversibility=rounded_up.get(c, 1.25 * c),
        resolution=c / 2,
        reference=c / 5,
    )


def classify(
    evaluation: StaticEvaluation,
    *,
    degree: int,
    decreasing: bool,
    form: Reproducibility = "range",
    fixed_scale: bool = False,
) -> Classification:
    """Find the class of a calibration and the range over which each class is met.

    Parameters
    ----------
    evaluation : StaticEvaluation
        The calibration's quantities.
    degree : int
        Degree of the interpolation.
    decreasing : bool
        Whether decreasing torque counts.
    form : {"range", "standard-deviation"}
        Form of the reproducibility.
    fixed_scale : bool, default False
        Whether the indication is read with a fixed scale, so that f_q counts instead of f_a.

    Raises
    ------
    InputError
        Where a quantity that a class needs wasn't measured: a class is never given on part of it.
    """
    starts: dict[float, float | None] = {}
    for accuracy_class in CLASSES:
        meets = _meets(evaluation, accuracy_class, degree, decreasing, form, fixed_scale)
        failing = np.flatnonzero(~meets)
        first = 0 if failing.size == 0 else int(failing[-1]) + 1
        starts[accuracy_class] = float(evaluation.torque_nm[first]) if first < meets.size else None
    smallest = float(evaluation.torque_nm[0])
    whole = [accuracy_class for accuracy_class, start in starts.items() if start == smallest]
    return Classification(starts_nm=starts, whole_range=min(whole, default=None))


def _meets(
    evaluation: StaticEvaluation,
    accuracy_class: float,
    degree: int,
    decreasing: bool,
    form: Reproducibility,
    fixed_scale: bool,
) -> NDArray[np.bool_]:
    limits = limits_of_class(accuracy_class)
    quantities = {
        "a repeated series (b′)": (evaluation.repeatability_percent, limits.repeatability),
        "a second position (b)": (
            evaluation.reproducibility_percent(form),
            limits.reproducibility,
        ),
        "a zero after a series (f₀)": (evaluation.zero_residual_percent, limits.zero_residual),
        "the resolution": (evaluation.resolution_percent, limits.resolution),
        "the reference's uncertainty": (
            evaluation.reference_uncertainty_percent,
            limits.reference,
        ),
    }
    if fixed_scale:
        quantities["a fixed scale (f_q)"] = (
            evaluation.indication_deviation_percent,
            limits.indication,
        )
    else:
        deviation = evaluation.interpolation(degree).deviation_percent
        quantities["an interpolation"] = (deviation, limits.interpolation)
    if decreasing:
        quantities["a decreasing series (h)"] = (
            evaluation.reversibility_percent,
            limits.reversibility,
        )
    meets = np.ones(evaluation.torque_nm.shape, dtype=np.bool_)
    for name, (values, limit) in quantities.items():
        if values is None:
            raise InputError(
                Message("a calibration without {name}", name),
                "every quantity that the class limits",
                "measure it, or state the uncertainty without a class",
            )
        meets &= np.abs(values) <= limit
    return meets
