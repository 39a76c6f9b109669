"""Windows over whole turns of a shaft, so that what repeats with a turn averages out."""

from __future__ import annotations

from math import ceil

from torquebench.units import MINUTE

__all__ = ["turn_s", "whole_turns_s"]


def turn_s(speed_rpm: float) -> float:
    """Return the time of one turn at a speed in 1/min, s."""
    return MINUTE / abs(speed_rpm)


def whole_turns_s(shortest_s: float, speed_rpm: float) -> float:
    """Return the time of the whole turns that last at least so long, s.

    Examples
    --------
    >>> whole_turns_s(0.4, -200.0)
    0.6
    """
    period_s = turn_s(speed_rpm)
    return round(period_s * ceil(shortest_s / period_s - 1e-9), 9)
