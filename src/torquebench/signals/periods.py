"""Inputs that are already counted: periods, and frequency samples."""

import numpy as np
from numpy.typing import ArrayLike

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.signals._kernels import mark_repeats
from torquebench.signals.edges import EdgeBlock, as_ticks
from torquebench.signals.faults import SignalFaultKind
from torquebench.signals.samples import FrequencySamples

__all__ = ["FrequencyInput", "edges_of_periods"]


def edges_of_periods(period_ticks: ArrayLike, timebase_hz: float, start_tick: int = 0) -> EdgeBlock:
    """Edges of a counter that delivers the number of ticks from each edge to the next.

    Parameters
    ----------
    period_ticks : array_like of int, shape (n,)
        Periods in ticks, each 1 or more.
    timebase_hz : float
        Timebase in Hz.
    start_tick : int
        Tick of the edge that the first period began with; for the next part of a stream, the
        last edge of this one.

    Returns
    -------
    EdgeBlock
        The n edges that end the periods; it covers (start_tick, last edge].

    Raises
    ------
    InputError
        When a period isn't a positive integer.

    Examples
    --------
    >>> block = edges_of_periods([1600, 1601, 1599], 100e6, start_tick=50)
    >>> block.ticks, block.start_tick, block.stop_tick
    (array([1650, 3251, 4850]), 51, 4851)
    """
    periods = as_ticks(period_ticks, "period_ticks")
    wrong = np.flatnonzero(periods < 1)
    if wrong.size:
        raise InputError(
            Message("period_ticks[{wrong}] = {periods}", wrong[0], periods[wrong[0]]),
            "1 tick or more",
            "an overflowed or missing period is a fault of the counter",
        )
    ticks = start_tick + np.cumsum(periods)
    stop = int(ticks[-1]) if ticks.size else start_tick
    return EdgeBlock(ticks, start_tick + 1, stop + 1, timebase_hz)


class FrequencyInput:
    """Stream of a counter that delivers frequencies: marks invalid values as faults.

    Parameters
    ----------
    standard_uncertainty_hz : float
        Standard uncertainty of one sample by the counter's data sheet, in Hz.
    stuck_windows : int or None
        So many samples in a row with the same number are a stuck counter. None switches the
        check off, as for a counter whose resolution is coarser than the signal's noise.

    Examples
    --------
    >>> stream = FrequencyInput(0.01, stuck_windows=3)
    >>> stream.push([0.01, 0.02, 0.03], [60e3, 60e3, 0.0]).fault
    array([0, 0, 1], dtype=uint8)
    """

    def __init__(self, standard_uncertainty_hz: float, *, stuck_windows: int | None = 25) -> None:
        if not standard_uncertainty_hz >= 0:
            raise InputError(
                Message("uncertainty {standard_uncertainty_hz} Hz", standard_uncertainty_hz),
                "0 Hz or more",
            )
        self.standard_uncertainty_hz = float(standard_uncertainty_hz)
        self._stuck_windows = stuck_windows
        self._last = np.nan
        self._repeats = 0

    def push(self, time_s: ArrayLike, frequency_hz: ArrayLike) -> FrequencySamples:
        """Take the next samples.

        Parameters
        ----------
        time_s : array_like, shape (n,)
            Centres of the counter's windows in seconds.
        frequency_hz : array_like, shape (n,)
            Frequencies in Hz; 0, negative or not finite means no pulses.

        Raises
        ------
        InputError
            When the two aren't rows of the same length.
        """
        time = np.asarray(time_s, dtype=np.float64)
        frequency = np.array(frequency_hz, dtype=np.float64)
        if time.ndim != 1 or time.shape != frequency.shape:
            raise InputError(
                Message(
                    "times {shape} and frequencies {frequency_shape}", time.shape, frequency.shape
                ),
                "two equal rows",
            )
        silent = ~(np.isfinite(frequency) & (frequency > 0))
        fault = np.where(silent, np.uint8(SignalFaultKind.NO_PULSES), np.uint8(0))
        frequency[silent] = np.nan
        if self._stuck_windows is not None:
            self._last, self._repeats, _ = mark_repeats(
                frequency,
                fault,
                self._stuck_windows,
                int(SignalFaultKind.STUCK),
                self._last,
                self._repeats,
            )
        faulty = fault != 0
        return FrequencySamples(
            time_s=time,
            fault=fault,
            frequency_hz=np.where(faulty, np.nan, frequency),
            edges=np.zeros(time.size, dtype=np.int64),
            standard_uncertainty_hz=np.where(faulty, np.nan, self.standard_uncertainty_hz),
            missing=np.zeros(time.size, dtype=np.int32),
            doubled=np.zeros(time.size, dtype=np.int32),
        )
