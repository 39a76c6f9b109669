"""Contradictions of a calibration: points that contradict each other, and exceeded limits."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal, Self, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from torquebench.calibration.consistency import Disagreement, Examination, examine
from torquebench.calibration.data import CalibrationData
from torquebench.calibration.series import DIRECTIONS, tare
from torquebench.message import Message

FloatArray = NDArray[np.float64]
Percent = Annotated[float, Field(gt=0, le=100)] | None
ContradictionKind = Literal[
    "zero", "scale", "sign", "stuck", "unknown", "loop", "repeats", "span", "directions", "change"
]

FALSE_MOVE = 1e-3
"""Probability of a false report that the zeros of series have moved."""


class Plausibility(BaseModel):
    """Limits of size that a profile states for its own transducers, in % of full scale.

    A model of points that exceed a limit isn't put into use, unless a person decides otherwise.
    None means no limit. Contradictions between points are found without limits: see `examine`.

    Parameters
    ----------
    loop_percent
        Difference between rising and falling torque.
    repeat_percent
        Standard deviation of repeated steps over the series.
    zero_percent
        Reading of the transducer and of the standard without load.
    span_percent
        Error of the reading's span, in % of the span; more where the largest torque is small.
    direction_percent
        Difference of the spans of both directions, in % of the span.
    change_percent
        Difference from the model in use.

    Examples
    --------
    >>> Plausibility(span_percent=1.5).loop_percent is None
    True
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    loop_percent: Percent = None
    repeat_percent: Percent = None
    zero_percent: Percent = None
    span_percent: Percent = None
    direction_percent: Percent = None
    change_percent: Percent = None

    @model_validator(mode="before")
    @classmethod
    def _of_earlier_versions(cls, values: Any) -> Any:
        """Drop two limits of version 0.2.0, which the comparison of the points replaces."""
        if not isinstance(values, dict):
            return values
        gone = ("split_percent", "scatter_percent")
        return {name: value for name, value in values.items() if name not in gone}


@dataclass(frozen=True)
class Contradiction:
    """A part of a calibration's points that contradicts the rest, or one exceeded limit.

    Parameters
    ----------
    clause : str
        Key path of the profile's limit; empty where the points contradict each other.
    found, allowed : str
        Found and allowed value, with units.
    cause : str
        The most probable cause by the points; possible causes of an exceeded limit.
    """

    kind: ContradictionKind
    clause: str
    found: str
    allowed: str
    cause: str

    def __str__(self) -> str:
        if not self.clause and not self.cause:
            return Message("{found}; allowed: {allowed}", self.found, self.allowed)
        if not self.clause:
            return Message(
                "{found}; allowed: {allowed}. {cause}", self.found, self.allowed, self.cause
            )
        return Message(
            "{found}; allowed: {allowed} (clause {clause}). {cause}",
            self.found,
            self.allowed,
            self.clause,
            self.cause,
        )

    @classmethod
    def of_text(cls, text: str) -> Self:
        """Rebuild the contradiction from its sentence in a model file.

        Examples
        --------
        >>> limit = Contradiction("span", "plausibility.span_percent", "2 % off", "1 %", "A load.")
        >>> Contradiction.of_text(str(limit)) == limit
        True
        """
        message, _, rest = text.partition("; allowed: ")
        allowed, _, rest = rest.partition(" (clause ")
        clause, _, cause = rest.partition("). ")
        if not clause:
            allowed, _, cause = allowed.partition(". ")
            return cls("unknown", "", message, allowed, cause)
        name = clause.rpartition(".")[2].removesuffix("_percent")
        kinds: tuple[ContradictionKind, ...] = get_args(ContradictionKind)
        named = [each for each in kinds if each.startswith(name)]
        kind: ContradictionKind = named[0] if named else "unknown"
        return cls(kind, clause, message, allowed, cause)


def examine_table(data: CalibrationData) -> Examination:
    """Examine whether the points of a calibration agree with each other.

    The readings are compared without subtracting the zero of each series, because a single wrong
    zero would move its whole series. If the points, or their repeats, agree only with these zeros
    subtracted, they are compared that way, and the parts that disagree without it are doubts.
    """
    as_read, points = examine(data), tare(data).data
    if np.array_equal(points.reading_nm, data.reading_nm):
        return as_read
    moved = _zeros_moved(data, points)
    if not (moved or as_read.disagreements):
        return as_read
    from_zeros = examine(points)
    if from_zeros.disagreements and not moved:
        return min(as_read, from_zeros, key=lambda each: len(each.disagreements))
    doubts = (*as_read.disagreements, *from_zeros.doubts)
    return replace(from_zeros, doubts=doubts, from_zeros=True)


