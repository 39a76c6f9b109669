"""Law of propagation of uncertainty (GUM, clause 5), with correlations."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.uncertainty.budget import Budget, BudgetLine, welch_satterthwaite
from torquebench.uncertainty.quantity import Quantity
from torquebench.uncertainty.sensitivity import (
    DerivativeMethod,
    MeasurementFunction,
    sensitivities,
)

__all__ = [
    "Correlations",
    "SharedFreedom",
    "correlated_groups",
    "correlation_matrix",
    "propagate",
    "shared_indices",
]

Correlations = Mapping[tuple[str, str], float]
"""Correlation coefficients by the names of the two quantities; pairs left out are independent."""

SharedFreedom = Sequence[Sequence[str]]
"""Names of quantities whose standard uncertainties come from one estimate, group by group."""


def propagate(
    function: MeasurementFunction,
    quantities: Sequence[Quantity],
    *,
    correlations: Correlations | None = None,
    shared_freedom: SharedFreedom = (),
    derivatives: ArrayLike | None = None,
    method: DerivativeMethod = "auto",
    unit: str = "",
) -> Budget:
    """Propagate standard uncertainties through a measurement function, to first order.

    Parameters
    ----------
    function : callable
        f(x1, x2, ...) with the quantities' values in their order.
    quantities : sequence of Quantity
        Inputs, with unique names.
    correlations : mapping of (name, name) to float, optional
        Correlation coefficients between inputs.
    shared_freedom : sequence of sequences of names, optional
        Inputs whose standard uncertainties come from one and the same estimate (the scatter about
        one fit, say): independent errors, but one number of degrees of freedom together.
    derivatives : array_like of shape (n,), optional
        Sensitivity coefficients where they are known analytically; else they are computed.
    method : {"auto", "complex-step", "differences"}
        How sensitivities are computed, see `sensitivities`.
    unit : str
        Unit of the result.

    Returns
    -------
    Budget
        Result, combined standard uncertainty, effective degrees of freedom and contributions.
        Welch-Satterthwaite holds for independent estimates only: a group that is correlated or
        shares its estimate counts as one contribution. If its members' degrees of freedom differ,
        the smallest is used, which is cautious, and the budget states that.

    Raises
    ------
    InputError
        When names repeat, a correlation names an unknown quantity or is impossible, or the
        function is not finite.

    Examples
    --------
    >>> budget = propagate(
    ...     lambda force, arm: force * arm,
    ...     [Quantity("force", 100.0, 0.03, unit="N"), Quantity("arm", 0.5, 0.0002, unit="m")],
    ...     unit="N·m",
    ... )
    >>> budget.value, round(budget.standard_uncertainty, 6)
    (50.0, 0.025)
    """
    matrix = correlation_matrix(quantities, correlations)
    values = [quantity.value for quantity in quantities]
    spread = np.array([quantity.standard_uncertainty for quantity in quantities])
    freedom = np.array([quantity.degrees_of_freedom for quantity in quantities])
    value = float(function(*values))
    if not np.isfinite(value):
        raise InputError(
            Message("the measurement function gives {value}", value), "a finite result"
        )
    slope = (
        sensitivities(function, values, spread.tolist(), method)
        if derivatives is None
        else np.asarray(derivatives, dtype=np.float64)
    )
    if slope.shape != spread.shape:
        raise InputError(
            Message("{size} derivatives for {spread_size} quantities", slope.size, spread.size),
            "one for each",
        )
    signed = slope * spread
    partial = signed * (matrix @ signed)
    variance = max(float(np.sum(partial)), 0.0)
    groups = correlated_groups(matrix, shared_indices(quantities, shared_freedom))
    group_variance = np.array([max(float(np.sum(partial[group])), 0.0) for group in groups])
    group_freedom = np.array([float(np.min(freedom[group])) for group in groups])
    cautions = _cautions(quantities, groups, freedom)
    lines = tuple(
        BudgetLine(
            quantity.name,
            quantity.unit,
            quantity.value,
            quantity.standard_uncertainty,
            quantity.degrees_of_freedom,
            quantity.distribution,
            float(slope[index]),
            abs(float(signed[index])),
            float(partial[index]) / variance if variance > 0 else 0.0,
        )
        for index, quantity in enumerate(quantities)
    )
    effective = float(welch_satterthwaite(np.sqrt(group_variance), group_freedom))
    return Budget(value, float(np.sqrt(variance)), effective, lines, unit, cautions)


def correlation_matrix(
    quantities: Sequence[Quantity], correlations: Correlations | None
) -> NDArray[np.float64]:
    """Full correlation matrix of the quantities; refuses impossible ones.

    Examples
    --------
    >>> pair = [Quantity("a", 1.0, 0.1), Quantity("b", 2.0, 0.1)]
    >>> correlation_matrix(pair, {("a", "b"): -0.5}).tolist()
    [[1.0, -0.5], [-0.5, 1.0]]
    """
    if not quantities:
        raise InputError("no input quantity", "at least one")
    names = [quantity.name for quantity in quantities]
    if len(set(names)) < len(names):
        repeated = sorted({name for name in names if names.count(name) > 1})
        raise InputError(
            Message("the quantities {repeated} appear twice", repeated), "unique names"
        )
    matrix = np.eye(len(names))
    for (first, second), coefficient in (correlations or {}).items():
        if first not in names or second not in names or first == second:
            raise InputError(
                Message("a correlation between {first!r} and {second!r}", first, second),
                Message("two different quantities of {names}", ", ".join(names)),
            )
        if not -1.0 <= coefficient <= 1.0:
            raise InputError(
                Message(
                    "correlation of {first!r} and {second!r} = {coefficient:g}",
                    first,
                    second,
                    coefficient,
                ),
                "between -1 and 1",
            )
        row, column = names.index(first), names.index(second)
        matrix[row, column] = matrix[column, row] = coefficient
    if correlations and np.linalg.eigvalsh(matrix)[0] < -1e-10:
        raise InputError(
            "correlations that contradict each other (the matrix is not positive semi-definite)",
            "coefficients that can exist together",
            "check the coefficients of quantities that share a cause",
        )
    return matrix


def correlated_groups(
    matrix: NDArray[np.float64], shared: Sequence[Sequence[int]] = ()
) -> list[list[int]]:
    """List the indices of quantities that hang together, one list a group.

    Parameters
    ----------
    matrix : float64 array of shape (n, n)
        Correlation coefficients.
    shared : sequence of sequences of int, optional
        Indices that hang together without being correlated.

    Examples
    --------
    >>> correlated_groups(np.array([[1.0, 0.0, 0.4], [0.0, 1.0, 0.0], [0.4, 0.0, 1.0]]))
    [[0, 2], [1]]
    >>> correlated_groups(np.eye(3), [[0, 1]])
    [[0, 1], [2]]
    """
    joined = matrix != 0.0
    for members in shared:
        joined[np.ix_(members, members)] = True
    left = set(range(len(matrix)))
    groups: list[list[int]] = []
    while left:
        open_ends = [min(left)]
        left.remove(open_ends[0])
        group: list[int] = []
        while open_ends:
            index = open_ends.pop()
            group.append(index)
            partners = [other for other in sorted(left) if joined[index, other]]
            left.difference_update(partners)
            open_ends.extend(partners)
        groups.append(sorted(group))
    return groups


def shared_indices(
    quantities: Sequence[Quantity], shared_freedom: SharedFreedom
) -> list[list[int]]:
    """Turn the groups' names into indices; refuses unknown names.

    Examples
    --------
    >>> shared_indices([Quantity("a", 1.0, 0.1), Quantity("b", 2.0, 0.1)], [("b", "a")])
    [[1, 0]]
    """
    names = [quantity.name for quantity in quantities]
    unknown = sorted({name for group in shared_freedom for name in group} - set(names))
    if unknown:
        raise InputError(
            Message("shared degrees of freedom of {unknown}", unknown),
            Message("names of {names}", names),
        )
    return [[names.index(name) for name in group] for group in shared_freedom]


def _cautions(
    quantities: Sequence[Quantity], groups: list[list[int]], freedom: NDArray[np.float64]
) -> tuple[str, ...]:
    cautions = []
    for group in groups:
        if len(group) > 1 and len(set(freedom[group].tolist())) > 1:
            names = ", ".join(quantities[index].name for index in group)
            cautions.append(
                f"{names} belong together and have different degrees of freedom, for which "
                "Welch-Satterthwaite does not hold; the smallest is taken for the group"
            )
    return tuple(cautions)
