"""SCPI instruments of the simulated bench: gap-free counters and a torque amplifier."""

from __future__ import annotations

import contextlib
import math
import re
import socket
import threading
from abc import ABC
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from torquebench.bench.roles import Side
from torquebench.errors import BenchError
from torquebench.signals import EdgeBlock, FrequencyCounter
from torquebench.simulators.line_server import LineServer
from torquebench.simulators.misbehaviour import WireFaults
from torquebench.simulators.plant import EdgeTap, Plant

NO_NUMBER = "9.91E37"
WAIT_S = 10.0
ERRORS_KEPT = 20
MOST_READINGS = 1_000_000
SHORTEST_GATE_S, LONGEST_GATE_S = 1e-3, 1e3
ERRORS = {
    -104: "Data type error",
    -108: "Parameter not allowed",
    -109: "Missing parameter",
    -113: "Undefined header",
    -213: "Init ignored",
    -222: "Data out of range",
    -224: "Illegal parameter value",
    -230: "Data corrupt or stale",
    -350: "Queue overflow",
}
OPERATION_COMPLETE, POWER_ON = 1, 128
EVENT_OF_ERROR = {1: 32, 2: 16, 3: 8, 4: 4}
"""Bit of the event status register for the hundreds digit of an error: command, execution, device,
query."""
SUFFIXES = {"": 1.0, "S": 1.0, "MS": 1e-3, "US": 1e-6, "NS": 1e-9, "HZ": 1.0}
_NUMBER = re.compile(r"([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:E[+-]?[0-9]+)?) *([A-Z]*)")
Handler = Callable[[Sequence[str], WireFaults], str | None]


