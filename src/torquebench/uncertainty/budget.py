"""The uncertainty budget: contributions, degrees of freedom, coverage."""

from dataclasses import dataclass
from math import erf, isinf, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.uncertainty.distributions import Distribution
from torquebench.uncertainty.shared import Shared

__all__ = [
    "COVERAGE_PROBABILITY",
    "Budget",
    "BudgetLine",
    "coverage_factor",
    "welch_satterthwaite",
]

COVERAGE_PROBABILITY = erf(sqrt(2.0))
"""95.45 %: the coverage that k = 2 gives for a normal distribution."""


def coverage_factor(
    degrees_of_freedom: ArrayLike, coverage_probability: float = COVERAGE_PROBABILITY
) -> NDArray[np.float64]:
    """Two-sided coverage factor k from Student's t-distribution (GUM, G.3).

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
    """Effective degrees of freedom of independent contributions (GUM, G.2b).

    Parameters
    ----------
    contributions : array_like of shape (..., n)
        Contributions |c·u| in the result's unit.
    degrees_of_freedom : array_like, broadcast to the same shape
        Of each; `inf` allowed.

    Returns
    -------
    ndarray of shape (...)
        ν_eff; `inf` where no contribution with finite degrees of freedom is above 0.

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
    """Contribution of one quantity to the result.

    Attributes
    ----------
    name, unit : str
        The quantity and its unit.
    value, standard_uncertainty, degrees_of_freedom, distribution
        As of the quantity.
    sensitivity : float
        Partial derivative of the result by the quantity, result's unit per quantity's unit.
    contribution : float
        |sensitivity| · standard uncertainty, in the result's unit.
    share : float
        The quantity's part of the result's variance, correlations counted half to each partner;
        all shares add up to 1 (one can be negative where correlations are).
    shared : Shared
        What another result must have in common with this one to have the same error.
    """

    name: str
    unit: str
    value: float
    standard_uncertainty: float
    degrees_of_freedom: float
    distribution: Distribution
    sensitivity: float
    contribution: float
    share: float
    shared: Shared = Shared.NOTHING

    @property
    def common(self) -> bool:
        """Whether another result may have the same error."""
        return self.shared is not Shared.NOTHING


@dataclass(frozen=True)
class Budget:
    """An uncertainty budget: the result and where its uncertainty comes from.

    Attributes
    ----------
    value, standard_uncertainty : float
        Result and combined standard uncertainty, in `unit`.
    degrees_of_freedom : float
        Effective (Welch-Satterthwaite).
    lines : tuple of BudgetLine
        One a quantity, in the order given.
    unit : str
        Unit of the result.
    cautions : tuple of str
        Assumptions of the numbers that don't hold strictly.
    """

    value: float
    standard_uncertainty: float
    degrees_of_freedom: float
    lines: tuple[BudgetLine, ...]
    unit: str = ""
    cautions: tuple[str, ...] = ()

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

    def dominant(self) -> BudgetLine:
        """Return the line that contributes most."""
        return max(self.lines, key=lambda line: line.contribution)

    def text(self, coverage_probability: float = COVERAGE_PROBABILITY) -> str:
        """Write the budget as aligned plain text, one line a quantity, the result below."""
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
        return "\n".join([*table, *(f"caution: {caution}" for caution in self.cautions)])


def _freedom(value: float) -> str:
    return "∞" if isinf(value) or value > 1e6 else f"{value:.1f}"
