"""Uncertainty due to the limited sampling of a reducer test.

A short test has fewer output positions and a cold reducer. Its repeats can't show how values vary
over the turn, or how friction falls while the reducer warms up. Both enter every budget with stated
limits, so that less sampling never gives a smaller U.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from math import sqrt
from typing import TYPE_CHECKING

from torquebench.message import Message
from torquebench.reducers import Finding, ReducerResult, budget
from torquebench.uncertainty import Budget, BudgetLine

if TYPE_CHECKING:
    from torquebench.reducers import DataSheetLimits, LimitedQuantity, ResultQuantity

LEAST_POSITIONS = 3
"""Number of output positions from which on their own scatter shows the variation over the turn."""
POSITION_SHARE = 0.03
"""Standard deviation of a value from one output position to the next, as a share of it. It is an
assumption: the simulated reducers show 0.3 to 1 %, and worn gears vary more.
"""
WARMING_SHARE = 0.3
"""Limit by which friction may fall while a reducer warms up, as a share of it: 10 to 15 K with a
lubricant whose viscosity falls by 2 to 3 % per kelvin.
"""


@dataclass(frozen=True)
class Unsampled:
    """An influence that a test didn't sample.

    Parameters
    ----------
    name : str
        Name of its contribution to the budgets.
    remark : str
        Sentence about the omission and the assumed value.
    standard_uncertainty : callable
        Returns the standard uncertainty for a value, in the value's unit.
    """

    name: str
    remark: str
    standard_uncertainty: Callable[[float], float]


def few_positions(positions: int) -> tuple[Unsampled, ...]:
    """Return the influence of too few output positions; none with `LEAST_POSITIONS` or more.

    Examples
    --------
    >>> [round(each.standard_uncertainty(100.0), 2) for each in few_positions(1)]
    [3.0]
    >>> few_positions(5)
    ()
    """
    if positions >= LEAST_POSITIONS:
        return ()
    share = POSITION_SHARE / sqrt(positions)
    remark = Message(
        "output positions: {positions}, too few to show how values differ over a "
        "turn; {position_percent:.0f} % of the value from position to position "
        "counts in U",
        positions,
        100.0 * POSITION_SHARE,
    )
    return (Unsampled("positions not sampled", remark, lambda value: share * abs(value)),)


_COLD = Message(
    "the reducer wasn't warmed up: U contains a possible decrease of its "
    "friction by {warming_percent:.0f} %",
    100.0 * WARMING_SHARE,
)


def cold_friction(warm_up_s: float) -> tuple[Unsampled, ...]:
    """Return the influence of a missing warm-up on a friction torque, which may still fall."""
    if warm_up_s > 0.0:
        return ()
    share = WARMING_SHARE / sqrt(3.0)
    return (Unsampled("not warmed up", _COLD, lambda value: share * abs(value)),)


def cold_efficiency(warm_up_s: float) -> tuple[Unsampled, ...]:
    """Return the influence of a missing warm-up on an efficiency in %, which may still rise.

    With the lost share 1 − η, dη = η·(1 − η)·d(loss)/loss.
    """
    if warm_up_s > 0.0:
        return ()
    share = WARMING_SHARE / sqrt(3.0)

    def rise(percent: float) -> float:
        """Return the standard uncertainty of an efficiency that warming would still raise, %."""
        return share * abs(percent * (1.0 - percent / 100.0))

    return (Unsampled("not warmed up", _COLD, rise),)


@dataclass(frozen=True)
class PartlySampled:
    """A result whose budgets include the reduced sampling."""

    result: ReducerResult
    unsampled: tuple[Unsampled, ...]

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Remarks about the data."""
        return self.result.findings

    def quantities(self) -> tuple[ResultQuantity, ...]:
        """Return the values under their names, for tables and reports."""
        return tuple(
            replace(quantity, estimate=self._widened(quantity.estimate))
            for quantity in self.result.quantities()
        )

    def limited(self, limits: DataSheetLimits) -> Iterator[LimitedQuantity]:
        """Return the values that the data sheet limits."""
        for limited_quantity in self.result.limited(limits):
            yield replace(limited_quantity, estimate=self._widened(limited_quantity.estimate))

    def _widened(self, estimate: Budget) -> Budget:
        """Return an estimate with the influences that weren't sampled in its budget."""
        if not self.unsampled:
            return estimate
        sampled = [line.times(1.0) for line in estimate.lines]
        added = [
            BudgetLine(influence.name, influence.standard_uncertainty(estimate.value))
            for influence in self.unsampled
        ]
        return budget(estimate.value, estimate.unit, [*sampled, *added])
