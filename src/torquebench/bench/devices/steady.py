"""The torque of a settled step: the one detector that calibration and tests read."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import chain

import numpy as np
from bluesky.protocols import HasHints, Hints, Preparable, Reading, Triggerable
from event_model import DataKey
from numpy.typing import NDArray
from ophyd_async.core import AsyncConfigurable, AsyncReadable, AsyncStatus, Device

from torquebench.bench.active_chain import ActiveChain
from torquebench.bench.channels import described_transducer
from torquebench.bench.devices.context import BenchContext
from torquebench.bench.devices.data_keys import data_key
from torquebench.bench.roles import Side, reference_channel, torque_channel
from torquebench.chain import Torque
from torquebench.errors import InputError, SignalFault
from torquebench.message import Message
from torquebench.signals import Record, SteadyValue, steady_value
from torquebench.units import RPM_PER_RAD_S

FloatArray = NDArray[np.float64]

LEAST_WINDOWS = 8
SETTLING_SHARE = 0.6
"""Share of the windows, from the first one on, in which refused readings may come from a step that
is still settling."""

_ALWAYS = {
    "reading_nm": float,
    "reading_standard_error_nm": float,
    "reading_drift_nm_per_s": float,
    "zero_nm": float,
    "settled": bool,
    "samples": int,
    "commanded_nm": float,
    "speed_rpm": float,
    "temperature_c": float,
    "time_s": float,
}
SIGNALS = ("frequency_hz", "signal", "standard_frequency_hz", "standard_signal")
"""The transducers' signals: a frequency, or a value in the unit that the description states."""
_COMPENSATED = ("torque_nm", "torque_uncertainty_nm")
_OF_STANDARD = (
    "standard_nm",
    "standard_uncertainty_nm",
    "standard_drift_nm_per_s",
)
STEADY_FIELDS = (
    *_ALWAYS,
    *SIGNALS,
    *_COMPENSATED,
    *_OF_STANDARD,
    "standard_temperature_c",
    "true_torque_nm",
)
"""All fields of a steady value."""


def signal_of(reading: Mapping[str, float], prefix: str = "") -> float | None:
    """Return the signal in a steady value (of the standard with "standard_"); None without one."""
    names = (f"{prefix}frequency_hz", f"{prefix}signal")
    return next((float(reading[name]) for name in names if name in reading), None)


SETTINGS = {"settle_s": float, "window_s": float, "limit_s": float, "reference": bool}
"""Settings of `SteadySettings` that documents contain, with their types."""


@dataclass(frozen=True)
class SteadySettings:
    """Settings of a steady value.

    Parameters
    ----------
    settle_s : float
        Settling time of the step, counted from the last torque or speed command to this side, s. A
        step of a rapid staircase lasts `settle_s + window_s`.
    window_s : float
        Length of the averaging window, s.
    limit_s : float
        Longest additional time to wait for a window without a fault whose drift is within its
        standard error. After that the value is used anyway, with `settled = False`.
    period_s : float or None
        Period of a known ripple (one revolution); the mean is over whole periods.
    reference : bool
        Whether to read the mounted standard's torque over the same window.

    Raises
    ------
    InputError
        A negative time, or a window of zero length.
    """

    settle_s: float = 0.2
    window_s: float = 0.3
    limit_s: float = 0.0
    period_s: float | None = None
    reference: bool = False

    def __post_init__(self) -> None:
        if not (self.settle_s >= 0.0 and self.limit_s >= 0.0 and 0.0 < self.window_s < 3600.0):
            raise InputError(
                Message(
                    "settle {settle_s} s, window {window_s} s, limit {limit_s} s",
                    self.settle_s,
                    self.window_s,
                    self.limit_s,
                ),
                "times of at least 0 s and a window above 0 s",
            )


@dataclass(frozen=True)
class _Evaluated:
    """Steady value of one channel, with its mean signal under the name of its column."""

    steady: SteadyValue
    signal: float
    column: str


