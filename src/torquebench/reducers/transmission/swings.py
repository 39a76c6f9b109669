"""Backlash and lost motion of an unloaded reducer that swings less than a revolution."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.preparation import Samples, count_step, noise_of
from torquebench.reducers.quantities import (
    Finding,
    LimitedQuantity,
    ResultQuantity,
    budget,
)
from torquebench.reducers.transmission.evaluation import AngleUncertainty, angles_screened
from torquebench.reducers.transmission.runs import COARSE, RATIO_TOLERANCE, one_way
from torquebench.uncertainty import Budget, BudgetLine, Shared
from torquebench.units import ARCMIN, DEG_PER_RAD, TURN

if TYPE_CHECKING:
    from torquebench.reducers.description import DataSheetLimits

Floats = NDArray[np.float64]
FULL_STROKE = 0.6
"""Smallest length of a stroke that counts, as a share of the longest."""
CENTRAL = 0.25
"""Share of a stroke at each end in which the backlash is taken up."""
PARTS = 8
"""Number of parts of a stroke's middle in which the gap is compared."""
ENDS = 40
"""The slope of a stroke's middle is read from this fraction of it (1/40) at each end."""


@dataclass(frozen=True, eq=False)
class Swing:
    """One stroke: angle by the input encoder (θ_i/R) and error θ_o − θ_i/R, rad, both in time."""

    angle_rad: Floats
    error_rad: Floats

    @property
    def forward(self) -> bool:
        """Whether the angle rises."""
        return bool(self.angle_rad[-1] > self.angle_rad[0])

    def mean_error(self, low: float, high: float) -> float:
        """Return the mean error over an interval of the angle."""
        order = np.argsort(self.angle_rad, kind="stable")
        x, y = self.angle_rad[order], self.error_rad[order]
        inside = (x > low) & (x < high)
        ends = np.interp([low, high], x, y)
        x = np.concatenate([[low], x[inside], [high]])
        y = np.concatenate([ends[:1], y[inside], ends[1:]])
        return float(np.trapezoid(y, x)) / (high - low)


@dataclass(frozen=True, eq=False)
class SwingsResult:
    """Backlash and lost motion from reciprocating motion without load.

    Parameters
    ----------
    ratio : float
        Input turns for one output turn, as stated.
    lost_motion : Budget
        Gap of the output angle between both directions at equal input angle, arcmin.
    backlash : Budget
        Travel of the input after a reversal, at the output, until the output follows, arcmin.
    reach_rad : float
        Range of the swing at the output.
    """

    ratio: float
    lost_motion: Budget
    backlash: Budget
    reach_rad: float
    swings: tuple[Swing, ...]
    findings: tuple[Finding, ...]

    def quantities(self) -> tuple[ResultQuantity, ...]:
        """Return the values under their names, for tables and reports."""
        gap = Message(
            "gap between both directions, unloaded, {strokes} strokes of {reach:.3g}°",
            len(self.swings),
            self.reach_rad * DEG_PER_RAD,
        )
        dead = "travel after a reversal until the output follows"
        return (
            ResultQuantity("lost_motion", "lost motion", self.lost_motion, gap),
            ResultQuantity("backlash", "backlash", self.backlash, dead),
        )

    def limited(self, _limits: DataSheetLimits) -> Iterator[LimitedQuantity]:
        """Return nothing: data sheets limit lost motion and backlash under a torque only."""
        return iter(())


def turned_one_way(input_angle_rad: ArrayLike, ratio: float) -> float:
    """Return the longest travel without a reversal, in output turns."""
    angle = np.asarray(input_angle_rad, dtype=np.float64)
    angle = angle[np.isfinite(angle)] / ratio
    if angle.size < 2:
        return 0.0
    return max((abs(float(angle[b] - angle[a])) for a, b in one_way(angle)), default=0.0) / TURN


