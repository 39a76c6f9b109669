"""Fit of Coulomb, viscous and Stribeck friction to mean torques, with uncertainties."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar, nnls
from scipy.special import fdtrc

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.units import RAD_S_PER_RPM

Form = Literal["coulomb", "coulomb-viscous", "coulomb-stribeck", "coulomb-viscous-stribeck"]
FORMS: dict[str, tuple[str, ...]] = {
    "coulomb": ("coulomb",),
    "coulomb-viscous": ("coulomb", "viscous"),
    "coulomb-stribeck": ("coulomb", "stribeck", "stribeck_speed"),
    "coulomb-viscous-stribeck": ("coulomb", "viscous", "stribeck", "stribeck_speed"),
}
"""Parameters of each form, the simplest first."""

SUPPORTED = 3.0
"""A part is supported if it exceeds this many standard uncertainties."""
CHANCE = 0.001
"""Probability below which the means' errors don't explain the scatter about a fit."""


@dataclass(frozen=True)
class Estimate:
    """A parameter and its standard uncertainty, in the unit of the field that holds it."""

    value: float
    standard_uncertainty: float


@dataclass(frozen=True, eq=False)
class FrictionFit:
    """Parts of the friction torque in one direction of rotation.

    Parameters
    ----------
    form : str
        The parts of the fit, one of `FORMS`.
    coulomb_nm : Estimate
        Torque that doesn't depend on speed, N·m.
    viscous_nm_s_per_rad : Estimate
        Torque per speed, N·m·s/rad; 0 where the form has none.
    stribeck_nm : Estimate
        Torque at creeping speed above the Coulomb torque, N·m; 0 without it.
    stribeck_speed_rpm : Estimate or None
        Speed over which the Stribeck part decays, 1/min; None where the form has none.
    exponent : int
        Exponent δ of the Stribeck part.
    residual_nm : float
        Standard deviation of the mean torques about the fit, N·m (weighted by their points).
    degrees_of_freedom : int
        Of the residual.
    covariance : array of float, shape (p, p)
        Covariance of the parameters in the order of ``FORMS[form]``, units as above but the
        Stribeck speed in rad/s.
    """

    form: Form
    coulomb_nm: Estimate
    viscous_nm_s_per_rad: Estimate
    stribeck_nm: Estimate
    stribeck_speed_rpm: Estimate | None
    exponent: int
    residual_nm: float
    degrees_of_freedom: int
    covariance: NDArray[np.float64]

    def torque(self, speed_rpm: ArrayLike) -> NDArray[np.float64]:
        """Return the friction torque at speeds in 1/min, N·m, with the sign of the speed."""
        speed = np.asarray(speed_rpm, dtype=np.float64)
        basis, _ = self._basis(np.abs(speed) * RAD_S_PER_RPM)
        linear = np.array([part.value for part in self.parts.values()])
        return np.asarray(np.sign(speed) * (basis @ linear), dtype=np.float64)

    def standard_uncertainty(self, speed_rpm: ArrayLike) -> NDArray[np.float64]:
        """Return the standard uncertainty of the fitted curve at speeds in 1/min, N·m."""
        speed = np.atleast_1d(np.asarray(speed_rpm, dtype=np.float64))
        basis, slope = self._basis(np.abs(speed) * RAD_S_PER_RPM)
        jacobian = basis
        if self.stribeck_speed_rpm is not None:
            jacobian = np.column_stack([basis, self.stribeck_nm.value * slope])
        variance = np.einsum("ij,jk,ik->i", jacobian, self.covariance, jacobian)
        return np.asarray(np.sqrt(variance), dtype=np.float64)

    @property
    def parts(self) -> dict[str, Estimate]:
        """The linear parts of the form."""
        every = (self.coulomb_nm, self.viscous_nm_s_per_rad, self.stribeck_nm)
        named = dict(zip(("coulomb", "viscous", "stribeck"), every, strict=True))
        return {name: named[name] for name in _linear_parts(self.form)}

    def _basis(
        self, speed_rad_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the linear part of the form at speeds, and its derivatives."""
        speed = 1.0
        if self.stribeck_speed_rpm is not None:
            speed = self.stribeck_speed_rpm.value * RAD_S_PER_RPM
        return _basis(speed_rad_s, _linear_parts(self.form), speed, self.exponent)