class SteadyTorque(Device, AsyncReadable, AsyncConfigurable, Triggerable, Preparable, HasHints):
    """Mean torque of one side over a settled window, with its standard error and drift.

    `prepare(SteadySettings(...))` sets the settings, `trigger()` waits in bench time and evaluates,
    `read()` returns fields of `STEADY_FIELDS`, which `torquebench.columns` describes (data key by
    `key(field)`):

    - always reading, zero, signal, set point, speed, temperature and bench time;
    - torque and its standard uncertainty by the whole chain, with an active model;
    - the standard's torque, signal and temperature, with `reference`;
    - the true torque over the settled window, on a simulated bench.

    A fault of the signal raises `SignalFault`, so that there is never a value without pulses. The
    compensated torque is the steady value of the stream's torque, not a compensated steady reading;
    `torque` holds it with the components of its uncertainty.
    """

    def __init__(self, context: BenchContext, side: Side, name: str = "") -> None:
        self._context = context
        self.side = side
        self._settings = SteadySettings()
        self._values: dict[str, float | int | bool] = {}
        self.torque: Torque | None = None
        self._taken = time.time()
        super().__init__(name=name)

    def key(self, field: str) -> str:
        """Event data key of a field."""
        return f"{self.name}-{field}"

    # -- taking a value ---------------------------------------------------------------------

    @AsyncStatus.wrap
    async def prepare(self, value: SteadySettings) -> None:
        """Set the settings of the following values."""
        if value.reference:
            self._context.acquisition.channel_of_standard(self.side)
        self._settings = value
        self._values, self.torque = {}, None

    @AsyncStatus.wrap
    async def trigger(self) -> None:
        """Wait in bench time until the step has settled and its window is full; evaluate.

        Raises
        ------
        SignalFault
            The reading or the standard has a fault that lasts longer than `limit_s`. After a
            shorter fault, a later window is used.
        TorquebenchError
            An alarm is latched; the error is its cause.
        """
        context, settings = self._context, self._settings
        context.supervisor.raise_if_latched()
        if settings.reference:
            context.acquisition.use_reference(self.side)
        commanded_s = context.commands.side(self.side).changed_s
        start_s = max(context.clock.now(), commanded_s + settings.settle_s)
        last_s, faulty = start_s + settings.limit_s, False
        while True:
            stop_s = start_s + settings.window_s
            await context.clock.sleep_until(stop_s)
            try:
                values = self._evaluate(start_s, stop_s)
            except SignalFault:
                if settings.limit_s > 0.0 and not faulty:
                    last_s = max(
                        last_s, stop_s
                    )  # after a short fault, a window without it may follow
                faulty = True
                if start_s >= last_s:
                    raise
            else:
                if values["settled"] or start_s >= last_s:
                    break
            start_s = min(start_s + settings.window_s / 2.0, last_s)
        self._values = values
        self._taken = time.time()

    def _evaluate(self, start_s: float, stop_s: float) -> dict[str, float | int | bool]:
        """Return the steady values and conditions of an interval by their data keys."""
        context, side = self._context, self.side
        acquisition, module = context.acquisition, context.description.module(side)
        reading = self._steady(torque_channel(side), start_s, stop_s)
        zero = acquisition.zero(torque_channel(side))
        commands = context.commands.side(side)
        speed_rad_s = math.nan
        if module.encoder is not None:
            speed_rad_s = acquisition.mean_speed_rad_s(side, start_s, stop_s)
        temperature_c = acquisition.temperature_c(module.temperature_probe)
        values: dict[str, float | int | bool] = {
            "reading_nm": reading.steady.value,
            "reading_standard_error_nm": reading.steady.standard_error,
            "reading_drift_nm_per_s": reading.steady.drift_per_s,
            "zero_nm": float(module.transducer.scale().torque(zero)),
            reading.column: reading.signal,
            "settled": reading.steady.settled,
            "samples": reading.steady.samples,
            "commanded_nm": commands.torque_nm,
            "speed_rpm": speed_rad_s * RPM_PER_RAD_S,
            "temperature_c": temperature_c,
            "time_s": (start_s + stop_s) / 2.0,
        }
        active = acquisition.compensation(side)
        if active is not None:
            self.torque = self._steady_torque(active, start_s, stop_s)
            values |= {
                "torque_nm": float(self.torque.value_nm[0]),
                "torque_uncertainty_nm": float(self.torque.standard_uncertainty_nm[0]),
            }
        if self._settings.reference:
            standard = self._steady(reference_channel(side), start_s, stop_s)
            values |= {
                "standard_nm": standard.steady.value,
                "standard_uncertainty_nm": standard.steady.standard_error,
                "standard_drift_nm_per_s": standard.steady.drift_per_s,
                f"standard_{standard.column}": standard.signal,
            }
            probe = self._standard_probe()
            if probe is not None:
                values["standard_temperature_c"] = acquisition.temperature_c(probe)
            values["settled"] = reading.steady.settled and standard.steady.settled
        truth = context.drivers.truth
        if truth is not None:
            used, half_s = reading.steady, context.description.counter.window_s / 2.0
            values["true_torque_nm"] = truth.true_torque(
                side, used.start_s - half_s, used.stop_s + half_s
            )
        return values

    def _steady(self, channel: str, start_s: float, stop_s: float) -> _Evaluated:
        """Return a channel's steady value in an interval."""
        record = self._context.acquisition.window(channel, start_s, stop_s)
        self._check_complete(channel, record, start_s, stop_s)
        steady = self._steady_value(record.time_s, record["reading_nm"])
        column = self._context.acquisition.channel(channel).column
        return _Evaluated(steady, float(record[column].mean()), column)

    def _steady_value(self, time_s: FloatArray, torque_nm: FloatArray) -> SteadyValue:
        """Return the steady value of torques, over whole periods of a known ripple."""
        return steady_value(
            time_s,
            torque_nm,
            period_s=self._settings.period_s,
            minimum_samples=min(LEAST_WINDOWS, time_s.size),
        )

    def _steady_torque(self, active: ActiveChain, start_s: float, stop_s: float) -> Torque:
        """Return the steady value of the stream's torque.

        Its standard error replaces the noise of its windows if it is larger. An error names windows
        without compensation, or the effect that refuses a reading.
        """
        compensated = active.window(start_s, stop_s)
        windows = self._least_windows(start_s, stop_s, torque_channel(self.side))
        if compensated is None or compensated[0].size < max(windows - active.late_windows, 2):
            raise SignalFault(
                Message(
                    "{windows} windows, of which {size} were compensated",
                    windows,
                    0 if compensated is None else compensated[0].size,
                ),
                "all of them",
                "repeat the measurement: the model has just been activated",
            )
        time_s, torque = compensated
        refused = np.flatnonzero(~torque.has_number)
        if refused.size:
            first = int(refused[-1]) + 1
            if first > SETTLING_SHARE * time_s.size:
                active.refuse(self.side, start_s, stop_s)
            time_s, torque = time_s[first:], torque.at(np.arange(first, time_s.size))
        steady = self._steady_value(time_s, torque.value_nm)
        used = (time_s >= steady.start_s) & (time_s <= steady.stop_s)
        mean = torque.at(np.flatnonzero(used)).mean()
        shift_nm = steady.value - float(mean.value_nm[0])
        return mean.steady(shift_nm, steady.standard_error, active.chain.steps_nm)

    def value_periods_s(self, *, reference: bool) -> dict[str, float]:
        """Return the time from one value to the next by channel; a read-out has a time of its own.

        Parameters
        ----------
        reference : bool
            Whether the mounted standard is read, too.
        """
        window_s, readout = (
            self._context.description.counter.window_s,
            self._context.drivers.reference,
        )
        periods = {torque_channel(self.side): window_s}
        if reference:
            period_s = window_s if readout is None else max(window_s, readout.period_s)
            periods[reference_channel(self.side)] = period_s
        return periods

    def _least_windows(self, start_s: float, stop_s: float, channel: str) -> int:
        period_s = self.value_periods_s(reference=True)[channel]
        return max(int((stop_s - start_s) / period_s + 1e-9) - 1, 2)

    def _check_complete(self, channel: str, record: Record, start_s: float, stop_s: float) -> None:
        """Refuse an interval in which windows of a channel are missing."""
        least = self._least_windows(start_s, stop_s, channel)
        if len(record) < least:
            raise SignalFault(
                Message(
                    "{channel}: {count} windows from {start:.3f} to {stop:.3f} s",
                    channel,
                    len(record),
                    start_s,
                    stop_s,
                ),
                Message("at least {limit}", least),
                "check that the counter delivers without gaps, or use a longer window",
            )

    # -- bluesky interface ------------------------------------------------------------------

    async def read(self) -> dict[str, Reading]:
        """Return the last value.

        Raises
        ------
        SignalFault
            Nothing was triggered since the last `prepare`.
        """
        if not self._values:
            raise SignalFault(
                Message("{name} was read before it was triggered", self.name), "trigger first"
            )
        return {
            self.key(field): Reading(value=value, timestamp=self._taken)
            for field, value in self._values.items()
        }

    async def describe(self) -> dict[str, DataKey]:
        """Describe the fields of a value that would be measured now."""
        return {
            self.key(field): data_key(
                f"bench://{self.side}/{field}", field, _ALWAYS.get(field, float)
            )
            for field in self._values or self._expected_fields()
        }

    def _expected_fields(self) -> tuple[str, ...]:
        """Return the data keys of a document with the present settings and mounting."""
        context = self._context
        conditions = {
            _COMPENSATED: context.acquisition.compensation(self.side) is not None,
            _OF_STANDARD: self._settings.reference,
            ("standard_temperature_c",): (
                self._settings.reference and self._standard_probe() is not None
            ),
            ("true_torque_nm",): context.drivers.truth is not None,
        }
        names = [("", torque_channel(self.side))]
        if self._settings.reference:
            names.append(("standard_", reference_channel(self.side)))
        mounting, readout = context.state.mounted(), context.drivers.reference is not None
        for prefix, name in names:
            transducer = described_transducer(name, context.description, mounting, readout)
            if transducer is not None:
                conditions[(prefix + transducer.scale().column,)] = True
        parts = (fields for fields, applies in conditions.items() if applies)
        return (*_ALWAYS, *chain.from_iterable(parts))

    def _standard_probe(self) -> str | None:
        """Return the name of the mounted standard's temperature probe; None without one."""
        standard = self._context.description.standard(self._context.state.mounted())
        return None if standard is None else standard.temperature_probe

    async def read_configuration(self) -> dict[str, Reading]:
        """Return the settings of the values."""
        return {
            self.key(field): Reading(value=getattr(self._settings, field), timestamp=self._taken)
            for field in SETTINGS
        }

    async def describe_configuration(self) -> dict[str, DataKey]:
        """Describe the settings."""
        return {
            self.key(field): data_key("plan://settings", field, kind)
            for field, kind in SETTINGS.items()
        }

    @property
    def hints(self) -> Hints:
        """Fields worth plotting."""
        return {"fields": [self.key("reading_nm")]}
