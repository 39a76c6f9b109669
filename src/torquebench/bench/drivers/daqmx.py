"""Counters of NI-DAQmx hardware: every edge of the torque transducers, and both encoders.

`nidaqmx` uses the local driver, or over gRPC an NI gRPC Device Server. One counter per transducer
measures periods in ticks of the timebase (buffered, without gaps); their sum is the time of each
edge. One counter per encoder counts its position at the sample clock, which another counter derives
from the same timebase. The sample clock's first pulse arms all counters, so that they share one
time axis.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.base import Block, Identity, Side
from torquebench.bench.drivers.counters import LibraryCounter
from torquebench.bench.drivers.links import Address, TimeOut
from torquebench.bench.drivers.plugins import (
    DriverPlugin,
    InstrumentRequest,
    Options,
    require_library,
)
from torquebench.bench.roles import SIDES, angle_channel
from torquebench.errors import BenchError, InputError
from torquebench.message import Message
from torquebench.signals import EdgeBlock, Record

__all__ = ["PLUGIN", "DaqmxCounter", "DaqmxOptions"]

BUFFER_S = 20.0
"""Duration of the counter's buffer, s: a computer that stalls for a shorter time loses nothing."""
HIGHEST_HZ = 400e3
"""240 ± 120 kHz, with margin"""
COUNTS_A_PULSE = 4
SHORTEST_REMOTE_READ_S = 0.025
Terminal = Annotated[str, Field(pattern=r"^[^/\s]+/ctr\d+$", description="such as Dev1/ctr0")]
LOCAL_REMEDY = (
    "install NI's driver NI-DAQmx (Windows and some Linux), check device and counters in NI MAX or "
    "with `nilsdev`, or give driver.counter.address to reach a card in another computer"
)
REMOTE_REMEDY = (
    "check network and address, that the NI gRPC Device Server runs there, and device and "
    "counters in its NI MAX"
)


class DaqmxOptions(Options):
    """Counters by channel and encoder; without `address`, the driver on this computer is used.

    `latency_s` is the longest time from an edge at the counter to the computer's buffer: blocks are
    older than the newest sample by this time.
    """

    address: Address | None = None
    device: Annotated[str, Field(min_length=1)]
    channels: Mapping[
        Literal["input_torque", "output_torque", "input_reference", "output_reference"], Terminal
    ] = Field(min_length=2)
    encoders: Mapping[Literal["input", "output"], Terminal] = Field(min_length=2)
    clock: Terminal
    sample_rate_hz: Annotated[float, Field(ge=100.0, le=1e5, description="Hz")] = 1000.0
    latency_s: Annotated[float, Field(ge=0.0, le=0.5, description="s")] = 0.002
    timeout_s: TimeOut = 1.0


class _Periods:
    """Periods of one channel, summed to the times of its edges."""

    def __init__(self) -> None:
        self._last = 0
        self._waiting: NDArray[np.int64] = np.empty(0, dtype=np.int64)

    def take(self, periods: NDArray[np.uint32]) -> None:
        ticks = self._last + np.cumsum(periods, dtype=np.int64)
        if ticks.size:
            self._last = int(ticks[-1])
            self._waiting = np.concatenate((self._waiting, ticks))

    def until(self, stop_tick: int) -> NDArray[np.int64]:
        """Return the edges before a tick, and remove them."""
        count = int(np.searchsorted(self._waiting, stop_tick))
        taken, self._waiting = self._waiting[:count], self._waiting[count:]
        return taken


