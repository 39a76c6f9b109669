"""The uncertainty budget: contributions, degrees of freedom, coverage."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from math import erf, inf, isinf, sqrt
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.uncertainty.distributions import HALF_WIDTH_FACTOR, Distribution

COVERAGE_PROBABILITY = erf(sqrt(2.0))
"""Coverage probability of k = 2 for a normal distribution: 95.45 %."""


class Shared(StrEnum):
    """Conditions under which two torques, or two results by torques, share an error."""

    CALIBRATION = "calibration"
    MOUNTING = "mounting"
    ZEROING = "zeroing"
    LOADING = "loading"
    NOTHING = "nothing"


def coverage_factor(
    degrees_of_freedom: ArrayLike, coverage_probability: float = COVERAGE_PROBABILITY
) -> NDArray[np.float64]:
    """Return the two-sided coverage factor k from Student's t-distribution (GUM, G.3).

    Parameters
    ----------
    degrees_of_freedom : array_like
        Effective degrees of freedom, above 0; `inf` gives the normal distribution's factor.
        Values between whole numbers are used as they are (GUM, G.4.1, note 1).
    coverage_probability : float
        Between 0 and 1.

    Returns
    -------
    ndarray
        k, same shape as `degrees_of_freedom`.

    Raises
    ------
    InputError
        When the probability is outside (0, 1) or the degrees of freedom are not above 0.

    Examples
    --------
    >>> round(float(coverage_factor(16, 0.99)), 2)
    2.92
    >>> round(float(coverage_factor(np.inf)), 6)
    2.0
    """
    if not 0.0 < coverage_probability < 1.0:
        raise InputError(
            Message("coverage probability {coverage_probability:g}", coverage_probability),
            "between 0 and 1",
        )
    from scipy import special  # imported late: a server at rest doesn't need SciPy

    freedom = np.asarray(degrees_of_freedom, dtype=np.float64)
    if not np.all(freedom > 0):
        raise InputError("degrees of freedom that are not above 0", "above 0")
    quantile = 0.5 * (1.0 + coverage_probability)
    normal = special.ndtri(quantile)
    finite = np.where(np.isinf(freedom), 1.0, freedom)
    factor: NDArray[np.float64] = np.where(
        np.isinf(freedom), normal, special.stdtrit(finite, quantile)
    )
    return factor


def welch_satterthwaite(
    contributions: ArrayLike, degrees_of_freedom: ArrayLike
) -> NDArray[np.float64]:
    """Return the effective degrees of freedom of independent contributions (GUM, G.2b).

    Parameters
    ----------
    contributions : array_like of shape (..., n)
        Contributions |c·u| in the result's unit.
    degrees_of_freedom : array_like, broadcast to the same shape
        Degrees of freedom of each contribution; `inf` is allowed.

    Returns
    -------
    ndarray of shape (...)
        ν_eff; `inf` if no contribution with finite degrees of freedom is above 0.

    Examples
    --------
    >>> round(float(welch_satterthwaite([3.0, 4.0], [4.0, np.inf])), 3)
    30.864
    """
    freedom = np.asarray(degrees_of_freedom, dtype=np.float64)
    variance = np.square(np.asarray(contributions, dtype=np.float64))
    total = np.sum(variance, axis=-1, keepdims=True)
    share = np.divide(variance, total, out=np.zeros_like(variance + total), where=total > 0)
    loss = np.sum(np.square(share) / freedom, axis=-1)
    effective: NDArray[np.float64] = np.divide(
        1.0, loss, out=np.full(np.shape(loss), np.inf), where=loss > 0
    )
    return effective


@dataclass(frozen=True)
class BudgetLine:
    """One source of a result's uncertainty: a summand of the result.

    Attributes
    ----------
    name : str
        Source of the uncertainty.
    standard_uncertainty : float
        In the result's unit, not negative.
    degrees_of_freedom : float
        Degrees of freedom of that; ``inf`` if it is treated as exactly known.
    sensitivity : float
        +1 or -1: direction in which a positive error of the source shifts the result, so that two
        results that share the source can be compared.
    shared : Shared
        What another result must have in common with this one to have the same error: the
        calibration (of a chain or of the bench's encoders), the mounting, the zero, the test as one
        loading, or nothing.
    distribution : Distribution
        Shape that Monte Carlo draws from.
    value : float
        Best estimate of the summand, in `unit`.
    unit : str
        The result's unit.
    contribution : float
        The standard uncertainty: it is in the result's unit.
    share : float
        Part of the result's variance; all shares add up to 1. Set by `Budget.of`.
    """

    name: str
    standard_uncertainty: float
    degrees_of_freedom: float = inf
    sensitivity: float = 1.0
    shared: Shared = Shared.NOTHING
    distribution: Distribution = Distribution.NORMAL
    value: float = 0.0
    unit: str = ""
    contribution: float = field(init=False)
    share: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "contribution", self.standard_uncertainty)

    @classmethod
    def rectangular(cls, name: str, half_width: float) -> Self:
        """Return a line whose error is equally probable anywhere within ±`half_width`.

        Examples
        --------
        >>> BudgetLine.rectangular("resolution", half_width=0.5).standard_uncertainty
        0.288675134594812...
        """
        shape = Distribution.RECTANGULAR
        return cls(name, half_width / HALF_WIDTH_FACTOR[shape], distribution=shape)

    def times(self, factor: float) -> Self:
        """Return the line for a multiple of the result, without the estimate."""
        return replace(
            self,
            standard_uncertainty=abs(factor) * self.standard_uncertainty,
            sensitivity=float(np.copysign(1.0, factor)) * self.sensitivity,
            value=0.0,
        )

    @property
    def common(self) -> bool:
        """Whether another result may share this error."""
        return self.shared is not Shared.NOTHING


@dataclass(frozen=True)
class Budget:
    """An uncertainty budget: the result, and the sources of its uncertainty.

    Attributes
    ----------
    value, standard_uncertainty : float
        Result and combined standard uncertainty, in `unit`.
    degrees_of_freedom : float
        Effective (Welch-Satterthwaite).
    lines : tuple of BudgetLine
        One for each source, in the given order.
    unit : str
        Unit of the result.
    """

    value: float
    standard_uncertainty: float
    degrees_of_freedom: float
    lines: tuple[BudgetLine, ...]
    unit: str = ""

    @classmethod
    def of(cls, value: float, unit: str, lines: Sequence[BudgetLine]) -> Self:
        """Return the budget of a sum of independent parts (GUM, 5.1.2, with sensitivities ±1).

        Examples
        --------
        >>> found = Budget.of(1.2, "arcmin", [BudgetLine("scale", 0.03), BudgetLine("noise", 0.04)])
        >>> round(found.standard_uncertainty, 6), [round(line.share, 2) for line in found.lines]
        (0.05, [0.36, 0.64])
        """
        variance = sum(line.standard_uncertainty**2 for line in lines)
        freedom = inf
        if lines:
            sizes = [line.standard_uncertainty for line in lines]
            freedom = float(welch_satterthwaite(sizes, [line.degrees_of_freedom for line in lines]))
        stated = tuple(
            replace(
                line, unit=unit, share=line.standard_uncertainty**2 / variance if variance else 0.0
            )
            for line in lines
        )
        return cls(float(value), sqrt(variance), freedom, stated, unit)

    def coverage_factor(self, coverage_probability: float = COVERAGE_PROBABILITY) -> float:
        """Return k for the effective degrees of freedom."""
        return float(coverage_factor(self.degrees_of_freedom, coverage_probability))

    def expanded_uncertainty(self, coverage_probability: float = COVERAGE_PROBABILITY) -> float:
        """Return U = k·u, in `unit`."""
        return self.coverage_factor(coverage_probability) * self.standard_uncertainty

    def interval(self, coverage_probability: float = COVERAGE_PROBABILITY) -> tuple[float, float]:
        """Return value − U and value + U, in `unit`."""
        expanded = self.expanded_uncertainty(coverage_probability)
        return self.value - expanded, self.value + expanded

    def text(self, coverage_probability: float = COVERAGE_PROBABILITY) -> str:
        """Return the budget as aligned plain text: a line for each source, then the result."""
        rows = [("quantity", "value", "u", "ν", "distribution", "c", "|c|·u", "share")]
        rows.extend(
            (
                line.name,
                f"{line.value:.6g} {line.unit}".rstrip(),
                f"{line.standard_uncertainty:.3g}",
                _freedom(line.degrees_of_freedom),
                str(line.distribution),
                f"{line.sensitivity:.4g}",
                f"{line.contribution:.3g}",
                f"{100 * line.share:.1f} %",
            )
            for line in self.lines
        )
        widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
        table = [
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in rows
        ]
        factor = self.coverage_factor(coverage_probability)
        unit = f" {self.unit}" if self.unit else ""
        table.append(
            f"result {self.value:.7g}{unit}, u = {self.standard_uncertainty:.3g}{unit}, "
            f"ν_eff = {_freedom(self.degrees_of_freedom)}, k = {factor:.2f}, "
            f"U = {factor * self.standard_uncertainty:.3g}{unit} "
            f"({100 * coverage_probability:.4g} %)"
        )
        return "\n".join(table)


def _freedom(value: float) -> str:
    return "∞" if isinf(value) or value > 1e6 else f"{value:.1f}"