def evaluate_swings(
    input_angle_rad: ArrayLike,
    output_angle_rad: ArrayLike,
    ratio: float,
    *,
    uncertainty: AngleUncertainty | None = None,
    row: ArrayLike | None = None,
    keep_outliers: bool = False,
) -> SwingsResult:
    """Evaluate a reciprocating motion under one revolution, two encoders and no load.

    At equal input angles the transmission error of both directions is the same: what differs is the
    lost motion. It is the mean gap over the middle half of the strokes; backlash is the part of it
    over which the output stands still after a reversal.

    Parameters
    ----------
    input_angle_rad, output_angle_rad : array of float, shape (n,)
        Both encoders at the same moments, unwrapped, rad.
    ratio : float
        Input turns for one output turn; negative where the output turns against the input.
    row : array of int, shape (n,), optional
        Number of each sample in its file, for messages.
    keep_outliers : bool
        Evaluate single samples far from their neighbours with the others.

    Raises
    ------
    InputError
        Fewer than three strokes, another ratio, or a lost motion that isn't taken up within a
        quarter of a stroke.

    Examples
    --------
    >>> swing = 0.2 * np.sin(np.linspace(0.0, 20.0, 4001))
    >>> lag = np.where(np.gradient(swing) > 0.0, -0.001, 0.001)
    >>> found = evaluate_swings(50.0 * swing, swing + lag, 50.0)
    >>> round(found.lost_motion.value, 2)  # 0.002 rad
    6.88
    """
    if not (np.isfinite(ratio) and abs(ratio) > 0.0):
        raise InputError(Message("ratio {ratio}", ratio), "input turns for one output turn, not 0")
    samples = Samples.of(
        32, row=row, keep=keep_outliers, input_rad=input_angle_rad, output_rad=output_angle_rad
    )
    samples = angles_screened(samples, ratio)
    input_rad, output_rad = samples["input_rad"], samples["output_rad"]
    angle, error = input_rad / ratio, output_rad - input_rad / ratio
    parts = one_way(angle)
    longest = max(abs(float(angle[b] - angle[a])) for a, b in parts)
    swings = tuple(
        Swing(angle[a : b + 1], error[a : b + 1])
        for a, b in parts
        if abs(float(angle[b] - angle[a])) >= FULL_STROKE * longest
    )
    directions = [swing.forward for swing in swings]
    if len(swings) < 3 or any(a == b for a, b in pairwise(directions)):
        raise InputError(
            Message(
                "{count} strokes to and fro of {turns:.3g} output revolutions",
                len(swings),
                longest / TURN,
            ),
            "three strokes or more, or a whole output revolution in one direction",
            "swing the input to and fro, or turn it further",
        )
    low = max(float(swing.angle_rad.min()) for swing in swings)
    high = min(float(swing.angle_rad.max()) for swing in swings)
    edge = CENTRAL * (high - low)
    gaps = _gaps(swings, low + edge, high - edge)
    gap = float(gaps.mean())
    if gap > edge:
        raise InputError(
            Message("a lost motion of {gap:.3g} arcmin", gap / ARCMIN),
            Message("at most {edge:.3g} arcmin, a quarter of the strokes", edge / ARCMIN),
            "swing further",
        )
    slope, findings = _slope(swings, low + edge, high - edge, ratio)
    apart = gap * _mean_slope(swings, low + edge, high - edge)
    edges = np.linspace(low + edge, high - edge, PARTS + 1)
    local = np.array([float(_gaps(swings, a, b).mean()) for a, b in pairwise(edges.tolist())])
    along = float(np.std(local, ddof=1)) / (0.5 * PARTS) ** 0.5  # neighbours are alike
    step = float(np.hypot(count_step(output_rad), count_step(input_rad) / ratio))
    noise = noise_of(error)
    stated = uncertainty or AngleUncertainty()
    encoders = 2.0**0.5 * float(np.hypot(stated.output_rad, stated.input_rad / ratio))
    common = [
        BudgetLine("along the strokes", along / ARCMIN, PARTS - 1.0),
        BudgetLine("encoders", encoders / ARCMIN, shared=Shared.CALIBRATION),
    ]
    counts = BudgetLine("resolution", step / 6.0**0.5 / ARCMIN)
    # If the error depends on the output's own angle, it differs between both directions by the gap.
    shifted = BudgetLine("gap at equal output angle", abs(apart) / 3.0**0.5 / ARCMIN)
    lost = _over_strokes(gaps, noise, [*common, counts, shifted])
    if gap < -lost.expanded_uncertainty() * ARCMIN:
        findings.append(
            Finding(
                "negative lost motion",
                Message(
                    "the output is ahead of the input by {gap:.3g} arcmin in both directions, "
                    "which no reducer does: one encoder's readings are delayed",
                    -gap / ARCMIN,
                ),
                "swing more slowly, or read both encoders at the same moments",
                severe=True,
            )
        )
    if np.ptp(local) > max(0.3 * abs(gap), 8.0 * along):
        findings.append(
            Finding(
                "uneven gap",
                Message(
                    "the gap between both directions is {low:.3g} to {high:.3g} arcmin along the "
                    "strokes",
                    local.min() / ARCMIN,
                    local.max() / ARCMIN,
                ),
                "swing further and more slowly; check both encoders for a delay",
            )
        )
    bands = [_dead_band(swing, gap, noise, step) for swing in swings[1:]]
    dead, spacing = (np.array(column) for column in zip(*bands, strict=True))
    dead = np.minimum(dead, 1.2 * max(gap, 0.0))  # without a gap the output doesn't stop
    sampled = float(np.hypot(step / 6.0**0.5, float(np.mean(spacing)) / 12.0**0.5))
    counts = BudgetLine("resolution", sampled / ARCMIN)
    scale = BudgetLine("ratio", abs(slope - 1.0) * float(dead.mean()) / 3.0**0.5 / ARCMIN)
    backlash = _over_strokes(dead, noise, [*common, counts, scale])
    return SwingsResult(
        float(ratio), lost, backlash, longest, swings, (*samples.findings, *findings)
    )


