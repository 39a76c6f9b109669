"""Conversion of a calibration table to the series of a static evaluation: runs, zeros, steps."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from torquebench.calibration.data import CalibrationData, infer_branch, plainest
from torquebench.calibration.evaluation import LoadingSeries
from torquebench.message import Message

FloatArray = NDArray[np.float64]
DIRECTIONS = {1: "clockwise", -1: "counter-clockwise"}

SAME_STEP_PERCENT = 2.5
"""Largest difference of reference torques of different series that are one step, in %."""

REPEATED_PERCENT = 0.5
"""Largest difference of reference torques of one series that repeat a step, in %. A remark names a
reference torque that deviates from its nominal torque by more."""

FARTHEST_PERCENT = 10.0
"""Largest deviation of a torque from its nominal torque, in %; beyond it, a point is left out with
a remark."""

MOST_STEPS = 100
"""Largest number of steps in one direction; more are a ramp."""


@dataclass(frozen=True, eq=False)
class _Run:
    """One rise and the fall after it, in one direction of one series, as rows of the table."""

    series: int
    direction: int
    position_deg: float
    rising: NDArray[np.intp]
    falling: NDArray[np.intp]
    zero: int | None
    """Row of the unloaded reading that is subtracted."""
    final_zero: int | None
    """Row of the unloaded reading after the run."""

    @property
    def rows(self) -> NDArray[np.intp]:
        """Loaded rows in measuring order."""
        return np.sort(np.concatenate([self.rising, self.falling]))


def _runs(data: CalibrationData) -> list[_Run]:
    """Return the runs in measuring order: each rise after a fall begins one."""
    branch = np.where(data.branch == 0, infer_branch(data.standard_nm, data.series), data.branch)
    position = np.zeros(len(data)) if data.position_deg is None else data.position_deg
    zeros = np.flatnonzero(data.unloaded)
    grouped: list[list[int]] = []
    keys = np.stack([data.series, data.direction, position], axis=1)
    for row in np.flatnonzero(~data.unloaded).tolist():
        last = grouped[-1][-1] if grouped else None
        rises = last is not None and branch[last] < 0 < branch[row]
        if last is None or rises or np.any(keys[row] != keys[last]):
            grouped.append([])
        grouped[-1].append(row)
    ends = [*(rows[0] for rows in grouped[1:]), len(data)][: len(grouped)]
    runs = []
    for group, end in zip(grouped, ends, strict=True):
        rows = np.array(group, dtype=np.intp)
        first, rising = int(rows[0]), rows[branch[rows] > 0]
        own = zeros[data.series[zeros] == data.series[first]]
        own = own[position[own] == position[first]]
        same = zeros[position[zeros] == position[first]]
        after = own[(own > rows[-1]) & (own < end) & (branch[own] < 0)]
        # The zero of a run is the last one before it in its series; for a fall without a rise, the
        # zero after it; else the last one before it in its position; else the nearest one.
        candidates = (
            own[own < first][-1:],
            after[:1] if not rising.size else own[:0],
            same[same < first][-1:],
            same[np.argsort(np.abs(same - first))][:1],
            zeros[np.argsort(np.abs(zeros - first))][:1],
        )
        zero = next((int(candidate[0]) for candidate in candidates if candidate.size), None)
        runs.append(
            _Run(
                int(data.series[first]),
                int(data.direction[first]),
                float(position[first]),
                rising,
                rows[branch[rows] < 0],
                zero,
                int(after[0]) if after.size else None,
            )
        )
    return runs


@dataclass(frozen=True, eq=False)
class TaredPoints:
    """The points of a calibration with the zero of each series subtracted, X = I − I₀.

    Parameters
    ----------
    zeros_nm : tuple of float
        The subtracted zeros, one for each rise; empty where the readings were tared.
    remarks : tuple of str
        Remarks on the zeros, and on series without a zero before them.
    """

    data: CalibrationData
    zeros_nm: tuple[float, ...] = ()
    remarks: tuple[str, ...] = ()


def tare(data: CalibrationData) -> TaredPoints:
    """Subtract from the readings of each series the zero of that series, X = I − I₀.

    The zero of a series is the last reading without load before it, in the same series or mounting
    position; if there is none, the nearest one. A constant added to all readings therefore has no
    influence. Tared readings, and tables without unloaded readings, are returned unchanged.

    Parameters
    ----------
    data : CalibrationData
        In measuring order.

    Examples
    --------
    >>> data = CalibrationData([1.0, 6.0, 11.0, 1.1], [0, 5, 10, 0], [1] * 4, [1, 1, 1, -1], 10.0)
    >>> points = tare(data)
    >>> points.data.reading_nm.round(6).tolist(), points.zeros_nm
    ([0.0, 5.0, 10.0, 0.1], (1.0,))
    """
    runs = _runs(data)
    if data.tared or not runs:
        return TaredPoints(data)
    if not np.any(data.unloaded):
        return TaredPoints(
            replace(data, tared=True),
            remarks=("no reading without load: the readings count as tared",),
        )
    zeros = np.array([data.reading_nm[run.zero] for run in runs])
    starts = np.array([run.rows[0] for run in runs])
    rows = np.arange(len(data))
    # An unloaded row belongs to the run after it, unless it is the end of the run before.
    owner = np.minimum(np.searchsorted(starts, rows, side="left"), len(runs) - 1)
    for number, run in enumerate(runs):
        owner[run.rows] = number
        if run.final_zero is not None:
            owner[run.final_zero] = number
    remarks = []
    if np.any(zeros != 0.0):
        texts = list(dict.fromkeys(f"{value:.5g}" for value in zeros))
        more = Message(" and {count} more", len(texts) - 8) if len(texts) > 8 else ""
        remarks.append(
            Message(
                "zero of each series, subtracted: {zeros} N·m{more}", ", ".join(texts[:8]), more
            )
        )
    late = dict.fromkeys(str(run.series) for run in runs if (run.zero or 0) > run.rows[0])
    if late:
        remarks.append(
            Message(
                "no reading without load before series {numbers}: the nearest one counts as its "
                "zero",
                ", ".join(late),
            )
        )
    tared = replace(data, reading_nm=data.reading_nm - zeros[owner], tared=True)
    return TaredPoints(tared, tuple(zeros.tolist()), tuple(remarks))


def own_steps(data: CalibrationData, named_nm: Sequence[float] = ()) -> CalibrationData:
    """Return the data with the nearest step as nominal torque of each point.

    Data with nominal torques are returned unchanged. Reference torques within 2.5 % of each other
    are one step, those of the same run within 0.5 %. The step's nominal torque is the nearest named
    torque within this distance, else the number with the fewest digits near its mean.

    Parameters
    ----------
    named_nm : sequence of float
        Magnitudes of steps, such as those of a profile.

    Examples
    --------
    >>> data = CalibrationData([2, 4.1, 6, 2], [2.001, 4, 6, 1.999], [1, 1, 1, 2], [1] * 4, 10.0)
    >>> own_steps(data).nominal_nm.tolist()
    [2.0, 4.0, 6.0, 2.0]
    """
    if data.nominal_nm is not None:
        return data
    nominal = np.zeros(len(data))
    for sign in DIRECTIONS:
        runs = [run for run in _runs(data) if run.direction == sign]
        branches = [rows for run in runs for rows in (run.rising, run.falling) if rows.size]
        if not branches:
            continue
        rows = np.concatenate(branches)
        branch = np.repeat(np.arange(len(branches)), [branch_rows.size for branch_rows in branches])
        size = np.abs(data.standard_nm[rows])
        order = np.argsort(size, kind="stable")
        groups = [order[members] for members in _clusters(size[order], branch[order])]
        names = _names(np.array([np.mean(size[group]) for group in groups]), named_nm)
        for group, name in zip(groups, names, strict=True):
            nominal[rows[group]] = sign * name
    return replace(data, nominal_nm=nominal)


def _clusters(size: FloatArray, branch: NDArray[np.intp]) -> list[slice]:
    """Return slices of sorted torques that are one step; the closest torques are joined first."""
    begin, end = (
        np.arange(size.size),
        np.arange(size.size),
    )  # cluster's ends
    members = [{int(number)} for number in branch]
    for k in np.argsort(np.diff(size) / size[1:], kind="stable"):
        low, high = int(begin[k]), int(end[k + 1])
        spread = 100.0 * (size[high] / size[low] - 1.0)
        apart = members[low].isdisjoint(members[int(k) + 1])
        if spread <= REPEATED_PERCENT or (spread <= SAME_STEP_PERCENT and apart):
            members[low] |= members[int(k) + 1]
            begin[high], end[low] = low, high
    slices, first = [], 0
    while first < size.size:
        slices.append(slice(first, int(end[first]) + 1))
        first = int(end[first]) + 1
    return slices


def _names(mean: FloatArray, named_nm: Sequence[float]) -> FloatArray:
    """Return each step's nearest named torque, else the plainest number within 0.5 %."""
    names = np.array([plainest(value, REPEATED_PERCENT / 100.0) for value in mean.tolist()])
    for named in named_nm:
        nearest = int(np.argmin(np.abs(mean - named)))
        if abs(mean[nearest] - named) <= SAME_STEP_PERCENT / 100.0 * named:
            names[nearest] = named
    return names


