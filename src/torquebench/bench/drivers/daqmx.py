"""NI-DAQmx hardware: every edge of the torque transducers, voltages, bridges, and both encoders.

`nidaqmx` uses the local driver, or over gRPC an NI gRPC Device Server. One counter per transducer
measures periods in ticks of the timebase (buffered, without gaps); their sum is the time of each
edge. An analogue input measures a voltage or a bridge, averaged over each window. One counter per
encoder counts its position at the sample clock, which the analogue inputs or one more counter
derive from the same timebase. The clock's start arms all counters, so that they share one time
axis.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from torquebench.bench.blocks import Block
from torquebench.bench.description import BenchDescription, TransducerDescription
from torquebench.bench.drivers.base import Identity
from torquebench.bench.drivers.counters import LibraryCounter
from torquebench.bench.drivers.links import Address, TimeOut
from torquebench.bench.drivers.plugins import (
    DriverPlugin,
    InstrumentRequest,
    Options,
    require_library,
)
from torquebench.bench.roles import SIDES, Side, angle_channel, torque_channel
from torquebench.errors import BenchError, InputError
from torquebench.message import Message
from torquebench.signals import EdgeBlock, Record
from torquebench.validation import ConflictError

BUFFER_S = 20.0
"""Duration of the counter's buffer, s: a computer that stalls for a shorter time loses nothing."""
HIGHEST_HZ = 400e3
"""240 ± 120 kHz, with margin"""
COUNTS_A_PULSE = 4
SHORTEST_REMOTE_READ_S = 0.025
BEYOND_RANGE = 1.02
"""Share of an analogue input's range above which it is overloaded or its wire is open."""
BRIDGE_RANGE = 1.5
"""Range of a bridge input, as a multiple of the signal at nominal torque."""
Counter = Annotated[str, Field(pattern=r"^[^/\s]+/_?ctr\d+$", description="such as Dev1/ctr0")]
Terminal = Annotated[
    str,
    Field(pattern=r"^[^/\s]+/(_?ctr|ai)\d+$", description="such as Dev1/ctr0 or Dev1/ai0"),
]
LOCAL_REMEDY = (
    "install NI's driver NI-DAQmx (Windows and some Linux), check device and counters in NI MAX or "
    "with `nilsdev`, or give driver.counter.address to reach a card in another computer"
)
REMOTE_REMEDY = (
    "check network and address, that the NI gRPC Device Server runs there, and device and "
    "counters in its NI MAX"
)


class DaqmxOptions(Options):
    """Terminals by channel and encoder; without `address`, this computer's driver is used.

    `clock` is the counter, or the unused analogue input, whose task gives the sample clock; that of
    analogue channels does so by itself. `latency_s` is the longest time from an edge at the counter
    to the computer's buffer: blocks are older than the newest sample by this time. An analogue
    channel is a voltage within ±`range_v`, or a full bridge of `bridge_ohm` fed with
    `excitation_v`, as its transducer's signal is described.
    """

    address: Address | None = None
    device: Annotated[str, Field(min_length=1)]
    channels: Mapping[
        Literal["input_torque", "output_torque", "input_reference", "output_reference"], Terminal
    ] = Field(min_length=2)
    encoders: Mapping[Literal["input", "output"], Counter] = Field(default_factory=dict)
    clock: Terminal | None = None
    range_v: Annotated[float, Field(gt=0.0, le=100.0, description="V")] = 10.0
    excitation_v: Annotated[float, Field(gt=0.0, le=20.0, description="V")] = 5.0
    bridge_ohm: Annotated[float, Field(gt=0.0, le=1e5, description="ohm")] = 350.0
    sample_rate_hz: Annotated[float, Field(ge=100.0, le=1e5, description="Hz")] = 1000.0
    latency_s: Annotated[float, Field(ge=0.0, le=0.5, description="s")] = 0.002
    timeout_s: TimeOut = 1.0

    @property
    def analog(self) -> dict[str, str]:
        """Analogue inputs by channel."""
        return {str(name): port for name, port in self.channels.items() if "/ai" in port}

    @model_validator(mode="after")
    def _timed(self) -> Self:
        """Refuse options by which nothing, or more than one thing, times the samples."""
        if len(self.encoders) == 1:
            raise ConflictError(
                "encoders",
                Message("only one, {side}", next(iter(self.encoders))),
                "a counter for each encoder, or none",
                "add the other one, or read both by [driver.angles]",
            )
        by_input = bool(self.analog) or "/ai" in (self.clock or "")
        if self.analog and self.clock is not None:
            raise ConflictError(
                "clock",
                self.clock,
                "no clock beside analogue channels, whose own clock times everything",
                "remove it",
            )
        if self.clock is None and not by_input:
            raise ConflictError(
                "clock",
                "missing",
                "one more counter, or an unused analogue input such as Dev1/ai0",
                "add it",
            )
        if not self.encoders and not by_input:
            raise ConflictError(
                "clock",
                str(self.clock),
                "an analogue input such as Dev1/ai0 if no counter reads an encoder",
                "choose an unused analogue input: it needs no wire",
            )
        return self