def _gaps(swings: tuple[Swing, ...], low: float, high: float) -> Floats:
    """Return the gap between each stroke and the one before: how much the output lags."""
    means = np.array([swing.mean_error(low, high) for swing in swings])
    signs = np.array([-1.0 if swing.forward else 1.0 for swing in swings[1:]])
    return np.asarray(signs * np.diff(means))


def _dead_band(swing: Swing, gap: float, noise: float, step: float) -> tuple[float, float]:
    """Return the travel after a reversal until the output follows, and the sample spacing there.

    The output stands still, then follows along a line. The start is a mean of possible starts of
    that line, weighted by how well each fits.
    """
    travel = np.abs(swing.angle_rad - swing.angle_rad[0])
    turn = 1.0 if swing.forward else -1.0
    moved = turn * (swing.angle_rad + swing.error_rad)
    moved = moved - float(np.median(moved[: max(1, min(5, moved.size // 20))]))
    enough = max(0.3 * abs(gap), 8.0 * noise, 4.0 * step)
    beyond = np.flatnonzero(moved > enough)
    stop = min(max(int(beyond[0]) + 1 if beyond.size else moved.size, 6), moved.size)
    x, y = travel[:stop], moved[:stop]
    starts = np.linspace(0.0, float(x.max()), 200, endpoint=False)
    basis = np.maximum(x[:, None] - starts[None, :], 0.0)
    basis = basis - basis.mean(axis=0)
    y = y - y.mean()
    size = np.sum(basis**2, axis=0)
    along = y @ basis
    gain = np.where((size > 0.0) & (along > 0.0), along**2 / np.where(size > 0.0, size, 1.0), 0.0)
    squares = float(y @ y) - float(gain.max())
    variance = max(noise**2, step**2 / 12.0, squares / max(stop - 3, 1), 1e-30)
    weight = np.exp(np.maximum((gain - gain.max()) / (2.0 * variance), -700.0))
    band = float(weight @ starts / weight.sum())
    at = int(np.clip(np.searchsorted(travel[:stop], band), 1, stop - 1))
    return band, float(abs(travel[at] - travel[at - 1]))


def _mean_slope(swings: tuple[Swing, ...], low: float, high: float) -> float:
    """Return the mean slope of the error over an interval, from its values at both ends."""
    width = (high - low) / ENDS
    rise = [
        swing.mean_error(high - width, high) - swing.mean_error(low, low + width)
        for swing in swings
    ]
    return float(np.mean(rise)) / (high - low - width)


def _over_strokes(values: Floats, noise: float, common: Sequence[BudgetLine]) -> Budget:
    """Return the mean of differences between strokes, rad, as a budget in arcmin."""
    # Neighbouring differences share a stroke, so that their correlation is one half.
    count = values.size
    centred = np.eye(count) - 1.0 / count
    alike = np.eye(count) + 0.5 * (np.eye(count, k=1) + np.eye(count, k=-1))
    repeating = centred @ alike
    freedom = float(np.trace(repeating) ** 2 / np.trace(repeating @ repeating))
    squares = float(np.sum((values - values.mean()) ** 2)) / float(np.trace(repeating))
    scatter = (squares * float(alike.sum())) ** 0.5 / count
    parts = [BudgetLine("strokes", scatter / ARCMIN, freedom), *common]
    if scatter == 0.0:
        parts.append(BudgetLine("noise", noise / ARCMIN))
    return budget(float(values.mean()) / ARCMIN, "arcmin", parts)


def _slope(
    swings: tuple[Swing, ...], low: float, high: float, ratio: float
) -> tuple[float, list[Finding]]:
    """Return the output's travel per stated travel; report or refuse a deviating ratio."""
    products = squares = 0.0
    for swing in swings:
        inside = (swing.angle_rad > low) & (swing.angle_rad < high)
        angle, error = (values[inside] for values in (swing.angle_rad, swing.error_rad))
        if angle.size > 2:
            products += float((angle - angle.mean()) @ (error - error.mean()))
            squares += float((angle - angle.mean()) @ (angle - angle.mean()))
    slope = 1.0 + (products / squares if squares else 0.0)
    measured = ratio / slope if slope else np.inf
    if not abs(slope - 1.0) <= COARSE:
        raise InputError(
            Message("angles that show a ratio of {shown:.4g}", measured),
            Message("{ratio:g} within {limit:g} %", ratio, 100 * COARSE),
            "check the ratio, its sign, the angles' units, and which column is which",
        )
    if abs(slope - 1.0) <= RATIO_TOLERANCE:
        return slope, []
    return slope, [
        Finding(
            "ratio over a part of a turn",
            Message(
                "the angles show a ratio of {shown:.5g} instead of {ratio:g} here: a wrong ratio, "
                "or a transmission error; both directions share it",
                measured,
                ratio,
            ),
            "turn by a whole output revolution to tell",
        )
    ]
