"""The supervisor: watches the bench below every procedure and brings it to a safe state.

It is fed by acquisition in acquisition's thread and has a watchdog thread of its own, so it acts
when the run engine hangs, when the event loop is blocked and when acquisition itself stalls.
Software on a computer is never the safety function: safe torque off, the emergency stop and the
hardware watchdog belong to the drive and the safety relay.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from torquebench.bench.clock import BenchClock
from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.base import DriverSet
from torquebench.bench.roles import SIDES, Side
from torquebench.bench.safety_alarms import (
    Alarm,
    AlarmBook,
    AlarmKind,
    AlarmLevel,
    StandingAlarm,
)
from torquebench.bench.samples import AcquiredBlock
from torquebench.bench.state import CommandState
from torquebench.errors import InterlockError
from torquebench.signals import SignalFaultKind

__all__ = ["Alarm", "AlarmKind", "AlarmLevel", "SafetySupervisor", "StandingAlarm"]

WATCH_PERIOD_S = 0.05
UNLOAD_SETTLING_S = 0.2
"""How long shafts and drives swing after an orderly ramp to zero, s of bench time."""
FAST_PATIENCE = 15.0
"""How much longer a stall may be in simulated time, which doesn't pass meanwhile."""

ROUNDING_S = 1e-6
RPM = 60.0 / (2.0 * np.pi)


@dataclass
class _Heartbeat:
    timeout_s: float
    last_s: float
    ping: Callable[[], None] | None


