"""Additional torque of the chain between transducer and reducer (sources' equations 1-15)."""

from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.mechanics.torsion import polar_moment
from torquebench.message import Message

FloatArray = NDArray[np.float64]
Form = Literal["consistent", "published"]

# relative step of the complex-step derivative, which has no cancellation
_STEP = 1e-30

_UNITS = {
    "outer_diameter_m": "N·m/m",
    "inner_diameter_m": "N·m/m",
    "length_m": "N·m/m",
    "shear_modulus_pa": "N·m/Pa",
    "shaft_radius_m": "N·m/m",
    "coaxiality_error_m": "N·m/m",
    "angular_misalignment_rad": "N·m/rad",
    "strain_coefficient_n_per_m": "N·m/(N/m)",
    "elastic_coefficient_n_per_rad": "N·m/(N/rad)",
    "radial_stiffness_n_per_m": "N·m/(N/m)",
    "torque_nm": "N·m/(N·m)",
}


@dataclass(frozen=True)
class Chain:
    """One chain between a torque transducer and the reducer's flange.

    Attributes
    ----------
    outer_diameter_m, inner_diameter_m : float
        D and d of the shaft.
    length_m : float
        L, length of the shaft.
    shear_modulus_pa : float
        G of the shaft's material.
    shaft_radius_m : float
        r, the radius at which the torque turns into a radial force F_r = T/r.
    coaxiality_error_m : float
        Δr, parallel offset of the axes.
    angular_misalignment_rad : float
        Δθ, angle between the axes.
    strain_coefficient_n_per_m : float
        ε, radial force per radial offset.
    elastic_coefficient_n_per_rad : float
        μ, converts offset (m) times twist (rad) to bearing friction (N·m).
    radial_stiffness_n_per_m : float
        K_c of the coupling.

    Raises
    ------
    InputError
        If a length, a modulus or a coefficient that divides isn't positive, or a value isn't
        finite.

    Examples
    --------
    >>> chain = Chain(0.03, 0.0, 0.2, 79e9, 0.015, 2e-5, 1e-4, 5e7, 3.6e5, 1.25e4)
    >>> float(additional_torque(chain, 50.0).total_nm.round(4))
    0.333
    """

    outer_diameter_m: float
    inner_diameter_m: float
    length_m: float
    shear_modulus_pa: float
    shaft_radius_m: float
    coaxiality_error_m: float
    angular_misalignment_rad: float
    strain_coefficient_n_per_m: float
    elastic_coefficient_n_per_rad: float
    radial_stiffness_n_per_m: float

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not np.isfinite(value):
                raise InputError(Message("{name} = {value}", name, value), "a finite number")
        for name in (
            "shaft_radius_m",
            "strain_coefficient_n_per_m",
            "length_m",
            "shear_modulus_pa",
        ):
            if not np.real(getattr(self, name)) > 0.0:
                raise InputError(
                    Message("{name} = {value}", name, getattr(self, name)), "a value above 0"
                )
        polar_moment(self.outer_diameter_m, self.inner_diameter_m)


class AdditionalTorque(NamedTuple):
    """Additional torque and its parts, each in N·m and of the torque's shape.

    Attributes
    ----------
    bearing_friction_nm : float64[...]
        ΔT₁, friction of the bearings under the radial load.
    parallel_misalignment_nm : float64[...]
        ΔT₂, bending of the coupling by the parallel offset.
    angular_misalignment_nm : float64[...]
        ΔT₃, projection of the torque by the angle between the axes.
    total_nm : float64[...]
        T′. In the published form it isn't the sum of the parts, see `additional_torque`.
    """

    bearing_friction_nm: FloatArray
    parallel_misalignment_nm: FloatArray
    angular_misalignment_nm: FloatArray
    total_nm: FloatArray


class Coefficients(NamedTuple):
    """T′ = c₀ + c₁ T + c₂ T².

    Attributes
    ----------
    constant_nm : float
        c₀ in N·m.
    linear : float
        c₁, dimensionless.
    quadratic_per_nm : float
        c₂ in 1/(N·m).
    """

    constant_nm: float
    linear: float
    quadratic_per_nm: float