def _linear_parts(form: str) -> tuple[str, ...]:
    return tuple(name for name in FORMS[form] if name != "stribeck_speed")


def fit_friction(
    speed_rpm: NDArray[np.float64],
    torque_nm: NDArray[np.float64],
    points: NDArray[np.int64],
    *,
    exponent: Literal[1, 2] = 2,
    form: Form | Literal["best"] = "best",
    resolution_nm: float = 0.0,
    error_nm: float = 0.0,
    error_freedom: float = np.inf,
) -> FrictionFit:
    """Fit the parts of friction to mean torques of one direction.

    All parts are at least 0, and a part that the fit sets to 0 is removed: the fit's form states
    which parts remain. For a given Stribeck speed the fit is linear and solved by non-negative
    least squares; the Stribeck speed is searched between the smallest and the largest speed.
    Uncertainties follow from the residual. ``"best"`` only chooses a form whose Stribeck speed is
    within these limits and whose parts all exceed three standard uncertainties: within a short
    range of speeds, large viscous and Stribeck parts can cancel. It prefers forms whose residuals
    are explained by the errors of the means.

    Parameters
    ----------
    speed_rpm : array of float, shape (k,)
        Speeds above 0, in 1/min.
    torque_nm : array of float, shape (k,)
        Mean torques that oppose the motion, in N·m.
    points : array of int, shape (k,)
        Number of points in each mean: its weight.
    exponent : {1, 2}
        Exponent of the Stribeck part.
    form : str
        One of `FORMS`, or ``"best"`` by the corrected Akaike information criterion.
    resolution_nm : float
        Last place of the torques.
    error_nm, error_freedom : float
        Standard error of a mean of the usual number of points by repeats or windows, 0 if unknown;
        and its degrees of freedom.
    """
    names = list(FORMS) if form == "best" else [form]
    names = [name for name in names if speed_rpm.size > len(FORMS[name])]
    if not names:
        raise InputError(
            Message("{size} speeds", speed_rpm.size),
            Message("at least {count} for the form {form}", len(FORMS[form]) + 1, form),
        )
    speed = speed_rpm * RAD_S_PER_RPM
    weight = points / points.mean()
    solutions = [_solve(speed, torque_nm, weight, name, exponent) for name in names]
    # The residuals can't show a scatter below the resolution.
    least = resolution_nm**2 / 12.0
    fits = [_described(solution, speed, weight, exponent, least) for solution in solutions]
    candidates = [k for k, fit in enumerate(fits) if solutions[k].inside and _supported(fit)]
    if error_nm:
        error_nm = float(np.hypot(error_nm, least**0.5))
    within = [k for k in candidates if _explained(fits[k], error_nm, error_freedom)]
    candidates = within or candidates
    best = min(
        candidates if form == "best" and candidates else [0],
        key=lambda k: _information(solutions[k].squares, speed.size, len(FORMS[fits[k].form])),
    )
    return fits[best]


def _supported(fit: FrictionFit) -> bool:
    """Return whether each part of a fit is clearly above 0."""
    return all(part.value > SUPPORTED * part.standard_uncertainty for part in fit.parts.values())


def _explained(fit: FrictionFit, error_nm: float, error_freedom: float) -> bool:
    """Return whether the errors of the means explain the residuals of a fit (F-test)."""
    if error_nm == 0.0:
        return True
    ratio = (fit.residual_nm / error_nm) ** 2
    return bool(fdtrc(fit.degrees_of_freedom, min(error_freedom, 1e6), ratio) > CHANCE)


@dataclass(frozen=True, eq=False)
class _Solution:
    """Parameters of one form: the linear ones, the Stribeck speed in rad/s, and the residuals."""

    form: str
    linear: NDArray[np.float64]
    stribeck_speed: float
    squares: float
    inside: bool