class SafetySupervisor:
    """Watches limits, signals, drives and heartbeats; ramps to zero, stops, disables, latches.

    Parameters
    ----------
    description : BenchDescription
        Limits of both sides and the section `[safety]`.
    drivers : DriverSet
    clock : BenchClock
    commands : CommandState
    """

    def __init__(
        self,
        description: BenchDescription,
        drivers: DriverSet,
        clock: BenchClock,
        commands: CommandState,
    ) -> None:
        self._description = description
        self._drivers = drivers
        self._clock = clock
        self._commands = commands
        self._lock = threading.RLock()
        self._book = AlarmBook()
        self._heartbeats: dict[str, _Heartbeat] = {}
        self._faulty_s: dict[str, float] = {}
        self._unloaded_s = 0.0
        self._disable_at_s = 0.0
        self._disable_at_wall = 0.0
        self._safe = threading.Event()
        self._safe.set()
        self._busy_since: float | None = None
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="torquebench-safety", daemon=True)

    # -- state ------------------------------------------------------------------------------

    @property
    def alarm(self) -> Alarm | None:
        """The latched alarm, None when there is none."""
        return self._book.latched

    @property
    def alarms(self) -> tuple[StandingAlarm, ...]:
        """Alarms that stand, the worst first: what is latched, its later causes, warnings."""
        return self._book.standing

    @property
    def history(self) -> tuple[Alarm, ...]:
        """Every critical alarm since the bench was opened, later causes of a latched one too."""
        critical = AlarmLevel.CRITICAL
        return tuple(each.alarm for each in self._book.entries if each.alarm.level is critical)

    @property
    def entries(self) -> tuple[StandingAlarm, ...]:
        """Every alarm and warning since the bench was opened, and what has become of it."""
        return self._book.entries

    def raise_if_latched(self) -> None:
        """Raise the latched alarm's error."""
        alarm = self._book.latched
        if alarm is not None:
            raise alarm.error()

    def wait_safe(self, timeout_s: float) -> bool:
        """Wait (wall time) until the drives are disabled after an alarm; True when they are."""
        return self._safe.wait(timeout_s)

    def acknowledge(self, who: str) -> Alarm | None:
        """Clear the latched alarm, once the safe state is reached; return what was cleared.

        Parameters
        ----------
        who : str
            The person who has removed the cause.

        Raises
        ------
        InterlockError
            The bench isn't in its safe state yet.
        InputError
            Nobody is named.
        """
        with self._lock:
            alarm = self._book.latched
            if alarm is None:
                return None
            if not self._safe.is_set():
                raise InterlockError(
                    f"alarm {alarm.kind.value} while the drives still ramp to zero",
                    "acknowledgement in the safe state",
                    "wait a moment",
                )
            if not who.strip():
                raise InterlockError("acknowledgement by nobody", "a person's name")
            self._faulty_s.clear()
            return self._book.acknowledge(who.strip())

    def subscribe(self, listener: Callable[[StandingAlarm], None]) -> None:
        """Call this when an alarm or a warning comes, is cleared or is acknowledged.

        In the thread that notes it, which is the supervisor's or acquisition's: be quick.
        """
        self._book.subscribe(listener)

    # -- heartbeats -------------------------------------------------------------------------

    def expect(self, name: str, timeout_s: float, ping: Callable[[], None] | None = None) -> None:
        """Require a heartbeat from now on, at the latest every `timeout_s` of bench time.

        `ping` is called with every block and may ask for the beat without waiting for it.
        """
        with self._lock:
            self._heartbeats[name] = _Heartbeat(timeout_s, self._clock.now(), ping)

    def beat(self, name: str) -> None:
        """Note that the named part lives."""
        heartbeat = self._heartbeats.get(name)
        if heartbeat is not None:
            heartbeat.last_s = self._clock.now()

    def release(self, name: str) -> None:
        """Require the heartbeat no longer."""
        with self._lock:
            self._heartbeats.pop(name, None)

    # -- what acquisition calls -------------------------------------------------------------

    @contextlib.contextmanager
    def guarding_block(self) -> Iterator[None]:
        """Guard the making of one block: taking longer than `stall_s` of wall time is a stall."""
        self._busy_since = time.monotonic()
        try:
            yield
        finally:
            self._busy_since = None

    def check(self, block: AcquiredBlock) -> None:
        """Judge a block; act on what is wrong, go on with an action that has begun."""
        if self._book.latched is None:
            violation = self._violation(block)
            if violation is not None:
                self.trip(*violation)
        if not self._safe.is_set() and block.stop_s > self._disable_at_s - ROUNDING_S:
            self.disable()
        if self._book.latched is None or not self._safe.is_set():
            for drive in self._drivers.drives.values():
                drive.feed_watchdog()

    def _violation(self, block: AcquiredBlock) -> tuple[AlarmKind, str, str, str, str] | None:
        for side in SIDES:
            limits = self._description.module(side).limits
            speed = abs(block.speed_rad_s.get(side, 0.0)) * RPM  # a silent encoder: see below
            if not speed <= limits.speed_rpm:
                return (
                    AlarmKind.SPEED_LIMIT,
                    side,
                    f"{side} speed {speed:.1f} rpm",
                    f"at most {limits.speed_rpm:g} rpm",
                    "find out why the drive ran away before going on",
                )
            probe = self._description.module(side).temperature_probe
            temperature = block.temperatures.get(probe)
            if temperature is not None and not temperature <= limits.temperature_c:
                return (
                    AlarmKind.TEMPERATURE_LIMIT,
                    probe,
                    f"probe {probe} {temperature:.1f} °C",
                    f"at most {limits.temperature_c:g} °C",
                    "let the bench cool down",
                )
        return self._torque_violation(block) or (
            (self._signal_violation(block) or self._drive_violation() or self._heartbeat_missing())
            if self._commands.any_enabled
            else None
        )

    def _torque_violation(
        self, block: AcquiredBlock
    ) -> tuple[AlarmKind, str, str, str, str] | None:
        for samples in block.channels.values():
            limit = self._description.module(samples.side).limits.torque_nm
            if samples.torque_nm.size == 0:
                continue
            highest = float(np.fmax.reduce(np.abs(samples.torque_nm)))  # NaN isn't a maximum
            if highest > limit:
                return (
                    AlarmKind.TORQUE_LIMIT,
                    samples.channel,
                    f"{samples.channel} {highest:.1f} N·m",
                    f"at most {limit:g} N·m",
                    "find out what overloaded the chain before going on",
                )
        return None

    def _signal_violation(
        self, block: AcquiredBlock
    ) -> tuple[AlarmKind, str, str, str, str] | None:
        for side in SIDES:
            probe = self._description.module(side).temperature_probe
            for signal, present in (
                (f"{side} encoder", side in block.speed_rad_s),
                (f"probe {probe}", probe in block.temperatures),
            ):
                if not present:
                    return (
                        AlarmKind.SIGNAL_LOST,
                        signal,
                        f"no sample of the {signal}",
                        "samples in every block",
                        "check its connection",
                    )
        window_s = self._description.counter.window_s
        for name, samples in block.channels.items():
            if samples.fault.size == 0:  # nothing at all came: as bad as a fault
                faulty_s = self._faulty_s.get(name, 0.0) + (block.stop_s - block.start_s)
                kind = SignalFaultKind.LOST_DATA
                longest_s = faulty_s
            else:
                faulty_s, longest_s = _faulty_time(
                    samples.fault, self._faulty_s.get(name, 0.0), window_s
                )
                kind = SignalFaultKind(int(samples.fault.max()))
            self._faulty_s[name] = faulty_s
            if longest_s > self._description.safety.signal_loss_s:
                return (
                    AlarmKind.SIGNAL_LOST,
                    name,
                    f"{name}: {kind.description} for {longest_s:.3f} s",
                    f"at most {self._description.safety.signal_loss_s:g} s",
                    kind.remedy,
                )
        return None

    def _drive_violation(self) -> tuple[AlarmKind, str, str, str, str] | None:
        for side, drive in self._drivers.drives.items():
            if not self._commands.side(side).enabled:
                continue
            state = drive.state()
            if state.fault or not state.enabled:
                return (
                    AlarmKind.DRIVE_FAULT,
                    side,
                    f"{side} drive: {state.fault or 'lost its enable'}",
                    "an enabled drive without fault",
                    "read the drive's fault code",
                )
        return None

    def _heartbeat_missing(self) -> tuple[AlarmKind, str, str, str, str] | None:
        now = self._clock.now()
        with self._lock:
            heartbeats = list(self._heartbeats.items())
        for name, heartbeat in heartbeats:
            silent_s = now - heartbeat.last_s
            if silent_s > heartbeat.timeout_s:
                return (
                    AlarmKind.HEARTBEAT,
                    name,
                    f"no heartbeat of the {name} for {silent_s:.1f} s",
                    f"at most {heartbeat.timeout_s:g} s",
                    "restart the software that hangs",
                )
            if heartbeat.ping is not None:
                heartbeat.ping()
        return None

    # -- acting -----------------------------------------------------------------------------

    def trip(self, kind: AlarmKind, source: str, found: str, allowed: str, remedy: str) -> Alarm:
        """Bring the bench to its safe state and latch an alarm; callable from any thread.

        While one alarm is latched a further one is only added to the history.
        """
        with self._lock:
            latched = self._book.latched
            if latched is None:
                self._safe.clear()
            alarm = self._book.add(Alarm(kind, source, found, allowed, remedy, self._clock.now()))
            if latched is not None:
                self._book.announce(alarm.number)
                return alarm
            ramp_s = self._description.safety.ramp_to_zero_s
            for side in SIDES:
                self._ramp_to_zero(side, ramp_s)
            settled_s = self._clock.now() + ramp_s + self._description.counter.block_s
            self._disable_at_s = settled_s
            self._disable_at_wall = time.monotonic() + ramp_s + self._description.safety.stall_s
        self._clock.interrupt(alarm.error())
        self._clock.require(settled_s)
        self._book.announce(alarm.number)
        return alarm

    def unload(self, sides: Iterable[Side] = SIDES) -> float:
        """Bring drives to zero torque and speed at their own rates, as no alarm demands haste.

        Returns
        -------
        float
            Bench time until they are there and have settled, s; 0 where they are already.
        """
        with self._lock:
            now = self._clock.now()
            for side in sides:
                commands, rates = self._commands.side(side), self._description.module(side).drive
                ramp_s = max(
                    abs(commands.torque_nm) / rates.torque_rate_nm_per_s,
                    abs(commands.speed_rad_s) / rates.speed_rate_rad_per_s2,
                )
                if commands.enabled and ramp_s > 0.0:  # else it is there, or on its way
                    self._ramp_to_zero(side, ramp_s)
                    self._unloaded_s = max(self._unloaded_s, now + ramp_s + UNLOAD_SETTLING_S)
            return max(0.0, self._unloaded_s - now)

    def _ramp_to_zero(self, side: Side, ramp_s: float) -> None:
        """Tell a drive to go to zero torque and speed, and disable one that can't."""
        drive = self._drivers.drives[side]
        try:
            drive.ramp_to_zero(ramp_s)
        except Exception:  # whatever is wrong with it, it must not go on
            with contextlib.suppress(Exception):
                drive.disable()
        self._commands.side(side).at_zero(self._clock.now())

    def disable(self) -> None:
        """Take the power off both drives; with an alarm latched this ends the way to safety."""
        for side, drive in self._drivers.drives.items():
            with contextlib.suppress(Exception):  # the other one must be disabled in any case
                drive.disable()
            self._commands.side(side).off(self._clock.now())
        self._safe.set()

    # -- the watchdog thread ----------------------------------------------------------------

    def start(self) -> None:
        """Start the watchdog thread."""
        self._thread.start()

    def close(self) -> None:
        """End the watchdog thread. A second call does nothing."""
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join()

    def _watch(self) -> None:
        stall_s = self._description.safety.stall_s
        if self._clock.fast:  # bench time stands while the machine is busy with something else
            stall_s *= FAST_PATIENCE
        while not self._closing.wait(WATCH_PERIOD_S):
            busy_since = self._busy_since
            stalled = busy_since is not None and time.monotonic() - busy_since > stall_s
            if stalled and self._book.latched is None and self._commands.any_enabled:
                self.trip(
                    AlarmKind.STALL,
                    "acquisition",
                    f"no block of samples for {stall_s:g} s of wall time",
                    "a block in its own time",
                    "check the counter's connection and the computer's load",
                )
            if not self._safe.is_set() and time.monotonic() > self._disable_at_wall:
                self.disable()


def _faulty_time(
    fault: np.ndarray[tuple[int], np.dtype[np.uint8]], before_s: float, window_s: float
) -> tuple[float, float]:
    """Return how long the fault lasts at the end, and how long it lasted at its longest, s."""
    present_s, longest_s = before_s, 0.0
    for code in fault.tolist():
        present_s = present_s + window_s if code else 0.0
        longest_s = max(longest_s, present_s)
    return present_s, longest_s