class _Periods:
    """Periods of one channel, summed to the times of its edges."""

    def __init__(self) -> None:
        self._last = 0
        self._waiting: NDArray[np.int64] = np.empty(0, dtype=np.int64)

    def take(self, periods: NDArray[np.uint32]) -> None:
        """Append the edges at the ends of the next periods."""
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
            side: description.needed_encoder(side).counts_per_revolution
            for side in SIDES
            if side in options.encoders
        }
        self._tasks: dict[str, Any] = {}
        self._reader: dict[str, Any] = {}
        self._selected: frozenset[str] = frozenset()
        self._analog = tuple(options.analog)
        self._signals = {name: _transducer(description, name) for name in self._analog}
        self._periods = {
            str(name): _Periods() for name in options.channels if name not in self._analog
        }
        self._held: dict[Side, NDArray[np.int64]] = {}
        self._sides = tuple(side for side in SIDES if side in options.encoders)
        self._volts = np.empty((len(self._analog), 0))
        self._windows = 0
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
        self._samples_a_window = round(self._counting.window_s * options.sample_rate_hz)
        if self._analog and self._samples_a_window < 1:
            raise InputError(
                Message("sample_rate_hz = {sample_rate_hz:g}", options.sample_rate_hz),
                Message("a sample in each window of {window_s:g} s", self._counting.window_s),
                "raise it",
            )
        self._channel = self._connect()
        try:
            self._serial = self.identity().serial
        except BaseException:
            self.close()
            raise

    @property
    def times_encoders(self) -> bool:
        """Whether the counter reads encoders, so that no other source of angles is needed."""
        return bool(self._sides)

    @property
    def shortest_read_s(self) -> float:
        """A read of a card in this computer costs nothing; over gRPC it takes six round trips.

        An analogue value is there when its window is over.
        """
        remote_s = 0.0 if self._options.address is None else SHORTEST_REMOTE_READ_S
        return max(remote_s, self._counting.window_s if self._analog else 0.0)

    # -- the device -------------------------------------------------------------------------

    def _connect(self) -> Any:
        """Return a connection to the device's server; None for a device of this computer."""
        if self._options.address is None:
            return None
        grpc = require_library("grpc", "nidaqmx")
        deadlines = require_library("torquebench.bench.drivers.grpc_deadline", "nidaqmx")
        plain = grpc.insecure_channel(self._options.address)
        self._plain = plain
        return grpc.intercept_channel(plain, deadlines.Deadline(self._options.timeout_s))

    def _session(self, name: str) -> Any:
        """Return the session of a device server; None for a local driver."""
        if self._channel is None:
            return None
        return self._nidaqmx.GrpcSessionOptions(self._channel, name)

    def _text_of(self, error: Exception) -> str:
        """Return the text of a library's error, in plain words where its cause is known."""
        text = super()._text_of(error)
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
            """Read product and serial number."""
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
            """Create a task under a name that no other program uses."""
            full = f"torquebench-{mark}-{name}"
            task = self._nidaqmx.Task(full, grpc_options=self._session(full))
            self._tasks[name] = task
            return task

        def question() -> None:
            """Create and start the tasks of all channels, the encoders and the sample clock."""
            for name in self._periods:
                self._period_task(create(name), self._options.channels[name])  # type: ignore[index]  # periods have channels
            for side in self._sides:
                self._encoder_task(create(f"{side}_encoder"), side, self._options.encoders[side])
            for counter, task in self._tasks.items():
                reader = self._readers.CounterReader(task.in_stream)
                reader.verify_array_shape = False
                self._reader[counter] = reader
                task.start()
            clock = create("clock")
            if self._by_input:
                self._analog_task(clock)
            else:
                clock.co_channels.add_co_pulse_chan_freq(
                    self._options.clock, freq=self._options.sample_rate_hz
                )
                clock.timing.cfg_implicit_timing(self._constants.AcquisitionType.CONTINUOUS)
            clock.start()

        self._ask(question, "starting the counters")

    @property
    def _by_input(self) -> bool:
        """Whether the sample clock is that of the analogue inputs."""
        return bool(self._analog) or "/ai" in str(self._options.clock)

    def _analog_task(self, task: Any) -> None:
        """Set up the task of the analogue inputs, which also gives the sample clock."""
        inputs = task.ai_channels
        for name in self._analog or ("",):
            terminal = self._options.analog.get(name) or self._options.clock
            if name and self._signals[name].signal == "mV/V":
                full = BRIDGE_RANGE * float(self._signals[name].signal_at_nominal or 0.0)
                inputs.add_ai_bridge_chan(
                    terminal,
                    min_val=-full,
                    max_val=full,
                    units=self._constants.BridgeUnits.MILLIVOLTS_PER_VOLT,
                    voltage_excit_val=self._options.excitation_v,
                    nominal_bridge_resistance=self._options.bridge_ohm,
                )
            else:
                full = self._options.range_v
                inputs.add_ai_voltage_chan(terminal, min_val=-full, max_val=full)
        self._timing(task)
        reader = self._readers.AnalogMultiChannelReader(task.in_stream)
        reader.verify_array_shape = False
        self._reader["clock"] = reader

    def _timing(self, task: Any, **source: str) -> None:
        """Let a task sample continuously at the described rate."""
        task.timing.cfg_samp_clk_timing(
            self._options.sample_rate_hz,
            sample_mode=self._constants.AcquisitionType.CONTINUOUS,
            samps_per_chan=round(BUFFER_S * self._options.sample_rate_hz),
            **source,
        )

    def _terminal(self, of_inputs: str) -> str:
        """Return the terminal of the analogue inputs' clock, or of the clock's counter."""
        if self._by_input:
            return f"/{self._options.device}/ai/{of_inputs}"
        device, _, counter = str(self._options.clock).partition("/")
        return f"/{device}/{counter.lstrip('_').capitalize()}InternalOutput"

    def _armed(self, task: Any) -> None:
        """Let a task begin with the first edge of the start trigger."""
        trigger = task.triggers.arm_start_trigger
        trigger.trig_type = self._constants.TriggerType.DIGITAL_EDGE
        trigger.dig_edge_src = self._terminal("StartTrigger")
        trigger.dig_edge_edge = self._constants.Edge.RISING

    def _period_task(self, task: Any, terminal: str) -> None:
        """Set a task up that measures the periods of one channel's edges in ticks."""
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
        """Set a task up that samples the counts of one side's encoder."""
        task.ci_channels.add_ci_ang_encoder_chan(
            terminal,
            decoding_type=self._constants.EncoderType.X_4,
            units=self._constants.AngleUnits.TICKS,
            pulses_per_rev=self._per_revolution[side] // COUNTS_A_PULSE,
        )
        self._timing(task, source=self._terminal("SampleClock"))
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
            for side in self._sides:
                self._read_encoder(side, wanted, duration_s)
            if self._by_input:
                self._read_inputs(wanted, duration_s)
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
        records = {angle_channel(side): self._angles(side, count) for side in self._sides}
        records |= self._means(stop_sample)
        start_s, stop_s = self._start_sample / rate, stop_sample / rate
        self._start_sample = stop_sample
        return Block(start_s, stop_s, edges, records, waiting_s=waiting_s)

    def _count_waiting(self) -> int:
        """Return the number of unread samples that the sample clock has passed."""
        sampled = "clock" if self._by_input else f"{self._sides[0]}_encoder"
        stream = self._tasks[sampled].in_stream
        return int(self._ask(lambda: stream.avail_samp_per_chan, "samples that wait"))

    def _read_encoder(self, side: Side, wanted: int, duration_s: float) -> None:
        """Read the wanted samples of an encoder, and keep its unwrapped counts."""
        raw = np.empty(wanted, dtype=np.uint32)
        reader = self._reader[f"{side}_encoder"].read_many_sample_uint32
        self._read_samples(reader, raw, wanted, duration_s, Message("{side} encoder", side))
        counts = self._unwrapped(side, raw)
        before = self._held.get(side, np.empty(0, dtype=np.int64))
        self._held[side] = np.concatenate((before, counts))

    def _read_samples(
        self, read: Any, into: NDArray[Any], wanted: int, duration_s: float, what: str
    ) -> None:
        """Read exactly `wanted` samples of a task that the sample clock times."""
        timeout_s = duration_s + self._options.latency_s + 0.5 * self._options.timeout_s
        count = self._ask(lambda: read(into, wanted, timeout_s), what)
        if count != wanted:
            raise BenchError(
                Message("{place}: {what} sends {count} samples", self._place, what, count),
                Message("the {wanted} that were requested", wanted),
                "check that no other program reads it",
            )

    def _read_inputs(self, wanted: int, duration_s: float) -> None:
        """Read the next samples of the analogue inputs; NaN beyond an input's range."""
        values = np.empty((max(1, len(self._analog)), wanted))
        reader = self._reader["clock"].read_many_sample
        self._read_samples(reader, values, wanted, duration_s, "analogue inputs")
        for row, name in enumerate(self._analog):
            full = self._options.range_v
            if self._signals[name].signal == "mV/V":
                full = BRIDGE_RANGE * float(self._signals[name].signal_at_nominal or 0.0)
            values[row, np.abs(values[row]) > BEYOND_RANGE * full] = np.nan
        self._volts = np.concatenate((self._volts, values[: len(self._analog)]), axis=1)

    def _means(self, stop_sample: int) -> dict[str, Record]:
        """Return the means of the analogue inputs over the windows that end by a sample."""
        size = self._samples_a_window
        first, last = self._windows, stop_sample // size if self._analog else self._windows
        count = last - first
        taken, self._volts = self._volts[:, : count * size], self._volts[:, count * size :]
        means = taken.reshape(len(self._analog), count, size).mean(axis=2)
        self._windows = last
        middle = (np.arange(first, last, dtype=np.float64) + 0.5) * size - 0.5
        time_s = middle / self._options.sample_rate_hz
        return {
            name: Record({"time_s": time_s, "signal": means[row]})
            for row, name in enumerate(self._analog)
            if name in self._selected
        }

    def _unwrapped(self, side: Side, raw: NDArray[np.uint32]) -> NDArray[np.int64]:
        """Unwrap the 32-bit counter."""
        signed = raw.view(np.int32)
        first = self._position.get(side, int(signed[0]))
        words = np.concatenate((np.array([first], dtype=np.int64).astype(np.int32), signed))
        counts = first + np.cumsum(np.diff(words).astype(np.int64))
        self._position[side] = int(counts[-1])
        return np.asarray(counts)

    def _angles(self, side: Side, count: int) -> Record:
        """Return the next counts of an encoder with their times."""
        held = self._held[side]
        counts, self._held[side] = held[:count], held[count:]
        numbers = self._start_sample + np.arange(count, dtype=np.float64)
        time_s = numbers / self._options.sample_rate_hz
        return Record({"time_s": time_s, "angle_counts": counts})

    def _available(self, name: str) -> NDArray[np.uint32]:
        """Return the edges that the device has of a counter, without waiting for more."""

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


def _transducer(description: BenchDescription, channel: str) -> TransducerDescription:
    """Return the transducer of an analogue channel; raise `InputError` if it gives a frequency."""
    side: Side = "input" if channel.startswith("input") else "output"
    module = channel == torque_channel(side)
    transducer = (
        description.module(side).transducer if module else description.calibrator.transducer(side)
    )
    if transducer.signal not in ("V", "mV/V"):
        raise InputError(
            Message(
                "{channel} at an analogue input, its signal {signal!r}", channel, transducer.signal
            ),
            "signal = 'V' or 'mV/V' at an analogue input, 'frequency' at a counter",
            "correct the transducer's signal or driver.counter.channels",
        )
    return transducer


def _counter(request: InstrumentRequest) -> DaqmxCounter:
    options: DaqmxOptions = request.read(DaqmxOptions)
    return DaqmxCounter(options, request.description)


PLUGIN = DriverPlugin("nidaqmx", {"counter": _counter})
"""Plug-in for `protocol = "nidaqmx"`."""
