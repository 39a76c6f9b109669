"""Propagation of distributions by Monte Carlo (JCGM 101:2008) and its check of a GUM budget."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor, inf, log10
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.uncertainty.budget import COVERAGE_PROBABILITY, Budget
from torquebench.uncertainty.distributions import Distribution, sample
from torquebench.uncertainty.propagation import (
    Correlations,
    SharedFreedom,
    correlated_groups,
    correlation_matrix,
    propagate,
    shared_indices,
)
from torquebench.uncertainty.quantity import Quantity
from torquebench.uncertainty.sensitivity import DerivativeMethod, MeasurementFunction

__all__ = [
    "IntervalKind",
    "MonteCarloResult",
    "Validation",
    "check_by_monte_carlo",
    "coverage_interval",
    "draw_inputs",
    "monte_carlo",
    "numerical_tolerance",
    "validate",
]

IntervalKind = Literal["symmetric", "shortest"]


@dataclass(frozen=True)
class MonteCarloResult:
    """Result of a Monte Carlo propagation.

    Attributes
    ----------
    value, standard_uncertainty : float
        Mean and standard deviation of the drawn results.
    low, high : float
        Coverage interval.
    coverage_probability : float
        Of that interval.
    interval_kind : {"symmetric", "shortest"}
        Probabilistically symmetric, or shortest.
    trials : int
        Number of draws.
    tolerance : float
        Numerical tolerance that the adaptive procedure had to reach.
    converged : bool
        Whether it did within the allowed number of trials.
    """

    value: float
    standard_uncertainty: float
    low: float
    high: float
    coverage_probability: float
    interval_kind: IntervalKind
    trials: int
    tolerance: float
    converged: bool


@dataclass(frozen=True)
class Validation:
    """Whether Monte Carlo confirms a GUM budget (JCGM 101:2008, clause 8.1).

    Attributes
    ----------
    agrees : bool
        True where both ends of the intervals differ by no more than the tolerance.
    low_difference, high_difference : float
        Absolute differences of the intervals' ends.
    tolerance : float
        Half a unit of the last significant digit of the standard uncertainty.
    budget : Budget
        What was checked.
    monte_carlo : MonteCarloResult
        What it was checked against.
    """

    agrees: bool
    low_difference: float
    high_difference: float
    tolerance: float
    budget: Budget
    monte_carlo: MonteCarloResult

    def sentence(self) -> str:
        """One sentence for a report: do the two methods agree, and by how much."""
        unit = f" {self.budget.unit}" if self.budget.unit else ""
        verdict = "agree" if self.agrees else "do not agree"
        return (
            f"GUM and Monte Carlo ({self.monte_carlo.trials} trials) {verdict}: the ends of the "
            f"{100 * self.monte_carlo.coverage_probability:.4g} % interval differ by "
            f"{self.low_difference:.2g}{unit} and {self.high_difference:.2g}{unit}, "
            f"tolerance {self.tolerance:.2g}{unit}"
        )


def numerical_tolerance(standard_uncertainty: float, significant_digits: int = 2) -> float:
    """Half a unit in the last significant digit of a standard uncertainty (JCGM 101, 7.9.2).

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
    values: NDArray[np.float64],
    coverage_probability: float = COVERAGE_PROBABILITY,
    kind: IntervalKind = "symmetric",
) -> tuple[float, float]:
    """Coverage interval of drawn results (JCGM 101:2008, 7.7).

    Parameters
    ----------
    values : ndarray of shape (n,)
        Draws, in any order.
    coverage_probability : float
        Between 0 and 1.
    kind : {"symmetric", "shortest"}
        Equal probability outside either end, or the shortest interval.

    Returns
    -------
    low, high : float
        Ends of the interval.

    Examples
    --------
    >>> coverage_interval(np.arange(1.0, 101.0), 0.9)
    (5.0, 95.0)
    >>> coverage_interval(np.arange(1.0, 101.0) ** 2, 0.9, "shortest")
    (1.0, 8281.0)
    """
    ordered = np.sort(values)
    count = ordered.size
    inside = min(floor(coverage_probability * count + 0.5), count - 1)
    if inside < 1:
        raise InputError(Message("{count} draws", count), "at least 2 for a coverage interval")
    if kind == "shortest":
        width = ordered[inside:] - ordered[: count - inside]
        first = int(np.argmin(width))
    else:
        first = max(floor((count - inside) / 2 + 0.5) - 1, 0)
    return float(ordered[first]), float(ordered[first + inside])


