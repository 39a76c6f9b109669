"""Continuous acquisition in a thread of its own: from edges to torque.

A block of edges becomes frequency, torque and, with an active compensation, compensated torque.
Then the supervisor checks it, the journal records it (a journal failure brings the bench to the
safe state), and viewers receive it.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from torquebench.bench.active_chain import ActiveChain, ZeroTaken
from torquebench.bench.blocks import Block, Viewer
from torquebench.bench.channels import Channel, open_channel
from torquebench.bench.clock import BenchClock
from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.base import DriverSet
from torquebench.bench.evaluating import BlockEvaluator, mean_speed
from torquebench.bench.roles import (
    SIDES,
    Mounting,
    Side,
    reference_channel,
    torque_channel,
)
from torquebench.bench.safety import AlarmKind, SafetySupervisor
from torquebench.bench.safety.priority import collecting_later, prefer_this_thread
from torquebench.bench.state import CommandState
from torquebench.errors import BenchError, ModelMismatchError, SignalFault, TorquebenchError
from torquebench.message import Message
from torquebench.signals import EdgeBlock, Record
from torquebench.units import TURN

CATCHING_UP_S = 10.0
"""Largest backlog of bench time that is read at the start, s."""
CAUGHT_UP_BLOCKS = 10
"""Number of blocks in a row that came no sooner than the one before, after which the counter's
buffer counts as empty.
"""
HELD_BLOCKS = 20
"""Largest number of blocks that are compensated and recorded together in fast time."""
REST_CHECK_S = 0.05
"""Longest interval between two checks of the signals while no drive has power, s."""
COOLING_S = 1.0
"""Time after the last drive went off until the signals are checked less often, s of bench time."""
JOINED_S = 1.0
"""Length of the blocks that are kept for viewers that begin earlier, s."""
DEMAND_POLL_S = 0.05
"""Interval at which an idle fast bench checks whether it shall end, s of wall time."""
LATE_BLOCKS = 3
"""Number of blocks of backlog from which on the counter's buffer is read in one request."""
LONGEST_READ_S = 10.0
"""Longest time for which one request reads buffered data, s, because buffers and memory are
limited."""
LATE_S = 1.0
"""Delay of acquisition above which an alarm is raised, s."""

logger = logging.getLogger(__name__)


class JournalSink(Protocol):
    """A sink that records every block. An exception in it brings the bench to its safe state."""

    def write(self, block: Block) -> None:
        """Record a block, or several joined blocks."""


