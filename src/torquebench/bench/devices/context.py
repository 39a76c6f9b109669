"""Objects that all devices of a bench share."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import ParamSpec, TypeVar

from torquebench.bench.acquisition import Acquisition
from torquebench.bench.clock import BenchClock
from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.base import DriverSet
from torquebench.bench.interlocks import BenchState
from torquebench.bench.roles import Side
from torquebench.bench.safety import AlarmKind, SafetySupervisor
from torquebench.bench.state import CommandState
from torquebench.errors import BenchError
from torquebench.message import Message

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


@dataclass(frozen=True)
class BenchContext:
    """The open bench that the devices use: drivers, acquisition, supervisor and clock."""

    description: BenchDescription
    drivers: DriverSet
    clock: BenchClock
    acquisition: Acquisition
    supervisor: SafetySupervisor
    state: BenchState
    commands: CommandState

    async def call(
        self,
        function: Callable[Arguments, Result],
        *args: Arguments.args,
        **kwargs: Arguments.kwargs,
    ) -> Result:
        """Call a driver, in a thread of its own if it may block."""
        if self.drivers.blocking:
            return await asyncio.to_thread(function, *args, **kwargs)
        return function(*args, **kwargs)

    async def tell_drive(
        self,
        side: Side,
        what: str,
        order: Callable[Arguments, None],
        *args: Arguments.args,
        **kwargs: Arguments.kwargs,
    ) -> None:
        """Command a drive; a failure raises an alarm, because the drive's state is then unknown.

        Parameters
        ----------
        side : {"input", "output"}
        what : str
            The command in words, to follow "commanded to".
        order : callable
            The drive's method, followed by its arguments.

        Raises
        ------
        BenchError
            The drive's error, after the alarm.
        """
        try:
            await self.call(order, *args, **kwargs)
        except BenchError as failure:
            if (
                self.supervisor.alarm is None
            ):  # a failure may be the reason why it was just switched off
                message = Message(
                    "{side} drive, commanded to {what}: {found}", side, what, failure.found
                )
                trip, kind = self.supervisor.trip, AlarmKind.DRIVE_FAULT
                await self.call(trip, kind, side, message, failure.allowed, failure.remedy)
            raise