def draw_inputs(
    quantities: Sequence[Quantity],
    matrix: NDArray[np.float64],
    size: int,
    generator: np.random.Generator,
    shared: Sequence[Sequence[int]] = (),
) -> list[NDArray[np.float64]]:
    """Draw `size` values of every quantity, those that belong together jointly.

    Quantities that are correlated or `shared` (their scatter comes from one estimate) are drawn
    from a multivariate normal distribution or, with finite degrees of freedom, a multivariate t
    (JCGM 102:2011, 5.3.2); other shapes can't be correlated by a coefficient alone and are refused.
    """
    draws: list[NDArray[np.float64]] = [np.empty(0)] * len(quantities)
    for group in correlated_groups(matrix, shared):
        members = [quantities[index] for index in group]
        if len(group) == 1:
            only = members[0]
            draws[group[0]] = sample(
                only.distribution,
                only.value,
                only.standard_uncertainty,
                only.degrees_of_freedom,
                size,
                generator,
            )
            continue
        odd = [m.name for m in members if m.distribution is not Distribution.NORMAL]
        if odd:
            raise InputError(
                Message(
                    "correlated quantities with another distribution than normal: {odd}",
                    ", ".join(odd),
                ),
                "normal distributions within a correlated group",
                "split the shared cause into a quantity of its own",
            )
        # a multivariate t has one number of degrees of freedom: the smallest, as in the budget
        freedom = min(m.degrees_of_freedom for m in members)
        block = matrix[np.ix_(group, group)]
        eigenvalues, vectors = np.linalg.eigh(block)
        root = vectors * np.sqrt(np.clip(eigenvalues, 0.0, None))
        joint = root @ generator.standard_normal((len(group), size))
        if np.isfinite(freedom):
            joint /= np.sqrt(generator.chisquare(freedom, size) / freedom)
        for row, index in enumerate(group):
            quantity = quantities[index]
            draws[index] = quantity.value + quantity.standard_uncertainty * joint[row]
    return draws


def monte_carlo(
    function: MeasurementFunction,
    quantities: Sequence[Quantity],
    *,
    generator: np.random.Generator,
    correlations: Correlations | None = None,
    shared_freedom: SharedFreedom = (),
    coverage_probability: float = COVERAGE_PROBABILITY,
    interval_kind: IntervalKind = "symmetric",
    significant_digits: int = 2,
    tolerance: float | None = None,
    maximum_trials: int = 5_000_000,
) -> MonteCarloResult:
    """Propagate distributions adaptively until the result is numerically stable.

    Blocks of draws are added until twice the standard deviation of the blocks' means of value,
    standard uncertainty and both interval ends is below the tolerance (JCGM 101:2008, 7.9.4).

    Parameters
    ----------
    function : callable
        f(x1, x2, ...) on arrays of draws; may return a scalar for a constant.
    quantities : sequence of Quantity
        Inputs, with unique names.
    generator : numpy.random.Generator
        Source of the draws: same state, same result.
    correlations, shared_freedom : optional
        As in `propagate`.
    coverage_probability, interval_kind
        Of the coverage interval.
    significant_digits : int
        Digits of the standard uncertainty that shall be stable, 1 or 2.
    tolerance : float, optional
        Numerical tolerance in the result's unit instead of that by digits.
    maximum_trials : int
        Where to stop though the tolerance isn't reached; `converged` is then False.

    Returns
    -------
    MonteCarloResult
        Over all draws.

    Raises
    ------
    InputError
        When the function is not finite for a draw, or the inputs can't be drawn.

    Examples
    --------
    >>> four = [Quantity.rectangular(f"x{i}", 0.0, 3**0.5) for i in range(4)]
    >>> result = monte_carlo(
    ...     lambda *x: sum(x), four, generator=np.random.default_rng(0), coverage_probability=0.95
    ... )
    >>> round(result.standard_uncertainty, 1), round(result.high, 1)
    (2.0, 3.9)
    """
    matrix = correlation_matrix(quantities, correlations)
    shared = shared_indices(quantities, shared_freedom)
    block_size = max(ceil(100.0 / (1.0 - coverage_probability)), 10_000)
    blocks: list[NDArray[np.float64]] = []
    statistics: list[tuple[float, float, float, float]] = []
    goal = tolerance if tolerance is not None else inf
    converged = False
    while not converged and (len(blocks) + 1) * block_size <= max(maximum_trials, 2 * block_size):
        block = _evaluate(function, draw_inputs(quantities, matrix, block_size, generator, shared))
        low, high = coverage_interval(block, coverage_probability, interval_kind)
        blocks.append(block)
        statistics.append((float(np.mean(block)), float(np.std(block, ddof=1)), low, high))
        if len(blocks) < 2:
            continue
        table = np.array(statistics)
        scatter = np.std(table, axis=0, ddof=1) / np.sqrt(len(blocks))
        if tolerance is None:
            # the blocks' pooled deviation equals that of all draws to well within a digit
            pooled = float(np.sqrt(np.mean(np.square(table[:, 1])) + np.var(table[:, 0])))
            goal = numerical_tolerance(pooled, significant_digits)
        converged = bool(np.all(2.0 * scatter <= goal))
    values = np.concatenate(blocks)
    low, high = coverage_interval(values, coverage_probability, interval_kind)
    return MonteCarloResult(
        float(np.mean(values)),
        float(np.std(values, ddof=1)),
        low,
        high,
        coverage_probability,
        interval_kind,
        values.size,
        goal,
        converged,
    )


