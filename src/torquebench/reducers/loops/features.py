"""Features of one torque-angle loop: widths, compliances, energy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.loops.branches import RawLoop, Recording, branch_of
from torquebench.reducers.loops.local_fit import Branch, LocalLines, Reading, read
from torquebench.reducers.loops.results import (
    Feature,
    KeyPoint,
    LoopCurve,
    LoopFeatures,
    LoopSettings,
)
from torquebench.reducers.preparation import levels_of, noise_of

Floats = NDArray[np.float64]
Pieces = Sequence[Branch]
CURVE_POINTS = 401
REACHED = 0.97
"""Share of the stiffness interval's upper end that the torque has to reach."""
LEAST_OF_LINE = 3
"""Fewest knots of the line through a stiffness interval."""


def features_of(
    loops: Sequence[RawLoop], recording: Recording, settings: LoopSettings
) -> list[LoopFeatures]:
    """Read the loops of a position: local fits on both branches, widths, compliances and energy."""
    torque = recording.torque
    branches, ranges = [], []
    for raw in loops:
        sides = (raw.rising, raw.falling)
        ends = [torque[np.concatenate(pieces)] for pieces in sides]
        low, high = max(float(end.min()) for end in ends), min(float(end.max()) for end in ends)
        _check_range(raw, low, high, settings)
        branches.append([[branch_of(recording, rows) for rows in pieces] for pieces in sides])
        ranges.append((low, high))
    widest = settings.window_share * max(max(high, -low) for low, high in ranges)
    share = settings.lost_motion_rule.share * settings.rated_torque_nm
    up, down = (
        list(zip(*(_read(side, place, widest) for place in (0.0, share, -share)), strict=True))
        for side in zip(*branches, strict=True)
    )
    first, last = (part * settings.rated_torque_nm for part in settings.stiffness_interval)
    features = []
    for raw, (rising, falling), (low, high), u, d in zip(
        loops, branches, ranges, up, down, strict=True
    ):
        closure, noise = _closure(raw, recording)
        features.append(
            LoopFeatures(
                position=raw.position,
                loop=raw.number,
                curve=_curve(rising, falling, low, high, widest),
                backlash=_combined([d[0], u[0]], [1.0, -1.0]),
                lost_motion=_combined([u[1], d[1], u[2], d[2]], [0.5, 0.5, -0.5, -0.5]),
                compliance_positive=_compliance(rising, 1, first, last),
                compliance_negative=_compliance(falling, -1, first, last),
                regions=_regions(rising, falling, min(high, -low), settings),
                energy=_energy(rising, falling, raw, recording),
                closure_rad=closure,
                closure_noise_rad=noise,
                slope_at_zero=0.5 * abs(u[0].slope + d[0].slope),
                slope_at_lost_motion=0.25
                * abs(sum(key_point.slope for key_point in (*u[1:], *d[1:]))),
                slope_difference_at_zero=abs(d[0].slope - u[0].slope),
                largest_torque_nm=min(high, -low),
            )
        )
    return features


def _read(sides: Sequence[Pieces], torque: float, widest: float) -> list[Reading]:
    """Read a branch of each loop at a torque; in a single cycle, the piece that covers it.

    The first piece of a cycle isn't on the loop at its start: half the gap between both pieces is
    added to its readings.
    """
    if len(sides[0]) == 1:
        return read([pieces[0] for pieces in sides], torque, widest)
    last, first = sides[0]
    if float(last.torque.min()) <= torque <= float(last.torque.max()):
        return read([last], torque, widest)
    (begun,) = read([first], torque, widest)
    ends = [read([branch], 0.0, widest)[0] for branch in (last, first)]
    gap = ends[0].value - ends[1].value
    noise = float(np.linalg.norm([begun.noise, 0.5 * ends[0].noise, 0.5 * ends[1].noise]))
    between = float(np.hypot(begun.between, gap / 12.0**0.5))
    return [Reading(begun.value + 0.5 * gap, begun.slope, noise, begun.step, between)]


