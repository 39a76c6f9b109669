"""SCPI instruments: frequency counters that measure without gaps, and read-outs of calibrators."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from torquebench.bench.blocks import Block
from torquebench.bench.description import CounterDescription
from torquebench.bench.drivers.base import Identity
from torquebench.bench.drivers.counters import DescribedCounter, counted
from torquebench.bench.drivers.links import TimeOut
from torquebench.bench.drivers.plugins import DriverPlugin, InstrumentRequest, Options
from torquebench.bench.drivers.sample_clock import SampleClock
from torquebench.bench.drivers.scpi.link import ScpiAddress, ScpiLink, ScpiOptions, numbers
from torquebench.bench.roles import CHANNELS, SIDES, Side
from torquebench.errors import BenchError, InputError
from torquebench.message import Message
from torquebench.signals import Record

SETUP = (
    "ABOR",
    "CONF:FREQ",
    "SENS:FREQ:MODE CONT",
    "SENS:FREQ:GATE:SOUR TIME",
    "SENS:FREQ:GATE:TIME {gate_s:.9g}",
    "SENS:ROSC:SOUR {clock}",
    "SYST:TIM {longest_s:.9g}",
    "SAMP:COUN 1000000",
    "TRIG:COUN 1000000",
    "INIT",
)
"""Commands for gap-free frequencies of the Keysight 53230A; `setup` replaces them."""


class CounterOptions(Options):
    """Options of the counters: one for each channel, all with one reference clock.

    `fetch` removes `{count}` readings from the counter and waits for them: at most for their gate
    times and `timeout_s`, by default the time in which a lost signal must be noticed
    (`safety.signal_loss_s`). In `setup`, `{longest_s}` is the time after which the counter ends a
    gate without pulses.
    """

    channels: Mapping[
        Literal["input_torque", "output_torque", "input_reference", "output_reference"],
        ScpiAddress,
    ] = Field(min_length=2)
    reference_clock: Literal["INT", "EXT"] = "EXT"
    setup: tuple[str, ...] = SETUP
    fetch: str = "DATA:REM? {count},WAIT"
    single_shot_s: Annotated[float, Field(gt=0.0, le=1e-6, description="s")] = 1e-9
    timeout_s: TimeOut | None = None


ANSWER_S = 1.0
"""Time-out of all requests except readings, s."""
SHORTEST_LOSS_S = 0.01
"""Shortest gate time-out that a 53230A accepts, s."""


class ScpiCounter(DescribedCounter):
    """Frequency counters that deliver one frequency per gate time, without gaps.

    They send no edges, so that lost and doubled pulses only appear as steps of the frequency.
    Readings in a lost answer are lost, too: the stream then has a gap, which is an error.

    Parameters
    ----------
    counting : CounterDescription
        Description of the counter; the gate time is its window.
    signal_loss_s : float
        Time in which a lost signal is to be noticed.
    """

    def __init__(
        self, options: CounterOptions, counting: CounterDescription, signal_loss_s: float
    ) -> None:
        super().__init__(counting, options.channels)
        self._options = options
        self._loss_s = max(signal_loss_s, SHORTEST_LOSS_S)
        answer_s = ANSWER_S if options.timeout_s is None else options.timeout_s
        self._fetch_s = self._loss_s if options.timeout_s is None else options.timeout_s
        self._links = {
            str(name): ScpiLink(f"counter of {name}", address, answer_s, attempts=1)
            for name, address in options.channels.items()
        }
        self._running: frozenset[str] = frozenset()
        self._windows = 0
        try:
            self._serial = self.identity().serial
        except BaseException:
            self.close()
            raise
        self._relative_uncertainty = math.sqrt(2.0) * options.single_shot_s / counting.window_s

    @property
    def shortest_read_s(self) -> float:
        """A block is requested at once, because every request takes a round trip."""
        return self._counting.block_s

    def identity(self) -> Identity:
        """Read the identity of the first counter, on behalf of all."""
        first, *others = [link.identity("counter") for link in self._links.values()]
        details = dict(first.details) | {
            f"serial of {name}": other.serial
            for name, other in zip(list(self._links)[1:], others, strict=True)
        }
        return Identity(
            "counter", first.manufacturer, first.model, first.serial, first.firmware, details
        )

    def select(self, channels: frozenset[str]) -> None:
        """Start the counters of these channels, and stop the others."""
        self._check_served(channels)
        for name in sorted(channels - self._running):
            self._start(self._links[name])
        for name in sorted(self._running - channels):
            self._links[name].command("ABOR")
        self._running = channels

    def _start(self, link: ScpiLink) -> None:
        """Set a counter up to measure continuously with the common reference clock."""
        clock = self._options.reference_clock
        gate_s = self._counting.window_s
        for line in self._options.setup:
            longest_s = gate_s + self._loss_s
            link.command(line.format(gate_s=gate_s, clock=clock, longest_s=longest_s))
        used = link.query("SENS:ROSC:SOUR?")
        if used.upper()[:3] != clock:
            raise BenchError(
                Message("{name} uses its reference clock {used!r}", link.name, used),
                repr(clock),
                "connect the common reference clock",
            )

    def read_block(self, duration_s: float) -> Block:
        """Return the next windows of every running channel."""
        gate_s = self._counting.window_s
        count = round(duration_s / gate_s)
        if count < 1 or abs(count * gate_s - duration_s) > 1e-6:
            raise InputError(
                Message("a block of {duration_s:g} s", duration_s),
                Message("a multiple of the gate time {gate_s:g} s", gate_s),
            )
        start_s = self._windows * gate_s
        time_s = start_s + gate_s * (np.arange(count, dtype=np.float64) + 0.5)
        frequencies = {
            name: self._counted(time_s, self._fetch(name, count)) for name in sorted(self._running)
        }
        self._windows += count
        return Block(start_s, self._windows * gate_s, {}, frequencies)

    def _fetch(self, name: str, count: int) -> NDArray[np.float64]:
        """Return the next readings of a counter; refuse another number of them."""
        link = self._links[name]
        within_s = count * self._counting.window_s + self._fetch_s
        answer = link.query(self._options.fetch.format(count=count), within_s=within_s)
        values = numbers(answer, link.name)
        if len(values) != count:
            raise BenchError(
                Message("{name} sends {count} readings", link.name, len(values)),
                Message("the {wanted} that were requested", count),
                "check that it measures continuously and that no other program reads it",
            )
        return np.array(values)

    def _counted(self, time_s: NDArray[np.float64], frequency_hz: NDArray[np.float64]) -> Record:
        uncertainty_hz = frequency_hz * self._relative_uncertainty
        return counted(time_s, frequency_hz, uncertainty_hz)

    def close(self) -> None:
        """Release every counter. A second call does nothing."""
        for link in self._links.values():
            link.close()


class ReadoutOptions(ScpiOptions):
    """Options of a calibrator's amplifier: the request for its samples since the last request.

    `scale` is the torque in N·m per unit of the answer.
    """

    fetch: str = "FETC:ARR? (@{channel})"
    input: Annotated[int, Field(ge=1, le=99)] = 1
    output: Annotated[int, Field(ge=1, le=99)] = 2
    period_s: Annotated[float, Field(gt=0.0, le=1.0, description="s")] = 0.01
    scale: Annotated[float, Field(gt=0.0, le=1e6, description="N·m a unit")] = 1.0


class ScpiReadout:
    """A calibrator's amplifier on SCPI that delivers every sample once.

    Its newest sample is assumed to be as old as the answer; see `SampleClock`.
    """

    def __init__(self, link: ScpiLink, options: ReadoutOptions) -> None:
        self._link = link
        self._options = options
        self._channels: dict[Side, int] = {"input": options.input, "output": options.output}
        self._clocks = {side: SampleClock(options.period_s) for side in SIDES}
        for side in SIDES:  # discard earlier samples
            self._fetch(side)

    def identity(self) -> Identity:
        """Read the identity of the amplifier."""
        return self._link.identity("reference")

    @property
    def period_s(self) -> float:
        """Period of the samples, as described."""
        return self._options.period_s

    def _fetch(self, side: Side) -> NDArray[np.float64]:
        line = self._options.fetch.format(channel=self._channels[side])
        return np.array(numbers(self._link.query(line), self._link.name), dtype=np.float64)

    def read(self, side: Side, until_s: float, timed_s: float) -> Record:
        """Return the samples since the last call; NaN without a signal."""
        return self._clocks[side].take(self._options.scale * self._fetch(side), until_s, timed_s)

    def close(self) -> None:
        """Release the amplifier. A second call does nothing."""
        self._link.close()


def _counter(request: InstrumentRequest) -> ScpiCounter:
    options: CounterOptions = request.read(CounterOptions)
    assert set(options.channels) <= set(CHANNELS)
    described = request.description
    return ScpiCounter(options, described.counter, described.safety.signal_loss_s)


def _readout(request: InstrumentRequest) -> ScpiReadout:
    options: ReadoutOptions = request.read(ReadoutOptions)
    with ScpiLink("reference", options.address, options.timeout_s).kept() as link:
        return ScpiReadout(link, options)


PLUGIN = DriverPlugin("scpi", {"counter": _counter, "reference": _readout})
"""Plug-in for `protocol = "scpi"`."""
