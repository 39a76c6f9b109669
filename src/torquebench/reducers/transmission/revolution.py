"""One direction of a transmission error: mean revolution, peak to peak, orders."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from torquebench.reducers.transmission.runs import Run
from torquebench.units import ARCSEC, TURN

Floats = NDArray[np.float64]
LEAST_SAMPLES = 720
PER_PERIOD = 64
"""Samples in a period of the highest order; denser records are averaged to this number."""


@dataclass(frozen=True, eq=False)
class Revolution:
    """The mean of whole revolutions at even angles, mean removed and low-pass filtered, arcsec.

    Parameters
    ----------
    angle_rad, error_arcsec, standard_error_arcsec : array of float, shape (n,)
        The standard error is NaN with one revolution.
    noise_arcsec : float
        Standard error of a value of the curve: from the scatter between revolutions, otherwise from
        the part above the highest order.
    peak_noise_arcsec : float
        Increase of the peak to peak value by this noise.
    order, amplitude_arcsec, phase_rad : array of float, shape (m,)
        Spectrum of the mean over all revolutions, up to the highest order.
    amplitude_error_arcsec : array of float, shape (m,)
    mean_rad : float
        The mean that was removed.
    cut_order, cut_arcsec : float
        Strongest order above the highest one, as far as the samples show it, and its amplitude.
    """

    angle_rad: Floats
    error_arcsec: Floats
    standard_error_arcsec: Floats
    peak_to_peak_arcsec: float
    noise_arcsec: float
    noise_freedom: float
    peak_noise_arcsec: float
    order: Floats
    amplitude_arcsec: Floats
    phase_rad: Floats
    amplitude_error_arcsec: Floats
    mean_rad: float
    revolutions: int
    cut_order: float
    cut_arcsec: float


def mean_revolution(run: Run, highest_order: float) -> Revolution:
    """Resample in angle, low-pass without phase shift and average whole revolutions.

    A dense record is averaged to 64 samples in a period of the highest order, and a cubic spline
    interpolates them at even angles. A Fourier transform over all whole revolutions, cut at the
    highest order, is a low-pass in angle without phase shift, and exact for periodic parts.

    The angle is the output's, θ_o, of which the error is a function: over θ_i/R the error itself
    would distort each order by a share of order times error (2 % for 23 arcsec of order 200).
    """
    revolutions = run.turns
    angle, error, block = _thinned(run, highest_order)
    per_revolution = angle.size / max(float(angle[-1] - angle[0]) / TURN, 1e-9)
    least = max(LEAST_SAMPLES, PER_PERIOD * highest_order, per_revolution)
    per_turn = int(2 ** np.ceil(np.log2(least)))
    step = float(TURN / per_turn)
    first = int(np.ceil(angle[0] / step))
    angles = np.arange(first, first + revolutions * per_turn) * step
    size = angles.size
    angles = np.where(angles > angle[-1], np.maximum(angles - TURN, angle[0]), angles)
    # The curve begins at the angle 0, so that both directions are comparable.
    over_output = np.roll(CubicSpline(angle, error)(angles), first % per_turn)
    mean = float(over_output.mean())
    lines = np.fft.rfft((over_output - mean) / ARCSEC)
    order = np.arange(lines.size) / revolutions
    # The mean over a block attenuates changes within it.
    lines = lines / np.sinc(np.minimum(order * block / TURN, 0.5))
    limited = np.where(order <= highest_order * (1 + 1e-9), lines, 0.0)
    filtered = np.fft.irfft(limited, size).reshape(revolutions, per_turn)
    curve = filtered.mean(axis=0)
    noise, freedom, spread = _noise(filtered, lines, order, 0.4 * per_revolution, highest_order)
    harmonics = np.arange(revolutions, lines.size, revolutions)
    cut = harmonics[(order[harmonics] > highest_order) & (order[harmonics] < 0.4 * per_revolution)]
    strongest = int(cut[np.argmax(np.abs(lines[cut]))]) if cut.size else 0
    harmonics = harmonics[order[harmonics] <= highest_order * (1 + 1e-9)]
    # The noise of a mean curve is distributed over its lines: variance of the curve = sum of a²/2.
    per_line = noise * np.sqrt(2.0 / max(harmonics.size, 1))
    return Revolution(
        angle_rad=np.arange(per_turn, dtype=np.float64) * step,
        error_arcsec=curve,
        standard_error_arcsec=spread,
        peak_to_peak_arcsec=float(np.ptp(np.fft.irfft(limited[::revolutions], 8 * per_turn)))
        * 8.0
        / revolutions,
        noise_arcsec=noise,
        noise_freedom=freedom,
        peak_noise_arcsec=_peak_noise(curve, noise),
        order=order[harmonics],
        amplitude_arcsec=2.0 * np.abs(lines[harmonics]) / size,
        phase_rad=-np.angle(lines[harmonics]),
        amplitude_error_arcsec=np.full(harmonics.size, per_line),
        mean_rad=mean,
        revolutions=revolutions,
        cut_order=float(order[strongest]),
        cut_arcsec=2.0 * float(np.abs(lines[strongest])) / size if strongest else 0.0,
    )


def _thinned(run: Run, highest_order: float) -> tuple[Floats, Floats, float]:
    """Return rising output angles and errors, averaged over blocks, and the blocks' width."""
    angle, error = run.angle_rad, run.error_rad
    turns = max(float(angle[-1] - angle[0]) / TURN, 1e-9)
    count = max(1, int(angle.size / turns / (PER_PERIOD * highest_order)))
    if count > 1:
        size = angle.size // count * count
        angle, error = (values[:size].reshape(-1, count).mean(axis=1) for values in (angle, error))
    step = float(angle[-1] - angle[0]) / max(angle.size - 1, 1)
    width = step * (1.0 - 1.0 / count)  # from the first to the last sample of a block
    turned = angle + error
    order = np.argsort(turned, kind="stable")
    different, first = np.unique(turned[order], return_index=True)
    # A coarse encoder repeats its counts.
    means = np.add.reduceat(error[order], first) / np.diff(np.append(first, error.size))
    return different, means, width


