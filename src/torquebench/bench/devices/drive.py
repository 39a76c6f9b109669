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

from torquebench.bench.description import ModuleDescription
from torquebench.bench.devices.context import BenchContext
from torquebench.bench.interlocks import PlannedState, check_enable, check_set_point
from torquebench.bench.roles import Side
from torquebench.bench.state import Quantity, SetPoint
from torquebench.errors import InputError, LimitError
from torquebench.message import Message
from torquebench.units import RPM_PER_RAD_S

SHORTEST_SLICE_S = 0.1
"""Shortest slice of a ramp, s: half of it remains for the next command to arrive."""
SLICE_SHARE = 0.1
"""Largest share of the range by which a longer slice may change the set point."""


@dataclass(frozen=True)
class RampTo:
    """A torque or speed, and the rate at which it is approached.

    The rate influences the shape of a torque-angle loop, and a quick change of speed loads a
    transducer with the shafts' inertia.

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

    `set` checks the interlocks and limits, commands the drive and is done when the duration of the
    drive's ramp is over. It doesn't wait for the torque to settle: `SteadyTorque` does. `stop`
    ramps the drive to zero torque and zero speed: the run engine calls it on pause, abort and at
    the end of every plan.
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
        """Command the drive; done when the duration of its ramp is over.

        The drive itself ramps, at its own rate or at a lower rate of `RampTo`. In real time, a ramp
        is commanded in slices (see `slice_s`), each before the drive has reached the end of the
        previous one, so that a drive that loses its connection stops ramping. If the drive has
        power, the command is recorded before and after it is given.

        Raises
        ------
        InterlockError
            Clamp open, side not driven, alarm latched, drive off.
        LimitError
            The value is beyond the limits of the bench description or of the drive.
        BenchError
            The drive doesn't accept the command, which is an alarm.
        """
        context, quantity = self._context, self._quantity
        ramp = value if isinstance(value, RampTo) else RampTo(value, math.inf)
        check_set_point(context.state, self._side, quantity, ramp.target)
        commands = context.commands.side(self._side)
        module = context.description.module(self._side)
        rate = min(ramp.rate, module.drive.rate(quantity))
        # in fast time the bench stops without this computer anyway
        sliced = commands.enabled and not context.clock.fast
        part_s = slice_s(module, quantity, rate) if sliced else math.inf
        start = commands.value(quantity)
        way, done = abs(ramp.target - start), 0.0
        while True:
            ahead = done + rate * part_s
            last = ahead >= way
            target = ramp.target if last else start + math.copysign(ahead, ramp.target - start)
            told = await self._command(target, rate)
            acquired_s = context.clock.now()
            left_s = (way - done) / rate
            await context.clock.sleep_until(told.told_s + min(left_s, part_s / 2.0))
            superseded = commands.set_points[quantity] is not told
            if last or superseded:  # meanwhile a pause or a stop has commanded zero
                break
            # a simulated drive is as far as the samples, a real one is ahead of them
            clock = context.clock
            passed_s = min(clock.now() - acquired_s, clock.present() - told.told_s)
            done = min(ahead, done + rate * passed_s)
        await context.clock.sleep_until(told.told_s + left_s)

    def rehearse(self, planned: PlannedState, value: float | RampTo) -> float:
        """Ramp in the planned state; return the duration of the ramp, s."""
        ramp = value if isinstance(value, RampTo) else RampTo(value, math.inf)
        return planned.ramp(self._side, self._quantity, ramp.target, ramp.rate)

    async def _command(self, target: float, rate: float) -> SetPoint:
        """Command the drive if it has power, and record the command."""
        context, side, quantity = self._context, self._side, self._quantity
        commands, drive = context.commands.side(side), context.drivers.drives[side]
        before = commands.controls, commands.set_points[quantity]
        requested = commands.ask(quantity, target, rate, context.clock.now())
        if commands.enabled:
            tell = drive.command_torque if quantity == "torque" else drive.command_speed
            order = Message("go to {target:g} {unit}", target, self._unit)
            try:
                await context.tell_drive(side, order, tell, target, rate)
            except (InputError, LimitError):  # refused before the drive received it
                commands.withdraw(quantity, requested, before)
                raise
        # the samples so far end before the ramp
        confirmed = commands.told(quantity, requested, context.clock.present())
        present = commands.set_points[quantity]
        overtaken = present is not confirmed and present.value == 0.0 != target
        if overtaken and commands.enabled:
            # zero was commanded while this command was given, and takes precedence
            ramp_s = context.description.safety.ramp_to_zero_s
            await context.tell_drive(side, "go to zero", drive.ramp_to_zero, ramp_s)
        return confirmed

    async def stop(self, success: bool = True) -> None:
        """Ramp torque and speed to zero at the drive's own rates, without waiting for the end."""
        del success
        await self._context.call(self._context.supervisor.unload, (self._side,))

    async def locate(self) -> Location[float]:
        """Commanded set point."""
        value = self._present()
        return Location(setpoint=value, readback=value)


