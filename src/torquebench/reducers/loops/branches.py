"""Cuts records of torque and angle into loops of a rising and a falling branch."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["RawLoop", "cut_loops", "moving_mean", "smoothed", "turning_points"]

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]
QUIET_SHARE = 0.004
"""Noise of the torque, as a share of its largest value, below which loops need no averaging."""
LONGEST_MEAN = 0.02
"""Largest part of a record between two reversals that is averaged against noise."""
FULL_SPAN = 0.8
"""A branch is complete if it spans this share of the widest."""
TURN_SHARE = 0.25
"""The torque reverses where it returns by this share of its range."""
AT_THE_END = 0.9
"""A labelled loop begins and ends within this share of its largest torque."""


@dataclass(frozen=True, eq=False)
class RawLoop:
    """Samples of one loop.

    Parameters
    ----------
    position : float
        Label of the output position.
    number : int
        From 1 at each position.
    rising, falling : array of int
        Rows of the record, in time order, while the torque rises and falls.
    """

    position: float
    number: int
    rising: Indices
    falling: Indices


def moving_mean(values: Floats, width: int) -> Floats:
    """Return means over so many samples around each; the ends continue as they are."""
    padded = np.pad(values, (width // 2, width - 1 - width // 2), mode="edge")
    return np.convolve(padded, np.full(width, 1.0 / width), mode="valid")


def turning_points(torque: Floats) -> Indices:
    """Return the samples at which a torque turns, the first and the last sample included.

    Examples
    --------
    >>> turning_points(np.array([0.0, 1.0, 2.0, 1.0, -1.0, -2.0, 0.0])).tolist()
    [0, 2, 5, 6]
    """
    smooth = moving_mean(torque, max(1, torque.size // 400))
    least = TURN_SHARE * float(np.ptp(smooth))
    turns, direction, extreme = [0], 0, 0
    lowest = highest = 0
    for k, value in enumerate(smooth.tolist()):
        if direction == 0:
            lowest = k if value < smooth[lowest] else lowest
            highest = k if value > smooth[highest] else highest
            if value > smooth[lowest] + least:
                direction, extreme = 1, k
            elif value < smooth[highest] - least:
                direction, extreme = -1, k
        elif direction * (value - smooth[extreme]) > 0:
            extreme = k
        elif direction * (smooth[extreme] - value) > least:
            turns.append(extreme)
            direction, extreme = -direction, k
    return np.array(sorted({*turns, torque.size - 1}), dtype=np.intp)


def smoothed(torque: Floats, angle: Floats, branches: int) -> tuple[Floats, Floats, int]:
    """Average noisy torque and its angle over neighbouring samples, as far as it is needed.

    Noise of the torque blurs a loop where it is steep, which no fit of angle against torque can
    undo. Both are averaged over the same odd number of samples, which is also returned: 1 where
    the noise is below 0.4 % of the largest torque.

    Parameters
    ----------
    torque, angle : array of float, shape (n,)
        In the order of measurement, at one position.
    branches : int
        Number of times that the torque runs from one end to the other.
    """
    if torque.size < 32:
        return torque, angle, 1
    noise = float(np.median(np.abs(np.diff(torque, 2)))) / (0.6745 * 6.0**0.5)
    quiet = QUIET_SHARE * float(np.quantile(np.abs(torque), 0.99))
    longest = int(LONGEST_MEAN * torque.size / max(branches, 1))
    width = min(int((noise / quiet) ** 2) + 1, longest) if noise > quiet else 1
    width -= 1 - width % 2
    if width < 3:
        return torque, angle, 1
    return moving_mean(torque, width), moving_mean(angle, width), width


def cut_loops(torque: Floats, position: Floats, loop: Floats | None) -> Iterator[RawLoop]:
    """Yield the loops of a record, position by position in the order of measurement.

    Labelled loops that begin and end at their largest torque aren't cut. All others are cut at the
    torque's reversals: the part before the first complete branch (from zero, or a preload) doesn't
    belong to any loop.

    Raises
    ------
    InputError
        Where a position holds no whole loop.
    """
    _, first = np.unique(position, return_index=True)
    for label in position[np.sort(first)]:
        rows = np.flatnonzero(position == label)
        found = None if loop is None else _labelled(torque, rows, loop[rows])
        if found is None:
            found = _cut(torque, rows)
        if not found:
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
        for number, (rising, falling) in enumerate(found, 1):
            yield RawLoop(float(label), number, rising, falling)


def _labelled(
    torque: Floats, rows: Indices, labels: Floats
) -> list[tuple[Indices, Indices]] | None:
    found = []
    for label in dict.fromkeys(labels.tolist()):
        mine = rows[labels == label]
        end = float(np.max(np.abs(torque[mine])))
        ends = np.abs(torque[mine[[0, -1]]])
        if mine.size < 8 or np.any(ends < AT_THE_END * end):
            return None
        parts = _parts(torque[mine], mine)
        rising = [part for sign, part in parts if sign > 0]
        falling = [part for sign, part in parts if sign < 0]
        if not rising or not falling:
            return None
        found.append((np.concatenate(rising), np.concatenate(falling)))
    return found


def _parts(torque: Floats, rows: Indices) -> list[tuple[int, Indices]]:
    turns = turning_points(torque)
    return [
        (1 if torque[stop] > torque[start] else -1, rows[start : stop + 1])
        for start, stop in pairwise(turns.tolist())
    ]


def _cut(torque: Floats, rows: Indices) -> list[tuple[Indices, Indices]]:
    parts = _parts(torque[rows], rows)
    spans = [abs(float(torque[part[-1]] - torque[part[0]])) for _, part in parts]
    whole = [
        part for part, span in zip(parts, spans, strict=True) if span >= FULL_SPAN * max(spans)
    ]
    found = []
    for first, second in zip(whole[::2], whole[1::2], strict=False):
        rising = first[1] if first[0] > 0 else second[1]
        falling = second[1] if first[0] > 0 else first[1]
        if first[0] != second[0]:
            found.append((rising, falling))
    return found