def _zeros_moved(data: CalibrationData, points: CalibrationData) -> bool:
    """Return whether repeats agree better without the zeros of their series, by an F-test."""
    from scipy.special import fdtri  # imported late: profiles don't need SciPy

    loaded = np.flatnonzero(~data.unloaded)
    as_read, from_zeros = (compared.subset(loaded).noise_floor() for compared in (data, points))
    if as_read is None or from_zeros is None or from_zeros.degrees_of_freedom < 1:
        return False
    series = np.unique(data.series).size
    limit = fdtri(max(series - 1, 1), from_zeros.degrees_of_freedom, 1.0 - FALSE_MOVE)
    as_read_nm, from_zeros_nm = (
        compared.standard_deviation_nm for compared in (as_read, from_zeros)
    )
    return bool(as_read_nm > limit**0.5 * from_zeros_nm)  # repeats may agree exactly


def find_contradictions(
    data: CalibrationData,
    limits: Plausibility | None = None,
    *,
    examination: Examination | None = None,
    torque_nm: FloatArray | None = None,
    before_nm: FloatArray | None = None,
) -> tuple[Contradiction, ...]:
    """Return the contradictions of a calibration, the clearest first.

    Parameters
    ----------
    data : CalibrationData
        In measuring order.
    limits : Plausibility, optional
        Limits of the profile that was followed.
    examination : Examination, optional
        Result of `examine_table`, if known already.
    torque_nm : array of float, shape (n,), optional
        Compensated torque of each reading by the fitted model.
    before_nm : array of float, shape (n,), optional
        Torque by the previous model; NaN outside its range.

    Returns
    -------
    tuple of Contradiction
        Empty for a plausible calibration.

    Examples
    --------
    >>> torque = np.r_[1:11, 9:-1:-1] * 10.0
    >>> branch = np.repeat([1, -1], 10)
    >>> good = CalibrationData(torque * 0.995, torque, np.ones(20), branch, 100.0)
    >>> find_contradictions(good)
    ()
    >>> torque[5:] *= 0.97
    >>> changed = CalibrationData(good.reading_nm, torque, np.ones(20), branch, 100.0)
    >>> [each.kind for each in find_contradictions(changed)]
    ['scale']
    """
    examination = examination or examine_table(data)
    contradictions = [
        contradiction_of(data, disagreement, examination)
        for disagreement in examination.disagreements
    ]
    contradictions += _opposite(data)
    return (*contradictions, *_exceeded(data, limits or Plausibility(), torque_nm, before_nm))


def contradiction_of(
    data: CalibrationData, part: Disagreement, examination: Examination
) -> Contradiction:
    """Return a disagreeing part as a contradiction, with the file's row numbers."""
    where = _place(data, part)
    allowed = Message(
        "a difference of at most {expanded:.2g} N·m, the U (k = 2) of a reading by the other rows",
        examination.expanded_nm,
    )
    if part.cause == "sign":
        message = Message("{where}: reading and standard have opposite signs", where)
        allowed = Message("the sign of the other rows")
        cause = "The sign of one of them is swapped there."
        return Contradiction("sign", "", message, allowed, cause)
    if part.cause == "stuck":
        values = data.reading_nm if part.constant == "reading" else data.standard_nm
        others = data.standard_nm if part.constant == "reading" else data.reading_nm
        rows = slice(part.first, part.last + 1)
        message = Message(
            "{where}: the {stuck} stays at {value:.6g} N·m, while the {other} goes from {low:.6g} "
            "to {high:.6g} N·m",
            where,
            part.constant,
            values[part.first],
            "standard" if part.constant == "reading" else "reading",
            others[rows].min(),
            others[rows].max(),
        )
        return Contradiction("stuck", "", message, "a value that follows", "It is stuck there.")
    parts = []
    if part.zero_nm is not None:
        parts.append(Message("{zero:+.3g} N·m ± {u:.2g} N·m", part.zero_nm, part.zero_expanded_nm))
    if part.scale_percent is not None:
        parts.append(
            Message(
                "{scale:+.3g} % ± {u:.2g} % of the torque",
                part.scale_percent,
                part.scale_expanded_percent,
            )
        )
    message = Message(
        "{where}: standard − reading differs from that of the other rows by {size}, at most "
        "{largest:.3g} N·m",
        where,
        Message.joined(parts),
        part.size_nm,
    )
    cause = {
        "zero": "A zero has moved there.",
        "scale": "The scale of the reading or of the standard has changed there.",
    }.get(part.cause, "")
    return Contradiction(part.cause, "", message, allowed, cause)


