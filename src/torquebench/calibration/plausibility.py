"""Points of a calibration that contradict each other, the model or the last calibration."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Annotated, Literal, Self, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from torquebench.calibration.data import CalibrationData
from torquebench.message import Message

__all__ = ["Contradiction", "Plausibility", "Split", "find_contradictions", "find_split"]

FloatArray = NDArray[np.float64]
Percent = Annotated[float, Field(gt=0, le=100)]
ContradictionKind = Literal[
    "sign", "split", "scatter", "loop", "repeats", "zero", "span", "directions", "model", "change"
]

_MOST_SHAPES = 16
"""Splines a direction that describe a sound chain's error."""
_SCATTERS = 4.0
"""Smallest step between neighbouring parts, in standard deviations of the points about it."""
_SPLIT_LEVEL = 1e-5
"""Probability, over all places, of a step this clear by chance."""
_FEWEST_FREEDOM = 4
_FEWEST_POINTS = 3
"""Fewer points on one side of a place are treated as outliers."""
_OUTLIERS = 2
"""Number of outliers that may be left out; a step that explains less than they do is none."""
_ALIKE = 0.02
"""Below this share of independence, a change of zero and one of span can't be distinguished."""
_ANSWER = 0.1
"""Where the smaller of reading and standard is below this share of the larger, it is stuck."""
_SIGN_SHARE = 0.01
"""Below this share of the range, a torque's sign may be caused by its error."""


