"""Comparison of benches with a specimen that travels between them: E_n numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["BenchResult", "ComparedBench", "TravellingComparison", "compare_benches"]


@dataclass(frozen=True)
class BenchResult:
    """Result of one bench for the specimen.

    Parameters
    ----------
    bench : str
    value, expanded_uncertainty : float
        Mean of its runs, and U (k = 2), in one unit.
    runs : int
        How many.
    """

    bench: str
    value: float
    expanded_uncertainty: float
    runs: int = 1


@dataclass(frozen=True)
class ComparedBench:
    """One bench against the reference.

    Attributes
    ----------
    result : BenchResult
    reference, reference_expanded_uncertainty : float
        Reference value.
    difference : float
        Its value less the reference.
    en : float
        Difference over √(U² + U_ref²); 0 for the reference bench itself.
    """

    result: BenchResult
    reference: float
    reference_expanded_uncertainty: float
    difference: float
    en: float

    @property
    def agrees(self) -> bool:
        """Whether |E_n| is at most 1."""
        return abs(self.en) <= 1.0


@dataclass(frozen=True)
class TravellingComparison:
    """All benches that had the specimen.

    Attributes
    ----------
    benches : tuple of ComparedBench
    mean, expanded_uncertainty : float
        Weighted mean of all benches with its U (k = 2).
    chi_squared, p_value : float
        p-value of their scatter given their uncertainties; below 0.05 it is too large.
    """

    benches: tuple[ComparedBench, ...]
    mean: float
    expanded_uncertainty: float
    chi_squared: float
    p_value: float


def compare_benches(
    results: Sequence[BenchResult], reference: str | None = None
) -> TravellingComparison:
    """Compare benches by their results for one specimen.

    Each is compared with the reference bench, or against the weighted mean of all others, which
    doesn't depend on it.

    Parameters
    ----------
    results : sequence of BenchResult
        One a bench, at least two, with U above 0.
    reference : str, optional
        The bench that the others are held against.

    Raises
    ------
    InputError
        Fewer than two benches, one twice, a reference that isn't among them, or no uncertainty.

    References
    ----------
    ISO/IEC 17043:2010, B.3.1.3 e) and B.2; M. G. Cox, Metrologia 39 (2002) 589, procedure A.

    Examples
    --------
    >>> found = compare_benches([BenchResult("A", 10.0, 0.3), BenchResult("B", 10.5, 0.4)])
    >>> [round(each.en, 6) for each in found.benches]
    [-1.0, 1.0]
    """
    names = [each.bench for each in results]
    if len(set(names)) < max(2, len(names)):
        raise InputError(
            Message("{count} results of {benches} benches", len(names), len(set(names))),
            "two benches or more, each once",
        )
    if reference is not None and reference not in names:
        raise InputError(Message("reference bench {reference}", reference), ", ".join(names))
    for each in results:
        if not each.expanded_uncertainty > 0.0:
            raise InputError(
                Message(
                    "bench {bench} states U = {expanded_uncertainty:g}",
                    each.bench,
                    each.expanded_uncertainty,
                ),
                "a U above 0",
            )
    x = np.array([each.value for each in results])
    weight = np.array([4.0 / each.expanded_uncertainty**2 for each in results])
    mean = float(np.sum(weight * x) / weight.sum())
    chi_squared = float(np.sum(weight * (x - mean) ** 2))
    from scipy import stats

    def compared(k: int) -> ComparedBench:
        own = results[k]
        if reference is not None:
            other = results[names.index(reference)]
            value, expanded = other.value, other.expanded_uncertainty
        else:
            rest = np.arange(x.size) != k
            value = float(np.sum((weight * x)[rest]) / weight[rest].sum())
            expanded = 2.0 / sqrt(float(weight[rest].sum()))
        difference = own.value - value
        en = difference / sqrt(own.expanded_uncertainty**2 + expanded**2)
        return ComparedBench(own, value, expanded, difference, en)

    return TravellingComparison(
        benches=tuple(compared(k) for k in range(x.size)),
        mean=mean,
        expanded_uncertainty=2.0 / sqrt(float(weight.sum())),
        chi_squared=chi_squared,
        p_value=float(stats.chi2.sf(chi_squared, x.size - 1)),
    )