def slice_s(module: ModuleDescription, quantity: Quantity, rate: float) -> float:
    """Return the duration of a ramp's slices, s, by which a drive is commanded ahead.

    After a loss of the connection, the drive stops at the end of a slice. A slice is at most as
    long as the drive's watchdog time, and changes the set point by at most a tenth of the range
    unless that takes less than `SHORTEST_SLICE_S`.
    """
    speed = module.limits.speed_rpm / RPM_PER_RAD_S
    most = SLICE_SHARE * (module.range_nm if quantity == "torque" else speed)
    return min(module.drive.watchdog_s, max(SHORTEST_SLICE_S, most / rate))


class DriveSwitch(StandardReadable):
    """Power of a drive: `set(True)` enables it at zero torque, `set(False)` disables it."""

    def __init__(self, context: BenchContext, side: Side) -> None:
        self._context = context
        self._side = side
        commands = context.commands.side(side)
        with self.add_children_as_readables(StandardReadableFormat.HINTED_UNCACHED_SIGNAL):
            self.enabled, _ = soft_signal_r_and_setter(bool, getter=lambda: commands.enabled)
        super().__init__()

    @AsyncStatus.wrap
    async def set(self, value: bool) -> None:
        """Enable the drive at zero torque; or ramp to zero, disable it and read that back.

        Raises
        ------
        InterlockError
            Enabling while an alarm is latched.
        SignalFault
            Enabling while this side's torque signal is missing.
        BenchError
            The drive doesn't confirm that it was switched on or off; that is an alarm.
        """
        context, side = self._context, self._side
        commands = context.commands.side(side)
        if value:
            check_enable(context.state, side)
            commands.switching = True
            try:
                if not context.clock.fast:  # from the next block on, signals are checked often
                    await context.clock.sleep(context.description.counter.block_s)
                    check_enable(context.state, side)
                await self._enable()
            finally:
                commands.switching = False
            return
        await context.clock.sleep(await context.call(context.supervisor.unload, (side,)))
        if context.supervisor.alarm is not None:
            # the supervisor switches the power off when zero is read back; a drive that switches
            # off earlier raises an alarm
            return
        commands.off(
            context.clock.now()
        )  # recorded before: a drive that switches off by itself raises an alarm
        await self._disable()
        alarm = await context.call(context.supervisor.read_off, (side,))
        if alarm is not None:
            raise alarm.error()

    def rehearse(self, planned: PlannedState, value: bool) -> float:
        """Switch in the planned state, off after a ramp to zero; return the duration, s."""
        side, lasts_s = self._side, 0.0
        if value:
            check_enable(planned, side)
        else:
            lasts_s = planned.ramp(side, "torque", 0.0) + planned.ramp(side, "speed", 0.0)
        planned.power[side] = value
        return lasts_s

    async def _enable(self) -> None:
        """Switch the drive's power on, at zero torque; a drive that fails may still have power."""
        context, side = self._context, self._side
        commands = context.commands.side(side)
        try:
            await context.tell_drive(side, "switch on", context.drivers.drives[side].enable)
            commands.at_zero(context.clock.now())
            commands.on()
        except BaseException:
            await self._disable()
            raise

    async def _disable(self) -> None:
        """Switch the drive's power off; if that fails, it counts as still on."""
        context, side = self._context, self._side
        try:
            await context.call(context.drivers.drives[side].disable)
        except BaseException:
            context.commands.side(side).on()  # so that the supervisor continues to monitor it
            raise


class DriveDevice(Device):
    """The drive of one module: `torque` and `speed` axes and the `power` switch."""

    def __init__(self, context: BenchContext, side: Side) -> None:
        self.torque = DriveAxis(context, side, "torque")
        self.speed = DriveAxis(context, side, "speed")
        self.power = DriveSwitch(context, side)
        super().__init__()
