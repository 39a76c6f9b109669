"""Uncertainty of torques, split by what shares the errors and by how they act."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Self

import numpy as np
from numpy.typing import NDArray

from torquebench.chain.readings import FloatArray
from torquebench.chain.torque import Component, Torque
from torquebench.uncertainty import Distribution, Shared

NEGLIGIBLE = 1e-3
"""Share of opposite signs that is ignored, because an error in proportion to the torque may have
the wrong sign where the torque is nearly 0.
"""


@dataclass(frozen=True, eq=False)
class TorqueParts:
    """Standard uncertainties of torques by group, N·m: the squares add up to the chain's.

    A component's group is derived from the readings that share its error and from its signs, so
    that new effects needn't be listed here. A record should be split as a whole: signs show how an
    error acts only if it contains torques of both directions.

    Parameters
    ----------
    scale_nm : float64[n]
        Common to a calibration, with the torque's sign (or against it): remains in a mean over both
        directions.
    shift_nm : float64[n]
        Common to a calibration, with the same sign for both directions: cancels in that mean.
    curve_nm : float64[n]
        Common to a calibration, other errors: of a curve, or with changing signs.
    mounting_nm, zero_nm : float64[n]
        Common to a mounting, and to a zeroing.
    loading_nm : float64[n]
        New with every loading, within limits; equal loadings may have equal errors.
    scatter_nm : float64[n]
        New with every loading, at random.
    noise_nm : float64[n]
        New with every reading: it averages out.

    Examples
    --------
    >>> torque = Torque(
    ...     np.array([100.0, -60.0]),
    ...     (
    ...         Component("reference", Shared.CALIBRATION, np.array([0.10, -0.06])),
    ...         Component("zero over speed", Shared.CALIBRATION, np.array([0.03, 0.03])),
    ...         Component("noise of the reading", Shared.NOTHING, 0.02),
    ...     ),
    ... )
    >>> parts = TorqueParts.of(torque)
    >>> parts.scale_nm.tolist(), parts.shift_nm.tolist(), parts.noise_nm.tolist()
    ([0.1, 0.06], [0.03, 0.03], [0.02, 0.02])
    """

    scale_nm: FloatArray
    shift_nm: FloatArray
    curve_nm: FloatArray
    mounting_nm: FloatArray
    zero_nm: FloatArray
    loading_nm: FloatArray
    scatter_nm: FloatArray
    noise_nm: FloatArray

    @classmethod
    def of(cls, torque: Torque) -> Self:
        """Split the uncertainty of torques into the groups."""
        squares = {item.name: np.zeros(len(torque)) for item in fields(cls)}
        for component in torque.components:
            squares[_part(component, torque.value_nm)] += np.square(component.uncertainty_nm)
        return cls(**{name: np.sqrt(square) for name, square in squares.items()})

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Concatenate the parts of several records; without records, the columns are empty."""
        return cls(
            *(
                np.concatenate([getattr(part, item.name) for part in parts] or [np.zeros(0)])
                for item in fields(cls)
            )
        )

    def at(self, rows: slice | NDArray[np.generic]) -> Self:
        """Return the parts of selected torques."""
        return type(self)(*(getattr(self, item.name)[rows] for item in fields(self)))

    @property
    def standard_uncertainty_nm(self) -> FloatArray:
        """Combined standard uncertainty u, N·m."""
        squares = [np.square(getattr(self, item.name)) for item in fields(self)]
        return np.asarray(np.sqrt(np.sum(squares, axis=0)))


def _part(component: Component, torque_nm: FloatArray) -> str:
    """Return the name of the part that a component belongs to."""
    match component.shared:
        case Shared.MOUNTING:
            return "mounting_nm"
        case Shared.ZEROING:
            return "zero_nm"
        case Shared.LOADING:
            by_scatter = component.distribution is Distribution.NORMAL
            return "scatter_nm" if by_scatter else "loading_nm"
        case Shared.NOTHING:
            return "noise_nm"
        case Shared.CALIBRATION:
            error = np.broadcast_to(component.uncertainty_nm, torque_nm.shape)
            if _one_sign(error * torque_nm):
                return "scale_nm"
            if component.place is None and _one_sign(error):
                return "shift_nm"
            return "curve_nm"


def _one_sign(values: FloatArray) -> bool:
    """Return whether values have one sign, except for a negligible part of their sum."""
    up, down = float(np.sum(values[values > 0.0])), -float(np.sum(values[values < 0.0]))
    return min(up, down) <= NEGLIGIBLE * max(up, down) and max(up, down) > 0.0
