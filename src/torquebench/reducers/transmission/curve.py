"""One direction of a transmission error: mean revolution, peak to peak, orders."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torquebench.reducers.transmission.segments import Run
from torquebench.units import ARCSEC, TURN

__all__ = ["Revolution", "mean_revolution"]

Floats = NDArray[np.float64]
LEAST_SAMPLES = 720
PER_PERIOD = 16


@dataclass(frozen=True, eq=False)
class Revolution:
    """The mean of whole revolutions at even angles, mean removed and low-pass filtered, arcsec.

    Parameters
    ----------
    angle_rad, error_arcsec, standard_error_arcsec : array of float, shape (n,)
        The standard error is NaN with one revolution.
    peak_to_peak_arcsec : float
    noise_arcsec : float
        Standard error of a value of the curve: from the scatter between revolutions, otherwise from
        the part above the highest order.
    noise_freedom : float
    peak_noise_arcsec : float
        Increase of the peak to peak value by such noise.
    order, amplitude_arcsec, phase_rad : array of float, shape (m,)
        Spectrum of the mean over all revolutions, up to the highest order.
    amplitude_error_arcsec : array of float, shape (m,)
    mean_rad : float
        Removed part.
    revolutions : int
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


def mean_revolution(run: Run, highest_order: float) -> Revolution:
    """Resample in angle, low-pass without phase shift and average whole revolutions.

    Between the samples the error is averaged over each step of an even grid where the record is
    dense, and interpolated if it isn't. A Fourier transform over all whole revolutions, cut at the
    highest order, is a low-pass in angle without phase shift, and exact for periodic parts.

    The angle is the output's, θ_o, of which the error is a function: over θ_i/R the error itself
    would distort each order by a share of order times error (2 % for 23 arcsec of order 200), and
    the distortion above the highest order would be cut off.

    Parameters
    ----------
    run : Run
        One direction, one revolution or more.
    highest_order : float
        Per output revolution.
    """
    per_turn = int(max(LEAST_SAMPLES, 2 ** np.ceil(np.log2(PER_PERIOD * highest_order))))
    step = float(TURN / per_turn)
    turned = np.maximum.accumulate(run.angle_rad + run.error_rad)
    first = int(np.ceil(turned[0] / step))
    span = turned[-1] - first * step
    revolutions = max(1, int(np.floor((span + 2.0 * step) / TURN)))
    grid = np.arange(first, first + revolutions * per_turn)
    error, averaged = _resampled(turned / step, run.error_rad, grid)
    # The curve begins at the angle 0, so that both directions are comparable.
    error = np.roll(error, first % per_turn)
    mean = float(error.mean())
    lines = np.fft.rfft((error - mean) / ARCSEC)
    order = np.arange(lines.size) / revolutions
    if averaged:  # a mean over a step reduces changes within it
        lines = lines / np.sinc(np.minimum(order / per_turn, 0.5))
    kept = np.where(order <= highest_order * (1 + 1e-9), lines, 0.0)
    filtered = np.fft.irfft(kept, error.size).reshape(revolutions, per_turn)
    curve = filtered.mean(axis=0)
    noise, freedom, spread = _noise(filtered, lines, order, highest_order)
    whole = np.arange(revolutions, lines.size, revolutions)
    whole = whole[order[whole] <= highest_order * (1 + 1e-9)]
    amplitude = 2.0 * np.abs(lines[whole]) / error.size
    # The noise of a mean curve is distributed over its lines: variance of the curve = sum of a²/2.
    per_line = noise * np.sqrt(2.0 / max(whole.size, 1))
    return Revolution(
        angle_rad=np.arange(per_turn, dtype=np.float64) * step,
        error_arcsec=curve,
        standard_error_arcsec=spread,
        peak_to_peak_arcsec=float(np.ptp(curve)),
        noise_arcsec=noise,
        noise_freedom=freedom,
        peak_noise_arcsec=_peak_noise(curve, noise),
        order=order[whole],
        amplitude_arcsec=amplitude,
        phase_rad=-np.angle(lines[whole]),
        amplitude_error_arcsec=np.full(whole.size, per_line),
        mean_rad=mean,
        revolutions=revolutions,
    )


def _resampled(place: Floats, error: Floats, grid: NDArray[np.int64]) -> tuple[Floats, bool]:
    """Return means over the steps of the grid; interpolated values where samples are few.

    `place` counts in steps.
    """
    nearest = np.rint(place).astype(np.int64) - grid[0]
    inside = (nearest >= 0) & (nearest < grid.size)
    count = np.bincount(nearest[inside], minlength=grid.size)
    if np.median(count) < 4:
        return np.interp(grid, place, error), False
    total = np.bincount(nearest[inside], weights=error[inside], minlength=grid.size)
    where = np.bincount(nearest[inside], weights=place[inside], minlength=grid.size)
    full = count >= 4
    means, centres = total[full] / count[full], where[full] / count[full]
    return np.interp(grid, centres, means), True


def _noise(
    filtered: Floats, lines: NDArray[np.complex128], order: Floats, highest_order: float
) -> tuple[float, float, Floats]:
    """Return the mean curve's standard error, its degrees of freedom, and the error by place."""
    revolutions, per_turn = filtered.shape
    if revolutions > 1:
        spread = filtered.std(axis=0, ddof=1) / revolutions**0.5
        # Neighbouring places have common noise: the filter's bandwidth gives the independent
        # number.
        independent = min(2.0 * highest_order, per_turn)
        return (
            float(np.sqrt(np.mean(spread**2))),
            float(max(independent * (revolutions - 1) / 4.0, revolutions - 1)),
            spread,
        )
    above = (order > 1.5 * highest_order) & (order < 0.8 * order[-1])
    count = int(np.count_nonzero(above))
    if count == 0:
        return 0.0, np.inf, np.full(per_turn, np.nan)
    density = float(np.mean(np.abs(lines[above]) ** 2))
    passed = 2.0 * float(np.count_nonzero((order > 0) & (order <= highest_order)))
    noise = float(np.sqrt(density * passed)) / per_turn
    return noise, float(2 * count), np.full(per_turn, np.nan)


def _peak_noise(curve: Floats, noise: float) -> float:
    """Return by how much noise raises the range: the more places are near the peak, the more.

    For each end, the expected maximum of the competing places (those within two standard
    deviations of the peak), which is about σ·√(2 ln n) for n independent ones.
    """
    if noise <= 0.0:
        return 0.0
    raised = 0.0
    for side in (curve, -curve):
        near = side > side.max() - 2.0 * noise
        groups = max(1, int(np.count_nonzero(np.diff(near.astype(np.int8)) == 1)))
        raised += noise * np.sqrt(2.0 * np.log(groups)) if groups > 1 else 0.3 * noise
    return float(raised)