def _evaluate(
    function: MeasurementFunction, draws: list[NDArray[np.float64]]
) -> NDArray[np.float64]:
    size = draws[0].size
    outcome = np.asarray(function(*draws), dtype=np.float64)
    if outcome.shape not in {(), (size,)}:
        raise InputError(
            Message(
                "the measurement function gives shape {shape} for {size} draws", outcome.shape, size
            ),
            Message("shape ({size},)", size),
            "write it with NumPy functions so that it takes arrays",
        )
    if not np.all(np.isfinite(outcome)):
        raise InputError(
            "the measurement function is not finite for some draws",
            "finite results over the inputs' distributions",
        )
    return np.broadcast_to(outcome, (size,))


def validate(budget: Budget, result: MonteCarloResult, significant_digits: int = 2) -> Validation:
    """Compare a GUM budget's interval with a Monte Carlo result (JCGM 101:2008, 8.1).

    Parameters
    ----------
    budget : Budget
        From `propagate`.
    result : MonteCarloResult
        From `monte_carlo`, with a tolerance of at most a fifth of the one used here (8.2).
    significant_digits : int
        Digits of the standard uncertainty that matter, 1 or 2.

    Returns
    -------
    Validation
        Agreement and differences.
    """
    low, high = budget.interval(result.coverage_probability)
    tolerance = numerical_tolerance(budget.standard_uncertainty, significant_digits)
    low_difference, high_difference = abs(low - result.low), abs(high - result.high)
    agrees = result.converged and low_difference <= tolerance and high_difference <= tolerance
    return Validation(agrees, low_difference, high_difference, tolerance, budget, result)


def check_by_monte_carlo(
    function: MeasurementFunction,
    quantities: Sequence[Quantity],
    *,
    generator: np.random.Generator,
    correlations: Correlations | None = None,
    shared_freedom: SharedFreedom = (),
    coverage_probability: float = COVERAGE_PROBABILITY,
    significant_digits: int = 2,
    method: DerivativeMethod = "auto",
    maximum_trials: int = 5_000_000,
    unit: str = "",
) -> Validation:
    """Propagate by GUM and by Monte Carlo and say whether they agree (JCGM 101:2008, clause 8).

    Parameters
    ----------
    function, quantities, correlations, shared_freedom, method, unit
        As in `propagate`.
    generator, coverage_probability, significant_digits, maximum_trials
        As in `monte_carlo`, run with a fifth of the tolerance.

    Returns
    -------
    Validation
        With both results.

    Examples
    --------
    >>> checked = check_by_monte_carlo(
    ...     lambda a, b: a + b,
    ...     [Quantity("a", 1.0, 0.3), Quantity("b", 2.0, 0.4)],
    ...     generator=np.random.default_rng(0),
    ...     significant_digits=1,
    ... )
    >>> checked.agrees
    True
    """
    budget = propagate(
        function,
        quantities,
        correlations=correlations,
        shared_freedom=shared_freedom,
        method=method,
        unit=unit,
    )
    goal = numerical_tolerance(budget.standard_uncertainty, significant_digits)
    result = monte_carlo(
        function,
        quantities,
        generator=generator,
        correlations=correlations,
        shared_freedom=shared_freedom,
        coverage_probability=coverage_probability,
        tolerance=goal / 5.0,
        maximum_trials=maximum_trials,
    )
    return validate(budget, result, significant_digits)
