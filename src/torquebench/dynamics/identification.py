"""Transfer function and inertia of a chain from ramps, steps and sines, with uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray

from torquebench.dynamics.transfer import TransferFunction
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.units import RAD_S_PER_RPM, TURN

FloatArray = NDArray[np.float64]

_LARGEST_RELATIVE = {"resonance_hz": 0.05, "damping_ratio": 0.3}
_LARGEST_PHASE = 0.2  # rad at the resonance: common error of lag and delay
_LARGEST_INERTIA = 0.05
_UNEVEN = 1e-3
_CORRELATED_LAGS = 200
_BLOCK_S = 0.05
_FEWEST_BLOCKS = 20
_WORDS = {"resonance_hz": "resonance", "damping_ratio": "damping"}


@dataclass(frozen=True, eq=False)
class Known:
    """Readings at a constant rate with a known torque at the flange: steps or sines.

    The first values of reading and torque must belong to a steady state.

    Parameters
    ----------
    interval_s : float
        Sample interval.
    reading_nm, torque_nm : float64[n]
        Reading, and torque at the flange from a reference that is faster than the chain.
    """

    interval_s: float
    reading_nm: FloatArray
    torque_nm: FloatArray


@dataclass(frozen=True)
class Inertia:
    """Moment of inertia between transducer and flange.

    Attributes
    ----------
    largest_rad_s2 : float
        Largest acceleration among the points from which the inertia was identified.
    blocks : int
        Number of block means from which the inertia was identified.
    """

    inertia_kgm2: float
    standard_uncertainty_kgm2: float
    largest_rad_s2: float
    blocks: int


@dataclass(frozen=True)
class Shaft:
    """Stiffness and damping between the transducer's two flanges, with standard uncertainties."""

    stiffness_nm_rad: float
    stiffness_uncertainty_nm_rad: float
    damping_nm_s: float
    damping_uncertainty_nm_s: float


def identify(runs: Sequence[Known], window_s: float = 0.0) -> TransferFunction:
    """Identify the transfer function from runs with a known torque.

    The parameters minimise the deviation of the measured reading from the known torque after the
    transfer function; gain and offset of each run are free, because they belong to the static
    calibration. The covariance follows from the residuals, with their correlation in time.

    Parameters
    ----------
    runs : sequence of Known
        At least one run; all with the same sample interval.
    window_s : float
        Length of the counter's window.

    Returns
    -------
    TransferFunction
        Transfer function with covariance.

    Raises
    ------
    InputError
        If the runs can't identify the resonance, its damping or the lag; the message names the
        necessary runs.
    """
    from scipy.optimize import least_squares

    if not runs:
        raise InputError(
            "no run with a known torque", "at least one run with steps or sines of a known torque"
        )
    prepared = [_prepare(run) for run in runs]
    nyquist_hz = 0.5 / runs[0].interval_s
    if any(abs(run.interval_s / runs[0].interval_s - 1.0) > _UNEVEN for run in runs):
        raise InputError("runs of different sample rates", "one rate", "count equal windows")

    def chain(free: FloatArray) -> TransferFunction:
        """Return the transfer function of these parameters."""
        lag_s, delay_s = np.maximum(free[2:], 0.0) if free.size == 4 else (max(free[2], 0.0), 0.0)
        return TransferFunction(
            float(np.exp(free[0])), float(np.exp(free[1])), float(lag_s), float(delay_s), window_s
        )

    def deviations(free: FloatArray) -> FloatArray:
        """Return the deviations of all runs; the times in `free` are in sample intervals."""
        transfer = chain(free * scale[: free.size])
        return np.concatenate([run.deviation(transfer) for run in prepared])

    scale = np.array([1.0, 1.0, runs[0].interval_s, runs[0].interval_s])
    limits = (
        [np.log(0.002 * nyquist_hz), np.log(1e-3), 0.0, 0.0],
        [np.log(4.0 * nyquist_hz), np.log(1.5), 500.0, 500.0],
    )
    starts = [
        np.array([np.log(share * nyquist_hz), np.log(damping), 0.3, 0.3])
        for share in np.geomspace(0.005, 1.0, 24)
        for damping in (0.03, 0.3)
    ]
    starts.sort(key=lambda start: float(np.sum(np.square(deviations(start)))))
    best = None
    for start in starts[:2]:
        solution = least_squares(deviations, start, bounds=limits, x_scale=[0.1, 0.5, 1.0, 1.0])
        if best is None or solution.cost < best.cost:
            best = solution
    assert best is not None
    free = best.x
    if (
        free[2] < 0.01 or free[3] < 0.01
    ):  # at a limit, one of the two parameters explains the runs alone
        free[2], free[3] = max(free[2], 0.01), max(free[3], 0.01)
    covariance = _covariance(deviations, free)
    jacobian = np.diag([np.exp(free[0]), np.exp(free[1]), scale[2], scale[3]])
    covariance = jacobian @ covariance @ jacobian
    transfer = chain(best.x * scale)
    identified = replace(transfer, covariance=tuple(map(tuple, covariance.tolist())))
    _check(identified, nyquist_hz)
    return identified


