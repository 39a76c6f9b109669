"""Low-pass filters: zero-phase for evaluation, with a known delay for live signals."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import butter, firwin, sosfiltfilt

from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["LiveFilter", "zero_phase"]


def zero_phase(
    value: ArrayLike, sample_rate_hz: float, cutoff_hz: float, order: int = 4
) -> NDArray[np.float64]:
    """Filter a record forwards and backwards, without delay.

    A Butterworth filter, applied twice; its corner is shifted so that both passes together have −3
    dB at the cut-off. It needs the whole record: for evaluation only.

    Parameters
    ----------
    value : array_like, shape (n,)
        Even samples, all finite.
    sample_rate_hz : float
        Samples per second.
    cutoff_hz : float
        Frequency of −3 dB in Hz, below half of the sample rate.
    order : int
        Order of one pass, 1 to 12.

    Raises
    ------
    InputError
        When samples aren't finite or too few, or a parameter is outside its range.

    Examples
    --------
    >>> time = np.arange(2000) / 1000
    >>> slow = np.sin(2 * np.pi * 2.0 * time)
    >>> filtered = zero_phase(slow + 0.2 * np.sin(2 * np.pi * 100.0 * time), 1000.0, 20.0)
    >>> bool(np.max(np.abs(filtered - slow)[200:-200]) < 0.001)
    True
    """
    samples = _row(value)
    _check_cutoff(sample_rate_hz, cutoff_hz)
    if not 1 <= order <= 12:
        raise InputError(Message("order {order}", order), "1 to 12")
    # |H|⁴ = 1/2 where (f/f_c)^(2·order) = √2 − 1, on the axis that the bilinear transform warps.
    corner = np.tan(np.pi * cutoff_hz / sample_rate_hz) / (np.sqrt(2) - 1) ** (1 / (2 * order))
    sections = butter(order, 2 / np.pi * np.arctan(corner), output="sos")
    padding = min(samples.size - 1, int(3 * sample_rate_hz / cutoff_hz))
    if samples.size < 3 * order:
        raise InputError(
            Message("{count} samples", samples.size), Message("at least {limit}", 3 * order)
        )
    return np.asarray(sosfiltfilt(sections, samples, padlen=padding))


class LiveFilter:
    """Low-pass filter of a stream with the same, exactly known delay at every frequency.

    A symmetric finite impulse response (windowed sinc, Hamming): an edge in the torque comes
    out `delay_s` later and with its shape. Cut the stream anywhere: the result is the same.

    Parameters
    ----------
    sample_rate_hz : float
        Samples per second.
    cutoff_hz : float
        Frequency of −6 dB in Hz, below half of the sample rate.
    taps : int, optional
        Length of the impulse response, odd; as short as the cut-off allows when not given.

    Raises
    ------
    InputError
        When a parameter is outside its range.

    Examples
    --------
    >>> live = LiveFilter(1000.0, 50.0)
    >>> live.taps, live.delay_s
    (67, 0.033)
    >>> live.push(np.full(4, 2.5))
    array([2.5, 2.5, 2.5, 2.5])
    """

    def __init__(self, sample_rate_hz: float, cutoff_hz: float, taps: int | None = None) -> None:
        _check_cutoff(sample_rate_hz, cutoff_hz)
        # A Hamming window's transition band is 3.3 sample rates wide over its length.
        length = int(3.3 * sample_rate_hz / cutoff_hz) // 2 * 2 + 1 if taps is None else taps
        if length < 3 or length % 2 == 0:
            raise InputError(Message("{length} taps", length), "an odd number, 3 or more")
        self.taps = length
        self.delay_s = (length - 1) / 2 / sample_rate_hz
        self._weights = firwin(length, cutoff_hz, fs=sample_rate_hz)
        self._past: NDArray[np.float64] | None = None

    def push(self, value: ArrayLike) -> NDArray[np.float64]:
        """Filter the next samples; before the first the stream is taken to be constant.

        Parameters
        ----------
        value : array_like, shape (n,)
            Samples, all finite.

        Returns
        -------
        float64 array, shape (n,)
            Sample k belongs to the time `delay_s` before that of the k-th sample pushed.
        """
        samples = _row(value)
        if not samples.size:
            return samples
        if self._past is None:
            self._past = np.full(self.taps - 1, samples[0])
        joined = np.concatenate((self._past, samples))
        self._past = joined[-(self.taps - 1) :]
        # One scalar product per sample, so that a value doesn't depend on the blocks.
        return np.convolve(joined, self._weights, mode="valid")

    def reset(self) -> None:
        """Forget the past, after a fault."""
        self._past = None


def _row(value: ArrayLike) -> NDArray[np.float64]:
    samples = np.asarray(value, dtype=np.float64)
    if samples.ndim != 1 or not np.all(np.isfinite(samples)):
        raise InputError(
            "samples that aren't a finite row", "finite samples", "handle the fault before"
        )
    return samples


def _check_cutoff(sample_rate_hz: float, cutoff_hz: float) -> None:
    if not 0 < cutoff_hz < sample_rate_hz / 2:
        raise InputError(
            Message(
                "cut-off {cutoff_hz} Hz at {sample_rate_hz} samples per second",
                cutoff_hz,
                sample_rate_hz,
            ),
            Message("between 0 and {sample_rate_hz} Hz", sample_rate_hz / 2),
        )
