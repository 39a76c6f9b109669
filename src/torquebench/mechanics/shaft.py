"""The chain's round shaft: polar moment, stiffness, twist (sources' equations 1-2)."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["polar_moment", "shaft_stiffness", "shaft_twist"]


def polar_moment(outer_diameter_m: ArrayLike, inner_diameter_m: ArrayLike = 0.0) -> NDArray[Any]:
    """Polar second moment of area of a round shaft, J = π (D⁴ − d⁴) / 32.

    Parameters
    ----------
    outer_diameter_m, inner_diameter_m : array_like
        Diameters in metres, broadcast against each other; 0 ≤ d < D.

    Returns
    -------
    ndarray
        Polar moment in m⁴.

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


def shaft_stiffness(
    length_m: ArrayLike,
    shear_modulus_pa: ArrayLike,
    outer_diameter_m: ArrayLike,
    inner_diameter_m: ArrayLike = 0.0,
) -> NDArray[Any]:
    """Torsional stiffness J G / L of a round shaft in N·m/rad.

    Parameters
    ----------
    length_m, shear_modulus_pa, outer_diameter_m, inner_diameter_m : array_like
        Geometry in metres and shear modulus in pascal, broadcast against each other.

    Returns
    -------
    ndarray
        Stiffness in N·m/rad.

    Raises
    ------
    InputError
        If the length or the modulus isn't positive, or by `polar_moment`.

    Examples
    --------
    >>> float(shaft_stiffness(0.2, 79e9, 0.030).round(1))
    31411.0
    """
    length, modulus = np.asarray(length_m), np.asarray(shear_modulus_pa)
    if not (np.all(length.real > 0.0) and np.all(modulus.real > 0.0)):
        raise InputError(
            Message(
                "length {length_m!r} m with shear modulus {shear_modulus_pa!r} Pa",
                length_m,
                shear_modulus_pa,
            ),
            "both above 0",
        )
    return np.asarray(polar_moment(outer_diameter_m, inner_diameter_m) * modulus / length)


def shaft_twist(
    torque_nm: ArrayLike,
    length_m: ArrayLike,
    shear_modulus_pa: ArrayLike,
    outer_diameter_m: ArrayLike,
    inner_diameter_m: ArrayLike = 0.0,
) -> NDArray[Any]:
    """Twist β = T L / (J G) of a round shaft in rad.

    Parameters
    ----------
    torque_nm : array_like
        Torque in N·m.
    length_m, shear_modulus_pa, outer_diameter_m, inner_diameter_m : array_like
        See `shaft_stiffness`.

    Returns
    -------
    ndarray
        Twist in rad, signed like the torque.

    Examples
    --------
    >>> float(shaft_twist(50.0, 0.2, 79e9, 0.030).round(6))
    0.001592
    """
    stiffness = shaft_stiffness(length_m, shear_modulus_pa, outer_diameter_m, inner_diameter_m)
    return np.asarray(np.asarray(torque_nm) / stiffness)
