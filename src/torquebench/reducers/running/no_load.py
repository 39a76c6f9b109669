"""No-load running torque: the input torque at constant speed with a free output."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.preparation import finite_columns, labels
from torquebench.reducers.quantities import (
    Contribution,
    Finding,
    LimitedQuantity,
    ResultQuantity,
    budget,
    refuse,
    unsteady_temperature,
)
from torquebench.reducers.running.friction import FrictionCurve, FrictionResult, evaluate_friction
from torquebench.reducers.running.no_load_points import (
    NoLoadPoint,
    Steps,
    both_directions,
    points_of,
    scatter_findings,
    scatter_of,
)
from torquebench.reducers.running.tare import Tare
from torquebench.reducers.saturation import missed_speed
from torquebench.reducers.torque_uncertainty import KnownTorque, TorqueUncertainty, over
from torquebench.uncertainty import Budget

if TYPE_CHECKING:
    from torquebench.reducers.description import DataSheetLimits

__all__ = ["NoLoadPoint", "NoLoadResult", "TorqueUncertainty", "evaluate_no_load"]

LEAST_RANGE_K = 1.0
"""Change of temperature below which its effect isn't evaluated."""


@dataclass(frozen=True, eq=False)
class NoLoadResult:
    """No-load running torque of a reducer.

    Parameters
    ----------
    points : tuple of NoLoadPoint
        At rising speed, negative speeds first.
    means : tuple of NoLoadPoint
        Mean of both directions where both were driven, at rising speed: errors of the zero, and of
        the zero over speed, cancel.
    friction : FrictionResult
        Curve, and Coulomb, viscous and Stribeck parts in each direction.
    temperature_coefficient : Budget or None
        Relative change of the torque per kelvin, %/K; None where the temperature hardly changed.
    speed_rpm, torque_nm, temperature_c, repeat, branch : array, shape (n,)
        The evaluated points (after the correction to a reference temperature, if requested), for
        figures with all repeats.
    findings : tuple of Finding
    """

    points: tuple[NoLoadPoint, ...]
    means: tuple[NoLoadPoint, ...]
    friction: FrictionResult
    temperature_coefficient: Budget | None
    speed_rpm: NDArray[np.float64]
    torque_nm: NDArray[np.float64]
    temperature_c: NDArray[np.float64]
    repeat: NDArray[np.int64]
    branch: NDArray[np.int64]
    findings: tuple[Finding, ...]

    def quantities(self) -> tuple[ResultQuantity, ...]:
        """Return the values under their names, for tables and reports."""
        rows = [
            ResultQuantity(each.key, each.title, each.torque)
            for each in (*self.means, *self.points)
        ]
        rows += self.friction.quantities()
        if self.temperature_coefficient is not None:
            rows.append(
                ResultQuantity(
                    "temperature_coefficient",
                    "change of torque with temperature",
                    self.temperature_coefficient,
                )
            )
        return tuple(rows)

    def repeat_range_nm(self, point: NoLoadPoint) -> float | None:
        """Return the range of the repeats' means at a point, N·m; None of a single repeat."""
        index = _nearest(self.friction.curve, self.speed_rpm)
        place = int(np.argmin(np.abs(self.friction.curve.speed_rpm - point.speed_rpm)))
        here = index == place
        torque, repeat, turn = self.torque_nm[here], self.repeat[here], self.branch[here]
        means = []
        for number in np.unique(repeat):
            of = repeat == number
            # as in the point's mean, the inertia's torque cancels between the branches
            means.append(np.mean([torque[of & (turn == each)].mean() for each in set(turn[of])]))
        return float(np.ptp(means)) if len(means) > 1 else None

    def limited(self, limits: DataSheetLimits) -> Iterator[LimitedQuantity]:
        """Return the values that the data sheet limits; those without a limit may be left out."""
        for limit in limits.no_load:
            for point in self.points:
                if abs(abs(point.speed_rpm) - limit.speed_rpm) <= 0.02 * limit.speed_rpm:
                    title = Message("no-load torque at {speed:.0f} rpm", point.speed_rpm)
                    torque = point.magnitude()
                    yield LimitedQuantity(point.key, title, torque, upper=limit.torque_nm)


