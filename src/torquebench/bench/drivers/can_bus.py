"""A CAN bus of python-can, for the drives on it."""

from __future__ import annotations

from typing import Any

from pydantic import ConfigDict

from torquebench.bench.drivers.links import WireError
from torquebench.bench.drivers.plugins import Options, require_library


class BusOptions(Options):
    """Options of a CAN bus in python-can; further keys of the interface are passed on."""

    model_config = ConfigDict(extra="allow", frozen=True)

    interface: str = "socketcan"
    channel: str = "can0"
    host: str | None = None
    port: int | None = None

    @property
    def address(self) -> str:
        """Address for messages."""
        return f"{self.host}:{self.port}" if self.host else f"{self.interface} {self.channel}"

    def open(self, timeout_s: float) -> Any:
        """Open the bus; raises `OSError` or `WireError`."""
        can = require_library("can", "canopen")
        try:
            if self.interface == "socketcand" and self.host is not None and self.port is not None:
                module = require_library("torquebench.bench.drivers.socketcand_bus", "canopen")
                return module.SocketcandBus(self.channel, self.host, self.port, timeout_s)
            settings = {key: value for key, value in self.model_dump().items() if value is not None}
            return can.Bus(**settings)
        except (can.CanError, ValueError) as error:
            raise WireError(str(error)) from error
