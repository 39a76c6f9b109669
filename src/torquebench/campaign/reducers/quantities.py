"""Quantities of a reducer test with limits and verdicts: plain values for tables and reports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from torquebench.uncertainty import Verdict

if TYPE_CHECKING:
    from torquebench.reducers import FrictionResult, QuantityVerdict, ReducerResult


@dataclass(frozen=True)
class ReducerTestQuantity:
    """One result of a reducer test with uncertainty, limit and verdict.

    Attributes
    ----------
    key : str
        Name for programs, unique within its test, such as ``"backlash"``.
    title : str
        Name for people.
    value, expanded_uncertainty, coverage_factor : float
        Estimate and its expanded uncertainty (95.45 % coverage), in `unit`.
    unit : str
        Unit of value, uncertainty and limit.
    limit : str
        The data sheet's limit, in words with its unit; empty without a limit.
    verdict : str
        Guard-banded verdict against that limit; empty without one.
    rule : str
        The definition used, if makers differ.
    """

    key: str
    title: str
    value: float
    expanded_uncertainty: float
    coverage_factor: float
    unit: str
    limit: str = ""
    verdict: Verdict = Verdict.NONE
    rule: str = ""


def result_quantities(
    result: ReducerResult | FrictionResult,
    judged: Sequence[QuantityVerdict],
    *,
    conditional: bool = False,
) -> tuple[ReducerTestQuantity, ...]:
    """Return the quantities of a result with limits and verdicts.

    Parameters
    ----------
    judged : sequence of QuantityVerdict
        Quantities with a limit in the data sheet.
    conditional : bool
        Whether a pass is only conditional, as after a short test.
    """
    limits = {each.key: each for each in judged}
    quantities = [
        (quantity.key, quantity.title, quantity.estimate, quantity.rule)
        for quantity in result.quantities()
    ]
    # A limit between measured points, for example of an efficiency, has no entry in the quantities.
    keys = {key for key, _, _, _ in quantities}
    quantities += [
        (each.key, each.title, each.estimate, "interpolated")
        for each in judged
        if each.key not in keys
    ]
    rows = []
    for key, title, estimate, rule in quantities:
        held = limits.get(key)
        verdict = Verdict.NONE if held is None else held.decision.verdict
        if conditional and verdict is Verdict.PASS:
            verdict = Verdict.CONDITIONAL_PASS
        rows.append(
            ReducerTestQuantity(
                key=key,
                title=title,
                value=estimate.value,
                expanded_uncertainty=estimate.expanded_uncertainty(),
                coverage_factor=estimate.coverage_factor(),
                unit=estimate.unit,
                limit="" if held is None else held.limit,
                verdict=verdict,
                rule=rule,
            )
        )
    return tuple(rows)
