"""Checks of the counter's signals: torque, speed, angle, temperature, rates and freshness.

There are two stages: a fast check of the raw edges of a few milliseconds, in real time, so that the
drives are stopped at once; and a check of every evaluated block, whose faults are marked.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from torquebench.bench.blocks import Block
from torquebench.bench.description import BenchDescription, TransducerDescription
from torquebench.bench.drivers.base import CLOCKS_APART_S, ReferenceReadout
from torquebench.bench.roles import SIDES, Side, reference_channel, torque_channel
from torquebench.bench.safety.alarms import AlarmKind, AlarmLevel, Violation
from torquebench.bench.safety.following import FollowingJudge
from torquebench.bench.safety.limits import LimitBook, Watch
from torquebench.bench.state import CommandState
from torquebench.message import Message
from torquebench.signals import EdgeBlock, Record, SignalFaultKind
from torquebench.units import DEG_PER_TURN, MINUTE, RPM_PER_RAD_S

TEMPERATURE_WARNING_K = 5.0
TEMPERATURE_HYSTERESIS_K = 1.0
FEW_EDGES = 8
"""Smallest number of edges in one fast check that gives a frequency."""
CLOCK_SETTLING_S = 1.0
"""Longest time at the start until the times of a read-out's samples are known, s."""
OWN_KEPT_S = 2.0
"""How long a module's torque is kept for comparison with its standard, s."""


class FastCheck(Protocol):
    """Data of a torque channel for a fast check."""

    name: str
    side: Side
    transducer: TransducerDescription

    def torque(self, frequency_hz: float) -> float:
        """Torque of one frequency by the present zero, N·m."""


@dataclass(frozen=True)
class Change:
    """A level that was reached or ended (then `violation` is None)."""

    watch: Watch
    violation: Violation | None


@dataclass
class _ChannelCheck:
    """State of one torque channel between checks; last values as time, s, and torque, N·m."""

    before_slice: tuple[float, float] | None = None
    before_block: tuple[float, float] | None = None
    edges_until_s: float | None = None
    """Time of the last edge while the transducer worked."""
    faulty_s: float = 0.0
    """Duration of the fault at the end of the last block."""
    stated_until_s: float | None = None
    """End of the last valid sample of a read-out."""
    waiting: Record | None = None
    """Values whose comparison with the other transducer of their side is pending."""


@dataclass
class _ShaftCheck:
    """State of one shaft between checks; last values as time, s, and speed, rpm."""

    before_slice: tuple[float, float] | None = None
    before_block: tuple[float, float] | None = None
    turns: tuple[float, float] | None = None
    """Time, s, and angle in turns of the last encoder sample."""
    stood: tuple[tuple[int, float], float] | None = None
    """Limit of the angle with its number, and the angle from which it counts, degrees."""


_SPEEDS = {side: Message("{side} speed", side) for side in SIDES}
_REMEDIES = {
    AlarmKind.TORQUE_LIMIT: "find out what overloaded the chain before you continue",
    AlarmKind.SPEED_LIMIT: "find out why the drive ran away before you continue",
    AlarmKind.ANGLE_LIMIT: "check whether clamp, coupling or mode conversion has slipped",
    AlarmKind.RATE_LIMIT: "check whether something broke or came loose before you continue",
    AlarmKind.TEMPERATURE_LIMIT: "let the bench cool down",
}


@dataclass
class _Memory:
    """State of the checks between two blocks; an acknowledgement resets it."""

    channels: dict[str, _ChannelCheck] = field(default_factory=dict)
    shafts: dict[Side, _ShaftCheck] = field(
        default_factory=lambda: {side: _ShaftCheck() for side in SIDES}
    )

    def channel(self, name: str) -> _ChannelCheck:
        return self.channels.setdefault(name, _ChannelCheck())


