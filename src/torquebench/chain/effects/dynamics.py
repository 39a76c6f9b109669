"""Dynamics: response of shaft, transducer and counter to a quickly changing torque."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, ClassVar, Self

import numpy as np

from torquebench.chain.effect import Effect, register
from torquebench.chain.readings import FloatArray, Known, Readings, known_or
from torquebench.chain.torque import Component
from torquebench.dynamics import FilterStream, InverseFilter, UncertainFilter
from torquebench.elementwise import Values
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.uncertainty import Distribution, Shared

_UNEVEN = 0.05  # of the sample interval
_SQUARE_ROOT_3 = 3.0**0.5


@register("dynamics")
@dataclass(frozen=True)
class Dynamics(Effect):
    """The inverse of an identified transfer function, as a filter along the stream.

    The filter only takes readings at the rate for which it was designed. A row of a record gets the
    torque at its own time, from readings up to `delay_s` later; the torques of a live stream are
    delayed by `delay_s`. Readings at another rate aren't corrected, and the chain's delay enters as
    an uncertainty that grows with the rate of change; readings without a time are treated as
    steady.

    Parameters
    ----------
    interval_s : float
        Sample interval of the filter.
    weights : tuple of float
        Coefficients of the filter.
    factors : tuple of tuples of float
        Rows whose outer products sum up to the covariance of the coefficients.
    delay_s : float
        Delay of chain and filter together.
    late_s : float
        Delay of the chain alone for slow changes.
    """

    title: ClassVar[str] = "dynamics of shaft and transducer"
    needs: ClassVar[tuple[str, ...]] = ("time_s",)
    corrects_reading: ClassVar[bool] = True
    interval_s: float = field(metadata={"least": 1e-9})
    weights: tuple[float, ...] = (1.0,)
    factors: tuple[tuple[float, ...], ...] = ()
    delay_s: float = field(default=0.0, metadata={"least": 0.0})
    late_s: float = field(default=0.0, metadata={"least": 0.0})

    @classmethod
    def of(cls, record: str, designed: InverseFilter) -> Self:
        """Return the effect for a designed filter."""
        return cls(
            record,
            designed.interval_s,
            tuple(designed.filter.weights.tolist()),
            tuple(map(tuple, designed.filter.factors.tolist())),
            designed.delay_s,
            designed.transfer.group_delay_s,
        )

    @classmethod
    def from_specification(cls, values: Mapping[str, Any]) -> Self:
        """Rebuild the effect from its `specification`."""
        listed = dict(values)
        try:
            listed["weights"] = tuple(map(float, listed["weights"]))
            listed["factors"] = tuple(tuple(map(float, row)) for row in listed["factors"])
        except (KeyError, ValueError) as problem:
            raise InputError(
                Message("{title}: no coefficients ({problem})", cls.title, problem),
                "lists of numbers",
            ) from problem
        return cls(**listed)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.filter()

    def filter(self) -> UncertainFilter:
        """Return the filter; raises `InputError` if the coefficients are unsuitable."""
        rows = np.asarray(self.factors, np.float64).reshape(-1, len(self.weights))
        return UncertainFilter(np.asarray(self.weights), covariance=rows.T @ rows)

    def check_rate(self, time_s: FloatArray | None) -> None:
        """Refuse rows that aren't at the filter's rate."""
        if time_s is None or time_s.size < 2:
            message = "readings at uneven times"
        else:
            step = float(np.median(np.diff(time_s)))
            if abs(step - self.interval_s) <= _UNEVEN * self.interval_s:
                return
            message = Message("readings every {step:.6g} s", step)
        raise InputError(
            Message("{found}, dynamics identified at {interval_s:.6g} s", message, self.interval_s),
            "a column time_s at that rate",
            "identify the dynamics at the rate of the readings",
        )

    @property
    def rows_late(self) -> int:
        """Number of readings by which the filter's output is delayed."""
        return round(self.delay_s / self.interval_s)

    def acted_s(self, time_s: FloatArray) -> FloatArray:
        """Return when the torques acted that the live filter states at these times.

        The caller subtracts the transducer's own delay.
        """
        if time_s.size < 2 or abs(time_s[1] - time_s[0] - self.interval_s) > (
            _UNEVEN * self.interval_s
        ):
            return time_s
        return time_s - (self.delay_s - self.late_s)

    def components(self, readings: Readings, torque_nm: Values) -> tuple[Component, ...]:
        """Return the components for rows that are a whole record."""
        recorded = self.recorded()
        recorded.prepare(readings, None)
        return recorded.components(readings, torque_nm)

    def recorded(self) -> RecordedDynamics:
        """Return a filter for one record, whose blocks are passed in order."""
        return RecordedDynamics(self.record, self, _Prepared())

    def stream(self) -> Effect:
        """Return a filter for one live stream."""
        return _FollowedDynamics(self.record, self, _Memory(self.filter().stream()))