class Plausibility(BaseModel):
    """Limits of contradictions between the points of a calibration, in % of full scale.

    A model of points that exceed one of these is not put into use; a person may decide otherwise.

    Parameters
    ----------
    split_percent
        Contradiction between the points before and after one moment: a scale or a zero has
        changed.
    scatter_percent
        Standard deviation of the points about a smooth curve with hysteresis, and about the model.
    loop_percent
        Difference between rising and falling torque.
    repeat_percent
        Standard deviation of repeated steps over the series.
    zero_percent
        Reading and standard without load.
    span_percent
        Error of the reading's span, in % of the span; more where the largest torque is small.
    direction_percent
        Difference of the spans of both directions, in % of the span.
    change_percent
        Difference to the model in use.

    Examples
    --------
    >>> Plausibility().span_percent
    1.5
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    split_percent: Percent = 0.06
    scatter_percent: Percent = 0.15
    loop_percent: Percent = 0.5
    repeat_percent: Percent = 0.2
    zero_percent: Percent = 0.15
    span_percent: Percent = 1.5
    direction_percent: Percent = 0.6
    change_percent: Percent = 0.3


@dataclass(frozen=True)
class Split:
    """Position from which the points of a calibration disagree with the earlier points.

    Parameters
    ----------
    first : int
        The first point after it, from 0.
    series : int
        Its series.
    torque_nm : float
        Its nominal torque (or reading, where there is none), N·m.
    branch : int
        Its branch.
    zero_nm, zero_expanded_nm : float
        How much standard − reading grew there, and the expanded uncertainty (k = 2) of that, N·m.
    span_percent, span_expanded_percent : float
        The same in proportion to the torque.
    seen_nm : float
        Size of the contradiction, N·m: the part that no smooth curve describes.
    """

    first: int
    series: int
    torque_nm: float
    branch: int
    zero_nm: float
    zero_expanded_nm: float
    span_percent: float
    span_expanded_percent: float
    seen_nm: float


@dataclass(frozen=True)
class Contradiction:
    """One exceeded limit of the profile's plausibility checks.

    Parameters
    ----------
    kind : str
    clause : str
        Key path of the profile's limit.
    found, allowed : str
        With values and units.
    cause : str
        Possible causes.
    """

    kind: ContradictionKind
    clause: str
    found: str
    allowed: str
    cause: str

    def __str__(self) -> str:
        return Message(
            "{found}; allowed: {allowed} (clause {clause}). {cause}",
            self.found,
            self.allowed,
            self.clause,
            self.cause,
        )

    @classmethod
    def of_text(cls, text: str) -> Self:
        """Return the contradiction that a model file states as a sentence.

        Examples
        --------
        >>> found = Contradiction("span", "plausibility.span_percent", "2 % off", "1 %", "A load.")
        >>> Contradiction.of_text(str(found)) == found
        True
        """
        found, _, rest = text.partition("; allowed: ")
        allowed, _, rest = rest.partition(" (clause ")
        clause, _, cause = rest.partition("). ")
        name = clause.rpartition(".")[2].removesuffix("_percent")
        kinds: tuple[ContradictionKind, ...] = get_args(ContradictionKind)
        named = [each for each in kinds if each.startswith(name)]
        kind: ContradictionKind = named[0] if named else "sign"
        return cls(kind, clause, found, allowed, cause)


def find_contradictions(
    data: CalibrationData,
    limits: Plausibility,
    *,
    torque_nm: FloatArray | None = None,
    before_nm: FloatArray | None = None,
) -> tuple[Contradiction, ...]:
    """Return the contradictions of a calibration's points, the clearest first.

    Parameters
    ----------
    data : CalibrationData
        In measuring order.
    limits : Plausibility
        Of the profile.
    torque_nm : array of float, shape (n,), optional
        Compensated torque of each reading by the fitted model.
    before_nm : array of float, shape (n,), optional
        The same by the previous model; NaN where that doesn't reach.

    Returns
    -------
    tuple of Contradiction
        Empty for a plausible calibration.

    Examples
    --------
    >>> torque = np.r_[1:11, 9:-1:-1] * 10.0
    >>> branch = np.repeat([1, -1], 10)
    >>> good = CalibrationData(torque * 0.995, torque, np.ones(20), branch, 100.0)
    >>> find_contradictions(good, Plausibility())
    ()
    >>> torque[5:] *= 0.97
    >>> changed = CalibrationData(good.reading_nm, torque, np.ones(20), branch, 100.0)
    >>> [each.kind for each in find_contradictions(changed, Plausibility())]
    ['split', 'span']
    """
    return tuple(_contradictions(data, limits, torque_nm, before_nm))


def _contradictions(
    data: CalibrationData,
    limits: Plausibility,
    torque_nm: FloatArray | None,
    before_nm: FloatArray | None,
) -> Iterator[Contradiction]:
    signs = list(_signs(data))
    yield from signs
    if signs:
        return  # all other figures follow from it
    smooth = _Smooth(data)
    split = _split(smooth, limits)
    if split is not None:
        yield _told(data, split, limits)
    elif smooth.freedom >= _FEWEST_FREEDOM:
        percent = 100.0 * smooth.scatter()
        yield from _over(
            "scatter",
            Message(
                "the points scatter by {found:.2g} % of full scale about every smooth curve",
                percent,
            ),
            percent,
            limits.scatter_percent,
            "a loose clamp, a stuck standard or an unsteady signal",
        )
    yield from _loops(data, limits)
    yield from _repeats(data, limits)
    yield from _zeros(data, limits)
    yield from _spans(data, limits)
    if torque_nm is not None:
        left = np.median(np.abs(torque_nm - data.standard_nm)) * 1.4826 / data.range_nm
        percent = 100.0 * float(left)
        yield from _over(
            "model",
            Message(
                "the model's residuals at its own points are {found:.2g} % of full scale", percent
            ),
            percent,
            limits.scatter_percent,
            "the points aren't those of one chain, or the kind of model doesn't fit it",
        )
    if torque_nm is not None and before_nm is not None and np.any(np.isfinite(before_nm)):
        change = torque_nm - before_nm
        worst = int(np.nanargmax(np.abs(change)))
        percent = 100.0 * abs(float(change[worst])) / data.range_nm
        yield from _over(
            "change",
            Message(
                "at {torque:.6g} N·m the torque differs by {change:+.4g} N·m from the "
                "model in use, {found:.2g} % of full scale",
                data.standard_nm[worst],
                change[worst],
                percent,
            ),
            percent,
            limits.change_percent,
            "the chain or the standard has changed since: an overload, another scale or mounting",
        )


def _over(
    kind: ContradictionKind, found: str, percent: float, limit: float, cause: str
) -> Iterator[Contradiction]:
    if not percent <= limit:
        if kind in ("span", "directions"):
            allowed = Message("at most {limit:.3g} %", limit)
        else:
            allowed = Message("at most {limit:.3g} % of full scale", limit)
        setting = {"directions": "direction", "repeats": "repeat", "model": "scatter"}
        yield Contradiction(
            kind,
            f"plausibility.{setting.get(kind, kind)}_percent",
            found,
            allowed,
            Message("Possible causes: {causes}.", cause),
        )


def _signs(data: CalibrationData) -> Iterator[Contradiction]:
    larger = np.maximum(np.abs(data.standard_nm), np.abs(data.reading_nm))
    loaded = larger > _SIGN_SHARE * data.range_nm
    apart = np.flatnonzero(loaded & (data.standard_nm * data.reading_nm < _ANSWER * larger**2))
    if apart.size >= _FEWEST_POINTS:
        first = int(apart[0])
        yield Contradiction(
            "sign",
            "plausibility",
            Message(
                "from point {point} on (series {series}) {count} of {all} loaded points "
                "have a standard that doesn't follow the reading, or with the other sign",
                first + 1,
                data.series[first],
                apart.size,
                np.count_nonzero(loaded),
            ),
            "reading and standard of equal sign and similar magnitude",
            "Possible causes: the standard's or the module's sign was swapped, or one of them is "
            "stuck.",
        )


class _Smooth:
    """Residual of a calibration's error about the smoothest curves with hysteresis."""

    def __init__(self, data: CalibrationData) -> None:
        self.data = data
        torque = data.reading_nm if data.nominal_nm is None else data.nominal_nm
        self.torque = torque / data.range_nm
        error = (data.standard_nm - data.reading_nm) / data.range_nm
        self.error = error
        self.axes = _axes(_shapes(self.torque, data, loops=True))
        self.freedom = len(data) - self.axes.shape[1]
        self.rest = error - self.axes @ (self.axes.T @ error)

    def scatter(self) -> float:
        """Return the standard deviation of the points about the curves, but for outliers."""
        count = min(max(_OUTLIERS, len(self.data) // 30), self.freedom - 1)
        squares = float(self.rest @ self.rest) - _gain_of_outliers(self, count)
        return float(np.sqrt(max(squares, 0.0) / (self.freedom - count)))

    def without_loops(self) -> FloatArray:
        """Return axes of the curves alone."""
        return _axes(_shapes(self.torque, self.data, loops=False))


def _axes(columns: Iterable[FloatArray]) -> FloatArray:
    left, size, _ = np.linalg.svd(np.hstack(list(columns)), full_matrices=False)
    return np.asarray(left[:, size > 1e-6 * size[0]])


def _cubic_splines(place: FloatArray, count: int) -> FloatArray:
    """Return cubic B-splines over evenly spaced knots from 0 to 1, shape (n, count).

    By de Boor's recursion: `scipy.interpolate` would add a fifth of a second to the import time.
    """
    knots = np.concatenate([[0.0] * 3, np.linspace(0.0, 1.0, count - 2), [1.0] * 3])
    last = np.searchsorted(knots, place, side="right").clip(4, count) - 1
    splines = (np.arange(knots.size - 1) == last[:, None]).astype(np.float64)
    for degree in (1, 2, 3):
        width = knots[degree:] - knots[:-degree]
        share = (place[:, None] - knots[:-degree]) / np.where(width > 0.0, width, 1.0)
        splines = splines[:, :-1] * share[:, :-1] + splines[:, 1:] * (1.0 - share[:, 1:])
    return np.asarray(splines)


def _left_of(axes: FloatArray, columns: FloatArray) -> FloatArray:
    """Return the residuals of columns after projection on the axes."""
    return np.asarray(columns - axes @ (axes.T @ columns))


def _shapes(torque: FloatArray, data: CalibrationData, *, loops: bool) -> Iterator[FloatArray]:
    """Yield columns a direction: splines for the curve, and loops that close at the reversal."""
    direction = data.loading_direction()
    for sign in (1, -1, 0):
        here = direction == sign
        if not np.any(here):
            continue
        place = np.abs(torque[here])
        place = place / (place.max() or 1.0)
        steps = np.unique(np.round(place, 3)).size
        count = min(_MOST_SHAPES, steps // 2, int(np.count_nonzero(here)) // 4)
        if count >= 4:
            columns = _cubic_splines(np.minimum(place, 1.0), count)
        else:
            columns = np.vander(place, max(count, 2), increasing=True)
        branch = data.branch[here].astype(np.float64)
        if loops and np.any(branch > 0) and np.any(branch < 0):
            opened = branch * (1.0 - place)
            columns = np.column_stack([columns, opened, opened * place, opened * place**2])
        spread = np.zeros((torque.size, columns.shape[1]))
        spread[here] = columns
        yield spread


def find_split(data: CalibrationData, limits: Plausibility | None = None) -> Split | None:
    """Return the position from which the points disagree with earlier ones; None if there is none.

    For every place in measuring order, a change of zero and span from there on is added to smooth
    curves with hysteresis in each direction. The change that explains most is a split where it is
    significant, exceeds the limit and the points' scatter, and explains more than the two largest
    outliers do.

    Parameters
    ----------
    data : CalibrationData
        In measuring order.
    limits : Plausibility, optional

    References
    ----------
    R. E. Quandt, J. American Statistical Association 53 (1958) 873: the likelihood ratio over all
    places of a change.

    Examples
    --------
    >>> torque = np.r_[1:21, 19:-1:-1] * 5.0
    >>> branch = np.repeat([1, -1], 20)
    >>> standard = np.where(np.arange(40) < 12, 1.0, 1.01) * torque * 0.99
    >>> found = find_split(CalibrationData(torque * 0.99, standard, np.ones(40), branch, 100.0))
    >>> found.first, round(found.span_percent, 6), abs(round(found.zero_nm, 6))
    (12, 1.0, 0.0)
    """
    return _split(_Smooth(data), limits or Plausibility())


def _split(smooth: _Smooth, limits: Plausibility) -> Split | None:
    from scipy import special  # imported late: profiles don't need it

    data, rest, torque = smooth.data, smooth.rest, smooth.torque
    freedom = smooth.freedom - 2
    if freedom < _FEWEST_FREEDOM or len(data) < 2 * _FEWEST_POINTS:
        return None
    gain = _gains(smooth)
    gain[: _FEWEST_POINTS - 1] = gain[len(gain) - _FEWEST_POINTS + 1 :] = 0.0
    place = int(np.argmax(gain))
    before = float(rest @ rest)
    after = max(before - float(gain[place]), 1e-24 * len(data))
    ratio = (before - after) / 2.0 / (after / freedom)
    if gain.size * float(special.fdtrc(2, freedom, ratio)) > _SPLIT_LEVEL:
        return None
    if gain[place] < _gain_of_outliers(smooth, _OUTLIERS):
        return None
    first = place + 1
    step = np.zeros((len(data), 2))
    step[first:] = np.stack([np.ones(len(data)), torque], axis=1)[first:]
    columns = _left_of(smooth.axes, step)
    change, covariance, alike = _least_squares(columns, rest)
    seen = float(np.max(np.abs(columns @ change)))
    scatter = np.sqrt(after / freedom)
    if seen <= max(limits.split_percent / 100.0, _SCATTERS * scatter):
        return None
    if alike:  # a change at a reversal resembles a loop, which is far smaller
        axes = smooth.without_loops()
        rest, columns = _left_of(axes, smooth.error), _left_of(axes, step)
        change, covariance, _ = _least_squares(columns, rest)
        scatter = np.sqrt(np.sum((rest - columns @ change) ** 2) / freedom)
    expanded = 2.0 * scatter * np.sqrt(np.diag(covariance))
    return Split(
        first=first,
        series=int(data.series[first]),
        torque_nm=float(torque[first] * data.range_nm),
        branch=int(data.branch[first]),
        zero_nm=float(change[0] * data.range_nm),
        zero_expanded_nm=float(expanded[0] * data.range_nm),
        span_percent=100.0 * float(change[1]),
        span_expanded_percent=100.0 * float(expanded[1]),
        seen_nm=seen * data.range_nm,
    )


def _gains(smooth: _Smooth) -> FloatArray:
    """Return by how much a change of zero and span at each place lowers the sum of squares."""
    rest, torque, axes = smooth.rest, smooth.torque, smooth.axes

    def following(values: FloatArray) -> FloatArray:
        return np.asarray(np.cumsum(values[::-1], axis=0)[::-1][1:])

    zero_axes, span_axes = following(axes), following(axes * torque[:, None])
    zero_zero = following(np.ones_like(torque)) - np.sum(zero_axes**2, axis=1)
    zero_span = following(torque) - np.sum(zero_axes * span_axes, axis=1)
    span_span = following(torque**2) - np.sum(span_axes**2, axis=1)
    zero, span = following(rest), following(rest * torque)
    product = zero_zero * span_span
    determinant = product - zero_span**2
    seen = zero_zero > 1e-6
    both = seen & (span_span > 1e-9) & (determinant > 1e-4 * product)
    gain = np.zeros_like(zero)
    gain[seen] = zero[seen] ** 2 / zero_zero[seen]
    gain[both] = (span_span * zero**2 - 2.0 * zero_span * zero * span + zero_zero * span**2)[
        both
    ] / determinant[both]
    return gain


def _gain_of_outliers(smooth: _Smooth, count: int) -> float:
    """Return by how much leaving out the largest outliers lowers the sum of squares."""
    rest = smooth.rest.copy()
    leverage = np.sum(smooth.axes**2, axis=1)
    free = np.maximum(1.0 - leverage, 1e-3)
    gain = 0.0
    for _ in range(count):
        gains = rest**2 / free
        worst = int(np.argmax(gains))
        gain += float(gains[worst])
        column = -smooth.axes @ smooth.axes[worst]
        column[worst] += 1.0
        rest = rest - column * rest[worst] / free[worst]
    return gain


def _least_squares(columns: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray, bool]:
    """Return the change of zero and span, its covariance, and whether both are indistinguishable.

    If they are, the change is the one of the two that explains more.
    """
    normal, right = columns.T @ columns, columns.T @ values
    size = np.maximum(np.diag(normal), 1e-12)
    if np.linalg.det(normal) > _ALIKE * size[0] * size[1]:
        covariance = np.asarray(np.linalg.inv(normal), dtype=np.float64)
        return np.asarray(covariance @ right), covariance, False
    gain = right**2 / size
    alone = np.array([gain[1] < gain[0] * (1.0 - 1e-3), gain[1] >= gain[0] * (1.0 - 1e-3)])
    covariance = np.asarray(np.diag(np.where(alone, 1.0 / size, 0.0)), dtype=np.float64)
    return np.where(alone, right / size, 0.0), covariance, True


def _told(data: CalibrationData, split: Split, limits: Plausibility) -> Contradiction:
    branch = {1: "up", -1: "down"}.get(split.branch, "branch unknown")
    return Contradiction(
        "split",
        "plausibility.split_percent",
        Message(
            "the points split before point {point} of {count} (series {series}, "
            "{torque:.6g} N·m, {branch}): from there on the standard's torque less "
            "the reading has grown by {zero:+.3g} N·m ± {zero_u:.2g} N·m (zero) and "
            "{span:+.3g} % ± {span_u:.2g} % (span)",
            split.first + 1,
            len(data),
            split.series,
            split.torque_nm,
            branch,
            split.zero_nm,
            split.zero_expanded_nm,
            split.span_percent,
            split.span_expanded_percent,
        ),
        Message("at most {limit:g} % of full scale", limits.split_percent),
        Message("Possible causes: {causes}.", _cause(data, split)),
    )


def _cause(data: CalibrationData, split: Split) -> str:
    zero = abs(split.zero_nm) > max(split.zero_expanded_nm, 0.001 * data.range_nm)
    span = abs(split.span_percent) > max(split.span_expanded_percent, 0.1)
    if span and not zero:
        return "the scale of the standard or of the module has changed"
    if zero and not span:
        return "a zero has moved, or the clamp or a mounting has slipped"
    return "the clamp slips, or the standard or the module is stuck or has another scale"


def _loops(data: CalibrationData, limits: Plausibility) -> Iterator[Contradiction]:
    """Compare rising and falling torque at equal steps of a direction."""
    labels, error = _steps(data)
    place = np.unique(labels, return_inverse=True)[1]
    up, down = (_means(place, error, data.branch == sign) for sign in (1, -1))
    opened = _middle_of_neighbours(np.abs(up - down))
    if np.any(np.isfinite(opened)):
        step = int(np.nanargmax(opened))
        torque = float(np.mean(data.standard_nm[place == step]))
        percent = 100.0 * float(opened[step])
        yield from _over(
            "loop",
            Message(
                "rising and falling torque differ by {value:.4g} N·m at {torque:.6g} "
                "N·m, {found:.2g} % of full scale",
                opened[step] * data.range_nm,
                torque,
                percent,
            ),
            percent,
            limits.loop_percent,
            "the clamp slips, the standard or the module is stuck, or the scale of one of them has "
            "changed at the turn",
        )


def _middle_of_neighbours(values: FloatArray) -> FloatArray:
    """Return the median of each finite value and its neighbours: one outlier opens no loop."""
    found = values.copy()
    known = np.flatnonzero(np.isfinite(values))
    for before, here, after in zip(known, known[1:], known[2:], strict=False):
        found[here] = np.median(values[[before, here, after]])
    if known.size > 2:
        found[known[[0, -1]]] = found[known[[1, -2]]]
    return found


def _steps(data: CalibrationData) -> tuple[NDArray[np.int64], FloatArray]:
    """Return each point's step, regardless of branch, and its error as a share of the range."""
    torque = data.standard_nm if data.nominal_nm is None else data.nominal_nm
    # Standard values of one step are close to each other, not equal.
    width = (1e-6 if data.nominal_nm is not None else 0.005) * data.range_nm
    order = np.argsort(torque, kind="stable")
    number = np.cumsum(np.diff(torque[order], prepend=-np.inf) > width)
    steps = np.empty(len(data), dtype=np.int64)
    steps[order] = number
    direction = data.loading_direction().astype(np.int64)
    return 3 * steps + direction + 1, (data.standard_nm - data.reading_nm) / data.range_nm


def _means(place: NDArray[np.int64], error: FloatArray, where: NDArray[np.bool_]) -> FloatArray:
    size = int(place.max()) + 1
    count = np.bincount(place[where], minlength=size)
    total = np.bincount(place[where], weights=error[where], minlength=size)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _repeats(data: CalibrationData, limits: Plausibility) -> Iterator[Contradiction]:
    """Compare the series of equal steps, where steps are repeated."""
    if data.nominal_nm is None:
        return
    labels, error = _steps(data)
    keys = np.stack([labels, data.branch.astype(np.int64)], axis=1)
    place = np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1)
    everywhere = np.ones(len(data), dtype=np.bool_)
    left = error - _means(place, error, everywhere)[place]
    freedom = len(data) - int(place.max()) - 1
    if freedom < 1:
        return
    percent = 100.0 * float(np.sqrt(np.sum(left**2) / freedom))
    yield from _over(
        "repeats",
        Message("repeated steps scatter by {found:.2g} % of full scale over the series", percent),
        percent,
        limits.repeat_percent,
        "a moving mounting, a drifting zero or a changing scale between the series",
    )


def _zeros(data: CalibrationData, limits: Plausibility) -> Iterator[Contradiction]:
    if data.nominal_nm is None:
        return
    unloaded = np.flatnonzero(data.unloaded)
    for name, column in (("reading", data.reading_nm), ("standard", data.standard_nm)):
        if unloaded.size:
            worst = int(unloaded[np.argmax(np.abs(column[unloaded]))])
            percent = 100.0 * abs(float(column[worst])) / data.range_nm
            yield from _over(
                "zero",
                Message(
                    "without load the reading is {value:+.4g} N·m at point {point} (series "
                    "{series}), {found:.2g} % of full scale",
                    column[worst],
                    worst + 1,
                    data.series[worst],
                    percent,
                )
                if name == "reading"
                else Message(
                    "without load the standard is {value:+.4g} N·m at point {point} (series "
                    "{series}), {found:.2g} % of full scale",
                    column[worst],
                    worst + 1,
                    data.series[worst],
                    percent,
                ),
                percent,
                limits.zero_percent,
                "a zero has moved, or a part was left on the flange",
            )


def _spans(data: CalibrationData, limits: Plausibility) -> Iterator[Contradiction]:
    from torquebench.calibration.drift import span_errors

    spans = span_errors(data)
    # The allowed zero error is a larger part of the span, the smaller the largest torque is.
    part = data.range_nm / max(float(np.max(np.abs(data.standard_nm))), 1e-3 * data.range_nm)
    more = limits.zero_percent * max(part - 1.0, 0.0)
    for name, span in spans.items():
        yield from _over(
            "span",
            Message(
                "the reading's span differs by {span:+.3g} % from the standard's, {direction}",
                span,
                name,
            ),
            abs(span),
            limits.span_percent + more,
            "a wrong scale of the standard or of the module, or the wrong transducer",
        )
    if len(spans) == 2:
        clockwise, counter = spans["clockwise"], spans["counter-clockwise"]
        percent = abs(clockwise - counter)
        yield from _over(
            "directions",
            Message(
                "the spans of both directions differ by {found:.2g} % ({cw:+.3g} % "
                "clockwise, {ccw:+.3g} % counter-clockwise)",
                percent,
                clockwise,
                counter,
            ),
            percent,
            limits.direction_percent + more,
            "a scale has changed between both directions",
        )
