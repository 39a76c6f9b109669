"""Whether the points of a calibration agree with each other.

The error of a healthy chain is a smooth curve in each direction, with a step and ripple, a loop
between rising and falling torque, zero drift, re-seating variability between series, and scatter.
It is described by a Gaussian process, whose amplitudes are estimated from the table itself: no size
is limited. This description is compared with explanations of a part of the table: from one row to
another the zero has moved, the scale has changed, a sign is swapped or a value is stuck; or a
single row is wrong. An explanation is accepted if it makes the table more probable by more than its
prior odds, which contain the rate of false alarms. The probability that a Bayes factor exceeds 1/α
in a table without a fault is at most α.

References
----------
R. E. Kass, A. E. Raftery, J. American Statistical Association 90 (1995) 773: Bayes factors.
C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine Learning (2006), chapter 5.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from torquebench.calibration.data import CalibrationData
from torquebench.chain import stretches

FloatArray = NDArray[np.float64]
Cause = Literal["zero", "scale", "sign", "stuck", "unknown"]
_Kind = Literal["row", "zero", "scale", "both"]

FALSE_ALARM = 1e-2
"""Largest probability that a part of a healthy table is reported as a disagreement."""

FALSE_DOUBT = 10.0
"""Factor by which the odds of a doubt may be lower; one healthy table in twenty was found to show a
doubt."""

FALSE_ROW = 0.05
"""Largest probability that a row of a healthy table is reported as wrong and left out."""

FALSE_ROW_DOUBT = 1.0
"""Factor by which the odds of a doubtful row, which is kept, may be lower."""

SINGLED_OUT = 0.95
"""Smallest posterior probability of a cause that is named, and of a range of rows that is
credible."""

MOST_POINTS = 220
"""Larger tables are first averaged over neighbours of one branch."""

FEWEST_POINTS = 6
FEWEST_ROWS = 3
"""Fewer rows than this that disagree together count as single rows."""

_STEEP = 0.015
"""Torques below this share of the largest one are averaged only with each other."""
_FINEST = 2e-6
"""Smallest scatter, as a share of the largest torque: no standard resolves more."""
_MOST_EXPLANATIONS = 8
_TESTED = 5
_HOPELESS = -13.0
_BOTH = 0.05
"""Prior odds that zero and scale both change instead of one of them."""
_DECADE = float(np.log(5.0))
"""Logarithm of the prior odds that the size of a change lies in one decade."""

# Prior mean and standard deviation of the logarithm of each amplitude over the scatter.
_AMPLITUDES = {
    "smooth": (3.0, 2.0),
    "middle": (0.0, 2.0),
    "rough": (-1.0, 1.5),
    "step": (0.5, 1.5),
    "near zero": (-1.0, 1.5),
    "loop": (1.0, 2.0),
    "loop of friction": (1.0, 2.0),
    "lag": (1.0, 2.0),
    "lag of friction": (1.0, 2.0),
    "slip": (-2.0, 1.0),
    "drift": (0.0, 1.5),
    "wander": (-1.2, 0.8),
    "series": (-0.5, 1.5),
    "mounting": (1.0, 1.5),
    "condition": (2.0, 2.0),
}
_SCATTER, _GROWTH = (0.0, 1.5), (-1.0, 1.0)
_DIRECTIONS = 0.03
"""Standard deviation of the difference of both directions' spans, as a share."""


@dataclass(frozen=True)
class WrongRow:
    """A point that disagrees with all others.

    Parameters
    ----------
    point : int
        From 0.
    residual_nm : float
        Standard minus the value expected from the other points, N·m.
    """

    point: int
    residual_nm: float


@dataclass(frozen=True)
class Disagreement:
    """A part of a table that disagrees with the rest.

    Parameters
    ----------
    cause : str
        Most probable cause; "unknown" if none is probable enough.
    first, last : int
        Points from 0, both included.
    first_range, last_range : tuple of int
        Credible first and last points.
    zero_nm, scale_percent : float or None
        Change of standard − reading in this part: by a constant, and in proportion to the torque.
    zero_expanded_nm, scale_expanded_percent : float
        Their U (k = 2).
    size_nm : float
        Largest difference, N·m.
    constant : str
        Which column is stuck: "reading" or "standard".
    """

    cause: Cause
    first: int
    last: int
    first_range: tuple[int, int]
    last_range: tuple[int, int]
    zero_nm: float | None
    scale_percent: float | None
    size_nm: float
    constant: str = ""
    zero_expanded_nm: float = 0.0
    scale_expanded_percent: float = 0.0


