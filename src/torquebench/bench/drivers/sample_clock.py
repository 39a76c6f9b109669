"""Bench times for samples of an instrument with a clock of its own, known by when they arrive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["SampleClock"]

LARGEST_DRIFT = 2e-4
"""By which the instrument's clock may differ from the counter's, relative."""


class SampleClock:
    """Spreads samples evenly, a period apart, by the quickest answer that there was.

    A question is asked when the counter's block has come, so an answer is never older than the
    block's end; on a busy computer it is younger by as much as the computer is behind. The answer
    that was least behind tells best how the two clocks lie, and holds until they may have drifted.

    Parameters
    ----------
    period_s : float

    Examples
    --------
    >>> clock = SampleClock(0.01)
    >>> clock.times(2, until_s=1.0).round(3).tolist()
    [0.985, 0.995]
    >>> clock.times(3, until_s=1.022).round(3).tolist()  # asked late, so it brings more
    [1.005, 1.015, 1.025]
    >>> clock.times(1, until_s=1.04).round(3).tolist()
    [1.035]
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._next_s: float | None = None

    def times(self, count: int, until_s: float, lost: int = 0) -> NDArray[np.float64]:
        """Return the times of the next samples.

        Parameters
        ----------
        count : int
            How many came.
        until_s : float
            End of the block for which they were asked, bench time.
        lost : int
            How many the instrument has lost before them, where it tells.
        """
        if count == 0:
            return np.empty(0)
        period_s = self._period_s
        first_s = until_s - (count - 0.5) * period_s
        if self._next_s is not None:
            expected_s = self._next_s + lost * period_s
            first_s = max(first_s, expected_s - LARGEST_DRIFT * count * period_s)
        self._next_s = first_s + count * period_s
        return first_s + period_s * np.arange(count, dtype=np.float64)
