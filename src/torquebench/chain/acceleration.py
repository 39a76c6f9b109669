"""Angular acceleration from a speed that is sampled at an even rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from torquebench.chain.readings import FloatArray
from torquebench.units import RAD_S_PER_RPM

_WANTED_RAD_S2 = 0.3
"""Largest standard uncertainty caused by noise of the speed, rad/s²: 1 % of a ramp of 300 rpm/s."""
_LONGEST_S = 0.25
LEARNED = 4096
"""Number of first samples of a record from which noise and step are estimated, however it is
cut."""
_GAP_STEPS = 1.5
_MEDIAN_OF_SQUARES = 0.4549
# variance of the third difference of white noise, as a multiple of the noise's
_THIRD_DIFFERENCE = 20.0


@dataclass(frozen=True)
class AccelerationBySpeed:
    """Angular acceleration: slope of the speed over as few samples as its noise allows.

    Parameters
    ----------
    half_width : int
        Samples on either side of the one that the slope is taken at.
    noise_rpm : float
        Standard deviation of a sample.
    step_s : float
        Time from one sample to the next, s.

    Examples
    --------
    >>> time_s = 0.01 * np.arange(200)
    >>> speed = 3.0 * (time_s - 1.0).clip(0.0) / RAD_S_PER_RPM
    >>> by_speed = AccelerationBySpeed.of(time_s, speed)
    >>> acceleration, uncertainty = by_speed(time_s, speed)
    >>> by_speed.half_width, acceleration[[50, 150]].round(9).tolist()
    (1, [0.0, 3.0])
    >>> bool(uncertainty[100] > 0.5), bool(uncertainty[150] < 1e-6)  # where the ramp begins
    (True, True)
    """

    half_width: int = 1
    noise_rpm: float = 0.0
    step_s: float = 1.0

    @classmethod
    def of(cls, time_s: FloatArray, speed_rpm: FloatArray) -> AccelerationBySpeed:
        """Choose the smallest number of samples with which a record's noise is low enough.

        Parameters
        ----------
        time_s, speed_rpm : float64 array of shape (n,)
        """
        time_s, speed_rpm = time_s[:LEARNED], speed_rpm[:LEARNED]
        if speed_rpm.size < 5:
            return cls()
        third = np.diff(speed_rpm, 3)
        noise = float(np.sqrt(np.median(third**2) / _MEDIAN_OF_SQUARES / _THIRD_DIFFERENCE))
        step_s = float(np.median(np.diff(time_s)))
        if not step_s > 0.0:
            return cls(1, noise)
        widest = max(int(_LONGEST_S / step_s), 1)
        for half_width in range(1, widest):
            if RAD_S_PER_RPM * noise * _per_noise(half_width) / step_s <= _WANTED_RAD_S2:
                return cls(half_width, noise, step_s)
        return cls(widest, noise, step_s)

    @property
    def context(self) -> int:
        """Number of samples before and after a block on which its accelerations depend."""
        return self.half_width

    def __call__(self, time_s: FloatArray, speed_rpm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return acceleration and its standard uncertainty, rad/s²; 0 for a single sample.

        Parameters
        ----------
        time_s, speed_rpm : float64 array of shape (n,)
            Rising times; no slope is calculated across missing samples.
        """
        slope, deviation = np.zeros((2, speed_rpm.size))
        step = np.diff(time_s)
        if not step.size:
            return slope, deviation
        cuts = np.flatnonzero((step > _GAP_STEPS * self.step_s) | (step <= 0.0)) + 1
        for rows in np.split(np.arange(speed_rpm.size), cuts):
            run = slice(int(rows[0]), int(rows[-1]) + 1)
            slope[run], deviation[run] = self._run(time_s[run], speed_rpm[run])
        return slope, deviation

    def _run(self, time_s: FloatArray, speed_rpm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return slope and uncertainty of the speed in one run without gaps, in rad/s²."""
        count = speed_rpm.size
        slope, change = np.zeros((2, count))
        for half in range(min(self.half_width, (count - 1) // 2), 0, -1):
            # the widest window if it fits, narrower windows near the ends
            inner = half == self.half_width
            rows = (
                np.arange(half, count - half)
                if inner
                else np.array(sorted({half, count - 1 - half}))
            )
            step = (time_s[rows + half] - time_s[rows - half]) / (2 * half)
            ahead = sum(k * (speed_rpm[rows + k] - speed_rpm[rows]) for k in range(1, half + 1))
            behind = sum(k * (speed_rpm[rows] - speed_rpm[rows - k]) for k in range(1, half + 1))
            squares = half * (half + 1) * (2 * half + 1) / 6.0
            slope[rows] = (ahead + behind) / (2.0 * squares * step)
            change[rows] = (ahead - behind) / (squares * step)
        if count > 1:
            for end, other in ((0, 1), (count - 1, count - 2)):
                slope[end] = (speed_rpm[other] - speed_rpm[end]) / (time_s[other] - time_s[end])
        noise = self.noise_rpm * _per_noise(self.half_width) / self.step_s
        # at the start of a ramp, the slope is anywhere between those of both sides (rectangular)
        return RAD_S_PER_RPM * slope, RAD_S_PER_RPM * np.hypot(noise, 0.5 * change / np.sqrt(3.0))


def _per_noise(half: int) -> float:
    return float(np.sqrt(3.0 / (half * (half + 1) * (2 * half + 1))))