@dataclass(frozen=True, eq=False)
class Loading:
    """Steps and series of one direction, as `evaluate_static` takes them.

    Parameters
    ----------
    torque_nm : array of float, shape (m,)
        Magnitudes of the steps, rising.
    series : list of LoadingSeries
        Deflections as magnitudes, NaN at steps that a series doesn't have; empty for fewer than two
        steps and for a ramp.
    remarks : tuple of str
        Points that were left out or normalised by more than 0.5 %, and the reasons.
    """

    torque_nm: FloatArray
    series: list[LoadingSeries]
    remarks: tuple[str, ...]


def loading_series(data: CalibrationData, direction: int) -> Loading | None:
    """Return steps and series of one direction; None where it wasn't loaded.

    A reference transducer never shows the nominal step exactly, so each deflection is normalised to
    the nominal torque: X* = X · M_nom/M_ref. Repeated readings of a step on one branch of a run are
    averaged. Each run is a series: one rise and, if there is one, the fall after it. A point at a
    nominal torque of 0 on the falling branch is the zero after the run.

    Parameters
    ----------
    data : CalibrationData
        Points with nominal torques, stated or from `own_steps`.
    direction : {+1, -1}
        +1 clockwise, -1 counter-clockwise.
    """
    tared = tare(own_steps(data)).data
    nominal = tared.nominal_nm
    assert nominal is not None
    name = DIRECTIONS[direction]
    runs = [run for run in _runs(tared) if run.direction == direction]
    if not runs:
        return None
    remarks: list[str] = []
    reduced = np.full(len(tared), np.nan)
    rows = np.concatenate([run.rows for run in runs])
    off = 100.0 * np.abs(tared.standard_nm[rows] / nominal[rows] - 1.0)
    near = rows[off <= FARTHEST_PERCENT]
    reduced[near] = direction * tared.reading_nm[near] * nominal[near] / tared.standard_nm[near]
    remarks += _off_steps(tared, rows[off > REPEATED_PERCENT], off[off > REPEATED_PERCENT], name)
    rising = [row for run in runs for row in run.rising if reduced[row] > 0.0]
    steps = np.unique(np.abs(nominal[rising]))
    only_falling = np.setdiff1d(np.abs(nominal[near]), steps)
    if only_falling.size:
        remarks.append(
            Message(
                "{name}, without increasing torque: {steps} N·m; left out",
                name,
                _listed(only_falling),
            )
        )
    if not 2 <= steps.size <= MOST_STEPS:
        remarks.append(
            Message("{name}, fewer than two steps: not evaluated", name)
            if steps.size < 2
            else Message(
                "{name}, {count} different torques are a ramp: not evaluated by steps",
                name,
                steps.size,
            )
        )
        return Loading(steps, [], tuple(remarks))

    def column(rows: NDArray[np.intp]) -> FloatArray:
        """Return the mean of these rows at each step; NaN at steps without one."""
        values = reduced[rows]
        keep = values > 0.0
        at = np.searchsorted(steps, np.abs(nominal[rows[keep]]))
        keep_at = at < steps.size
        at, values, origin = at[keep_at], values[keep][keep_at], rows[keep][keep_at]
        matching = steps[at] == np.abs(nominal[origin])
        count = np.bincount(at[matching], minlength=steps.size)
        total = np.bincount(at[matching], weights=values[matching], minlength=steps.size)
        return np.where(count > 0, total / np.maximum(count, 1), np.nan)

    series = []
    for run in runs:
        up, down = column(run.rising), column(run.falling)
        top = np.flatnonzero(np.isfinite(up))[-1:]
        if run.falling.size and np.isnan(down[top]).all():
            down[top] = up[top]  # at the reversal, the largest step is read once for both branches
        returned = None
        if run.final_zero is not None and (data.tared or run.final_zero != run.zero):
            returned = float(tared.reading_nm[run.final_zero])
        elif run.final_zero is not None:
            # The final zero was subtracted from its own run: compare it with the nearest other zero
            # instead.
            others = np.setdiff1d(np.flatnonzero(data.unloaded), run.final_zero)
            if others.size:
                nearest = others[np.argmin(np.abs(others - run.final_zero))]
                returned = float(data.reading_nm[run.final_zero] - data.reading_nm[nearest])
        series.append(
            LoadingSeries(run.position_deg, up, down if run.falling.size else None, returned)
        )
    return Loading(steps, series, tuple(remarks))


