"""Frequency to torque: measured zero and one sensitivity per direction."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.signals.faults import PulseTrainFault, SignalFaultKind
from torquebench.signals.record import Record

__all__ = ["FrequencyScale"]


@dataclass(frozen=True, slots=True, kw_only=True)
class FrequencyScale:
    """Scale of a torque transducer with frequency output.

    M = (f − f₀)/S with S of the direction: S_cw where f ≥ f₀ (clockwise, positive torque) and
    S_ccw below. f₀ is the *measured* zero; the sensitivities come from the transducer's own
    certificate or the nominal values (60 kHz option: 15 Hz/(N·m) at 2 kN·m, 600 Hz/(N·m) at
    50 N·m).

    A timebase that runs wrong by δ multiplies every frequency by 1 + δ: with a nominal zero that
    shifts torque by δ·f₀/S (2δ of full scale for 60 ± 30 kHz) and its gain by δ. A zero measured
    with the same clock removes the shift; calibrating and measuring with the same clock removes the
    gain error. So a calibration is valid for one counter: record which.

    Parameters
    ----------
    nominal_torque_nm : float
        Nominal torque (full scale) in N·m.
    nominal_zero_hz : float
        Frequency at zero torque by the data sheet in Hz.
    sensitivity_cw_hz_per_nm, sensitivity_ccw_hz_per_nm : float
        Sensitivity of the two directions in Hz/(N·m), above 0.
    modulation_hz : (float, float)
        Lowest and highest valid frequency in Hz; outside it a frequency is a fault.
    zero_hz : float, optional
        Measured zero in Hz; the nominal zero when it isn't measured yet.

    Raises
    ------
    InputError
        If a value isn't finite and positive, or the zero is outside the modulation range.

    Examples
    --------
    >>> scale = FrequencyScale(
    ...     nominal_torque_nm=2000.0,
    ...     nominal_zero_hz=60e3,
    ...     sensitivity_cw_hz_per_nm=15.0,
    ...     sensitivity_ccw_hz_per_nm=15.0,
    ...     modulation_hz=(15e3, 105e3),
    ... )
    >>> scale.torque([75e3, 45e3])
    array([ 1000., -1000.])
    >>> scale.with_zero(60_015.0).torque(60_015.0)
    array(0.)
    """

    nominal_torque_nm: float
    nominal_zero_hz: float
    sensitivity_cw_hz_per_nm: float
    sensitivity_ccw_hz_per_nm: float
    modulation_hz: tuple[float, float]
    zero_hz: float | None = None

    def __post_init__(self) -> None:
        for name in (
            "nominal_torque_nm",
            "nominal_zero_hz",
            "sensitivity_cw_hz_per_nm",
            "sensitivity_ccw_hz_per_nm",
        ):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise InputError(Message("{name} = {value}", name, value), "a finite value above 0")
        low, high = self.modulation_hz
        if not (0 < low < high < np.inf):
            raise InputError(
                Message("modulation_hz = {modulation_hz}", self.modulation_hz), "0 < low < high"
            )
        if not low <= self.zero <= high:
            raise InputError(
                Message("zero {zero} Hz", self.zero),
                Message("{lowest_hz} to {highest_hz} Hz", low, high),
                "check the transducer's option and unload it before zeroing",
            )

    @classmethod
    def symmetric(
        cls,
        nominal_torque_nm: float,
        nominal_zero_hz: float = 60e3,
        *,
        relative_deviation: float = 0.5,
        relative_modulation: float = 0.75,
    ) -> "FrequencyScale":
        """Make the nominal scale of a data sheet, such as 60 ± 30 kHz or 240 ± 120 kHz.

        Parameters
        ----------
        nominal_torque_nm : float
            Nominal torque in N·m.
        nominal_zero_hz : float
            Frequency at zero torque in Hz.
        relative_deviation : float
            Deviation at nominal torque, as a part of the zero's frequency.
        relative_modulation : float
            Valid deviation, likewise.

        Examples
        --------
        >>> FrequencyScale.symmetric(50.0).sensitivity_cw_hz_per_nm
        600.0
        >>> FrequencyScale.symmetric(50.0, 240e3).modulation_hz
        (60000.0, 420000.0)
        """
        sensitivity = nominal_zero_hz * relative_deviation / nominal_torque_nm
        return cls(
            nominal_torque_nm=nominal_torque_nm,
            nominal_zero_hz=nominal_zero_hz,
            sensitivity_cw_hz_per_nm=sensitivity,
            sensitivity_ccw_hz_per_nm=sensitivity,
            modulation_hz=(
                nominal_zero_hz * (1 - relative_modulation),
                nominal_zero_hz * (1 + relative_modulation),
            ),
        )

    @property
    def zero(self) -> float:
        """The zero in use in Hz: measured, or nominal if none is measured."""
        return self.nominal_zero_hz if self.zero_hz is None else self.zero_hz

    def with_zero(self, zero_hz: float) -> "FrequencyScale":
        """Return the scale with a newly measured zero in Hz."""
        return replace(self, zero_hz=float(zero_hz))

    def torque(self, frequency_hz: ArrayLike) -> NDArray[np.float64]:
        """Torque in N·m of frequencies in Hz, of any shape.

        Raises
        ------
        PulseTrainFault
            When a frequency is NaN or outside the modulation range.
        """
        frequency = np.asarray(frequency_hz, dtype=np.float64)
        outside = ~self._inside(frequency)
        if outside.any():
            raise PulseTrainFault(
                SignalFaultKind.OUT_OF_MODULATION,
                Message("frequency {flat:.9g} Hz", frequency[outside].flat[0]),
                Message(
                    "{lowest_hz:g} to {highest_hz:g} Hz",
                    self.modulation_hz[0],
                    self.modulation_hz[1],
                ),
            )
        return self._torque(frequency)

    def frequency(self, torque_nm: ArrayLike) -> NDArray[np.float64]:
        """Frequency in Hz of torques in N·m: the inverse of `torque`."""
        torque = np.asarray(torque_nm, dtype=np.float64)
        return np.asarray(self.zero + torque * self._sensitivity(torque))

    def readings(self, record: Record) -> Record:
        """Return a counter's windows with their torque: faults stay, the modulation is checked.

        Parameters
        ----------
        record : Record
            With `frequency_hz`, `frequency_uncertainty_hz` and `fault`.

        Returns
        -------
        Record
            The same with `reading_nm` and `counter_nm`, its standard uncertainty by counting; NaN
            at every fault, including those outside the modulation range.
        """
        inside = self._inside(record["frequency_hz"])
        if not np.logical_and.reduce(inside):
            record = record.marked(
                ~inside,
                SignalFaultKind.OUT_OF_MODULATION,
                "frequency_hz",
                "frequency_uncertainty_hz",
            )
        deviation = record["frequency_hz"] - self.zero
        sensitivity = self._sensitivity(deviation)
        return record.with_columns(
            reading_nm=deviation / sensitivity,
            counter_nm=record["frequency_uncertainty_hz"] / sensitivity,
        )

    def _inside(self, frequency: NDArray[np.float64]) -> NDArray[np.bool_]:
        low, high = self.modulation_hz
        return np.asarray((frequency >= low) & (frequency <= high))

    def _sensitivity(self, deviation: NDArray[np.float64]) -> NDArray[np.float64] | float:
        clockwise, other = self.sensitivity_cw_hz_per_nm, self.sensitivity_ccw_hz_per_nm
        return clockwise if clockwise == other else np.where(deviation < 0, other, clockwise)

    def _torque(self, frequency: NDArray[np.float64]) -> NDArray[np.float64]:
        deviation = frequency - self.zero
        return np.asarray(deviation / self._sensitivity(deviation))
