"""Torque and speed ramps at a given rate.

The speed of a loop decides its shape, and a quick change of speed loads a transducer with the
shafts' inertia.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from bluesky.protocols import Movable
from ophyd_async.core import AsyncStatus, Device

from torquebench.bench.devices.context import BenchContext
from torquebench.bench.interlocks import check_set_point
from torquebench.bench.roles import Side
from torquebench.bench.state import Quantity
from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["DriveRamp", "RampTo", "go_to"]


async def go_to(
    context: BenchContext,
    side: Side,
    quantity: Quantity,
    target: float,
    rate: float = math.inf,
) -> None:
    """Bring a drive to a torque or speed; done when its ramp has had its time.

    It is recorded before and after the drive is commanded, if it has power.

    Parameters
    ----------
    context : BenchContext
    side : {"input", "output"}
    quantity : {"torque", "speed"}
    target : float
        N·m or rad/s.
    rate : float
        At most, and at most as fast as described, N·m/s or rad/s².

    Raises
    ------
    InterlockError
        Clamp open, side not driven, alarm latched, drive off.
    LimitError
        The target is beyond the limits of the bench description.
    BenchError
        The drive doesn't obey, which is an alarm.
    """
    check_set_point(context.state, side, quantity, target)
    commands, drive = context.commands.side(side), context.drivers.drives[side]
    tell: Callable[[float, float], None]
    if quantity == "torque":
        tell, unit = drive.command_torque, "N·m"
    else:
        tell, unit = drive.command_speed, "rad/s"
    before = commands.value(quantity)
    rate = min(rate, context.description.module(side).drive.rate(quantity))
    commands.ask(quantity, target, rate, context.clock.now())
    if commands.enabled:
        await context.tell_drive(
            side, Message("go to {target:g} {unit}", target, unit), tell, target, rate
        )
    told_s = context.clock.present()  # the samples so far end before the ramp
    commands.told(quantity, target, told_s)
    await context.clock.sleep_until(told_s + abs(target - before) / rate)


@dataclass(frozen=True)
class RampTo:
    """A torque or speed and the rate at which it is approached.

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


class DriveRamp(Device, Movable[RampTo]):
    """Uniform ramps of torque or speed; the drive itself ramps, at most as fast as described.

    `set(RampTo(...))` checks the interlocks and limits, commands the drive and is done when the
    ramp has had its time.
    """

    def __init__(self, context: BenchContext, side: Side, quantity: Quantity) -> None:
        self._context = context
        self._side = side
        self._quantity = quantity
        super().__init__()

    @AsyncStatus.wrap
    async def set(self, value: RampTo) -> None:
        """Ramp the torque or the speed.

        Raises
        ------
        InterlockError
            Clamp open, side not driven, alarm latched, drive off.
        LimitError
            The target is beyond the limits of the bench description.
        """
        await go_to(self._context, self._side, self._quantity, value.target, value.rate)