def _listed(steps_nm: FloatArray) -> Message | str:
    """Return the first steps in words, and the number of further ones."""
    texts = ", ".join(f"{step:g}" for step in steps_nm[:4])
    return (
        Message("{steps} and {count} more", texts, steps_nm.size - 4)
        if steps_nm.size > 4
        else texts
    )


def _off_steps(
    data: CalibrationData, rows: NDArray[np.intp], off: FloatArray, name: str
) -> Iterator[str]:
    """Yield remarks on steps beyond their tolerance: the worst normalised and left out ones."""
    assert data.nominal_nm is not None
    far = off > FARTHEST_PERCENT
    for which, consequence in ((~far, "reduced in proportion"), (far, "left out")):
        if not np.any(which):
            continue
        worst = rows[which][np.argmax(off[which])]
        more = Message(" ({count} more)", np.count_nonzero(which) - 1) if which.sum() > 1 else ""
        yield Message(
            "{name}, the step {nominal:.6g} N·m of series {series} was loaded with {standard:.6g} "
            "N·m, deviation {off:.3g} %{more}: {consequence}",
            name,
            data.nominal_nm[worst],
            data.series[worst],
            data.standard_nm[worst],
            off[which].max(),
            more,
            consequence,
        )


@dataclass(frozen=True)
class ZeroHysteresis:
    """Difference of the zeros after clockwise and after counter-clockwise loading.

    Parameters
    ----------
    cycles : int
        Number of cycles with both zeros.
    mean_nm, worst_nm : float
        Mean and largest difference, zero after clockwise minus zero after counter-clockwise.
    mean_percent_fs, worst_percent_fs : float
        The same in % of full scale.
    """

    cycles: int
    mean_nm: float
    worst_nm: float
    mean_percent_fs: float
    worst_percent_fs: float


