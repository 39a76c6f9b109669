"""Outliers: single values, and whole groups such as benches or batches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["GroupDifference", "outlying_groups", "outlying_values"]

LIMIT = 3.5
"""Modified z-score of an outlier (Iglewicz and Hoaglin)."""


@dataclass(frozen=True)
class GroupDifference:
    """Difference of a group's mean from the mean of all others.

    Attributes
    ----------
    group : str
    count : int
        Values in it.
    mean, difference : float
        Its mean, and that mean less the mean of the others.
    p_value : float
        Welch's test, times the number of groups (Bonferroni), at most 1.
    outlying : bool
        Whether it differs by more than chance.
    """

    group: str
    count: int
    mean: float
    difference: float
    p_value: float
    outlying: bool


def outlying_values(values: ArrayLike, limit: float = LIMIT) -> tuple[int, ...]:
    """Return which values are outliers: |0.6745 (x - median)/MAD| above a limit.

    References
    ----------
    B. Iglewicz, D. Hoaglin, How to Detect and Handle Outliers (ASQC, 1993); NIST/SEMATECH
    e-Handbook of Statistical Methods, 1.3.5.17.

    Examples
    --------
    >>> outlying_values([0.81, 0.80, 0.83, 0.79, 1.60, 0.82])
    (4,)
    """
    x = np.asarray(values, dtype=np.float64)
    if x.size < 3:
        return ()
    away = np.abs(x - np.median(x))
    spread = float(np.median(away))
    # More than half of the values are equal, so the median deviation is zero.
    score = (
        0.6745 * away / spread if spread else away / (1.253314 * max(float(away.mean()), 1e-300))
    )
    return tuple(int(k) for k in np.flatnonzero(score > limit))


def outlying_groups(
    values: ArrayLike, groups: Sequence[str], *, level: float = 0.01
) -> list[GroupDifference]:
    """Return every group's difference from all others, the largest first.

    Parameters
    ----------
    values : array of float, shape (n,)
    groups : sequence of str, length n
        Bench or batch of each value.
    level : float, default 0.01
        Of the test over all groups together.

    Raises
    ------
    InputError
        Where lengths differ.

    Examples
    --------
    >>> values = [1.0, 1.1, 0.9, 1.0, 1.1, 0.9, 1.4, 1.5, 1.45]
    >>> [each.group for each in outlying_groups(values, "AAABBBCCC") if each.outlying]
    ['C']
    """
    x, names = np.asarray(values, dtype=np.float64), np.array(list(groups), dtype=object)
    if x.shape != names.shape:
        raise InputError(
            Message("{size} values in {names_size} groups", x.size, names.size),
            "a group for each value",
        )
    from scipy import stats

    kinds = sorted(set(groups))
    found = []
    for kind in kinds:
        inside, others = x[names == kind], x[names != kind]
        if inside.size < 2 or others.size < 2:
            continue
        difference = float(inside.mean() - others.mean())
        if np.ptp(inside) == 0.0 and np.ptp(others) == 0.0:
            p = 0.0 if difference else 1.0
        else:
            p = float(stats.ttest_ind(inside, others, equal_var=False).pvalue)
        p = min(p * len(kinds), 1.0)
        found.append(
            GroupDifference(
                str(kind), int(inside.size), float(inside.mean()), difference, p, p < level
            )
        )
    return sorted(found, key=lambda each: (each.p_value, -abs(each.difference)))
