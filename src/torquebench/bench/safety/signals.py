"""Checks of the counter's signals: torque, speed, angle, temperature, rates and freshness.

Two stages: a fast check of the bare edges of a few milliseconds, in real time, so that the drives
are stopped at once; and a check of every block after the whole signal path, where faults are
marked.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.description import BenchDescription, TransducerDescription
from torquebench.bench.drivers.base import AngleSamples, CounterBlock, ReferenceReadout
from torquebench.bench.roles import SIDES, Side, reference_channel, torque_channel
from torquebench.bench.safety.alarms import AlarmKind, AlarmLevel, Violation
from torquebench.bench.safety.following import FollowingJudge
from torquebench.bench.safety.limits import LimitBook, Watch
from torquebench.bench.samples import AcquiredBlock, ChannelSamples
from torquebench.bench.state import CommandState
from torquebench.message import Message
from torquebench.signals import EdgeBlock, SignalFaultKind
from torquebench.units import DEG_PER_TURN, MINUTE, RPM_PER_RAD_S

__all__ = ["Change", "FastCheck", "SignalJudge"]

TEMPERATURE_WARNING_K = 5.0
TEMPERATURE_HYSTERESIS_K = 1.0
FEW_EDGES = 8
"""Fewer edges in one fast check give no frequency."""
CLOCKS_APART_S = 0.1
"""Largest deviation of a read-out's clock from the counter's, s, in addition to two of its periods.
"""
CLOCK_SETTLING_S = 1.0
"""Longest time at the start until the times of a read-out's samples are known, s."""
OWN_KEPT_S = 2.0
"""How long a module's torque is kept for comparison with its standard, s."""
HELD_SHARE = 0.01
"""A standard that repeats one value while its module moves by this share of the range is stuck."""


Torques = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Times, s, and torques, N·m."""


class FastCheck(Protocol):
    """Data of a torque channel for a fast check."""

    name: str
    side: Side
    transducer: TransducerDescription

    def torque(self, frequency_hz: float) -> float:
        """Torque of one frequency by the present zero, N·m."""


@dataclass(frozen=True)
class Change:
    """A level that was reached, or ended (`violation` is then None)."""

    watch: Watch
    violation: Violation | None


@dataclass(frozen=True)
class _Held:
    """A value that a standard repeats, and the change of its module's torque meanwhile."""

    value_nm: float
    since_s: float
    lowest_nm: float
    highest_nm: float


_SPEEDS = {side: Message("{side} speed", side) for side in SIDES}
_REMEDIES = {
    AlarmKind.TORQUE_LIMIT: "find out what overloaded the chain before you continue",
    AlarmKind.SPEED_LIMIT: "find out why the drive ran away before you continue",
    AlarmKind.ANGLE_LIMIT: "check whether clamp, coupling or mode conversion has slipped",
    AlarmKind.RATE_LIMIT: "check whether something broke or came loose before you continue",
    AlarmKind.TEMPERATURE_LIMIT: "let the bench cool down",
}


