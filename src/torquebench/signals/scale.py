"""Scale from a transducer's signal to torque: measured zero, and one sensitivity per direction."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.signals.faults import PulseTrainFault, SignalFaultKind
from torquebench.signals.record import Record


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalScale:
    """Scale of a torque transducer whose signal is a frequency, a torque, a voltage or a ratio.

    M = (s − s₀)/S with S of the direction: S_cw where s ≥ s₀ (clockwise, positive torque) and
    S_ccw below. s₀ is the *measured* zero; the sensitivities come from the transducer's own
    certificate or the nominal values (60 kHz option: 15 Hz/(N·m) at 2 kN·m, 600 Hz/(N·m) at
    50 N·m).

    A timebase with a relative error δ multiplies every frequency by 1 + δ: with a nominal zero this
    shifts the torque by δ·s₀/S (2δ of full scale for 60 ± 30 kHz) and its gain by δ. A zero
    measured with the same clock removes the shift; calibrating and measuring with the same clock
    removes the gain error. A calibration is therefore valid for one counter, which must be
    recorded.

    Parameters
    ----------
    nominal_torque_nm : float
        Nominal torque (full scale) in N·m.
    nominal_zero : float
        Signal at zero torque by the data sheet.
    sensitivity_cw, sensitivity_ccw : float
        Sensitivity of the two directions per N·m, above 0.
    limits : (float, float)
        Lowest and highest valid signal; outside it a signal is a fault.
    measured_zero : float, optional
        Measured zero; without one, the nominal zero is used.
    unit : str
        Unit of the signal: Hz, N·m, V or mV/V.

    Raises
    ------
    InputError
        If a value isn't finite, a sensitivity isn't positive, or the zero is outside the limits.

    Examples
    --------
    >>> scale = SignalScale(
    ...     nominal_torque_nm=2000.0,
    ...     nominal_zero=60e3,
    ...     sensitivity_cw=15.0,
    ...     sensitivity_ccw=15.0,
    ...     limits=(15e3, 105e3),
    ... )
    >>> scale.torque([75e3, 45e3])
    array([ 1000., -1000.])
    >>> scale.with_zero(60_015.0).torque(60_015.0)
    array(0.)
    """

    nominal_torque_nm: float
    nominal_zero: float
    sensitivity_cw: float
    sensitivity_ccw: float
    limits: tuple[float, float]
    measured_zero: float | None = None
    unit: str = "Hz"

    def __post_init__(self) -> None:
        for name in ("nominal_torque_nm", "sensitivity_cw", "sensitivity_ccw"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise InputError(Message("{name} = {value}", name, value), "a finite value above 0")
        low, high = self.limits
        if not (-np.inf < low < high < np.inf) or (self.unit == "Hz" and low <= 0):
            raise InputError(
                Message("limits = {limits}", self.limits),
                "low < high, and above 0 for a frequency",
            )
        if not low <= self.zero <= high:
            raise InputError(
                Message("zero {zero} {unit}", self.zero, self.unit),
                Message("{low} to {high} {unit}", low, high, self.unit),
                "check the transducer's signal and unload it before zeroing",
            )

    @property
    def column(self) -> str:
        """Column of a record with the signal."""
        return "frequency_hz" if self.unit == "Hz" else "signal"

    @property
    def uncertainty_column(self) -> str:
        """Column of a record with the signal's standard uncertainty."""
        return "frequency_uncertainty_hz" if self.unit == "Hz" else "signal_uncertainty"

    @property
    def zero(self) -> float:
        """The zero in use: the measured zero, or the nominal one."""
        return self.nominal_zero if self.measured_zero is None else self.measured_zero

    def with_zero(self, zero: float) -> "SignalScale":
        """Return the scale with a newly measured zero."""
        return replace(self, measured_zero=float(zero))

    def torque(self, signal: ArrayLike) -> NDArray[np.float64]:
        """Return the torque in N·m for signals of any shape.

        Raises
        ------
        PulseTrainFault
            When a signal is NaN or outside its limits.
        """
        values = np.asarray(signal, dtype=np.float64)
        outside = ~self._inside(values)
        if outside.any():
            raise PulseTrainFault(
                SignalFaultKind.OUT_OF_MODULATION,
                Message("signal {flat:.9g} {unit}", values[outside].flat[0], self.unit),
                Message("{low:g} to {high:g} {unit}", *self.limits, self.unit),
            )
        deviation = values - self.zero
        return np.asarray(deviation / self._sensitivity(deviation))

    def signal(self, torque_nm: ArrayLike) -> NDArray[np.float64]:
        """Return the signal for torques in N·m: the inverse of `torque`."""
        torque = np.asarray(torque_nm, dtype=np.float64)
        return np.asarray(self.zero + torque * self._sensitivity(torque))

    def readings(self, record: Record) -> Record:
        """Return windows with their torque; a signal beyond the limits becomes a fault.

        Parameters
        ----------
        record : Record
            Record with the signal, its uncertainty and `fault`.

        Returns
        -------
        Record
            The record with `reading_nm` and its standard uncertainty `counter_nm` by the counter or
            amplifier; NaN at every fault.
        """
        names = self.column, self.uncertainty_column
        signal, (low, high) = record[names[0]], self.limits
        if signal.size == 1 and low <= (value := signal.item()) <= high:  # of a live block
            deviation = value - self.zero
            slope = self.sensitivity_ccw if deviation < 0.0 else self.sensitivity_cw
            return record.with_columns(
                reading_nm=np.array([deviation / slope]),
                counter_nm=np.array([record[names[1]].item() / slope]),
            )
        if not self._inside(signal).all():
            record = record.marked(~self._inside(signal), SignalFaultKind.OUT_OF_MODULATION, *names)
        deviations = record[names[0]] - self.zero
        sensitivity = self._sensitivity(deviations)
        return record.with_columns(
            reading_nm=deviations / sensitivity, counter_nm=record[names[1]] / sensitivity
        )

    def _inside(self, signal: NDArray[np.float64]) -> NDArray[np.bool_]:
        low, high = self.limits
        return np.asarray((signal >= low) & (signal <= high))

    def _sensitivity(self, deviation: NDArray[np.float64]) -> NDArray[np.float64] | float:
        clockwise, other = self.sensitivity_cw, self.sensitivity_ccw
        return clockwise if clockwise == other else np.where(deviation < 0, other, clockwise)
