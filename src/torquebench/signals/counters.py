"""Counters on streams: edge times in, frequency per window out."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from torquebench.signals.edges import EdgeBlock
from torquebench.signals.samples import FrequencySamples

__all__ = ["CounterMethod", "FrequencyCounter", "gated", "reciprocal", "regression", "triangular"]

CounterMethod = Literal["gated", "reciprocal", "regression", "triangular"]


class FrequencyCounter:
    """Counter on a stream of edge blocks, with its state carried over block borders exactly.

    Windows lie on a fixed grid of the timebase: window k covers the ticks
    [k·step, k·step + window), so all channels of one timebase share their windows, and a stream
    cut anywhere gives the same samples to the last bit.

    Parameters
    ----------
    method : {"gated", "reciprocal", "regression", "triangular"}
        Counter: edges per gate; first to last edge (Π); least-squares slope (Ω); difference of
        the mean times of the window's two halves (Λ).
    window_s : float
        Length of a window in seconds, rounded to whole ticks.
    timebase_hz : float
        Frequency of the timebase in Hz; each block must have the same.
    edge_jitter_s : float
        Standard deviation of the edges' own time noise in seconds, for the uncertainty.
    step_s : float, optional
        Distance of the windows in seconds; shorter than the window they slide. The window's
        length when not given.
    both_edges : bool
        Use rising and falling edges, whatever the duty cycle.
    stuck_windows : int, optional
        So many windows in a row with the same number to the last bit are a stuck counter: real
        edges have jitter. None switches the check off.

    Raises
    ------
    InputError
        When a parameter is outside its range.
    """

    def __init__(
        self,
        method: CounterMethod,
        window_s: float,
        timebase_hz: float,
        *,
        edge_jitter_s: float = 0.0,
        step_s: float | None = None,
        both_edges: bool = False,
        stuck_windows: int | None = 25,
    ) -> None: ...

    def push(self, block: EdgeBlock) -> FrequencySamples:
        """Take the next block; return the samples of all windows that it completes.

        A block that doesn't start where the one before it stopped is a gap: the windows that
        touch the gap carry the fault LOST_DATA. A block that starts earlier is refused.

        Parameters
        ----------
        block : EdgeBlock
            The next edges of the stream.

        Raises
        ------
        InputError
            When the block has another timebase, overlaps the stream, or isn't increasing.
        """
        raise NotImplementedError


def gated(
    blocks: EdgeBlock | Sequence[EdgeBlock], window_s: float, **options: float
) -> FrequencySamples:
    """Frequency by counting edges per gate: n/τ, quantised to 1/τ."""
    raise NotImplementedError


def reciprocal(
    blocks: EdgeBlock | Sequence[EdgeBlock], window_s: float, **options: float
) -> FrequencySamples:
    """Frequency by the time from the first to the last edge of a window (Π counter)."""
    raise NotImplementedError


def regression(
    blocks: EdgeBlock | Sequence[EdgeBlock], window_s: float, **options: float
) -> FrequencySamples:
    """Frequency by least squares through all edges of a window (Ω counter)."""
    raise NotImplementedError


def triangular(
    blocks: EdgeBlock | Sequence[EdgeBlock], window_s: float, **options: float
) -> FrequencySamples:
    """Frequency by the mean times of a window's two halves (Λ counter)."""
    raise NotImplementedError


_ = np