class DaqmxCounter(LibraryCounter):
    """The counters of one NI-DAQmx device as the bench's counter card.

    Parameters
    ----------
    options : DaqmxOptions
    description : BenchDescription

    Raises
    ------
    BenchError
        The device doesn't answer, or its timebase isn't the one described.
    """

    def __init__(self, options: DaqmxOptions, description: BenchDescription) -> None:
        self._options = options
        self._nidaqmx = require_library("nidaqmx", "nidaqmx")
        super().__init__(
            description.counter,
            options.channels,
            f"counter {options.device} at {options.address or 'this computer'}",
            (self._nidaqmx.errors.Error, ValueError),
            REMOTE_REMEDY if options.address else LOCAL_REMEDY,
        )
        self._constants = require_library("nidaqmx.constants", "nidaqmx")
        self._readers = require_library("nidaqmx.stream_readers", "nidaqmx")
        self._per_revolution = {
            side: description.module(side).encoder.counts_per_revolution for side in SIDES
        }
        self._tasks: dict[str, Any] = {}
        self._reader: dict[str, Any] = {}
        self._selected: frozenset[str] = frozenset()
        self._periods = {str(name): _Periods() for name in options.channels}
        self._held: dict[Side, NDArray[np.int64]] = {}
        self._position: dict[Side, int] = {}
        self._samples = 0
        self._waiting = 0
        self._start_sample = 0
        rate = self._counting.timebase_hz / options.sample_rate_hz
        if rate != round(rate):
            raise InputError(
                Message("sample_rate_hz = {sample_rate_hz:g}", options.sample_rate_hz),
                Message(
                    "a whole part of the timebase {timebase_hz:g} Hz", self._counting.timebase_hz
                ),
            )
        self._ticks_a_sample = round(rate)
        self._channel = self._connect()
        try:
            self._serial = self.identity().serial
        except BaseException:
            self.close()
            raise

    times_encoders = True
    """Whether the counter reads encoders, so that no other source of angles is needed."""

    @property
    def shortest_read_s(self) -> float:
        """A read of a card in this computer costs nothing; over gRPC it takes six round trips."""
        return 0.0 if self._options.address is None else SHORTEST_REMOTE_READ_S

    # -- the device -------------------------------------------------------------------------

    def _connect(self) -> Any:
        if self._options.address is None:
            return None
        grpc = require_library("grpc", "nidaqmx")
        deadlines = require_library("torquebench.bench.drivers.grpc_deadline", "nidaqmx")
        plain = grpc.insecure_channel(self._options.address)
        self._plain = plain
        return grpc.intercept_channel(plain, deadlines.Deadline(self._options.timeout_s))

    def _session(self, name: str) -> Any:
        if self._channel is None:
            return None
        return self._nidaqmx.GrpcSessionOptions(self._channel, name)

    def _said(self, error: Exception) -> str:
        text = super()._said(error)
        if "DEADLINE_EXCEEDED" in text:
            return Message("no answer in {timeout_s:g} s", self._options.timeout_s)
        if "UNAVAILABLE" in text:
            return "no NI gRPC Device Server answers there"
        if isinstance(error, self._nidaqmx.errors.DaqNotFoundError):
            return "the NI-DAQmx driver isn't installed"
        return text

    def identity(self) -> Identity:
        """Read the device's identity; its serial number as in NI MAX, eight hexadecimal digits."""

        def question() -> tuple[str, int]:
            device = self._nidaqmx.system.Device(
                self._options.device, grpc_options=self._session("")
            )
            return str(device.product_type), int(device.serial_num)

        model, serial = self._ask(question, "who it is")
        details = {"device": self._options.device, "address": self._options.address or "local"}
        return Identity("counter", "National Instruments", model, f"{serial:08X}", details=details)

    # -- tasks ------------------------------------------------------------------------------

    def _begin(self) -> None:
        """Create and start all tasks; the sample clock is started last and arms the others."""
        mark = os.urandom(4).hex()

        def create(name: str) -> Any:
            full = f"torquebench-{mark}-{name}"
            task = self._nidaqmx.Task(full, grpc_options=self._session(full))
            self._tasks[name] = task
            return task

        def question() -> None:
            for name, terminal in self._options.channels.items():
                self._period_task(create(name), terminal)
            for side in SIDES:
                self._encoder_task(create(f"{side}_encoder"), side, self._options.encoders[side])
            for counter, task in self._tasks.items():
                reader = self._readers.CounterReader(task.in_stream)
                reader.verify_array_shape = False
                self._reader[counter] = reader
                task.start()
            clock = create("clock")
            clock.co_channels.add_co_pulse_chan_freq(
                self._options.clock, freq=self._options.sample_rate_hz
            )
            clock.timing.cfg_implicit_timing(self._constants.AcquisitionType.CONTINUOUS)
            clock.start()

        self._ask(question, "starting the counters")

    @property
    def _clock_output(self) -> str:
        device, _, counter = self._options.clock.partition("/")
        return f"/{device}/{counter.capitalize()}InternalOutput"

    def _armed(self, task: Any) -> None:
        trigger = task.triggers.arm_start_trigger
        trigger.trig_type = self._constants.TriggerType.DIGITAL_EDGE
        trigger.dig_edge_src = self._clock_output
        trigger.dig_edge_edge = self._constants.Edge.RISING

    def _period_task(self, task: Any, terminal: str) -> None:
        highest = round(self._counting.timebase_hz)
        channel = task.ci_channels.add_ci_period_chan(
            terminal,
            min_val=2,
            max_val=highest,
            units=self._constants.TimeUnits.TICKS,
            edge=self._constants.Edge.RISING,
            meas_method=self._constants.CounterFrequencyMethod.LOW_FREQUENCY_1_COUNTER,
        )
        task.timing.cfg_implicit_timing(
            self._constants.AcquisitionType.CONTINUOUS, round(BUFFER_S * HIGHEST_HZ)
        )
        self._armed(task)
        rate_hz = float(channel.ci_ctr_timebase_rate)
        if rate_hz != self._counting.timebase_hz:
            raise BenchError(
                Message("{terminal} counts with {rate_hz:g} Hz", terminal, rate_hz),
                Message("{timebase_hz:g} Hz, as described", self._counting.timebase_hz),
                "correct counter.timebase_hz or the device",
            )

    def _encoder_task(self, task: Any, side: Side, terminal: str) -> None:
        task.ci_channels.add_ci_ang_encoder_chan(
            terminal,
            decoding_type=self._constants.EncoderType.X_4,
            units=self._constants.AngleUnits.TICKS,
            pulses_per_rev=self._per_revolution[side] // COUNTS_A_PULSE,
        )
        task.timing.cfg_samp_clk_timing(
            self._options.sample_rate_hz,
            source=self._clock_output,
            sample_mode=self._constants.AcquisitionType.CONTINUOUS,
            samps_per_chan=round(BUFFER_S * self._options.sample_rate_hz),
        )
        self._armed(task)

    # -- reading ----------------------------------------------------------------------------

    def select(self, channels: frozenset[str]) -> None:
        """Deliver only these channels from the next block on; all are counted in any case.

        A counter that starts later would have a time axis of its own.
        """
        self._check_served(channels)
        self._selected = channels

    def read_block(self, duration_s: float) -> Block:
        """Return the next `duration_s`, after waiting until the sample clock has passed it."""
        if not self._tasks:
            self._begin()
        rate = self._options.sample_rate_hz
        count = max(1, round(duration_s * rate))
        stop_sample = self._start_sample + count
        latency = int(np.ceil(self._options.latency_s * rate))
        if stop_sample + latency > self._samples:
            # Read a backlog at once: block by block it would never be worked off.
            wanted = max(stop_sample + latency - self._samples, self._waiting)
            for side in SIDES:
                self._read_encoder(side, wanted, duration_s)
            self._samples += wanted
            for name, periods in self._periods.items():
                periods.take(self._available(name))
        self._waiting = self._count_waiting()
        waiting_s = (self._samples + self._waiting - stop_sample) / rate
        start_tick = self._start_sample * self._ticks_a_sample
        stop_tick = stop_sample * self._ticks_a_sample
        edges: dict[str, EdgeBlock] = {}
        for name, periods in self._periods.items():
            ticks = periods.until(stop_tick)
            if name not in self._selected:
                continue
            if ticks.size and ticks[0] < start_tick:
                raise BenchError(
                    Message(
                        "counter of {name}: an edge came {latency_s:g} s late",
                        name,
                        self._options.latency_s,
                    ),
                    "edges in the buffer when the sample clock has passed them",
                    "raise driver.counter.latency_s",
                )
            edges[name] = EdgeBlock(ticks, start_tick, stop_tick, self._counting.timebase_hz)
        angles = {angle_channel(side): self._angles(side, count) for side in SIDES}
        start_s, stop_s = self._start_sample / rate, stop_sample / rate
        self._start_sample = stop_sample
        return Block(start_s, stop_s, edges, angles, waiting_s=waiting_s)

    def _count_waiting(self) -> int:
        """Return the number of unread samples that the sample clock has passed."""
        stream = self._tasks[f"{SIDES[0]}_encoder"].in_stream
        return int(self._ask(lambda: stream.avail_samp_per_chan, "samples that wait"))

    def _read_encoder(self, side: Side, wanted: int, duration_s: float) -> None:
        raw = np.empty(wanted, dtype=np.uint32)
        timeout_s = duration_s + self._options.latency_s + 0.5 * self._options.timeout_s
        reader = self._reader[f"{side}_encoder"]
        read = self._ask(
            lambda: reader.read_many_sample_uint32(raw, wanted, timeout_s),
            Message("{side} encoder", side),
        )
        if read != wanted:
            raise BenchError(
                Message("counter of the {side} encoder sends {read} samples", side, read),
                Message("the {wanted} that were requested", wanted),
                "check that no other program reads it",
            )
        counts = self._unwrapped(side, raw)
        before = self._held.get(side, np.empty(0, dtype=np.int64))
        self._held[side] = np.concatenate((before, counts))

    def _unwrapped(self, side: Side, raw: NDArray[np.uint32]) -> NDArray[np.int64]:
        """Unwrap the 32-bit counter."""
        signed = raw.view(np.int32)
        first = self._position.get(side, int(signed[0]))
        words = np.concatenate((np.array([first], dtype=np.int64).astype(np.int32), signed))
        counts = first + np.cumsum(np.diff(words).astype(np.int64))
        self._position[side] = int(counts[-1])
        return np.asarray(counts)

    def _angles(self, side: Side, count: int) -> Record:
        held = self._held[side]
        counts, self._held[side] = held[:count], held[count:]
        numbers = self._start_sample + np.arange(count, dtype=np.float64)
        time_s = numbers / self._options.sample_rate_hz
        return Record({"time_s": time_s, "angle_counts": counts})

    def _available(self, name: str) -> NDArray[np.uint32]:
        def question() -> NDArray[np.uint32]:
            """Read all samples that the device has."""
            stream = self._tasks[name].in_stream
            present = int(stream.avail_samp_per_chan)
            raw = np.empty(present, dtype=np.uint32)
            if present:
                self._reader[name].read_many_sample_uint32(raw, present, self._options.timeout_s)
            return raw

        return self._ask(question, Message("edges of {name}", name))

    def close(self) -> None:
        """End all tasks and release the device. A second call does nothing."""
        if self._closed:
            return
        self._closed = True
        deadline = time.monotonic() + self._options.timeout_s
        for task in self._tasks.values():
            with contextlib.suppress(Exception):
                if time.monotonic() < deadline:
                    task.close()
        self._tasks.clear()
        if self._channel is not None:
            self._plain.close()


def _counter(request: InstrumentRequest) -> DaqmxCounter:
    options: DaqmxOptions = request.read(DaqmxOptions)
    return DaqmxCounter(options, request.description)


PLUGIN = DriverPlugin("nidaqmx", {"counter": _counter})
"""Plug-in for `protocol = "nidaqmx"`."""