def rows_in_words(data: CalibrationData, first: int, last: int | None = None) -> str:
    """Describe points by the rows of their file, or by their numbers from 1.

    Examples
    --------
    >>> data = CalibrationData([1, 2], [1, 2], [1, 1], [1, 1], 2.0, row=[7, 9])
    >>> rows_in_words(data, 0, 1), rows_in_words(data, 1)
    ('rows 7 to 9', 'row 9')
    """
    numbers = np.arange(1, len(data) + 1) if data.row is None else data.row
    table = "" if data.table is None else str(data.table[first])
    if last is None or last == first:
        words = Message("row {row}", numbers[first])
    else:
        words = Message("rows {first} to {last}", numbers[first], numbers[last])
    return Message("{table}, {rows}", table, words) if table else words


def _place(data: CalibrationData, part: Disagreement) -> str:
    """Return in words between which points a disagreement lies."""
    first, last = part.first, part.last
    words = Message(
        "{rows} (series {series}, {start:.6g} N·m to {end:.6g} N·m)",
        rows_in_words(data, first, last),
        data.series[first],
        data.standard_nm[first],
        data.standard_nm[last],
    )
    (earliest, latest), (soonest, furthest) = part.first_range, part.last_range
    if earliest < first or latest > first:
        words = Message(
            "{place}, beginning between {earliest} and {latest}",
            words,
            rows_in_words(data, earliest),
            rows_in_words(data, latest),
        )
    if last < len(data) - 1 and (soonest < last or furthest > last):
        words = Message(
            "{place}, ending between {earliest} and {latest}",
            words,
            rows_in_words(data, soonest),
            rows_in_words(data, furthest),
        )
    return words


def _opposite(data: CalibrationData) -> list[Contradiction]:
    """Return a contradiction if reading and standard have opposite signs in the whole table."""
    reading, standard = data.reading_nm, data.standard_nm
    if np.ptp(standard) == 0.0 or np.ptp(reading) == 0.0:
        return []
    if np.corrcoef(reading, standard)[0, 1] > -0.5:
        return []
    return [
        Contradiction(
            "sign",
            "",
            "the reading falls where the standard rises, in the whole table",
            "readings that follow the standard",
            "The sign of one of them is reversed: `--column reading=-HEADER` reverses it.",
        )
    ]


def _exceeded(
    data: CalibrationData,
    limits: Plausibility,
    torque_nm: FloatArray | None,
    before_nm: FloatArray | None,
) -> Iterator[Contradiction]:
    """Yield a contradiction for each limit of the profile that the points exceed."""
    if limits.loop_percent is not None:
        yield from _loops(data, limits.loop_percent)
    if limits.repeat_percent is not None and data.nominal_nm is not None:
        yield from _repeats(data, limits.repeat_percent)
    if limits.zero_percent is not None and data.nominal_nm is not None:
        yield from _zeros(data, limits.zero_percent)
    if limits.span_percent is not None or limits.direction_percent is not None:
        yield from _spans(data, limits)
    if limits.change_percent is None or torque_nm is None or before_nm is None:
        return
    change = torque_nm - before_nm
    if np.any(np.isfinite(change)):
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
    """Yield a contradiction if a share exceeds its limit or is unknown."""
    if not percent <= limit:
        of_span = kind in ("span", "directions")
        allowed = (
            Message("at most {limit:.3g} %", limit)
            if of_span
            else Message("at most {limit:.3g} % of full scale", limit)
        )
        setting = {"directions": "direction", "repeats": "repeat"}.get(kind, kind)
        clause = f"plausibility.{setting}_percent"
        yield Contradiction(
            kind, clause, found, allowed, Message("Possible causes: {causes}.", cause)
        )