class Sensitivity(NamedTuple):
    """Derivative of the additional torque with respect to one parameter.

    Attributes
    ----------
    derivative : float64[...]
        ∂T′/∂parameter, of the torque's shape.
    unit : str
        Its unit.
    """

    derivative: FloatArray
    unit: str


def additional_torque(
    chain: Chain, torque_nm: ArrayLike, *, form: Form = "consistent"
) -> AdditionalTorque:
    """Return the additional torque T′ = ΔT₁ + ΔT₂ + ΔT₃ of a chain under a torque.

    Consistent form, with β = T L/(J G), F_r = T/r, ΔX = Δr + F_r/ε:

    - ΔT₁ = μ ΔX β = 32 μ L (Δr T + T²/(r ε)) / (G π (D⁴ − d⁴)),
    - ΔT₂ = K_c L (Δr + T/(r ε)),
    - ΔT₃ = T (cos Δθ − 1) + T sin Δθ · L/r.

    The published form is the one printed in the 2021 article, so that its numbers can be
    reproduced; its terms have inconsistent dimensions:

    - eq. 7 drops μ from the second term of ΔT₁,
    - eq. 13 multiplies by ε where it must divide: ΔT₂ = K_c L (Δr + ε T/r),
    - eq. 14 has cos Δθ · L/r in place of sin Δθ · L/r: T L/r remains at zero misalignment,
    - eq. 15, the total, also drops 32 L from the quadratic term, so that the total isn't the sum
      of the parts.

    The equations are valid for one direction of loading, T ≥ 0. For a torque that reverses, the
    chain of each direction is evaluated with |T| and the result has the sign of T, because an even
    quadratic can't be odd in T.

    Parameters
    ----------
    chain : Chain
        Geometry, misalignments and coefficients.
    torque_nm : array_like
        Torque that the transducer reads, N·m.
    form : {"consistent", "published"}
        Which equations.

    Returns
    -------
    AdditionalTorque
        Parts and total in N·m, of the torque's shape.

    Raises
    ------
    InputError
        If ``form`` is unknown.

    References
    ----------
    Z. Yu, Y. Zhang, Torque Measurement of High-Precision Reducer for Industrial Robot, Journal of
    Sensors, 2021, equations 1-15.

    Examples
    --------
    >>> chain = Chain(0.03, 0.0, 0.2, 79e9, 0.015, 2e-5, 1e-4, 5e7, 3.6e5, 1.25e4)
    >>> parts = additional_torque(chain, [0.0, 25.0, 50.0])
    >>> parts.total_nm.round(3)
    array([0.05 , 0.182, 0.333])
    """
    return AdditionalTorque(*(np.asarray(part) for part in _parts(chain, torque_nm, form)))


def _parts(chain: Chain, torque_nm: ArrayLike, form: Form) -> tuple[NDArray[Any], ...]:
    """Return parts and total for real or complex parameters, which carry a derivative."""
    _check_form(form)
    torque = np.asarray(torque_nm)
    offset, radius = chain.coaxiality_error_m, chain.shaft_radius_m
    strain, friction = chain.strain_coefficient_n_per_m, chain.elastic_coefficient_n_per_rad
    angle, length = chain.angular_misalignment_rad, chain.length_m
    stiffness = chain.radial_stiffness_n_per_m
    rigidity = _rigidity(chain)
    offset_by_torque = torque / (radius * strain)
    projection = torque * (np.cos(angle) - 1.0)
    if form == "consistent":
        bearing = 32.0 * friction * length * torque * (offset + offset_by_torque) / rigidity
        parallel = stiffness * length * (offset + offset_by_torque)
        angular = projection + torque * np.sin(angle) * length / radius
        return bearing, parallel, angular, bearing + parallel + angular
    linear = 32.0 * length * friction * offset * torque / rigidity
    quadratic = torque * offset_by_torque / rigidity
    parallel = stiffness * length * (offset + strain * torque / radius)
    angular = projection + torque * np.cos(angle) * length / radius
    total = linear + quadratic + parallel + angular
    return linear + 32.0 * length * quadratic, parallel, angular, total


