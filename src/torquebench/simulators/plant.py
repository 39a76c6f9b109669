"""The simulated bench that all simulators of one description share, and its time.

With time "on-demand", bench time advances when the counter is read: a request for samples up to a
time simulates them. Unmodified drivers are then exact at any speed, because the counter's clock is
the bench's clock. If the counter is no longer read while a drive is on (the client was killed),
time follows the wall clock, so that the drive's own watchdog can trip.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.blocks import Block
from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.instruments import SimulationOptions
from torquebench.bench.drivers.simulated.driver import SimulatedBench
from torquebench.bench.roles import CHANNELS, SIDES, Side, angle_channel
from torquebench.signals import EdgeBlock

STEP_S = 0.05
"""Longest part of bench time that is simulated at once, s."""
WALL_STEP_S = 0.005
LONGEST_STALL_S = 2.0
"""Time without simulation after which a plant in real time counts as stopped, s."""
KEPT_TORQUES = 400
KEPT_COUNTS = 400

Ticks = NDArray[np.int64]


class EdgeTap:
    """Buffer of one channel's edges for one counter input."""

    def __init__(self, channel: str) -> None:
        self.channel = channel
        self._blocks: list[EdgeBlock] = []

    def put(self, block: EdgeBlock) -> None:
        """Add the plant's new data."""
        self._blocks.append(block)

    def take(self) -> list[EdgeBlock]:
        """Return the data since the last call, oldest first."""
        taken, self._blocks = self._blocks, []
        return taken


class AngleTap:
    """Buffer of one encoder's counts, sampled every millisecond."""

    def __init__(self, side: Side) -> None:
        self.side = side
        self._samples: list[tuple[NDArray[np.float64], Ticks]] = []

    def put(self, time_s: NDArray[np.float64], counts: Ticks) -> None:
        """Add the plant's new data."""
        self._samples.append((time_s, counts))

    def take(self) -> tuple[NDArray[np.float64], Ticks]:
        """Return times and counts since the last call."""
        taken, self._samples = self._samples, []
        if not taken:
            return np.empty(0), np.empty(0, dtype=np.int64)
        return np.concatenate([t for t, _ in taken]), np.concatenate([c for _, c in taken])