@dataclass(frozen=True)
class Examination:
    """Result of the comparison of a table's points with each other.

    Parameters
    ----------
    scatter_nm : float
        Standard deviation of a point about the fitted Gaussian process, N·m.
    expanded_nm : float
        Median U (k = 2) of a further reading, as estimated from the table, N·m.
    disagreements : tuple of Disagreement
        The most probable first; none is smaller than `expanded_nm`.
    doubts : tuple of Disagreement
        Less probable ones, single rows included; about one of ten healthy tables has one.
    from_zeros : bool
        Whether the points agree only if each series counts from its own zero; then `doubts` begin
        with the parts that disagree without this.
    """

    scatter_nm: float
    expanded_nm: float
    wrong_rows: tuple[WrongRow, ...] = ()
    disagreements: tuple[Disagreement, ...] = ()
    doubts: tuple[Disagreement, ...] = ()
    from_zeros: bool = False


def examine(data: CalibrationData) -> Examination:
    """Examine whether the points of a calibration agree with each other.

    Parameters
    ----------
    data : CalibrationData
        Points in measuring order, with the zero of each series subtracted; see `tare`.

    Examples
    --------
    >>> torque = np.r_[1:21, 19:-1:-1] * 5.0
    >>> standard = np.where(np.arange(40) < 12, 1.0, 1.01) * torque
    >>> branch = np.repeat([1, -1], 20)
    >>> noise = 0.01 * np.random.default_rng(1).normal(size=40)
    >>> data = CalibrationData(torque + noise, standard, np.ones(40), branch, 105.0)
    >>> (found,) = examine(data).disagreements
    >>> found.cause, found.first, found.last, round(found.scale_percent, 1)
    ('scale', 12, 39, 1.0)
    """
    if len(data) < FEWEST_POINTS or np.ptp(data.standard_nm) == 0.0:
        return Examination(float("nan"), float("nan"))
    obvious, left = _obvious(data)
    if left.size < FEWEST_POINTS:
        return Examination(float("nan"), float("nan"), disagreements=obvious)
    from torquebench.compensation.base import single_blas_thread

    with single_blas_thread():
        examination = _Search(_Table.of(data, left)).examination()
    return replace(examination, disagreements=(*obvious, *examination.disagreements))


_FOLLOWS = 0.1
"""A value is stuck if it changes by less than this share of the other value's change."""
_LARGE = 0.05
"""Share of the largest torque above which the errors of a chain can't swap a sign or hide a
step."""


def _obvious(data: CalibrationData) -> tuple[tuple[Disagreement, ...], NDArray[np.intp]]:
    """Return parts with a swapped sign or a stuck value, and the remaining points."""
    reading, standard = data.reading_nm, data.standard_nm
    largest = float(min(np.max(np.abs(standard)), np.max(np.abs(reading))))
    loaded = np.minimum(np.abs(reading), np.abs(standard)) > _LARGE * largest
    swapped = reading * standard < 0.0
    against = np.flatnonzero(loaded & (swapped != (2 * np.sum(loaded & swapped) > np.sum(loaded))))
    same = np.flatnonzero(loaded & ~np.isin(np.arange(len(data)), against))
    explanations = []
    gone = np.zeros(len(data), dtype=np.bool_)
    for rows in np.split(against, np.flatnonzero(np.diff(np.searchsorted(same, against))) + 1):
        if rows.size >= FEWEST_ROWS:
            first, last = int(rows[0]), int(rows[-1])
            before, after = same[same < first], same[same > last]
            gone[first : last + 1] = True
            begin = int(before[-1]) + 1 if before.size else 0
            end = int(after[0]) - 1 if after.size else len(data) - 1
            gone[begin : end + 1] = True
            size = float(np.max(np.abs(standard[rows] - reading[rows])))
            explanations.append(
                Disagreement("sign", first, last, (begin, first), (last, end), None, None, size)
            )
    for name, held, moving in (
        ("reading", reading, standard),
        ("standard", standard, reading),
    ):
        for first, end in _stuck(held, moving, largest):
            if gone[first:end].any():
                continue
            gone[first:end] = True
            size = float(np.max(np.abs(standard[first:end] - reading[first:end])))
            last = end - 1
            bounds = (first, last, (first, first), (last, last))
            explanations.append(Disagreement("stuck", *bounds, None, None, size, name))
    return tuple(explanations), np.flatnonzero(~gone)


def _stuck(held: FloatArray, moving: FloatArray, largest: float) -> Iterator[tuple[int, int]]:
    """Yield first row and end of each part in which a value repeats that of the row before."""
    tolerance = max(_FOLLOWS * _LARGE * largest / 2.0, 1e-12)
    start = 0
    while start < held.size - FEWEST_ROWS:
        end = start + 1
        while end < held.size and abs(held[end] - held[start]) <= tolerance:
            end += 1
        moved = float(np.ptp(moving[start:end]))
        still = float(np.ptp(held[start:end]))
        if end - start > FEWEST_ROWS and moved > _LARGE * largest and still < _FOLLOWS * moved:
            yield start + 1, end
            start = end
        else:
            start += 1


