"""Cut recordings of torque and angle into loops of two branches, and subtract their drift.

A branch is reduced to knots: its samples, the levels of a stepped torque, or the torques at which a
coarse angle changes its count. Where a count changes, the angle is known exactly, and the torque
within the interval between two samples; the mean torque of a count is less exact.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.loops.local_fit import Branch
from torquebench.reducers.preparation import (
    levels_of,
    moving_mean,
    noise_of,
    turning_points,
)

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]
QUIET_SHARE = 0.004
"""Noise of the torque, as a share of its largest value, below which loops need no averaging."""
LONGEST_MEAN = 0.02
"""Largest share of a record between two reversals over which noise is averaged."""
FULL_SPAN = 0.8
"""A branch is complete if it spans this share of the widest."""
AT_THE_END = 0.9
"""A labelled loop begins and ends within this share of its largest torque."""
COUNTED = 0.5
"""Share of unchanged counts from which on an angle is read only where its count changes."""
SETTLED = 0.5
"""Share of a level's samples that is left out because the angle may still follow the torque."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Torque (N·m) and angle (rad) in the order of measurement.

    `subtracted` (twist of the bench, drift) goes off the angle after its reduction to knots.
    `step_rad` is the visible step of the angle's counts, 0 for none; `loop` the number of the loop
    at its position, if stated.
    """

    torque: Floats
    angle: Floats
    position: Floats
    subtracted: Floats
    loop: Floats | None = None
    time: Floats | None = None
    step_rad: float = 0.0

    def at(self, rows: Indices) -> Recording:
        """Return some of the samples."""
        loop, time = (None if values is None else values[rows] for values in (self.loop, self.time))
        return Recording(
            self.torque[rows],
            self.angle[rows],
            self.position[rows],
            self.subtracted[rows],
            loop,
            time,
            self.step_rad,
        )

    def changed(self, torque: Floats, angle: Floats) -> Recording:
        """Return the recording with a new torque and a corrected angle that shows no counts."""
        nothing = np.zeros(angle.size)
        return replace(self, torque=torque, angle=angle, subtracted=nothing, step_rad=0.0)

    def place(self, loops: Sequence[RawLoop]) -> Floats:
        """Return each sample's time since the first loop began, in durations of a loop."""
        time = np.arange(self.torque.size, dtype=np.float64)
        if self.time is not None and np.all(np.diff(self.time[loops[0].rows[0] :]) >= 0.0):
            time = self.time
        ends = [time[loop.rows[[0, -1]]] for loop in loops]
        span = float(ends[-1][1] - ends[0][0]) / len(loops)
        return np.asarray((time - ends[0][0]) / max(span, 1e-300))

    def positions(self) -> list[Indices]:
        """Return the samples of each output position, in the order of measurement."""
        _, first = np.unique(self.position, return_index=True)
        return [np.flatnonzero(self.position == self.position[k]) for k in np.sort(first)]


@dataclass(frozen=True, eq=False)
class RawLoop:
    """Samples of one loop: rows while the torque rises and falls, in time order.

    In a single cycle 0 → +T → −T → 0 one branch consists of two pieces: the cycle's last part, then
    its first.
    """

    position: float
    number: int
    rising: tuple[Indices, ...]
    falling: tuple[Indices, ...]

    @property
    def rows(self) -> Indices:
        """All rows, in time order."""
        return np.sort(np.concatenate([*self.rising, *self.falling]))


def averaged(recording: Recording) -> tuple[Recording, int]:
    """Average noisy torque and its angle over as few neighbouring samples as the noise requires.

    Noise of the torque blurs a loop where it is steep, which no fit of angle against torque can
    undo. Both are averaged over the same odd number of samples, which is also returned: 1 where the
    noise is below 0.4 % of the largest torque.
    """
    torque, angle, widest = recording.torque.copy(), recording.angle - recording.subtracted, 1
    for rows in recording.positions():
        load = torque[rows]
        if load.size < 32 or levels_of(load):
            continue
        branches = max(turning_points(load).size - 1, 1)
        noise, quiet = noise_of(load), QUIET_SHARE * float(np.quantile(np.abs(load), 0.99))
        longest = int(LONGEST_MEAN * load.size / branches)
        width = min(int((noise / quiet) ** 2) + 1, longest) if noise > quiet else 1
        width -= 1 - width % 2
        if width >= 3:
            torque[rows], angle[rows] = moving_mean(load, width), moving_mean(angle[rows], width)
            widest = max(widest, width)
    if widest == 1:
        return recording, 1
    return recording.changed(torque, angle), widest


