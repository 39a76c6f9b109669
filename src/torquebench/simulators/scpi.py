"""SCPI instruments before the simulated bench: gap-free counters and a torque amplifier."""

from __future__ import annotations

import contextlib
import math
import socket
import threading
from abc import ABC, abstractmethod

import numpy as np

from torquebench.bench.drivers.base import Side
from torquebench.errors import BenchError
from torquebench.signals import EdgeBlock, FrequencyCounter
from torquebench.simulators.line_server import LineServer
from torquebench.simulators.misbehaviour import WireFaults
from torquebench.simulators.plant import EdgeTap, Plant

__all__ = ["ScpiAmplifier", "ScpiFrequencyCounter", "ScpiInstrument", "ScpiSimulator"]

NO_NUMBER = "9.91E37"
WAIT_S = 10.0


class ScpiInstrument(ABC):
    """What answers behind the lines.

    Parameters
    ----------
    model, serial : str
        For `*IDN?`.
    """

    def __init__(self, model: str, serial: str) -> None:
        self._plate = f"simulated,{model},{serial},1.0"
        self._errors: list[str] = []

    def answer(self, line: str, faults: WireFaults) -> str | None:
        """Obey or answer one line."""
        upper = line.upper()
        if upper == "*IDN?":
            return self._plate
        if upper == "SYST:ERR?":
            return self._errors.pop(0) if self._errors else '0,"No error"'
        try:
            return self.act(upper, faults)
        except (ValueError, IndexError):
            self._errors.append('-102,"Syntax error"')
            return None

    @abstractmethod
    def act(self, line: str, faults: WireFaults) -> str | None:
        """Obey or answer one line of this instrument's own; ValueError where it has none such."""

    def attended(self, begins: bool) -> None:  # noqa: B027 - most do not care
        """Note that a client came or went."""


class ScpiFrequencyCounter(ScpiInstrument):
    """One counter on one channel of the bench."""

    def __init__(self, plant: Plant, channel: str, serial: str) -> None:
        super().__init__("frequency counter", serial)
        self._plant = plant
        self._channel = channel
        self._lock = threading.Lock()
        self._gate_s = 0.01
        self._clock = "INT"
        self._tap: EdgeTap | None = None
        self._counter: FrequencyCounter | None = None
        self._started_tick = 0
        self._handed = 0
        self._readings: list[float] = []
        self._last: list[float] = []

    def attended(self, begins: bool) -> None:
        """Tell the plant that somebody reads."""
        self._plant.reading(begins)

    def act(self, line: str, faults: WireFaults) -> str | None:
        """Obey or answer."""
        word, _, argument = line.partition(" ")
        with self._lock:
            if word == "ABOR":
                self._stop()
            elif word == "INIT":
                self._begin()
            elif word == "SENS:FREQ:GATE:TIME":
                self._gate_s = float(argument)
            elif word == "SENS:ROSC:SOUR":
                self._clock = argument.strip()
            elif word == "SENS:ROSC:SOUR?":
                return self._clock
            elif word == "DATA:REM?":
                return self._remove(int(argument.partition(",")[0]), faults)
            elif word not in (
                "CONF:FREQ",
                "SENS:FREQ:MODE",
                "SENS:FREQ:GATE:SOUR",
                "SAMP:COUN",
                "TRIG:COUN",
                "*RST",
            ):
                raise ValueError(word)
        return None

    def _stop(self) -> None:
        if self._tap is not None:
            self._plant.release(self._tap)
            self._plant.counting(False)
        self._tap = self._counter = None
        self._readings = []

    def _begin(self) -> None:
        self._stop()
        timebase_hz = self._plant.bench.timebase_hz
        with self._plant.lock:
            self._plant.counting(True)
            self._started_tick = round(self._plant.now_s * timebase_hz)
            self._tap = self._plant.tap_edges(self._channel)
        self._counter = FrequencyCounter("regression", self._gate_s, timebase_hz)
        self._handed = 0

    def _remove(self, count: int, faults: WireFaults) -> str:
        if self._tap is None or self._counter is None:
            raise ValueError("not initiated")
        begun_s = self._started_tick / self._plant.bench.timebase_hz
        until_s = begun_s + (self._handed + count) * self._gate_s
        self._plant.require(until_s, WAIT_S)
        for block in self._tap.take():
            shifted = EdgeBlock(
                block.ticks - self._started_tick,
                block.start_tick - self._started_tick,
                block.stop_tick - self._started_tick,
                block.timebase_hz,
            )
            self._readings += self._counter.push(shifted).frequency_hz.tolist()
        taken, self._readings = self._readings[:count], self._readings[count:]
        self._handed += len(taken)
        if faults.frozen and self._last:
            taken = (self._last * count)[:count]
        else:
            self._last = taken[-1:]
        if faults.lying:
            taken = [1.05 * value for value in taken]
        return ",".join(_text(value) for value in taken)


class ScpiAmplifier(ScpiInstrument):
    """The amplifier of the mounted standard."""

    def __init__(self, plant: Plant) -> None:
        super().__init__("torque amplifier", "SIM-AMP-1")
        self._plant = plant
        self._handed: dict[Side, int] = {}
        self._frozen: dict[Side, float] = {}

    def act(self, line: str, faults: WireFaults) -> str | None:
        """Answer `FETC:ARR? (@n)` with the samples since the last one."""
        word, _, argument = line.partition(" ")
        if word != "FETC:ARR?":
            raise ValueError(word)
        sides: dict[str, Side] = {"(@1)": "input", "(@2)": "output"}
        side = sides.get(argument.strip())
        if side is None:
            raise ValueError(argument)
        count, torques = self._plant.torques(side)
        new = min(count - self._handed.get(side, 0), len(torques))
        self._handed[side] = count
        values = torques[len(torques) - new :]
        if faults.frozen:
            held = self._frozen.setdefault(side, values[-1] if values else math.nan)
            values = [held] * len(values)
        else:
            self._frozen.pop(side, None)
        if faults.lying:
            values = [-value for value in values]
        return ",".join(_text(value) for value in values)


def _text(value: float) -> str:
    return NO_NUMBER if not np.isfinite(value) else f"{value:.9E}"


class ScpiSimulator(LineServer):
    """A SCPI instrument on a TCP port.

    Parameters
    ----------
    instrument : ScpiInstrument
    faults : WireFaults
    host, port
        Port 0 takes a free one, which `port` then says.
    """

    def __init__(
        self, instrument: ScpiInstrument, faults: WireFaults, host: str, port: int
    ) -> None:
        self._instrument = instrument
        super().__init__(faults, host, port)

    def attend(self, connection: socket.socket) -> None:
        """Answer one client until it goes."""
        self._instrument.attended(True)
        try:
            with contextlib.suppress(OSError), connection.makefile("rb") as lines:
                for raw in lines:
                    line = raw.decode("ascii", "replace").strip()
                    answer = self._instrument.answer(line, self.faults) if line else None
                    if answer is None:
                        continue
                    data = self.faults.outgoing(answer.encode("ascii") + b"\n")
                    if data is not None:
                        connection.sendall(data)
        finally:
            with contextlib.suppress(BenchError):
                self._instrument.attended(False)
