"""No-load running torque: the input torque at constant speed with a free output."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf, sqrt
from typing import TYPE_CHECKING

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
    common_of_both,
    distinct_texts,
    refuse,
    unsteady_temperature,
)
from torquebench.reducers.running.friction import FrictionResult, curve_of, friction_of
from torquebench.reducers.running.points import SpeedPoints, speed_points
from torquebench.reducers.running.tare import Tare
from torquebench.reducers.saturation import missed_speed
from torquebench.reducers.torque_uncertainty import KnownTorque, TorqueUncertainty, over
from torquebench.uncertainty import Budget, BudgetLine, Shared

if TYPE_CHECKING:
    from torquebench.reducers.description import DataSheetLimits

Floats = NDArray[np.float64]
LEAST_RANGE_K = 1.0
"""Smallest range of temperatures from which its effect is evaluated."""
SAME_SPEED = 0.02
"""Largest difference between speeds of both directions that count as equal, as a share of the
larger one."""


@dataclass(frozen=True)
class NoLoadPoint:
    """No-load torque at one speed.

    Parameters
    ----------
    key : str
        Name for programs, unique within a result.
    speed_rpm : float
        Mean input speed, clockwise positive; its magnitude for a mean of both directions.
    torque : Budget
        Torque with the sign of the speed, N·m; its magnitude for a mean of both directions.
    up_minus_down_nm : float
        Mean while the speed rises less mean while it falls; NaN where one is missing.
    temperature_c : float
        Mean; NaN where it wasn't measured.
    nominal_rpm : float
        Speed in the point's name: the commanded one, or the mean.
    both : bool
        Whether the point is the mean of both directions.
    """

    key: str
    speed_rpm: float
    torque: Budget
    up_minus_down_nm: float
    temperature_c: float
    nominal_rpm: float
    both: bool = False

    @property
    def title(self) -> str:
        """Name for people."""
        which = ", mean of both directions" if self.both else ""
        return Message("no-load torque at {nominal_rpm:.5g} rpm{which}", self.nominal_rpm, which)

    def magnitude(self) -> Budget:
        """Return the torque that opposes the motion, positive for friction."""
        torque = self.torque
        sign = -1.0 if self.speed_rpm < 0 else 1.0
        lines = (line.times(sign) for line in torque.lines)
        return budget(sign * torque.value, torque.unit, lines)


@dataclass(frozen=True, eq=False)
class NoLoadResult:
    """No-load running torque of a reducer.

    Parameters
    ----------
    points : tuple of NoLoadPoint
        Points at rising speed, negative speeds first.
    means : tuple of NoLoadPoint
        Mean of both directions where both were driven, at rising speed: errors of the zero, and of
        the zero over speed, cancel.
    friction : FrictionResult
        Curve, and Coulomb, viscous and Stribeck parts in each direction.
    temperature_coefficient : Budget or None
        Relative change of the torque per kelvin, %/K; None where the temperature hardly changed.
    speed_rpm, torque_nm, temperature_c, repeat, branch, step : array, shape (n,)
        The evaluated points (after the correction to a reference temperature, if requested), for
        figures with all repeats; `step` is the index of each one's speed in `points`.
    """

    points: tuple[NoLoadPoint, ...]
    means: tuple[NoLoadPoint, ...]
    friction: FrictionResult
    temperature_coefficient: Budget | None
    speed_rpm: Floats
    torque_nm: Floats
    temperature_c: Floats
    repeat: NDArray[np.int64]
    branch: NDArray[np.int64]
    step: NDArray[np.int64]
    findings: tuple[Finding, ...]

    def quantities(self) -> tuple[ResultQuantity, ...]:
        """Return the values under their names, for tables and reports."""
        rows = [
            ResultQuantity(item.key, item.title, item.torque)
            for item in (*self.means, *self.points)
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
        here = self.step == self.points.index(point)
        torque, repeat, turn = self.torque_nm[here], self.repeat[here], self.branch[here]
        means = []
        for number in np.unique(repeat):
            of = repeat == number
            # as in the point's mean, the inertia's torque cancels between the branches
            means.append(np.mean([torque[of & (turn == label)].mean() for label in set(turn[of])]))
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
    zeroed: bool = False,
    steady: bool = False,
    row: ArrayLike | None = None,
    keep_outliers: bool = False,
) -> NoLoadResult:
    """Evaluate steady no-load torques over speed.

    The uncertainty of a mean has a part from the scatter within a series and one common to all
    speeds of a series (a new zero, re-seating after it, warming up): a two-way analysis of
    variance. The torque of inertia cancels in the mean of rising and falling speeds, an error of
    the zero in the mean of both directions. A log is averaged over its steady windows, a ramp over
    parts of it.

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
        Uncertainty of the torque: one for all points, or one for each.
    tare : Tare, optional
        Of an empty run, to be subtracted; then its uncertainty replaces the limits of the effects
        of speed and drag.
    tolerance_rpm : float, optional
        Largest range of the speeds of one step; by default 0.5 % of the largest and
        5 % of their own.
    reference_temperature_c : float, optional
        Convert all torques to this temperature, by the coefficient that the data show.
    largest_share : float, optional
        Refuse the result where U exceeds this share of the torque at any speed.
    zeroed : bool
        Whether the torque was zeroed before; otherwise an offset is estimated from both directions
        where it is significant.
    steady : bool
        Whether each row is a steady point; otherwise a log or a ramp is looked for.
    row : array of int, shape (n,), optional
        Number of each sample in its file, for messages.
    keep_outliers : bool
        Evaluate outliers with the others.

    Raises
    ------
    InputError
        Where the columns can't be used, a torque helps the motion (a swapped sign), or the
        uncertainty exceeds `largest_share`.

    Examples
    --------
    >>> speed = np.tile([100.0, 300.0, 500.0, 700.0], 3)
    >>> noise = 1e-3 * np.cos(np.arange(12.0) ** 2)
    >>> found = evaluate_no_load(speed, 0.1 + 1e-4 * speed + noise, repeat=np.repeat([1, 2, 3], 4))
    >>> [round(point.torque.value, 2) for point in found.points]
    [0.11, 0.13, 0.15, 0.17]
    """
    of_each = None
    if uncertainty is not None and not isinstance(uncertainty, TorqueUncertainty):
        of_each = np.arange(len(uncertainty), dtype=np.float64)
    samples = Samples.of(
        1,
        row=row,
        keep=keep_outliers,
        speed_rpm=speed_rpm,
        torque_nm=torque_nm,
        demanded_rpm=nominal_rpm,
        repeat=repeat,
        branch=branch,
        series=series,
        temperature_c=temperature_c,
        known=of_each,
    )
    if tare is not None:
        torque = samples["torque_nm"] - [
            tare.at(sample).torque_nm for sample in samples["speed_rpm"]
        ]
        samples = samples.having(torque_nm=np.asarray(torque))
    points = speed_points(samples, tolerance_rpm=tolerance_rpm, zeroed=zeroed, steady=steady)
    known: KnownTorque = uncertainty or TorqueUncertainty()
    if of_each is not None and not isinstance(known, TorqueUncertainty):
        known = [known[int(index)] for index in points.samples["known"]]
    missed: tuple[Finding, ...] = ()
    if nominal_rpm is not None:
        missed = missed_speed(points.speed, points.samples["demanded_rpm"])
    warmth = points.samples.get("temperature_c", float("nan"))
    coefficient = _coefficient(points, warmth)
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
        torque, correction = _at_temperature(
            points.torque, warmth, reference_temperature_c, coefficient
        )
        points = SpeedPoints(**{**vars(points), "samples": points.samples.having(torque_nm=torque)})
    every = over(known)
    common = (every.zero_nm, every.model_nm, every.mounting_nm, every.loading_nm)
    friction = friction_of(points, systematic_uncertainty_nm=float(np.linalg.norm(common)))
    series_of = _series(points)
    scatter = _scatter(points, series_of, friction)
    speeds = _points(points, series_of, scatter, known, tare, correction)
    means = _both_directions(speeds, SAME_SPEED * float(np.max(np.abs(points.speed))))
    for point in means or speeds:
        if largest_share is not None:
            refuse(point.torque, largest_share, point.title)
    return NoLoadResult(
        points=speeds,
        means=means,
        friction=friction,
        temperature_coefficient=coefficient,
        speed_rpm=points.speed,
        torque_nm=points.torque,
        temperature_c=warmth,
        repeat=points.samples.get("repeat", 1.0).astype(np.int64),
        branch=points.branch.astype(np.int64),
        step=_rank(points),
        findings=(*points.findings, *missed, *findings, *scatter.findings()),
    )


def _rank(points: SpeedPoints) -> NDArray[np.int64]:
    """Return each point's speed step, numbered by rising speed."""
    count = np.bincount(points.group)
    speed = np.bincount(points.group, weights=points.speed) / count
    rank = np.empty(count.size, dtype=np.int64)
    rank[np.argsort(speed, kind="stable")] = np.arange(count.size)
    return rank[points.group]


