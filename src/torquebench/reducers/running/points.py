"""Steady points of running torque, from a table, the windows of a log, or parts of a ramp."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.preparation import (
    Samples,
    decimal_step,
    grouped,
    is_ramp,
    moving_mean,
    noise_of,
    outliers,
    repeat_outliers,
    windows_of,
)
from torquebench.reducers.quantities import Finding

Floats = NDArray[np.float64]
TOLERANCE, SAME_VALUE = 0.005, 0.05
"""Largest range of speeds within one step, as shares of the largest speed and of the step's
speed."""
RAMP_PARTS = 45
AT_REST = 0.01
"""Share of the largest speed below which a log's shaft is at rest."""
OFFSET_SIGNIFICANT = 2.0
LEAST_PAIRS = 4
"""Fewest speeds driven in both directions whose sums are compared."""


@dataclass(frozen=True, eq=False)
class SpeedPoints:
    """Points as columns, and the speed step that each belongs to.

    Parameters
    ----------
    samples : Samples
        Samples with speed_rpm, torque_nm and the other columns of the table.
    group : array of int, shape (n,)
        Step of each point, from the lowest speed.
    own_nm : array of float, shape (n,)
        Standard uncertainty of each point from the scatter in its window; NaN for a point of a
        table.
    resolution_nm : float
        Last decimal place of the torque; 0 if it shows none.
    offset_nm, offset_u_nm : float
        Offset that was subtracted from all torques, and its standard uncertainty.
    ramp : pair of array, or None
        Speeds and torques of a ramp in short blocks, for the fit of friction, which bends within a
        point's range of speeds. The offset isn't subtracted from them.
    """

    samples: Samples
    group: NDArray[np.int64]
    own_nm: Floats
    resolution_nm: float
    offset_nm: float = 0.0
    offset_u_nm: float = 0.0
    ramp: tuple[Floats, Floats] | None = None

    @property
    def speed(self) -> Floats:
        """Speed of each point, 1/min."""
        return self.samples["speed_rpm"]

    @property
    def torque(self) -> Floats:
        """Torque of each point, N·m."""
        return self.samples["torque_nm"]

    @property
    def branch(self) -> Floats:
        """+1 while the speed's magnitude rises, -1 while it falls, 0 unknown."""
        return self.samples.get("branch", 0.0)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Remarks."""
        return self.samples.findings


def speed_points(
    samples: Samples,
    *,
    tolerance_rpm: float | None = None,
    zeroed: bool = False,
    steady: bool = False,
) -> SpeedPoints:
    """Return the steady points of a recording.

    Unless rows are steady points, a log with many samples at each speed is averaged over its steady
    windows, and a ramp over parts of it. Points of one demanded speed are one step, otherwise those
    within a tolerance. Outliers are left out. Unless the torque was zeroed, an offset is estimated
    where both directions were driven.
    """
    resolution = decimal_step(samples["torque_nm"])
    if not steady:
        samples = windows_of(samples, ("speed_rpm",), ("torque_nm",))
    own, speed = samples.get("own_torque_nm", float("nan")), samples["speed_rpm"]
    logged = bool(np.isfinite(own).all())
    resting = np.abs(speed) <= (AT_REST * float(np.max(np.abs(speed))) if logged else 0.0)
    if resting.all():
        raise InputError(
            "a speed of 0 in all rows", "points at which the input turns", "check the column"
        )
    if resting.any():
        remark = Finding(
            "at rest",
            Message("{count} points without speed are left out", int(resting.sum())),
            "a torque at rest is a break-away torque, not a running one",
        )
        samples, own = samples.where(~resting).with_finding(remark), own[~resting]
        speed = samples["speed_rpm"]
    if logged and "branch" not in samples.columns:
        samples = samples.having(branch=_branch(speed))
    ramp = None
    demanded = samples.columns.get("demanded_rpm")
    if demanded is not None:
        group = np.unique(demanded, return_inverse=True)[1].ravel().astype(np.int64)
    else:
        group = same_speeds(speed, tolerance_rpm)
        if not (logged or steady) and is_ramp(speed, group):
            samples = samples.screened(torque=samples["torque_nm"])
            ramp = (_blocks(samples["speed_rpm"]), _blocks(samples["torque_nm"]))
            samples, group, own = _of_ramp(samples)
    points = SpeedPoints(samples, group, own, resolution, ramp=ramp)
    points = _without_outliers(points)
    return points if zeroed else _less_offset(points)


def same_speeds(speed: Floats, tolerance_rpm: float | None) -> NDArray[np.int64]:
    """Group speeds within a tolerance; by default 0.5 % of the largest, at most 5 % of own."""
    if tolerance_rpm is not None:
        return grouped(speed, tolerance_rpm)
    near = np.minimum(TOLERANCE * float(np.max(np.abs(speed))), SAME_VALUE * np.abs(speed))
    return grouped(speed, near)


def _branch(speed: Floats) -> Floats:
    """Return +1 where the size of the speed grows or the direction changes, -1 where it falls."""
    size = np.abs(speed)
    change = np.sign(np.diff(size, prepend=size[0]))
    change[np.diff(np.sign(speed), prepend=np.sign(speed[0])) != 0.0] = 1.0
    return np.asarray(change)


def _blocks(values: Floats) -> Floats:
    """Return means over blocks of neighbouring samples, so that 1,000 to 2,000 blocks remain."""
    size = max(1, values.size // 1000)
    return np.asarray(values[: values.size // size * size].reshape(-1, size).mean(axis=1))


def _of_ramp(samples: Samples) -> tuple[Samples, NDArray[np.int64], Floats]:
    """Average a ramp over parts of its speed range, separately while rising and falling.

    Returns the means with the number of the part that each belongs to, and the standard error of
    each mean torque by its noise.
    """
    speed = samples["speed_rpm"]
    # Narrower at low speed, where friction bends.
    share = (np.abs(speed) / float(np.max(np.abs(speed)))) ** (2.0 / 3.0)
    part = np.floor(share * RAMP_PARTS) * np.sign(speed)
    rising = np.sign(np.gradient(moving_mean(np.abs(speed), 9)))
    # The lowest parts of both directions have the number 0: the addend keeps them separate.
    key, index = np.unique(
        np.column_stack([part + 0.1 * np.sign(speed), rising]), axis=0, return_inverse=True
    )
    index = index.ravel()
    count = np.bincount(index)
    usable = count >= 3
    columns = {
        name: (np.bincount(index, weights=column) / count)[usable]
        for name, column in samples.columns.items()
    }
    columns["branch"] = key[usable, 1]
    own = (noise_of(samples["torque_nm"]) / np.sqrt(count))[usable]
    both = len(set(key[usable, 1].tolist())) > 1
    finding = Finding(
        "ramp of speed",
        Message(
            "the speed changes steadily: torques are means over {count} parts of the ramp{inertia}",
            int(usable.sum()),
            "" if both else ", and contain what accelerates the inertia",
        ),
        "ramp up and down, or measure in steps of speed",
    )
    first = np.array([np.flatnonzero(index == k)[0] for k in np.flatnonzero(usable)])
    ramp = replace(samples, columns=columns, row=samples.row[first]).with_finding(finding)
    group = np.unique(key[usable, 0], return_inverse=True)[1].ravel().astype(np.int64)
    return ramp, group, own


def _without_outliers(points: SpeedPoints) -> SpeedPoints:
    """Leave out points far from the repeats of their speed, or from the neighbouring speeds."""
    speed, torque = points.speed, points.torque
    bad = repeat_outliers(torque, points.group) | _unlike_directions(points)
    for sign in (1.0, -1.0):
        same_direction = np.flatnonzero(np.sign(speed) == sign)
        order = same_direction[np.argsort(np.abs(speed[same_direction]), kind="stable")]
        inner = points.group[order]
        # At the slowest and the fastest speed there are no neighbours on both sides.
        inside = (inner != inner[0]) & (inner != inner[-1]) if order.size else np.zeros(0, bool)
        bad[order[inside & outliers(torque[order])]] = True
    samples = points.samples.less({"torque": bad})
    if samples.row.size == bad.size:
        return replace(points, samples=samples)
    good = ~bad
    group = np.unique(points.group[good], return_inverse=True)[1].ravel().astype(np.int64)
    return replace(points, samples=samples, group=group, own_nm=points.own_nm[good])


def _unlike_directions(points: SpeedPoints) -> NDArray[np.bool_]:
    """Find single points whose torque doesn't match that of the opposite direction.

    The sum of both directions is compared with the sums at other speeds. Of an unlike pair, the
    outlier is the point that is farther from the next speeds of its direction.
    """
    count = np.bincount(points.group)
    speed = np.bincount(points.group, weights=points.speed) / count
    torque = np.bincount(points.group, weights=points.torque) / count
    bad = np.zeros(points.group.size, dtype=np.bool_)
    pairs = []
    for k in np.flatnonzero(speed > 0.0).tolist():
        other = int(np.argmin(np.abs(speed + speed[k])))
        if abs(speed[other] + speed[k]) <= SAME_VALUE * speed[k]:
            pairs.append((k, other))
    if len(pairs) < LEAST_PAIRS:
        return bad
    sums = np.array([torque[a] + torque[b] for a, b in pairs])
    far = repeat_outliers(sums, np.zeros(sums.size, dtype=np.int64))
    for a, b in (pairs[k] for k in np.flatnonzero(far).tolist()):
        apart = []
        for k in (a, b):
            side = np.flatnonzero((np.sign(speed) == np.sign(speed[k])) & (speed != speed[k]))
            near = side[np.argsort(np.abs(speed[side] - speed[k]), kind="stable")[:2]]
            apart.append(float(np.abs(torque[k] - np.median(torque[near]))))
        worse = a if apart[0] >= apart[1] else b
        if count[worse] == 1:
            bad |= points.group == worse
    return bad


def _less_offset(points: SpeedPoints) -> SpeedPoints:
    """Subtract half the sum of both directions as an offset, where it is significant."""
    count = np.bincount(points.group)
    speed = np.bincount(points.group, weights=points.speed) / count
    torque = np.bincount(points.group, weights=points.torque) / count
    forward, backward = speed > 0.0, speed < 0.0
    if not forward.any() or not backward.any():
        return points
    # Backward torques are interpolated at the forward speeds within their range.
    forward_speed, order = speed[forward], np.argsort(-speed[backward])
    backward_speed, backward_torque = -speed[backward][order], torque[backward][order]
    common = forward_speed >= 0.98 * backward_speed[0]
    common &= forward_speed <= 1.02 * backward_speed[-1]
    if not common.any():
        return points
    opposite = np.interp(forward_speed, backward_speed, backward_torque)
    halves = 0.5 * (torque[forward] + opposite)[common]
    offset = float(halves.mean())
    spread = float(np.std(halves, ddof=1)) / halves.size**0.5 if halves.size > 1 else 0.0
    scatter = points.torque - torque[points.group]
    freedom = points.torque.size - count.size
    noise = float(np.sqrt(np.sum(scatter**2) / freedom)) if freedom else 0.0
    error = max(spread, noise / points.torque.size**0.5, points.resolution_nm / 12.0**0.5)
    if abs(offset) <= OFFSET_SIGNIFICANT * error or not error > 0.0:
        return points
    finding = Finding(
        "torque offset",
        Message(
            "half the sum of both directions is {offset:.3g} N·m: subtracted as an offset of the "
            "torque",
            offset,
        ),
        "zero the torque before the test and state the uncertainty of its zero; a friction that "
        "differs by direction shows the same",
    )
    samples = points.samples.having(torque_nm=points.torque - offset).with_finding(finding)
    return replace(points, samples=samples, offset_nm=offset, offset_u_nm=error)
