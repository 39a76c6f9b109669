"""Pulse trains: edges on the counters' clock, from the integrated phase of a frequency."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from torquebench.kernels import inner, kernel

FloatArray = NDArray[np.float64]
TickArray = NDArray[np.int64]


class CounterConstants(NamedTuple):
    """The clock that times all edges.

    Attributes
    ----------
    timebase_error : float
        Relative error of the clock, which has (1 + error) times its nominal ticks in a second.
    jitter_s : float
        Standard deviation of one edge's time.
    """

    timebase_error: float
    jitter_s: float


@inner
def lagged(before: float, start: float, end: float, lag_s: float, step_s: float) -> float:
    """Return the exact response of a first-order lag to a ramp from start to end over one step."""
    trail = (end - start) * lag_s / step_s
    return end - trail + (before - start + trail) * math.exp(-step_s / lag_s)


@kernel
def edges_of_steps(
    cycles_per_tick: FloatArray,
    first_step: int,
    step_ticks: int,
    delay_ticks: float,
    jitter_ticks: float,
    phase: float,
    generator: np.random.Generator,
    ticks: TickArray,
) -> tuple[int, float]:
    """Find the rising edges of a frequency that is linear between the steps' borders.

    Parameters
    ----------
    cycles_per_tick : float64[steps + 1]
        Frequency at the borders.
    first_step : int
        Number of the first step.
    step_ticks : int
        Length of a step.
    delay_ticks : float
        Group delay.
    jitter_ticks : float
        Standard deviation of an edge's time.
    phase : float
        Cycles since the last edge at the first border, in [0, 1).
    generator : numpy.random.Generator
        Source of the jitter.
    ticks : int64[n]
        Written: the edges. Must be long enough.

    Returns
    -------
    count : int
        Number of written edges.
    phase : float
        Cycles since the last edge at the last border.
    """
    count = 0
    for step in range(cycles_per_tick.size - 1):
        start, end = cycles_per_tick[step], cycles_per_tick[step + 1]
        border = float((first_step + step) * step_ticks) + delay_ticks
        total = phase + 0.5 * (start + end) * step_ticks
        slope = (end - start) / step_ticks
        whole = int(total)
        for k in range(1, whole + 1):
            cycles = k - phase
            # the quadratic's root in a form without cancellation at small slopes
            after = 2.0 * cycles / (start + math.sqrt(start * start + 2.0 * slope * cycles))
            after += jitter_ticks * generator.standard_normal()
            ticks[count] = math.floor(border + after)
            count += 1
        phase = total - whole
    return count, phase


class EdgeSource:
    """Source of one channel's edges across blocks: phase, jitter, and undelivered edges.

    Parameters
    ----------
    generator : numpy.random.Generator
        Source of the jitter; belongs to this channel alone.
    timebase_hz : float
        Nominal ticks per second.
    step_ticks : int
        Ticks of one step.
    counter : CounterConstants
        Error and jitter of the clock.
    delay_s : float
        Delay of the edges against the frequency.
    """

    def __init__(
        self,
        generator: np.random.Generator,
        timebase_hz: float,
        step_ticks: int,
        counter: CounterConstants,
        delay_s: float,
    ) -> None:
        self._generator = generator
        self._step_ticks = step_ticks
        self._scale = 1.0 / (timebase_hz * (1.0 + counter.timebase_error))
        self._jitter_ticks = counter.jitter_s * timebase_hz
        self._delay_ticks = delay_s * timebase_hz
        self._phase = 0.0
        self._room: TickArray = np.empty(0, dtype=np.int64)
        self._waiting = 0  # undelivered edges at the beginning of the buffer
        self._delivered = 0

    def run(self, first_step: int, frequency_hz: FloatArray) -> None:
        """Generate the edges of the steps between the given border frequencies."""
        cycles = np.maximum(frequency_hz, 1.0) * self._scale
        most = self._waiting + int(np.add.reduce(cycles) * self._step_ticks) + 8
        if most > self._room.size:
            room = np.empty(2 * most, dtype=np.int64)
            room[: self._waiting] = self._room[: self._waiting]
            self._room = room
        count, self._phase = edges_of_steps(
            cycles,
            first_step,
            self._step_ticks,
            self._delay_ticks,
            self._jitter_ticks,
            self._phase,
            self._generator,
            self._room[self._waiting :],
        )
        self._waiting += count

    def take(self, stop_tick: int) -> tuple[TickArray, int]:
        """Return the edges before a tick, and the running number of the first of them."""
        split = int(self._room[: self._waiting].searchsorted(stop_tick))
        taken = self._room[:split].copy()
        self._waiting -= split
        self._room[: self._waiting] = self._room[split : split + self._waiting].copy()
        number = self._delivered
        self._delivered += split
        return taken, number

    def forget(self) -> None:
        """Drop undelivered edges: the channel was unused, and their time has passed."""
        self._waiting = 0

    def begin(self, frequency_hz: float) -> None:
        """Start as if the channel had always run, so that the first block has no gap."""
        self.run(-1, np.array([frequency_hz, frequency_hz]))
        self.take(0)
        self._delivered = 0
