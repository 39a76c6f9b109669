"""Signals periodic in rotation: resampling in angle, order spectrum, ripple removal."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.signal import get_window

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.units import TURN

__all__ = [
    "AngleRecord",
    "OrderSpectrum",
    "RippleFit",
    "fit_ripple",
    "order_spectrum",
    "resample_in_angle",
]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AngleRecord:
    """A value against angle, at even angles.

    Parameters
    ----------
    angle_rad : float64 array, shape (n,)
        Angles in rad, growing.
    value : float64 array, shape (n,)
        Value there.
    samples_per_revolution : int
        Samples in 2π.
    """

    angle_rad: NDArray[np.float64]
    value: NDArray[np.float64]
    samples_per_revolution: int


def resample_in_angle(
    time_s: ArrayLike,
    value: ArrayLike,
    angle_time_s: ArrayLike,
    angle_rad: ArrayLike,
    samples_per_revolution: int,
) -> AngleRecord:
    """Read a value at even angles: torque against angle, and order tracking.

    Each angle's time comes from the angle channel (a monotone cubic), the value at that time from a
    cubic spline. Changes faster than half of the samples per revolution must be filtered before, or
    they alias into lower orders.

    Parameters
    ----------
    time_s, value : array_like, shape (n,)
        The value, at increasing times in seconds, synchronous with the angle.
    angle_time_s, angle_rad : array_like, shape (m,)
        The angle in rad, unwrapped, at increasing times; it must turn in one direction.
    samples_per_revolution : int
        Samples in 2π of angle.

    Raises
    ------
    InputError
        When rows don't match, times don't increase, the angle turns back, or both channels
        have less than two angles in common.

    Examples
    --------
    >>> time = np.linspace(0, 2, 4001)
    >>> angle = 2 * np.pi * (3 * time + 2 * time**2)
    >>> record = resample_in_angle(time, np.cos(5 * angle), time, angle, 64)
    >>> bool(np.max(np.abs(record.value - np.cos(5 * record.angle_rad))) < 1e-3)
    True
    """
    times, values = _rows(time_s, value, "value")
    angle_times, angles = _rows(angle_time_s, angle_rad, "angle")
    if samples_per_revolution < 2:
        raise InputError(
            Message("{samples_per_revolution} samples per revolution", samples_per_revolution),
            "2 or more",
        )
    turns = np.diff(angles)
    if not (np.all(turns > 0) or np.all(turns < 0)):
        raise InputError(
            "an angle that stands or turns back",
            "an angle that turns in one direction",
            "split the record at its reversals",
        )
    if turns[0] < 0:
        angle_times, angles = angle_times[::-1], angles[::-1]
    start, stop = max(times[0], min(angle_times)), min(times[-1], max(angle_times))
    step = TURN / samples_per_revolution
    ends = np.sort(np.interp([start, stop], *_increasing(angle_times, angles)))
    grid = np.arange(np.ceil(ends[0] / step - 1e-9), np.floor(ends[1] / step + 1e-9) + 1) * step
    if stop <= start or grid.size < 2:
        raise InputError("value and angle with nothing in common", "records of the same time")
    at = np.clip(PchipInterpolator(angles, angle_times)(grid), start, stop)
    return AngleRecord(
        angle_rad=grid,
        value=np.asarray(CubicSpline(times, values)(at)),
        samples_per_revolution=samples_per_revolution,
    )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class OrderSpectrum:
    """Amplitude against order.

    Parameters
    ----------
    order : float64 array, shape (n,)
        Periods per revolution.
    amplitude : float64 array, shape (n,)
        Amplitude (peak, not root mean square) in the value's unit.
    """

    order: NDArray[np.float64]
    amplitude: NDArray[np.float64]

    def at(self, order: float) -> float:
        """Amplitude of the line nearest to an order."""
        return float(self.amplitude[int(np.argmin(np.abs(self.order - order)))])


def order_spectrum(record: AngleRecord, window: str = "hann") -> OrderSpectrum:
    """Spectrum of a record in angle, by a windowed Fourier transform.

    It is taken over whole revolutions, so whole orders lie on lines and their amplitudes are exact;
    between lines "flattop" gives correct amplitudes with less resolution.

    Parameters
    ----------
    record : AngleRecord
        One revolution or more.
    window : str
        A window's name for `scipy.signal.get_window`.

    Examples
    --------
    >>> angle = np.arange(256) * 2 * np.pi / 64
    >>> record = AngleRecord(
    ...     angle_rad=angle, value=5.0 + 0.3 * np.sin(7 * angle), samples_per_revolution=64
    ... )
    >>> round(order_spectrum(record).at(7), 6)
    0.3
    """
    per_turn = record.samples_per_revolution
    revolutions = record.value.size // per_turn
    if revolutions < 1:
        raise InputError(
            Message("{size:.3g} revolutions", record.value.size / per_turn),
            "at least one whole revolution",
        )
    values = record.value[: revolutions * per_turn]
    weights = get_window(window, values.size)
    lines = np.fft.rfft((values - values.mean()) * weights) / weights.sum()
    return OrderSpectrum(order=np.arange(lines.size) / revolutions, amplitude=2 * np.abs(lines))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RippleFit:
    """The periodic part over an angle, and the rest.

    Parameters
    ----------
    orders : float64 array, shape (k,)
        Periods per revolution.
    amplitude : float64 array, shape (k,)
        Amplitude of each in the value's unit.
    phase_rad : float64 array, shape (k,)
        Angle of its first maximum times the order, −π to π.
    ripple : float64 array, shape (n,)
        The ripple at each sample.
    rest : float64 array, shape (n,)
        The value without it.
    """

    orders: NDArray[np.float64]
    amplitude: NDArray[np.float64]
    phase_rad: NDArray[np.float64]
    ripple: NDArray[np.float64]
    rest: NDArray[np.float64]


def fit_ripple(
    angle_rad: ArrayLike, value: ArrayLike, orders: Sequence[float] = (1.0, 2.0)
) -> RippleFit:
    """Fit and remove ripple that is synchronous with a rotation, at any speed.

    Least squares of mean, slope and one cosine per order in the angle; uneven samples, changing
    speed and parts of revolutions are allowed as long as the orders can be separated.

    Parameters
    ----------
    angle_rad, value : array_like, shape (n,)
        Angle in rad, unwrapped, and value at the same times.
    orders : sequence of float
        Periods per revolution, each above 0.

    Raises
    ------
    InputError
        If rows don't match, or the record is too short to separate the orders.

    Examples
    --------
    >>> angle = np.linspace(0.0, 40.0, 900) ** 1.3
    >>> fit = fit_ripple(angle, 7.0 + 0.4 * np.cos(angle - 0.5) + 0.1 * np.cos(2 * angle))
    >>> fit.amplitude.round(6)
    array([0.4, 0.1])
    >>> np.allclose(fit.phase_rad, [0.5, 0.0]), np.allclose(fit.rest, 7.0)
    (True, True)
    """
    angles = np.asarray(angle_rad, dtype=np.float64)
    values = np.asarray(value, dtype=np.float64)
    chosen = np.asarray(orders, dtype=np.float64)
    if angles.ndim != 1 or angles.shape != values.shape:
        raise InputError(
            Message("angles {shape} and values {values_shape}", angles.shape, values.shape),
            "two equal rows",
        )
    if not (np.all(np.isfinite(angles)) and np.all(np.isfinite(values))):
        raise InputError("angles or values that aren't finite", "finite samples")
    if not chosen.size or np.any(chosen <= 0) or np.unique(chosen).size < chosen.size:
        raise InputError(Message("orders {orders}", chosen.tolist()), "different orders above 0")
    centred = angles - angles.mean()
    phase = np.multiply.outer(angles, chosen)
    matrix = np.column_stack((np.ones_like(angles), centred, np.cos(phase), np.sin(phase)))
    scale = np.linalg.norm(matrix, axis=0)
    scale[scale == 0] = 1.0
    coefficients, _, rank, singular = np.linalg.lstsq(matrix / scale, values, rcond=None)
    if rank < matrix.shape[1] or singular[-1] < 1e-3 * singular[0]:
        raise InputError(
            Message(
                "{revolutions:.3g} revolutions for orders {chosen}",
                np.ptp(angles) / TURN,
                chosen.tolist(),
            ),
            "a record that tells the orders apart",
            "record a whole revolution of the lowest order or more",
        )
    coefficients = coefficients / scale
    cosine, sine = coefficients[2 : 2 + chosen.size], coefficients[2 + chosen.size :]
    ripple = np.asarray(np.cos(phase) @ cosine + np.sin(phase) @ sine)
    return RippleFit(
        orders=chosen,
        amplitude=np.hypot(cosine, sine),
        phase_rad=np.arctan2(sine, cosine),
        ripple=ripple,
        rest=values - ripple,
    )


def _rows(
    time_s: ArrayLike, value: ArrayLike, name: str
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    times = np.asarray(time_s, dtype=np.float64)
    values = np.asarray(value, dtype=np.float64)
    if times.ndim != 1 or times.shape != values.shape or times.size < 4:
        raise InputError(
            Message("times {shape} and {name} {values_shape}", times.shape, name, values.shape),
            "two equal rows of 4 or more",
        )
    if not (np.all(np.isfinite(times)) and np.all(np.isfinite(values))):
        raise InputError(Message("a {name} that isn't finite", name), "finite samples")
    if np.any(np.diff(times) <= 0):
        raise InputError(
            Message("times of the {name} that don't increase", name), "increasing times"
        )
    return times, values


def _increasing(
    times: NDArray[np.float64], angles: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return (times, angles) if times[0] < times[-1] else (times[::-1], angles[::-1])
