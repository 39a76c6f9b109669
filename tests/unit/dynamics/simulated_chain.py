"""A chain in continuous time, simulated without the library's transfer function."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lsim

FloatArray = NDArray[np.float64]
_FINE = 40


@dataclass(frozen=True)
class SimulatedChain:
    """Flange of an inertia on a spring, lag and delay of the transducer, means over windows."""

    inertia_kgm2: float = 0.0025
    stiffness_nm_rad: float = 25_700.0
    damping_nm_s: float = 0.96
    lag_s: float = 53e-6
    delay_s: float = 167e-6
    interval_s: float = 1e-4
    noise_nm: float = 0.02

    def run(
        self, torque: Callable[[FloatArray], FloatArray], duration_s: float, seed: int = 0
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return time, reading and torque at the middle of every window."""
        fine_s = self.interval_s / _FINE
        count = round(duration_s / self.interval_s)
        time = np.arange((count + 1) * _FINE + 1) * fine_s - self.interval_s
        spring = [self.damping_nm_s, self.stiffness_nm_rad]
        swinging = [self.inertia_kgm2, *spring]
        _, shown, _ = lsim(
            (spring, np.polymul(swinging, [self.lag_s, 1.0])),
            torque(time - self.delay_s),
            time - time[0],
        )
        total = np.concatenate([[0.0], np.cumsum(0.5 * (shown[1:] + shown[:-1]))])
        middle = np.arange(_FINE, (count + 1) * _FINE - _FINE, _FINE)
        half = _FINE // 2
        reading = (total[middle + half] - total[middle - half]) / (2 * half)
        noise = self.noise_nm * np.random.default_rng(seed).standard_normal(reading.size)
        return time[middle], reading + noise, torque(time[middle])


def steps(time_s: FloatArray) -> FloatArray:
    """Two steps that rise in half a millisecond."""
    up, down = (np.clip((time_s - start) / 5e-4, 0.0, 1.0) for start in (0.01, 0.05))
    return np.asarray(3.0 + 20.0 * (up - down))


def sines(time_s: FloatArray) -> FloatArray:
    """A sine from 10 to 1500 Hz within 0.25 s."""
    phase = 2.0 * np.pi * (10.0 * time_s + 1490.0 / 0.5 * time_s**2)
    return np.asarray(np.where(time_s > 0.0, 5.0 * np.sin(phase), 0.0))


def slow(time_s: FloatArray) -> FloatArray:
    """A swell of 4 Hz, which shows nothing of the resonance."""
    return np.asarray(np.where(time_s > 0.0, 5.0 - 5.0 * np.cos(8.0 * np.pi * time_s), 0.0))
