"""Resume an interrupted loading sequence: repeat zero and preload, then the interrupted series."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from torquebench.calibration import Step
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.procedures.staircase import Row


@dataclass(frozen=True)
class Resumption:
    """Remaining steps of an interrupted calibration, and its measured points.

    Parameters
    ----------
    steps : tuple of Step
        Repeated preloads and zero, then the profile's steps from the interrupted series on.
    earlier : tuple of (Step, Row)
        Acknowledged points of the earlier complete series, in measuring order; their bench times
        are shifted to before this run.
    """

    steps: tuple[Step, ...]
    earlier: tuple[tuple[Step, Row], ...]


def complete_series(steps: Sequence[Step], taken: Collection[tuple[int, int]]) -> tuple[int, ...]:
    """Return the leading series of which every point was measured.

    A complete series after an incomplete one doesn't count, because the chain's hysteresis depends
    on the order of the series.

    Parameters
    ----------
    steps : sequence of Step
        Steps of the whole calibration.
    taken : collection of (series, index)
        Points that were acknowledged.

    Examples
    --------
    >>> def point(series, index):
    ...     return Step(kind="point", series=series, index=index, nominal_nm=1.0, branch=1,
    ...                 duration_s=1.0)
    >>> steps = [point(1, 0), point(1, 1), point(2, 0), point(2, 1)]
    >>> complete_series(steps, {(1, 0), (1, 1), (2, 0)})
    (1,)
    """
    complete = []
    for series in sorted({step.series for step in steps if step.recorded}):
        wanted = {(step.series, step.index) for step in steps if step.recorded}
        if not {each for each in wanted if each[0] == series} <= set(taken):
            break
        complete.append(series)
    return tuple(complete)


def steps_from(steps: Sequence[Step], series: int) -> tuple[Step, ...]:
    """Return the steps that continue with a series: its repeated preloads and zero, then the rest.

    Preloads and zero are the last ones before the series, in their order. If the series isn't the
    first in its mounting position, the standard is seated in this position again, because it may
    have been moved meanwhile.

    Raises
    ------
    InputError
        There is no such series.
    """
    first = next(
        (number for number, step in enumerate(steps) if step.recorded and step.series == series),
        None,
    )
    if first is None:
        raise InputError(
            Message("series {series} to go on with", series), "a series of the profile"
        )
    return (*preparation(steps[:first]), *steps[first:])


def steps_again(steps: Sequence[Step], points: Collection[tuple[int, int]]) -> tuple[Step, ...]:
    """Return the steps that measure single points again, with the history of their series.

    Each series is prepared as after an interruption and loaded up to its last such point, so that
    the chain's hysteresis is the same; only these points are recorded.

    Parameters
    ----------
    steps : sequence of Step
        Steps of the whole calibration.
    points : collection of (series, index)
        Points to be measured again.

    Examples
    --------
    >>> def point(series, index):
    ...     return Step(kind="point", series=series, index=index, nominal_nm=10.0 * index, branch=1,
    ...                 duration_s=1.0)
    >>> steps = [point(1, 1), point(1, 2), point(1, 3), point(2, 1)]
    >>> [(step.kind, step.nominal_nm) for step in steps_again(steps, {(1, 2)})]
    [('turn', 10.0), ('point', 20.0)]
    """
    again: list[Step] = []
    for series in sorted({series for series, _ in points}):
        own = [n for n, step in enumerate(steps) if step.recorded and step.series == series]
        wanted = [n for n in own if (series, steps[n].index) in points]
        again += preparation(steps[: own[0]])
        for number in range(own[0], wanted[-1] + 1):
            step = steps[number]
            if step.recorded and number not in wanted:
                step = step.model_copy(update={"kind": "turn", "index": -1})
            again.append(step)
    return tuple(again)


def preparation(before: Sequence[Step]) -> tuple[Step, ...]:
    """Return the preloads and the zero that are repeated after an interruption.

    Parameters
    ----------
    before : sequence of Step
        The profile's steps up to the interruption; see `steps_from`.

    Examples
    --------
    >>> def step(kind, nominal_nm=0.0, series=0):
    ...     return Step(kind=kind, series=series, index=0, nominal_nm=nominal_nm, branch=1,
    ...                 duration_s=1.0)
    >>> steps = [step("preload", 10.0), step("preload", 0.0), step("zero"), step("point", 5.0, 1)]
    >>> [each.kind for each in preparation(steps)]
    ['preload', 'preload', 'zero']
    """
    zero = max((n for n, step in enumerate(before) if step.kind == "zero"), default=None)
    preloads = _last_preloads(before)
    again = [before[n] for n in sorted({*preloads, *([zero] if zero is not None else [])})]
    seat = _seating(before)
    if again and seat is not None and seat.change != "none":
        again = [again[0].model_copy(update={"change": seat.change}), *again[1:]]
        again[1:] = [step.model_copy(update={"change": "none"}) for step in again[1:]]
    return tuple(again)


def _last_preloads(before: Sequence[Step]) -> list[int]:
    """Return the indices of the last group of preloads before a series."""
    numbers: list[int] = []
    for number in range(len(before) - 1, -1, -1):
        if before[number].kind == "preload":
            numbers.append(number)
        elif numbers:
            break
    return numbers


def _seating(before: Sequence[Step]) -> Step | None:
    """Return the step at which the standard was last seated."""
    changes = [step for step in before if step.change != "none"]
    return changes[-1] if changes else None