@dataclass(frozen=True, eq=False)
class _Prepared:
    """A run that is padded so that its end doesn't affect its beginning."""

    reading: FloatArray
    spectrum: NDArray[np.complex128]
    frequency_hz: FloatArray
    size: int

    def deviation(self, transfer: TransferFunction) -> FloatArray:
        """Return the residuals of the reading after fitting gain and offset."""
        model = np.fft.irfft(self.spectrum * transfer.response(self.frequency_hz), self.size)
        shape = model[: self.reading.size] - np.mean(model[: self.reading.size])
        gain = float(shape @ self.reading) / max(float(shape @ shape), 1e-300)
        return np.asarray(self.reading - np.mean(self.reading) - gain * shape)


def _prepare(run: Known) -> _Prepared:
    """Check a run, and return its reading and the spectrum of its torque."""
    reading, torque = (np.asarray(column, np.float64) for column in (run.reading_nm, run.torque_nm))
    if reading.ndim != 1 or reading.shape != torque.shape or reading.size < 50:
        raise InputError(
            Message(
                "a run of {size} readings and {torque_size} torques", reading.size, torque.size
            ),
            "as many of both, 50 at least",
        )
    if not (np.isfinite(reading).all() and np.isfinite(torque).all()):
        raise InputError("a run with gaps", "finite readings and torques", "cut it at its gaps")
    moved = torque - torque[0]
    if not np.any(moved):
        raise InputError(
            "a run in which the torque doesn't change",
            "steps or sines",
            "record steps of torque, or sines up to frequencies above the resonance",
        )
    back = 0.5 * (1.0 + np.cos(np.linspace(0.0, pi, reading.size)))
    padded = np.concatenate([moved, moved[-1] * back, np.zeros(reading.size)])
    return _Prepared(
        reading,
        np.fft.rfft(padded),
        np.asarray(np.fft.rfftfreq(padded.size, run.interval_s), np.float64),
        padded.size,
    )