class Plant:
    """The twin with its drives, shared by simulators in several threads.

    Parameters
    ----------
    description : BenchDescription
        Description whose section `[driver.simulation]` is `options`.
    """

    def __init__(self, description: BenchDescription, options: SimulationOptions) -> None:
        self.description = description
        own: dict[str, object] = {"preset": options.preset, "seed": options.seed}
        if options.ambient_c is not None:
            own["ambient_c"] = options.ambient_c
        if description.driver.get("reference") is not None:
            own["reference"] = "readout"
        self.bench = SimulatedBench(description.model_copy(update={"driver": own}))
        self.time: Literal["on-demand", "real"] = options.time
        self.lock = threading.RLock()
        self._progress = threading.Condition(self.lock)
        self._edges: list[EdgeTap] = []
        self._angles: list[AngleTap] = []
        self._torques: dict[Side, list[float]] = {side: [] for side in SIDES}
        self._torque_count: dict[Side, int] = dict.fromkeys(SIDES, 0)
        self._counts: dict[Side, deque[tuple[float, int]]] = {
            side: deque([(0.0, 0)], maxlen=KEPT_COUNTS) for side in SIDES
        }
        self._readers = 0
        self._counting = 0
        self.epoch_s = 0.0
        """Time at which the client's counter was started: its bench time 0."""
        self._read_before = False
        self._now_s = 0.0
        self._closing = threading.Event()
        self._advance(WALL_STEP_S)  # compiles the kernels, before a client waits for an answer
        self._thread = threading.Thread(target=self._follow, name="simulated-plant", daemon=True)
        self._thread.start()

    # -- time -------------------------------------------------------------------------------

    @property
    def now_s(self) -> float:
        """Bench time, s."""
        return self._now_s

    def require(self, time_s: float, timeout_s: float) -> bool:
        """Advance the bench to a time, or wait for it; return False after `timeout_s`."""
        deadline = time.monotonic() + timeout_s
        with self.lock:
            while self._now_s < time_s - 1e-9:
                if self.time == "on-demand":
                    self._advance(min(STEP_S, time_s - self._now_s))
                    continue
                remaining = deadline - time.monotonic()
                if remaining <= 0.0 or self._closing.is_set():
                    return False
                self._progress.wait(remaining)
        return True

    def reading(self, begins: bool) -> None:
        """Record that a client of the counter connected or disconnected."""
        with self.lock:
            self._readers += 1 if begins else -1
            self._read_before = True

    def _follow(self) -> None:
        """Advance with the wall clock, in real time or if no client watches powered drives."""
        last = time.monotonic()
        while not self._closing.wait(WALL_STEP_S):
            now = time.monotonic()
            passed_s, last = min(now - last, LONGEST_STALL_S), now
            while passed_s > 0.0:  # a busy computer delays the simulation, but doesn't slow it down
                with self.lock:
                    if self.time == "real" or self._abandoned():
                        self._advance(min(passed_s, STEP_S))
                        self._progress.notify_all()
                passed_s -= STEP_S

    def _abandoned(self) -> bool:
        """Return whether nobody reads any more while a drive has power."""
        powered = any(drive.state().enabled for drive in self.bench.drives.values())
        return self._read_before and self._readers == 0 and powered

    def _advance(self, duration_s: float) -> None:
        """Advance the bench, and hand its edges and angles to those who take them."""
        block = self.bench.read_block(duration_s)
        self._now_s = block.stop_s
        for tap in self._edges:
            tap.put(block.edges[tap.channel])
        for side in SIDES:
            angle = block.angle(side)
            if angle is not None and len(angle):
                self._counts[side].append((self._now_s, int(angle["angle_counts"][-1])))
        for tapped in self._angles:
            samples = block.records[angle_channel(tapped.side)]
            tapped.put(samples.time_s, samples["angle_counts"])
        self._keep_torques(block)

    def _keep_torques(self, block: Block) -> None:
        """Keep the newest values of the standard's amplifier; NaN while nothing is mounted."""
        readout = self.bench.readout
        if readout is None:
            return
        for side in SIDES:
            new = readout.read(side, block.stop_s, block.timed_s)["signal"].tolist()
            if not new and not readout.channels:  # nothing mounted: an amplifier without signal
                windows = round(block.stop_s / self.window_s) - round(block.start_s / self.window_s)
                new = [float("nan")] * windows
            self._torques[side] = (self._torques[side] + new)[-KEPT_TORQUES:]
            self._torque_count[side] += len(new)

    # -- signals for the counters ------------------------------------------------------------

    @property
    def window_s(self) -> float:
        """Length of the windows of the standard's own counter, s."""
        return self.description.counter.window_s

    def tap_edges(self, channel: str) -> EdgeTap:
        """Connect a counter input to a channel from now on."""
        tap = EdgeTap(channel)
        with self.lock:
            self._edges.append(tap)
            self._select()
        return tap

    def tap_angles(self, side: Side) -> AngleTap:
        """Connect a counter input to an encoder from now on."""
        tap = AngleTap(side)
        with self.lock:
            self._angles.append(tap)
        return tap

    def counting(self, begins: bool) -> None:
        """Record that a counter starts or stops; the first one to start sets the epoch."""
        with self.lock:
            if begins and self._counting == 0:
                self.epoch_s = self._now_s
            self._counting = max(0, self._counting + (1 if begins else -1))

    def release(self, tap: EdgeTap | AngleTap) -> None:
        """Disconnect a counter input."""
        with self.lock:
            if isinstance(tap, EdgeTap) and tap in self._edges:
                self._edges.remove(tap)
                self._select()
            elif isinstance(tap, AngleTap) and tap in self._angles:
                self._angles.remove(tap)

    def _select(self) -> None:
        """Time the channels whose edges somebody takes."""
        wanted = {tap.channel for tap in self._edges}
        self.bench.select(frozenset(name for name in CHANNELS if name in wanted))

    # -- signals for the other instruments ----------------------------------------------------

    def counts(self, side: Side, age_s: float = 0.0) -> int:
        """Return the encoder counts of a side, now or some time ago."""
        with self.lock:
            counted, then_s = self._counts[side], self._now_s - age_s
            return next(
                (counts for time_s, counts in reversed(counted) if time_s <= then_s), counted[0][1]
            )

    def torques(self, side: Side) -> tuple[int, list[float]]:
        """Return the number of torques that the standard has produced, and the newest of them."""
        with self.lock:
            return self._torque_count[side], list(self._torques[side])

    def close(self) -> None:
        """End the plant. A second call does nothing."""
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join()