def _series(points: SpeedPoints) -> NDArray[np.int64]:
    """Return the number of each point's series: points with one zero before them."""
    if "series" in points.samples.columns:
        keys = points.samples["series"]
        return np.unique(keys, return_inverse=True)[1].ravel().astype(np.int64)
    keys = np.column_stack([points.samples.get("repeat", 1.0), np.sign(points.speed)])
    return np.unique(keys, axis=0, return_inverse=True)[1].ravel().astype(np.int64)


def _at_temperature(
    torque: Floats, warmth: Floats, reference_c: float, coefficient: Budget | None
) -> tuple[Floats, float]:
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


def _coefficient(points: SpeedPoints, warmth: Floats) -> Budget | None:
    """Return the relative change of torque per kelvin at equal speeds, %/K."""
    if np.any(np.isnan(warmth)):
        return None
    group, torque = points.group, points.torque
    count = np.bincount(group)
    deviation = warmth - (np.bincount(group, weights=warmth) / count)[group]
    relative = torque / (np.bincount(group, weights=torque) / count)[group] - 1.0
    freedom = torque.size - count.size - 1
    squares = float(np.sum(deviation**2))
    if freedom < 2 or np.ptp(deviation) < LEAST_RANGE_K:
        return None
    slope = float(np.sum(deviation * relative)) / squares
    residual = relative - slope * deviation
    error = float(np.sqrt(np.sum(residual**2) / freedom / squares))
    return budget(100.0 * slope, "%/K", [BudgetLine("scatter", 100.0 * error, freedom)])


