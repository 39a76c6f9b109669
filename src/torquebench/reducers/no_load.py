"""No-load running torque: what keeps the input turning at a speed, output free."""

from dataclasses import dataclass
from math import isfinite

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.reducers.columns import finite_columns, labels
from torquebench.reducers.friction import FrictionCurve, FrictionResult, evaluate_friction
from torquebench.reducers.quantities import (
    Contribution,
    Finding,
    ResultQuantity,
    budget,
    refuse,
)
from torquebench.uncertainty import Budget

__all__ = ["NoLoadPoint", "NoLoadResult", "TorqueUncertainty", "evaluate_no_load"]

LEAST_RANGE_K = 1.0
"""Below this change of temperature nothing is said about its effect."""


@dataclass(frozen=True)
class TorqueUncertainty:
    """Standard uncertainties (k = 1) of a torque.

    Parameters
    ----------
    relative : float
        Of the sensitivity, as a share of reading.
    zero_nm : float
        Of the zero that was taken just before, N·m; common to all points.
    """

    relative: float = 0.0
    zero_nm: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (isfinite(value) and value >= 0.0):
                raise InputError(f"standard uncertainty {name} = {value}", "finite, 0 or more")


@dataclass(frozen=True)
class NoLoadPoint:
    """No-load torque at one speed.

    Parameters
    ----------
    speed_rpm : float
        Input speed, clockwise positive.
    torque : Budget
        Torque with the sign of the speed, N·m.
    up_minus_down_nm : float
        Mean while the speed rises less mean while it falls; NaN where one is missing.
    temperature_c : float
        Mean; NaN where it wasn't measured.
    """

    speed_rpm: float
    torque: Budget
    up_minus_down_nm: float
    temperature_c: float

    @property
    def key(self) -> str:
        """Name for programs."""
        return f"no_load_{self.speed_rpm:+.0f}_rpm"

    def magnitude(self) -> Budget:
        """Return the torque that opposes the motion: positive where friction is."""
        torque = self.torque
        sign = -1.0 if self.speed_rpm < 0 else 1.0
        return Budget(
            sign * torque.value,
            torque.standard_uncertainty,
            torque.degrees_of_freedom,
            torque.lines,
            torque.unit,
        )


@dataclass(frozen=True, eq=False)
class NoLoadResult:
    """No-load running torque of a reducer.

    Parameters
    ----------
    points : tuple of NoLoadPoint
        At rising speed, negative speeds first.
    friction : FrictionResult
        Curve, and Coulomb, viscous and Stribeck parts in each direction.
    temperature_coefficient : Budget or None
        Relative change of the torque per kelvin, %/K; None where the temperature hardly changed.
    speed_rpm, torque_nm, temperature_c, repeat, branch : array, shape (n,)
        What was evaluated (after the correction to a reference temperature, where asked for),
        for figures with all repeats.
    findings : tuple of Finding
    """

    points: tuple[NoLoadPoint, ...]
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
            ResultQuantity(each.key, f"no-load torque at {each.speed_rpm:.0f} rpm", each.torque)
            for each in self.points
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


