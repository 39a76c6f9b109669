"""Common parts of all evaluations: values with budgets, and findings about the data."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.uncertainty import (
    Budget,
    BudgetLine,
    Shared,
)

if TYPE_CHECKING:
    from torquebench.reducers.description import DataSheetLimits

LARGEST_TEMPERATURE_RANGE_K = 2.0
"""Change of temperature during a test above which it is treated as unsteady."""


@dataclass(frozen=True)
class Finding:
    """A remark about the data that a reader of the result has to know.

    Parameters
    ----------
    name : str
        Short name for programs, such as ``"drive saturation"``.
    message : str
        The finding with its value and limit.
    remedy : str
        Remedy.
    severe : bool
        Whether the result shouldn't be used for a verdict.
    """

    name: str
    message: str
    remedy: str
    severe: bool = False

    @property
    def sentence(self) -> str:
        """Finding and remedy in one sentence, without the name."""
        return Message.joined((self.message, self.remedy), "; ")

    def __str__(self) -> str:
        return f"{self.name}: {self.sentence}"


@dataclass(frozen=True)
class ResultQuantity:
    """One value of a result with its name, in the same form for all tests, for tables and reports.

    Parameters
    ----------
    key : str
        Name for programs, unique within a result, such as ``"backlash"``.
    title : str
        Name for people.
    estimate : Budget
        Value, standard uncertainty, degrees of freedom and contributions, in `estimate.unit`.
    rule : str
        The definition that was used, where makers differ; else empty.
    """

    key: str
    title: str
    estimate: Budget
    rule: str = ""


@dataclass(frozen=True)
class LimitedQuantity:
    """A value of a result and the data sheet's limit.

    Parameters
    ----------
    lower, upper : float or None
        Limits in the estimate's unit; None without one.
    """

    key: str
    title: str
    estimate: Budget
    lower: float | None = None
    upper: float | None = None


class ReducerResult(Protocol):
    """Result of the evaluation of a reducer test."""

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Remarks about the data."""

    def quantities(self) -> tuple[ResultQuantity, ...]:
        """Return the values under their names, for tables and reports."""

    def limited(self, limits: DataSheetLimits) -> Iterable[LimitedQuantity]:
        """Return the values that the data sheet limits; those without a limit may be left out."""


def distinct_texts(values: Sequence[float]) -> list[str]:
    """Write numbers with signs and just enough decimals to tell them apart, for keys.

    Examples
    --------
    >>> distinct_texts([100.0, -100.0, 100.25]), distinct_texts([2.0, 2.0])
    (['+100.0', '-100.0', '+100.2'], ['+2', '+2'])
    """
    different = len(set(values))
    for places in range(17):
        texts = [f"{value:+.{places}f}" for value in values]
        if len(set(texts)) == different:
            return texts
    return [f"{value:+.17g}" for value in values]


NOTHING = 1e-12
"""Relative standard uncertainty that rounding alone may show."""


def budget(value: float, unit: str, lines: Iterable[BudgetLine]) -> Budget:
    """Combine independent lines into a budget; without any, U is unknown: infinite.

    Examples
    --------
    >>> found = budget(1.2, "arcmin", [BudgetLine("scale", 0.03), BudgetLine("noise", 0.04)])
    >>> round(found.standard_uncertainty, 6), found.unit
    (0.05, 'arcmin')
    """
    counted = [line for line in lines if line.standard_uncertainty > 0.0]
    stated = Budget.of(value, unit, counted)
    if not stated.standard_uncertainty > NOTHING * abs(value):
        return Budget(float(value), inf, inf, (), unit)
    return stated


def common_of_both(first: Budget, second: Budget) -> list[BudgetLine]:
    """Return the contributions to the mean of two values by the errors that both share.

    Errors of one source add with their signs: of equal sizes and opposite signs they cancel.

    Examples
    --------
    >>> scale = BudgetLine("scale", 0.2, shared=Shared.CALIBRATION)
    >>> zeros = [BudgetLine("zero", 0.3, sensitivity=s, shared=Shared.ZEROING) for s in (1, -1)]
    >>> forward, backward = (budget(5.0, "N·m", [scale, zero]) for zero in zeros)
    >>> [(each.name, each.standard_uncertainty) for each in common_of_both(forward, backward)]
    [('scale', 0.2), ('zero', 0.0)]
    """
    lines: dict[tuple[str, Shared], list[BudgetLine]] = {}
    for line in (*first.lines, *second.lines):
        if line.common:
            lines.setdefault((line.name, line.shared), []).append(line)
    return [together([(0.5, line) for line in pair]) for pair in lines.values()]


def together(weighted: Sequence[tuple[float, BudgetLine]]) -> BudgetLine:
    """Return the contribution of one error source to a weighted sum of results that share it."""
    signed = sum(weight * line.sensitivity * line.contribution for weight, line in weighted)
    freedom = min(line.degrees_of_freedom for _, line in weighted)
    line = weighted[0][1]
    return BudgetLine(line.name, abs(signed), freedom, float(np.sign(signed)) or 1.0, line.shared)


def unsteady_temperature(
    temperature_c: NDArray[np.float64], remedy: str, *, effect: str = "", severe: bool = False
) -> tuple[Finding, ...]:
    """Report a temperature that changed during a test; NaN where none was measured."""
    if np.all(np.isnan(temperature_c)) or np.ptp(temperature_c) <= LARGEST_TEMPERATURE_RANGE_K:
        return ()
    message = Message(
        "{lowest_c:.1f} to {highest_c:.1f} °C during the test (allowed: a range of "
        "{limit_k:g} K){effect}",
        temperature_c.min(),
        temperature_c.max(),
        LARGEST_TEMPERATURE_RANGE_K,
        effect,
    )
    return (Finding("unsteady temperature", message, remedy, severe),)


def refuse(estimate: Budget, share: float, what: str) -> None:
    """Refuse a value whose expanded uncertainty exceeds a stated share of it.

    Parameters
    ----------
    share : float
        Largest allowed U as a share of the value's magnitude.
    what : str
        Name of the value, for the message.

    Raises
    ------
    InputError

    Examples
    --------
    >>> refuse(budget(29.0, "mN·m", [BudgetLine("zero", 10.0)]), 0.3, "starting torque")
    Traceback (most recent call last):
    torquebench.errors.InputError: starting torque of 29 mN·m with U = 20 mN·m (69 %); ...
    """
    expanded = estimate.expanded_uncertainty()
    if not expanded <= share * abs(estimate.value):
        relative = 100.0 * expanded / abs(estimate.value) if estimate.value else inf
        raise InputError(
            Message(
                "{what} of {value:.4g} {unit} with U = {expanded:.3g} {unit} ({relative:.3g} %)",
                what,
                estimate.value,
                estimate.unit,
                expanded,
                relative,
            ),
            Message("an expanded uncertainty of at most {share:.3g} % of the value", 100.0 * share),
            "zero just before the test, repeat it more often, or use a smaller transducer",
        )
