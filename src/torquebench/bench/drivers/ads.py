"""A Beckhoff TwinCAT PLC by ADS (pyads): variables by their names, several in one request."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from pydantic import Field

from torquebench.bench.drivers.links import WireError
from torquebench.bench.drivers.plc import PlcLink, PlcOptions, plc_plugin
from torquebench.bench.drivers.plugins import require_library
from torquebench.errors import BenchError
from torquebench.message import Message
from torquebench.units import MS_PER_S

CYCLES = "TwinCAT_SystemInfoVarList._TaskInfo[1].CycleCount"
"""TwinCAT's own counter of the first task's cycles."""
NO_SYMBOL, NO_SUCH_TYPE = 1808, 1809
Symbol = Annotated[str, Field(min_length=1, max_length=255, description="such as GVL.fTorque")]


class AdsOptions(PlcOptions):
    """Address of a PLC: AMS Net ID and port, and the computer where its router runs."""

    address: Annotated[
        str, Field(pattern=r"^\d+(\.\d+){5}:\d+$", description="such as 5.23.11.7.1.1:851")
    ]
    host: Annotated[str, Field(min_length=1, description="name or IP address")]


class AdsLink(PlcLink):
    """A TwinCAT runtime."""

    def __init__(self, name: str, options: AdsOptions, timeout_s: float) -> None:
        super().__init__(name, f"{options.address} on {options.host}", timeout_s)
        self._options = options
        self._ads = require_library("pyads", "ads")

    def _open(self) -> Any:
        """Connect to the PLC's ADS router."""
        net_id, _, port = self._options.address.partition(":")
        connection = self._ads.Connection(net_id, int(port), self._options.host)
        try:
            connection.open()
            connection.set_timeout(round(self.timeout_s * MS_PER_S))
        except (self._ads.ADSError, OSError, ValueError) as error:
            raise WireError(str(error)) from error
        return connection

    def _close(self, connection: Any) -> None:
        connection.close()

    def _asked(self, question: Any, *arguments: Any) -> Any:
        """Return the PLC's answer to a question; translate the library's errors."""
        try:
            return question(*arguments)
        except self._ads.ADSError as error:
            if error.err_code in (NO_SYMBOL, NO_SUCH_TYPE):
                raise BenchError(
                    Message("{name} has no variable {node}", self.name, arguments[0]),
                    "variables of the PLC's program",
                    "copy the name from TwinCAT, and start the program",
                ) from error
            raise WireError(str(error)) from error
        except (ValueError, KeyError, IndexError, TypeError, struct.error) as error:
            raise WireError(Message("garbled answer ({error})", error)) from error

    def _read(self, connection: Any, names: Sequence[str]) -> list[float]:
        values = self._asked(connection.read_list_by_name, list(names))
        return [self._number(name, values[name]) for name in names]

    def _number(self, name: str, value: Any) -> float:
        """Return a variable's value as a float; refuse one that isn't a number."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise BenchError(
                Message("{node} of {name} states {number!r}", name, self.name, value),
                "a number",
                "choose the variable of the scaled value",
            )
        return float(value)

    def _write(self, connection: Any, values: Mapping[str, float]) -> None:
        """Write all values by one request; any refusal is an error."""
        answers = self._asked(connection.write_list_by_name, dict(values))
        refused = {name: text for name, text in answers.items() if text != "no error"}
        for name, text in refused.items():
            raise WireError(f"{name}: {text}")

    def _plate(self, connection: Any) -> tuple[str, str, str]:
        model, version = self._asked(connection.read_device_info)
        return "Beckhoff", str(model), f"{version.version}.{version.revision}.{version.build}"

    def fields(self, structure: str, types: Mapping[str, str], first: int = 0) -> dict[str, str]:
        """Return the variable of each field: a member of the structure."""
        del first
        return {name: f"{structure}.{name}" for name in types}


PLUGIN = plc_plugin(
    "ads", AdsOptions, Symbol, Annotated[str, Field(default=CYCLES, min_length=1)], AdsLink
)
"""Plug-in for `protocol = "ads"`."""
