"""First steps of every evaluation: outliers, counts, reversals, levels and groups of a recording.

Thresholds are multiples of the recording's own noise, counts or slope, so that they hold for any
bench.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.quantities import Finding

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]

OUTLYING = 10.0
"""Distance of an outlier from its neighbours, in medians of that of all samples."""
STEEP = 5.0
"""Distance of an outlier from its neighbours, in changes from neighbour to neighbour beside it."""
MOST_OUTLIERS, LEAST_OUTLIERS = 0.01, 3
"""Largest share and number of samples that count as outliers; more belong to the recording."""
MOST_LOST = 0.05
"""Largest share of a recording's rows that may lack a number."""
TURN_SHARE = 0.25
"""A signal turns where it returns by this share of its range."""


# -- columns ----------------------------------------------------------------------------------


def finite_columns(least: int, **columns: ArrayLike) -> tuple[Floats, ...]:
    """Return columns as equally long rows of finite numbers.

    Examples
    --------
    >>> finite_columns(1, torque_nm=[1.0, float("nan")])
    Traceback (most recent call last):
    torquebench.errors.InputError: torque_nm is nan in row 2; allowed: finite numbers; ...
    """
    rows = _equal_columns(columns)
    for name, row in rows.items():
        bad = np.flatnonzero(~np.isfinite(row))
        if bad.size:
            more = Message(" and {size} others", bad.size - 1) if bad.size > 1 else ""
            raise InputError(
                Message("{name} is {row} in row {bad}{size}", name, row[bad[0]], bad[0] + 1, more),
                "finite numbers",
                "remove these rows, or measure them again",
            )
    _check_size(rows, least)
    return tuple(rows.values())


def _equal_columns(columns: Mapping[str, ArrayLike]) -> dict[str, Floats]:
    """Return columns as rows of floats; refuse different lengths."""
    rows = {
        name: np.atleast_1d(np.asarray(values, dtype=np.float64))
        for name, values in columns.items()
    }
    first = next(iter(rows))
    for name, row in rows.items():
        if row.ndim != 1 or row.size != rows[first].size:
            raise InputError(
                Message("{name} of shape {shape}", name, row.shape),
                Message("one value for each of {size} in {name}", rows[first].size, first),
            )
    return rows


def _check_size(rows: Mapping[str, Floats], least: int) -> None:
    name, row = next(iter(rows.items()))
    if row.size < least:
        raise InputError(
            Message("{size} values of {name}", row.size, name), Message("at least {limit}", least)
        )


def labels(values: ArrayLike | None, size: int, default: float, name: str) -> Floats:
    """Return labels, shape (size,); by default the same for all."""
    if values is None:
        return np.full(size, default)
    row = np.atleast_1d(np.asarray(values, dtype=np.float64))
    if row.shape != (size,):
        raise InputError(
            Message("{name} of shape {shape}", name, row.shape), Message("{size} labels", size)
        )
    if not np.all(np.isfinite(row)):
        raise InputError(Message("a {name} that isn't finite", name), "a finite label in each row")
    return row


