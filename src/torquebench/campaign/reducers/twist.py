"""The bench's own twist, measured against the locked calibrator and subtracted from loops."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.bench.roles import Side
from torquebench.message import Message
from torquebench.procedures.reducers.loop import BenchTwistRecording
from torquebench.reducers.preparation import turning_points

FloatArray = NDArray[np.float64]

TWIST_LEVELS = 40
"""Number of torque levels on each side of zero, between which the twist is interpolated
linearly."""


@dataclass(frozen=True)
class TwistCompliance:
    """Twist of the bench between an encoder and the flange beside it.

    The twist is nonlinear over the torque, because bearings and splines carry a part of the torque.

    Parameters
    ----------
    rad_per_nm : float
        Slope over the whole range of torque.
    source : str
        Origin of the values, for the record.
    level_nm, bend_rad : tuple of float
        Torques, increasing, and the twist's deviation from the straight line there; none if only a
        slope is known.

    Examples
    --------
    >>> bent = TwistCompliance(1e-6, level_nm=(-100.0, 0.0, 100.0), bend_rad=(0.0, 0.0, 2e-6))
    >>> bent.at([-100.0, 50.0, 100.0]).round(9).tolist()
    [-0.0001, 5.1e-05, 0.000102]
    """

    rad_per_nm: float = 0.0
    standard_uncertainty_rad_per_nm: float = 0.0
    source: str = ""
    level_nm: tuple[float, ...] = ()
    bend_rad: tuple[float, ...] = ()

    def at(self, torque_nm: ArrayLike) -> FloatArray:
        """Return the twist at torques, rad; beyond the levels it continues with the slope."""
        torque = np.asarray(torque_nm, dtype=np.float64)
        straight = self.rad_per_nm * torque
        if not self.level_nm:
            return np.asarray(straight)
        return np.asarray(straight + np.interp(torque, self.level_nm, self.bend_rad))


def twist_compliances(recording: BenchTwistRecording) -> dict[Side, TwistCompliance]:
    """Return the twist of every side that was loaded against the held calibrator."""
    source = Message("measured against {serial}", recording.standard_serial)
    return {
        side: twist_compliance(recorded.torque_nm(side), recorded.angle_rad(side), source)
        for side, recorded in recording.recordings.items()
    }


def twist_compliance(torque_nm: FloatArray, angle_rad: FloatArray, source: str) -> TwistCompliance:
    """Return a side's twist from cycles 0 → +T → −T → 0 against the held calibrator.

    It consists of the least-squares slope of angle over torque, and of the mean deviation from it
    at levels of torque. Rising and falling legs have equal weights, so that the shaft's hysteresis
    cancels. The uncertainty is half the difference of the legs, for the slope and at each level.

    Parameters
    ----------
    torque_nm, angle_rad : array of float, shape (n,)
        In the order of measurement.
    source : str
        Source of the values.
    """
    slope, offset = (float(coefficient) for coefficient in np.polyfit(torque_nm, angle_rad, 1))
    largest = float(np.max(np.abs(torque_nm)))
    rising = _rising(torque_nm)
    singles = [
        float(np.polyfit(torque_nm[leg], angle_rad[leg], 1)[0])
        for leg in (rising, ~rising)
        if np.count_nonzero(leg) > 8
    ]
    spread = float(np.ptp(singles)) / np.sqrt(12.0) if len(singles) == 2 else 0.05 * abs(slope)
    off_line = angle_rad - slope * torque_nm - offset
    level = np.round(torque_nm / largest * TWIST_LEVELS).astype(np.int64) + TWIST_LEVELS
    count = np.bincount(level)
    there = count > 0
    torque = np.bincount(level, weights=torque_nm)[there] / count[there]
    bend = np.bincount(level, weights=off_line)[there] / count[there]
    residual = off_line - np.interp(torque_nm, torque, bend)
    lag = np.bincount(level, weights=np.where(rising, residual, -residual))[there] / count[there]
    spread = float(np.hypot(spread, lag.std() / (0.5 * largest)))
    return TwistCompliance(slope, spread, source, tuple(torque.tolist()), tuple(bend.tolist()))


def _rising(torque_nm: FloatArray) -> NDArray[np.bool_]:
    """Return which samples belong to legs of rising torque, unaffected by noise."""
    rising = np.zeros(torque_nm.size, dtype=np.bool_)
    for start, stop in pairwise(turning_points(torque_nm).tolist()):
        rising[start : stop + 1] = torque_nm[stop] > torque_nm[start]
    return rising
