"""Reference transducers: the calibrator with its certificate, and the verification standard."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from torquebench.kernels import inner
from torquebench.twin.blocks import Certificate
from torquebench.units import TURN

FloatArray = NDArray[np.float64]

CERTIFIED_POINTS = 50  # in each direction, evenly spaced
_KNOTS_PER_POINT = 4
TABLE_END = 1.2  # the error table covers this share of the range in both directions


class ReferenceConstants(NamedTuple):
    """Scalars of a reference transducer; relative quantities are shares of the nominal torque.

    Attributes
    ----------
    nominal_torque_nm, zero_hz, sensitivity_hz_per_nm : float
        Full scale, actual zero frequency and sensitivity.
    zero_drift_per_k, span_drift_per_k : float
        Drift with temperature.
    white : float
        Standard deviation of the noise of one 1 ms value.
    lag_s, delay_s : float
        First-order lag of the bandwidth, and the rest of the group delay.
    """

    nominal_torque_nm: float
    zero_hz: float
    sensitivity_hz_per_nm: float
    zero_drift_per_k: float
    span_drift_per_k: float
    white: float
    lag_s: float
    delay_s: float


@dataclass(frozen=True)
class ReferenceParameters:
    """One reference transducer with its true errors and its certificate.

    Attributes
    ----------
    constants : ReferenceConstants
        Scalars.
    error : tuple of float
        True relative error at the knots, evenly spaced over ±1.2 of the range, linear between.
    certified_error : tuple of float
        Relative error that the certificate gives at its points, -100 % to 100 %.
    certified_uncertainty : float
        Relative expanded uncertainty (k = 2) of the certificate.
    """

    constants: ReferenceConstants
    error: tuple[float, ...]
    certified_error: tuple[float, ...]
    certified_uncertainty: float

    def error_table(self) -> FloatArray:
        """Error at the knots as an array for the kernels."""
        return np.array(self.error)

    def certificate(self) -> Certificate:
        """Certificate in N·m."""
        nominal = self.constants.nominal_torque_nm
        torque = np.linspace(-nominal, nominal, 2 * CERTIFIED_POINTS + 1)
        uncertainty = np.full(torque.shape, self.certified_uncertainty * nominal)
        return Certificate(torque, np.array(self.certified_error) * nominal, uncertainty)


def draw_reference(
    generator: np.random.Generator,
    constants: ReferenceConstants,
    *,
    largest_error: float,
    certificate_noise: float,
    interpolation_error: float,
) -> ReferenceParameters:
    """Draw a reference's error: smooth, with fine structure between the certified points.

    Parameters
    ----------
    generator : numpy.random.Generator
        Generator of the draws.
    constants : ReferenceConstants
        Scalars.
    largest_error : float
        Largest allowed relative error; the drawn error reaches 60-95 % of it.
    certificate_noise : float
        Relative standard deviation of the certificate's entries.
    interpolation_error : float
        Relative standard deviation between the points.
    """
    per_side = round(TABLE_END * CERTIFIED_POINTS) * _KNOTS_PER_POINT
    relative = np.linspace(-TABLE_END, TABLE_END, 2 * per_side + 1)
    smooth = generator.normal() * relative + generator.normal() * relative**2
    for order in range(1, 5):
        wave = np.sin(np.pi * order * relative + generator.uniform(0.0, TURN))
        smooth += generator.normal() / order * (wave - wave[per_side])
    inside = np.abs(relative) <= 1.0
    smooth *= generator.uniform(0.6, 0.95) * largest_error / np.max(np.abs(smooth[inside]))
    error = smooth + interpolation_error * generator.standard_normal(smooth.shape)
    error[per_side] = 0.0
    extra = round((TABLE_END - 1.0) * CERTIFIED_POINTS) * _KNOTS_PER_POINT
    certified = error[extra : error.size - extra : _KNOTS_PER_POINT].copy()
    certified += certificate_noise * generator.standard_normal(certified.shape)
    certified[CERTIFIED_POINTS] = 0.0
    return ReferenceParameters(
        constants,
        tuple(error.tolist()),
        tuple(certified.tolist()),
        2.0 * float(np.hypot(certificate_noise, interpolation_error)),
    )


@inner
def reference_indication(
    constants: ReferenceConstants,
    error_table: FloatArray,
    torque_nm: float,
    temperature_c: float,
    normal: float,
) -> float:
    """Return the torque with certificate error, drift and noise, in N·m of actual sensitivity."""
    relative = torque_nm / constants.nominal_torque_nm
    last = error_table.size - 1
    position = min(max((relative / TABLE_END + 1.0) * 0.5 * last, 0.0), last - 1e-9)
    knot = int(position)
    share = position - knot
    deviation = (1.0 - share) * error_table[knot] + share * error_table[knot + 1]
    warmth = temperature_c - 23.0
    deviation += (constants.zero_drift_per_k + constants.span_drift_per_k * relative) * warmth
    deviation += constants.white * normal
    return float(torque_nm + deviation * constants.nominal_torque_nm)