@dataclass(frozen=True, eq=False)
class Samples:
    """Columns of a recording and their rows in the file, without missing values and outliers.

    `keep` leaves outliers in. `findings` name the samples that were left out.
    """

    columns: Mapping[str, Floats]
    row: NDArray[np.int64]
    keep: bool = False
    findings: tuple[Finding, ...] = ()

    @classmethod
    def of(
        cls,
        least: int,
        *,
        row: ArrayLike | None = None,
        keep: bool = False,
        **columns: ArrayLike | None,
    ) -> Samples:
        """Return the columns that aren't None, without rows that lack a number."""
        rows = _equal_columns({name: each for name, each in columns.items() if each is not None})
        _check_size(rows, least)
        size = next(iter(rows.values())).size
        number = np.arange(1, size + 1) if row is None else np.asarray(row, dtype=np.int64)
        samples = cls(rows, number, keep)
        lost = ~np.all([np.isfinite(each) for each in rows.values()], axis=0)
        if not lost.any():
            return samples
        if lost.sum() > max(size >= 10, MOST_LOST * size):
            finite_columns(least, **rows)
        remaining = samples.where(~lost)
        _check_size(remaining.columns, least)
        return remaining.with_finding(
            Finding(
                "lost samples",
                Message("no number in {rows}: left out", _rows_named(number[lost])),
                "check what was read there",
            )
        )

    def __getitem__(self, name: str) -> Floats:
        return self.columns[name]

    def get(self, name: str, default: float) -> Floats:
        """Return a column, or an array of the default if there is none."""
        return self.columns.get(name, np.full(self.row.size, default))

    def where(self, rows: Mask | Indices) -> Samples:
        """Return the selected samples."""
        columns = {name: values[rows] for name, values in self.columns.items()}
        return replace(self, columns=columns, row=self.row[rows])

    def having(self, **columns: Floats) -> Samples:
        """Return the samples with added or replaced columns."""
        return replace(self, columns={**self.columns, **columns})

    def with_finding(self, *findings: Finding) -> Samples:
        """Return the same samples with further findings."""
        return replace(self, findings=(*self.findings, *findings))

    def screened(self, group: Floats | None = None, **series: Floats) -> Samples:
        """Leave out samples far from their neighbours in a series, group by group, and report them.

        The series are in the order of measurement; messages use their names.
        """
        masks: dict[str, Mask] = {}
        size = self.row.size
        parts = [np.ones(size, dtype=np.bool_)]
        if group is not None:
            parts = [group == number for number in np.unique(group)]
        for name, values in series.items():
            bad = np.zeros(size, dtype=np.bool_)
            for part in parts:
                bad[part] = outliers(values[part])
            masks[name] = bad
        return self.less({name: bad for name, bad in masks.items() if bad.any()})

    def less(self, masks: Mapping[str, Mask]) -> Samples:
        """Leave out the outliers (by series), or report them only."""
        bad = np.zeros(self.row.size, dtype=np.bool_)
        for mask in masks.values():
            bad |= mask
        if not bad.any() or bad.sum() > max(LEAST_OUTLIERS, MOST_OUTLIERS * bad.size):
            return self
        what = Message.joined(
            [
                Message("{name} in {rows}", _word(name), _rows_named(self.row[mask]))
                for name, mask in masks.items()
                if mask.any()
            ]
        )
        finding = Finding(
            "outliers",
            Message(
                "{what}: far from its neighbours, {left_out}",
                what,
                "kept" if self.keep else "left out",
            ),
            "check what happened there"
            if self.keep
            else "check what happened there; --keep-outliers evaluates it with the others",
        )
        return (self if self.keep else self.where(~bad)).with_finding(finding)


_UNITS = ("_nm", "_rad", "_rpm", "_s")


def _word(column: str) -> str:
    """Return a column's name in words, without its unit."""
    for unit in _UNITS:
        column = column.removesuffix(unit)
    return column.replace("_", " ")


def _rows_named(rows: NDArray[np.int64]) -> str:
    """Return row numbers in words, the first five of many."""
    numbers = ", ".join(str(row) for row in rows[:5])
    if rows.size > 5:
        numbers = Message("{rows} and {count} more", numbers, rows.size - 5)
    return Message("row {rows}", numbers) if rows.size == 1 else Message("rows {rows}", numbers)


# -- noise, outliers, steps -------------------------------------------------------------------


def noise_of(values: Floats) -> float:
    """Return the standard deviation of white noise, from second differences."""
    if values.size < 8:
        return 0.0
    scale: float = 0.6745 * 6.0**0.5
    return float(np.median(np.abs(np.diff(values, 2)))) / scale