@dataclass(frozen=True, eq=False)
class _Table:
    """Points in measuring order, the error in units of their scatter about the neighbours.

    `unit_nm` is that scatter and `largest_nm` the largest torque; `weight` is the number of rows
    averaged in a point, and `rows` has the first row of each point and finally the number of rows.
    `step_nm` is the step of which all errors are multiples, about 0 if there is none.
    """

    u: FloatArray
    error: FloatArray
    branch: FloatArray
    direction: FloatArray
    series: NDArray[np.int64]
    position: FloatArray
    condition: NDArray[np.int64]
    weight: FloatArray
    rows: NDArray[np.intp]
    unit_nm: float
    largest_nm: float
    step_nm: float

    @classmethod
    def of(cls, data: CalibrationData, rows: NDArray[np.intp]) -> "_Table":
        """Return the kept points as means over blocks, in units of range and scatter."""
        largest = float(np.max(np.abs(data.standard_nm)))
        u = data.standard_nm / largest
        if data.nominal_nm is not None:
            u = data.nominal_nm / largest
        direction = data.loading_direction().astype(np.float64)
        position = np.zeros(len(data)) if data.position_deg is None else data.position_deg
        condition = np.broadcast_to(
            stretches(data.speed_rpm, data.temperature_c), (len(data),)
        ).astype(np.int64)
        error = data.additional_torque_nm
        branch = data.branch.astype(np.float64)
        legs = np.stack([data.series, direction, branch, condition], axis=1)[rows]
        small = (np.abs(u) < _STEEP)[rows]
        block = _blocks(legs, small, MOST_POINTS)
        step = _resolution(error[rows], largest)
        unit = max(_scatter(u[rows], error[rows], legs), step / np.sqrt(12.0), _FINEST * largest)
        count = np.bincount(block)

        def mean(values: FloatArray) -> FloatArray:
            return np.bincount(block, weights=values[rows]) / count

        first = np.searchsorted(block, np.arange(count.size))
        return cls(
            mean(u),
            mean(error) / unit,
            branch[rows][first],
            direction[rows][first],
            data.series[rows][first],
            position[rows][first],
            condition[rows][first],
            count.astype(np.float64),
            np.append(rows[first], rows[-1] + 1),
            unit,
            largest,
            step,
        )


