"""Check of a GUM budget by Monte Carlo (JCGM 101:2008)."""

from dataclasses import dataclass
from math import ceil, floor, log10

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.uncertainty.budget import COVERAGE_PROBABILITY, Budget
from torquebench.uncertainty.distributions import sample


@dataclass(frozen=True)
class MonteCarloResult:
    """Result of a Monte Carlo propagation.

    Attributes
    ----------
    value, standard_uncertainty : float
        Mean and standard deviation of the drawn results.
    low, high : float
        Probabilistically symmetric coverage interval.
    coverage_probability : float
        Coverage probability of that interval.
    trials : int
        Number of draws.
    tolerance : float
        Numerical tolerance that the adaptive procedure had to reach.
    converged : bool
        Whether the tolerance was reached within the allowed number of trials.
    """

    value: float
    standard_uncertainty: float
    low: float
    high: float
    coverage_probability: float
    trials: int
    tolerance: float
    converged: bool


@dataclass(frozen=True)
class Validation:
    """Comparison of a GUM budget with Monte Carlo (JCGM 101:2008, clause 8.1).

    Attributes
    ----------
    agrees : bool
        True where both ends of the intervals differ by no more than the tolerance.
    low_difference, high_difference : float
        Absolute differences of the intervals' ends.
    tolerance : float
        Half a unit of the last significant digit of the standard uncertainty.
    budget : Budget
        The budget.
    monte_carlo : MonteCarloResult
        The Monte Carlo result.
    """

    agrees: bool
    low_difference: float
    high_difference: float
    tolerance: float
    budget: Budget
    monte_carlo: MonteCarloResult

    def sentence(self) -> str:
        """One sentence for a report: whether the two methods agree, and their difference."""
        unit = f" {self.budget.unit}" if self.budget.unit else ""
        return Message(
            "GUM and Monte Carlo ({trials} trials) agree: the ends of the {coverage:.4g} % "
            "interval differ by {low:.2g}{unit} and {high:.2g}{unit}, tolerance {tolerance:.2g}"
            "{unit}"
            if self.agrees
            else "GUM and Monte Carlo ({trials} trials) do not agree: the ends of the "
            "{coverage:.4g} % interval differ by {low:.2g}{unit} and {high:.2g}{unit}, tolerance "
            "{tolerance:.2g}{unit}",
            self.monte_carlo.trials,
            100 * self.monte_carlo.coverage_probability,
            self.low_difference,
            unit,
            self.high_difference,
            self.tolerance,
        )


def numerical_tolerance(standard_uncertainty: float, significant_digits: int = 2) -> float:
    """Return half a unit in the last significant digit of a standard uncertainty (JCGM 101, 7.9.2).

    Examples
    --------
    >>> numerical_tolerance(0.00035, 2)
    5e-06
    >>> numerical_tolerance(2.0, 1)
    0.5
    """
    if significant_digits < 1:
        raise InputError(
            Message("{significant_digits} significant digits", significant_digits), "1 or 2"
        )
    if standard_uncertainty <= 0.0:
        return 0.0
    mantissa_digits = significant_digits - 1
    exponent = floor(log10(standard_uncertainty))
    if round(standard_uncertainty / 10.0 ** (exponent - mantissa_digits)) >= 10**significant_digits:
        exponent += 1
    return float(f"0.5e{exponent - mantissa_digits}")


def coverage_interval(
    values: NDArray[np.float64], coverage_probability: float = COVERAGE_PROBABILITY
) -> tuple[float, float]:
    """Return the probabilistically symmetric interval of drawn results (JCGM 101:2008, 7.7).

    Examples
    --------
    >>> coverage_interval(np.arange(1.0, 101.0), 0.9)
    (5.0, 95.0)
    """
    ordered = np.sort(values)
    count = ordered.size
    inside = min(floor(coverage_probability * count + 0.5), count - 1)
    if inside < 1:
        raise InputError(Message("{count} draws", count), "at least 2 for a coverage interval")
    first = max(floor((count - inside) / 2 + 0.5) - 1, 0)
    return float(ordered[first]), float(ordered[first + inside])


