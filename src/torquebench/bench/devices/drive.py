"""The motor of a module: torque, speed and power."""

from __future__ import annotations

import math
from dataclasses import dataclass

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
from torquebench.bench.interlocks import check_enable, check_set_point
from torquebench.bench.roles import Side
from torquebench.bench.state import Quantity
from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["DriveAxis", "DriveDevice", "DriveSwitch", "RampTo"]


@dataclass(frozen=True)
class RampTo:
    """A torque or speed and the rate at which it is approached.

    The speed of a loop decides its shape, and a quick change of speed loads a transducer with the
    shafts' inertia.

    Parameters
    ----------
    target : float
        Target, N·m or rad/s.
    rate : float
        Rate, N·m/s or rad/s².

    Raises
    ------
    InputError
        A rate of 0 or less.
    """

    target: float
    rate: float

    def __post_init__(self) -> None:
        if not self.rate > 0.0:
            raise InputError(Message("a ramp at a rate of {rate:g}", self.rate), "a rate above 0")


class DriveAxis(StandardReadable, AsyncLocatable[float]):
    """Torque (N·m) or speed (rad/s) of a drive.

    `set` checks the interlocks and limits, commands the drive and is done when the drive's ramp
    has had its time. It doesn't wait for the torque to settle: `SteadyTorque` does. `stop` ramps
    the drive to zero torque and zero speed: the run engine calls it on pause, abort and at the
    end of every plan.
    """

    def __init__(self, context: BenchContext, side: Side, quantity: Quantity) -> None:
        self._context = context
        self._side = side
        self._quantity = quantity
        self._unit = "N·m" if quantity == "torque" else "rad/s"
        with self.add_children_as_readables(StandardReadableFormat.HINTED_UNCACHED_SIGNAL):
            self.setpoint, _ = soft_signal_r_and_setter(
                float, units=self._unit, getter=self._present
            )
        super().__init__()

    def _present(self) -> float:
        return self._context.commands.side(self._side).value(self._quantity)

    @AsyncStatus.wrap
    async def set(self, value: float | RampTo) -> None:
        """Command the drive; done when its ramp has had its time.

        The drive itself ramps, at its own rate or at a lower one of `RampTo`. A command is recorded
        before and after the drive gets it, if it has power.

        Raises
        ------
        InterlockError
            Clamp open, side not driven, alarm latched, drive off.
        LimitError
            The value is beyond the limits of the bench description.
        BenchError
            The drive doesn't obey, which is an alarm.
        """
        context, side, quantity = self._context, self._side, self._quantity
        ramp = value if isinstance(value, RampTo) else RampTo(value, math.inf)
        check_set_point(context.state, side, quantity, ramp.target)
        commands, drive = context.commands.side(side), context.drivers.drives[side]
        before = commands.value(quantity)
        rate = min(ramp.rate, context.description.module(side).drive.rate(quantity))
        commands.ask(quantity, ramp.target, rate, context.clock.now())
        if commands.enabled:
            tell = drive.command_torque if quantity == "torque" else drive.command_speed
            order = Message("go to {target:g} {unit}", ramp.target, self._unit)
            await context.tell_drive(side, order, tell, ramp.target, rate)
        told_s = context.clock.present()  # the samples so far end before the ramp
        commands.told(quantity, ramp.target, told_s)
        await context.clock.sleep_until(told_s + abs(ramp.target - before) / rate)

    async def stop(self, success: bool = True) -> None:
        """Bring torque and speed to zero at the drive's own rates, without waiting for it."""
        del success
        await self._context.call(self._context.supervisor.unload, (self._side,))

    async def locate(self) -> Location[float]:
        """Set point as commanded."""
        value = self._present()
        return Location(setpoint=value, readback=value)


class DriveSwitch(StandardReadable):
    """Power of a drive: `set(True)` enables it at zero torque, `set(False)` takes it off."""

    def __init__(self, context: BenchContext, side: Side) -> None:
        self._context = context
        self._side = side
        commands = context.commands.side(side)
        with self.add_children_as_readables(StandardReadableFormat.HINTED_UNCACHED_SIGNAL):
            self.enabled, _ = soft_signal_r_and_setter(bool, getter=lambda: commands.enabled)
        super().__init__()

    @AsyncStatus.wrap
    async def set(self, value: bool) -> None:
        """Enable the drive at zero torque, or ramp to zero, disable it and read that back.

        Raises
        ------
        InterlockError
            Enabling while an alarm is latched.
        SignalFault
            Enabling while this side's torque signal is missing.
        BenchError
            The drive doesn't confirm that it has power, or has none any more; that is an alarm.
        """
        context, side = self._context, self._side
        drive, commands = context.drivers.drives[side], context.commands.side(side)
        if value:
            check_enable(context.state, side)
            commands.switching = True
            try:
                await context.tell_drive(side, "switch on", drive.enable)
                commands.at_zero(context.clock.now())
                commands.on()
            except BaseException:  # a drive that failed to enable may still have power
                await self._take_off()
                raise
            finally:
                commands.switching = False
            return
        await context.clock.sleep(await context.call(context.supervisor.unload, (side,)))
        if context.supervisor.alarm is not None:
            # the supervisor takes the power off when zero is read back; a drive that switches off
            # earlier is an alarm
            return
        commands.off(context.clock.now())  # before: a drive that goes off by itself is an alarm
        await self._take_off()
        alarm = await context.call(context.supervisor.read_off, (side,))
        if alarm is not None:
            raise alarm.error()

    async def _take_off(self) -> None:
        context, side = self._context, self._side
        try:
            await context.call(context.drivers.drives[side].disable)
        except BaseException:
            context.commands.side(side).on()  # so that the supervisor continues watching it
            raise


class DriveDevice(Device):
    """The drive of one module: `torque` and `speed` axes and the `power` switch."""

    def __init__(self, context: BenchContext, side: Side) -> None:
        self.torque = DriveAxis(context, side, "torque")
        self.speed = DriveAxis(context, side, "speed")
        self.power = DriveSwitch(context, side)
        super().__init__()