class SignalJudge:
    """Compares every signal with the limits in force; called by acquisition's thread only.

    Parameters
    ----------
    readout : ReferenceReadout, optional
        Read-out of a standard that delivers torque itself, with its own clock.
    """

    def __init__(
        self,
        description: BenchDescription,
        limits: LimitBook,
        commands: CommandState,
        readout: ReferenceReadout | None = None,
    ) -> None:
        self._description = description
        self._per_turn = {
            side: encoder.counts_per_revolution
            for side in SIDES
            if (encoder := description.module(side).encoder) is not None
        }
        self._readout = readout
        self._limits = limits
        self._commands = commands
        self._warning = description.safety.warning_percent / 100.0
        self._hysteresis = description.safety.hysteresis_percent / 100.0
        self._watches: dict[tuple[AlarmKind, str], Watch] = {}
        self._memory = _Memory()
        self._following = FollowingJudge(description, commands)
        self._forgetting = False
        self._warnings: list[Change] = []
        self._violation: Violation | None = None

    def forget(self) -> None:
        """Restart the checks after an acknowledgement, at the next check; from any thread."""
        self._forgetting = True

    def _begin(self) -> None:
        """Forget the past if that was requested, except for the angles of the shafts."""
        if not self._forgetting:
            return
        self._forgetting = False
        turns = {side: shaft.turns for side, shaft in self._memory.shafts.items()}
        self._memory = _Memory()
        for side, shaft in self._memory.shafts.items():
            shaft.turns = turns[side]
        self._following.forget()

    def _result(self) -> tuple[Violation | None, list[Change]]:
        """Return the check's first violation and its warnings, and clear both."""
        result = self._violation, self._warnings
        self._violation, self._warnings = None, []
        return result

    # -- the fast check ---------------------------------------------------------------------

    def check_edges(
        self, measured: Block, channels: Mapping[str, FastCheck]
    ) -> tuple[Violation | None, list[Change]]:
        """Check the raw edges and encoder counts of a few milliseconds.

        Returns
        -------
        Violation or None, list of Change
            The first violation of a limit, and warnings that began or ended.
        """
        self._begin()
        for name, memory in self._memory.channels.items():
            if name not in measured.edges:
                memory.edges_until_s = None  # a channel that isn't timed any more isn't silent
        for name, edges in measured.edges.items():
            channel = channels.get(name)
            if channel is not None:
                self._check_edges(channel, edges, measured.stop_s)
        for side in SIDES:
            angle = measured.angle(side)
            if angle is not None and len(angle) and side in self._per_turn:
                self._turn(side, angle)
        return self._result()

    def _check_edges(self, channel: FastCheck, edges: EdgeBlock, now_s: float) -> None:
        """Check a slice of a channel's edges: frequency within its limits, torque and its rate."""
        ticks, name = edges.ticks, channel.name
        count, memory = ticks.size, self._memory.channel(name)
        lowest_hz, highest_hz = channel.transducer.modulation_hz
        frequency = 0.0
        if count >= FEW_EDGES:
            frequency = (count - 1) * edges.timebase_hz / float(ticks[-1] - ticks[0])
        if not lowest_hz <= frequency <= highest_hz:
            memory.before_slice = None
            if memory.edges_until_s is None:
                memory.edges_until_s = now_s - edges.duration_s
            silent_s = now_s - memory.edges_until_s
            if self._commands.any_enabled and (
                silent_s > self._description.safety.signal_loss_s + 1e-9
            ):
                kind = (
                    SignalFaultKind.NO_PULSES
                    if count < FEW_EDGES
                    else SignalFaultKind.OUT_OF_MODULATION
                )
                self._lost(name, kind, silent_s)
            return
        memory.edges_until_s = now_s - (edges.stop_tick - int(ticks[-1])) / edges.timebase_hz
        torque = channel.torque(frequency)
        self._torque(channel.side, name, abs(torque))
        middle_s = now_s - 0.5 * edges.duration_s  # slices of a bench at rest are longer
        before, memory.before_slice = memory.before_slice, (middle_s, torque)
        if before is not None:
            self._torque_rate(channel.side, name, abs(torque - before[1]) / (middle_s - before[0]))

    def _turn(self, side: Side, angle: Record) -> None:
        """Check the angle of a shaft since the last sample of its encoder."""
        shaft = self._memory.shafts[side]
        per_turn = self._per_turn[side]
        time_s, counts = angle.time_s, angle["angle_counts"]
        last_s, turns = float(time_s[-1]), float(counts[-1]) / per_turn
        before = shaft.turns
        if before is None and len(angle) > 1:
            before = float(time_s[0]), float(counts[0]) / per_turn
        shaft.turns = (last_s, turns)
        if before is not None and last_s > before[0]:
            speed_rpm = MINUTE * (turns - before[1]) / (last_s - before[0])
            self._speed(side, speed_rpm, last_s, quick=True)
        self._angle(side, DEG_PER_TURN * turns)

    # -- whole blocks -----------------------------------------------------------------------

    def judge(self, block: Block) -> tuple[Violation | None, list[Change]]:
        """Check an evaluated block; return values like those of `check_edges`."""
        self._begin()
        for side in SIDES:
            speed = block.speed_rad_s(side)  # silent encoders are handled below
            if not math.isnan(speed):
                self._speed(side, speed * RPM_PER_RAD_S, block.stop_s, quick=False)
            angle = block.angle(side)
            if angle is not None and len(angle):
                self._slipped(side, angle)
            self._temperature(side, block)
        records = {
            name: (side, record)
            for side in SIDES
            for name in (torque_channel(side), reference_channel(side))
            if (record := block.records.get(name)) is not None
        }
        for name, (side, record) in records.items():
            if len(record):
                highest = float(
                    np.fmax.reduce(np.abs(record["reading_nm"]))
                )  # NaN isn't an extreme value
                self._torque(side, name, highest)
                self._rate_of_block(side, name, record)
        self._note_readout(block)
        if self._violation is None and self._commands.any_enabled:
            self._missing(block)
            for name, (_, record) in records.items():
                self._faulty(name, record, block)
            self._disagreeing(block)
            deviation = self._following.judge(block)
            if deviation is not None:
                self._violated(
                    deviation.kind,
                    deviation.source,
                    deviation.found,
                    deviation.allowed,
                    deviation.remedy,
                )
        elif not self._commands.any_enabled:
            for memory in self._memory.channels.values():
                memory.waiting = None
            self._following.forget()
        return self._result()

    def _slipped(self, side: Side, angle: Record) -> None:
        """Check a polled encoder since its last sample before the block: it may slip between."""
        shaft = self._memory.shafts[side]
        per_turn = self._per_turn[side]
        first, last = (
            (float(angle.time_s[k]), float(angle["angle_counts"][k]) / per_turn) for k in (0, -1)
        )
        before = shaft.turns
        if before is not None and first[0] - before[0] > self._description.safety.fast_check_s:
            self._speed_level(side, MINUTE * (first[1] - before[1]) / (first[0] - before[0]))
        if before is None or before[0] < last[0]:
            shaft.turns = last
        self._angle(side, DEG_PER_TURN * last[1])

    def _temperature(self, side: Side, block: Block) -> None:
        """Check a module's temperature against its limit."""
        probe = self._description.module(side).temperature_probe
        temperature = block.temperature_c(probe)
        if math.isnan(temperature):  # silent probes are handled as lost signals
            return
        limit = self._limits.side(side).temperature_c
        self._level(
            AlarmKind.TEMPERATURE_LIMIT,
            probe,
            temperature,
            limit,
            "probe {source} {value:.1f} °C",
            "°C",
            (limit - TEMPERATURE_WARNING_K, TEMPERATURE_HYSTERESIS_K),
        )

    def _rate_of_block(self, side: Side, name: str, record: Record) -> None:
        """Check the torque's rate of change from window to window."""
        if math.isinf(self._limits.side(side).torque_rate_nm_per_s):
            return
        window_s = self._description.counter.window_s
        time_s, torque_nm = record.time_s, record["reading_nm"]
        memory = self._memory.channel(name)
        before, memory.before_block = (
            memory.before_block,
            (float(time_s[-1]), float(torque_nm[-1])),
        )
        highest = math.nan
        if before is not None:
            highest = abs(float(torque_nm[0]) - before[1])
            highest /= max(float(time_s[0]) - before[0], window_s)
        if time_s.size > 1:
            rates = np.abs(np.diff(torque_nm)) / np.maximum(np.diff(time_s), window_s)
            highest = float(np.fmax.reduce(rates, initial=highest))  # NaN isn't a maximum
        if time_s.size > 1 or before is not None:
            self._torque_rate(side, name, highest)

    def _missing(self, block: Block) -> None:
        """Check that encoders and probes deliver samples."""
        for side in SIDES:
            probe = self._description.module(side).temperature_probe
            if side in self._per_turn and math.isnan(block.speed_rad_s(side)):
                self._no_sample(Message("{side} encoder", side))
            if math.isnan(block.temperature_c(probe)):
                self._no_sample(Message("probe {probe}", probe))

    def _no_sample(self, signal: str) -> None:
        """Report a violation: a block has no sample of a signal."""
        self._violated(
            AlarmKind.SIGNAL_LOST,
            signal,
            Message("no sample of the {signal}", signal),
            "samples in every block",
            "check its connection",
        )

    def _faulty(self, name: str, record: Record, block: Block) -> None:
        """Detect a channel that has had no valid value for too long."""
        memory, fault = self._memory.channel(name), record["fault"]
        if memory.stated_until_s is not None and not np.any(fault == SignalFaultKind.STUCK):
            # The samples of a block's last period come with the next block.
            allowed_s = self._description.safety.signal_loss_s + 2.0 * self._period_s
            silent_s = block.stop_s - memory.stated_until_s
            if silent_s > allowed_s + 1e-9:
                self._lost(name, _kind_of(fault), silent_s, allowed_s)
            return
        window_s = self._description.counter.window_s
        if not len(record):  # no samples at all count as a fault
            memory.faulty_s += block.stop_s - block.start_s
            longest_s = memory.faulty_s
        else:
            faulty = (fault != 0) | np.isnan(record["reading_nm"])
            memory.faulty_s, longest_s = _faulty_time(faulty, memory.faulty_s, window_s)
        if longest_s > self._description.safety.signal_loss_s:
            self._lost(name, _kind_of(fault), longest_s)

    def _note_readout(self, block: Block) -> None:
        """Record the time of a standard's last sample, if it has a read-out."""
        if self._readout is None:
            return
        for side in SIDES:
            memory = self._memory.channel(reference_channel(side))
            record = block.records.get(reference_channel(side))
            if record is None:
                memory.stated_until_s = None
                continue
            until_s = memory.stated_until_s or block.start_s + CLOCK_SETTLING_S
            valid = np.flatnonzero((record["fault"] == 0) & np.isfinite(record["reading_nm"]))
            if valid.size:
                until_s = max(until_s, float(record.time_s[valid[-1]]) + 0.5 * self._period_s)
            memory.stated_until_s = until_s

    @property
    def _period_s(self) -> float:
        return 0.0 if self._readout is None else self._readout.period_s

    def _disagreeing(self, block: Block) -> None:
        """Compare a module with the standard on its side, which carries the same torque."""
        share = self._description.safety.disagreement_percent / 100.0
        apart_s = 0.0 if self._readout is None else 2.0 * self._period_s + CLOCKS_APART_S
        for side in SIDES:
            names = torque_channel(side), reference_channel(side)
            own, standard = (self._memory.channel(name) for name in names)
            records = [block.records.get(name) for name in names]
            if records[0] is None or records[1] is None:
                own.waiting = standard.waiting = None
                continue
            module = own.waiting = _appended(own.waiting, records[0])
            stated = _appended(standard.waiting, records[1])
            # A standard's sample is compared once the module has been read far enough beyond it.
            due = stated.time_s + apart_s < block.stop_s
            standard.waiting, stated = stated.at(~due), stated.at(due)
            own.waiting = module.at(module.time_s > block.stop_s - OWN_KEPT_S)
            first = np.searchsorted(module.time_s, stated.time_s - apart_s - 1e-9)
            last = np.searchsorted(module.time_s, stated.time_s + apart_s + 1e-9)
            torque_nm = module["reading_nm"]
            deviations = [
                max(float(torque_nm[i:k].min()) - value, value - float(torque_nm[i:k].max()))
                for i, k, value in zip(first, last, stated["reading_nm"], strict=True)
                if k > i
            ]
            # during the whole interval, not only at a moment of a ramp
            least = min(deviations, default=0.0)
            allowed = share * self._description.module(side).range_nm
            if least > allowed:
                self._violated(
                    AlarmKind.DISAGREEMENT,
                    names[0],
                    Message("{own} and {standard} are {value:.1f} N·m apart", *names, least),
                    Message("at most {allowed:g} N·m", allowed),
                    "find out which of the two transducers is wrong before you continue",
                )

    # -- levels -----------------------------------------------------------------------------

    def _torque(self, side: Side, name: str, torque_nm: float) -> None:
        limit = self._limits.side(side).torque_nm
        self._level(
            AlarmKind.TORQUE_LIMIT, name, torque_nm, limit, "{source} {value:.1f} N·m", "N·m"
        )

    def _speed_level(self, side: Side, speed_rpm: float) -> None:
        """Compare a side's speed with its limit."""
        self._level(
            AlarmKind.SPEED_LIMIT,
            side,
            abs(speed_rpm),
            self._limits.side(side).speed_rpm,
            "{source} speed {value:.1f} rpm",
            "rpm",
        )

    def _speed(self, side: Side, speed_rpm: float, now_s: float, *, quick: bool) -> None:
        """Check a speed and its change since the last one, for slices (`quick`) or for blocks."""
        self._speed_level(side, speed_rpm)
        shaft = self._memory.shafts[side]
        if quick:
            before, shaft.before_slice = shaft.before_slice, (now_s, speed_rpm)
        else:
            before, shaft.before_block = shaft.before_block, (now_s, speed_rpm)
        if before is not None and self._commands.any_enabled and now_s > before[0]:
            self._level(
                AlarmKind.RATE_LIMIT,
                _SPEEDS[side],
                abs(speed_rpm - before[1]) / (now_s - before[0]),
                self._limits.side(side).speed_rate_rpm_per_s,
                "{source} changes by {value:.0f} rpm/s",
                "rpm/s",
            )

    def _torque_rate(self, side: Side, name: str, rate: float) -> None:
        """Compare a torque's rate of change with its limit while a drive is enabled."""
        if self._commands.any_enabled:
            self._level(
                AlarmKind.RATE_LIMIT,
                name,
                rate,
                self._limits.side(side).torque_rate_nm_per_s,
                "{source} changes by {value:.0f} N·m/s",
                "N·m/s",
            )

    def _angle(self, side: Side, angle_deg: float) -> None:
        """Check the angle by which a side has turned since its limit was set."""
        limit, shaft = self._limits.side(side).angle_deg, self._memory.shafts[side]
        enabled = self._commands.any_enabled
        if math.isinf(limit) or not enabled:
            shaft.stood = None
            return
        epoch = (self._limits.angle_changes[side], limit)
        if shaft.stood is None or shaft.stood[0] != epoch:
            shaft.stood = (epoch, angle_deg)
        self._level(
            AlarmKind.ANGLE_LIMIT,
            side,
            abs(angle_deg - shaft.stood[1]),
            limit,
            "{source} side turned by {value:.2f}°",
            "°",
        )

    def _level(
        self,
        kind: AlarmKind,
        source: str,
        value: float,
        limit: float,
        text: str,
        unit: str,
        warning: tuple[float, float] | None = None,
    ) -> None:
        """Compare a value with its limit: beyond it a violation, near it a warning."""
        if limit == math.inf:
            return
        watch = self._watches.get((kind, source))
        if watch is None:
            watch = self._watches[kind, source] = Watch()
        level, hysteresis = warning or (self._warning * limit, self._hysteresis * limit)
        changed = watch.judge(value, limit, level, hysteresis)
        if watch.level is not AlarmLevel.CRITICAL and not changed:
            return
        message = Message(text, source, value)
        allowed = Message("at most {limit:g} {unit}", limit, unit)
        if watch.level is AlarmLevel.CRITICAL:
            self._violated(kind, source, message, allowed, _REMEDIES[kind])
        warns = Violation(kind, source, message, allowed, "it stops the bench at the limit")
        self._warnings.append(Change(watch, warns if watch.level is AlarmLevel.WARNING else None))

    def _lost(
        self, name: str, kind: SignalFaultKind, lasted_s: float, allowed_s: float | None = None
    ) -> None:
        """Report a violation: a signal has had a fault for longer than allowed."""
        allowed_s = self._description.safety.signal_loss_s if allowed_s is None else allowed_s
        self._violated(
            AlarmKind.SIGNAL_LOST,
            name,
            Message("{name}: {fault} for {lasted:.3f} s", name, kind.description, lasted_s),
            Message("at most {timeout_s:g} s", allowed_s),
            kind.remedy,
        )

    def _violated(
        self, kind: AlarmKind, source: str, found: str, allowed: str, remedy: str
    ) -> None:
        """Keep only the first violation of a check."""
        if self._violation is None:
            self._violation = Violation(kind, source, found, allowed, remedy)


def _kind_of(fault: np.ndarray[tuple[int], np.dtype[np.uint8]]) -> SignalFaultKind:
    """Return the most serious fault; data loss if there is none."""
    kind = SignalFaultKind(int(fault.max(initial=0)))
    return kind if kind.value else SignalFaultKind.LOST_DATA


def _appended(before: Record | None, record: Record) -> Record:
    """Append times and readings, without NaN."""
    finite = np.isfinite(record["reading_nm"])
    new = Record.unchecked(
        {name: record[name][finite] for name in ("time_s", "reading_nm")}, int(finite.sum())
    )
    return new if before is None else Record.join([before, new])


def _faulty_time(
    faulty: np.ndarray[tuple[int], np.dtype[np.bool_]], before_s: float, window_s: float
) -> tuple[float, float]:
    """Return the duration of the fault at the end of the block, and of the longest fault, s."""
    present_s, longest_s = before_s, 0.0
    for wrong in faulty.tolist():
        present_s = present_s + window_s if wrong else 0.0
        longest_s = max(longest_s, present_s)
    return present_s, longest_s
