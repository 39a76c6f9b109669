"""Dynamics: response of shaft, transducer and counter to a torque that changes quickly."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, ClassVar, Self

import numpy as np

from torquebench.chain.effect import Effect, register
from torquebench.chain.readings import FloatArray, Readings, known_or
from torquebench.chain.torque import Component, Shared
from torquebench.dynamics import FilterStream, InverseFilter, UncertainFilter
from torquebench.errors import InputError
from torquebench.uncertainty import Distribution

__all__ = ["Dynamics"]

_UNEVEN = 0.05  # of the sample interval
_SQUARE_ROOT_3 = 3.0**0.5


@register("dynamics")
@dataclass(frozen=True)
class Dynamics(Effect):
    """The inverse of an identified transfer function, as a filter along the stream.

    It works on readings at the rate that it was designed for. Its output is later than the torque
    by `delay_s`. Readings at another rate aren't corrected, and the chain's delay enters as an
    uncertainty that grows with the rate of change; readings without a time are treated as steady.

    Parameters
    ----------
    interval_s : float
        Sample interval that the filter holds for.
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
        """Return the effect of a designed filter."""
        return cls(
            record,
            designed.interval_s,
            tuple(designed.filter.numerator.tolist()),
            tuple(map(tuple, designed.filter.factors.tolist())),
            designed.delay_s,
            designed.transfer.group_delay_s,
        )

    @classmethod
    def from_specification(cls, values: Mapping[str, Any]) -> Self:
        """Return the effect that `specification` described."""
        listed = dict(values)
        try:
            listed["weights"] = tuple(map(float, listed["weights"]))
            listed["factors"] = tuple(tuple(map(float, row)) for row in listed["factors"])
        except (KeyError, ValueError) as problem:
            raise InputError(
                f"{cls.title}: no coefficients ({problem})", "lists of numbers"
            ) from problem
        return cls(**listed)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.filter()

    def filter(self) -> UncertainFilter:
        """Return the filter; raises `InputError` if the coefficients don't form one."""
        rows = np.asarray(self.factors, np.float64).reshape(-1, len(self.weights))
        return UncertainFilter(np.asarray(self.weights), covariance=rows.T @ rows)

    def check_rate(self, time_s: FloatArray | None) -> None:
        """Refuse rows that aren't at the filter's rate."""
        if time_s is None or time_s.size < 2:
            found = "readings at uneven times"
        else:
            step = float(np.median(np.diff(time_s)))
            if abs(step - self.interval_s) <= _UNEVEN * self.interval_s:
                return
            found = f"readings every {step:.6g} s"
        raise InputError(
            f"{found}, dynamics identified at {self.interval_s:.6g} s",
            "a column time_s at that rate",
            "identify the dynamics at the rate of the readings",
        )

    def components(self, readings: Readings, torque_nm: FloatArray) -> tuple[Component, ...]:
        """Return the components of rows that are a stream by themselves."""
        return self.stream().components(readings, torque_nm)

    def stream(self) -> Effect:
        """Return a filter for one stream."""
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
        self.filtering.forget()
        self.settling = 0
        self.last_s = self.last_nm = float("nan")


@dataclass(frozen=True)
class _FollowedDynamics(Effect):
    """The filter along one stream."""

    title: ClassVar[str] = Dynamics.title
    corrects_reading: ClassVar[bool] = True
    effect: Dynamics
    memory: _Memory

    @property
    def kind(self) -> str:  # type: ignore[override] # a stream stands in the place of its effect
        return self.effect.kind

    def copy(self) -> Effect:
        return _FollowedDynamics(self.record, self.effect, self.memory.copy())

    def forget(self) -> None:
        self.memory.forget()

    def components(self, readings: Readings, torque_nm: FloatArray) -> tuple[Component, ...]:
        time = readings.time_s
        if time is None:
            return ()
        count = torque_nm.size
        added, curve, noise = np.zeros((3, count))
        if count:
            step = np.empty(count)
            step[0], step[1:] = time[0] - self.memory.last_s, time[1:] - time[:-1]
            wanted = self.effect.interval_s
            even = np.abs(step - wanted) <= _UNEVEN * wanted
            if not np.isfinite(step[0]):  # the first reading of a stream has no predecessor
                even[0] = count == 1 or even[1]
            if even.any():
                spread = known_or(readings.counter_nm, 0.0)
                spread = spread if spread.shape else np.full(count, spread)
                cuts = [0, *(np.flatnonzero(~even[1:]) + 1).tolist(), count]
                for start, stop in pairwise(cuts):
                    if not even[start]:
                        self.memory.forget()
                    part = slice(start, stop)
                    self._filter(
                        torque_nm[part], spread[part], added[part], curve[part], noise[part]
                    )
            else:
                earlier = np.concatenate([[self.memory.last_nm], torque_nm[:-1]])
                with np.errstate(invalid="ignore", divide="ignore"):
                    slope = np.abs((torque_nm - earlier) / step)
                curve[:] = np.nan_to_num(self.effect.late_s * slope / _SQUARE_ROOT_3, posinf=0.0)
                self.memory.filtering.forget()
                self.memory.settling = 0
            self.memory.last_s, self.memory.last_nm = float(time[-1]), float(torque_nm[-1])
        return (
            Component(
                "dynamics", Shared.LOADING, curve, added, distribution=Distribution.RECTANGULAR
            ),
            Component("noise of the dynamic filter", Shared.NOTHING, noise),
        )

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
        found = self.memory.filtering.push(reading_nm, np.where(faulty, 0.0, counter_nm))
        added[:] = found.value - reading_nm
        curve[:] = found.of_coefficients
        noise[:] = np.sqrt(np.maximum(found.of_noise**2 - counter_nm**2, 0.0))
        # readings before the first one are unknown, and so is the filter's output
        if self.memory.settling >= len(self.effect.weights) - 1 and not faulty.any():
            self.memory.settling += reading_nm.size
            return
        place = np.arange(reading_nm.size)
        last = np.maximum.accumulate(np.where(faulty, place, -1 - self.memory.settling))
        since = place - last - 1
        unsettled = since < len(self.effect.weights) - 1
        curve[:] = np.hypot(curve, np.where(unsettled, added / _SQUARE_ROOT_3, 0.0))
        self.memory.settling = int(since[-1]) + 1
