"""No-load torque at each speed and in the mean of both directions, with its scatter and budget."""

from dataclasses import dataclass
from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

from torquebench.message import Message
from torquebench.reducers.quantities import Contribution, Finding, budget, common_of_both
from torquebench.reducers.running.friction import FrictionCurve, FrictionResult
from torquebench.reducers.running.tare import Tare
from torquebench.reducers.torque_uncertainty import KnownTorque, over
from torquebench.uncertainty import Budget, Shared

__all__ = [
    "NoLoadPoint",
    "Scatter",
    "Steps",
    "both_directions",
    "points_of",
    "scatter_findings",
    "scatter_of",
]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class NoLoadPoint:
    """No-load torque at one speed.

    Parameters
    ----------
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
        Whether it is the mean of both directions.
    """

    speed_rpm: float
    torque: Budget
    up_minus_down_nm: float
    temperature_c: float
    nominal_rpm: float
    both: bool = False

    @property
    def key(self) -> str:
        """Name for programs."""
        return f"no_load_{self.nominal_rpm:{'' if self.both else '+'}.0f}_rpm"

    @property
    def title(self) -> str:
        """Name for people."""
        which = ", mean of both directions" if self.both else ""
        return Message("no-load torque at {nominal_rpm:.0f} rpm{which}", self.nominal_rpm, which)

    def magnitude(self) -> Budget:
        """Return the torque that opposes the motion: positive where friction is."""
        torque = self.torque
        sign = -1.0 if self.speed_rpm < 0 else 1.0
        lines = (Contribution.of(line, sign) for line in torque.lines)
        return budget(sign * torque.value, torque.unit, lines)


@dataclass(frozen=True, eq=False)
class Steps:
    """Points and the steps of speed that they belong to.

    Parameters
    ----------
    curve : FrictionCurve
        Steps at rising speed.
    index : array of int, shape (n,)
        Step of each point.
    nominal_rpm, torque_nm, series, branch, temperature_c : array of float, shape (n,)
    """

    curve: FrictionCurve
    index: NDArray[np.intp]
    nominal_rpm: FloatArray
    torque_nm: FloatArray
    series: FloatArray
    branch: FloatArray
    temperature_c: FloatArray

    def mean(self, step: int) -> float:
        """Mean of the means of rising and falling speed, so that the inertia's torque cancels."""
        here = self.index == step
        torque, turn = self.torque_nm[here], self.branch[here]
        if np.any(turn > 0) and np.any(turn < 0):
            return 0.5 * float(torque[turn > 0].mean() + torque[turn < 0].mean())
        return float(torque.mean())

    def series_at(self, step: int) -> int:
        """Return the number of series with this step."""
        return int(np.unique(self.series[self.index == step]).size)


@dataclass(frozen=True)
class Scatter:
    """Scatter of a test's repeats.

    Parameters
    ----------
    within_nm, within_freedom : float
        Standard deviation of a point about its series, N·m, and its degrees of freedom.
    between_nm, between_freedom : float
        Standard deviation common to all points of a series, N·m.
    repeated : bool
        Whether any step was measured more than once.
    """

    within_nm: float
    within_freedom: float
    between_nm: float
    between_freedom: float
    repeated: bool

    def parts(self, points: int, series: int) -> list[Contribution]:
        """Return the standard error of a mean of points from several series."""
        found = []
        if self.within_freedom:
            error = self.within_nm / sqrt(points)
            found.append(Contribution("repeatability", error, self.within_freedom))
        if self.between_freedom:
            error = self.between_nm / sqrt(series)
            found.append(Contribution("between series", error, self.between_freedom))
        return found


def scatter_of(steps: Steps, friction: FrictionResult) -> Scatter:
    """Split the scatter into a part common to a series and the rest, pooled over directions.

    Model: torque = step and branch + series + scatter, series as random effects (method of
    moments).
    """
    cells = np.unique(
        np.column_stack([steps.index, np.sign(steps.branch)]), axis=0, return_inverse=True
    )[1].ravel()
    count = np.bincount(cells)
    rest = steps.torque_nm - (np.bincount(cells, weights=steps.torque_nm) / count)[cells]
    series = np.unique(steps.series, return_inverse=True)[1]
    size = np.bincount(series)
    direction = np.sign(steps.curve.speed_rpm[steps.index])
    sides = [np.unique(series[direction == sign]) for sign in (1.0, -1.0)]
    between_freedom = sum(max(side.size - 1, 0) for side in sides)
    freedom = rest.size - count.size - between_freedom
    if freedom < 1:
        for fit in (friction.clockwise, friction.counter_clockwise):
            if fit is not None:
                return Scatter(fit.residual_nm, fit.degrees_of_freedom, 0.0, 0.0, repeated=False)
        return Scatter(0.0, 0.0, 0.0, 0.0, repeated=False)
    effect = np.bincount(series, weights=rest) / size
    within = float(np.sum((rest - effect[series]) ** 2)) / freedom
    between = 0.0
    if between_freedom:
        squares = sum(
            float(np.sum((effect[side] - effect[side].mean()) ** 2)) for side in sides if side.size
        )
        between = max(squares / between_freedom - within * float(np.mean(1.0 / size)), 0.0)
    return Scatter(sqrt(within), freedom, sqrt(between), between_freedom, repeated=True)


