"""No-load friction torque against speed: repeats, spread, and Coulomb, viscous and Stribeck parts.

The friction of a rotating drive at speed ω is, opposing the motion,

    T(ω) = sign(ω)·[T_C + T_S·exp(−(|ω|/ω_S)^δ)] + b·ω

with Coulomb torque T_C, Stribeck torque T_S (breakaway minus Coulomb), Stribeck speed ω_S,
exponent δ (1 or 2) and viscous coefficient b; Armstrong-Hélouvry, Dupont and Canudas de Wit,
Automatica 30 (1994) 1083, eq. 7.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.preparation import BLOCKS, Samples
from torquebench.reducers.quantities import (
    Finding,
    LimitedQuantity,
    ResultQuantity,
    budget,
    unsteady_temperature,
)
from torquebench.reducers.running.friction_fit import FORMS, Form, FrictionFit, fit_friction
from torquebench.reducers.running.points import SpeedPoints, speed_points
from torquebench.reducers.saturation import missed_speed
from torquebench.uncertainty import BudgetLine, Shared

if TYPE_CHECKING:
    from torquebench.reducers.description import DataSheetLimits

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FrictionCurve:
    """Friction torque at each speed: mean and spread over the repeats and over up and down.

    Parameters
    ----------
    speed_rpm : array of float, shape (k,)
        Mean speed of each step in 1/min, clockwise positive, rising.
    torque_nm : array of float, shape (k,)
        Mean torque in N·m.
    spread_nm : array of float, shape (k,)
        Standard deviation of the single points in N·m; NaN where a speed occurs once.
    standard_error_nm : array of float, shape (k,)
        Standard error of the mean in N·m, from the spread pooled over all speeds, or from the
        windows of a log; NaN without either.
    points : array of int, shape (k,)
        Number of points in each mean.
    up_minus_down_nm : array of float, shape (k,)
        Mean while the speed rises minus mean while it falls, in N·m; NaN where one is missing.
    """

    speed_rpm: Floats
    torque_nm: Floats
    spread_nm: Floats
    standard_error_nm: Floats
    points: NDArray[np.int64]
    up_minus_down_nm: Floats


@dataclass(frozen=True, eq=False)
class FrictionResult:
    """No-load friction of a reducer.

    Parameters
    ----------
    curve : FrictionCurve
        Mean and spread at each speed.
    clockwise, counter_clockwise : FrictionFit or None
        Parts of the friction in each direction; None where there are too few speeds.
    systematic_uncertainty_nm : float
        Standard uncertainty that all torques have in common (zero, offset, reference,
        compensation), N·m.
    worst_relative_uncertainty : float
        Largest expanded uncertainty (k = 2) of a mean, as a share of that mean; infinite where no
        mean's uncertainty is known.
    """

    curve: FrictionCurve
    clockwise: FrictionFit | None
    counter_clockwise: FrictionFit | None
    systematic_uncertainty_nm: float
    worst_relative_uncertainty: float
    findings: tuple[Finding, ...] = ()

    def quantities(self) -> tuple[ResultQuantity, ...]:
        """Return the parts of the friction under their names, for tables and reports."""
        rows = []
        for name, fit in (
            ("clockwise", self.clockwise),
            ("counter-clockwise", self.counter_clockwise),
        ):
            if fit is None:
                continue
            parts = [
                ("coulomb", "Coulomb torque", fit.coulomb_nm, "N·m"),
                ("viscous", "viscous coefficient", fit.viscous_nm_s_per_rad, "N·m·s/rad"),
                ("stribeck", "Stribeck torque", fit.stribeck_nm, "N·m"),
            ]
            if fit.stribeck_speed_rpm is not None:
                parts.append(("stribeck_speed", "Stribeck speed", fit.stribeck_speed_rpm, "rpm"))
            for key, title, estimate, unit in parts:
                if estimate.value == 0.0:
                    continue
                scatter = BudgetLine(
                    "scatter about the fit", estimate.standard_uncertainty, fit.degrees_of_freedom
                )
                # An error of the zero is an error of the Coulomb torque at all speeds.
                size = self.systematic_uncertainty_nm if key == "coulomb" else 0.0
                common = BudgetLine("torque zero", size, shared=Shared.ZEROING)
                rows.append(
                    ResultQuantity(
                        f"{key}_{name.replace('-', '_')}",
                        Message.joined((title, name)),
                        budget(estimate.value, unit, [scatter, common]),
                        fit.form,
                    )
                )
        return tuple(rows)

    def limited(self, _limits: DataSheetLimits) -> Iterator[LimitedQuantity]:
        """Return nothing: data sheets limit no part of the friction."""
        return iter(())

    def require(self, share: float) -> None:
        """Refuse the result where its uncertainty (k = 2) exceeds a stated share of the torque."""
        if not self.worst_relative_uncertainty <= share:
            raise InputError(
                Message(
                    "an expanded uncertainty of {worst_relative_uncertainty:.3g} % of the "
                    "friction torque",
                    100 * self.worst_relative_uncertainty,
                ),
                Message("at most {limit:.3g} %", 100 * share),
                "zero just before the sweep, repeat it more often, or use a smaller transducer",
            )


def curve_of(points: SpeedPoints) -> FrictionCurve:
    """Average points at each step of speed."""
    return _curve(points.speed, points.torque, points.branch, points.group, points.own_nm)


def _curve(
    speed: Floats, torque: Floats, turn: Floats, group: NDArray[np.int64], own_nm: Floats
) -> FrictionCurve:
    """Average points in groups of one speed: mean, spread, and what turning up or down changes.

    Where no group has two points, the standard error comes from the points' own uncertainty.
    """
    count = np.bincount(group)
    mean = np.bincount(group, weights=torque) / count
    squares = np.bincount(group, weights=(torque - mean[group]) ** 2)
    freedom = count - 1
    spread = np.full(count.size, np.nan)
    spread[freedom > 0] = np.sqrt(squares[freedom > 0] / freedom[freedom > 0])
    total = int(freedom.sum())
    pooled = float(np.sqrt(squares.sum() / total)) if total else np.nan
    error = pooled / np.sqrt(count)
    if not total:
        error = np.sqrt(np.bincount(group, weights=own_nm**2)) / count
    mean_speed = np.bincount(group, weights=speed) / count
    order = np.argsort(mean_speed, kind="stable")
    change = _mean_where(torque, group, turn > 0, count.size)
    change = change - _mean_where(torque, group, turn < 0, count.size)
    return FrictionCurve(
        speed_rpm=mean_speed[order],
        torque_nm=mean[order],
        spread_nm=spread[order],
        standard_error_nm=error[order],
        points=count[order].astype(np.int64),
        up_minus_down_nm=change[order],
    )


def _mean_where(
    values: Floats, group: NDArray[np.int64], where: NDArray[np.bool_], size: int
) -> Floats:
    """Return each group's mean over the chosen rows; NaN for a group without any."""
    count = np.bincount(group[where], minlength=size)
    total = np.bincount(group[where], weights=values[where], minlength=size)
    mean = np.full(size, np.nan)
    mean[count > 0] = total[count > 0] / count[count > 0]
    return mean


