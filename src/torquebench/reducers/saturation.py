"""Drives that don't reach the requested torque or speed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from torquebench.message import Message
from torquebench.reducers.quantities import Finding

Floats = NDArray[np.float64]
PLATEAU = 0.25
"""A drive saturates if more than this share of a record is within 2 % of the largest torque."""
MISSED = 0.05
"""Relative deviation from the set point from which on a drive counts as saturated."""


def torque_saturation(torque: Floats, demanded: Floats | None) -> list[Finding]:
    """Return a finding where the drive doesn't follow its set points."""
    largest = float(np.quantile(np.abs(torque), 0.99))
    if demanded is not None:
        wanted = float(np.max(np.abs(demanded)))
        high = np.abs(demanded) > 0.5 * wanted
        missed = high & (np.abs(torque) < (1.0 - MISSED) * np.abs(demanded))
        if wanted > (1.0 + 2.0 * MISSED) * largest and missed.sum() > 0.05 * high.sum():
            return [_saturated(largest, Message("{wanted:.4g} N·m were requested", wanted), missed)]
        return []
    plateau = np.abs(torque) > 0.95 * largest
    if np.mean(plateau) > PLATEAU:
        return [_saturated(largest, "the torque stays there", plateau)]
    return []


def _saturated(largest: float, asked: str, rows: NDArray[np.bool_]) -> Finding:
    """Return the finding that torque stops below what was demanded."""
    return Finding(
        "drive saturation",
        Message(
            "the torque stops near ±{largest:.3g} N·m, {asked} ({mean:.0f} % of the samples)",
            largest,
            asked,
            100 * np.mean(rows),
        ),
        "only measured torques are used: lower the demanded torque, or use a larger drive",
    )


def missed_speed(speed_rpm: Floats, demanded_rpm: Floats) -> tuple[Finding, ...]:
    """Report requested speeds that weren't reached, as by a drive at its torque limit.

    Parameters
    ----------
    speed_rpm, demanded_rpm : float64 array of shape (n,)
        Measured and commanded speed of each point, rpm.

    Examples
    --------
    >>> missed_speed(np.array([100.0, 880.0]), np.array([100.0, 1000.0]))[0].name
    'drive saturation'
    """
    missed = np.abs(speed_rpm) < (1.0 - MISSED) * np.abs(demanded_rpm)
    if not np.any(missed):
        return ()
    worst = int(np.argmax(np.abs(demanded_rpm) - np.abs(speed_rpm)))
    return (
        Finding(
            "drive saturation",
            Message(
                "{demanded_rpm:.4g} rpm were requested and {speed_rpm:.4g} rpm reached "
                "({count} of {size} points)",
                demanded_rpm[worst],
                speed_rpm[worst],
                np.count_nonzero(missed),
                missed.size,
            ),
            "points count at the speed that was reached: lower the speed, or use a larger drive",
        ),
    )
