"""Steady value of one step: settled part, DC component over whole periods, honest error."""

from dataclasses import dataclass

from numpy.typing import ArrayLike

__all__ = ["SteadyValue", "steady_value"]


@dataclass(frozen=True, slots=True, kw_only=True)
class SteadyValue:
    """Steady value of a step.

    Parameters
    ----------
    value : float
        DC component of the settled part, in the unit of the samples.
    standard_error : float
        Standard error of `value`, honest under autocorrelated noise and ripple; same unit.
    drift_per_s : float
        Slope of the settled part, in the samples' unit per second.
    drift_standard_error_per_s : float
        Standard error of that slope.
    settled : bool
        True when the drift over the window is below its own standard error (or below the
        tolerance given): only then the value counts. Otherwise wait longer, or mark the point.
    samples : int
        Samples that the value rests on.
    effective_samples : float
        Independent samples that they are worth.
    rejected : int
        Single wild values left out of the window.
    start_s, stop_s : float
        The window used, in the samples' time.
    period_s : float or None
        Period of the ripple that was taken out, given or estimated.
    ripple : float
        Amplitude of that ripple's fundamental.
    """

    value: float
    standard_error: float
    drift_per_s: float
    drift_standard_error_per_s: float
    settled: bool
    samples: int
    effective_samples: float
    rejected: int
    start_s: float
    stop_s: float
    period_s: float | None = None
    ripple: float = 0.0


def steady_value(
    time_s: ArrayLike,
    value: ArrayLike,
    *,
    period_s: float | None = None,
    estimate_period: bool = True,
    harmonics: int = 2,
    tolerance: float = 0.0,
    minimum_samples: int = 8,
    settling_limit: float = 0.6,
) -> SteadyValue:
    """Find the settled part of a step and its steady value.

    Parameters
    ----------
    time_s : array_like, shape (n,)
        Times of the samples in seconds, increasing.
    value : array_like, shape (n,)
        Samples, all finite (a fault must be handled before), in any unit.
    period_s : float, optional
        Known period of a ripple in seconds, such as the motor's rotation.
    estimate_period : bool
        Look for a significant ripple when no period is given.
    harmonics : int
        Harmonics of the ripple that are taken out together with it.
    tolerance : float
        Drift over the window that doesn't matter, in the samples' unit.
    minimum_samples : int
        Fewest samples that a steady value may rest on.
    settling_limit : float
        Part of the record that may be given up as settling, 0 to 1.

    Returns
    -------
    SteadyValue
        With `settled` False when no part of the record is steady: a mark, not an error.

    Raises
    ------
    InputError
        When samples are too few, not finite, or times don't increase.
    """
    raise NotImplementedError