def _covariance(function: Callable[[FloatArray], FloatArray], free: FloatArray) -> FloatArray:
    """Return the covariance of the estimate, with the correlation of the deviations over time."""
    residual = function(free)
    slopes = np.empty((residual.size, free.size))
    for k in range(free.size):
        step = np.zeros(free.size)
        step[k] = 1e-4 if k < 2 else 0.005
        slopes[:, k] = (function(free + step) - function(free - step)) / (2.0 * step[k])
    normal = slopes.T @ slopes
    spread = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    inverse = np.linalg.pinv(normal / np.outer(spread, spread), rcond=1e-14)
    inverse /= np.outer(spread, spread)
    # "Sandwich" covariance: lags are weighted by a triangle (Newey and West).
    count = residual.size - free.size - 2
    middle = float(residual @ residual) / count * normal
    for lag in range(1, min(_CORRELATED_LAGS, residual.size // 10)):
        weight = 1.0 - lag / _CORRELATED_LAGS
        shared = float(residual[lag:] @ residual[:-lag]) / count
        product = slopes[lag:].T @ slopes[:-lag]
        middle += weight * shared * (product + product.T)
    robust = inverse @ middle @ inverse
    plain = float(residual @ residual) / count * inverse
    larger = np.sqrt(np.maximum(np.diag(robust) / np.diag(plain), 1.0))
    return np.asarray(plain * np.outer(larger, larger))


def _check(transfer: TransferFunction, nyquist_hz: float) -> None:
    """Refuse parameters that the runs can't identify."""
    what: list[str] = []
    for name, most in _LARGEST_RELATIVE.items():
        value, u = getattr(transfer, name), transfer.standard_uncertainty(name)
        if not u <= most * value:
            what.append(Message("{words} {value:.4g} with u = {u:.3g}", _WORDS[name], value, u))
    shift = transfer.covariance
    late = sqrt(max(shift[2][2] + shift[3][3] + 2.0 * shift[2][3], 0.0))
    if not TURN * transfer.resonance_hz * late <= _LARGEST_PHASE:
        what.append(
            Message(
                "lag and delay {lag_s:.3g} s with u = {late:.3g}",
                transfer.lag_s + transfer.delay_s,
                late,
            )
        )
    if transfer.resonance_hz > nyquist_hz:
        what.append(
            Message(
                "resonance {resonance_hz:.4g} Hz above half of the rate, {nyquist_hz:.4g} Hz",
                transfer.resonance_hz,
                nyquist_hz,
            )
        )
    if what:
        raise InputError(
            Message("these runs don't identify the chain: {what}", Message.joined(what, "; ")),
            "resonance to 5 %, damping to 30 %, lag and delay to 0.2 rad at the resonance",
            "record steps whose rise is shorter than a quarter of the resonance's period, or sines "
            "to beyond the resonance, with more amplitude or more often, in windows of at most a "
            "fifth of its period",
        )


def identify_inertia(
    time_s: FloatArray,
    reading_nm: FloatArray,
    speed_rpm: FloatArray,
    acceleration_rad_s2: FloatArray | None = None,
) -> Inertia:
    """Identify the inertia between transducer and flange from ramps of an empty run.

    Means over blocks of reading and acceleration are fitted, together with zero, drift, zero over
    speed and drag. To separate these from the acceleration, ramps of different steepness through
    the same speeds are needed.

    Parameters
    ----------
    time_s, reading_nm, speed_rpm : float64[n]
        At an even rate, with nothing mounted.
    acceleration_rad_s2 : float64[n], optional
        Measured acceleration; by default it follows from the speed.

    Raises
    ------
    InputError
        The accelerations don't separate the inertia from the other effects.
    """
    time, reading, speed = (
        np.asarray(each, np.float64) for each in (time_s, reading_nm, speed_rpm)
    )
    columns = [time, reading, speed]
    if acceleration_rad_s2 is not None:
        columns.append(np.asarray(acceleration_rad_s2, np.float64))
    if len({column.shape for column in columns}) != 1 or time.ndim != 1 or time.size < 3:
        raise InputError("columns of different lengths", "one value of each a row")
    if not all(np.isfinite(column).all() for column in columns):
        raise InputError("an empty run with gaps", "finite values", "cut it at its gaps")
    interval = (time[-1] - time[0]) / (time.size - 1)
    rows = max(round(_BLOCK_S / interval), 1)
    blocks = (time.size - 1) // rows
    if blocks < _FEWEST_BLOCKS:
        raise InputError(
            Message("{time:.3g} s of an empty run", time[-1] - time[0]),
            Message("{fewest_blocks:g} s or more", _FEWEST_BLOCKS * _BLOCK_S),
        )
    edges = np.arange(blocks + 1) * rows
    turning = speed * RAD_S_PER_RPM
    # the mean over a block follows exactly from the speed at both ends
    if acceleration_rad_s2 is None:
        gained = np.diff(turning[edges])
        acceleration = gained / np.diff(time[edges])
    else:
        acceleration = _means(columns[3], edges)
    mean, rate = _means(reading, edges), _means(turning, edges)
    largest = float(np.max(np.abs(acceleration)))
    top = float(np.max(np.abs(rate))) or 1.0
    basis = np.column_stack(
        [
            acceleration,
            np.ones(blocks),
            np.linspace(-1.0, 1.0, blocks),
            rate / top,
            np.abs(rate) / top,
            np.tanh(rate / (0.02 * top)),
        ]
    )
    norms = np.linalg.norm(basis, axis=0)
    used = norms > 0.0
    scaled = basis[:, used] / norms[used]
    left_over = scaled[:, 0] if used[0] else np.zeros(blocks)
    if used[0]:
        others = scaled[:, 1:]
        left_over = left_over - others @ np.linalg.lstsq(others, left_over, rcond=None)[0]
    distinct = float(np.linalg.norm(left_over))
    remedy = (
        "record an empty run with gentle and steep ramps through the same speeds, both up and down"
    )
    if distinct < 0.05:
        raise InputError(
            Message(
                "an empty run whose acceleration (up to {largest:.3g} rad/s²) can't be "
                "told apart from speed and drift",
                largest,
            ),
            "ramps of different steepness",
            remedy,
        )
    solution, *_ = np.linalg.lstsq(scaled, mean, rcond=None)
    residual = mean - scaled @ solution
    variance = float(residual @ residual) / (blocks - int(used.sum()))
    shared = float(residual[1:] @ residual[:-1]) / max(float(residual @ residual), 1e-300)
    variance *= max((1.0 + shared) / max(1.0 - shared, 0.05), 1.0)
    inertia = float(solution[0] / norms[0])
    u = sqrt(variance) / (distinct * float(norms[0]))
    if not (inertia > 0.0 and u <= _LARGEST_INERTIA * inertia):
        raise InputError(
            Message(
                "inertia {inertia:.3g} kg·m² with u = {u:.2g} from accelerations up to "
                "{largest:.3g} rad/s²",
                inertia,
                u,
                largest,
            ),
            "an inertia above 0, known to 5 %",
            remedy,
        )
    return Inertia(inertia, u, largest, blocks)


def _means(values: FloatArray, edges: NDArray[np.int64]) -> FloatArray:
    """Return the mean over each block by the trapezoidal rule, as for the acceleration."""
    total = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]))])
    return np.asarray(np.diff(total[edges]) / np.diff(edges))


def shaft_of(transfer: TransferFunction, inertia: Inertia) -> Shaft:
    """Return stiffness and damping: k = J(2πf₀)², c = 2ζJ·2πf₀.

    Examples
    --------
    >>> shaft = shaft_of(TransferFunction(500.0, 0.1), Inertia(0.0025, 2.5e-5, 31.0, 400))
    >>> round(shaft.stiffness_nm_rad), round(shaft.stiffness_uncertainty_nm_rad)
    (24674, 247)
    """
    natural, moment = TURN * transfer.resonance_hz, inertia.inertia_kgm2
    stiffness = moment * natural**2
    damping = 2.0 * transfer.damping_ratio * moment * natural
    relative = inertia.standard_uncertainty_kgm2 / moment
    covariance = np.asarray(transfer.covariance)
    by_resonance = covariance[0, 0] / transfer.resonance_hz**2
    by_damping = covariance[1, 1] / transfer.damping_ratio**2
    both = covariance[0, 1] / (transfer.resonance_hz * transfer.damping_ratio)
    return Shaft(
        stiffness,
        stiffness * sqrt(4.0 * by_resonance + relative**2),
        damping,
        damping * sqrt(max(by_resonance + by_damping + 2.0 * both, 0.0) + relative**2),
    )
