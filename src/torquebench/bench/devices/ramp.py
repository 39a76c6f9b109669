"""Torque at a rate of one's own: what loops, whose speed decides their shape, are driven with."""

from __future__ import annotations

from dataclasses import dataclass

from bluesky.protocols import Movable
from ophyd_async.core import AsyncStatus, Device

from torquebench.bench.devices.context import BenchContext
from torquebench.bench.roles import Side
from torquebench.bench.state import Quantity
from torquebench.errors import InputError

__all__ = ["RampTo", "TorqueRamp", "command"]


async def command(
    context: BenchContext, side: Side, quantity: Quantity, value: float, rate: float
) -> None:
    """Tell a drive where to go, if it has power, and note it before and after.

    Parameters
    ----------
    context : BenchContext
    side : {"input", "output"}
    quantity : {"torque", "speed"}
    value, rate : float
        N·m and N·m/s, or rad/s and rad/s².

    Raises
    ------
    BenchError
        The drive doesn't obey, which is an alarm.
    LimitError
        Beyond what the drive can do.
    """
    drive, commands = context.drivers.drives[side], context.commands.side(side)
    commands.ask(quantity, value, rate, context.clock.now())
    if commands.enabled:
        tell = drive.command_torque if quantity == "torque" else drive.command_speed
        unit = "N·m" if quantity == "torque" else "rad/s"
        await context.tell_drive(side, f"go to {value:g} {unit}", tell, value, rate)
    commands.told(quantity, value, context.clock.now())


@dataclass(frozen=True)
class RampTo:
    """A torque and the rate at which it is approached.

    Parameters
    ----------
    torque_nm : float
        Where the ramp ends, N·m.
    rate_nm_per_s : float
        How fast it goes there, N·m/s.

    Raises
    ------
    InputError
        A rate of 0 or less.
    """

    torque_nm: float
    rate_nm_per_s: float

    def __post_init__(self) -> None:
        if not self.rate_nm_per_s > 0.0:
            raise InputError(f"a ramp of {self.rate_nm_per_s} N·m/s", "a rate above 0 N·m/s")


class TorqueRamp(Device, Movable[RampTo]):
    """Uniform torque ramps of one drive; the drive itself ramps, at most as fast as described.

    `set(RampTo(...))` checks the interlocks and limits, commands the drive and is done when the
    ramp has had its time.
    """

    def __init__(self, context: BenchContext, side: Side) -> None:
        self._context = context
        self._side = side
        super().__init__()

    @AsyncStatus.wrap
    async def set(self, value: RampTo) -> None:
        """Ramp the torque.

        Raises
        ------
        InterlockError
            Clamp open, side not driven, alarm latched, drive off.
        LimitError
            The torque is beyond the limits of the bench description.
        """
        context, side = self._context, self._side
        before = context.commands.side(side).torque_nm
        context.interlocks.check_torque(side, value.torque_nm)
        fastest = context.description.module(side).drive.torque_rate_nm_per_s
        rate = min(value.rate_nm_per_s, fastest)
        await command(context, side, "torque", value.torque_nm, rate)
        await context.clock.sleep(abs(value.torque_nm - before) / rate)