def evaluate_friction(
    speed_rpm: ArrayLike,
    torque_nm: ArrayLike,
    branch: ArrayLike | None = None,
    *,
    systematic_uncertainty_nm: float = 0.0,
    exponent: Literal[1, 2] = 2,
    form: Form | Literal["best"] = "best",
    tolerance_rpm: float | None = None,
    temperature_c: ArrayLike | None = None,
    demanded_rpm: ArrayLike | None = None,
    zeroed: bool = False,
    row: ArrayLike | None = None,
    keep_outliers: bool = False,
) -> FrictionResult:
    r"""Evaluate no-load friction: mean and spread at each speed, and the parts of friction.

    A log is averaged over its steady windows, a ramp over parts of it.

    Parameters
    ----------
    speed_rpm, torque_nm, branch, tolerance_rpm
        Mean speed of each point in 1/min, clockwise positive; torque that keeps the input turning,
        in N·m, with the sign of the speed; +1 while \|speed\| rises, -1 while it falls; largest
        range of the speeds of one step (by default 0.5 % of the largest \|speed\| and 5 % of
        their own). Points at rest (speed 0) are left out.
    systematic_uncertainty_nm : float, default 0
        Standard uncertainty that all torques have in common, in N·m; averaging doesn't lower it.
    exponent : {1, 2}, default 2
        Exponent δ of the Stribeck part: 2 Gaussian, 1 exponential.
    form : str, default "best"
        One of ``FORMS``, or ``"best"``: the one with the lowest corrected Akaike information
        criterion, so that a Stribeck part only appears where the points support it.
    temperature_c : array of float, shape (n,), optional
        Temperature of the reducer, °C; a change of more than 2 K is a finding.
    demanded_rpm : array of float, shape (n,), optional
        Commanded speed, by which points are grouped; one that wasn't reached is a finding.
    zeroed : bool
        Whether the torque was zeroed before; otherwise an offset is estimated from both directions
        where it is significant.
    row : array of int, shape (n,), optional
        Number of each sample in its file, for messages.
    keep_outliers : bool
        Evaluate outliers with the others.

    Raises
    ------
    InputError
        Where the columns can't be used, or a torque helps the motion that it should oppose in the
        mean of a direction (a swapped sign).

    Examples
    --------
    >>> speed = np.arange(100.0, 1300.0, 100.0)
    >>> result = evaluate_friction(speed, 0.5 + 0.0002 * speed, form="coulomb-viscous")
    >>> fit = result.clockwise
    >>> round(fit.coulomb_nm.value, 6), round(fit.viscous_nm_s_per_rad.value, 6)
    (0.5, 0.00191)
    """
    if form != "best" and form not in FORMS:
        raise InputError(Message("form {form!r}", form), ", ".join((*FORMS, "best")))
    samples = Samples.of(
        1,
        row=row,
        keep=keep_outliers,
        speed_rpm=speed_rpm,
        torque_nm=torque_nm,
        branch=branch,
        temperature_c=temperature_c,
        demanded_rpm=demanded_rpm,
    )
    points = speed_points(samples, tolerance_rpm=tolerance_rpm, zeroed=zeroed)
    unsteady: tuple[Finding, ...] = ()
    if temperature_c is not None:
        unsteady = unsteady_temperature(
            points.samples["temperature_c"],
            "warm up until the temperature is steady, or evaluate as no-load torque at a "
            "reference temperature",
        )
    missed: tuple[Finding, ...] = ()
    if demanded_rpm is not None:
        missed = missed_speed(points.speed, points.samples["demanded_rpm"])
    friction = friction_of(
        points, systematic_uncertainty_nm=systematic_uncertainty_nm, exponent=exponent, form=form
    )
    return FrictionResult(
        **{**vars(friction), "findings": (*points.findings, *unsteady, *missed, *friction.findings)}
    )