# -- scatter ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Scatter:
    """Scatter of a test's repeats: of points within a series, and between series."""

    within_nm: float
    within_freedom: float
    between_nm: float
    between_freedom: float
    repeated: bool
    own: bool = False
    resolution_nm: float = 0.0

    def parts(self, points: int, series: int) -> list[BudgetLine]:
        """Return contributions to the mean of a number of points from a number of series."""
        parts = []
        if self.within_freedom:
            error = self.within_nm / sqrt(points)
            parts.append(BudgetLine("repeatability", error, self.within_freedom))
            if self.within_nm < self.resolution_nm:  # repeats are rounded alike
                parts.append(BudgetLine("resolution", self.resolution_nm / sqrt(12.0)))
        if self.between_freedom:
            error = self.between_nm / sqrt(series)
            parts.append(BudgetLine("between series", error, self.between_freedom))
        return parts

    def findings(self) -> list[Finding]:
        """Return a finding if repeats are missing."""
        if self.repeated:
            return []
        if self.own:
            message = "every speed was driven once: U contains the noise of each window only"
        elif self.within_freedom:
            message = "every speed was measured once: the scatter is that about the fitted friction"
        else:
            return [
                Finding(
                    "no scatter",
                    "too few points to say anything about repeatability",
                    "measure at more speeds, or repeat the sweep",
                    severe=True,
                )
            ]
        remedy = "measure up and down and repeat the sweep, three times by preference"
        return [Finding("no repeats", message, remedy)]


def _scatter(points: SpeedPoints, series: NDArray[np.int64], friction: FrictionResult) -> _Scatter:
    """Split the scatter into a part common to a series and the rest, pooled over both directions.

    Model: torque = step and branch + series + scatter, series as random effects (method of
    moments).
    """
    keys = np.column_stack([points.group, np.sign(points.branch)])
    cells = np.unique(keys, axis=0, return_inverse=True)[1].ravel()
    count = np.bincount(cells)
    residual = points.torque - (np.bincount(cells, weights=points.torque) / count)[cells]
    size = np.bincount(series)
    direction = np.sign(points.speed)
    sides = [np.unique(series[direction == sign]) for sign in (1.0, -1.0)]
    between_freedom = sum(max(side.size - 1, 0) for side in sides)
    freedom = residual.size - count.size - between_freedom
    step = points.resolution_nm
    if freedom < 1:
        if np.isfinite(points.own_nm).all():
            own = float(np.sqrt(np.mean(points.own_nm**2)))
            free = float((BLOCKS - 1) * points.own_nm.size)
            return _Scatter(own, free, 0.0, 0.0, repeated=False, own=True, resolution_nm=step)
        for fit in (friction.clockwise, friction.counter_clockwise):
            if fit is not None:
                free = fit.degrees_of_freedom
                return _Scatter(fit.residual_nm, free, 0.0, 0.0, repeated=False, resolution_nm=step)
        return _Scatter(0.0, 0.0, 0.0, 0.0, repeated=False)
    effect = np.bincount(series, weights=residual) / size
    within = float(np.sum((residual - effect[series]) ** 2)) / freedom
    between = 0.0
    if between_freedom:
        squares = sum(
            float(np.sum((effect[side] - effect[side].mean()) ** 2)) for side in sides if side.size
        )
        between = max(squares / between_freedom - within * float(np.mean(1.0 / size)), 0.0)
    return _Scatter(
        sqrt(within),
        freedom,
        sqrt(between),
        between_freedom,
        repeated=True,
        resolution_nm=step,
    )


# -- points -----------------------------------------------------------------------------------


