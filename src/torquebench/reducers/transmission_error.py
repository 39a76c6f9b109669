"""Transmission error over full output revolutions: peak to peak, orders, both directions."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.reducers.quantities import Finding, ResultQuantity
from torquebench.uncertainty import Budget

__all__ = [
    "AngleUncertainty",
    "DirectionError",
    "ErrorOrder",
    "TransmissionErrorResult",
    "evaluate_transmission_error",
]


@dataclass(frozen=True)
class AngleUncertainty:
    """Standard uncertainties (k = 1) of the encoders, rad.

    Parameters
    ----------
    output_rad : float
        Of the output encoder: errors that repeat with the revolution.
    input_rad : float
        Of the input encoder, at the input; the ratio divides it.
    """

    output_rad: float = 0.0
    input_rad: float = 0.0


@dataclass(frozen=True)
class ErrorOrder:
    """One order of the transmission error.

    Parameters
    ----------
    order : float
        Periods per output revolution.
    input_order : float
        Periods per input revolution.
    amplitude_arcsec : Budget
        Amplitude (half of peak to peak) of this order, arcsec.
    phase_rad : float
        Angle of its first maximum times the order, −π to π.
    """

    order: float
    input_order: float
    amplitude_arcsec: Budget
    phase_rad: float


@dataclass(frozen=True, eq=False)
class DirectionError:
    """Transmission error in one direction of rotation.

    Parameters
    ----------
    direction : {"clockwise", "counter-clockwise"}
        Of the output.
    revolutions : int
        Whole output revolutions that were used.
    angle_rad : array of float, shape (n,)
        Output angle over one revolution at even steps, from 0.
    error_arcsec : array of float, shape (n,)
        Mean over the revolutions, mean removed, low-pass filtered in angle.
    standard_error_arcsec : array of float, shape (n,)
        Of that mean; NaN with one revolution.
    peak_to_peak : Budget
        ATE = max − min, arcsec.
    order, amplitude_arcsec : array of float, shape (m,)
        Whole spectrum up to the highest order.
    orders : tuple of ErrorOrder
        The largest ones, largest first.
    speed_rpm : float
        Mean output speed; NaN without times.
    """

    direction: Literal["clockwise", "counter-clockwise"]
    revolutions: int
    angle_rad: NDArray[np.float64]
    error_arcsec: NDArray[np.float64]
    standard_error_arcsec: NDArray[np.float64]
    peak_to_peak: Budget
    order: NDArray[np.float64]
    amplitude_arcsec: NDArray[np.float64]
    orders: tuple[ErrorOrder, ...]
    speed_rpm: float


@dataclass(frozen=True, eq=False)
class TransmissionErrorResult:
    """Transmission error of a reducer.

    Parameters
    ----------
    ratio, highest_order : float
        What was used: input turns for one output turn (negative where reversed), and the
        low-pass limit in periods per output revolution.
    directions : tuple of DirectionError
        One or both.
    peak_to_peak : Budget
        The larger of both directions, arcsec.
    reversal_arcsec : Budget or None
        Mean gap between both directions at the same angle (backlash of the unloaded reducer),
        where both were recorded with one zero.
    findings : tuple of Finding
    """

    ratio: float
    highest_order: float
    directions: tuple[DirectionError, ...]
    peak_to_peak: Budget
    reversal_arcsec: Budget | None
    findings: tuple[Finding, ...]

    def quantities(self) -> tuple[ResultQuantity, ...]:
        """Return the values under their names, for tables and reports."""
        raise NotImplementedError


def evaluate_transmission_error(
    input_angle_rad: ArrayLike,
    output_angle_rad: ArrayLike,
    ratio: float,
    *,
    time_s: ArrayLike | None = None,
    highest_order: float | None = None,
    uncertainty: AngleUncertainty | None = None,
    largest_orders: int = 8,
) -> TransmissionErrorResult:
    """Evaluate θ_o − θ_i/R over whole output revolutions, each direction by itself.

    Parameters
    ----------
    input_angle_rad, output_angle_rad : array of float, shape (n,)
        Both encoders at the same moments, unwrapped, rad; both directions one after another.
    ratio : float
        Input turns for one output turn; negative where the output turns against the input.
    time_s : array of float, shape (n,), optional
        Moments, for the speed only.
    highest_order : float, optional
        Highest order per output revolution that is reported; three times the ratio by default.
    uncertainty : AngleUncertainty, optional
    largest_orders : int
        How many orders are listed.

    Raises
    ------
    InputError
        Less than one output revolution in a direction, fewer than 10 samples per period of the
        highest order, a wrong ratio, an encoder that slips, swapped columns, values not finite.
    """
    raise NotImplementedError
