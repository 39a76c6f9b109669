"""Counters over any windows of a train of edges."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.signals import _kernels
from torquebench.signals.edges import as_ticks
from torquebench.signals.faults import SignalFaultKind
from torquebench.signals.pulse_train import Irregularities, irregularities
from torquebench.signals.samples import FrequencySamples

__all__ = ["CounterMethod", "WindowCounter", "count_windows"]

CounterMethod = Literal["gated", "reciprocal", "regression", "triangular"]
Ticks = NDArray[np.int64]

_NUMBERS: dict[str, int] = {
    "gated": _kernels.GATED,
    "reciprocal": _kernels.RECIPROCAL,
    "regression": _kernels.REGRESSION,
    "triangular": _kernels.TRIANGULAR,
}
# Edges² x ticks of a window: a regression's sum is a sixth of it from each of two trains at
# most, and must stay below 2^63.
_LARGEST_SUM = 2.0**64


class WindowCounter:
    """One counter with its settings, to run over windows of one or two trains of edges.

    An edge's time has the variance σ_t² = σ_j² + T_c²/12 of its jitter and of the timebase's
    quantisation. From it follow the standard uncertainties, exact for n edges (n(n²−1) instead
    of n³): gated 1/(√6 τ), reciprocal √2 f σ_t/τ, regression √12 f σ_t/(τ√n) (E. Rubiola,
    M. Lenczner, P.-Y. Bourgeois, F. Vernotte, The Ω counter, arXiv:1506.05009), triangular
    4 f σ_t/(τ√n).

    They hold where the quantisation errors of successive edges are independent: with jitter
    of about a third of a tick or more, or a period that isn't near a small fraction of ticks.
    A period within about 1/n² of a tick of such a fraction, without any jitter, can be several
    times worse, but never worse than 1.5·T_c/τ relative.

    Parameters
    ----------
    method : {"gated", "reciprocal", "regression", "triangular"}
        The counter.
    timebase_hz : float
        Timebase in Hz.
    edge_jitter_s : float
        Standard deviation σ_j of the edges' own time noise in seconds.
    check_train : bool
        Look for missing and doubled pulses.

    Raises
    ------
    InputError
        When a parameter is outside its range.
    """

    def __init__(
        self,
        method: CounterMethod,
        timebase_hz: float,
        *,
        edge_jitter_s: float = 0.0,
        check_train: bool = True,
    ) -> None:
        if method not in _NUMBERS:
            raise InputError(Message("counter {method!r}", method), ", ".join(_NUMBERS))
        if not (timebase_hz > 0 and np.isfinite(timebase_hz)):
            raise InputError(
                Message("timebase {timebase_hz} Hz", timebase_hz), "a frequency above 0 Hz"
            )
        if not (edge_jitter_s >= 0 and np.isfinite(edge_jitter_s)):
            raise InputError(Message("edge jitter {edge_jitter_s} s", edge_jitter_s), "0 s or more")
        self.method: CounterMethod = method
        self.timebase_hz = float(timebase_hz)
        self.check_train = check_train
        self._number = _NUMBERS[method]
        self._edge_noise = float(np.sqrt((edge_jitter_s * timebase_hz) ** 2 + 1 / 12))

    def room(self, windows: int) -> FrequencySamples:
        """Make room for the samples of so many windows."""
        return FrequencySamples(
            time_s=np.empty(windows),
            fault=np.empty(windows, dtype=np.uint8),
            frequency_hz=np.empty(windows),
            edges=np.empty(windows, dtype=np.int64),
            standard_uncertainty_hz=np.empty(windows),
            missing=np.zeros(windows, dtype=np.int32),
            doubled=np.zeros(windows, dtype=np.int32),
        )

    def fill(
        self,
        samples: FrequencySamples,
        places: slice,
        trains: Sequence[Ticks],
        starts: Ticks,
        stops: Ticks,
    ) -> None:
        """Count windows of one or two trains into these places of the samples.

        Parameters
        ----------
        samples : FrequencySamples
            Room from `room`.
        places : slice
            Where the windows go.
        trains : sequence of int64 arrays
            Rising edges, and falling ones if they are to be used. Each keeps its own phase, so the
            duty cycle needn't be a half.
        starts, stops : int64 arrays, shape (n,)
            The windows.

        Raises
        ------
        InputError
            When edges don't increase, or a regression window is too long for 64-bit sums.
        """
        suspects = self._run(samples, places, trains, starts, stops, self.check_train)
        if not suspects:
            return
        fault = samples.fault[places]
        for window in np.flatnonzero(fault == _kernels.SUSPECT).tolist():
            one = slice(window, window + 1)
            place = slice(places.start + window, places.start + window + 1)
            found = [_inspected(ticks, starts[window], stops[window]) for ticks in trains]
            samples.missing[place] = sum(train.missing for train in found)
            samples.doubled[place] = sum(train.doubled for train in found)
            if any(train.missing or train.stopped for train in found):
                samples.fault[place] = SignalFaultKind.MISSING_PULSES
            elif any(train.doubled for train in found):
                samples.fault[place] = SignalFaultKind.DOUBLED_PULSES
            else:
                self._run(samples, place, trains, starts[one], stops[one], check=False)

    def _run(
        self,
        samples: FrequencySamples,
        places: slice,
        trains: Sequence[Ticks],
        starts: Ticks,
        stops: Ticks,
        check: bool,
    ) -> int:
        wrong, falls, suspects, largest = _kernels.count(
            trains[0],
            trains[-1],
            len(trains) > 1,
            starts,
            stops,
            self._number,
            check,
            self.timebase_hz,
            self._edge_noise,
            samples.time_s[places],
            samples.frequency_hz[places],
            samples.standard_uncertainty_hz[places],
            samples.edges[places],
            samples.fault[places],
        )
        if wrong >= 0:
            ticks = trains[-1] if falls else trains[0]
            raise InputError(
                Message(
                    "edge at tick {tick} after one at {before}", ticks[wrong], ticks[wrong - 1]
                ),
                "strictly increasing edges",
            )
        if self.method == "regression" and largest >= _LARGEST_SUM:
            raise InputError(
                Message("regression whose edges² x ticks are {largest:.3g}", largest),
                Message("below {high:.3g}", _LARGEST_SUM),
                "use shorter windows and average them",
            )
        return int(suspects)


def count_windows(
    ticks: ArrayLike,
    starts: ArrayLike,
    stops: ArrayLike,
    method: CounterMethod = "regression",
    *,
    timebase_hz: float,
    falling_ticks: ArrayLike | None = None,
    edge_jitter_s: float = 0.0,
    check_train: bool = True,
) -> FrequencySamples:
    """Run a counter over any windows of a recorded train of edges.

    Parameters
    ----------
    ticks : array_like of int, shape (m,)
        Edges, strictly increasing.
    starts, stops : array_like of int, shape (n,)
        Half-open windows [start, stop) in ticks; neither may decrease. They may overlap
        (sliding windows), touch, or leave gaps.
    method : {"gated", "reciprocal", "regression", "triangular"}
        The counter.
    timebase_hz : float
        Timebase in Hz.
    falling_ticks : array_like of int, optional
        Falling edges, to be used as well.
    edge_jitter_s : float
        Standard deviation of the edges' own time noise in seconds; see `WindowCounter`.
    check_train : bool
        Look for missing and doubled pulses. Switch it off for trains whose frequency may jump
        by more than a half from one pulse to the next, such as a starting encoder.

    Raises
    ------
    InputError
        When edges don't increase, windows decrease, or a regression window is too long for
        64-bit sums.

    Examples
    --------
    >>> edges = np.arange(0, 100_000, 1600)
    >>> samples = count_windows(edges, [0, 50_000], [50_000, 100_000], timebase_hz=100e6)
    >>> samples.edges, samples.frequency_hz
    (array([32, 31]), array([62500., 62500.]))
    """
    first = as_ticks(starts, "starts")
    last = as_ticks(stops, "stops")
    if first.shape != last.shape:
        raise InputError(
            Message("{size} starts and {last_size} stops", first.size, last.size), "as many of each"
        )
    if np.any(np.diff(first) < 0) or np.any(np.diff(last) < 0) or np.any(last <= first):
        raise InputError("windows that decrease or are empty", "ordered windows, start < stop")
    counter = WindowCounter(
        method, timebase_hz, edge_jitter_s=edge_jitter_s, check_train=check_train
    )
    trains = [as_ticks(ticks)]
    if falling_ticks is not None:
        trains.append(as_ticks(falling_ticks, "falling_ticks"))
    samples = counter.room(first.size)
    counter.fill(samples, slice(0, first.size), trains, first, last)
    return samples


def _inspected(ticks: Ticks, start: int, stop: int) -> Irregularities:
    """Inspect one window of a train, with the edge before it."""
    first, last = ticks.searchsorted((start, stop))
    return irregularities(ticks[max(first - 1, 0) : last], int(stop))