def friction_of(
    points: SpeedPoints,
    *,
    systematic_uncertainty_nm: float = 0.0,
    exponent: Literal[1, 2] = 2,
    form: Form | Literal["best"] = "best",
) -> FrictionResult:
    """Evaluate the friction of steady points."""
    curve = curve_of(points)
    systematic = float(np.hypot(systematic_uncertainty_nm, points.offset_u_nm))
    fits: dict[int, FrictionFit | None] = {}
    findings: list[Finding] = []
    for sign, name in ((1, "clockwise"), (-1, "counter-clockwise")):
        side = np.sign(curve.speed_rpm) == sign
        fits[sign] = None
        if np.any(side):
            fits[sign] = _fit_of_side(curve, side, sign, name, exponent, form, points)
            if fits[sign] is None:
                findings.append(
                    Finding(
                        "few speeds",
                        Message(
                            "{count} speeds {name}: too few for the parts of the friction",
                            int(np.count_nonzero(side)),
                            name,
                        ),
                        "measure at five speeds or more in each direction",
                    )
                )
    error = np.hypot(np.nan_to_num(curve.standard_error_nm), systematic)
    error = np.where(error > 0.0, error, np.inf)
    with np.errstate(divide="ignore"):
        relative = 2.0 * error / np.abs(curve.torque_nm)
    return FrictionResult(
        curve=curve,
        clockwise=fits[1],
        counter_clockwise=fits[-1],
        systematic_uncertainty_nm=systematic,
        worst_relative_uncertainty=float(np.max(relative)),
        findings=tuple(findings),
    )


def _fit_of_side(
    curve: FrictionCurve,
    side: NDArray[np.bool_],
    sign: int,
    name: str,
    exponent: Literal[1, 2],
    form: Form | Literal["best"],
    points: SpeedPoints,
) -> FrictionFit | None:
    """Fit the friction of one direction of rotation; None if there are too few speeds."""
    speed, torque, count = curve.speed_rpm[side], curve.torque_nm[side], curve.points[side]
    error, freedom = _error_of_means(curve, side)
    if points.ramp is not None:
        here = np.sign(points.ramp[0]) == sign
        speed, torque = points.ramp[0][here], points.ramp[1][here] - points.offset_nm
        count = np.ones(speed.size, dtype=np.int64)
        error, freedom = 0.0, np.inf
    torque = sign * torque
    if torque.mean() < 0:
        raise InputError(
            Message(
                "{name} torques of {sign:.4g} N·m in the mean help the motion",
                name,
                sign * torque.mean(),
            ),
            "a torque with the sign of the speed",
            "check the signs of torque and speed; an offset of the torque is found if both "
            "directions are driven",
        )
    smallest = 3 if form == "best" else len(FORMS[form]) + 1
    if torque.size < smallest:
        return None
    return fit_friction(
        np.abs(speed),
        torque,
        count,
        exponent=exponent,
        form=form,
        resolution_nm=points.resolution_nm,
        error_nm=error,
        error_freedom=freedom,
    )


def _error_of_means(curve: FrictionCurve, side: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the standard error of a mean of the typical number of points; 0 if unknown."""
    known = curve.standard_error_nm[side]
    if not np.all(np.isfinite(known)):
        return 0.0, np.inf
    count = curve.points[side]
    repeats = float(curve.points.sum() - curve.points.size)
    error = float(np.sqrt(np.mean(known**2 * count) / count.mean()))
    return error, repeats or float((BLOCKS - 1) * count.size)
