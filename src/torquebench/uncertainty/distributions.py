"""Distributions of a budget's quantities, and draws from them."""

from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.units import TURN


class Distribution(StrEnum):
    """Probability distribution of a quantity (JCGM 101:2008, clause 6.4).

    A ``NORMAL`` quantity with finite degrees of freedom is drawn from the scaled and shifted
    t-distribution (6.4.9), a ``RECTANGULAR`` one from the curvilinear trapezoid of inexactly known
    limits (6.4.3) whose relative width uncertainty is ``1/sqrt(2 ν)`` (GUM, G.4.2). A ``PRODUCT``
    is the product of two rectangular quantities about 0: a coefficient within a limit times a
    change of temperature within another limit.
    """

    NORMAL = "normal"
    RECTANGULAR = "rectangular"
    TRIANGULAR = "triangular"
    ARCSINE = "arcsine"
    PRODUCT = "product of two rectangular"


HALF_WIDTH_FACTOR: dict[Distribution, float] = {
    Distribution.RECTANGULAR: 3.0**0.5,
    Distribution.TRIANGULAR: 6.0**0.5,
    Distribution.ARCSINE: 2.0**0.5,
    Distribution.PRODUCT: 3.0,
}
"""Half-width of a bounded distribution divided by its standard uncertainty."""


def sample(
    distribution: Distribution,
    value: float,
    standard_uncertainty: float,
    degrees_of_freedom: float,
    size: int,
    generator: np.random.Generator,
) -> NDArray[np.float64]:
    """Draw `size` values of one quantity.

    Parameters
    ----------
    distribution : Distribution
        Shape.
    value, standard_uncertainty : float
        Location, and scale as a standard uncertainty, both in the quantity's unit.
    degrees_of_freedom : float
        Degrees of freedom of the standard uncertainty; `inf` if it is exactly known.
    size : int
        Number of draws.
    generator : numpy.random.Generator
        Source of the draws.

    Returns
    -------
    ndarray of shape (size,)
        Draws in the quantity's unit.

    Examples
    --------
    >>> draws = sample(
    ...     Distribution.RECTANGULAR, 10.0, 1.0, np.inf, 10_000, np.random.default_rng(1)
    ... )
    >>> bool(abs(draws - 10.0).max() <= 3**0.5)
    True
    """
    if distribution is Distribution.NORMAL:
        if np.isinf(degrees_of_freedom):
            return generator.normal(value, standard_uncertainty, size)
        heavy_tailed: NDArray[np.float64] = generator.standard_t(degrees_of_freedom, size)
        return value + standard_uncertainty * heavy_tailed
    half_width = HALF_WIDTH_FACTOR[distribution] * standard_uncertainty
    if distribution is Distribution.RECTANGULAR:
        width = np.full(size, half_width)
        if np.isfinite(degrees_of_freedom):
            _require_separate_limits(degrees_of_freedom)
            # JCGM 101:2008, 6.4.3.4, with an exact mid-point and an inexact width
            inexactness = half_width / np.sqrt(2.0 * degrees_of_freedom)
            width += inexactness * generator.uniform(-1.0, 1.0, size)
        return value + width * generator.uniform(-1.0, 1.0, size)
    if distribution is Distribution.TRIANGULAR:
        sum_of_two = generator.uniform(-0.5, 0.5, size) + generator.uniform(-0.5, 0.5, size)
        return value + half_width * sum_of_two
    if distribution is Distribution.PRODUCT:
        of_both = generator.uniform(-1.0, 1.0, size) * generator.uniform(-1.0, 1.0, size)
        return value + half_width * of_both
    return value + half_width * np.sin(TURN * generator.random(size))


def _require_separate_limits(degrees_of_freedom: float) -> None:
    """Refuse a rectangular quantity whose limits are hardly known."""
    if degrees_of_freedom < 1.0:
        raise InputError(
            Message(
                "a rectangular quantity with {degrees_of_freedom:g} degrees of freedom",
                degrees_of_freedom,
            ),
            "at least 1, so that its limits stay on their own sides",
            "state the limits better or give the quantity as normal",
        )