def _points(
    points: SpeedPoints,
    series: NDArray[np.int64],
    scatter: _Scatter,
    uncertainty: KnownTorque,
    tare: Tare | None,
    correction: float,
) -> tuple[NoLoadPoint, ...]:
    """Return the torque at every step of speed and direction."""
    step, curve = _rank(points), curve_of(points)
    names = points.samples.columns.get("demanded_rpm", points.speed)
    warmth = points.samples.get("temperature_c", float("nan"))
    nominal = [float(np.mean(names[step == place])) for place in range(curve.speed_rpm.size)]
    texts = distinct_texts(nominal)
    rows = []
    for place, centre in enumerate(curve.speed_rpm):
        here = step == place
        mean, speed = _mean_of_branches(points, here), float(centre)
        known = over(uncertainty, here)
        sign, turn = float(np.sign(mean)) or 1.0, float(np.sign(speed)) or 1.0
        parts = [
            BudgetLine("torque zero", known.zero_nm, shared=Shared.ZEROING),
            BudgetLine("torque offset", points.offset_u_nm, shared=Shared.ZEROING),
            BudgetLine("compensation model", known.model_nm, inf, sign, Shared.CALIBRATION),
            BudgetLine("torque scale", known.relative * abs(mean), inf, sign, Shared.CALIBRATION),
            BudgetLine(
                "zero by speed", known.speed_nm_per_rpm * abs(speed), shared=Shared.CALIBRATION
            ),
            BudgetLine("mounting and drag", known.mounting_nm, inf, turn, Shared.MOUNTING),
            BudgetLine("loading effects", known.loading_nm, inf, sign, Shared.LOADING),
            BudgetLine("temperature correction", correction * abs(mean), inf, sign, Shared.LOADING),
            *scatter.parts(int(np.count_nonzero(here)), int(np.unique(series[here]).size)),
        ]
        if not scatter.between_freedom:
            parts.append(BudgetLine("chain repeatability", known.repeatability_nm))
        if tare is not None:
            taken = tare.at(speed)
            parts += [
                BudgetLine("tare", taken.scatter_nm, taken.degrees_of_freedom),
                BudgetLine("tare zero", tare.zero_nm, shared=Shared.ZEROING),
                BudgetLine("tare transfer", taken.transfer_nm, inf, turn, Shared.MOUNTING),
            ]
        rows.append(
            NoLoadPoint(
                key=f"no_load_{texts[place]}_rpm",
                speed_rpm=speed,
                torque=budget(mean, "N·m", parts),
                up_minus_down_nm=float(curve.up_minus_down_nm[place]),
                temperature_c=float(np.mean(warmth[here])),
                nominal_rpm=nominal[place],
            )
        )
    return tuple(rows)


def _mean_of_branches(points: SpeedPoints, here: NDArray[np.bool_]) -> float:
    """Mean of the means of rising and falling speed, so that the inertia's torque cancels."""
    torque, turn = points.torque[here], points.branch[here]
    if np.any(turn > 0) and np.any(turn < 0):
        return 0.5 * float(torque[turn > 0].mean() + torque[turn < 0].mean())
    return float(torque.mean())


def _both_directions(points: tuple[NoLoadPoint, ...], tolerance: float) -> tuple[NoLoadPoint, ...]:
    """Return the mean magnitude of both directions at each speed that was driven in both."""
    means = []
    backward = [point for point in points if point.nominal_rpm < 0.0]
    for forward in (point for point in points if point.nominal_rpm > 0.0):
        other = min(
            backward, key=lambda each: abs(each.nominal_rpm + forward.nominal_rpm), default=None
        )
        if other is None or abs(other.nominal_rpm + forward.nominal_rpm) > tolerance:
            continue
        first, second = forward.magnitude(), other.magnitude()
        parts = common_of_both(first, second)
        alone = [line for each in (first, second) for line in each.lines if not line.common]
        for name in dict.fromkeys(line.name for line in alone):
            both = [line for line in alone if line.name == name]
            size = sqrt(sum(line.contribution**2 for line in both))
            # Scatter and degrees of freedom are pooled over both directions.
            freedom = min(line.degrees_of_freedom for line in both)
            parts.append(BudgetLine(name, 0.5 * size, freedom))
        value = 0.5 * (first.value + second.value)
        means.append(
            NoLoadPoint(
                key=forward.key.replace("no_load_+", "no_load_"),
                speed_rpm=0.5 * (forward.speed_rpm - other.speed_rpm),
                torque=budget(value, "N·m", parts),
                up_minus_down_nm=0.5 * (forward.up_minus_down_nm - other.up_minus_down_nm),
                temperature_c=0.5 * (forward.temperature_c + other.temperature_c),
                nominal_rpm=forward.nominal_rpm,
                both=True,
            )
        )
    return tuple(means)
