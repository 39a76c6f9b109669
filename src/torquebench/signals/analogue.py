"""Sampled analogue square waves to edges: threshold, hysteresis, interpolation."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.signals.edges import EdgeBlock

__all__ = ["AnalogueInput", "Threshold", "edges_of_wave"]

# Parts of a sample interval in which an interpolated edge is timed: the rounding error is then far
# below the effect of the samples' noise.
_TICKS_PER_SAMPLE = 4096
# Smallest swing of a square wave, as a share of its largest value.
_LEAST_SWING = 1e-9


@dataclass(frozen=True, slots=True)
class Threshold:
    """Thresholds of a wave: up through level + hysteresis/2, down through level − hysteresis/2.

    Parameters
    ----------
    level : float
        Middle of the two, in the samples' unit.
    hysteresis : float
        Distance of the two; more than the noise from peak to peak.
    """

    level: float
    hysteresis: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.level) and np.isfinite(self.hysteresis) and self.hysteresis >= 0):
            raise InputError(
                Message(
                    "threshold {level} with hysteresis {hysteresis}", self.level, self.hysteresis
                ),
                "finite numbers, hysteresis 0 or more",
            )

    @classmethod
    def of_wave(cls, samples: ArrayLike, hysteresis_part: float = 0.2) -> "Threshold":
        """Take the middle between a wave's low and high level.

        Parameters
        ----------
        samples : array_like, shape (n,)
            At least one period of the wave.
        hysteresis_part : float
            Hysteresis as a part of the swing.

        Raises
        ------
        InputError
            When the samples don't swing.

        Examples
        --------
        >>> Threshold.of_wave([0.0, 0.1, 2.5, 2.6, 0.0, 2.5])
        Threshold(level=1.3, hysteresis=0.52)
        """
        values = np.asarray(samples, dtype=np.float64)
        if not values.size or not np.all(np.isfinite(values)):
            raise InputError("samples that are empty or not finite", "a recorded wave")
        low, high = (float(level) for level in (values.min(), values.max()))
        if high - low <= _LEAST_SWING * max(abs(low), abs(high)):
            raise InputError(
                Message("a wave that stays at {low:.6g}", low),
                "a wave that swings",
                "check the wiring",
            )
        return cls((low + high) / 2, hysteresis_part * (high - low))


class AnalogueInput:
    """Samples of an analogue square wave as a stream of edge blocks.

    Each edge is the time at which the line between two samples crosses the threshold, in ticks
    of 1/4096 of the sample interval.

    Parameters
    ----------
    sample_rate_hz : float
        Samples per second.
    threshold : Threshold
        Where the wave switches.

    Examples
    --------
    >>> stream = AnalogueInput(1e6, Threshold(1.0, 0.2))
    >>> block = stream.push([0.0, 0.0, 2.0, 2.0, 0.0])
    >>> block.ticks / block.timebase_hz * 1e6
    array([1.55004883])
    >>> block.falling_ticks / block.timebase_hz * 1e6
    array([3.55004883])
    """

    def __init__(self, sample_rate_hz: float, threshold: Threshold) -> None:
        if not (np.isfinite(sample_rate_hz) and sample_rate_hz > 0):
            raise InputError(
                Message("sample rate {sample_rate_hz} Hz", sample_rate_hz), "a frequency above 0 Hz"
            )
        self.sample_rate_hz = float(sample_rate_hz)
        self.threshold = threshold
        self._samples = 0
        self._last: float | None = None
        self._high: bool | None = None

    def push(self, samples: ArrayLike) -> EdgeBlock:
        """Take the next samples; return the edges up to the last of them.

        Parameters
        ----------
        samples : array_like, shape (n,)
            Samples in the threshold's unit, all finite.

        Raises
        ------
        InputError
            When the samples aren't a row of finite numbers.
        """
        values = np.asarray(samples, dtype=np.float64)
        if values.ndim != 1 or not np.all(np.isfinite(values)):
            raise InputError("samples that aren't a row of finite numbers", "finite samples")
        first = self._samples
        self._samples += values.size
        known = values if self._last is None else np.concatenate(([self._last], values))
        origin = first if self._last is None else first - 1
        if not values.size:
            return self._block([], [], first)
        self._last = float(values[-1])
        high = self._states(known)
        changes = np.flatnonzero(high[1:] != high[:-1]) + 1
        self._high = bool(high[-1])
        crossed = np.where(
            high[changes],
            self.threshold.level + self.threshold.hysteresis / 2,
            self.threshold.level - self.threshold.hysteresis / 2,
        )
        before, after = known[changes - 1], known[changes]
        part = (crossed - before) / (after - before)
        ticks = (origin + changes - 1) * _TICKS_PER_SAMPLE + np.ceil(
            part * _TICKS_PER_SAMPLE
        ).astype(np.int64)
        return self._block(ticks[high[changes]], ticks[~high[changes]], first)

    def _states(self, values: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Level at each sample, with hysteresis; the middle decides before the first crossing."""
        half = self.threshold.hysteresis / 2
        above = values > self.threshold.level + half
        below = values < self.threshold.level - half
        decided = np.where(above | below, np.arange(values.size), -1)
        last_decided = np.maximum.accumulate(decided)
        start = values[0] > self.threshold.level if self._high is None else self._high
        return np.where(last_decided < 0, start, above[last_decided])

    def _block(self, rising: ArrayLike, falling: ArrayLike, first: int) -> EdgeBlock:
        # An edge before the first sample of a block came after the last of the one before.
        start = max(first - 1, 0) * _TICKS_PER_SAMPLE + (first > 0)
        stop = max(self._samples - 1, 0) * _TICKS_PER_SAMPLE + (self._samples > 0)
        return EdgeBlock(
            np.asarray(rising, dtype=np.int64),
            start,
            stop,
            self.sample_rate_hz * _TICKS_PER_SAMPLE,
            np.asarray(falling, dtype=np.int64),
        )


def edges_of_wave(
    samples: ArrayLike, sample_rate_hz: float, threshold: Threshold | None = None
) -> EdgeBlock:
    """Edges of one recording of an analogue square wave; see `AnalogueInput`.

    Parameters
    ----------
    samples : array_like, shape (n,)
        Samples.
    sample_rate_hz : float
        Samples per second.
    threshold : Threshold, optional
        The middle of the recording's swing with a fifth of it as hysteresis when not given.

    Examples
    --------
    >>> time = np.arange(5000) / 1e6
    >>> block = edges_of_wave(np.sin(2 * np.pi * 1234.5 * time + 1.0), 1e6)
    >>> periods = np.diff(block.ticks) / block.timebase_hz
    >>> float(1 / periods.mean()).__round__(2)
    1234.5
    """
    chosen = Threshold.of_wave(samples) if threshold is None else threshold
    return AnalogueInput(sample_rate_hz, chosen).push(samples)