def zero_hysteresis(data: CalibrationData) -> ZeroHysteresis | None:
    """Return the zero hysteresis of reversing cycles.

    None where no series has both zeros.

    Parameters
    ----------
    data : CalibrationData
        Cycles 0 → +FS → 0 → −FS → 0, one per series, with a point at each zero and one common zero
        subtracted.

    Examples
    --------
    >>> data = CalibrationData(
    ...     [10.0, 0.03, -10.0, -0.01], [10.0, 0.0, -10.0, 0.0], [1] * 4, [1, -1, 1, -1], 10.0
    ... )
    >>> round(zero_hysteresis(data).mean_percent_fs, 6)
    0.4
    """
    unloaded = data.unloaded & (data.branch < 0)
    side = data.loading_direction()
    differences = []
    for number in np.unique(data.series):
        after, before = (
            data.reading_nm[unloaded & (data.series == number) & (side == sign)] for sign in (1, -1)
        )
        if after.size and before.size:
            differences.append(float(after.mean() - before.mean()))
    if not differences:
        return None
    mean = float(np.mean(differences))
    worst = max(differences, key=abs)
    return ZeroHysteresis(
        cycles=len(differences),
        mean_nm=mean,
        worst_nm=worst,
        mean_percent_fs=100.0 * mean / data.range_nm,
        worst_percent_fs=100.0 * worst / data.range_nm,
    )
