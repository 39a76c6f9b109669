"""Verdicts on results against a data sheet, with guard bands."""

from dataclasses import dataclass
from math import inf, isfinite, nan

from torquebench.reducers.description import ReducerDescription
from torquebench.reducers.quantities import LimitedQuantity, ReducerResult
from torquebench.uncertainty import Budget, Decision, Tolerance, Verdict, decide


@dataclass(frozen=True)
class QuantityVerdict:
    """One value of a result compared with its limit.

    Parameters
    ----------
    key : str
        Key of the quantity, as in ``result.quantities()``.
    limit : str
        Limit as text with its unit, such as ``"≤ 1 arcmin"``.
    decision : Decision
        Verdict (pass, conditional pass, conditional fail, fail) with guard band w = U.
    """

    key: str
    title: str
    estimate: Budget
    limit: str
    decision: Decision


def verdicts(result: ReducerResult, description: ReducerDescription) -> tuple[QuantityVerdict, ...]:
    """Compare every value that the data sheet limits with its limit.

    Returns
    -------
    tuple of QuantityVerdict
        Empty if the data sheet has no limit for the result. A limit at a speed or torque that
        wasn't measured (no-load speed, efficiency point) gives no verdict.
    """
    return tuple(
        _verdict(quantity)
        for quantity in result.limited(description.limits)
        if quantity.lower is not None or quantity.upper is not None
    )


def _verdict(limited: LimitedQuantity) -> QuantityVerdict:
    """Judge a quantity by its limits, with its uncertainty."""
    estimate, lower, upper = limited.estimate, limited.lower, limited.upper
    words = [
        f"{sign} {limit:g} {estimate.unit}"
        for sign, limit in (("≥", lower), ("≤", upper))
        if limit is not None
    ]
    if isfinite(estimate.standard_uncertainty):
        decision = decide(
            estimate.value,
            estimate.expanded_uncertainty(),
            Tolerance(lower, upper),
            degrees_of_freedom=estimate.degrees_of_freedom,
        )
    else:  # nothing is certain with an unknown uncertainty
        inside = (lower is None or estimate.value >= lower) and (
            upper is None or estimate.value <= upper
        )
        verdict = Verdict.CONDITIONAL_PASS if inside else Verdict.CONDITIONAL_FAIL
        decision = Decision(verdict, estimate.value, inf, lower, upper, inf, nan)
    return QuantityVerdict(limited.key, limited.title, estimate, ", ".join(words), decision)