def _basis(
    speed: NDArray[np.float64], names: tuple[str, ...], stribeck_speed: float, exponent: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the columns of the linear parts, and the last one's derivative by Stribeck speed."""
    ratio = (speed / stribeck_speed) ** exponent
    decay = np.exp(-ratio)
    columns = {"coulomb": np.ones_like(speed), "viscous": speed, "stribeck": decay}
    slope = decay * exponent * ratio / stribeck_speed
    return np.stack([columns[name] for name in names], axis=-1), slope


def _solve(
    speed: NDArray[np.float64],
    torque: NDArray[np.float64],
    weight: NDArray[np.float64],
    form: str,
    exponent: int,
) -> _Solution:
    """Return the best fit of one form, or of the simpler one if a part of it vanishes."""
    names = _linear_parts(form)
    root = np.sqrt(weight)

    def at(stribeck_speed: float) -> tuple[NDArray[np.float64], float]:
        """Return the linear parts, none below 0, and the squares left, at a Stribeck speed."""
        basis, _ = _basis(speed, names, stribeck_speed, exponent)
        scale = np.abs(basis).max(axis=0)
        solution, distance = nnls(basis / scale * root[:, None], torque * root)
        return solution / scale, float(distance) ** 2

    def distance(log_speed: float) -> float:
        return at(float(np.exp(log_speed)))[1]

    stribeck_speed, inside = 1.0, True
    if "stribeck" in names:
        grid = np.linspace(np.log(speed.min()), np.log(speed.max()), 80)
        start = int(np.argmin([distance(value) for value in grid]))
        inside = 0 < start < grid.size - 1
        bounds = (grid[max(start - 1, 0)], grid[min(start + 1, grid.size - 1)])
        minimum = minimize_scalar(
            distance, bounds=bounds, method="bounded", options={"xatol": 1e-9}
        )
        stribeck_speed = float(np.exp(minimum.x))
    linear, squares = at(stribeck_speed)
    present = {name for name, value in zip(names, linear, strict=True) if value > 0} | {"coulomb"}
    if present != set(names):
        simpler = next(
            name for name, parts in FORMS.items() if set(parts) - {"stribeck_speed"} == present
        )
        return _solve(speed, torque, weight, simpler, exponent)
    return _Solution(form, linear, stribeck_speed, squares, inside)


def _information(squares: float, n: int, parameters: int) -> float:
    """Corrected Akaike information criterion, up to a constant (Hurvich and Tsai, 1989)."""
    k = parameters + 1  # and the variance
    correction = 2.0 * k * (k + 1) / (n - k - 1) if n > k + 1 else np.inf
    return float(n * np.log(max(squares, 1e-300) / n) + 2.0 * k + correction)


def _described(
    fit: _Solution,
    speed: NDArray[np.float64],
    weight: NDArray[np.float64],
    exponent: int,
    least_variance: float,
) -> FrictionFit:
    """Return a solution's parameters with their standard uncertainties."""
    names = FORMS[fit.form]
    linear_names = _linear_parts(fit.form)
    basis, slope = _basis(speed, linear_names, fit.stribeck_speed, exponent)
    jacobian = basis
    values = dict(zip(linear_names, fit.linear, strict=True))
    if "stribeck_speed" in names:
        jacobian = np.column_stack([basis, values["stribeck"] * slope])
    freedom = speed.size - len(names)
    variance = max(fit.squares / freedom, least_variance)
    scale = np.abs(jacobian).max(axis=0)
    scaled = jacobian / scale
    normal = scaled.T @ (weight[:, None] * scaled)
    covariance = variance * np.linalg.pinv(normal, hermitian=True) / np.outer(scale, scale)
    sigma = dict(zip(names, np.sqrt(np.diag(covariance)), strict=True))

    def estimate(name: str) -> Estimate:
        return Estimate(float(values.get(name, 0.0)), float(sigma.get(name, 0.0)))

    return FrictionFit(
        form=fit.form,  # type: ignore[arg-type] # a key of FORMS
        coulomb_nm=estimate("coulomb"),
        viscous_nm_s_per_rad=estimate("viscous"),
        stribeck_nm=estimate("stribeck"),
        stribeck_speed_rpm=Estimate(
            fit.stribeck_speed / RAD_S_PER_RPM, float(sigma["stribeck_speed"]) / RAD_S_PER_RPM
        )
        if "stribeck_speed" in names
        else None,
        exponent=exponent,
        residual_nm=float(np.sqrt(variance)),
        degrees_of_freedom=freedom,
        covariance=covariance,
    )