def _combined(readings: Sequence[Reading], weights: Sequence[float]) -> Feature:
    """Return a weighted sum of readings, and its uncertainty by source."""
    value = sum(w * each.value for w, each in zip(weights, readings, strict=True))

    def weighted(source: str) -> list[float]:
        """Return each reading's uncertainty by a source, times its weight."""
        return [
            abs(w) * getattr(reading, source) for w, reading in zip(weights, readings, strict=True)
        ]

    # The error of interpolation between samples is alike on both branches.
    noise, step = (float(np.linalg.norm(weighted(source))) for source in ("noise", "step"))
    return Feature(float(value), noise, step, sum(weighted("between")))


def _check_range(raw: RawLoop, low: float, high: float, settings: LoopSettings) -> None:
    """Refuse a loop that doesn't pass zero or doesn't reach the stiffness interval."""
    where = Message("loop {number} at position {position:g}", raw.number, raw.position)
    if low >= 0.0 or high <= 0.0:
        raise InputError(
            Message(
                "{where}: a torque of {low:.4g} to {high:.4g} N·m, which doesn't pass zero",
                where,
                low,
                high,
            ),
            "a loop from negative to positive torque",
            "remove the preload that hides backlash and lost motion, and check the zero",
        )
    need = settings.stiffness_interval[1] * settings.rated_torque_nm
    if min(high, -low) < REACHED * need:
        raise InputError(
            Message(
                "{where}: the torque reaches {low:.4g} to {high:.4g} N·m only", where, low, high
            ),
            Message("±{need:.4g} N·m, the upper end of the stiffness interval", need),
            "load the reducer further (does the drive saturate?), or state a lower rated torque "
            "or stiffness interval",
        )