class _ScpiError(Exception):
    """An SCPI error by its number."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


def _header(pattern: str) -> re.Pattern[str]:
    """Compile a header as printed in manuals: capitals are its short form, brackets optional."""
    words = []
    for optional, word in re.findall(r"(\[?):?([A-Za-z]+):?\]?", pattern):
        short = "".join(letter for letter in word if letter.isupper())
        both = f"(?:{short}|{word.upper()}):"
        words.append(f"(?:{both})?" if optional else both)
    return re.compile("".join(words))


def _number(text: str, lowest: float, highest: float) -> float:
    """Return a number with its SI suffix; refuse another text or range."""
    match = _NUMBER.fullmatch(text)
    if match is None or match[2] not in SUFFIXES:
        raise _ScpiError(-104)
    value = float(match[1]) * SUFFIXES[match[2]]
    if not lowest <= value <= highest:
        raise _ScpiError(-222)
    return value


def _choice(text: str, words: Sequence[str]) -> str:
    """Return the short form of a keyword parameter, which may be given in either form."""
    for word in words:
        short = "".join(letter for letter in word if letter.isupper())
        if text in (short, word.upper()):
            return short
    raise _ScpiError(-224)


class ScpiInstrument(ABC):  # noqa: B024 - some have nothing else to do
    """An SCPI instrument: common commands of IEEE 488.2, an error queue, and headers.

    Headers may have their short or long form; several headers in a line are separated by
    semicolons, and a later one is relative to the path of the one before. The answers to one line
    are sent in one line.

    Parameters
    ----------
    model, serial : str
        For `*IDN?`.
    """

    def __init__(self, model: str, serial: str) -> None:
        self._plate = f"simulated,{model},{serial},1.0"
        self._errors: list[int] = []
        self._events = POWER_ON
        self._masks = {"*ESE": 0, "*SRE": 0}
        self._lock = threading.RLock()
        self._handlers: list[tuple[re.Pattern[str], bool, int, int, Handler]] = []
        self.serve("SYSTem:ERRor[:NEXT]", lambda _, __: self._next_error(), query=True)
        self.serve("SYSTem:ERRor:COUNt", lambda _, __: str(len(self._errors)), query=True)
        self.serve("SYSTem:VERSion", lambda _, __: "1999.0", query=True)

    def serve(
        self, pattern: str, handler: Handler, *, query: bool = False, least: int = 0, most: int = 0
    ) -> None:
        """Register a handler, with `least` to `most` parameters, for a header or its query.

        Examples
        --------
        >>> instrument = ScpiInstrument("any", "1")
        >>> instrument.serve("SENSe:FUNCtion", lambda _, __: "FREQ", query=True)
        >>> faults = WireFaults("any", None)
        >>> instrument.answer("SENS:FUNC?;:sense:function?;*OPC?", faults)
        'FREQ;FREQ;1'
        >>> instrument.answer("NONSENSE?", faults), instrument.answer("SYST:ERR?", faults)
        (None, '-113,"Undefined header"')
        """
        self._handlers.append((_header(pattern), query, least, most, handler))

    def answer(self, line: str, faults: WireFaults) -> str | None:
        """Execute or answer one line."""
        path, answers = "", []
        with self._lock:
            for unit in filter(None, (part.strip() for part in line.upper().split(";"))):
                header, _, text = unit.partition(" ")
                arguments = [part.strip() for part in text.split(",")] if text.strip() else []
                try:
                    if header.startswith("*"):
                        answer = self._common(header, arguments)
                    else:
                        full = header[1:] if header.startswith(":") else path + header
                        path = full.rpartition(":")[0] + ":" if ":" in full else ""
                        answer = self._act(full, arguments, faults)
                except _ScpiError as error:
                    self._note(error.code)
                    break
                if answer is not None:
                    answers.append(answer)
        return ";".join(answers) if answers else None

    def _act(self, header: str, arguments: list[str], faults: WireFaults) -> str | None:
        """Obey an instrument's own command; return the answer to a query."""
        asks = header.endswith("?")
        if faults.ignoring and not asks:
            return None
        for pattern, query, least, most, handler in self._handlers:
            if query == asks and pattern.fullmatch(header.removesuffix("?") + ":"):
                if len(arguments) < least:
                    raise _ScpiError(-109)
                if len(arguments) > most:
                    raise _ScpiError(-108)
                return handler(arguments, faults)
        raise _ScpiError(-113)

    def _common(self, header: str, arguments: list[str]) -> str | None:
        """Obey a common command of IEEE 488.2; return the answer to a query."""
        if header in self._masks:
            if not arguments:
                raise _ScpiError(-109)
            self._masks[header] = int(_number(arguments[0], 0, 255))
            return None
        if header.removesuffix("?") in self._masks:
            return str(self._masks[header.removesuffix("?")])
        if header == "*ESR?":
            events, self._events = self._events, 0
            return str(events)
        answers = {"*IDN?": self._plate, "*OPC?": "1", "*TST?": "0", "*STB?": str(self._status())}
        if header in answers:
            return answers[header]
        if header == "*CLS":
            self._errors.clear()
            self._events = 0
        elif header == "*OPC":
            self._events |= OPERATION_COMPLETE
        elif header == "*RST":
            self.reset()
        elif header != "*WAI":
            raise _ScpiError(-113)
        return None

    def _status(self) -> int:
        """Return the status byte of IEEE 488.2."""
        summary = bool(self._events & self._masks["*ESE"])
        status = (4 if self._errors else 0) | (32 if summary else 0)
        return status | (64 if status & self._masks["*SRE"] else 0)

    def _note(self, code: int) -> None:
        """Queue an error and set its event bit."""
        self._events |= EVENT_OF_ERROR[-code // 100]
        if len(self._errors) < ERRORS_KEPT:
            self._errors.append(code)
        else:
            self._errors[-1] = -350

    def _next_error(self) -> str:
        code = self._errors.pop(0) if self._errors else 0
        return f'{code},"{ERRORS.get(code, "No error")}"'

    def reset(self) -> None:  # noqa: B027 - most have nothing to reset
        """Reset to the power-on state."""

    def attended(self, begins: bool) -> None:  # noqa: B027 - most do not care
        """Record that a client connected or disconnected."""


class ScpiFrequencyCounter(ScpiInstrument):
    """One counter on one channel of the bench."""

    def __init__(self, plant: Plant, channel: str, serial: str) -> None:
        super().__init__("frequency counter", serial)
        self._plant = plant
        self._channel = channel
        self._tap: EdgeTap | None = None
        self._counter: FrequencyCounter | None = None
        self._started_tick = 0
        self._handed = 0
        self._readings: list[float] = []
        self._last: list[float] = []
        self.serve("ABORt", lambda _, __: self._stop())
        self.serve("INITiate[:IMMediate]", lambda _, __: self._begin())
        self.serve("DATA:REMove", self._remove, query=True, least=1, most=2)
        self.serve("DATA:POINts", lambda _, __: str(len(self._readings)), query=True)
        self._settings: dict[str, str] = {}
        self.serve("CONFigure:FREQuency", lambda _, __: self.reset(), most=2)
        count = "SAMPle:COUNt", "TRIGger:COUNt"
        for pattern in count:
            self._setting(pattern, lambda text: f"{_number(text, 1, MOST_READINGS):.0f}")
        self._setting(
            "[SENSe:]FREQuency:GATE:TIME",
            lambda text: f"{_number(text, SHORTEST_GATE_S, LONGEST_GATE_S):.9E}",
        )
        self._setting("SYSTem:TIMeout", lambda text: f"{_number(text, 1e-2, LONGEST_GATE_S):.9E}")
        for pattern, words in (
            ("[SENSe:]FREQuency:MODE", ("AUTO", "RECiprocal", "CONTinuous")),
            ("[SENSe:]FREQuency:GATE:SOURce", ("TIME", "EXTernal")),
            ("[SENSe:]ROSCillator:SOURce", ("INTernal", "EXTernal")),
        ):
            self._setting(pattern, partial(_choice, words=words))
        self.reset()

    def _setting(self, pattern: str, parse: Callable[[str], str]) -> None:
        """Serve a setting that can be written and queried."""

        def put(arguments: Sequence[str], _: WireFaults) -> None:
            """Store a setting, which stops the measurement."""
            value = parse(arguments[0])
            self._stop()
            self._settings[pattern] = value

        self.serve(pattern, put, least=1, most=1)
        self.serve(pattern, lambda _, __: self._settings[pattern], query=True)

    def reset(self) -> None:
        """Reset to the power-on state, except the reference clock."""
        self._stop()
        self._settings = {"[SENSe:]ROSCillator:SOURce": "INT"} | self._settings
        self._settings |= {
            "SYSTem:TIMeout": "9.9E+37",
            "SAMPle:COUNt": "1",
            "TRIGger:COUNt": "1",
            "[SENSe:]FREQuency:GATE:TIME": f"{0.1:.9E}",
            "[SENSe:]FREQuency:MODE": "AUTO",
            "[SENSe:]FREQuency:GATE:SOURce": "TIME",
        }

    def attended(self, begins: bool) -> None:
        """Tell the plant that the counter is being read."""
        self._plant.reading(begins)

    @property
    def _gate_s(self) -> float:
        return float(self._settings["[SENSe:]FREQuency:GATE:TIME"])

    def _stop(self) -> None:
        """Stop counting and forget the readings."""
        if self._tap is not None:
            self._plant.release(self._tap)
            self._plant.counting(False)
        self._tap = self._counter = None
        self._readings = []

    def _begin(self) -> None:
        """Start to count the channel's edges in gates."""
        if self._tap is not None:
            raise _ScpiError(-213)
        timebase_hz = self._plant.bench.timebase_hz
        with self._plant.lock:
            self._plant.counting(True)
            self._started_tick = round(self._plant.now_s * timebase_hz)
            self._tap = self._plant.tap_edges(self._channel)
        self._counter = FrequencyCounter("regression", self._gate_s, timebase_hz)
        self._handed = 0

    def _remove(self, arguments: Sequence[str], faults: WireFaults) -> str:
        """Return the wanted readings and remove them from the memory."""
        count = int(_number(arguments[0], 1, MOST_READINGS))
        waits = len(arguments) > 1 and _choice(arguments[1], ("WAIT",)) == "WAIT"
        if self._tap is None or self._counter is None:
            raise _ScpiError(-230)
        if waits:
            begun_s = self._started_tick / self._plant.bench.timebase_hz
            until_s = begun_s + (self._handed + count) * self._gate_s
            self._plant.require(until_s + faults.age_s(), WAIT_S)
        for block in self._tap.take():
            shifted = EdgeBlock(
                block.ticks - self._started_tick,
                block.start_tick - self._started_tick,
                block.stop_tick - self._started_tick,
                block.timebase_hz,
            )
            self._readings += self._counter.push(shifted)["frequency_hz"].tolist()
        if len(self._readings) < count:
            raise _ScpiError(-230)
        taken, self._readings = self._readings[:count], self._readings[count:]
        self._handed += len(taken)
        if faults.frozen and self._last:
            taken = (self._last * count)[:count]
        else:
            self._last = taken[-1:]
        factor = faults.scale * (1.05 if faults.lying else 1.0)
        return ",".join(_text(factor * value) for value in taken)


class ScpiAmplifier(ScpiInstrument):
    """The amplifier of the mounted standard."""

    def __init__(self, plant: Plant) -> None:
        super().__init__("torque amplifier", "SIM-AMP-1")
        self._plant = plant
        self._handed: dict[Side, int] = {}
        self._frozen: dict[Side, float] = {}
        self.serve("FETCh:ARRay", self._fetch, query=True, least=1, most=1)

    def _fetch(self, arguments: Sequence[str], faults: WireFaults) -> str:
        """Return the samples of a channel since the last query."""
        sides: dict[str, Side] = {"(@1)": "input", "(@2)": "output"}
        side = sides.get(arguments[0])
        if side is None:
            raise _ScpiError(-224)
        count, torques = self._plant.torques(side)
        late = round(faults.age_s() / self._plant.window_s)
        count, torques = count - late, torques[: len(torques) - late]
        new = max(0, min(count - self._handed.get(side, 0), len(torques)))
        self._handed[side] = max(count, self._handed.get(side, 0))
        values = torques[len(torques) - new :]
        if faults.frozen:
            held = self._frozen.setdefault(side, values[-1] if values else math.nan)
            values = [held] * len(values)
        else:
            self._frozen.pop(side, None)
        factor = -faults.scale if faults.lying else faults.scale
        return ",".join(_text(factor * value) for value in values)


def _text(value: float) -> str:
    return NO_NUMBER if not np.isfinite(value) else f"{value:.9E}"


class ScpiSimulator(LineServer):
    """A SCPI instrument on a TCP port.

    Parameters
    ----------
    host, port
        With port 0, a free port is chosen, which `port` then holds.
    """

    def __init__(
        self, instrument: ScpiInstrument, faults: WireFaults, host: str, port: int
    ) -> None:
        self._instrument = instrument
        super().__init__(faults, host, port)

    def attend(self, connection: socket.socket) -> None:
        """Answer one client until it disconnects."""
        self._instrument.attended(True)
        try:
            with contextlib.suppress(OSError), connection.makefile("rb") as lines:
                for raw in lines:
                    line = raw.decode("ascii", "replace").strip()
                    answer = self._instrument.answer(line, self.faults)
                    if answer is None:
                        continue
                    data = self.faults.outgoing(answer.encode("ascii") + b"\n")
                    if data is not None:
                        connection.sendall(data)
        finally:
            with contextlib.suppress(BenchError):
                self._instrument.attended(False)
