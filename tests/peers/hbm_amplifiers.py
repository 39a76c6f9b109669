"""Amplifiers with HBM's interpreter, after the DMP41's interface description and the manuals of
MGCplus ("operation with computer or terminal") and PMX ("command set").

- A command ends with LF, CRLF, LFCR or a semicolon, an answer with CRLF. Small letters count.
- A query ends its name with a question mark. Every other command sets something and is answered
  with 0, or with ? if it isn't known or its parameters are wrong; SRB0 switches these answers off.
- On RS-232 the device listens only between CTRL-R (or CTRL-B) and CTRL-A.
- DMP41: CHS selects channels by a mask of bits; COF0 is the format "value, channel, status"; MSV?
  p1,p2 states p2 values of signal p1 of all selected channels, endlessly with p2 = 0, until STP.
  The status has bit 5 at overflow, bit 4 as the filter's warning, bits 0 to 3 for limit switches.
- MGCplus, PMX: PCS selects channels (slots), SPS their subchannels; RMV?214 states the gross values
  of the selected ones as value, channel, status. TEX sets the separator by its code.
"""

import threading
import time
from collections.abc import Callable
from typing import Literal

from tests.peers.lines import LinePeer

Value = Callable[[], tuple[float, int]]
PLATES = {
    "DMP41": "HBM,DMP41,4D:5B:B9:02:00:00,1.0.3.2",
    "MGCplus": "HBM,CP42,0,P4.20",
    "PMX": "HBM,PMX,0009E5004711,2.04",
}
REMOTE, TERMINAL, LOCAL = b"\x12", b"\x02", b"\x01"


class HbmPeer(LinePeer):
    """One amplifier; `values` has value and status by channel."""

    ends = rb"\r\n|\n\r|\n|;"
    ending = b"\r\n"

    def __init__(
        self, family: Literal["DMP41", "MGCplus", "PMX"], values: dict[int, Value], serial: bool
    ) -> None:
        super().__init__(serial=serial)
        self._family = family
        self.values = values
        self._serial = serial
        self._listens = not serial
        self._acknowledges = True
        self._selected = sorted(values)[:1]
        self._separator = ","
        self._format = 1
        self.streaming = False
        self.busy_s = 0.0

    def leave_streaming(self) -> None:
        """State values unasked from now on, until STP."""
        self.streaming = True

        def stream() -> None:
            while self.streaming:
                with self._lock:
                    self.write(b"999.0,1,0\r\n")
                time.sleep(0.01)

        threading.Thread(target=stream, daemon=True).start()

    def received(self, data: bytes) -> bytes:
        heard = b""
        for byte in (data[k : k + 1] for k in range(len(data))):
            if self._serial and byte in (REMOTE, TERMINAL):
                self._listens = True
            elif self._serial and byte == LOCAL:
                self._listens = False
            elif self._listens:
                heard += byte
        return heard

    def answer(self, line: str) -> str | None:
        line = line.upper().replace(" ", "")
        if "?" in line:
            name, _, parameters = line.partition("?")
            return self._query(name, parameters)
        name = line.rstrip("0123456789,-")
        known = self._set(name, line[len(name) :])
        return ("0" if known else "?") if self._acknowledges else None

    def _query(self, name: str, parameters: str) -> str:
        if name == "*IDN" or (name == "IDN" and self._family != "DMP41"):
            return PLATES[self._family]
        if name == "CHS" and self._family == "DMP41":
            return str(sum(1 << k - 1 for k in self._selected))
        signal, *count = parameters.split(",")
        if name == "MSV" and self._family == "DMP41" and signal in ("1", "13"):
            if count[:1] == ["0"]:
                self.leave_streaming()
            return self._stated()
        if name == "RMV" and self._family != "DMP41" and signal == "214":
            return self._stated()
        return "?"

    def _stated(self) -> str:
        time.sleep(self.busy_s)
        parts: list[str] = []
        for channel in self._selected:
            value, status = self.values[channel]()
            parts.append(f"{value:.6f}")
            if self._format == 0 or self._family != "DMP41":
                parts += [str(channel), str(status)]
        return self._separator.join(parts)

    def _set(self, name: str, text: str) -> bool:
        numbers = [int(part) for part in text.split(",")] if text else []
        dmp = self._family == "DMP41"
        if name == "SRB" and numbers and numbers[0] in (0, 1, 2):
            self._acknowledges = numbers[0] != 0
        elif name == "CHS" and dmp and numbers:
            chosen = [k for k in self.values if numbers[0] >> k - 1 & 1]
            if not chosen or sum(1 << k - 1 for k in chosen) != numbers[0]:
                return False
            self._selected = chosen
        elif name == "COF" and dmp and numbers and 0 <= numbers[0] <= 5:
            self._format = numbers[0]
        elif name == "STP" and dmp:
            self.streaming = False
        elif name == "PCS" and not dmp and numbers and set(numbers) <= set(self.values):
            self._selected = numbers
        elif name == "TEX" and not dmp and numbers:
            self._separator = chr(numbers[0])
        else:
            return name == "SPS" and not dmp and numbers == [1]
        return True