# -- cutting ----------------------------------------------------------------------------------


def cut_loops(recording: Recording) -> Iterator[RawLoop]:
    """Yield the loops of a recording, position by position in the order of measurement.

    Labelled loops that begin and end at their largest torque aren't cut. All others are cut at the
    torque's reversals. The part before the first complete branch (from zero, or a preload) belongs
    to no loop, except in a single cycle 0 → +T → −T → 0.
    """
    torque = recording.torque
    for rows in recording.positions():
        label = float(recording.position[rows[0]])
        pieces = None
        if recording.loop is not None:
            pieces = _labelled(torque, rows, recording.loop[rows])
        if pieces is None:
            parts = _parts(torque[rows], rows)
            pieces = _cut(torque, parts) or _single_cycle(torque, parts)
        if not pieces:
            raise InputError(
                Message(
                    "no whole loop at position {label:g}: the torque goes from {first_nm:.4g} "
                    "to {last_nm:.4g} N·m and never back",
                    label,
                    torque[rows].min(),
                    torque[rows].max(),
                ),
                "at least one loop from one end of the torque to the other and back",
                "record −T → 0 → +T → 0 → −T, three loops by preference",
            )
        for number, (rising, falling) in enumerate(pieces, 1):
            yield RawLoop(label, number, rising, falling)


Pieces = tuple[Indices, ...]


def _labelled(torque: Floats, rows: Indices, numbers: Floats) -> list[tuple[Pieces, Pieces]] | None:
    """Return rising and falling rows of each numbered loop; None if a loop is incomplete."""
    pieces: list[tuple[Pieces, Pieces]] = []
    for number in dict.fromkeys(numbers.tolist()):
        loop_rows = rows[numbers == number]
        end = float(np.max(np.abs(torque[loop_rows])))
        ends = np.abs(torque[loop_rows[[0, -1]]])
        if loop_rows.size < 8 or np.any(ends < AT_THE_END * end):
            return None
        parts = _parts(torque[loop_rows], loop_rows)
        rising = [part for sign, part in parts if sign > 0]
        falling = [part for sign, part in parts if sign < 0]
        if not rising or not falling:
            return None
        pieces.append(((np.concatenate(rising),), (np.concatenate(falling),)))
    return pieces


def _parts(torque: Floats, rows: Indices) -> list[tuple[int, Indices]]:
    """Cut a record at the torque's reversals; a level at a reversal belongs to both parts."""
    turns = turning_points(torque)
    levels = levels_of(torque)
    begins, ends = turns.copy(), turns.copy()
    if levels:
        stops = np.array([part.stop for part in levels])
        at = np.minimum(np.searchsorted(stops, turns, side="right"), len(levels) - 1)
        begins = np.minimum(turns, np.array([part.start for part in levels])[at])
        ends = np.maximum(turns, stops[at] - 1)
    return [
        (1 if torque[turns[k + 1]] > torque[turns[k]] else -1, rows[begins[k] : ends[k + 1] + 1])
        for k in range(turns.size - 1)
    ]


def _span(torque: Floats, part: Indices) -> float:
    return abs(float(torque[part[-1]] - torque[part[0]]))


def _cut(torque: Floats, parts: list[tuple[int, Indices]]) -> list[tuple[Pieces, Pieces]]:
    """Return rising and falling parts of each loop that spans nearly the whole torque."""
    widest = max(_span(torque, part) for _, part in parts)
    strokes = [(sign, part) for sign, part in parts if _span(torque, part) >= FULL_SPAN * widest]
    pieces: list[tuple[Pieces, Pieces]] = []
    for (sign, first), (other, second) in zip(strokes[::2], strokes[1::2], strict=False):
        if sign != other:
            pieces.append(((first,), (second,)) if sign > 0 else ((second,), (first,)))
    return pieces


def _single_cycle(torque: Floats, parts: list[tuple[int, Indices]]) -> list[tuple[Pieces, Pieces]]:
    """Return the loop of a single cycle that begins and ends near zero torque, if it is one."""
    if len(parts) != 3:
        return []
    (sign, first), (_, middle), (_, last) = parts
    half_span = 0.5 * _span(torque, middle)
    if min(_span(torque, first), _span(torque, last)) < FULL_SPAN * half_span:
        return []
    return [((last, first), (middle,))] if sign > 0 else [((middle,), (last, first))]