def evaluate_no_load(
    speed_rpm: ArrayLike,
    torque_nm: ArrayLike,
    *,
    nominal_rpm: ArrayLike | None = None,
    repeat: ArrayLike | None = None,
    branch: ArrayLike | None = None,
    series: ArrayLike | None = None,
    temperature_c: ArrayLike | None = None,
    uncertainty: KnownTorque | None = None,
    tare: Tare | None = None,
    tolerance_rpm: float | None = None,
    reference_temperature_c: float | None = None,
    largest_share: float | None = None,
) -> NoLoadResult:
    """Evaluate steady no-load torques over speed.

    The uncertainty of a mean has a part from the scatter within a series and one common to all
    speeds of a series (a new zero, re-seating after it, warming up): a two-way analysis of
    variance. The torque of inertia cancels in the mean of rising and falling speeds, an error of
    the zero in the mean of both directions.

    Parameters
    ----------
    speed_rpm, torque_nm : array of float, shape (n,)
        Mean of each steady point: input speed (clockwise positive) and torque with its sign.
    nominal_rpm : array of float, shape (n,), optional
        Commanded speed, by which points are grouped and named; a deviation from it counts as
        missed; by default points within `tolerance_rpm` are one step.
    repeat : array of int, shape (n,), optional
        Number of the repeat; all 1 by default.
    branch : array of int, shape (n,), optional
        +1 while the speed's magnitude rises, -1 while it falls, 0 unknown.
    series : array of int, shape (n,), optional
        Points with one zero before them; by default one direction of one repeat.
    temperature_c : array of float, shape (n,), optional
        Of the reducer.
    uncertainty : TorqueUncertainty or sequence of them, optional
        Of the torque: the same at all points, or of each.
    tare : Tare, optional
        Of an empty run, to be subtracted; then its uncertainty replaces the limits of the effects
        of speed and drag.
    tolerance_rpm : float, optional
        Largest gap between points of one speed; by default 0.2 % of the largest.
    reference_temperature_c : float, optional
        Bring all torques to this temperature by the coefficient that the data show.
    largest_share : float, optional
        Refuse the result where U exceeds this share of the torque at any speed.

    Raises
    ------
    InputError
        Where the columns can't be used, a point is at rest, a torque helps the motion (a swapped
        sign), or the uncertainty exceeds `largest_share`.

    Examples
    --------
    >>> speed = np.tile([100.0, 300.0, 500.0, 700.0], 3)
    >>> noise = 1e-3 * np.cos(np.arange(12.0) ** 2)
    >>> found = evaluate_no_load(speed, 0.1 + 1e-4 * speed + noise, repeat=np.repeat([1, 2, 3], 4))
    >>> [round(point.torque.value, 2) for point in found.points]
    [0.11, 0.13, 0.15, 0.17]
    """
    speed, torque = finite_columns(1, speed_rpm=speed_rpm, torque_nm=torque_nm)
    number = labels(repeat, speed.size, 1.0, "repeat")
    turn = labels(branch, speed.size, 0.0, "branch")
    zeroed = labels(series, speed.size, 0.0, "series")
    if series is None:
        zeroed = np.unique(np.column_stack([number, np.sign(speed)]), axis=0, return_inverse=True)[
            1
        ].astype(np.float64)
    missed: tuple[Finding, ...] = ()
    warmth = np.full(speed.size, np.nan)
    if temperature_c is not None:
        (warmth,) = finite_columns(speed.size, temperature_c=temperature_c)
    if nominal_rpm is not None:
        (nominal,) = finite_columns(speed.size, nominal_rpm=nominal_rpm)
        missed = missed_speed(speed, nominal)
        speed = _mean_of_step(speed, nominal)
    if tare is not None:
        torque = torque - np.array([tare.at(each).torque_nm for each in speed])
    known = uncertainty or TorqueUncertainty()
    first = evaluate_friction(speed, torque, turn, tolerance_rpm=tolerance_rpm)
    coefficient = _coefficient(first.curve, speed, torque, warmth)
    effect = ""
    if coefficient is not None:
        change = coefficient.value * np.ptp(warmth)
        effect = Message(", which changes the torque by {value:.2g} %", change)
    findings = unsteady_temperature(
        warmth,
        "warm up until the temperature is steady, or evaluate at a reference temperature",
        effect=effect,
    )
    correction = 0.0
    if reference_temperature_c is not None:
        torque, correction = _at_temperature(torque, warmth, reference_temperature_c, coefficient)
    every = over(known)
    common = float(
        np.linalg.norm([every.zero_nm, every.model_nm, every.mounting_nm, every.loading_nm])
    )
    friction = evaluate_friction(
        speed, torque, turn, tolerance_rpm=tolerance_rpm, systematic_uncertainty_nm=common
    )
    names = speed if nominal_rpm is None else nominal
    steps = Steps(
        friction.curve, _nearest(friction.curve, speed), names, torque, zeroed, turn, warmth
    )
    scatter = scatter_of(steps, friction)
    points = points_of(steps, scatter, known, tare, correction)
    means = both_directions(points, 0.02 * float(np.max(np.abs(speed))))
    for point in means or points:
        if largest_share is not None:
            refuse(point.torque, largest_share, point.title)
    return NoLoadResult(
        points=points,
        means=means,
        friction=friction,
        temperature_coefficient=coefficient,
        speed_rpm=speed,
        torque_nm=torque,
        temperature_c=warmth,
        repeat=number.astype(np.int64),
        branch=turn.astype(np.int64),
        findings=(*missed, *findings, *scatter_findings(scatter)),
    )


