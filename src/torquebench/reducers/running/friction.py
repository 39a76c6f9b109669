"""No-load friction torque against speed: repeats, spread, and Coulomb, viscous and Stribeck parts.

The friction of a rotating drive at speed ω is, opposing the motion,

    T(ω) = sign(ω)·[T_C + T_S·exp(−(|ω|/ω_S)^δ)] + b·ω

with Coulomb torque T_C, Stribeck torque T_S (breakaway minus Coulomb), Stribeck speed ω_S,
exponent δ (1 or 2) and viscous coefficient b; Armstrong-Hélouvry, Dupont and Canudas de Wit,
Automatica 30 (1994) 1083, eq. 7.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.preparation import finite_columns, labels
from torquebench.reducers.quantities import (
    Contribution,
    Finding,
    ResultQuantity,
    budget,
    unsteady_temperature,
)
from torquebench.reducers.running.friction_fit import FORMS, Form, FrictionFit, fit_friction
from torquebench.reducers.saturation import missed_speed
from torquebench.uncertainty import Shared

__all__ = ["FrictionCurve", "FrictionResult", "evaluate_friction", "friction_curve"]


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
        Standard error of the mean in N·m, from the spread pooled over all speeds.
    points : array of int, shape (k,)
        How many points each mean is of.
    up_minus_down_nm : array of float, shape (k,)
        Mean while the speed rises minus mean while it falls, in N·m; NaN where one is missing.
    """

    speed_rpm: NDArray[np.float64]
    torque_nm: NDArray[np.float64]
    spread_nm: NDArray[np.float64]
    standard_error_nm: NDArray[np.float64]
    points: NDArray[np.int64]
    up_minus_down_nm: NDArray[np.float64]


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
        Standard uncertainty that all torques have in common (zero, reference, compensation), N·m.
    worst_relative_uncertainty : float
        Largest expanded uncertainty (k = 2) of a mean, as a share of that mean.
    findings : tuple of Finding
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
                scatter = Contribution(
                    "scatter about the fit", estimate.standard_uncertainty, fit.degrees_of_freedom
                )
                # An error of the zero is an error of the Coulomb torque at all speeds.
                size = self.systematic_uncertainty_nm if key == "coulomb" else 0.0
                common = Contribution("torque zero", size, shared=Shared.ZEROING)
                rows.append(
                    ResultQuantity(
                        f"{key}_{name.replace('-', '_')}",
                        Message.joined((title, name)),
                        budget(estimate.value, unit, [scatter, common]),
                        fit.form,
                    )
                )
        return tuple(rows)

    def require(self, share: float) -> None:
        """Refuse the result where its uncertainty exceeds a stated share of the torque.

        Parameters
        ----------
        share : float
            Largest allowed expanded uncertainty (k = 2) of a mean torque, as a share of it.

        Raises
        ------
        InputError
            Where the uncertainty is larger.
        """
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