def evaluate_no_load(
    speed_rpm: ArrayLike,
    torque_nm: ArrayLike,
    *,
    repeat: ArrayLike | None = None,
    branch: ArrayLike | None = None,
    temperature_c: ArrayLike | None = None,
    uncertainty: TorqueUncertainty | None = None,
    tolerance_rpm: float | None = None,
    largest_temperature_range_k: float = 2.0,
    reference_temperature_c: float | None = None,
    largest_share: float | None = None,
) -> NoLoadResult:
    """Evaluate steady no-load torques over speed.

    The uncertainty of a mean has a part from the scatter within repeats and one from what all
    speeds of a repeat share (warming up, a new zero): a two-way analysis of variance. What
    accelerates and decelerates the inertia cancels in the mean of rising and falling speeds.

    Parameters
    ----------
    speed_rpm, torque_nm : array of float, shape (n,)
        Mean of each steady point: input speed (clockwise positive) and torque with its sign.
    repeat : array of int, shape (n,), optional
        Number of the repeat; all 1 by default.
    branch : array of int, shape (n,), optional
        +1 while the speed's magnitude rises, -1 while it falls, 0 unknown.
    temperature_c : array of float, shape (n,), optional
        Of the reducer.
    uncertainty : TorqueUncertainty, optional
    tolerance_rpm : float, optional
        Largest gap between points of one speed; by default 0.2 % of the largest.
    largest_temperature_range_k : float
        Above this the temperature counts as unsteady, which is a finding.
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
    series = labels(repeat, speed.size, 1.0, "repeat")
    turn = labels(branch, speed.size, 0.0, "branch")
    warmth = np.full(speed.size, np.nan)
    if temperature_c is not None:
        (warmth,) = finite_columns(speed.size, temperature_c=temperature_c)
    known = uncertainty or TorqueUncertainty()
    findings: list[Finding] = []
    first = evaluate_friction(speed, torque, turn, tolerance_rpm=tolerance_rpm)
    coefficient = _coefficient(first.curve, speed, torque, warmth)
    findings += _temperature_findings(warmth, largest_temperature_range_k, coefficient)
    correction = 0.0
    if reference_temperature_c is not None:
        if coefficient is None:
            raise InputError(
                "no visible effect of the temperature",
                f"temperatures over {LEAST_RANGE_K:g} K or more at repeated speeds",
                "leave the reference temperature out",
            )
        distance = warmth - reference_temperature_c
        torque = torque * np.exp(-0.01 * coefficient.value * distance)
        correction = 0.01 * coefficient.standard_uncertainty * abs(float(distance.mean()))
    friction = evaluate_friction(
        speed, torque, turn, tolerance_rpm=tolerance_rpm, systematic_uncertainty_nm=known.zero_nm
    )
    points, more = _points(friction, speed, torque, series, turn, warmth, known, correction)
    for point in points:
        if largest_share is not None:
            refuse(point.torque, largest_share, f"no-load torque at {point.speed_rpm:.0f} rpm")
    return NoLoadResult(
        points=points,
        friction=friction,
        temperature_coefficient=coefficient,
        speed_rpm=speed,
        torque_nm=torque,
        temperature_c=warmth,
        repeat=series.astype(np.int64),
        branch=turn.astype(np.int64),
        findings=(*findings, *more),
    )


def _nearest(curve: FrictionCurve, speed: NDArray[np.float64]) -> NDArray[np.intp]:
    return np.asarray(np.argmin(np.abs(speed[:, None] - curve.speed_rpm), axis=1), dtype=np.intp)


def _temperature_findings(
    warmth: NDArray[np.float64], limit_k: float, coefficient: Budget | None
) -> list[Finding]:
    if np.all(np.isnan(warmth)) or np.ptp(warmth) <= limit_k:
        return []
    effect = ""
    if coefficient is not None:
        effect = f", which changes the torque by {coefficient.value * np.ptp(warmth):.2g} %"
    return [
        Finding(
            "unsteady temperature",
            f"{warmth.min():.1f} to {warmth.max():.1f} °C during the test (allowed: a range of "
            f"{limit_k:g} K){effect}",
            "warm up until the temperature is steady, or evaluate at a reference temperature",
        )
    ]


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


def _points(
    friction: FrictionResult,
    speed: NDArray[np.float64],
    torque: NDArray[np.float64],
    series: NDArray[np.float64],
    turn: NDArray[np.float64],
    warmth: NDArray[np.float64],
    known: TorqueUncertainty,
    correction: float,
) -> tuple[tuple[NoLoadPoint, ...], list[Finding]]:
    curve = friction.curve
    index = _nearest(curve, speed)
    scatter = _scatter(friction, index, torque, series, turn)
    findings: list[Finding] = []
    if not scatter.repeated:
        findings.append(
            Finding(
                "no repeats",
                "every speed was measured once: the scatter is that about the fitted friction",
                "measure up and down and repeat the sweep, three times by preference",
            )
        )
    if scatter.freedom == 0:
        findings.append(
            Finding(
                "no scatter",
                "too few points to say anything about repeatability",
                "measure at more speeds, or repeat the sweep",
                severe=True,
            )
        )
    points = []
    for place, centre in enumerate(curve.speed_rpm):
        here = index == place
        mean = _balanced_mean(torque[here], turn[here])
        contributions = [
            Contribution("torque zero", known.zero_nm),
            Contribution("torque scale", known.relative * abs(mean), sensitivity=np.sign(mean)),
            Contribution("temperature correction", correction * abs(mean)),
        ]
        if scatter.freedom:
            error = scatter.within / np.sqrt(np.count_nonzero(here))
            contributions.append(Contribution("repeatability", float(error), scatter.freedom))
        if scatter.between > 0.0:
            contributions.append(
                Contribution(
                    "between repeats",
                    scatter.between / scatter.repeats**0.5 * abs(mean),
                    scatter.repeats - 1,
                )
            )
        points.append(
            NoLoadPoint(
                speed_rpm=float(centre),
                torque=budget(mean, "N·m", contributions),
                up_minus_down_nm=float(curve.up_minus_down_nm[place]),
                temperature_c=float(np.mean(warmth[here])),
            )
        )
    return tuple(points), findings


def _balanced_mean(torque: NDArray[np.float64], turn: NDArray[np.float64]) -> float:
    """Mean of the means of rising and falling speed, so that the inertia's torque cancels."""
    if np.any(turn > 0) and np.any(turn < 0):
        return 0.5 * float(torque[turn > 0].mean() + torque[turn < 0].mean())
    return float(torque.mean())


@dataclass(frozen=True)
class _Scatter:
    within: float
    freedom: int
    between: float
    repeats: int
    repeated: bool


def _scatter(
    friction: FrictionResult,
    index: NDArray[np.intp],
    torque: NDArray[np.float64],
    series: NDArray[np.float64],
    turn: NDArray[np.float64],
) -> _Scatter:
    """Scatter within repeats in N·m, and relative scatter between repeats.

    Model: torque = speed and branch + (1 + relative effect of the repeat) + scatter.
    """
    cells = np.unique(np.column_stack([index, np.sign(turn)]), axis=0, return_inverse=True)[1]
    cells = cells.ravel()
    count = np.bincount(cells)
    mean = np.bincount(cells, weights=torque) / count
    names, repeat = np.unique(series, return_inverse=True)
    rest = torque - mean[cells]
    freedom = torque.size - count.size
    if freedom < 1:
        for fit in (friction.clockwise, friction.counter_clockwise):
            if fit is not None:
                return _Scatter(fit.residual_nm, fit.degrees_of_freedom, 0.0, 1, repeated=False)
        return _Scatter(0.0, 0, 0.0, 1, repeated=False)
    if names.size < 2 or freedom - (names.size - 1) < 1:
        return _Scatter(float(np.sqrt(np.sum(rest**2) / freedom)), freedom, 0.0, 1, repeated=True)
    level = mean[cells]
    weight = np.bincount(repeat, weights=level**2)
    effect = np.bincount(repeat, weights=level * rest) / weight
    within_rest = rest - effect[repeat] * level
    freedom -= names.size - 1
    within = float(np.sum(within_rest**2) / freedom)
    variance = float(np.var(effect, ddof=1)) - within * float(np.mean(1.0 / weight))
    return _Scatter(
        float(np.sqrt(within)), freedom, float(np.sqrt(max(variance, 0.0))), names.size, True
    )
