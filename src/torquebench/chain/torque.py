"""Compensated torque with the components of its uncertainty and their correlation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.chain.readings import FloatArray
from torquebench.errors import InputError
from torquebench.html_table import html_table
from torquebench.message import Message
from torquebench.uncertainty import (
    Budget,
    BudgetLine,
    Distribution,
    Validation,
    check_by_monte_carlo,
)
from torquebench.uncertainty import (
    Shared as Shared,
)

Shapes = Distribution | NDArray[np.object_]
"""One distribution for all torques, or one for each."""

NOISE = "noise of the reading"
"""Component that contains the standard error of a mean."""

COVERAGE_FACTOR = 2.0
"""k of every U: the effects' standard uncertainties already contain Student's factor for their
degrees of freedom, so that ±2u covers 95.45 %.
"""


class Component(NamedTuple):
    """Contribution of one source to torques, and its uncertainty.

    It isn't a `BudgetLine`, into which `Torque.budget` turns it for one torque: it holds many
    torques and the places that correlate them, and every live block makes some twenty of it.

    Parameters
    ----------
    name : str
        Name of the source in budgets.
    shared : Shared
        Scope of the common error: what readings must have in common to share it.
    uncertainty_nm : float64[n] or float
        Standard uncertainty, N·m, with the sign of the error's direction: if the signs of two
        readings differ, a shared error has opposite directions.
    value_nm : float64[n] or float
        Correction of the torque, N·m.
    place : float64[n, m] or None
        Position of a reading, in correlation lengths: errors of readings farther apart than 1 are
        independent. None if one error shifts all readings.
    distribution : Distribution or array of them
    """

    name: str
    shared: Shared
    uncertainty_nm: FloatArray | float
    value_nm: FloatArray | float = 0.0
    place: FloatArray | None = None
    distribution: Shapes = Distribution.NORMAL

    def of_one(self) -> Component:
        """Return the contribution to a single torque with floats instead of arrays."""
        u, value = np.asarray(self.uncertainty_nm), np.asarray(self.value_nm)
        return self._replace(uncertainty_nm=u.item(), value_nm=value.item())


def by_row(rows: NDArray[np.bool_] | bool, these: Distribution, others: Distribution) -> Shapes:
    """Return one distribution for the torques in `rows` and another for all others."""
    if isinstance(rows, bool):
        return these if rows else others
    if rows.all() or not rows.any():
        return these if rows.any() else others
    return np.array([these if row else others for row in rows.tolist()], dtype=object)


def not_corrected(component: Component, share: float = 3.0**-0.5) -> Component:
    """Return a component without correction, with the size of the correction in its uncertainty.

    Parameters
    ----------
    share : float
        Standard uncertainty as a share of the omitted correction; that of a rectangular
        distribution by default.
    """
    u = np.hypot(component.uncertainty_nm, share * component.value_nm)
    return component._replace(value_nm=0.0, uncertainty_nm=u)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Torque:
    """Compensated torques and the components of their uncertainty.

    Parameters
    ----------
    value_nm : float64[n]
        Compensated torque, N·m; NaN where there is no number.
    components : tuple of Component
        One for each source.

    Examples
    --------
    >>> torque = Torque(
    ...     np.array([100.0, 60.0]),
    ...     (
    ...         Component("reference", Shared.CALIBRATION, np.array([0.10, 0.06])),
    ...         Component("noise of the reading", Shared.NOTHING, np.array([0.03, 0.04])),
    ...     ),
    ... )
    >>> torque.expanded_uncertainty_nm.round(3).tolist()
    [0.209, 0.144]
    >>> torque.combined([1.0, -1.0]).expanded_uncertainty_nm.round(3).tolist()  # 2·√(0.04² + 0.05²)
    [0.128]
    """

    value_nm: FloatArray
    components: tuple[Component, ...]

    def __len__(self) -> int:
        return int(self.value_nm.size)

    def __repr__(self) -> str:
        finite = self.value_nm[np.isfinite(self.value_nm)]
        if not finite.size:
            return f"Torque({len(self)} × no number)"
        low, high = float(finite.min()), float(finite.max())
        values = f"{low:.6g} N·m" if low == high else f"{low:.6g} to {high:.6g} N·m"
        largest = float(np.nanmax(self.expanded_uncertainty_nm))
        return f"Torque({len(self)} × {values}, U (k = 2) up to {largest:.2g} N·m)"

    def _repr_html_(self) -> str:
        rows = [
            (each.name, f"{float(np.max(self.component(each.name))):.2g} N·m")
            for each in self.components
        ]
        return html_table(repr(self), ("source", "largest u"), rows)

    @property
    def has_number(self) -> NDArray[np.bool_]:
        """Whether torques are finite."""
        return np.isfinite(self.value_nm)

    @property
    def standard_uncertainty_nm(self) -> FloatArray:
        """Combined standard uncertainty u, N·m."""
        variance = np.zeros(self.value_nm.shape)
        for component in self.components:
            variance += np.square(component.uncertainty_nm)
        return np.asarray(np.sqrt(variance))

    @property
    def expanded_uncertainty_nm(self) -> FloatArray:
        """Expanded uncertainty U = 2u, N·m."""
        return COVERAGE_FACTOR * self.standard_uncertainty_nm

    def component(self, name: str) -> FloatArray:
        """Return the standard uncertainty of one component, N·m; 0 if it doesn't exist."""
        variance = np.zeros(self.value_nm.shape)
        for component in self.components:
            if component.name == name:
                variance += np.square(component.uncertainty_nm)
        return np.asarray(np.sqrt(variance))

    def added(self, name: str) -> FloatArray:
        """Return the correction by one component, N·m; 0 if it doesn't exist."""
        total = np.zeros(self.value_nm.shape)
        for component in self.components:
            if component.name == name:
                total += component.value_nm
        return total

    def at(self, rows: ArrayLike | slice) -> Torque:
        """Return some of the torques."""
        index = rows if isinstance(rows, slice) else np.asarray(rows)

        def chosen(values: Any) -> Any:
            return values[index] if isinstance(values, np.ndarray) and values.ndim else values

        return Torque(
            self.value_nm[index],
            tuple(
                component._replace(
                    uncertainty_nm=chosen(component.uncertainty_nm),
                    value_nm=chosen(component.value_nm),
                    place=None if component.place is None else component.place[index],
                    distribution=chosen(component.distribution),
                )
                for component in self.components
            ),
        )

    def without(self, name: str) -> Torque:
        """Return the torques without one component's correction and uncertainty."""
        parts = tuple(
            not_corrected(component) if component.name == name else component
            for component in self.components
        )
        return Torque(self.value_nm - self.added(name), parts)

    def and_also(self, *components: Component) -> Torque:
        """Return the same torques with additional components."""
        return Torque(self.value_nm, (*self.components, *components))

    def combined(
        self,
        weights: ArrayLike,
        *,
        mounting: ArrayLike | None = None,
        zeroing: ArrayLike | None = None,
        loading: ArrayLike | None = None,
    ) -> Torque:
        """Return Σ wᵢTᵢ as one torque, such as a difference or a mean.

        Correlations follow from the components: an error of the calibration contributes Σ wᵢuᵢ, so
        that it cancels in a difference; an error that is new with every loading contributes √Σ
        (wᵢuᵢ)².

        Parameters
        ----------
        weights : array_like of shape (n,)
        mounting, zeroing, loading : array_like of shape (n,), optional
            Number of the mounting, the zeroing and the loading of each torque: equal numbers share
            their errors. By default one mounting and one zeroing, and a separate loading for every
            torque.

        Returns
        -------
        Torque
            Torque of one element; components keep their names.
        """
        count = len(self)
        weight = np.asarray(weights, dtype=np.float64)
        groups = {
            Shared.CALIBRATION: np.zeros(count),
            Shared.MOUNTING: np.zeros(count) if mounting is None else np.asarray(mounting),
            Shared.ZEROING: np.zeros(count) if zeroing is None else np.asarray(zeroing),
            Shared.LOADING: np.arange(count) if loading is None else np.asarray(loading),
            Shared.NOTHING: np.arange(count),
        }
        parts = tuple(
            component._replace(
                uncertainty_nm=np.atleast_1d(
                    _spread(
                        weight * component.uncertainty_nm, groups[component.shared], component.place
                    )
                ),
                value_nm=np.atleast_1d(np.sum(weight * component.value_nm)),
                place=None if component.place is None else _middle(component.place, weight),
                distribution=_shape(
                    component, int(np.argmax(np.abs(weight * component.uncertainty_nm)))
                ),
            )
            for component in self.components
        )
        return Torque(np.atleast_1d(weight @ self.value_nm), parts)

    def mean(self) -> Torque:
        """Return the mean over windows of one loading, as for a steady torque."""
        return self.combined(np.full(len(self), 1.0 / len(self)), loading=np.zeros(len(self)))

    def steady(self, shift_nm: float, standard_error_nm: float, in_scatter_nm: float) -> Torque:
        """Return a mean shifted to a steady value, with the larger of both standard errors.

        Parameters
        ----------
        shift_nm : float
            Steady value less mean, N·m.
        standard_error_nm : float
            Standard error of the steady value, N·m: it contains all noise of its windows.
        in_scatter_nm : float
            Standard error of the calibration's step means, which the scatter already contains, N·m.
        """
        noise = sum(
            float(np.square(component.uncertainty_nm).sum())
            for component in self.components
            if component.shared is Shared.NOTHING
        )
        missing = standard_error_nm**2 - in_scatter_nm**2 - noise
        parts = tuple(
            component._replace(
                uncertainty_nm=np.sqrt(np.square(component.uncertainty_nm) + missing)
            )
            if component.name == NOISE and missing > 0.0
            else component
            for component in self.components
        )
        return Torque(self.value_nm + shift_nm, parts)

    def budget(self, row: int = 0) -> Budget:
        """Return the uncertainty budget of one torque (GUM); its lines' values are corrections.

        Every sensitivity is 1, and the lines have no degrees of freedom: the uncertainties of fits
        already contain Student's factor, so that k is 2.
        """
        value = float(self.value_nm[row])
        if not np.isfinite(value):
            raise InputError(Message("a torque of {value} N·m", value), "a finite value")
        lines = [
            BudgetLine(
                component.name,
                abs(float(np.broadcast_to(component.uncertainty_nm, self.value_nm.shape)[row])),
                shared=component.shared,
                distribution=_shape(component, row),
                value=float(np.broadcast_to(component.value_nm, self.value_nm.shape)[row]),
            )
            for component in self.components
        ]
        return Budget.of(value, "N·m", lines)

    def check(
        self, row: int = 0, *, generator: np.random.Generator, significant_digits: int = 1
    ) -> Validation:
        """Compare the budget with Monte Carlo, by the criterion of JCGM 101:2008, clause 8."""
        return check_by_monte_carlo(
            self.budget(row), generator=generator, significant_digits=significant_digits
        )