def _mean_of_step(speed: NDArray[np.float64], nominal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean speed of each point's step."""
    step = np.unique(nominal, return_inverse=True)[1]
    return np.asarray((np.bincount(step, weights=speed) / np.bincount(step))[step])


def _at_temperature(
    torque: NDArray[np.float64],
    warmth: NDArray[np.float64],
    reference_c: float,
    coefficient: Budget | None,
) -> tuple[NDArray[np.float64], float]:
    """Return torques converted to a temperature, and the conversion's relative uncertainty."""
    if coefficient is None:
        raise InputError(
            "no visible effect of the temperature",
            Message(
                "temperatures over {least_range_k:g} K or more at repeated speeds", LEAST_RANGE_K
            ),
            "leave the reference temperature out",
        )
    distance = warmth - reference_c
    relative = 0.01 * coefficient.standard_uncertainty * abs(float(distance.mean()))
    return torque * np.exp(-0.01 * coefficient.value * distance), relative


def _nearest(curve: FrictionCurve, speed: NDArray[np.float64]) -> NDArray[np.intp]:
    return np.asarray(np.argmin(np.abs(speed[:, None] - curve.speed_rpm), axis=1), dtype=np.intp)


def _coefficient(
    curve: FrictionCurve,
    speed: NDArray[np.float64],
    torque: NDArray[np.float64],
    warmth: NDArray[np.float64],
) -> Budget | None:
    """Return the relative change of torque per kelvin at equal speeds, %/K."""
    if np.any(np.isnan(warmth)):
        return None
    index = _nearest(curve, speed)
    count = np.bincount(index, minlength=curve.speed_rpm.size)
    middle = np.bincount(index, weights=warmth, minlength=count.size) / np.maximum(count, 1)
    deviation = warmth - middle[index]
    relative = torque / curve.torque_nm[index] - 1.0
    freedom = speed.size - curve.speed_rpm.size - 1
    squares = float(np.sum(deviation**2))
    if freedom < 2 or np.ptp(deviation) < LEAST_RANGE_K:
        return None
    slope = float(np.sum(deviation * relative)) / squares
    rest = relative - slope * deviation
    error = float(np.sqrt(np.sum(rest**2) / freedom / squares))
    return budget(100.0 * slope, "%/K", [Contribution("scatter", 100.0 * error, freedom)])