@dataclass
class _Memory:
    """State between the blocks of a stream of readings."""

    filtering: FilterStream
    settling: int = 0
    last_s: float = float("nan")
    last_nm: float = float("nan")

    def copy(self) -> _Memory:
        return _Memory(self.filtering.copy(), self.settling, self.last_s, self.last_nm)

    def forget(self) -> None:
        """Forget earlier samples."""
        self.filtering.forget()
        self.settling = 0
        self.last_s = self.last_nm = float("nan")


@dataclass(frozen=True)
class _AppliedDynamics(Effect):
    """Base of the filters that replace the effect while readings are processed."""

    title: ClassVar[str] = Dynamics.title
    kind: ClassVar[str] = Dynamics.kind
    corrects_reading: ClassVar[bool] = True
    effect: Dynamics


@dataclass(frozen=True)
class _FollowedDynamics(_AppliedDynamics):
    """The filter along one stream."""

    memory: _Memory

    def copy(self) -> Effect:
        return _FollowedDynamics(self.record, self.effect, self.memory.copy())

    def forget(self) -> None:
        self.memory.forget()

    def components(self, readings: Readings, torque_nm: Values) -> tuple[Component, ...]:
        """Return the filter's correction of the next readings; it restarts after a gap."""
        time = readings.time_s
        if time is None:
            return ()
        torque_nm = np.array(torque_nm, ndmin=1)
        rows = self._going_on(time, torque_nm, readings.counter_nm)
        if rows is None:
            rows = np.zeros((3, torque_nm.size))
            if torque_nm.size:
                self._begin(rows, time, torque_nm, readings.counter_nm)
        return _components(*rows)

    def _begin(
        self, rows: FloatArray, time: FloatArray, reading_nm: FloatArray, counter_nm: Known
    ) -> None:
        """Write correction and u for readings that may have gaps, another rate or faults."""
        added, curve, noise = rows
        memory, interval_s, count = self.memory, self.effect.interval_s, time.size
        step = np.diff(time, prepend=memory.last_s)
        even = np.abs(step - interval_s) <= _UNEVEN * interval_s
        if not np.isfinite(step[0]):  # the first reading of a stream has no previous one
            even[0] = count == 1 or even[1]
        if even.any():
            spread = np.broadcast_to(known_or(counter_nm, 0.0), (count,))
            for start, stop in pairwise([0, *(np.flatnonzero(~even[1:]) + 1).tolist(), count]):
                if not even[start]:
                    memory.forget()
                part = slice(start, stop)
                self._filter(reading_nm[part], spread[part], added[part], curve[part], noise[part])
        else:
            earlier = np.concatenate([[memory.last_nm], reading_nm[:-1]])
            with np.errstate(invalid="ignore", divide="ignore"):
                slope = np.abs((reading_nm - earlier) / step)
            curve[:] = np.nan_to_num(self.effect.late_s * slope / _SQUARE_ROOT_3, posinf=0.0)
            memory.filtering.forget()
            memory.settling = 0
        memory.last_s, memory.last_nm = float(time[-1]), float(reading_nm[-1])

    def _going_on(self, time: FloatArray, reading_nm: FloatArray, counter_nm: Known) -> Any:
        """Return correction and u for a settled stream's next readings; None after a gap."""
        memory, interval_s = self.memory, self.effect.interval_s
        if not isinstance(counter_nm, np.ndarray) or counter_nm.shape != reading_nm.shape:
            return None
        settled = time.size and memory.settling >= len(self.effect.weights) - 1
        if not settled or not _goes_on(time, memory.last_s, interval_s, _UNEVEN * interval_s):
            return None
        rows = memory.filtering.correct(reading_nm, counter_nm)
        if rows is not None:
            memory.settling += time.size
            memory.last_s, memory.last_nm = float(time[-1]), float(reading_nm[-1])
        return rows

    def _filter(
        self,
        reading_nm: FloatArray,
        counter_nm: FloatArray,
        added: FloatArray,
        curve: FloatArray,
        noise: FloatArray,
    ) -> None:
        """Write the filter's correction for readings without a gap between them."""
        faulty = ~np.isfinite(reading_nm)
        filtered = self.memory.filtering.push(reading_nm, np.where(faulty, 0.0, counter_nm))
        added[:] = filtered.value - reading_nm
        curve[:] = filtered.of_coefficients
        noise[:] = np.sqrt(np.maximum(filtered.of_noise**2 - counter_nm**2, 0.0))
        # the readings before the first one are unknown, so that the filter's output is uncertain
        if self.memory.settling >= len(self.effect.weights) - 1 and not faulty.any():
            self.memory.settling += reading_nm.size
            return
        row = np.arange(reading_nm.size)
        last_fault = np.maximum.accumulate(np.where(faulty, row, -1 - self.memory.settling))
        since = row - last_fault - 1  # sound readings before each one
        unsettled = since < len(self.effect.weights) - 1
        curve[:] = np.hypot(curve, np.where(unsettled, added / _SQUARE_ROOT_3, 0.0))
        self.memory.settling = int(since[-1]) + 1