def _curve(rising: Pieces, falling: Pieces, low: float, high: float, widest: float) -> LoopCurve:
    """Return both branches of a loop on one grid of torques, denser around zero."""
    # Twice as dense around zero, where backlash is.
    even = np.linspace(low, high, CURVE_POINTS)
    near = np.linspace(0.1 * low, 0.1 * high, CURVE_POINTS // 2)
    grid = np.unique(np.concatenate([even, near]))
    columns = []
    for pieces in (rising, falling):
        angle = LocalLines(pieces[-1], widest).at(grid).value
        if len(pieces) == 2:
            first = LocalLines(pieces[0], widest).at(grid).value
            sign = -1.0 if pieces[0].torque.mean() < 0.0 else 1.0
            angle = np.where(sign * grid >= 0.0, first, angle)
        columns.append(angle)
    return LoopCurve(grid, *columns)


def _compliance(pieces: Pieces, sign: int, low_nm: float, high_nm: float) -> Feature:
    """Return Δθ/ΔT by least squares over an interval of the loading branch, rad/(N·m)."""
    branch = max(pieces, key=lambda each: float(np.max(sign * each.torque)))
    load = sign * branch.torque
    inside = (load >= low_nm * (1.0 - 1e-9)) & (load <= high_nm * (1.0 + 1e-9))
    if np.count_nonzero(inside) < LEAST_OF_LINE:
        raise InputError(
            Message(
                "{count} samples, levels or counts between {lower_nm:.4g} and {upper_nm:.4g} N·m",
                np.count_nonzero(inside),
                low_nm,
                high_nm,
            ),
            Message("at least {limit}", LEAST_OF_LINE),
            "record more samples per loop, or use a finer encoder",
        )
    x, y, weight = _on_interval(load, sign * branch.angle, low_nm, high_nm)
    slope, gain = _line(x, y, weight)
    # The change of the slope without every other knot bounds the error of interpolation between
    # knots; for sparse knots, so does the change without the interpolated ends.
    others = [_line(*_on_interval(load[::2], sign * branch.angle[::2], low_nm, high_nm))[0]]
    if branch.sparse:
        others.append(_line(load[inside], sign * branch.angle[inside], np.ones(inside.sum()))[0])
    difference = max(abs(slope - other) for other in others)
    noise = branch.noise * gain
    between = float(np.sqrt(max(difference**2 - (3.0 * noise) ** 2, 0.0) / 3.0))
    if len(pieces) == 2 and branch is pieces[1]:
        # The first piece of a single cycle joins the loop somewhere before its end.
        bend = _gap(pieces) / float(np.ptp(branch.torque))
        slope, between = slope + 0.5 * bend, float(np.hypot(between, bend / 12.0**0.5))
    if slope == 0.0:
        raise InputError(
            "an angle that doesn't follow the torque",
            "an angle that changes with the torque",
            "check the encoder and the columns",
        )
    # If steps of the angle beat with those of the torque, the whole line tilts.
    return Feature(slope, noise, branch.step * 2.0**0.5 / float(np.ptp(load[inside])), between)


def _line(x: Floats, y: Floats, weight: Floats) -> tuple[float, float]:
    """Return the slope of a weighted line, and the factor from noise to its standard error."""
    x, y = (values - np.average(values, weights=weight) for values in (x, y))
    squares = float(weight @ x**2)
    return float(weight @ (x * y)) / squares, float(np.linalg.norm(weight * x)) / squares


def _on_interval(
    torque: Floats, angle: Floats, low: float, high: float
) -> tuple[Floats, Floats, Floats]:
    """Return torques and angles in an interval with interpolated ends, and their weights."""
    order = np.argsort(torque, kind="stable")
    x, y = torque[order], angle[order]
    ends = np.array([low, high])
    if not (x[0] <= low and high <= x[-1]):
        reach = 0.5 * (high - low)  # reach beyond the knots by at most half the interval
        ends = np.array([max(low, float(x[0]) - reach), min(high, float(x[-1]) + reach)])
    inside = (x > ends[0]) & (x < ends[1])
    x, y = (
        np.concatenate([part[:1], column[inside], part[1:]])
        for part, column in ((ends, x), (_extended(ends, x, y), y))
    )
    return x, y, 0.5 * (np.diff(x, prepend=x[0]) + np.diff(x, append=x[-1]))


def _extended(place: Floats, x: Floats, y: Floats) -> Floats:
    """Interpolate between points, and extend the outermost lines beyond them."""
    value = np.interp(place, x, y)
    for end, other in ((0, 1), (-1, -2)):
        beyond = place < x[0] if end == 0 else place > x[-1]
        if np.any(beyond) and x[end] != x[other]:
            slope = (y[end] - y[other]) / (x[end] - x[other])
            value = np.where(beyond, y[end] + slope * (place - x[end]), value)
    return np.asarray(value)


def _regions(
    rising: Pieces, falling: Pieces, largest: float, settings: LoopSettings
) -> tuple[Feature | None, ...]:
    """Return the stiffness of the three regions of torque; None for a region not reached."""
    if settings.region_torques_nm is None:
        return (None, None, None)
    first, second = settings.region_torques_nm
    stiffness: list[Feature | None] = []
    for low, high in ((0.0, first), (first, second), (second, largest)):
        top = min(high, largest)
        if top < low + 0.1 * (second - first):
            stiffness.append(None)
            continue
        sides = (_compliance(rising, 1, low, top), _compliance(falling, -1, low, top))
        stiffness.append(Feature.mean(*sides))
    return tuple(stiffness)


def _energy(rising: Pieces, falling: Pieces, raw: RawLoop, recording: Recording) -> Feature:
    """Return the area of the loop, from its samples, or from the levels of a stepped torque."""
    step = recording.step_rad
    if levels_of(recording.torque[raw.rising[0]]):
        branches = [*rising, *falling]
    else:
        subtracted = recording.subtracted
        branches = [
            Branch(
                recording.torque[rows],
                (recording.angle - subtracted)[rows],
                noise_of((recording.angle - subtracted)[rows]),
                0.0,
            )
            for rows in (*raw.rising, *raw.falling)
        ]
    # Squared standard deviations of the area: by the noise, and by the steps of the angle.
    squares = steps = 0.0
    for branch in branches:
        squares += float(np.sum(np.diff(branch.torque) ** 2)) * branch.noise**2
        # If steps of the angle beat with those of the torque, a whole branch is raised.
        steps += (float(np.ptp(branch.torque)) * branch.step) ** 2
    area, coarser = (_area(branches, every) for every in (1, 2))  # from all, from half the samples
    hidden = max((area - coarser) ** 2 - 9.0 * squares, 0.0) / 3.0
    # The ends of a branch cut its first and last count, so that their angles are known less well.
    x, y = (
        np.concatenate([getattr(each, name) for each in branches]) for name in ("torque", "angle")
    )
    per_count = step * float(np.ptp(x)) / max(float(np.ptp(y)), 1e-300)
    steps = float(np.hypot(steps**0.5, step * per_count / 8.0 * (4.0 / 3.0) ** 0.5))
    between = 0.0
    for pieces in (rising, falling):
        if len(pieces) == 2:
            # The first piece of a single cycle joins the loop somewhere before its end.
            gap = _gap(pieces) * float(np.ptp(pieces[1].torque))
            area += 0.25 * gap
            between = gap / 4.0 / 3.0**0.5
    return Feature(area, squares**0.5, steps, float(np.hypot(between, hidden**0.5)))


def _area(branches: Sequence[Branch], every: int) -> float:
    """Return the area of a loop from every `every`-th knot and the ends of its branches."""
    path = []
    for branch in branches:
        rows = np.unique(np.append(np.arange(0, branch.torque.size, every), branch.torque.size - 1))
        path.append((branch.torque[rows], branch.angle[rows]))
    x, y = (np.concatenate(column) for column in zip(*path, strict=True))
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _gap(pieces: Pieces) -> float:
    """Return the gap between the start and the end of a single cycle."""
    return abs(float(pieces[1].angle[0] - pieces[0].angle[-1]))


def _closure(raw: RawLoop, recording: Recording) -> tuple[float, float]:
    """Return the angle at the loop's end less that at its start, at equal torque, and its noise."""
    if len(raw.rising) != len(raw.falling):
        return 0.0, 0.0
    rows = raw.rows
    torque, angle = recording.torque[rows], (recording.angle - recording.subtracted)[rows]
    count = max(1, rows.size // 100)
    nearest = slice(-(rows.size // 16 + 4), None)
    load = torque[nearest]
    slope = float(np.polyfit(load, angle[nearest], 1)[0]) if np.ptp(load) > 0.0 else 0.0
    gap = slope * float(torque[-count:].mean() - torque[:count].mean())
    unloaded = angle - slope * torque
    (start, first), (end, last) = (_outer_end(unloaded[::way][:count]) for way in (1, -1))
    noise = float(np.hypot(noise_of(angle), slope * noise_of(torque))) * (8.0 / count) ** 0.5
    # At a reversal the slope may change by about half of itself.
    parts = [noise, first, last, recording.step_rad / 6.0**0.5, 0.3 * gap]
    return end - start, float(np.linalg.norm(parts))


def _outer_end(values: Floats) -> tuple[float, float]:
    """Return a line's value at the first of a few samples, and their scatter about it.

    A loop is wider beside its tip: the mean of these samples would be away from the tip.
    """
    if values.size < 4:
        return float(values.mean()), 0.0
    position = np.arange(values.size) - 0.5 * (values.size - 1)
    slope, middle = np.polyfit(position, values, 1)
    scatter = float(np.std(values - middle - slope * position, ddof=2))
    return float(middle - slope * 0.5 * (values.size - 1)), scatter


def key_points_of(features: LoopFeatures, settings: LoopSettings) -> tuple[KeyPoint, ...]:
    """Return the points of a loop that a figure marks."""
    curve, rule = features.curve, settings.lost_motion_rule
    share = rule.share * settings.rated_torque_nm
    percent = Message("{share:g} %", 100 * rule.share)
    low, high = (part * settings.rated_torque_nm for part in settings.stiffness_interval)
    high = min(high, features.largest_torque_nm)
    marks = [
        ("θ↑(0)", 0.0, curve.rising_rad),
        ("θ↓(0)", 0.0, curve.falling_rad),
        (f"θ↑(+{percent})", share, curve.rising_rad),
        (f"θ↓(+{percent})", share, curve.falling_rad),
        (f"θ↑(−{percent})", -share, curve.rising_rad),
        (f"θ↓(−{percent})", -share, curve.falling_rad),
        ("stiffness, lower end", low, curve.rising_rad),
        ("stiffness, upper end", high, curve.rising_rad),
        ("stiffness, lower end", -low, curve.falling_rad),
        ("stiffness, upper end", -high, curve.falling_rad),
    ]
    return tuple(
        KeyPoint(label, place, float(np.interp(place, curve.torque_nm, branch)))
        for label, place, branch in marks
    )
