"""Irregular pulse trains: missing and doubled pulses."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Irregularities", "irregularities"]

# Shares of the period: an interval above the first lacks pulses, an edge nearer than the second
# to the one before it is a doubled one. A pulse that splits a period splits off one part below.
_LONG = 1.5
_SHORT = 0.6
# Quantile of the intervals that is taken as the period: above the median, so that a train in which
# every pulse is doubled still shows its long intervals.
_PERIOD_QUANTILE = 0.7


class Irregularities(NamedTuple):
    """Pulses that are missing from, or doubled in, a stretch of a train.

    Parameters
    ----------
    missing, doubled : int
        How many.
    stopped : bool
        True when the train had stopped before the stretch ended.
    """

    missing: int
    doubled: int
    stopped: bool


def irregularities(ticks: NDArray[np.int64], stop_tick: int | None = None) -> Irregularities:
    """Count missing and doubled pulses of a train of nearly constant frequency.

    Parameters
    ----------
    ticks : int64 array, shape (n,)
        Edges, increasing.
    stop_tick : int, optional
        End of the stretch, to see whether the train stopped before it.

    Returns
    -------
    Irregularities
        Zero and False for a train with fewer than two edges.

    Examples
    --------
    >>> irregularities(np.array([0, 100, 200, 400, 500, 510, 600, 700]))
    Irregularities(missing=1, doubled=1, stopped=False)
    """
    intervals = np.diff(ticks)
    if not intervals.size:
        return Irregularities(0, 0, False)
    period = np.sort(intervals)[int(_PERIOD_QUANTILE * intervals.size)]
    doubled = 0
    if intervals.min() < _SHORT * period:
        kept = [int(ticks[0])]
        for tick in ticks[1:].tolist():
            if tick - kept[-1] < _SHORT * period:
                doubled += 1
            else:
                kept.append(tick)
        intervals = np.diff(kept)
    long = intervals[intervals > _LONG * period]
    missing = int(np.sum(np.rint(long / period).astype(np.int64) - 1))
    stopped = stop_tick is not None and bool(stop_tick - ticks[-1] > _LONG * period)
    return Irregularities(missing, doubled, stopped)