def _rigidity(chain: Chain) -> NDArray[Any]:
    """Return 32 times the torsional rigidity of the shaft: G π (D⁴ − d⁴), N·m²."""
    moment = polar_moment(chain.outer_diameter_m, chain.inner_diameter_m)
    return np.asarray(32.0 * moment * chain.shear_modulus_pa)


def _check_form(form: Form) -> None:
    if form not in ("consistent", "published"):
        raise InputError(Message("form {form!r}", form), "'consistent' or 'published'")


def coefficients(chain: Chain, *, form: Form = "consistent") -> Coefficients:
    """Return the exact coefficients of T′ = c₀ + c₁ T + c₂ T².

    Parameters
    ----------
    chain : Chain
        Geometry, misalignments and coefficients.
    form : {"consistent", "published"}
        Form of the equations, see `additional_torque`.

    Returns
    -------
    Coefficients
        c₀ in N·m, c₁, c₂ in 1/(N·m).

    Examples
    --------
    >>> chain = Chain(0.03, 0.0, 0.2, 79e9, 0.015, 2e-5, 1e-4, 5e7, 3.6e5, 1.25e4)
    >>> round(coefficients(chain).constant_nm, 6)
    0.05
    """
    _check_form(form)
    length, radius, angle = chain.length_m, chain.shaft_radius_m, chain.angular_misalignment_rad
    strain, stiffness = chain.strain_coefficient_n_per_m, chain.radial_stiffness_n_per_m
    rigidity = float(_rigidity(chain))
    friction = 32.0 * chain.elastic_coefficient_n_per_rad * length / rigidity
    constant = stiffness * length * chain.coaxiality_error_m
    linear = friction * chain.coaxiality_error_m + (np.cos(angle) - 1.0)
    if form == "consistent":
        linear += stiffness * length / (radius * strain) + np.sin(angle) * length / radius
        quadratic = friction / (radius * strain)
    else:
        linear += stiffness * length * strain / radius + np.cos(angle) * length / radius
        quadratic = 1.0 / (radius * strain * rigidity)
    return Coefficients(float(constant), float(linear), float(quadratic))


def sensitivities(
    chain: Chain, torque_nm: ArrayLike, *, form: Form = "consistent"
) -> dict[str, Sensitivity]:
    """Return the sensitivities of the additional torque to each parameter and to the torque.

    They are complex-step derivatives, which are exact to rounding and need no choice of a step.

    Parameters
    ----------
    chain : Chain
        Parameters at which the derivatives are taken.
    torque_nm : array_like
        Torques, N·m.
    form : {"consistent", "published"}
        Which equations.

    Returns
    -------
    dict of str to Sensitivity
        One entry for each field of `Chain`, and "torque_nm".

    References
    ----------
    W. Squire, G. Trapp, Using Complex Variables to Estimate Derivatives of Real Functions, SIAM
    Review 40 (1998) 110-112.

    Examples
    --------
    >>> chain = Chain(0.03, 0.0, 0.2, 79e9, 0.015, 2e-5, 1e-4, 5e7, 3.6e5, 1.25e4)
    >>> by_offset = sensitivities(chain, 50.0)["coaxiality_error_m"]
    >>> round(float(by_offset.derivative)), by_offset.unit
    (3073, 'N·m/m')
    """
    torque = np.asarray(torque_nm, dtype=np.float64)
    result: dict[str, Sensitivity] = {}
    for field in fields(chain):
        value = getattr(chain, field.name)
        step = _STEP * (abs(value) or 1.0)
        shifted: Any = {field.name: complex(value, step)}
        total = _parts(replace(chain, **shifted), torque, form)[3]
        derivative = np.broadcast_to(np.imag(total) / step, torque.shape)
        result[field.name] = Sensitivity(np.array(derivative), _UNITS[field.name])
    total = _parts(chain, torque + 1j * _STEP, form)[3]
    result["torque_nm"] = Sensitivity(np.asarray(np.imag(total) / _STEP), _UNITS["torque_nm"])
    return result
