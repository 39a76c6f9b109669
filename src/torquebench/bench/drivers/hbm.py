"""HBM's interpreter (PMX, DMP41, MGCplus) over TCP and RS-232: amplifiers of modules or standards.

Every setting command is answered with 0 or ?, every query with its values. A value comes with its
channel and a status.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field

from torquebench.bench.drivers.amplifiers import AmplifierOptions, ChannelName, answer_s, opened
from torquebench.bench.drivers.base import Identity
from torquebench.bench.drivers.lines import LineConnection, LineLink, LineOptions, SerialRate
from torquebench.bench.drivers.links import WireError
from torquebench.bench.drivers.plugins import DriverPlugin, InstrumentRequest
from torquebench.errors import BenchError
from torquebench.message import Message

REMOTE, LOCAL = b"\x12", b"\x01"
"""Control characters that begin and end remote control on RS-232."""
MOST_LEFT_OVER = 1000
"""Largest number of lines from an earlier session that are skipped before an acknowledgement."""
SETUP = {
    "DMP41": ("SRB1", "STP", "COF0", "CHS{mask}"),
    "MGCplus": ("SRB1", "TEX44", "PCS{channels}", "SPS{subchannel}"),
    "PMX": ("PCS{channels}", "SPS{subchannel}"),
}
READ = {"DMP41": "MSV?13", "MGCplus": "RMV?214", "PMX": "RMV?214"}
FAULTY = {"DMP41": 0xE0, "MGCplus": 0xFF, "PMX": 0xFF}
"""Bits of a status that make a value invalid; the lower bits of a DMP41 are limit switches."""
Channel = Annotated[int, Field(ge=1, le=24)]


class HbmOptions(LineOptions, AmplifierOptions):
    """Options of an amplifier; `setup`, `read` and `faulty` replace the commands of its family.

    `serial` is used for a device that can't report its own.
    """

    family: Literal["DMP41", "MGCplus", "PMX"]
    channels: Mapping[ChannelName, Channel] = Field(min_length=1)
    subchannel: Annotated[int, Field(ge=1, le=24)] = 1
    setup: tuple[str, ...] | None = None
    read: Annotated[str, Field(min_length=1)] | None = None
    faulty: Annotated[int, Field(ge=0, le=0xFFFF)] | None = None
    baud_rate: SerialRate = 38400


class HbmAmplifier(LineLink):
    """An amplifier whose selected channels are read together."""

    def __init__(self, name: str, options: HbmOptions, timeout_s: float) -> None:
        super().__init__(name, options, timeout_s, prologue=REMOTE, epilogue=LOCAL)
        self._hbm = options
        self._names = sorted(options.channels, key=lambda name: options.channels[name])
        self._faulty = FAULTY[options.family] if options.faulty is None else options.faulty

    def _open(self) -> LineConnection:
        """Connect and send the commands that select channels and format."""
        connection = super()._open()
        numbers = [self._hbm.channels[name] for name in self._names]
        values = {
            "mask": sum(1 << number - 1 for number in numbers),
            "channels": ",".join(map(str, numbers)),
            "subchannel": self._hbm.subchannel,
        }
        try:
            setup = SETUP[self._hbm.family] if self._hbm.setup is None else self._hbm.setup
            for command in setup:
                self._obeyed(connection, command.format(**values))
        except BaseException:
            connection.close()
            raise
        return connection

    def _obeyed(self, connection: LineConnection, command: str) -> None:
        """Send a command and wait for its 0; skip values that an earlier session requested."""
        connection.send(command)
        for _ in range(MOST_LEFT_OVER):
            answer = connection.receive(self.timeout_s)
            if answer == "0":
                return
            if answer == "?":
                raise BenchError(
                    Message(
                        "{name} at {address} refuses {command!r}", self.name, self.address, command
                    ),
                    "0, its acknowledgement",
                    "compare the channels and commands with the amplifier's manual",
                )
        raise WireError("values without end")

    def identity(self, role: str) -> Identity:
        """Request the identity; an older device reports neither serial number nor firmware."""
        answer = self.query("*IDN?")
        if answer == "?":
            answer = self.query("IDN?")
        fields = [part.strip().strip('"') for part in answer.split(",")]
        if len(fields) < 2 or answer in ("0", "?"):
            raise BenchError(
                Message(
                    "{name} at {address} identifies itself as {answer!r}",
                    self.name,
                    self.address,
                    answer[:60],
                ),
                "manufacturer,model,serial,firmware",
                "check that the address is the amplifier's",
            )
        manufacturer, model, serial, firmware = (*fields, "", "")[:4]
        serial = self._hbm.serial if serial in ("", "0") else serial
        return Identity(role, manufacturer, model, serial, firmware, {"address": self.address})

    def values(self) -> Mapping[str, float]:
        """Request the value of every channel; NaN if its status says that it is invalid."""
        line = self._hbm.read or READ[self._hbm.family]

        def exchange(connection: LineConnection) -> dict[str, float]:
            """Request all channels once; NaN for a channel whose status is faulty."""
            connection.send(line)
            answer = connection.receive(self.timeout_s)
            parts = [part.strip() for part in answer.split(",")]
            try:
                numbers = [float(part) for part in parts]
            except ValueError:
                raise WireError(
                    Message("{line} is answered with {answer!r}", line, answer[:40])
                ) from None
            if len(numbers) != 3 * len(self._names):
                raise WireError(
                    Message(
                        "{line} is answered with {count} numbers instead of value, channel and "
                        "status of {wanted} channels",
                        line,
                        len(numbers),
                        len(self._names),
                    )
                )
            states = [int(number) & self._faulty for number in numbers[2::3]]
            return {
                name: math.nan if state else value
                for name, value, state in zip(self._names, numbers[::3], states, strict=True)
            }

        return self.call(exchange)


def _open(request: InstrumentRequest) -> Any:
    options: HbmOptions = request.read(HbmOptions)
    name, limit_s = request.name, answer_s(request, options.timeout_s)
    return opened(HbmAmplifier(name, options, limit_s), request, options)


PLUGIN = DriverPlugin("hbm", {"counter": _open, "reference": _open})
"""Plug-in for `protocol = "hbm"`."""
