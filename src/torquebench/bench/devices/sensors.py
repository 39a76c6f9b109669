"""Readings beside the steady torque: transducer, mounted standard, encoder, temperature."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

from ophyd_async.core import (
    AsyncStatus,
    StandardReadable,
    StandardReadableFormat,
    soft_signal_r_and_setter,
)

from torquebench.bench.devices.context import BenchContext
from torquebench.bench.interlocks import standard_serial
from torquebench.bench.roles import Side, reference_channel, torque_channel


class MeasuredZero(NamedTuple):
    """Signal of an unloaded transducer, and the standard uncertainty of this zero, N·m."""

    signal: float
    standard_uncertainty_nm: float


class Zero(StandardReadable):
    """Zero of a transducer: `set(MeasuredZero(...))` changes it, `signal` is the one in use."""

    def __init__(self, context: BenchContext, channel: str) -> None:
        self._context = context
        self._channel = channel
        with self.add_children_as_readables(StandardReadableFormat.CONFIG_SIGNAL):
            self.signal, _ = soft_signal_r_and_setter(
                float, getter=lambda: context.acquisition.zero(channel)
            )
        super().__init__()

    @AsyncStatus.wrap
    async def set(self, value: MeasuredZero) -> None:
        """Use this signal as the zero.

        Raises
        ------
        SignalFault
            The zero deviates too much from the nominal zero.
        """
        self._context.acquisition.set_zero(
            self._channel, value.signal, value.standard_uncertainty_nm
        )


class Transducer(StandardReadable):
    """Torque transducer of a module: latest reading and identity."""

    def __init__(self, context: BenchContext, side: Side) -> None:
        transducer = context.description.module(side).transducer
        channel = torque_channel(side)
        with self.add_children_as_readables(StandardReadableFormat.HINTED_UNCACHED_SIGNAL):
            self.reading_nm, _ = soft_signal_r_and_setter(
                float, units="N·m", getter=lambda: context.acquisition.reading_nm(channel)
            )
        with self.add_children_as_readables(StandardReadableFormat.CONFIG_SIGNAL):
            self.serial, _ = soft_signal_r_and_setter(str, transducer.serial)
            self.nominal_torque_nm, _ = soft_signal_r_and_setter(
                float, transducer.nominal_torque_nm, units="N·m"
            )
            self.counter, _ = soft_signal_r_and_setter(str, context.drivers.counter.clock_identity)
        with self.add_children_as_readables():
            self.zero = Zero(context, channel)
        super().__init__()


class Reference(StandardReadable):
    """The mounted standard (calibrator or verification standard): latest torque of each side."""

    def __init__(self, context: BenchContext) -> None:
        acquisition = context.acquisition
        with self.add_children_as_readables(StandardReadableFormat.UNCACHED_SIGNAL):
            self.serial, _ = soft_signal_r_and_setter(
                str, getter=lambda: standard_serial(context.state)
            )
            self.input_nm, _ = soft_signal_r_and_setter(
                float,
                units="N·m",
                getter=lambda: acquisition.reading_nm(reference_channel("input")),
            )
            self.output_nm, _ = soft_signal_r_and_setter(
                float,
                units="N·m",
                getter=lambda: acquisition.reading_nm(reference_channel("output")),
            )
        with self.add_children_as_readables():
            self.input_zero = Zero(context, reference_channel("input"))
            self.output_zero = Zero(context, reference_channel("output"))
        super().__init__()


class Encoder(StandardReadable):
    """Angle (rad, unwrapped) and speed (rad/s) of one side."""

    def __init__(self, context: BenchContext, side: Side) -> None:
        acquisition = context.acquisition
        with self.add_children_as_readables(StandardReadableFormat.HINTED_UNCACHED_SIGNAL):
            self.angle_rad, _ = soft_signal_r_and_setter(
                float, units="rad", getter=lambda: acquisition.angle_rad(side)
            )
            self.speed_rad_s, _ = soft_signal_r_and_setter(
                float, units="rad/s", getter=lambda: acquisition.speed_rad_s(side)
            )
        super().__init__()


class TemperatureProbes(StandardReadable):
    """All temperature probes, °C."""

    def __init__(self, context: BenchContext) -> None:
        for probe in context.description.temperatures:
            with self.add_children_as_readables(StandardReadableFormat.HINTED_UNCACHED_SIGNAL):
                signal, _ = soft_signal_r_and_setter(
                    float,
                    units="°C",
                    getter=partial(context.acquisition.temperature_c, probe),
                )
                setattr(self, f"{probe}_c", signal)
        super().__init__()
