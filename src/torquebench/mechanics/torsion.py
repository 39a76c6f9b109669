"""Torsion of sections in closed form: circle, hollow circle, rectangle."""

from math import tau
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message

FloatArray = NDArray[np.float64]


def _positive(name: str, value: ArrayLike) -> FloatArray:
    """Return a value as an array; refuse values that aren't above 0."""
    array = np.asarray(value, dtype=np.float64)
    if not (np.all(np.isfinite(array)) and np.all(array > 0.0)):
        raise InputError(Message("{name} = {value!r}", name, value), "finite and above 0")
    return array


def polar_moment(outer_diameter_m: ArrayLike, inner_diameter_m: ArrayLike = 0.0) -> NDArray[Any]:
    """Return a round shaft's polar second moment of area, and torsion constant, π (D⁴ − d⁴) / 32.

    Parameters
    ----------
    outer_diameter_m, inner_diameter_m : array_like
        Diameters in metres, broadcast against each other; 0 ≤ d < D. They may be complex, to carry
        a derivative.

    Returns
    -------
    ndarray
        Polar moment in m⁴: twist per length = torque / (G J).

    Raises
    ------
    InputError
        If a diameter is negative or the bore isn't smaller than the shaft.

    Examples
    --------
    >>> float(polar_moment(0.030).round(12))
    7.9522e-08
    """
    outer, inner = np.asarray(outer_diameter_m), np.asarray(inner_diameter_m)
    if not np.all((outer.real > inner.real) & (inner.real >= 0.0)):
        raise InputError(
            Message(
                "outer diameter {outer_diameter_m!r} m with inner diameter {inner_diameter_m!r} m",
                outer_diameter_m,
                inner_diameter_m,
            ),
            "0 m <= inner diameter < outer diameter",
        )
    return np.asarray(np.pi * (outer**4 - inner**4) / 32.0)


def rectangle_torsion_factor(aspect_ratio: ArrayLike) -> FloatArray:
    """Return the torsion factor β_s of a solid rectangle with sides a ≥ b.

    β_s(q) = ⅓ [1 − 192/(π⁵ q) Σ_{n odd} tanh(nπq/2)/n⁵]. The sum is calculated as (31/32) ζ(5) less
    the terms of 1 − tanh, which decrease exponentially, so that it is exact to rounding.

    Parameters
    ----------
    aspect_ratio : array_like
        q = a/b, at least 1.

    Returns
    -------
    float64[...]
        β_s, of the ratio's shape; ⅓ for an infinitely long strip.

    Raises
    ------
    InputError
        If a ratio is below 1.

    References
    ----------
    S. Timoshenko, J. N. Goodier, Theory of Elasticity, torsion of a rectangular bar.

    Examples
    --------
    >>> rectangle_torsion_factor([1.0, 2.0, 10.0]).round(4)
    array([0.1406, 0.2287, 0.3123])
    """
    from scipy.special import expit, zeta  # imported late: a server at rest doesn't need SciPy

    ratio = _positive("aspect ratio a/b", aspect_ratio)
    if np.any(ratio < 1.0):
        raise InputError(
            Message("aspect ratio a/b = {aspect_ratio!r}", aspect_ratio),
            "a/b >= 1: a is the longer side",
        )
    odd = np.arange(1.0, 40.0, 2.0)
    missing = 2.0 * expit(-np.pi * ratio[..., np.newaxis] * odd) / odd**5  # (1 − tanh(x/2)) / n⁵
    total = 31.0 / 32.0 * zeta(5.0) - missing.sum(axis=-1)
    return np.asarray((1.0 - 192.0 / (np.pi**5 * ratio) * total) / 3.0)


def rectangle_torsion_constant(longer_m: ArrayLike, shorter_m: ArrayLike) -> FloatArray:
    """Return the torsion constant β_s a b³ of a solid rectangle.

    Parameters
    ----------
    longer_m, shorter_m : array_like
        Sides a ≥ b in metres.

    Returns
    -------
    float64[...]
        Torsion constant in m⁴: twist per length = torque / (G · constant).

    Raises
    ------
    InputError
        If a side isn't positive or a < b.

    Examples
    --------
    >>> float(rectangle_torsion_constant(0.02, 0.01).round(12))
    4.574e-09
    """
    longer, shorter = _positive("longer side (m)", longer_m), _positive("shorter side", shorter_m)
    return np.asarray(rectangle_torsion_factor(longer / shorter) * longer * shorter**3)


def equal_area_twist_ratio(aspect_ratio: ArrayLike) -> FloatArray:
    """Return the twist of a rectangle over that of a circle of equal area: (a/b) / (2π β_s).

    Parameters
    ----------
    aspect_ratio : array_like
        q = a/b, at least 1.

    Returns
    -------
    float64[...]
        θ of the rectangle divided by θ of the circle, above 1.

    Raises
    ------
    InputError
        If a ratio is below 1.

    Examples
    --------
    >>> equal_area_twist_ratio([1.0, 3.0, 20.0]).round(3)
    array([1.132, 1.813, 9.86 ])
    """
    ratio: NDArray[Any] = np.asarray(aspect_ratio, dtype=np.float64)
    return np.asarray(ratio / (tau * rectangle_torsion_factor(ratio)))


def hollow_circle_gain(diameter_ratio: ArrayLike) -> FloatArray:
    """Return the stiffness of a hollow circle divided by that of a solid one of the same area.

    The ratio is (1 + k²) / (1 − k²) with k = d/D.

    Parameters
    ----------
    diameter_ratio : array_like
        Inner divided by outer diameter, 0 ≤ k < 1.

    Returns
    -------
    float64[...]
        Ratio of the stiffnesses, at least 1.

    Raises
    ------
    InputError
        If a ratio isn't in [0, 1).

    Examples
    --------
    >>> hollow_circle_gain([0.0, 0.5, 0.8]).round(3)
    array([1.   , 1.667, 4.556])
    """
    ratio = np.asarray(diameter_ratio, dtype=np.float64)
    if not np.all((ratio >= 0.0) & (ratio < 1.0)):
        raise InputError(
            Message("diameter ratio d/D = {diameter_ratio!r}", diameter_ratio), "0 <= d/D < 1"
        )
    return np.asarray((1.0 + ratio**2) / (1.0 - ratio**2))
