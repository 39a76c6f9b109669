"""What every device of one bench shares."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import ParamSpec, TypeVar

from torquebench.bench.acquisition import Acquisition
from torquebench.bench.clock import BenchClock
from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.base import DriverSet
from torquebench.bench.interlocks import Interlocks
from torquebench.bench.safety import SafetySupervisor
from torquebench.bench.state import CommandState

__all__ = ["BenchContext"]

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


@dataclass(frozen=True)
class BenchContext:
    """The open bench below its devices."""

    description: BenchDescription
    drivers: DriverSet
    clock: BenchClock
    acquisition: Acquisition
    supervisor: SafetySupervisor
    interlocks: Interlocks
    commands: CommandState

    async def call(
        self,
        function: Callable[Arguments, Result],
        *args: Arguments.args,
        **kwargs: Arguments.kwargs,
    ) -> Result:
        """Call a driver, on a thread of its own where it may block."""
        if self.drivers.blocking:
            return await asyncio.to_thread(function, *args, **kwargs)
        return function(*args, **kwargs)