def monte_carlo(
    budget: Budget,
    *,
    generator: np.random.Generator,
    coverage_probability: float = COVERAGE_PROBABILITY,
    tolerance: float,
    maximum_trials: int = 5_000_000,
) -> MonteCarloResult:
    """Propagate the distributions of a budget's lines until the result is numerically stable.

    Blocks of draws are added until twice the standard deviation of the blocks' means of value,
    standard uncertainty and both interval ends is below the tolerance (JCGM 101:2008, 7.9.4).

    Parameters
    ----------
    generator : numpy.random.Generator
        Source of the draws; the same state gives the same result.
    coverage_probability : float
        Coverage probability of the interval.
    tolerance : float
        Numerical tolerance in the result's unit.
    maximum_trials : int
        Largest number of trials; if the tolerance isn't reached by then, `converged` is False.

    Examples
    --------
    >>> from torquebench.uncertainty import BudgetLine
    >>> four = Budget.of(0.0, "", [BudgetLine.rectangular(f"x{i}", 3**0.5) for i in range(4)])
    >>> result = monte_carlo(
    ...     four, generator=np.random.default_rng(0), coverage_probability=0.95, tolerance=0.05
    ... )
    >>> round(result.standard_uncertainty, 1), round(result.high, 1)
    (2.0, 3.9)
    """
    block_size = max(ceil(100.0 / (1.0 - coverage_probability)), 10_000)
    blocks: list[NDArray[np.float64]] = []
    statistics: list[tuple[float, float, float, float]] = []
    converged = False
    while not converged and (len(blocks) + 1) * block_size <= max(maximum_trials, 2 * block_size):
        block = np.full(block_size, budget.value)
        for line in budget.lines:
            block += line.sensitivity * sample(
                line.distribution,
                0.0,
                line.standard_uncertainty,
                line.degrees_of_freedom,
                block_size,
                generator,
            )
        low, high = coverage_interval(block, coverage_probability)
        blocks.append(block)
        statistics.append((float(np.mean(block)), float(np.std(block, ddof=1)), low, high))
        if len(blocks) >= 2:
            scatter = np.std(np.array(statistics), axis=0, ddof=1) / np.sqrt(len(blocks))
            converged = bool(np.all(2.0 * scatter <= tolerance))
    values = np.concatenate(blocks)
    low, high = coverage_interval(values, coverage_probability)
    return MonteCarloResult(
        float(np.mean(values)),
        float(np.std(values, ddof=1)),
        low,
        high,
        coverage_probability,
        values.size,
        tolerance,
        converged,
    )


def check_by_monte_carlo(
    budget: Budget,
    *,
    generator: np.random.Generator,
    coverage_probability: float = COVERAGE_PROBABILITY,
    significant_digits: int = 2,
    maximum_trials: int = 5_000_000,
) -> Validation:
    """Compare a budget's interval with Monte Carlo's (JCGM 101:2008, clause 8).

    Parameters
    ----------
    generator, coverage_probability, maximum_trials
        As in `monte_carlo`, which is run with a fifth of the tolerance.
    significant_digits : int
        Number of meaningful digits of the standard uncertainty, 1 or 2.

    Examples
    --------
    >>> from torquebench.uncertainty import BudgetLine
    >>> budget = Budget.of(3.0, "", [BudgetLine("a", 0.3), BudgetLine("b", 0.4)])
    >>> generator = np.random.default_rng(0)
    >>> check_by_monte_carlo(budget, generator=generator, significant_digits=1).agrees
    True
    """
    tolerance = numerical_tolerance(budget.standard_uncertainty, significant_digits)
    result = monte_carlo(
        budget,
        generator=generator,
        coverage_probability=coverage_probability,
        tolerance=tolerance / 5.0,
        maximum_trials=maximum_trials,
    )
    low, high = budget.interval(coverage_probability)
    low_difference, high_difference = abs(low - result.low), abs(high - result.high)
    agrees = result.converged and low_difference <= tolerance and high_difference <= tolerance
    return Validation(agrees, low_difference, high_difference, tolerance, budget, result)