class Acquisition:
    """Converts the counter card's edges to torque continuously, in a thread of its own.

    Parameters
    ----------
    clock : BenchClock
        Acquisition advances it: bench time is the acquired time.
    """

    def __init__(
        self,
        description: BenchDescription,
        drivers: DriverSet,
        clock: BenchClock,
        supervisor: SafetySupervisor,
        commands: CommandState,
    ) -> None:
        self._description = description
        self._drivers = drivers
        self._clock = clock
        self._supervisor = supervisor
        self._commands = commands
        self._block_s = description.counter.block_s
        slice_s = max(description.safety.fast_check_s, drivers.shortest_read_s)
        # In fast simulated time nobody can react between blocks.
        self._slices = 1 if clock.fast else max(1, int(self._block_s / slice_s + 1e-9))
        self._rest_slices = max(1, int(REST_CHECK_S * self._slices / self._block_s + 1e-9))
        self._powered_s = -math.inf
        self._index = 0
        self._lock = threading.RLock()
        self._channels: dict[str, Channel] = {}
        self._zeros: dict[str, float] = {}
        self._zeroed: dict[Side, ZeroTaken] = {}
        self._mounted: Mounting = drivers.operator.mounted()
        self._reference_sides: frozenset[Side] = frozenset(SIDES)
        self._evaluator = BlockEvaluator(description, drivers)
        self._latest_block: Block | None = None
        self._compensations: dict[Side, ActiveChain] = {}
        self._switched_off: dict[Side, tuple[str, ...]] = {}
        self._journal: JournalSink | None = None
        self._held: list[Block] = []
        self._past: deque[Block] = deque()
        self._newest: list[Block] = []
        self._remembered_s = 0.0
        self._release_lock = threading.RLock()
        self._viewers: tuple[Viewer, ...] = ()
        self._stopping = threading.Event()
        self._wall_start = 0.0
        self._thread = threading.Thread(
            target=self._run, name="torquebench-acquisition", daemon=True
        )
        self._select()

    # -- life -------------------------------------------------------------------------------

    def start(self) -> None:
        """Acquire a first block in the calling thread, then continue in a thread of its own."""
        self._warm_up()
        self._step()  # this also compiles the kernels, before anything can be loaded
        if not self._clock.fast and not self._drivers.simulated_time:
            self._catch_up()
        self._wall_start = time.monotonic() - self._block_s
        self._thread.start()

    def _warm_up(self) -> None:
        """Compile the edge-counting kernels before the counter's limited buffer begins to fill."""
        name, timebase_hz = torque_channel(SIDES[0]), self._drivers.counter.timebase_hz
        channel = open_channel(name, self._description, self._drivers, self._mounted)
        if channel.transducer.signal != "frequency":
            return
        stop_tick = round(self._block_s * timebase_hz)
        period = round(timebase_hz / channel.transducer.zero_hz)
        ticks = np.arange(period, stop_tick, period, dtype=np.int64)
        channel.push(EdgeBlock(ticks, 0, stop_tick, timebase_hz))

    def _catch_up(self) -> None:
        """Read the blocks that the counter has buffered, until it delivers in real time.

        A counter that doesn't state its backlog delivers buffered blocks at once: while there is a
        backlog, every block comes sooner than the one before.
        """
        behind_s: list[float] = []
        for _ in range(round(CATCHING_UP_S / self._block_s)):
            waiting_s = self._step()
            if waiting_s is not None and waiting_s < self._block_s:
                return
            behind_s.append(time.monotonic() - self._clock.now())
            before_s = behind_s[:-CAUGHT_UP_BLOCKS]
            if waiting_s is not None or not before_s:
                continue
            if min(before_s) - min(behind_s) < self._description.counter.window_s:
                return

    def close(self) -> None:
        """End the thread. A second call does nothing."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join()
        with self._release_lock:
            self._release()
        self._clock.stop(BenchError("the bench is closed", "an open bench", "open it again"))

    @property
    def running(self) -> bool:
        """Whether the thread is running, so that samples may arrive."""
        return self._thread.is_alive()

    @property
    def blocks(self) -> int:
        """Number of acquired blocks."""
        return self._index

    def _run(self) -> None:
        """Read and evaluate blocks until acquisition is stopped; any failure stops the bench."""
        if not self._clock.fast:
            prefer_this_thread()
        try:
            while not self._stopping.is_set():
                if not self._clock.wait_for_demand(DEMAND_POLL_S):
                    continue
                if not self._paced(self._next_slices(0) / self._slices):
                    continue
                with self._supervisor.guarding_block(), collecting_later():
                    self._step()
        except Exception as error:  # whatever has failed, the bench must not stay loaded
            if not isinstance(error, TorquebenchError):  # an instrument's failure is an alarm
                logger.exception("acquisition ended")
            self._supervisor.trip(
                AlarmKind.DRIVER,
                "acquisition",
                Message("{name}: {error}", type(error).__name__, error),
                "an uninterrupted stream of samples",
                "check the named instrument and open the bench again",
            )
            self._clock.stop(
                BenchError(
                    Message("acquisition has ended: {error}", error), "", "open the bench again"
                )
            )

    def _next_slices(self, read: int) -> int:
        """Return how many slices of a block are read at once, after those that have been read.

        While no drive has power there is nothing to switch off: long slices save processor time. A
        drive that is switched on waits for the end of the present block, see `DriveSwitch`.
        """
        return min(self._rest_slices if self._resting() else 1, self._slices - read)

    def _resting(self) -> bool:
        """Return whether no drive has had power lately."""
        if self._commands.any_powered:
            self._powered_s = self._clock.now()
        return self._clock.now() - self._powered_s > COOLING_S

    def _paced(self, share: float) -> bool:
        """Wait until the wall clock reaches simulated time; return False when acquisition ends."""
        if self._clock.fast or not self._drivers.simulated_time:
            return True
        due = self._wall_start + (self._index + share) * self._block_s
        ahead_s = due - time.monotonic()
        if ahead_s > 0.0:
            return not self._stopping.wait(ahead_s)
        if ahead_s < -LATE_S:  # simulated time has stood still, and continues from here
            self._wall_start -= ahead_s
            self._clock.stood(-ahead_s)
        return True

    def _step(self) -> float | None:
        """Acquire a block; return the counter's backlog in seconds, None if unknown."""
        measured = self._read()
        behind_s = None if measured.waiting_s is None else time.monotonic() - measured.timed_s
        with self._lock:
            channels = list(self._channels.values())
        block = self._evaluator.evaluate(measured, channels)
        self._index += 1
        self._latest_block = block
        self._supervisor.check(block)
        self._hand_on(block)
        self._clock.advance_to(block.stop_s, behind_s)
        if not self._drivers.simulated_time:
            self._supervisor.check_lateness(self._clock.late_s, LATE_S)
        return measured.waiting_s

    def _read(self) -> Block:
        """Return the next block, slice by slice through the supervisor's fast check.

        A backlog is read in one request: block by block it would never be worked off.
        """
        counter = self._drivers.counter
        if not self._drivers.simulated_time:
            late_blocks = int(min(self._clock.late_s, LONGEST_READ_S) / self._block_s)
            if late_blocks >= LATE_BLOCKS:
                return counter.read_block(late_blocks * self._block_s)
        parts: list[Block] = []
        read = 0
        while read < self._slices:
            count = self._next_slices(read)
            read += count
            self._paced(read / self._slices)
            parts.append(counter.read_block(self._block_s * count / self._slices))
            if count < self._slices:  # a whole block is checked when it is evaluated
                self._supervisor.check_edges(parts[-1], self._channels)
        return Block.join(parts) if len(parts) > 1 else parts[0]

    def _hand_on(self, block: Block) -> None:
        """Compensate and record a block; in fast time, several blocks together."""
        with self._release_lock:
            failure = None
            if self._held and not block.follows(self._held[-1]):
                failure = self._release()
            self._held.append(block)
            if self._due(block.stop_s):
                failure = self._release() or failure
        self._raise_alarm(failure)

    def _due(self, stop_s: float) -> bool:
        """Return whether the held blocks are compensated now: on time, but no more than needed."""
        if self._clock.fast:
            return len(self._held) >= HELD_BLOCKS or self._clock.wakes(stop_s)
        if self._journal is not None or not self._resting():
            return True
        patience_s = min((viewer.patience_s for viewer in self._viewers), default=JOINED_S)
        held_s = stop_s - self._held[0].start_s
        return held_s > patience_s - 1e-9 or (self._clock.sleeping and self._clock.wakes(stop_s))

    def _release(self) -> Exception | None:
        """Compensate and record the held blocks; return the journal's failure."""
        if not self._held:
            return None
        block = self._evaluator.compensate(self._held, self._channels, self._compensations)
        if all(viewer.patience_s for viewer in self._viewers):
            parts = [block]
        else:
            spans = [(held.start_s, held.stop_s) for held in self._held]
            parts = [block.part(*span) for span in spans] if len(spans) > 1 else [block]
        for part in parts:
            for viewer in self._viewers:
                viewer.put(part)
        self._held.clear()
        if self._remembered_s:
            # edges take most of the memory
            remembered = block if self._description.recording.edges else replace(block, edges={})
            self._remember(remembered)
        return self._keep(block)

    def _remember(self, block: Block) -> None:
        """Keep a block for viewers that begin earlier; blocks are joined, which saves memory."""
        newest = self._newest
        if newest and (
            newest[-1].stop_s - newest[0].start_s >= JOINED_S or not block.joins(newest[-1])
        ):
            self._past.append(Block.join(newest))
            newest.clear()
            begin_s = block.stop_s - self._remembered_s
            while self._past and self._past[0].stop_s <= begin_s:
                self._past.popleft()
        newest.append(block)

    def _keep(self, block: Block) -> Exception | None:
        """Write a block to the journal; return the journal's error, if any."""
        if self._journal is None:
            return None
        try:
            self._journal.write(block)
        except Exception as error:  # a full disk or a bug: in both cases nothing is recorded
            self._journal = None
            return error
        return None

    def _release_held(self) -> None:
        """Compensate and record the held blocks before a setting changes."""
        with self._release_lock:
            failure = self._release()
        self._raise_alarm(failure)

    def _raise_alarm(self, failure: Exception | None) -> None:
        """Stop the bench because the journal failed; to be called without the lock."""
        if failure is None:
            return
        self._supervisor.trip(
            AlarmKind.JOURNAL,
            "journal",
            Message("{name}: {failure}", type(failure).__name__, failure),
            "every block kept",
            "make room on the disk or repair it, then repeat the run",
        )

    # -- journal and viewers ----------------------------------------------------------------

    def remember(self, seconds: float) -> None:
        """Keep the blocks of the last `seconds` from now on, for viewers that begin earlier."""
        with self._release_lock:
            self._remembered_s = seconds

    def set_journal(self, journal: JournalSink | None) -> None:
        """Record blocks in this journal from the next block on; None ends it."""
        with self._release_lock:
            failure = self._release()
            self._journal = journal
        self._raise_alarm(failure)

    def add_viewer(
        self, maximum: int = 100, *, before_s: float = 0.0, complete: bool = False
    ) -> Viewer:
        """Add a viewer, which gets every block and drops the oldest blocks if it is too slow.

        Parameters
        ----------
        maximum : int
            Largest number of waiting blocks.
        before_s : float
            It first gets the kept blocks that ended at most this time before the newest one, s.
        complete : bool
            Whether acquisition waits for it in fast simulated time, where nobody is in a hurry.
        """
        with self._release_lock:
            failure = self._release()
            past = [*self._past, *self._newest]
            begin_s = past[-1].stop_s - before_s if past else 0.0
            past = [block for block in past if block.stop_s > begin_s + 1e-9]
            viewer = Viewer(maximum + len(past), complete and self._clock.fast)
            for block in past:
                viewer.put(block)
            with self._lock:
                self._viewers = (*self._viewers, viewer)
        self._raise_alarm(failure)
        return viewer

    def remove_viewer(self, viewer: Viewer) -> None:
        """Send no more blocks to this viewer."""
        viewer.close()
        with self._lock:
            self._viewers = tuple(other for other in self._viewers if other is not viewer)

    # -- channels ---------------------------------------------------------------------------

    def select_for(self, mounting: Mounting) -> None:
        """Time the channels of this mounting; unused channels cost nothing."""
        with self._lock:
            self._mounted = mounting
            self._reference_sides = frozenset(SIDES)
            for side in SIDES:  # another reference standard has another zero
                self._channels.pop(reference_channel(side), None)
                self._zeros.pop(reference_channel(side), None)
            self._select()

    def use_reference(self, side: Side) -> None:
        """Time this side of the mounted standard, and its other side only if the drive is on."""
        enabled = {other for other in self._reference_sides if self._commands.side(other).enabled}
        wanted = frozenset({side} | enabled)
        if wanted != self._reference_sides:
            with self._lock:
                self._reference_sides = wanted
                self._select()

    def channel_of_standard(self, side: Side) -> Channel:
        """Use this side of the mounted standard and return its channel; see `use_reference`."""
        self.use_reference(side)
        return self.channel(reference_channel(side))

    def _select(self) -> None:
        """Time the torque channels of what is mounted, each with the zero last taken for it."""
        standard = self._description.standard(self._mounted)
        names = [torque_channel(side) for side in SIDES]
        if standard is not None:
            names += [reference_channel(side) for side in SIDES if side in self._reference_sides]
        self._channels = {
            name: self._channels.get(name)
            or open_channel(name, self._description, self._drivers, self._mounted)
            for name in names
        }
        for name, channel in self._channels.items():
            if name in self._zeros:
                channel.zero = self._zeros[name]
        timed = names if self._drivers.reference is None else names[: len(SIDES)]
        self._drivers.counter.select(frozenset(timed))

    def channel(self, name: str) -> Channel:
        """Return a channel in use.

        Raises
        ------
        SignalFault
            The channel isn't timed with what is mounted.
        """
        channel = self._channels.get(name)
        if channel is None:
            raise SignalFault(
                Message(
                    "{name} isn't in use with {mounted} mounted",
                    name,
                    self._mounted.replace("_", " "),
                ),
                Message("one of {list}", ", ".join(self._channels)),
                "mount a standard to read it",
            )
        return channel

    def reading_nm(self, name: str) -> float:
        """Return the newest reading of a channel; raises SignalFault for none or a faulty one."""
        return float(self.channel(name).latest()["reading_nm"][0])

    def window(self, name: str, start_s: float, stop_s: float) -> Record:
        """Return a channel's windows with centres in [start, stop), all without a fault.

        Raises
        ------
        SignalFault
            A faulty window, or a channel that isn't in use or has no windows yet.
        """
        record = self.channel(name).recent.window(start_s, stop_s)
        if record is None:
            raise SignalFault(Message("{name}: no sample yet", name), "a running acquisition")
        return record.raise_on_fault(name)

    def zero(self, name: str) -> float:
        """Zero in use of a channel, in its signal's unit; for an unused channel the last zero."""
        channel = self._channels.get(name)
        return channel.zero if channel is not None else self._zeros.get(name, 0.0)

    def set_zero(self, name: str, signal: float, standard_uncertainty_nm: float) -> None:
        """Use a signal as the zero from the next block on.

        Raises
        ------
        SignalFault
            The channel isn't timed, or the zero is implausible.
        """
        self._release_held()
        with self._lock:
            channel = self.channel(name)
            channel.zero = signal
            self._zeros[name] = signal
            if not channel.standard:
                probe = self._description.module(channel.side).temperature_probe
                self._zeroed[channel.side] = ZeroTaken(
                    self._clock.now(),
                    self.latest_block.temperature_c(probe),
                    standard_uncertainty_nm,
                )
                if channel.side in self._compensations:
                    self._compensations[channel.side].take_zero(self._zeroed[channel.side])

    # -- compensation -----------------------------------------------------------------------

    def set_compensation(self, side: Side, active: ActiveChain | None) -> None:
        """Compensate a side from the next block on; None ends the compensation."""
        if active is not None:
            active.zero = self._zeroed.get(side)
        with self._release_lock:
            if active is not None and side in self._switched_off:
                active.switch_off(self._switched_off[side])
            failure = self._release()
            compensations = dict(self._compensations)
            compensations.pop(side, None)
            if active is not None:
                compensations[side] = active
            self._compensations = compensations
        self._raise_alarm(failure)

    def compensation(self, side: Side) -> ActiveChain | None:
        """Return the compensation that is active on a side."""
        return self._compensations.get(side)

    def switch_off(self, side: Side, off: Sequence[str]) -> None:
        """Switch off these corrections of a side from the next block on, and switch on all others.

        Models that are activated later on this side have the same corrections switched off.

        Raises
        ------
        ModelMismatchError
            No model is active on the side.
        InputError
            The chain has no such correction.
        """
        failure = None
        try:
            with self._release_lock:
                active = self._compensations.get(side)
                if active is None:
                    raise ModelMismatchError(
                        Message("no active model for the {side} side", side),
                        "an active model",
                        "activate one",
                    )
                failure = self._release()
                active.switch_off(off)
                self._switched_off[side] = tuple(off)
        finally:
            self._raise_alarm(failure)

    # -- angle, speed, temperature ----------------------------------------------------------

    @property
    def latest_block(self) -> Block:
        """The newest block, without compensation."""
        if self._latest_block is None:
            raise SignalFault("no block of samples yet", "a running acquisition")
        return self._latest_block

    def angle_rad(self, side: Side) -> float:
        """Newest angle of a side, rad, unwrapped. Raises SignalFault for a silent encoder."""
        count_rad, angle = self._count_rad(side), self.latest_block.angle(side)
        if angle is None or not len(angle):
            raise _silent_encoder(side)
        return float(angle["angle_counts"][-1]) * count_rad

    def speed_rad_s(self, side: Side) -> float:
        """Mean speed of a side over the newest block, rad/s; raises errors like `angle_rad`."""
        self._description.needed_encoder(side)
        speed = self.latest_block.speed_rad_s(side)
        if math.isnan(speed):
            raise _silent_encoder(side)
        return speed

    def mean_speed_rad_s(self, side: Side, start_s: float, stop_s: float) -> float:
        """Mean speed of a side over a window of bench time, rad/s; errors as in `angle_rad`."""
        per_revolution = self._description.needed_encoder(side).counts_per_revolution
        angle = self._evaluator.angles[side].window(start_s, stop_s)
        if angle is None or len(angle) < 2:
            raise _silent_encoder(side)
        return mean_speed(angle, per_revolution)

    def angles(self, side: Side, start_s: float, stop_s: float) -> Record:
        """Return `time_s` and `angle_rad` of a side over a window of bench time."""
        angle = self._evaluator.angles[side].window(start_s, stop_s)
        if angle is None:
            return Record({"time_s": np.zeros(0), "angle_rad": np.zeros(0)})
        angle_rad = angle["angle_counts"] * self._count_rad(side)
        return Record({"time_s": angle.time_s, "angle_rad": angle_rad})

    def _count_rad(self, side: Side) -> float:
        return TURN / self._description.needed_encoder(side).counts_per_revolution

    def temperature_c(self, probe: str) -> float:
        """Newest temperature of a probe, °C. Raises SignalFault for a silent one."""
        temperature = self.latest_block.temperature_c(probe)
        if math.isnan(temperature):
            raise SignalFault(
                Message("no temperature from the probe {probe}", probe),
                Message("one of {list}", ", ".join(self._description.temperatures)),
                "check the probe's connection",
            )
        return temperature


def _silent_encoder(side: Side) -> SignalFault:
    return SignalFault(
        Message("no angle from the {side} encoder", side),
        "samples in every block",
        "check its connection",
    )