def scatter_findings(scatter: Scatter) -> list[Finding]:
    """State missing repeats."""
    findings = []
    if not scatter.repeated:
        findings.append(
            Finding(
                "no repeats",
                "every speed was measured once: the scatter is that about the fitted friction",
                "measure up and down and repeat the sweep, three times by preference",
            )
        )
    if scatter.within_freedom == 0:
        findings.append(
            Finding(
                "no scatter",
                "too few points to say anything about repeatability",
                "measure at more speeds, or repeat the sweep",
                severe=True,
            )
        )
    return findings


def points_of(
    steps: Steps,
    scatter: Scatter,
    uncertainty: KnownTorque,
    tare: Tare | None,
    correction: float,
) -> tuple[NoLoadPoint, ...]:
    """Return the torque at every step of speed and direction."""
    points = []
    for place, centre in enumerate(steps.curve.speed_rpm):
        here = steps.index == place
        mean, speed, known = steps.mean(place), float(centre), over(uncertainty, here)
        sign, turn = float(np.sign(mean)) or 1.0, float(np.sign(speed)) or 1.0
        parts = [
            Contribution("torque zero", known.zero_nm, shared=Shared.ZEROING),
            Contribution("compensation model", known.model_nm, inf, sign, Shared.CALIBRATION),
            Contribution("torque scale", known.relative * abs(mean), inf, sign, Shared.CALIBRATION),
            Contribution(
                "zero by speed", known.speed_nm_per_rpm * abs(speed), shared=Shared.CALIBRATION
            ),
            Contribution("mounting and drag", known.mounting_nm, inf, turn, Shared.MOUNTING),
            Contribution("loading effects", known.loading_nm, inf, sign, Shared.LOADING),
            Contribution(
                "temperature correction", correction * abs(mean), inf, sign, Shared.LOADING
            ),
            *scatter.parts(int(np.count_nonzero(here)), steps.series_at(place)),
        ]
        if not scatter.between_freedom:
            parts.append(Contribution("chain repeatability", known.repeatability_nm))
        if tare is not None:
            taken = tare.at(speed)
            parts += [
                Contribution("tare", taken.scatter_nm, taken.degrees_of_freedom),
                Contribution("tare zero", tare.zero_nm, shared=Shared.ZEROING),
                Contribution("tare transfer", taken.transfer_nm, inf, turn, Shared.MOUNTING),
            ]
        points.append(
            NoLoadPoint(
                speed_rpm=speed,
                torque=budget(mean, "N·m", parts),
                up_minus_down_nm=float(steps.curve.up_minus_down_nm[place]),
                temperature_c=float(np.mean(steps.temperature_c[here])),
                nominal_rpm=float(np.mean(steps.nominal_rpm[here])),
            )
        )
    return tuple(points)


def both_directions(points: tuple[NoLoadPoint, ...], tolerance: float) -> tuple[NoLoadPoint, ...]:
    """Return the mean magnitude of both directions at each speed that both were driven at.

    Parameters
    ----------
    points : tuple of NoLoadPoint
    tolerance : float
        Largest difference of two speeds that count as one, 1/min.
    """
    means = []
    backward = [each for each in points if each.nominal_rpm < 0.0]
    for forward in (each for each in points if each.nominal_rpm > 0.0):
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
            parts.append(Contribution(name, 0.5 * size, freedom))
        value = 0.5 * (first.value + second.value)
        means.append(
            NoLoadPoint(
                speed_rpm=0.5 * (forward.speed_rpm - other.speed_rpm),
                torque=budget(value, "N·m", parts),
                up_minus_down_nm=0.5 * (forward.up_minus_down_nm - other.up_minus_down_nm),
                temperature_c=0.5 * (forward.temperature_c + other.temperature_c),
                nominal_rpm=forward.nominal_rpm,
                both=True,
            )
        )
    return tuple(means)
