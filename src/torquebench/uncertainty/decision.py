"""Decision rules: whether a value conforms to its tolerance, given its uncertainty."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from math import isfinite
from typing import Literal

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.uncertainty.budget import coverage_factor


class Verdict(StrEnum):
    """Non-binary statement of conformity with a guard band (ILAC-G8:09/2019, 4.2.3).

    The members are in order of severity. The values are the digital calibration certificate's
    conformity values; ``NONE`` means that there is no limit.
    """

    NONE = ""
    PASS = "pass"
    CONDITIONAL_PASS = "conditionalPass"
    CONDITIONAL_FAIL = "conditionalFail"
    FAIL = "fail"

    @property
    def label(self) -> str:
        """The verdict in words."""
        return self.value.replace("conditional", "conditional ").lower()

    @property
    def failed(self) -> bool:
        """Whether the value is outside its tolerance, conditionally or certainly."""
        return self in (Verdict.CONDITIONAL_FAIL, Verdict.FAIL)

    @property
    def severity(self) -> int:
        """Position in the order of severity; 0 if there is no limit."""
        return list(Verdict).index(self)

    @classmethod
    def worst(cls, verdicts: Iterable[str]) -> Verdict:
        """Return the most severe verdict; ``NONE`` if there is none.

        Examples
        --------
        >>> Verdict.worst(["pass", "", "conditionalPass"]).label
        'conditional pass'
        """
        return max(map(cls, verdicts), key=lambda each: each.severity, default=cls.NONE)


@dataclass(frozen=True)
class Tolerance:
    """Tolerance interval, always stored together with what it refers to.

    Parameters
    ----------
    lower, upper : float or None
        Limits of the error; None if one side is open. In the unit of the value if `reference` is
        "absolute", else in % of the reference.
    reference : {"absolute", "full scale", "reading"}
        Reference of the limits.

    Examples
    --------
    >>> Tolerance(-0.1, 0.1, "full scale").limits(reading=500.0, full_scale=2000.0)
    (-2.0, 2.0)
    """

    lower: float | None
    upper: float | None
    reference: Literal["absolute", "full scale", "reading"] = "absolute"

    def __post_init__(self) -> None:
        limits = [limit for limit in (self.lower, self.upper) if limit is not None]
        if not limits or not all(isfinite(limit) for limit in limits):
            raise InputError(
                Message("tolerance {lower} to {upper}", self.lower, self.upper),
                "one or two finite limits",
            )
        if len(limits) == 2 and limits[0] >= limits[1]:
            raise InputError(
                Message("tolerance {lower} to {upper}", self.lower, self.upper),
                "a lower limit below the upper one",
            )

    def limits(
        self, reading: float | None = None, full_scale: float | None = None
    ) -> tuple[float | None, float | None]:
        """Return the limits in the unit of the value.

        Raises
        ------
        InputError
            The reference that the tolerance needs isn't given.
        """
        if self.reference == "absolute":
            return self.lower, self.upper
        base = reading if self.reference == "reading" else full_scale
        if base is None or not isfinite(base):
            raise InputError(
                Message(
                    "a tolerance in % of {reference} with no {reference} given", self.reference
                ),
                Message("the {reference} in the value's unit", self.reference),
            )
        scale = abs(base) / 100.0
        return (
            None if self.lower is None else self.lower * scale,
            None if self.upper is None else self.upper * scale,
        )


@dataclass(frozen=True)
class Decision:
    """A verdict, with the values on which it is based.

    Attributes
    ----------
    verdict : Verdict
        The verdict.
    value, expanded_uncertainty : float
        The value and its uncertainty.
    lower, upper : float or None
        Tolerance limits in the value's unit.
    guard_band : float
        Width w of the guard band.
    conformance_probability : float
        Probability that the true value lies within the tolerance.
    """

    verdict: Verdict
    value: float
    expanded_uncertainty: float
    lower: float | None
    upper: float | None
    guard_band: float
    conformance_probability: float

    def rule(self) -> str:
        """Decision rule in words, as a certificate has to state it."""
        return (
            "non-binary statement with guard band w = U (expanded uncertainty): pass within the "
            "tolerance reduced by w, conditional pass within the tolerance, conditional fail "
            "outside by no more than w, fail beyond"
        )


def conformance_probability(
    value: float,
    standard_uncertainty: float,
    lower: float | None,
    upper: float | None,
    degrees_of_freedom: float = float("inf"),
) -> float:
    """Return the probability that the true value lies within the tolerance (JCGM 106:2012, 7.2).

    Examples
    --------
    >>> round(conformance_probability(0.0, 1.0, -2.0, 2.0), 4)
    0.9545
    >>> conformance_probability(3.0, 0.0, None, 2.0)
    0.0
    """
    if standard_uncertainty == 0.0:
        inside = (lower is None or value >= lower) and (upper is None or value <= upper)
        return 1.0 if inside else 0.0

    from scipy import special  # imported late: a server at rest doesn't need SciPy

    def below(limit: float) -> float:
        """Return the probability that the true value is below a limit."""
        scaled = (limit - value) / standard_uncertainty
        if isfinite(degrees_of_freedom):
            return float(special.stdtr(degrees_of_freedom, scaled))
        return float(special.ndtr(scaled))

    return (1.0 if upper is None else below(upper)) - (0.0 if lower is None else below(lower))


def decide(
    value: float,
    expanded_uncertainty: float,
    tolerance: Tolerance,
    *,
    reading: float | None = None,
    full_scale: float | None = None,
    degrees_of_freedom: float = float("inf"),
) -> Decision:
    """Compare a value with its tolerance, with the guard band w = U.

    Parameters
    ----------
    value : float
        Value to be compared, usually an error.
    expanded_uncertainty : float
        U at `COVERAGE_PROBABILITY`, in the value's unit.
    tolerance : Tolerance
        Tolerance with its reference.
    reading, full_scale : float, optional
        Reference of the tolerance, in the value's unit.
    degrees_of_freedom : float
        Expansion of U, for the conformance probability.

    Returns
    -------
    Decision
        Verdict, guard band and conformance probability.

    Raises
    ------
    InputError
        When a number is not finite, U is negative, or the tolerance's reference is missing.

    Examples
    --------
    >>> [
    ...     decide(error, 0.3, Tolerance(-1.0, 1.0)).verdict.label
    ...     for error in (0.7, 0.8, 1.2, -1.4)
    ... ]
    ['pass', 'conditional pass', 'conditional fail', 'fail']
    """
    if not isfinite(value) or not isfinite(expanded_uncertainty) or expanded_uncertainty < 0:
        raise InputError(
            Message(
                "value {value} with expanded uncertainty {expanded_uncertainty}",
                value,
                expanded_uncertainty,
            ),
            "finite numbers, the uncertainty not negative",
        )
    lower, upper = tolerance.limits(reading, full_scale)
    # distance beyond the nearest limit, negative inside
    beyond = max(
        value - upper if upper is not None else -float("inf"),
        lower - value if lower is not None else -float("inf"),
    )
    if beyond <= -expanded_uncertainty:
        verdict = Verdict.PASS
    elif beyond <= 0.0:
        verdict = Verdict.CONDITIONAL_PASS
    elif beyond <= expanded_uncertainty:
        verdict = Verdict.CONDITIONAL_FAIL
    else:
        verdict = Verdict.FAIL
    standard = expanded_uncertainty / float(coverage_factor(degrees_of_freedom))
    probability = conformance_probability(value, standard, lower, upper, degrees_of_freedom)
    return Decision(
        verdict, value, expanded_uncertainty, lower, upper, expanded_uncertainty, probability
    )