def friction_curve(
    speed_rpm: ArrayLike,
    torque_nm: ArrayLike,
    branch: ArrayLike | None = None,
    *,
    tolerance_rpm: float | None = None,
) -> FrictionCurve:
    r"""Average the points of a friction sweep at each speed.

    Parameters
    ----------
    speed_rpm : array of float, shape (n,)
        Mean speed of each point in 1/min, clockwise positive.
    torque_nm : array of float, shape (n,)
        Torque that keeps the input turning, in N·m, with the sign of the speed.
    branch : array of int, shape (n,), optional
        +1 while \|speed\| rises, -1 while it falls.
    tolerance_rpm : float, optional
        Largest gap between points of one speed; by default 0.2 % of the largest \|speed\|.

    Raises
    ------
    InputError
        Where lengths differ, a value isn't finite or there is no point.

    Examples
    --------
    >>> curve = friction_curve([100.0, 200.0, 100.1, 200.1], [1.0, 2.0, 1.2, 2.2])
    >>> curve.torque_nm.round(3).tolist(), curve.spread_nm.round(3).tolist()
    ([1.1, 2.1], [0.141, 0.141])
    """
    speed, torque = finite_columns(1, speed_rpm=speed_rpm, torque_nm=torque_nm)
    turn = labels(branch, speed.size, 0.0, "branch")
    gap = 0.002 * float(np.max(np.abs(speed))) if tolerance_rpm is None else tolerance_rpm
    order = np.argsort(speed, kind="stable")
    label = np.empty(speed.size, dtype=np.intp)
    label[order] = np.cumsum(np.diff(speed[order], prepend=speed[order[0]]) > gap)
    count = np.bincount(label)
    mean = np.bincount(label, weights=torque) / count
    squares = np.bincount(label, weights=(torque - mean[label]) ** 2)
    freedom = count - 1
    spread = np.full(count.size, np.nan)
    spread[freedom > 0] = np.sqrt(squares[freedom > 0] / freedom[freedom > 0])
    total = int(freedom.sum())
    pooled = float(np.sqrt(squares.sum() / total)) if total else np.nan
    return FrictionCurve(
        speed_rpm=np.bincount(label, weights=speed) / count,
        torque_nm=mean,
        spread_nm=spread,
        standard_error_nm=pooled / np.sqrt(count),
        points=count.astype(np.int64),
        up_minus_down_nm=_mean_where(torque, label, turn > 0, count.size)
        - _mean_where(torque, label, turn < 0, count.size),
    )


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
) -> FrictionResult:
    """Evaluate a no-load friction sweep: mean and spread at each speed, and the parts of friction.

    Parameters
    ----------
    speed_rpm, torque_nm, branch, tolerance_rpm
        As for `friction_curve`; points at rest (speed 0) are refused.
    systematic_uncertainty_nm : float, default 0
        Standard uncertainty that all torques have in common, in N·m; averaging doesn't lower it.
    exponent : {1, 2}, default 2
        Exponent δ of the Stribeck part: 2 Gaussian, 1 exponential.
    form : str, default "best"
        One of ``FORMS``, or ``"best"``: the one with the lowest corrected Akaike information
        criterion, so that a Stribeck part only appears where the points ask for it.
    temperature_c : array of float, shape (n,), optional
        Of the reducer; a change of more than 2 K is a finding.
    demanded_rpm : array of float, shape (n,), optional
        Commanded speed; one that wasn't reached is a finding.

    Raises
    ------
    InputError
        Where the columns can't be used, a point is at rest, or a torque helps the motion that it
        should oppose in the mean of a direction (a swapped sign).

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
    curve = friction_curve(speed_rpm, torque_nm, branch, tolerance_rpm=tolerance_rpm)
    if np.any(curve.speed_rpm == 0):
        raise InputError("a point at 0 rpm", "points at which the input turns", "remove it")
    fits: dict[int, FrictionFit | None] = {}
    for sign, name in ((1, "clockwise"), (-1, "counter-clockwise")):
        side = np.sign(curve.speed_rpm) == sign
        fits[sign] = None
        if np.any(side):
            fits[sign] = _fit_of_side(curve, side, sign, name, exponent, form)
    unsteady: tuple[Finding, ...] = ()
    if temperature_c is not None:
        (warmth,) = finite_columns(1, temperature_c=temperature_c)
        unsteady = unsteady_temperature(
            warmth,
            "warm up until the temperature is steady, or evaluate as no-load torque at a "
            "reference temperature",
        )
    error = np.hypot(np.nan_to_num(curve.standard_error_nm), systematic_uncertainty_nm)
    with np.errstate(divide="ignore"):
        relative = 2.0 * error / np.abs(curve.torque_nm)
    return FrictionResult(
        curve=curve,
        clockwise=fits[1],
        counter_clockwise=fits[-1],
        systematic_uncertainty_nm=systematic_uncertainty_nm,
        worst_relative_uncertainty=float(np.max(relative)),
        findings=(*unsteady, *_missed(speed_rpm, demanded_rpm)),
    )


def _missed(speed_rpm: ArrayLike, demanded_rpm: ArrayLike | None) -> tuple[Finding, ...]:
    if demanded_rpm is None:
        return ()
    return missed_speed(*finite_columns(1, speed_rpm=speed_rpm, demanded_rpm=demanded_rpm))


def _fit_of_side(
    curve: FrictionCurve,
    side: NDArray[np.bool_],
    sign: int,
    name: str,
    exponent: Literal[1, 2],
    form: Form | Literal["best"],
) -> FrictionFit | None:
    torque = sign * curve.torque_nm[side]
    if torque.mean() < 0:
        raise InputError(
            Message(
                "{name} torques of {sign:.4g} N·m in the mean help the motion",
                name,
                sign * torque.mean(),
            ),
            "a torque with the sign of the speed",
            "check the signs of torque and speed",
        )
    smallest = 3 if form == "best" else len(FORMS[form]) + 1
    if torque.size < smallest:
        return None
    return fit_friction(
        np.abs(curve.speed_rpm[side]), torque, curve.points[side], exponent=exponent, form=form
    )


def _mean_where(
    values: NDArray[np.float64], label: NDArray[np.intp], where: NDArray[np.bool_], size: int
) -> NDArray[np.float64]:
    count = np.bincount(label[where], minlength=size)
    total = np.bincount(label[where], weights=values[where], minlength=size)
    mean = np.full(size, np.nan)
    mean[count > 0] = total[count > 0] / count[count > 0]
    return mean