# -- knots ------------------------------------------------------------------------------------


def branch_of(recording: Recording, rows: Indices) -> Branch:
    """Reduce the samples of one branch to knots."""
    torque, angle, step = recording.torque[rows], recording.angle[rows], recording.step_rad
    subtracted = recording.subtracted[rows]
    levels = levels_of(torque)
    if levels:
        return _of_levels(torque, angle, subtracted, levels, step)
    if step > 0.0 and np.mean(np.diff(angle) == 0.0) >= COUNTED:
        return _of_counts(torque, angle, subtracted, step)
    angle = angle - subtracted
    # If the torque passes the steps of the angle quickly, they scatter like noise.
    noise = float(
        np.hypot(max(noise_of(angle), step / 12.0**0.5), _slope(torque, angle) * noise_of(torque))
    )
    return Branch(torque, angle, noise, 0.0)


def _slope(torque: Floats, angle: Floats) -> float:
    span = float(np.ptp(torque))
    return float(np.ptp(angle)) / span if span else 0.0


def _of_levels(
    torque: Floats, angle: Floats, subtracted: Floats, levels: list[slice], step: float
) -> Branch:
    """Reduce a stepped torque to knots: mean torque and mean settled angle of each level."""
    inside = sum(abs(float(angle[part][-1] - angle[part][0])) for part in levels)
    ramped = inside > 0.5 * float(np.ptp(angle))
    steps = []
    for part in levels:
        size = part.stop - part.start
        steps.append(slice(part.start + (0 if ramped else int(SETTLED * size)), part.stop))
    load, twist = (np.array([column[part].mean() for part in steps]) for column in (torque, angle))
    scatter = np.concatenate([np.diff(angle[part]) for part in steps])
    noise = float(np.sqrt(np.mean(scatter**2) / 2.0)) if scatter.size else 0.0
    if ramped:
        noise = noise_of(angle)
    count = float(np.mean([part.stop - part.start for part in steps]))
    twist = twist - np.array([subtracted[part].mean() for part in steps])
    return Branch(load, twist, noise / count**0.5, step / 12.0**0.5, sparse=True)


def _of_counts(torque: Floats, angle: Floats, subtracted: Floats, step: float) -> Branch:
    """Return the torques at which a counted angle passes from one count to the next.

    Near a passage the count chatters between its two values. The passage is placed so that as many
    earlier samples have the new count as later samples have the old one, which chatter doesn't
    move. A passage whose chatter reaches an end of the branch is left out.
    """
    turn = 1.0 if angle[-1] >= angle[0] else -1.0
    count = np.rint(turn * (angle - angle[0]) / step).astype(np.int64)
    lowest, highest = int(count.min()), int(count.max())
    passed = np.arange(lowest, highest)
    below = np.cumsum(np.bincount(count - lowest, minlength=highest - lowest + 1))[:-1]
    first = np.searchsorted(np.maximum.accumulate(count), passed, side="right")
    last = np.searchsorted(np.minimum.accumulate(count[::-1])[::-1], passed, side="right") - 1
    inside = (first > 0) & (last < count.size - 1)
    chatter = float(np.mean((last - first + 1)[inside])) if inside.any() else 0.0
    place, begin = np.unique(below[inside], return_index=True)
    passed = passed[inside]
    end = np.append(begin[1:], passed.size) - 1
    middle = 0.5 * (passed[begin] + passed[end]) + 0.5
    load, shift = (0.5 * (values[place - 1] + values[place]) for values in (torque, subtracted))
    between = float(np.median(np.abs(np.diff(torque)))) * _slope(torque, angle)
    # The variance of a passage comes from the spacing of the samples and from the length of its
    # chatter.
    return Branch(
        load,
        angle[0] + turn * step * middle - shift,
        between * (0.15 * chatter) ** 0.5,
        between / 12.0**0.5,
        sparse=True,
    )


# -- drift ------------------------------------------------------------------------------------

BINS = 24
HIGHEST_DEGREE = 3
BENDS = 9.0
"""Gain in the sum of squares, in residual variances, from which on the drift gets a higher
degree."""