def _noise(
    filtered: Floats,
    lines: NDArray[np.complex128],
    order: Floats,
    shown: float,
    highest_order: float,
) -> tuple[float, float, Floats]:
    """Return the mean curve's standard error, its degrees of freedom, and the error at each angle.

    With one revolution, the noise is that of the orders above the highest one that the samples
    still resolve (up to `shown`).
    """
    revolutions, per_turn = filtered.shape
    if revolutions > 1:
        spread = filtered.std(axis=0, ddof=1) / revolutions**0.5
        # Neighbouring angles have common noise: the filter's bandwidth gives the number of
        # independent ones.
        independent = min(2.0 * highest_order, per_turn)
        return (
            float(np.sqrt(np.mean(spread**2))),
            float(max(independent * (revolutions - 1) / 4.0, revolutions - 1)),
            spread,
        )
    above = (order > 1.5 * highest_order) & (order < shown)
    count = int(np.count_nonzero(above))
    unknown = np.full(per_turn, np.nan)
    if count == 0:
        return 0.0, np.inf, unknown
    # A few orders that remain in this range don't move the median.
    density = float(np.median(np.abs(lines[above]) ** 2)) / np.log(2.0)
    passed = 2.0 * float(np.count_nonzero((order > 0) & (order <= highest_order)))
    return float(np.sqrt(density * passed)) / per_turn, float(2 * count), unknown


def _peak_noise(curve: Floats, noise: float) -> float:
    """Return by how much noise raises the range, which grows with the number of near-equal peaks.

    For each end, it is the expected maximum over the peaks within two standard deviations of the
    highest, which is about σ·√(2 ln n) for n independent ones.
    """
    if noise <= 0.0:
        return 0.0
    raised = 0.0
    for side in (curve, -curve):
        near = side > side.max() - 2.0 * noise
        groups = max(1, int(np.count_nonzero(np.diff(near.astype(np.int8)) == 1)))
        raised += noise * np.sqrt(2.0 * np.log(groups)) if groups > 1 else 0.3 * noise
    return float(raised)