def _blocks(legs: FloatArray, small: NDArray[np.bool_], most: int) -> NDArray[np.intp]:
    """Return the block number of each row: neighbours in a leg, in at most about `most` blocks.

    Small torques, where a chain's error is steep, aren't averaged with larger ones.
    """
    size = len(legs)
    begins = np.append(True, np.any(np.diff(legs, axis=0) != 0.0, axis=1))
    begins[1:] |= small[1:] != small[:-1]
    leg = np.cumsum(begins) - 1
    position = np.arange(size) - np.flatnonzero(begins)[leg]
    width = max(1, -(-size // most))
    return np.cumsum(begins | (position % width == 0)) - 1


def _scatter(u: FloatArray, error: FloatArray, legs: FloatArray) -> float:
    """Return the robust scatter of errors about the mean of their two neighbours in a leg."""
    order = np.lexsort([u, *legs.T])
    cuts = np.flatnonzero(np.any(np.diff(legs[order], axis=0), axis=1)) + 1
    bends = []
    for members in np.split(order, cuts):
        if members.size >= 3:
            below, here, above = u[members[:-2]], u[members[1:-1]], u[members[2:]]
            share = np.divide(here - below, above - below, out=np.full(here.size, 0.5),
                              where=above > below)  # fmt: skip
            bend = error[members[1:-1]] - (
                (1.0 - share) * error[members[:-2]] + share * error[members[2:]]
            )
            bends.append(bend / np.sqrt(1.0 + share**2 + (1.0 - share) ** 2))
    if not bends:
        return float(np.std(error - np.median(error)))
    return float(np.median(np.abs(np.concatenate(bends))) / 0.6745)


def _resolution(error: FloatArray, largest: float) -> float:
    """Return the step of which all errors are multiples (Euclid); about 0 without one."""
    resolution = 0.0
    for value in np.unique(np.diff(np.unique(error))):
        rest = float(value)
        while rest > 1e-9 * largest:
            resolution, rest = rest, abs(resolution - rest * round(resolution / rest))
    return resolution


class _Description:
    """Gaussian process of a healthy table: its parts, with amplitudes from the evidence."""

    def __init__(self, table: _Table) -> None:
        self.table = table
        u, size = table.u, np.abs(table.u)
        self.parts = dict(_parts(table))
        self.shapes = np.stack(list(self.parts.values()))
        priors = np.array([*(_AMPLITUDES[name] for name in self.parts), _SCATTER, _GROWTH])
        self.prior_mean, self.prior_sd = priors.T
        # In every table the zero and the span of each direction are unknown.
        wide = 10.0 * max(float(np.max(np.abs(table.error))), 10.0)
        narrow = _DIRECTIONS * table.largest_nm / table.unit_nm
        columns = np.stack([wide * np.ones_like(u), wide * u, min(wide, narrow) * size], axis=1)
        self.known = columns @ columns.T
        self.square = u**2

    def _noise(self, amplitudes: FloatArray) -> FloatArray:
        """Return the variance of each block's mean."""
        growth = np.exp(amplitudes[-1])
        scatter = np.exp(2.0 * amplitudes[-2]) * (1.0 + growth * self.square)
        return np.asarray(scatter / self.table.weight)

    def covariance(self, amplitudes: FloatArray, columns: FloatArray) -> FloatArray:
        """Return the covariance of the points; explanations are given as scaled columns."""
        total = self.known + np.tensordot(np.exp(2.0 * amplitudes[:-2]), self.shapes, 1)
        total += columns @ columns.T
        total[np.diag_indices_from(total)] += self._noise(amplitudes)
        return np.asarray(total)

    def precision(self, amplitudes: FloatArray, columns: FloatArray) -> FloatArray:
        """Return the inverse of the covariance."""
        return _inverse(self.covariance(amplitudes, columns))[0]

    def fit(
        self, columns: FloatArray, start: FloatArray | None = None, steps: int = 60
    ) -> tuple[float, FloatArray]:
        """Return the largest log of evidence times prior, and the amplitudes that give it."""
        from scipy import optimize  # imported late: profiles don't need it

        error = self.table.error
        fixed = self.known + columns @ columns.T
        diagonal = np.diag_indices_from(fixed)

        def loss(amplitudes: FloatArray) -> tuple[float, FloatArray]:
            """Return the negative logarithm of the posterior density and its gradient."""
            powers, noise = np.exp(2.0 * amplitudes[:-2]), self._noise(amplitudes)
            covariance = fixed + np.tensordot(powers, self.shapes, 1)
            covariance[diagonal] += noise
            try:
                precision, half_log = _inverse(covariance)
            except np.linalg.LinAlgError:
                return 1e12, np.zeros_like(amplitudes)
            weighted = precision @ error
            away = (amplitudes - self.prior_mean) / self.prior_sd
            value = 0.5 * float(error @ weighted) + half_log + 0.5 * float(away @ away)
            slope = precision - np.outer(weighted, weighted)
            gradient = away / self.prior_sd
            gradient[:-2] += powers * (self.shapes.reshape(powers.size, -1) @ slope.ravel())
            # The last two amplitudes are those of the noise and of its growth with torque.
            grown = np.exp(amplitudes[-1]) * self.square
            on_diagonal = np.diag(slope) * noise
            gradient[-2] += np.sum(on_diagonal)
            gradient[-1] += 0.5 * np.sum(on_diagonal * grown / (1.0 + grown))
            return value, gradient

        farthest = 4.0 * self.prior_sd
        bounds = optimize.Bounds(self.prior_mean - farthest, self.prior_mean + farthest)
        begin = self.prior_mean if start is None else start
        minimum: Any = optimize.minimize(
            loss, begin, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": steps}
        )
        return -float(minimum.fun), np.asarray(minimum.x)


def _inverse(matrix: FloatArray) -> tuple[FloatArray, float]:
    """Return the inverse of a positive definite matrix, and half its log determinant."""
    from scipy.linalg import lapack

    factor, failed = lapack.dpotrf(matrix, lower=1)
    if failed:
        raise np.linalg.LinAlgError
    inverse, _ = lapack.dpotri(factor, lower=1)
    lower = np.tril(inverse)
    return lower + np.tril(inverse, -1).T, float(np.sum(np.log(np.diag(factor))))


def _parts(table: _Table) -> Iterator[tuple[str, FloatArray]]:
    """Yield the covariance of each part with amplitude one."""
    u, size, branch = table.u, np.abs(table.u), table.branch
    distance = np.abs(u[:, None] - u[None, :])
    alike = (table.direction[:, None] == table.direction[None, :]).astype(np.float64)
    grown = np.sqrt(np.outer(size, size)) * alike

    def smooth(length: float) -> FloatArray:
        """Return the correlations of a smooth curve over the torque."""
        return np.exp(-0.5 * (distance / length) ** 2)

    def jagged(length: float) -> FloatArray:
        """Return the correlations of a curve that has slopes but bends sharply (Matérn 3/2)."""
        far = np.sqrt(3.0) * distance / length
        return np.asarray((1.0 + far) * np.exp(-far))

    yield "smooth", grown * smooth(0.5)
    yield "middle", grown * smooth(0.15)
    yield "rough", jagged(0.06)
    step, near = np.tanh(u / 0.003), np.exp(-size / 0.05)
    yield "step", np.outer(step, step)
    # A step of any width is smooth in a coordinate that is stretched about zero.
    stretched = np.arcsinh(u / 0.004)
    close = np.sqrt(3.0) * np.abs(stretched[:, None] - stretched[None, :]) / 2.0
    yield "near zero", np.outer(near, near) * (1.0 + close) * np.exp(-close)
    if np.any(branch > 0) and np.any(branch < 0):
        top = np.ones_like(u)
        for sign in np.unique(table.direction):
            here = table.direction == sign
            top[here] = max(float(size[here].max()), 1e-9)
        inside = np.sqrt(np.maximum(1.0 - size / top, 0.0))
        # Dry friction reverses soon after the torque has reversed; at zero torque it may keep its
        # state.
        turning = np.maximum(1.0 - size / top, 0.0) / 0.03
        friction = np.where(branch > 0, 1.0, 2.0 * np.exp(-turning) - 1.0)
        closed = 1.0 - np.exp(-size / 0.01)
        either = 1.0 + np.outer(closed, closed)
        alike_in_size = np.exp(-0.5 * ((size[:, None] - size[None, :]) / 0.4) ** 2)
        # The error of a loop has the same sign in both directions ("loop"), or the sign of the
        # direction ("lag").
        for name, sign in (("loop", 1.0), ("lag", table.direction)):
            elastic, dry = sign * branch * inside, sign * friction
            yield name, np.outer(elastic, elastic) * alike_in_size
            # Dry friction has a part that is the same at all torques and one that grows with them.
            with_torque = 0.49 * (1.0 + np.outer(size, size)) + 0.02 * alike_in_size
            # A part of it may remain at the reversal itself.
            remainder = sign * np.exp(-turning)
            shape = np.outer(dry, dry) + np.outer(remainder, remainder)
            yield f"{name} of friction", shape * either * with_torque
        yield "slip", np.outer(branch, branch) * alike * jagged(0.1)
    time = np.arange(u.size) / max(u.size - 1, 1)
    # Drift is smooth in time, or in the logarithm of time (settling and creep).
    settling = np.log1p(time / 0.03) / np.log1p(1.0 / 0.03)
    late, early = (values[:, None] - values[None, :] for values in (time, settling))
    yield "drift", 0.5 * (np.exp(-2.0 * late**2) + np.exp(-2.0 * early**2))
    yield "wander", np.minimum(time[:, None], time[None, :])
    for name, label in (
        ("series", table.series),
        ("mounting", table.position),
        ("condition", table.condition),
    ):
        several = any(
            np.unique(label[table.direction == sign]).size > 1
            for sign in np.unique(table.direction)
        )
        if several:
            one = (label[:, None] == label[None, :]).astype(np.float64)
            yield name, one * (1.0 + 4.0 * np.outer(u, u)) / 5.0


@dataclass(frozen=True)
class _Explanation:
    """A change of zero, of scale or of both over a range of points, or a single wrong row."""

    kind: _Kind
    first: int
    end: int
    zero: float = 0.0
    scale: float = 0.0
    """Prior standard deviations of the changes, in units of the scatter."""

    def columns(self, u: FloatArray) -> FloatArray:
        """Return the change of the error at readings u for a size of one prior standard deviation.

        Shape (n, 1), or (n, 2) where zero and scale change together.
        """
        changed = np.zeros_like(u)
        changed[self.first : self.end] = 1.0
        columns = {"zero": changed * self.zero, "scale": changed * u * self.scale}
        chosen = {"row": ("zero",), "both": ("zero", "scale")}.get(self.kind, (self.kind,))
        return np.stack([columns[name] for name in chosen], axis=1)

    @property
    def place(self) -> tuple[str, int, int]:
        return self.kind, self.first, self.end


@dataclass(frozen=True, eq=False)
class _Tested:
    """An explanation added to others, with the evidence and amplitudes of all together."""

    odds: float
    evidence: float
    explanation: _Explanation
    amplitudes: FloatArray
    others: tuple[_Explanation, ...]


def _least_log_odds(explanation: _Explanation) -> float:
    """Return the log odds from which on an explanation is reported."""
    certain, doubtful = (
        (FALSE_ROW, FALSE_ROW_DOUBT) if explanation.kind == "row" else (FALSE_ALARM, FALSE_DOUBT)
    )
    return float(np.log(certain / doubtful))


class _Search:
    """Search for the explanations with which a table is most probable."""

    def __init__(self, table: _Table) -> None:
        self.table, self.size = table, table.u.size
        self.description = _Description(table)
        legs = np.stack([table.series, table.direction, table.branch], axis=1)
        cuts = np.flatnonzero(np.any(np.diff(legs, axis=0) != 0.0, axis=1)) + 1
        self.cut = np.zeros(self.size + 1, dtype=np.bool_)
        self.cut[[0, *cuts, self.size]] = True
        first, end = np.triu_indices(self.size + 1, 1)
        keep = ((end - first >= FEWEST_ROWS) & (first > 0)) | (end - first == 1)
        # A change from a row on and the opposite change up to it are equivalent: the later part is
        # named.
        self.first, self.end = first[keep], end[keep]
        self.doubtful: list[_Tested] = []
        self.prior = self._priors(self.first, self.end)

    def _priors(self, first: NDArray[np.intp], end: NDArray[np.intp]) -> FloatArray:
        """Return the log prior odds of a change from one point to another."""
        # 20 % for all pairs of points, 50 % for changes that last, 30 % for those of whole legs.
        n, legs = self.size, int(self.cut.sum())
        odds = np.full(first.size, 0.2 / (n * n / 2.0))
        odds[end == n] = 0.5 / n
        cut_at_both = self.cut[first] & self.cut[end]
        odds[cut_at_both] = np.maximum(odds[cut_at_both], 0.3 / (legs * (legs - 1) / 2.0))
        return np.asarray(np.log(FALSE_ALARM * odds) - _DECADE)

    def prior_of(self, explanation: _Explanation) -> float:
        """Return the log prior odds of an explanation."""
        if explanation.kind == "row":
            return float(np.log(FALSE_ROW / self.size))
        where = np.array([explanation.first]), np.array([explanation.end])
        both = np.log(_BOTH) - _DECADE if explanation.kind == "both" else 0.0
        return float(self._priors(*where)[0] + both)

    def columns(self, explanations: Sequence[_Explanation]) -> FloatArray:
        """Return the columns of all explanations, side by side."""
        return np.hstack(
            [
                np.zeros((self.size, 0)),
                *(explanation.columns(self.table.u) for explanation in explanations),
            ]
        )

    def candidates(
        self, amplitudes: FloatArray, accepted: Sequence[_Explanation]
    ) -> list[tuple[float, _Explanation]]:
        """Return the most probable further explanations, with their log odds."""
        scores = list(self._scan(amplitudes, accepted))
        places = {each.place for each in accepted}
        explanations = []
        for kind, odds, zero, scale in scores:
            taken: list[tuple[int, int]] = []
            for k in np.argsort(-odds)[:200]:
                first, end = int(self.first[k]), int(self.end[k])
                near = any(abs(first - begin) + abs(end - stop) <= 2 for begin, stop in taken)
                if odds[k] < _HOPELESS or near or (kind, first, end) in places:
                    continue
                taken.append((first, end))
                explanation = _Explanation(kind, first, end, float(zero[k]), float(scale[k]))
                explanations.append((float(odds[k]), explanation))
                if len(taken) == 2:
                    break
        return sorted(explanations, key=lambda each: -each[0])

    def _scan(
        self, amplitudes: FloatArray, accepted: Sequence[_Explanation]
    ) -> Iterator[tuple[_Kind, FloatArray, FloatArray, FloatArray]]:
        """Yield odds and sizes of all changes of each kind, for given amplitudes."""
        u, first, end = self.table.u, self.first, self.end
        precision = self.description.precision(amplitudes, self.columns(accepted))
        pull = precision @ self.table.error

        def box(values: FloatArray) -> FloatArray:
            """Return the sums of square parts of a matrix, from `first` to `end`."""
            total = np.zeros((self.size + 1, self.size + 1))
            total[1:, 1:] = values.cumsum(axis=0).cumsum(axis=1)
            corners = total[end, end] - total[first, end] - total[end, first] + total[first, first]
            return np.asarray(np.maximum(corners, 1e-12))

        def span(values: FloatArray) -> FloatArray:
            """Return the sums of parts of a row, from `first` to `end`."""
            total = np.append(0.0, np.cumsum(values))
            return np.asarray(total[end] - total[first])

        zz, ss = box(precision), box(precision * np.outer(u, u))
        total = np.zeros((self.size + 1, self.size + 1))
        total[1:, 1:] = (precision * u[None, :]).cumsum(axis=0).cumsum(axis=1)
        zs = total[end, end] - total[first, end] - total[end, first] + total[first, first]
        z, s = span(pull), span(pull * u)
        rows = end - first == 1
        alone = []
        for right, normal in ((z, zz), (s, ss)):
            variance = np.maximum((right / normal) ** 2, 100.0)
            gain = 0.5 * right**2 * variance / (1.0 + variance * normal)
            alone.append((gain - 0.5 * np.log1p(variance * normal), np.sqrt(variance)))
        (zero_odds, zero), (scale_odds, scale) = alone
        none = np.full(first.size, -np.inf)
        row_prior = np.log(FALSE_ROW / self.size)
        yield "row", np.where(rows, zero_odds + row_prior, none), zero, scale
        yield "zero", np.where(rows, none, zero_odds + self.prior), zero, scale
        untold = rows | (ss < 1e-6 * ss.max())
        yield "scale", np.where(untold, none, scale_odds + self.prior), zero, scale
        determinant = zz * ss - zs**2
        distinguishable = ~rows & (determinant > 1e-4 * zz * ss) & (end - first > FEWEST_ROWS)
        determinant = np.where(distinguishable, determinant, 1.0)
        by_zero, by_scale = (ss * z - zs * s) / determinant, (zz * s - zs * z) / determinant
        zero, scale = np.maximum(np.abs(by_zero), 10.0), np.maximum(np.abs(by_scale), 10.0)
        inner = (1.0 + zero**2 * zz) * (1.0 + scale**2 * ss) - (zero * scale * zs) ** 2
        odds = 0.5 * (by_zero * z + by_scale * s) - 0.5 * np.log(np.maximum(inner, 1.0))
        prior = self.prior + np.log(_BOTH) - _DECADE
        yield "both", np.where(distinguishable, odds + prior, none), zero, scale

    def run(self) -> tuple[list[_Explanation], FloatArray]:
        """Return the accepted explanations, and the amplitudes.

        Doubts aren't accepted, so that they don't influence the search.
        """
        accepted: list[_Explanation] = []
        evidence, amplitudes = self.description.fit(self.columns(accepted))
        while len(accepted) < _MOST_EXPLANATIONS:
            tested = []
            for explanation in self._promising(amplitudes, accepted):
                columns = self.columns([*accepted, explanation])
                more, fitted = self.description.fit(columns, amplitudes, 40)
                odds = more - evidence + self.prior_of(explanation)
                tested.append(_Tested(odds, more, explanation, fitted, tuple(accepted)))
            best = max(tested, key=lambda one: one.odds, default=None)
            if best is None or best.odds <= 0.0:
                self._doubt(tested)
                break
            if best.explanation.kind == "row":  # a change over several rows may explain it as well
                self._doubt([one for one in tested if one.evidence > best.evidence])
            evidence, amplitudes = best.evidence, best.amplitudes
            accepted.append(best.explanation)
        return self._pruned(accepted, evidence, amplitudes)

    def _doubt(self, tested: Sequence[_Tested]) -> None:
        """Record the most probable explanation of each group of rows, if it is a doubt."""
        for one in sorted(tested, key=lambda each: -each.odds):
            first, end = one.explanation.first, one.explanation.end
            apart = all(
                end <= each.explanation.first or each.explanation.end <= first
                for each in self.doubtful
            )
            if apart and one.odds > _least_log_odds(one.explanation):
                self.doubtful.append(one)

    def _promising(
        self, amplitudes: FloatArray, accepted: Sequence[_Explanation]
    ) -> list[_Explanation]:
        """Return explanations to test, by the fitted amplitudes and by those of the prior.

        A fault inflates the fitted amplitudes, which can hide it and its size.
        """
        best: dict[tuple[str, int, int], _Explanation] = {}
        for assumed in (amplitudes, self.description.prior_mean):
            for _, one in self.candidates(assumed, accepted)[:_TESTED]:
                other = best.get(one.place, one)
                best[one.place] = replace(
                    one, zero=max(one.zero, other.zero), scale=max(one.scale, other.scale)
                )
        return list(best.values())

    def _pruned(
        self, accepted: list[_Explanation], evidence: float, amplitudes: FloatArray
    ) -> tuple[list[_Explanation], FloatArray]:
        """Remove explanations that later ones made superfluous."""
        for explanation in tuple(accepted):
            others = [other for other in accepted if other is not explanation]
            less, fitted = self.description.fit(self.columns(others), amplitudes, 40)
            if evidence - less + self.prior_of(explanation) <= 0.0:
                accepted, evidence, amplitudes = others, less, fitted
        return accepted, amplitudes

    def examination(self) -> Examination:
        """Run the search, and return its result."""
        accepted, amplitudes = self.run()
        table = self.table
        precision = self.description.precision(amplitudes, self.columns(accepted))
        scatter = float(np.exp(amplitudes[-2])) * table.unit_nm
        typical = float(np.median(2.0 * table.unit_nm / np.sqrt(np.diag(precision))))
        wrong: list[WrongRow] = []
        parts: list[Disagreement] = []
        for explanation in accepted:
            others = [each for each in accepted if each is not explanation]
            if explanation.kind == "row":
                (size,), _ = self._sizes(explanation, others, amplitudes)
                wrong.append(WrongRow(int(table.rows[explanation.first]), size))
            else:
                parts.append(self._disagreement(explanation, others, amplitudes))
        parts = [part for part in parts if part.size_nm > typical]
        parts.sort(key=lambda each: -each.size_nm)
        doubtful = [
            self._disagreement(one.explanation, one.others, one.amplitudes) for one in self.doubtful
        ]
        # A difference of one display step isn't a contradiction.
        doubtful += [part for part in parts if part.size_nm <= 1.5 * table.step_nm]
        parts = [part for part in parts if part.size_nm > 1.5 * table.step_nm]
        doubts = [
            doubt
            for doubt in doubtful
            if doubt.size_nm > typical
            and not any(part.first <= doubt.last and doubt.first <= part.last for part in parts)
        ]
        return Examination(scatter, typical, tuple(wrong), tuple(parts), tuple(doubts))

    def _sizes(
        self, explanation: _Explanation, others: Sequence[_Explanation], amplitudes: FloatArray
    ) -> tuple[list[float], list[float]]:
        """Return an explanation's changes of zero and scale and their U (k = 2), N·m."""
        columns = self.columns([explanation, *others])
        precision = self.description.precision(amplitudes, columns)
        count = 2 if explanation.kind == "both" else 1
        prior = [explanation.zero, explanation.scale]
        own = columns[:, :count]
        # Coefficients are multiples of their prior standard deviations.
        units = self.table.unit_nm * np.array(
            prior if count == 2 else prior[explanation.kind == "scale" :][:1]
        )
        left = 1.0 - np.einsum("ik,ij,jk->k", own, precision, own)
        values = units * (own.T @ (precision @ self.table.error))
        return values.tolist(), (2.0 * units * np.sqrt(np.maximum(left, 0.0))).tolist()

    def _disagreement(
        self,
        explanation: _Explanation,
        others: Sequence[_Explanation],
        amplitudes: FloatArray,
    ) -> Disagreement:
        """Return an explanation as a disagreement, with its cause and credible rows.

        The cause is a changed zero or scale where one of them has nearly all the odds, else
        unknown. The credible rows are those at which the change may begin and end.
        """
        cause: Cause = "unknown"
        first, end = (explanation.first,) * 2, (explanation.end,) * 2  # earliest and latest
        if explanation.kind != "row":
            scans = self._scan(amplitudes, others)
            chosen = {kind: odds for kind, odds, *_ in scans if kind != "row"}
            largest = max(float(odds.max()) for odds in chosen.values())
            weights = {kind: np.exp(odds - largest) for kind, odds in chosen.items()}
            places = sum(weights.values(), np.zeros(self.first.size))
            single: tuple[Literal["zero", "scale"], ...] = ("zero", "scale")
            clear = SINGLED_OUT * float(places.sum())
            cause = next((name for name in single if float(weights[name].sum()) >= clear), cause)
            first = _credible(self.first, places, explanation.first)
            end = _credible(self.end, places, explanation.end)
        rows = self.table.rows
        table, u = self.table, self.table.u[explanation.first : explanation.end]
        names = {"both": ("zero", "scale"), "row": ("zero",)}.get(
            explanation.kind, (explanation.kind,)
        )
        values, uncertainties = self._sizes(explanation, others, amplitudes)
        value = {"zero": 0.0, "scale": 0.0, **dict(zip(names, values, strict=True))}
        expanded = {"zero": 0.0, "scale": 0.0, **dict(zip(names, uncertainties, strict=True))}
        return Disagreement(
            cause,
            int(rows[explanation.first]),
            int(rows[explanation.end]) - 1,
            (int(rows[first[0]]), int(rows[first[1]])),
            (int(rows[end[0]]) - 1, int(rows[end[1]]) - 1),
            value["zero"] if "zero" in names else None,
            100.0 * value["scale"] / table.largest_nm if "scale" in names else None,
            float(np.max(np.abs(value["zero"] + value["scale"] * u))),
            zero_expanded_nm=expanded["zero"],
            scale_expanded_percent=100.0 * expanded["scale"] / table.largest_nm,
        )


def _credible(at: NDArray[np.intp], weight: FloatArray, chosen: int) -> tuple[int, int]:
    """Return the range of the most probable positions that hold the credible share."""
    total = np.bincount(at, weights=weight)
    order = np.argsort(-total)
    count = int(np.searchsorted(np.cumsum(total[order]), SINGLED_OUT * total.sum())) + 1
    places = [*order[:count].tolist(), chosen]
    return min(places), max(places)