@dataclass(frozen=True, eq=False)
class Drift:
    """Drift of the angle at one position: what is subtracted from each sample, and its size.

    `share` is the relative standard uncertainty of the subtracted drift; `significant` says whether
    the drift exceeds the noise of the loops.
    """

    rad: Floats
    per_loop_rad: float
    share: float
    significant: bool


def steady_drift(recording: Recording, loop: RawLoop, gap_rad: float, noise_rad: float) -> Drift:
    """Return half the gap of a single loop as a steady drift, if the gap exceeds its noise.

    The gap may be drift, or the first samples may not have been on the loop yet: U covers both.
    """
    position = recording.place([loop])
    if abs(gap_rad) <= 3.0 * noise_rad:
        return Drift(0.0 * position, 0.0, 0.0, significant=False)
    half = 0.5 * gap_rad
    # The gap is all drift or none: the ends are likelier than the middle (arcsine distribution).
    share = float(np.hypot(2.0**-0.5, noise_rad / half))
    return Drift(half * position, gap_rad, share, significant=True)


def drift_of(recording: Recording, loops: Sequence[RawLoop]) -> Drift:
    """Return the drift: how loops of one position differ at equal torque on equal branches.

    The drift is a polynomial of time, of a degree below the number of loops. It is fitted together
    with a line of angle over torque in each part of each branch.
    """
    sides = [(0, loop.rising) for loop in loops] + [(1, loop.falling) for loop in loops]
    rows = np.concatenate([piece for _, pieces in sides for piece in pieces])
    branch = np.concatenate(
        [np.full(piece.size, side) for side, pieces in sides for piece in pieces]
    )
    torque, angle = recording.torque[rows], (recording.angle - recording.subtracted)[rows]
    low, high = float(torque.min()), float(torque.max())
    bins = int(np.clip(rows.size / (12 * len(loops)), 4, BINS))
    part = np.clip(((torque - low) / (high - low) * bins).astype(np.int64), 0, bins - 1)
    cell = part + bins * branch
    degrees = min(HIGHEST_DEGREE, len(loops) - 1)
    moment = recording.place(loops)  # in loops
    powers = np.column_stack([moment ** (k + 1) for k in range(degrees)])
    basis = np.column_stack([_off_lines(cell, torque, powers[rows, k]) for k in range(degrees)])
    freedom = rows.size - 2 * np.unique(cell).size
    solution, covariance = _drift_polynomial(basis, _off_lines(cell, torque, angle), freedom)
    per_loop = np.array([float(len(loops)) ** k for k in range(solution.size)])
    u = float(np.sqrt(max(float(per_loop @ covariance @ per_loop), 0.0)))
    size = float(per_loop @ solution)
    share = u / max(abs(size), 1e-300)
    drift = powers[:, : solution.size] @ solution
    return Drift(drift, size, share, significant=size != 0.0 and share < 1.0 / 3.0)


def _drift_polynomial(basis: Floats, angle: Floats, freedom: int) -> tuple[Floats, Floats]:
    """Return coefficients and covariance of the lowest degree that no higher one clearly beats."""
    best: tuple[NDArray[Any], NDArray[Any], float] | None = None
    for degree in range(1, basis.shape[1] + 1):
        columns = basis[:, :degree]
        solution, *_ = np.linalg.lstsq(columns, angle, rcond=None)
        squares = float(np.sum((angle - columns @ solution) ** 2))
        variance = squares / max(freedom - degree, 1)
        if best is not None and best[2] - squares <= BENDS * variance:
            break
        best = solution, variance * np.linalg.pinv(columns.T @ columns), squares
    assert best is not None
    return best[:2]


def _off_lines(cell: NDArray[np.int64], torque: Floats, values: Floats) -> Floats:
    """Return the deviations of values from a line over torque in each cell."""
    count = np.maximum(np.bincount(cell), 1)

    def centred(column: Floats) -> Floats:
        return np.asarray(column - (np.bincount(cell, weights=column) / count)[cell])

    load, value = centred(torque), centred(values)
    squares = np.bincount(cell, weights=load**2)
    slope = np.divide(
        np.bincount(cell, weights=load * value),
        squares,
        out=np.zeros_like(squares),
        where=squares > 1e-12 * max(float(squares.max()), 1e-300),
    )
    return np.asarray(value - slope[cell] * load)
