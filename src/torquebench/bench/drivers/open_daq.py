"""openDAQ devices (HBK, Dewesoft and others): torque channels as sampled frequencies.

The device counts by itself and streams samples: frequencies in Hz, or values in any unit with
`scale_hz` and `offset_hz`. All channels are read together, aligned by their common domain (the
device's clock).
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Mapping
from functools import partial
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from torquebench.bench.blocks import Block
from torquebench.bench.description import CounterDescription
from torquebench.bench.drivers.base import Identity
from torquebench.bench.drivers.counters import LibraryCounter, counted
from torquebench.bench.drivers.links import TimeOut
from torquebench.bench.drivers.plugins import (
    DriverPlugin,
    InstrumentRequest,
    Options,
    require_library,
)
from torquebench.errors import BenchError, InputError
from torquebench.message import Message
from torquebench.units import MS_PER_S

SHORTEST_POLL_MS = 20
HERTZ = {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6}


class SignalOptions(Options):
    """One signal of the device: the end of its path, and the scale of its values to Hz.

    Without `scale_hz` the signal's own unit is used, which must be Hz, kHz or MHz.
    """

    signal: Annotated[str, Field(min_length=1)]
    scale_hz: Annotated[float, Field(gt=0.0, le=1e9, description="Hz a unit")] | None = None
    offset_hz: Annotated[float, Field(ge=-1e9, le=1e9, description="Hz")] = 0.0


class OpenDaqOptions(Options):
    """A device by its connection string, such as `daq.nd://192.168.0.20`."""

    address: Annotated[str, Field(pattern=r"^[a-z.]+://.+$", description="connection string")]
    channels: Mapping[
        Literal["input_torque", "output_torque", "input_reference", "output_reference"],
        SignalOptions,
    ] = Field(min_length=2)
    resolution_hz: Annotated[float, Field(gt=0.0, le=100.0, description="Hz")] = 1e-3
    timeout_s: TimeOut = 2.0


class OpenDaqCounter(LibraryCounter):
    """Torque channels of one openDAQ device, averaged over the counter's windows.

    It reads no encoders: the bench needs a section `[driver.angles]`.

    Raises
    ------
    BenchError
        The device can't be reached.
    InputError
        The device has no such signal, or none that can be read as a frequency.
    """

    def __init__(self, options: OpenDaqOptions, counting: CounterDescription) -> None:
        super().__init__(
            counting,
            options.channels,
            f"openDAQ device at {options.address}",
            (RuntimeError, AttributeError, KeyError),
            "check power, network and connection string of the device",
        )
        self._options = options
        self._library = require_library("opendaq", "opendaq")
        self._selected = frozenset(self._served)
        self._reader: Any = None
        self._device: Any = None
        self._next_tick: int | None = None
        self._windows = 0
        builder = self._library.InstanceBuilder()
        builder.global_log_level = self._library.LogLevel.Off
        self._instance = builder.build()
        try:
            self._connect()
        except BaseException:
            self.close()
            raise

    def _connect(self) -> None:
        """Connect to the device and read its signals' scales, sample rate and name plate."""
        address = self._options.address
        self._device = self._ask(lambda: self._instance.add_device(address))
        devices = {
            str(signal.global_id): signal
            for signal in self._ask(lambda: self._device.signals_recursive)
        }
        self._signals = [self._signal(devices, name) for name in self._served]
        self._scales = [self._scale(name) for name in range(len(self._served))]
        domain = self._signals[0].domain_signal.descriptor
        resolution = domain.tick_resolution
        self._tick_s = float(resolution.numerator) / float(resolution.denominator)
        self._delta = int(domain.rule.parameters["delta"])
        self._rate_hz = 1.0 / (self._delta * self._tick_s)
        per_window = self._counting.window_s * self._rate_hz
        self._per_window = round(per_window)
        if self._per_window < 1 or abs(per_window - self._per_window) > 1e-6:
            raise InputError(
                Message("{rate_hz:g} samples a second of the device", self._rate_hz),
                Message("a whole number in each window of {window_s:g} s", self._counting.window_s),
                "set the device's sample rate or counter.window_s",
            )
        info = self._device.info
        self._plate = (str(info.manufacturer), str(info.model or info.name))
        self._serial = str(info.serial_number)
        self._firmware = str(getattr(info, "software_revision", ""))

    def _signal(self, devices: Mapping[str, Any], name: str) -> Any:
        """Return the only signal whose path ends as described for a channel."""
        wanted = self._options.channels[name].signal  # type: ignore[index]
        matching = [signal for path, signal in devices.items() if f"/{path}".endswith(f"/{wanted}")]
        if len(matching) != 1 or matching[0].domain_signal is None:
            raise InputError(
                Message(
                    "driver.counter.channels.{name}.signal = {wanted!r} ends {count} paths",
                    name,
                    wanted,
                    len(matching),
                ),
                Message("the end of one of {found}", ", ".join(sorted(devices))),
                "copy the path from the device's own software",
            )
        return matching[0]

    def _scale(self, number: int) -> tuple[float, float]:
        """Return how many Hz a unit of a served signal is, and the offset in Hz."""
        name = self._served[number]
        options = self._options.channels[name]  # type: ignore[index]
        unit = self._signals[number].descriptor.unit
        symbol = str(unit.symbol) if unit is not None else "no unit"
        scale_hz = options.scale_hz if options.scale_hz is not None else HERTZ.get(symbol)
        if scale_hz is None:
            raise InputError(
                Message("signal of {name} in {symbol}", name, symbol),
                "Hz, kHz or MHz, or a key scale_hz",
                Message("say in driver.counter.channels.{name} how many Hz one unit is", name),
            )
        return scale_hz, options.offset_hz

    @property
    def shortest_read_s(self) -> float:
        """A block is read as a whole, because devices send their samples in packets."""
        return self._counting.block_s

    def identity(self) -> Identity:
        """Return the identity that the device reported on connection."""
        details = {"address": self._options.address, "sample rate": f"{self._rate_hz:g} Hz"}
        return Identity("counter", *self._plate, self._serial, self._firmware, details)

    def select(self, channels: frozenset[str]) -> None:
        """Deliver only these channels from the next block on; all are read in any case."""
        self._check_served(channels)
        self._selected = channels

    def read_block(self, duration_s: float) -> Block:
        """Wait for the next windows of every channel and return them.

        Raises
        ------
        BenchError
            The windows don't arrive, or samples before them are missing.
        """
        windows = max(1, round(duration_s / self._counting.window_s))
        if self._reader is None:
            self._reader = self._ask(lambda: self._library.MultiReader(self._signals))
        values = self._samples(windows * self._per_window)
        means = values.reshape(len(self._served), windows, self._per_window).mean(axis=2)
        window_s = self._counting.window_s
        start_s = self._windows * window_s
        time_s = start_s + window_s * (np.arange(windows, dtype=np.float64) + 0.5)
        frequencies = {
            name: counted(time_s, scale * row + offset, self._options.resolution_hz)
            for name, row, (scale, offset) in zip(self._served, means, self._scales, strict=True)
            if name in self._selected
        }
        self._windows += windows
        return Block(start_s, self._windows * window_s, {}, frequencies)

    def _samples(self, count: int) -> NDArray[np.float64]:
        """Read a number of samples of every channel without a gap, float64[channel, count]."""
        parts: list[NDArray[np.float64]] = []
        missing = count
        deadline = time.monotonic() + count / self._rate_hz + self._options.timeout_s
        while missing > 0:
            left_s = deadline - time.monotonic()
            if left_s <= 0.0:
                raise BenchError(
                    Message(
                        "openDAQ device at {address} sent {count} of {wanted} samples",
                        self._options.address,
                        count - missing,
                        count,
                    ),
                    Message(
                        "all samples within {timeout_s:g} s after they are due",
                        self._options.timeout_s,
                    ),
                    "check the device and the network",
                )
            wait_ms = max(SHORTEST_POLL_MS, round(MS_PER_S * min(left_s, 0.2)))
            read = partial(self._reader.read_with_domain, missing, timeout_ms=wait_ms)
            values, ticks = self._ask(read)
            if len(ticks[0]):
                self._check_gapless(np.asarray(ticks[0]))
                parts.append(np.asarray(values, dtype=np.float64))
                missing -= len(ticks[0])
        return np.concatenate(parts, axis=1)

    def _check_gapless(self, ticks: NDArray[np.int64]) -> None:
        """Refuse samples that don't continue the earlier ones at the sample interval."""
        expected = self._next_tick
        first, last = int(ticks[0]), int(ticks[-1])
        steps = (last - first) // self._delta + 1
        if (expected is not None and first != expected) or steps != ticks.size:
            raise BenchError(
                Message(
                    "openDAQ device at {address}: samples are missing after tick {expected}",
                    self._options.address,
                    expected if expected is not None else first,
                ),
                "a stream without gaps",
                "check the network and the computer's load, then open the bench again",
            )
        self._next_tick = last + self._delta

    def close(self) -> None:
        """Release the device. A second call does nothing."""
        if self._closed:
            return
        self._closed = True
        self._reader = None
        self._signals = []
        if self._device is not None:
            with contextlib.suppress(RuntimeError):
                self._instance.remove_device(self._device)
        self._device = self._instance = None


def _counter(request: InstrumentRequest) -> OpenDaqCounter:
    options: OpenDaqOptions = request.read(OpenDaqOptions)
    return OpenDaqCounter(options, request.description.counter)


PLUGIN = DriverPlugin("opendaq", {"counter": _counter})
"""Plug-in for `protocol = "opendaq"`."""