def moving_mean(values: Floats, width: int) -> Floats:
    """Return means over `width` samples around each; the end values continue beyond the ends."""
    padded = np.pad(values, (width // 2, width - 1 - width // 2), mode="edge")
    return np.convolve(padded, np.full(width, 1.0 / width), mode="valid")


def outliers(values: Floats, step: float | None = None) -> Mask:
    """Find single samples far outside their neighbours, in the order of measurement.

    The highest and the lowest of the six neighbours don't count, so that two outliers don't hide
    each other. The limit grows with the changes beside a sample and with the count `step` (the
    visible one by default), so that jumps, reversals and ripple aren't outliers.

    Examples
    --------
    >>> ramp = np.linspace(0.0, 1.0, 50)
    >>> np.flatnonzero(outliers(np.where(np.arange(50) == 30, 9.0, ramp))).tolist()
    [30]
    """
    if values.size < 8:
        return np.zeros(values.size, dtype=np.bool_)
    padded = np.pad(values, 3, constant_values=np.nan)
    neighbours = np.stack([padded[3 + k : 3 + k + values.size] for k in (-3, -2, -1, 1, 2, 3)])
    ordered = np.sort(neighbours, axis=0)  # NaN beyond the ends is sorted last
    count = np.count_nonzero(np.isfinite(neighbours), axis=0)
    low = ordered[1]
    high = np.take_along_axis(ordered, (count - 2)[None, :], axis=0)[0]
    beyond = np.maximum(np.maximum(values - high, low - values), 0.0)
    middle = 0.5 * (
        np.take_along_axis(ordered, ((count - 1) // 2)[None, :], axis=0)[0]
        + np.take_along_axis(ordered, (count // 2)[None, :], axis=0)[0]
    )
    usual = float(np.median(np.abs(values - middle)))
    with np.errstate(invalid="ignore"):
        steps = np.sort(np.abs(np.diff(neighbours, axis=0)[[0, 1, 3, 4]]), axis=0)
    change = np.where(np.isfinite(steps[2]), steps[2], steps[1])
    limit = np.maximum(OUTLYING * usual, STEEP * change)
    limit = np.where(count < len(neighbours), 2.0 * limit, limit)  # fewer near the ends
    limit = limit + 1e-9 * np.ptp(values)
    if step is None:  # an outlier needn't be a multiple of the step
        step = step_of(values[beyond <= limit])
    return np.asarray(beyond > limit + 3.0 * step)


def step_of(values: Floats) -> float:
    """Return the step of which all differences of the values are multiples; 0 if none.

    Examples
    --------
    >>> step_of(np.array([0.5, 1.25, 2.0, 0.5, 3.5, 4.25])), step_of(np.sqrt(np.arange(9.0)))
    (0.75, 0.0)
    """
    every = np.unique(values)
    if every.size < 3:
        return 0.0
    least = 1e-7 * float(every[-1] - every[0])
    gaps = np.diff(every)
    gaps = np.sort(gaps[gaps > least])
    if not gaps.size:
        return 0.0
    gaps = np.concatenate([gaps[:2000], gaps[2000 :: max(1, gaps.size // 2000)]])
    step = float(gaps[0])
    for _ in range(12):  # the greatest common divisor of the gaps
        deviation = np.abs(gaps - np.rint(gaps / step) * step)
        deviation = deviation[deviation > 1e-2 * step]
        if not deviation.size:
            return step if step > 10.0 * least else 0.0
        step = float(deviation.min())
        if step < least:
            return 0.0
    return 0.0


REGULAR = 0.95


def count_step(values: Floats) -> float:
    """Return the step of a signal's counts, from samples in the order of measurement.

    Steps that are all equal come from even sampling, not from counts.

    Examples
    --------
    >>> count_step(np.floor(np.linspace(0.0, 9.3, 40))), count_step(np.arange(40.0))
    (1.0, 0.0)
    """
    step = step_of(values)
    if step == 0.0:
        return 0.0
    single = np.rint(np.abs(np.diff(values)) / step) == 1.0
    return 0.0 if np.mean(single) > REGULAR else step


def decimal_step(values: Floats) -> float:
    """Return the last decimal place that numbers are written with; 0 beyond six places.

    Examples
    --------
    >>> decimal_step(np.array([1.0, 0.25, 2.5])), decimal_step(np.array([1.0 / 3.0]))
    (0.01, 0.0)
    """
    for places in range(7):
        scaled = values * 10.0**places
        if np.all(np.abs(scaled - np.rint(scaled)) <= 1e-6):
            return float(10.0**-places)
    return 0.0


# -- turns and levels -------------------------------------------------------------------------


def turning_points(values: Floats) -> Indices:
    """Return the samples at which a signal reverses, with the first and the last sample.

    Examples
    --------
    >>> turning_points(np.array([0.0, 1.0, 2.0, 1.0, -1.0, -2.0, 0.0])).tolist()
    [0, 2, 5, 6]
    """
    smooth = moving_mean(values, max(1, values.size // 400))
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
    return np.array(sorted({*turns, values.size - 1}), dtype=np.intp)


LEAST_LEVELS = 6
LEAST_STAYING = 3
"""Fewest samples in a row at which a signal is constant."""
STAYING = 0.6
"""Smallest share of constant samples in a stepped recording."""
MOVING = 0.3
"""Largest change within the levels, as a share of the change from level to level."""


def levels_of(values: Floats, least: int = LEAST_LEVELS) -> list[slice]:
    """Return the levels at which a signal is constant, in order; none unless the signal is stepped.

    Examples
    --------
    >>> stairs = np.repeat([0.0, 1.0, 2.0, 3.0, 2.0, 1.0, 0.0], 4)
    >>> [part.start for part in levels_of(stairs)]
    [0, 4, 8, 12, 16, 20, 24]
    >>> levels_of(np.linspace(0.0, 3.0, 40))
    []
    """
    if values.size < least * LEAST_STAYING:
        return []
    change = np.abs(np.diff(values))
    quiet = 6.0 * float(np.median(change))
    jumps = np.flatnonzero(change > max(quiet, 0.1 * float(change.max())))
    ends = [0, *(jumps + 1).tolist(), values.size]
    parts = [slice(a, b) for a, b in pairwise(ends) if b - a >= LEAST_STAYING]
    if len(parts) < least or sum(part.stop - part.start for part in parts) < (
        STAYING * values.size
    ):
        return []
    heights = np.array([float(np.median(values[part])) for part in parts])
    inside = 2.0 * sum(_drift(values[part]) for part in parts)
    return parts if inside < MOVING * float(np.abs(np.diff(heights)).sum()) else []


def _drift(values: Floats) -> float:
    """Return the difference of the means of both halves."""
    half = values.size // 2
    return abs(float(values[half:].mean() - values[: values.size - half].mean()))


# -- points -----------------------------------------------------------------------------------


def grouped(values: Floats, tolerance: ArrayLike) -> NDArray[np.int64]:
    """Return the number of each value's group of values within a tolerance, from the lowest.

    The values of a group have one sign and a range within their tolerance. Longer chains of close
    values are cut at their widest gaps.

    Examples
    --------
    >>> grouped(np.array([80.0, 81.0, 82.0, 180.0, -80.0]), 1.5).tolist()
    [1, 2, 2, 3, 0]
    """
    order = np.argsort(values, kind="stable")
    ordered = values[order]
    limit = np.broadcast_to(np.asarray(tolerance, dtype=np.float64), values.shape)[order]
    starts = np.zeros(values.size, dtype=np.bool_)
    pending = [(0, values.size)]
    while pending:
        first, last = pending.pop()
        part = ordered[first:last]
        signs = np.flatnonzero(np.diff(np.sign(part)))
        narrow = part[-1] - part[0] <= float(limit[first:last].min()) * (1.0 + 1e-9)
        if narrow and not signs.size:
            starts[first] = True
            continue
        gaps = np.diff(part)
        cut = first + 1 + int(signs[0] if signs.size else np.argmax(gaps > 0.999999 * gaps.max()))
        pending += [(first, cut), (cut, last)]
    number = np.empty(values.size, dtype=np.int64)
    number[order] = np.cumsum(starts) - 1
    return number


def repeat_outliers(values: Floats, group: NDArray[np.int64]) -> Mask:
    """Find values far from the median of their group, where groups have three or more.

    Examples
    --------
    >>> repeat_outliers(np.array([1.0, 1.01, 0.99, 5.0]), np.zeros(4, dtype=np.int64)).tolist()
    [False, False, False, True]
    """
    apart = np.zeros(values.size)
    for number in np.flatnonzero(np.bincount(group) >= 3):
        rows = group == number
        apart[rows] = np.abs(values[rows] - np.median(values[rows]))
    usual = apart[apart > 0.0]
    if not usual.size:
        return np.zeros(values.size, dtype=np.bool_)
    # The median of a few values is uncertain itself.
    factor = OUTLYING * (1.0 + 12.0 / usual.size)
    limit = factor * float(np.median(usual)) + 3.0 * decimal_step(values)
    return np.asarray(apart > limit)


LEAST_RAMP = 40
SMALL_CHANGE = 0.05


def is_ramp(values: Floats, group: NDArray[np.int64]) -> bool:
    """Return whether a series of values changes steadily instead of in steps."""
    if values.size < LEAST_RAMP or np.unique(group).size < values.size / 3.0:
        return False
    small = np.abs(np.diff(values)) < SMALL_CHANGE * float(np.ptp(values))
    return bool(np.mean(small) > 0.9)


LONGEST_MEAN = 200
LEAST_WINDOW = 20
"""Samples of the shortest window: fewer rows of one speed may be repeats."""
STEADY = 0.005
"""Change within a window, as a share of the largest value, up to which it is steady."""


def steady_windows(channels: Sequence[Floats]) -> list[slice]:
    """Return the windows of a log in which all set quantities are constant.

    A log has many samples at each set point: short windows don't count.

    Examples
    --------
    >>> speed = np.concatenate([np.linspace(0, 100, 30), np.full(60, 100.0), np.full(60, 200.0)])
    >>> [(part.start > 29, part.stop - part.start > 40) for part in steady_windows([speed])]
    [(True, True), (True, True)]
    """
    size = channels[0].size
    width = int(np.clip(size // 100, 10, LONGEST_MEAN))
    if size < 2 * width:
        return []
    steady = np.ones(size, dtype=np.bool_)
    limits = []
    for values in channels:
        sums = np.concatenate([[0.0], np.cumsum(values - values[0])])
        half = width // 2
        middle = np.arange(half, size - half)
        change = (sums[middle + half] - 2.0 * sums[middle] + sums[middle - half]) / half
        rough = moving_mean(np.abs(values - moving_mean(values, width)), width)[middle]
        limit = STEADY * float(np.quantile(np.abs(values), 0.98))
        limits.append(limit)
        here = np.zeros(size, dtype=np.bool_)
        here[middle] = np.abs(change) <= np.maximum(limit, 4.0 * 1.25 * rough / half**0.5)
        steady &= here
    edges = np.flatnonzero(np.diff(np.concatenate([[0], steady.astype(np.int8), [0]])))
    windows = []
    for first, last in edges.reshape(-1, 2).tolist():
        part = slice(first, last)
        if last - first < LEAST_WINDOW:
            continue
        drifts = [
            _drift(values[part]) <= 2.0 * limit
            for values, limit in zip(channels, limits, strict=True)
        ]
        if all(drifts):
            windows.append(part)
    return windows


SET = frozenset({"demanded_rpm", "demanded_nm", "repeat", "branch", "series", "index", "known"})
"""Columns that are constant within a window."""
BLOCKS = 8
"""Parts of a window whose means give the standard uncertainty of the window's mean."""


def windows_of(samples: Samples, steady: Sequence[str], measured: Sequence[str]) -> Samples:
    """Average a log over the windows of constant set quantities; return a table unchanged.

    Columns ``own_…`` are the standard uncertainties of the measured quantities' means, from means
    of parts of each window: samples that follow each other have much of their noise in common.
    """
    windows = steady_windows([samples[name] for name in steady])
    if not windows:
        return samples
    size = samples.row.size
    samples = samples.less(
        {name: _outliers_in(samples[name], windows) for name in {*steady, *measured}}
    )
    if samples.row.size != size:
        windows = steady_windows([samples[name] for name in steady])
    whole = samples.row.size
    sizes = np.array([part.stop - part.start for part in windows])
    columns = {
        name: np.array(
            [np.median(values[part]) if name in SET else values[part].mean() for part in windows]
        )
        for name, values in samples.columns.items()
    }
    for name in measured:
        means = [
            [block.mean() for block in np.array_split(samples[name][part], BLOCKS)]
            for part in windows
        ]
        columns[f"own_{name}"] = np.std(means, axis=1, ddof=1) / BLOCKS**0.5
    finding = Finding(
        "steady windows",
        Message(
            "{count} steady windows of {fewest} to {most} samples were found; the other "
            "{left} of {whole} samples aren't used",
            len(windows),
            int(sizes.min()),
            int(sizes.max()),
            int(whole - sizes.sum()),
            whole,
        ),
        "hold torque and speed for longer if a window is missing",
    )
    rows = samples.row[[part.start for part in windows]]
    return replace(samples, columns=columns, row=rows).with_finding(finding)


def _outliers_in(values: Floats, windows: Sequence[slice]) -> Mask:
    """Find outliers in a log, within each window and over all of it."""
    found = np.zeros(values.size, dtype=np.bool_)
    used = slice(windows[0].start, windows[-1].stop)
    found[used] = outliers(values[used])
    for part in windows:
        found[part] |= outliers(values[part])
    return found
