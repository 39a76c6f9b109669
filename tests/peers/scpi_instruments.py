"""A frequency counter and a read-out that speak SCPI, over bare sockets."""

import threading
import time
from collections.abc import Callable

from tests.peers.lines import LinePeer


class _Peer(LinePeer):
    """The common commands and the error queue."""

    plate = ""

    def __init__(self) -> None:
        super().__init__()
        self._errors: list[str] = []

    def answer(self, line: str) -> str | None:
        if line == "*IDN?":
            return self.plate
        if line == "SYST:ERR?":
            return self._errors.pop(0) if self._errors else '+0,"No error"'
        if line == "*CLS":
            self._errors.clear()
            return None
        answer = self.obey(line)
        if answer == "?":
            self._errors.append('-113,"Undefined header"')
            return None
        return answer

    def obey(self, line: str) -> str | None:
        """Obey or answer; "?" where the line is unknown."""
        raise NotImplementedError


class CounterPeer(_Peer):
    """A counter on one channel, whose n-th window has `first_hz + n` Hz.

    Without pulses a gate never closes, unless a time-out is set, as in a 53230A.
    """

    def __init__(self, first_hz: float, serial: str) -> None:
        super().__init__()
        self.plate = f"peer works,counter of its own,{serial},0.9"
        self.first_hz = first_hz
        self.begun: float | None = None
        self._gate_s = 1.0
        self._clock = "INT"
        self._handed = 0
        self.pulses = threading.Event()
        self.pulses.set()
        self.timeout_s: float | None = None

    def obey(self, line: str) -> str | None:
        word, _, argument = line.partition(" ")
        if word == "ABOR":
            self.begun = None
        elif word == "INIT":
            self.begun, self._handed = time.monotonic(), 0
        elif word == "SENS:FREQ:GATE:TIME":
            self._gate_s = float(argument)
        elif word == "SENS:ROSC:SOUR":
            self._clock = argument
        elif word == "SYST:TIM":
            self.timeout_s = float(argument)
        elif word == "SENS:ROSC:SOUR?":
            return self._clock
        elif word == "DATA:REM?" and self.begun is not None:
            first, count = self._handed, int(argument.removesuffix(",WAIT"))
            if not self.pulses.is_set() and not self.pulses.wait(self.timeout_s):
                return ",".join(["+9.91000000E+37"] * count)
            self._handed += count
            over = self.begun + self._handed * self._gate_s
            time.sleep(max(0.0, over - time.monotonic()))
            windows = range(first, self._handed)
            return ",".join(f"{self.first_hz + window:.6E}" for window in windows)
        elif word not in ("CONF:FREQ", "SENS:FREQ:MODE", "SENS:FREQ:GATE:SOUR") and not (
            word.endswith(":COUN")
        ):
            return "?"
        return None


class ReadoutPeer(_Peer):
    """An amplifier of two channels, a sample each 10 ms: `torque_nm`, and its opposite on 2.

    `clock` returns its time, s: the wall's, unless a test gives another.
    """

    plate = "peer works,amplifier of its own,SER-3,0.9"
    torque_nm = 12.5

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._handed = {1: 0, 2: 0}
        self._clock, self._since = clock, clock()

    def obey(self, line: str) -> str | None:
        if line not in ("FETC:ARR? (@1)", "FETC:ARR? (@2)"):
            return "?"
        channel = int(line[-2])
        there = int((self._clock() - self._since) / 0.01 + 1e-6)
        new, self._handed[channel] = there - self._handed[channel], there
        value = self.torque_nm if channel == 1 else -self.torque_nm
        return ",".join([f"{value:.4E}"] * new)