def _spread(weighted: FloatArray, group: NDArray[np.generic], place: FloatArray | None) -> float:
    """Return the standard uncertainty of a sum of parts whose errors are common within groups."""
    if place is None:
        if group.size and np.all(group == group[0]):
            return float(np.sum(weighted))
        _, member = np.unique(group, return_inverse=True)
        return float(np.sqrt(np.sum(np.bincount(member.reshape(-1), weighted) ** 2)))
    shared = (group[:, None] == group[None, :]).astype(np.float64)
    for column in place.T:
        shared *= np.maximum(1.0 - np.abs(column[:, None] - column[None, :]), 0.0)
    return float(np.sqrt(max(weighted @ shared @ weighted, 0.0)))


def _shape(component: Component, row: int) -> Distribution:
    shape = component.distribution
    return shape if isinstance(shape, Distribution) else shape[row]


def _middle(place: FloatArray, weight: FloatArray) -> FloatArray:
    share = np.abs(weight) / np.sum(np.abs(weight))
    return np.asarray((share @ place)[None, :])


def joined(parts: Sequence[Torque]) -> Torque:
    """Concatenate the torques of one chain.

    Parameters
    ----------
    parts : sequence of Torque
        Torques to join: at least one, all with the same components.
    """
    first = parts[0]

    def column(number: int, name: str) -> FloatArray:
        """Return an attribute of a component for the torques of all parts."""
        return np.concatenate(
            [
                np.broadcast_to(getattr(part.components[number], name), part.value_nm.shape)
                for part in parts
            ]
        )

    components = tuple(
        component._replace(
            uncertainty_nm=column(number, "uncertainty_nm"),
            value_nm=column(number, "value_nm"),
            place=None
            if component.place is None
            else np.concatenate([part.components[number].place for part in parts]),
            distribution=_joined_shapes(parts, number),
        )
        for number, component in enumerate(first.components)
    )
    return Torque(np.concatenate([part.value_nm for part in parts]), components)


def _joined_shapes(parts: Sequence[Torque], number: int) -> Shapes:
    """Return a component's distributions over all parts; one if they are the same."""
    shapes = [part.components[number].distribution for part in parts]
    if all(shape is shapes[0] for shape in shapes):
        return shapes[0]
    rows = [np.empty(len(part), dtype=object) for part in parts]
    for row, shape in zip(rows, shapes, strict=True):
        row[:] = shape
    return np.concatenate(rows)
