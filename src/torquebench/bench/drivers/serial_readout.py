"""Displays and boards that send a value as text on a serial line, each with one channel."""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import AfterValidator, Field

from torquebench.bench.drivers.amplifiers import AmplifierOptions, ChannelName, answer_s, opened
from torquebench.bench.drivers.base import Identity
from torquebench.bench.drivers.lines import LineConnection, LineLink, LineOptions
from torquebench.bench.drivers.links import WireError
from torquebench.bench.drivers.plugins import DriverPlugin, InstrumentRequest
from torquebench.message import Message


def _pattern(text: str) -> str:
    """Return a regular expression that has a group `value`; refuse any other text."""
    try:
        expression = re.compile(text)
    except re.error as error:
        raise ValueError(f"not a regular expression: {error}") from error
    if "value" not in expression.groupindex:
        raise ValueError("without a group (?P<value>...)")
    return text


class DisplayOptions(LineOptions, AmplifierOptions):
    """Options of displays, one for each channel, all alike.

    `request` is sent to each display; without it they send by themselves. `pattern` finds the
    number in a line, `no_value` recognises a line without one. `scale` is the value of a number's
    unit in N·m, V or mV/V.
    """

    address: str = ""
    channels: Mapping[ChannelName, Annotated[str, Field(min_length=3, max_length=200)]] = Field(
        min_length=1
    )
    request: str = ""
    pattern: Annotated[str, AfterValidator(_pattern)] = (
        r"^\s*(?P<value>[+-]?\s*\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?)\s*(?:N\.?m)?\s*$"
    )
    no_value: str = r"^\W*(?:OL|OVER|ERR)?\W*$"
    terminator: Annotated[str, Field(min_length=1, max_length=4)] = "\n"
    scale: Annotated[float, Field(ge=-1e9, le=1e9)] = 1.0
    manufacturer: str = "unknown"
    model: str = "display"
    serial: Annotated[str, Field(min_length=1)]


class _Display(LineLink):
    def __init__(self, name: str, options: DisplayOptions, address: str, timeout_s: float) -> None:
        terminator = options.terminator.encode("ascii")
        at = options.model_copy(update={"address": address})
        super().__init__(name, at, timeout_s, terminator)
        self._display = options

    def _open(self) -> LineConnection:
        connection = super()._open()
        if not self._display.request:  # reception may begin within a line
            connection.receive(self.timeout_s)
        return connection

    def value(self) -> float:
        """Return the newest value; NaN if the display shows none."""
        return self.call(self._exchange)

    def _exchange(self, connection: LineConnection) -> float:
        """Return the newest value that the display states; NaN if it states that it has none."""
        options = self._display
        if options.request:
            connection.send(options.request)
        line = connection.receive(self.timeout_s)
        if not options.request:
            with contextlib.suppress(WireError):  # no newer complete line has arrived
                while True:
                    line = connection.receive(0.0)
        match = re.search(options.pattern, line)
        if match is not None:
            return options.scale * float(match["value"].replace(" ", "").replace(",", "."))
        if re.search(options.no_value, line):
            return math.nan
        raise WireError(Message("{line!r} doesn't match the pattern", line[:40]))


class SerialDisplays:
    """Displays, one for each channel."""

    def __init__(self, name: str, options: DisplayOptions, timeout_s: float) -> None:
        self._options = options
        self._displays = {
            channel: _Display(f"{name} of {channel}", options, address, timeout_s)
            for channel, address in options.channels.items()
        }

    def identity(self, role: str) -> Identity:
        """Return the described identity, because displays don't report theirs."""
        options = self._options
        details = {str(channel): address for channel, address in options.channels.items()}
        return Identity(role, options.manufacturer, options.model, options.serial, "", details)

    def values(self) -> Mapping[str, float]:
        """Request the values of all displays."""
        return {str(channel): display.value() for channel, display in self._displays.items()}

    def close(self) -> None:
        """Release the ports. A second call does nothing."""
        for display in self._displays.values():
            display.close()


def _open(request: InstrumentRequest) -> Any:
    options: DisplayOptions = request.read(DisplayOptions)
    displays = SerialDisplays("display", options, answer_s(request, options.timeout_s))
    return opened(displays, request, options)


PLUGIN = DriverPlugin("serial", {"counter": _open, "reference": _open})
"""Plug-in for `protocol = "serial"`."""
