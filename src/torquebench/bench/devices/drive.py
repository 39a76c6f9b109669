"""The motor of a module: torque, speed and power."""

from __future__ import annotations

from bluesky.protocols import Location
from ophyd_async.core import (
    AsyncLocatable,
    AsyncStatus,
    Device,
    StandardReadable,
    StandardReadableFormat,
    soft_signal_r_and_setter,
)

from torquebench.bench.devices.context import BenchContext
from torquebench.bench.drivers.base import Side

__all__ = ["DriveAxis", "DriveDevice", "DriveSwitch"]

_STOP_RAMP_S = 0.2


class DriveAxis(StandardReadable, AsyncLocatable[float]):
    """Torque (N·m) or speed (rad/s) of a drive.

    `set` checks the interlocks and limits, commands the drive and is done when the drive's ramp
    has had its time. It doesn't wait for the torque to settle: `SteadyTorque` does. `stop` ramps
    the drive to zero torque and zero speed: the run engine calls it on pause, abort and at the
    end of every plan.

    Raises
    ------
    InterlockError
        Clamp open, side not driven, alarm latched, drive off.
    LimitError
        The value is beyond the limits of `bench.toml`.
    """

    def __init__(self, context: BenchContext, side: Side, quantity: str, name: str = "") -> None:
        self._context = context
        self._side = side
        self._quantity = quantity
        units = "N·m" if quantity == "torque" else "rad/s"
        with self.add_children_as_readables(StandardReadableFormat.HINTED_SIGNAL):
            self.setpoint, self._set_setpoint = soft_signal_r_and_setter(float, 0.0, units=units)
        super().__init__(name=name)

    @AsyncStatus.wrap
    async def set(self, value: float) -> None:
        """Command the drive; done when its ramp has had its time."""
        context, side = self._context, self._side
        drive = context.drivers.drives[side]
        module = context.description.module(side)
        before = await self.setpoint.get_value()
        if self._quantity == "torque":
            context.interlocks.check_torque(side, value)
            rate = module.drive.torque_rate_nm_per_s
            await context.call(drive.command_torque, value, rate)
        else:
            context.interlocks.check_speed(side, value)
            rate = module.drive.speed_rate_rad_per_s2
            await context.call(drive.command_speed, value, rate)
        context.acquisition.note_command(side, self._quantity, value)
        self._set_setpoint(value)
        await context.clock.sleep(abs(value - before) / rate)

    async def stop(self, success: bool = True) -> None:
        """Ramp torque and speed to zero."""
        del success
        drive = self._context.drivers.drives[self._side]
        await self._context.call(drive.ramp_to_zero, _STOP_RAMP_S)
        self._context.acquisition.note_command(self._side, self._quantity, 0.0)
        self._set_setpoint(0.0)

    async def locate(self) -> Location[float]:
        """Set point now and as commanded."""
        value = await self.setpoint.get_value()
        return Location(setpoint=value, readback=value)


class DriveSwitch(StandardReadable):
    """Power of a drive: `set(True)` enables it at zero torque, `set(False)` takes it off."""

    def __init__(self, context: BenchContext, side: Side, name: str = "") -> None:
        self._context = context
        self._side = side
        with self.add_children_as_readables(StandardReadableFormat.HINTED_SIGNAL):
            self.enabled, self._set_enabled = soft_signal_r_and_setter(bool, False)
        super().__init__(name=name)

    @AsyncStatus.wrap
    async def set(self, value: bool) -> None:
        """Enable or disable the drive.

        Raises
        ------
        InterlockError
            Enabling while an alarm is latched; disabling under load.
        """
        context, side = self._context, self._side
        drive = context.drivers.drives[side]
        if value:
            context.interlocks.check_enable(side)
            await context.call(drive.enable)
        else:
            context.interlocks.check_unloaded(side, "take the power off the drive")
            await context.call(drive.disable)
        context.interlocks.enabled[side] = value
        self._set_enabled(value)


class DriveDevice(Device):
    """The drive of one module: `torque` and `speed` axes and the `power` switch."""

    def __init__(self, context: BenchContext, side: Side, name: str = "") -> None:
        self.torque = DriveAxis(context, side, "torque")
        self.speed = DriveAxis(context, side, "speed")
        self.power = DriveSwitch(context, side)
        super().__init__(name=name)