def _loops(data: CalibrationData, limit: float) -> Iterator[Contradiction]:
    """Compare rising and falling torque at equal steps of a direction."""
    labels, error = _steps(data)
    step_of = np.unique(labels, return_inverse=True)[1]
    up, down = (_means(step_of, error, data.branch == sign) for sign in (1, -1))
    opened = _middle_of_neighbours(np.abs(up - down))
    if np.any(np.isfinite(opened)):
        step = int(np.nanargmax(opened))
        percent = 100.0 * float(opened[step])
        yield from _over(
            "loop",
            Message(
                "rising and falling torque differ by {value:.4g} N·m at {torque:.6g} "
                "N·m, {found:.2g} % of full scale",
                opened[step] * data.range_nm,
                float(np.mean(data.standard_nm[step_of == step])),
                percent,
            ),
            percent,
            limit,
            "the clamp slips, the standard or the module is stuck, or the scale of one of them has "
            "changed at the turn",
        )


def _middle_of_neighbours(values: FloatArray) -> FloatArray:
    """Return medians of each finite value and its neighbours, so that one outlier makes no loop."""
    medians = values.copy()
    finite = np.flatnonzero(np.isfinite(values))
    for before, here, after in zip(finite, finite[1:], finite[2:], strict=False):
        medians[here] = np.median(values[[before, here, after]])
    if finite.size > 2:
        medians[finite[[0, -1]]] = medians[finite[[1, -2]]]
    return medians


def _steps(data: CalibrationData) -> tuple[NDArray[np.int64], FloatArray]:
    """Return each point's step, regardless of branch, and its error as a share of the range."""
    torque = data.standard_nm if data.nominal_nm is None else data.nominal_nm
    # Standard values of one step are close to each other, but not equal.
    width = (1e-6 if data.nominal_nm is not None else 0.005) * data.range_nm
    order = np.argsort(torque, kind="stable")
    number = np.cumsum(np.diff(torque[order], prepend=-np.inf) > width)
    steps = np.empty(len(data), dtype=np.int64)
    steps[order] = number
    direction = data.loading_direction().astype(np.int64)
    return 3 * steps + direction + 1, data.additional_torque_nm / data.range_nm


def _means(step_of: NDArray[np.intp], error: FloatArray, where: NDArray[np.bool_]) -> FloatArray:
    """Return the mean error of each step over the rows in `where`; NaN without any."""
    size = int(step_of.max()) + 1
    count = np.bincount(step_of[where], minlength=size)
    total = np.bincount(step_of[where], weights=error[where], minlength=size)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _repeats(data: CalibrationData, limit: float) -> Iterator[Contradiction]:
    """Compare the series of repeated steps."""
    labels, error = _steps(data)
    keys = np.stack([labels, data.branch.astype(np.int64)], axis=1)
    step_of = np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1)
    residual = error - _means(step_of, error, np.ones(len(data), dtype=np.bool_))[step_of]
    freedom = len(data) - int(step_of.max()) - 1
    if freedom < 1:
        return
    percent = 100.0 * float(np.sqrt(np.sum(residual**2) / freedom))
    yield from _over(
        "repeats",
        Message("repeated steps scatter by {found:.2g} % of full scale over the series", percent),
        percent,
        limit,
        "a moving mounting, a drifting zero or a changing scale between the series",
    )


def _zeros(data: CalibrationData, limit: float) -> Iterator[Contradiction]:
    """Yield a contradiction for reading or standard too far from zero without load."""
    unloaded = np.flatnonzero(data.unloaded)
    for name, column in (("reading", data.reading_nm), ("standard", data.standard_nm)):
        if unloaded.size:
            worst = int(unloaded[np.argmax(np.abs(column[unloaded]))])
            percent = 100.0 * abs(float(column[worst])) / data.range_nm
            yield from _over(
                "zero",
                Message(
                    "without load the {name} is {value:+.4g} N·m at {row} (series {series}), "
                    "{found:.2g} % of full scale",
                    name,
                    column[worst],
                    rows_in_words(data, worst),
                    data.series[worst],
                    percent,
                ),
                percent,
                limit,
                "a zero has moved, or a part was left on the flange",
            )


def _spans(data: CalibrationData, limits: Plausibility) -> Iterator[Contradiction]:
    """Yield contradictions of spans: to the standard's, and between the directions."""
    from torquebench.calibration.drift import span_errors

    spans = span_errors(data)
    # The smaller the largest torque, the larger is the allowed zero error as a part of the span.
    part = data.range_nm / max(float(np.max(np.abs(data.standard_nm))), 1e-3 * data.range_nm)
    more = (limits.zero_percent or 0.0) * max(part - 1.0, 0.0)
    for name, span in spans.items():
        if limits.span_percent is not None:
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
    if len(spans) == 2 and limits.direction_percent is not None:
        clockwise, counter = (spans[name] for name in DIRECTIONS.values())
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