class SignalJudge:
    """Holds every signal against the limits in force; called by acquisition's thread only.

    Parameters
    ----------
    description : BenchDescription
    limits : LimitBook
    commands : CommandState
    readout : ReferenceReadout, optional
        Read-out of a standard that states torque itself, with its own clock.
    """

    def __init__(
        self,
        description: BenchDescription,
        limits: LimitBook,
        commands: CommandState,
        readout: ReferenceReadout | None = None,
    ) -> None:
        self._description = description
        self._readout = readout
        self._limits = limits
        self._commands = commands
        self._warning = description.safety.warning_percent / 100.0
        self._hysteresis = description.safety.hysteresis_percent / 100.0
        self._watches: dict[tuple[AlarmKind, str], Watch] = {}
        self._faulty_s: dict[str, float] = {}
        self._valid_until_s: dict[str, float] = {}
        self._own: dict[Side, Torques] = {}
        self._stated: dict[Side, Torques] = {}
        self._read_until_s: dict[str, float] = {}
        self._last_torque: dict[tuple[str, bool], tuple[float, float]] = {}
        self._last_speed: dict[tuple[Side, bool], tuple[float, float]] = {}
        self._last_angle: dict[Side, tuple[float, float]] = {}
        self._stood_at: dict[Side, tuple[tuple[int, float], float]] = {}
        self._held: dict[Side, _Held] = {}
        self._following = FollowingJudge(description, commands)
        self._forgetting = False
        self._warnings: list[Change] = []
        self._violation: Violation | None = None

    def forget(self) -> None:
        """Begin afresh after an acknowledgement, with the next check; from any thread."""
        self._forgetting = True

    def _begin(self) -> None:
        if not self._forgetting:
            return
        self._forgetting = False
        self._faulty_s.clear()
        self._valid_until_s.clear()
        self._own.clear()
        self._stated.clear()
        self._read_until_s.clear()
        self._stood_at.clear()
        self._held.clear()
        self._last_torque.clear()
        self._last_speed.clear()
        self._following.forget()

    def _result(self) -> tuple[Violation | None, list[Change]]:
        found = self._violation, self._warnings
        self._violation, self._warnings = None, []
        return found

    # -- the fast check ---------------------------------------------------------------------

    def check_edges(
        self, raw: CounterBlock, channels: Mapping[str, FastCheck]
    ) -> tuple[Violation | None, list[Change]]:
        """Check a few milliseconds of bare edges and encoder counts.

        Returns
        -------
        violation : Violation or None
            The first that must stop the bench.
        changes : list of Change
            Warnings that began or ended.
        """
        self._begin()
        for name in self._read_until_s.keys() - raw.edges.keys():
            del self._read_until_s[name]  # a channel that isn't timed any more isn't silent
        for name, edges in raw.edges.items():
            channel = channels.get(name)
            if channel is not None:
                self._check_edges(channel, edges, raw.stop_s)
        for side, angles in raw.angles.items():
            if angles.time_s.size:
                self._turn(side, angles)
        return self._result()

    def _check_edges(self, channel: FastCheck, edges: EdgeBlock, now_s: float) -> None:
        ticks, name = edges.ticks, channel.name
        count = ticks.size
        lowest_hz, highest_hz = channel.transducer.modulation_hz
        frequency = 0.0
        if count >= FEW_EDGES:
            frequency = (count - 1) * edges.timebase_hz / float(ticks[-1] - ticks[0])
        if not lowest_hz <= frequency <= highest_hz:
            self._last_torque.pop((name, True), None)
            read_s = self._read_until_s.setdefault(name, now_s - edges.duration_s)
            allowed_s = self._description.safety.signal_loss_s
            if self._commands.any_enabled and now_s - read_s > allowed_s + 1e-9:
                kind = (
                    SignalFaultKind.NO_PULSES
                    if count < FEW_EDGES
                    else SignalFaultKind.OUT_OF_MODULATION
                )
                self._lost(name, kind, now_s - read_s)
            return
        self._read_until_s[name] = now_s - (edges.stop_tick - int(ticks[-1])) / edges.timebase_hz
        torque = channel.torque(frequency)
        self._torque(channel.side, name, abs(torque))
        before = self._last_torque.get((name, True))
        self._last_torque[name, True] = (now_s, torque)
        if before is not None:
            self._torque_rate(channel.side, name, abs(torque - before[1]) / (now_s - before[0]))

    def _turn(self, side: Side, angles: AngleSamples) -> None:
        per_turn = angles.counts_per_revolution
        time_s, turns = float(angles.time_s[-1]), float(angles.counts[-1]) / per_turn
        before = self._last_angle.get(side)
        if before is None and angles.time_s.size > 1:
            before = float(angles.time_s[0]), float(angles.counts[0]) / per_turn
        self._last_angle[side] = (time_s, turns)
        if before is not None and time_s > before[0]:
            speed_rpm = MINUTE * (turns - before[1]) / (time_s - before[0])
            self._speed(side, speed_rpm, time_s, quick=True)
        self._angle(side, DEG_PER_TURN * turns)

    # -- whole blocks -----------------------------------------------------------------------

    def judge(self, block: AcquiredBlock) -> tuple[Violation | None, list[Change]]:
        """Judge a block after the whole signal path; returns like `check_edges`."""
        self._begin()
        for side in SIDES:
            speed = block.speed_rad_s.get(side)  # a silent encoder is handled below
            if speed is not None:
                self._speed(side, speed * RPM_PER_RAD_S, block.stop_s, quick=False)
            angles = block.angles.get(side)
            if angles is not None and angles.time_s.size:
                self._angle(
                    side, DEG_PER_TURN * float(angles.counts[-1]) / angles.counts_per_revolution
                )
            self._temperature(side, block.temperatures)
        for samples in block.channels.values():
            if samples.torque_nm.size:
                highest = float(np.fmax.reduce(np.abs(samples.torque_nm)))  # NaN isn't a maximum
                self._torque(samples.side, samples.channel, highest)
                self._rate_of_block(samples)
        self._note_readout(block)
        if self._violation is None and self._commands.any_enabled:
            self._missing(block)
            self._faulty(block)
            self._holding(block)
            self._disagreeing(block)
            deviating = self._following.judge(block)
            if deviating is not None:
                self._violated(
                    deviating.kind,
                    deviating.source,
                    deviating.found,
                    deviating.allowed,
                    deviating.remedy,
                )
        elif not self._commands.any_enabled:
            self._held.clear()
            self._own.clear()
            self._stated.clear()
            self._following.forget()
        return self._result()

    def _temperature(self, side: Side, temperatures: Mapping[str, float]) -> None:
        probe = self._description.module(side).temperature_probe
        temperature = temperatures.get(probe)
        if temperature is None:
            return
        limit = self._limits.side(side).temperature_c
        self._level(
            AlarmKind.TEMPERATURE_LIMIT,
            probe,
            math.inf if math.isnan(temperature) else temperature,
            limit,
            "probe {source} {value:.1f} °C",
            "°C",
            (limit - TEMPERATURE_WARNING_K, TEMPERATURE_HYSTERESIS_K),
        )

    def _rate_of_block(self, samples: ChannelSamples) -> None:
        """Judge the change from window to window, by the time from one to the next.

        After a gap, as an instrument leaves whose connection was lost for a moment, that is longer
        than a window.
        """
        if math.isinf(self._limits.side(samples.side).torque_rate_nm_per_s):
            return
        window_s = self._description.counter.window_s
        time_s, torque_nm = samples.time_s, samples.torque_nm
        before = self._last_torque.get((samples.channel, False))
        self._last_torque[samples.channel, False] = (float(time_s[-1]), float(torque_nm[-1]))
        highest = math.nan
        if before is not None:
            highest = abs(float(torque_nm[0]) - before[1])
            highest /= max(float(time_s[0]) - before[0], window_s)
        if time_s.size > 1:
            rates = np.abs(np.diff(torque_nm)) / np.maximum(np.diff(time_s), window_s)
            highest = float(np.fmax.reduce(rates, initial=highest))  # NaN isn't a maximum
        if time_s.size > 1 or before is not None:
            self._torque_rate(samples.side, samples.channel, highest)

    def _missing(self, block: AcquiredBlock) -> None:
        for side in SIDES:
            probe = self._description.module(side).temperature_probe
            if side not in block.speed_rad_s:
                self._no_sample(Message("{side} encoder", side))
            if probe not in block.temperatures:
                self._no_sample(Message("probe {probe}", probe))

    def _no_sample(self, signal: str) -> None:
        self._violated(
            AlarmKind.SIGNAL_LOST,
            signal,
            Message("no sample of the {signal}", signal),
            "samples in every block",
            "check its connection",
        )

    def _faulty(self, block: AcquiredBlock) -> None:
        window_s = self._description.counter.window_s
        for name, samples in block.channels.items():
            if samples.standard and self._readout is not None:
                self._unread(samples, block.stop_s)
                continue
            before_s = self._faulty_s.get(name, 0.0)
            if samples.fault.size == 0:  # no samples at all: as bad as a fault
                faulty_s = longest_s = before_s + (block.stop_s - block.start_s)
                kind = SignalFaultKind.LOST_DATA
            else:
                faulty = (samples.fault != 0) | np.isnan(samples.torque_nm)
                faulty_s, longest_s = _faulty_time(faulty, before_s, window_s)
                named = SignalFaultKind(int(samples.fault.max()))
                kind = named if named.value else SignalFaultKind.LOST_DATA
            self._faulty_s[name] = faulty_s
            if longest_s > self._description.safety.signal_loss_s:
                self._lost(name, kind, longest_s)

    def _note_readout(self, block: AcquiredBlock) -> None:
        """Note the time of a standard's last sample."""
        if self._readout is None:
            return
        standards = {name: each for name, each in block.channels.items() if each.standard}
        for name in self._valid_until_s.keys() - standards.keys():
            del self._valid_until_s[name]
        for name, samples in standards.items():
            until_s = self._valid_until_s.setdefault(name, block.start_s + CLOCK_SETTLING_S)
            valid = np.flatnonzero((samples.fault == 0) & np.isfinite(samples.torque_nm))
            if valid.size:
                newest_s = float(samples.time_s[valid[-1]]) + 0.5 * self._period_s
                self._valid_until_s[name] = max(until_s, newest_s)

    def _unread(self, samples: ChannelSamples, stop_s: float) -> None:
        """Detect a standard's read-out that states no torque any more."""
        # The samples of a block's last period come with the next block.
        allowed_s = self._description.safety.signal_loss_s + 2.0 * self._period_s
        silent_s = stop_s - self._valid_until_s[samples.channel]
        if silent_s > allowed_s + 1e-9:
            kind = SignalFaultKind(int(samples.fault.max(initial=0)))
            kind = kind if kind.value else SignalFaultKind.LOST_DATA
            self._lost(samples.channel, kind, silent_s, allowed_s)

    @property
    def _period_s(self) -> float:
        return 0.0 if self._readout is None else self._readout.period_s

    def _holding(self, block: AcquiredBlock) -> None:
        """Detect a standard that repeats one value while the torque beside it changes."""
        for side in SIDES:
            own = block.channels.get(torque_channel(side))
            standard = block.channels.get(reference_channel(side))
            held = self._held.get(side)
            if own is None or standard is None or own.torque_nm.size == 0:
                self._held.pop(side, None)
                continue
            if standard.torque_nm.size:
                value = float(standard.torque_nm[-1])
            elif held is None:
                continue
            else:  # the next sample comes with a later block
                value = held.value_nm
            if held is None or np.any(standard.torque_nm != value) or value != held.value_nm:
                now_nm = float(own.torque_nm[-1])
                self._held[side] = _Held(value, block.stop_s, now_nm, now_nm)
                continue
            lowest = float(np.fmin.reduce(own.torque_nm, initial=held.lowest_nm))
            highest = float(np.fmax.reduce(own.torque_nm, initial=held.highest_nm))
            self._held[side] = _Held(value, held.since_s, lowest, highest)
            lasted_s = block.stop_s - held.since_s
            moved_enough = HELD_SHARE * self._description.module(side).range_nm
            if lasted_s >= self._description.safety.stuck_s and highest - lowest > moved_enough:
                self._lost(standard.channel, SignalFaultKind.STUCK, lasted_s)

    def _disagreeing(self, block: AcquiredBlock) -> None:
        """Compare a module with the standard on its side, which carries the same torque.

        Both are compared at the same times. Where the standard has its own clock, the module's
        readings before and after are included as far as the clocks may deviate.
        """
        share = self._description.safety.disagreement_percent / 100.0
        apart_s = 0.0 if self._readout is None else 2.0 * self._period_s + CLOCKS_APART_S
        for side in SIDES:
            own = block.channels.get(torque_channel(side))
            standard = block.channels.get(reference_channel(side))
            if own is None or standard is None:
                self._own.pop(side, None)
                self._stated.pop(side, None)
                continue
            time_s, torque_nm = _appended(self._own.get(side), own)
            stated_s, stated_nm = _appended(self._stated.get(side), standard)
            # A standard's sample is compared once the module has been read that far beyond it.
            due = stated_s + apart_s < block.stop_s
            self._stated[side] = stated_s[~due], stated_nm[~due]
            stated_s, stated_nm = stated_s[due], stated_nm[due]
            kept = time_s > block.stop_s - OWN_KEPT_S
            self._own[side] = time_s[kept], torque_nm[kept]
            first = np.searchsorted(time_s, stated_s - apart_s - 1e-9)
            last = np.searchsorted(time_s, stated_s + apart_s + 1e-9)
            deviations = [
                max(float(torque_nm[i:k].min()) - value, value - float(torque_nm[i:k].max()))
                for i, k, value in zip(first, last, stated_nm, strict=True)
                if k > i
            ]
            # during the whole interval, not for a moment of a ramp
            least = min(deviations, default=0.0)
            allowed = share * self._description.module(side).range_nm
            if least > allowed:
                self._violated(
                    AlarmKind.DISAGREEMENT,
                    own.channel,
                    Message(
                        "{own} and {standard} are {value:.1f} N·m apart",
                        own.channel,
                        standard.channel,
                        least,
                    ),
                    Message("at most {allowed:g} N·m", allowed),
                    "find out which of the two transducers is wrong before you continue",
                )

    # -- levels -----------------------------------------------------------------------------

    def _torque(self, side: Side, name: str, torque_nm: float) -> None:
        limit = self._limits.side(side).torque_nm
        self._level(
            AlarmKind.TORQUE_LIMIT, name, torque_nm, limit, "{source} {value:.1f} N·m", "N·m"
        )

    def _speed(self, side: Side, speed_rpm: float, now_s: float, *, quick: bool) -> None:
        limits = self._limits.side(side)
        self._level(
            AlarmKind.SPEED_LIMIT,
            side,
            math.inf if math.isnan(speed_rpm) else abs(speed_rpm),
            limits.speed_rpm,
            "{source} speed {value:.1f} rpm",
            "rpm",
        )
        before = self._last_speed.get((side, quick))
        self._last_speed[side, quick] = (now_s, speed_rpm)
        if before is not None and self._commands.any_enabled and now_s > before[0]:
            self._level(
                AlarmKind.RATE_LIMIT,
                _SPEEDS[side],
                abs(speed_rpm - before[1]) / (now_s - before[0]),
                limits.speed_rate_rpm_per_s,
                "{source} changes by {value:.0f} rpm/s",
                "rpm/s",
            )

    def _torque_rate(self, side: Side, name: str, rate: float) -> None:
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
        limit = self._limits.side(side).angle_deg
        enabled = self._commands.any_enabled
        if math.isinf(limit) or not enabled:
            self._stood_at.pop(side, None)
            return
        epoch = (self._limits.angle_changes[side], limit)
        stood = self._stood_at.get(side)
        if stood is None or stood[0] != epoch:
            stood = self._stood_at[side] = (epoch, angle_deg)
        self._level(
            AlarmKind.ANGLE_LIMIT,
            side,
            abs(angle_deg - stood[1]),
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
        if limit == math.inf:
            return
        watch = self._watches.get((kind, source))
        if watch is None:
            watch = self._watches[kind, source] = Watch()
        level, hysteresis = warning or (self._warning * limit, self._hysteresis * limit)
        changed = watch.judge(value, limit, level, hysteresis)
        if watch.level is not AlarmLevel.CRITICAL and not changed:
            return
        found = Message(text, source, value)
        allowed = Message("at most {limit:g} {unit}", limit, unit)
        if watch.level is AlarmLevel.CRITICAL:
            self._violated(kind, source, found, allowed, _REMEDIES[kind])
        warns = Violation(kind, source, found, allowed, "it stops the bench at the limit")
        self._warnings.append(Change(watch, warns if watch.level is AlarmLevel.WARNING else None))

    def _lost(
        self, name: str, kind: SignalFaultKind, lasted_s: float, allowed_s: float | None = None
    ) -> None:
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
        if self._violation is None:
            self._violation = Violation(kind, source, found, allowed, remedy)


def _appended(before: Torques | None, samples: ChannelSamples) -> Torques:
    """Append the samples that are numbers."""
    known = np.isfinite(samples.torque_nm)
    time_s, torque_nm = samples.time_s[known], samples.torque_nm[known]
    if before is None:
        return time_s, torque_nm
    return np.concatenate((before[0], time_s)), np.concatenate((before[1], torque_nm))


def _faulty_time(
    faulty: np.ndarray[tuple[int], np.dtype[np.bool_]], before_s: float, window_s: float
) -> tuple[float, float]:
    """Return the duration of the fault at the end, and its longest duration, s."""
    present_s, longest_s = before_s, 0.0
    for wrong in faulty.tolist():
        present_s = present_s + window_s if wrong else 0.0
        longest_s = max(longest_s, present_s)
    return present_s, longest_s