def _goes_on(time_s: FloatArray, before_s: float, interval_s: float, allowed_s: float) -> bool:
    """Return whether times continue an earlier time at a constant interval."""
    for time in time_s.tolist():
        if not abs(time - before_s - interval_s) <= allowed_s:
            return False
        before_s = time
    return True


def _components(added: FloatArray, curve: FloatArray, noise: FloatArray) -> tuple[Component, ...]:
    """Return correction and uncertainties of the filter as components."""
    return (
        Component("dynamics", Shared.LOADING, curve, added, distribution=Distribution.RECTANGULAR),
        Component("noise of the dynamic filter", Shared.NOTHING, noise),
    )


@dataclass
class _Prepared:
    """The current block of a record: correction and standard uncertainties of its rows."""

    rows: FloatArray = field(default_factory=lambda: np.zeros((3, 0)))
    used: int = 0
    before: FloatArray = field(default_factory=lambda: np.zeros((3, 0)))
    """Time, reading and its uncertainty in the last rows before the block."""


@dataclass(frozen=True)
class RecordedDynamics(_AppliedDynamics):
    """The filter along a record: every row gets the torque at its own time.

    `prepare` takes the blocks in order, each with the following one; `components` then returns the
    rows of the block, in one or several parts. At the end of the record and before a gap, the
    filter lacks later readings: U of these rows contains the size of their correction.
    """

    prepared: _Prepared

    def prepare(self, readings: Readings, following: Readings | None) -> None:
        """Filter the rows of the next block."""
        if readings.time_s is None:
            return
        count, first = len(readings), self.prepared.before.shape[1]
        blocks = [self.prepared.before, _rows(readings)]
        if following is not None:
            blocks.append(_rows(following)[:, : self.effect.rows_late])
        record = np.concatenate(blocks, axis=1)
        kept = first + count - len(self.effect.weights) + 1
        self.prepared.before = record[:, max(kept, 0) : first + count]
        self.prepared.rows = self._filtered(record)[:, first : first + count]
        self.prepared.used = 0

    def components(self, readings: Readings, torque_nm: Values) -> tuple[Component, ...]:
        """Return the components of the next rows of the block."""
        if readings.time_s is None:
            return ()
        start = self.prepared.used
        self.prepared.used += len(readings)
        added, curve, noise = self.prepared.rows[:, start : self.prepared.used]
        return _components(added, curve, noise)

    def _filtered(self, record: FloatArray) -> FloatArray:
        """Return correction and standard uncertainties of rows that may have gaps and faults."""
        time, reading, _ = record
        step = np.diff(time)
        wanted, faulty = self.effect.interval_s, ~np.isfinite(reading)
        joined = np.abs(step - wanted) <= _UNEVEN * wanted
        joined &= ~(faulty[1:] | faulty[:-1])
        result = np.zeros_like(record)
        for start, stop in pairwise([0, *(np.flatnonzero(~joined) + 1).tolist(), time.size]):
            if stop - start > 1:
                result[:, start:stop] = self._even(record[1:, start:stop])
        alone = np.concatenate([[True], ~joined]) & np.concatenate([~joined, [True]])
        if alone.any() and time.size > 1:
            slope = np.concatenate([[0.0], np.abs(np.diff(reading) / step)])
            widened = self.effect.late_s * slope[alone] / _SQUARE_ROOT_3
            result[1, alone] = np.nan_to_num(widened, posinf=0.0)
        result[0, faulty] = np.nan
        return result

    def _even(self, rows: FloatArray) -> FloatArray:
        """Return correction and uncertainties of rows without a gap; the filter looks ahead."""
        late, count = self.effect.rows_late, rows.shape[1]
        reading, spread = np.pad(rows, ((0, 0), (0, late)), mode="edge")
        filtered = self.effect.filter().stream().push(reading, spread)
        added = filtered.value[late:] - rows[0]
        noise = np.sqrt(np.maximum(filtered.of_noise[late:] ** 2 - rows[1] ** 2, 0.0))
        row = np.arange(count)
        unknown = (row + late < len(self.effect.weights) - 1) | (row + late >= count)
        lacking = np.where(unknown, added / _SQUARE_ROOT_3, 0.0)
        return np.array([added, np.hypot(filtered.of_coefficients[late:], lacking), noise])


def _rows(readings: Readings) -> FloatArray:
    """Return time, reading and its uncertainty by counting."""
    count = len(readings)
    spread = np.broadcast_to(known_or(readings.counter_nm, 0.0), (count,))
    assert readings.time_s is not None
    return np.array([readings.time_s, readings.reading_nm, spread], dtype=np.float64)
