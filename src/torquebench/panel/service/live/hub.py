"""The live hub: present readings of the bench, computed once for all pages and clients.

A thread converts each acquired block to one row with lowest, highest and mean value of every
signal. Readers request the rows after their last one.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.blocks import KEPT_S, Block, Viewer, fault_of
from torquebench.bench.clock import BenchClock
from torquebench.bench.description import BenchDescription
from torquebench.bench.roles import SIDES, Side, reference_channel, torque_channel
from torquebench.chain import Torque
from torquebench.columns import Column, column_of
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations.recording import SignalWindows, torque_windows
from torquebench.panel.service.live.rings import (
    Array,
    Rows,
    TrendMemory,
    envelope,
    extremes_and_mean,
)
from torquebench.signals import History, Record
from torquebench.units import DEG_PER_TURN, RPM_PER_RAD_S

Connection = Literal["live", "stale", "lost"]

STALE_AFTER_S = 1.0
"""Time without a new value after which a signal counts as stale, s of wall time."""
UNCERTAINTY_S = 0.2
"""Interval of bench time at which U is computed, s; it changes slowly, and costs most of a row."""
WATCHED_S = 2.0
"""Time after the last request for which rows are made at once, s of wall time."""
UNWATCHED_S = 0.5
"""Interval at which the rows of a bench at rest are made while nobody requests them, s."""
ROWS = 3600
FACTORS = (10, 4)
"""Number of rows merged from level to level. With blocks of 30 ms, the levels hold 108 s of every
block, 18 min of rows of 0.3 s, and 72 min of rows of 1.2 s.
"""
MAXIMUM_INCREMENT = 1000
MOST_POINTS = 5000
MEANINGFUL_SHARE = 0.02
"""Share of the range below which a torque is too small for an efficiency."""
MEANINGFUL_SPEED_RPM = 1.0


_OF_A_SIDE = (
    "raw_nm",
    "torque_nm",
    "expanded_uncertainty_nm",
    "reference_nm",
    "speed_rpm",
    "acceleration_rad_s2",
    "angle_deg",
    "temperature_c",
)
SIGNALS: tuple[Column, ...] = tuple(
    column_of(name)
    for name in (*(f"{side}_{what}" for side in SIDES for what in _OF_A_SIDE), "efficiency_percent")
)
"""All live signals."""
_INDEX = {signal.name: place for place, signal in enumerate(SIGNALS)}


@dataclass(frozen=True, eq=False)
class LiveTrend:
    """New rows for a reader, or signals' past, reduced without losing extremes.

    Parameters
    ----------
    sequence : int
        Sequence number for the next call of `LiveHub.since`.
    time_s : float64[n]
        Bench time of each row's end, s.
    values : mapping of signal name to float64[n]
        Means; NaN marks a missing value.
    low, high : mapping of signal name to float64[n]
        Extremes within each row.
    missed : int
        Number of new rows that were dropped because the reader was too slow.
    """

    sequence: int
    time_s: NDArray[np.float64]
    values: Mapping[str, NDArray[np.float64]]
    low: Mapping[str, NDArray[np.float64]]
    high: Mapping[str, NDArray[np.float64]]
    missed: int = 0


@dataclass(frozen=True)
class LatestValue:
    """The newest value of a signal, None before the first, and its age.

    Parameters
    ----------
    value : float or None
    age_s : float
        Wall time since its arrival, s; infinite before the first.
    fault : str
        Why there is no newer value; empty if there is one.
    """

    value: float | None
    age_s: float
    fault: str = ""

    @property
    def stale(self) -> bool:
        """Whether the value is too old to be shown as the present reading."""
        return self.age_s > STALE_AFTER_S


class LiveHub:
    """Rows of all live signals, kept in bounded memory; safe to read from any thread.

    Parameters
    ----------
    description : BenchDescription
    clock : BenchClock
    viewer : Viewer
        A viewer of the acquisition, which the hub reads.
    mounted : callable, optional
        Returns what is mounted, because only a reducer has an efficiency.

    Examples
    --------
    A page calls repeatedly::

        increment = service.live.since(sequence)
        sequence = increment.sequence
        chart.append(increment.time_s, increment.values["output_torque_nm"])
    """

    def __init__(
        self,
        description: BenchDescription,
        clock: BenchClock,
        viewer: Viewer,
        mounted: Callable[[], str] = lambda: "reducer",
    ) -> None:
        self._description = description
        self._clock = clock
        self._viewer = viewer
        self._mounted = mounted
        self._lock = threading.Condition()
        self._watched_at = -math.inf
        self._memory = TrendMemory(len(SIGNALS), ROWS, FACTORS)
        self._newest = np.full(len(SIGNALS), np.nan)
        self._seen_at = np.full(len(SIGNALS), -np.inf)
        self._faults: dict[str, str] = {}
        self._stated: dict[Side, tuple[float, float]] = {}
        self._block_at = time.monotonic()
        self._bench_s = 0.0
        self._clock_s = time.time()
        rows = round(KEPT_S / description.counter.window_s)
        self._windows = {name: History(rows) for name in TORQUE_SIGNALS}
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="torquebench-live", daemon=True)

    def start(self) -> None:
        """Start the hub's thread."""
        self._thread.start()

    def close(self) -> None:
        """End the thread. A second call does nothing."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()

    # -- taking blocks ----------------------------------------------------------------------

    def _run(self) -> None:
        while not self._ended.is_set():
            watched = time.monotonic() - self._watched_at < WATCHED_S
            self._viewer.patience_s = 0.0 if watched else UNWATCHED_S
            block = self._viewer.get(timeout_s=0.2)
            if block is not None:
                self.take(block)

    def take(self, block: Block) -> None:
        """Convert a block to a row."""
        low, high, mean, faults = self._row(block)
        for name, found in torque_windows(block).items():
            columns = {"time_s": found.time_s, "value_nm": found.value_nm}
            self._windows[name].append(Record.unchecked(columns, found.time_s.size))
        now, clock_s = time.monotonic(), time.time()
        with self._lock:
            self._clock_s = clock_s
            self._memory.append(block.stop_s, low, high, mean)
            there = np.isfinite(mean)
            self._newest[there] = mean[there]
            self._seen_at[there] = now
            self._faults = faults
            self._block_at, self._bench_s = now, block.stop_s
            self._lock.notify_all()

    def _row(self, block: Block) -> tuple[Array, Array, Array, dict[str, str]]:
        low, high, mean = ([math.nan] * len(SIGNALS) for _ in range(3))
        faults: dict[str, str] = {}

        def put(name: str, value: float) -> None:
            place = _INDEX[name]
            low[place] = high[place] = mean[place] = value

        def put_all(name: str, values: Array) -> None:
            place = _INDEX[name]
            low[place], high[place], mean[place] = extremes_and_mean(values)

        for side in SIDES:
            for channel, name in (
                (torque_channel(side), f"{side}_raw_nm"),
                (reference_channel(side), f"{side}_reference_nm"),
            ):
                record = block.records.get(channel)
                if record is None:
                    continue
                put_all(name, record["reading_nm"])
                if record["fault"].any():
                    faults[name] = fault_of(record).description
            compensated = block.torques.get(side)
            if compensated is not None and len(compensated):
                put_all(f"{side}_torque_nm", compensated.value_nm)
                put(f"{side}_expanded_uncertainty_nm", self._uncertainty(side, compensated, block))
            put(f"{side}_speed_rpm", block.speed_rad_s(side) * RPM_PER_RAD_S)
            put(f"{side}_acceleration_rad_s2", block.condition(f"{side}_acceleration_rad_s2"))
            angle, module = block.angle(side), self._description.module(side)
            if angle is not None and len(angle) and module.encoder is not None:
                turns = float(angle["angle_counts"][-1]) / module.encoder.counts_per_revolution
                put(f"{side}_angle_deg", DEG_PER_TURN * turns)
            put(f"{side}_temperature_c", block.temperature_c(module.temperature_probe))
        put("efficiency_percent", self._efficiency(mean))
        return np.array(low), np.array(high), np.array(mean), faults

    def _uncertainty(self, side: Side, compensated: Torque, block: Block) -> float:
        """Return U of a block's mean torque, which is displayed; the last one for a short time."""
        kept = np.isfinite(compensated.value_nm)
        if not kept.any():
            return math.nan
        until_s, stated_nm = self._stated.get(side, (-math.inf, math.nan))
        if not block.stop_s < until_s:
            torque = compensated if kept.all() else compensated.at(np.flatnonzero(kept))
            stated_nm = float(torque.mean().expanded_uncertainty_nm[0])
            self._stated[side] = block.stop_s + UNCERTAINTY_S - 1e-9, stated_nm
        return stated_nm

    def _efficiency(self, mean: Sequence[float]) -> float:
        """Return the efficiency, output power by input power in either direction; NaN if undefined.

        It needs compensated torques, so a side without a model gives NaN.
        """
        if self._mounted() != "reducer":
            return math.nan
        powers = []
        for side in SIDES:
            torque = mean[_INDEX[f"{side}_torque_nm"]]
            speed = mean[_INDEX[f"{side}_speed_rpm"]]
            if not abs(torque) > MEANINGFUL_SHARE * self._description.module(side).range_nm:
                return math.nan
            powers.append(abs(torque * speed))
        if not abs(mean[_INDEX["input_speed_rpm"]]) > MEANINGFUL_SPEED_RPM:
            return math.nan
        return 100.0 * min(powers) / max(powers) if max(powers) > 0.0 else math.nan

    # -- for watchers -----------------------------------------------------------------------

    def _watch(self) -> None:
        """Note that somebody requests rows: from the next block on, they are made at once."""
        self._watched_at = time.monotonic()
        self._viewer.patience_s = 0.0

    @property
    def sequence(self) -> int:
        """Number of rows so far."""
        self._watch()
        return self._memory.levels[0].count

    @property
    def bench_time_s(self) -> float:
        """Bench time of the newest row, s."""
        return self._bench_s

    @property
    def oldest_s(self) -> float:
        """Bench time of the oldest stored row, s."""
        return min(level.oldest_s for level in self._memory.levels if level.count)

    @property
    def clock_offset_s(self) -> float:
        """Difference between the wall clock (s since 1970) and bench time, s."""
        with self._lock:
            return self._clock_s - self._bench_s

    @property
    def age_s(self) -> float:
        """Wall time since the last block, s."""
        self._watch()
        return time.monotonic() - self._block_at

    def wait_beyond(self, time_s: float, timeout_s: float = STALE_AFTER_S) -> bool:
        """Wait for a row that ends after a bench time; return whether it arrived in time."""
        self._watch()
        with self._lock:
            return self._lock.wait_for(lambda: self._bench_s > time_s, timeout_s)

    def since(self, sequence: int, signals: Sequence[str] | None = None) -> LiveTrend:
        """Return the rows after a sequence number, at most the newest thousand.

        Parameters
        ----------
        sequence : int
            Sequence number of the previous call; 0 for all stored rows.
        signals : sequence of str, optional
            Names from `SIGNALS`; by default all.

        Raises
        ------
        InputError
            An unknown signal.
        """
        with self._lock:
            newest = self.sequence
            new = newest - min(max(sequence, 0), newest)
            rows = self._memory.levels[0].newest(min(new, MAXIMUM_INCREMENT))
        return _trend(newest, rows, signals, missed=new - rows.time_s.size)

    def trend(
        self, seconds: float, signals: Sequence[str] | None = None, points: int = 600
    ) -> LiveTrend:
        """Return the last seconds (up to an hour), reduced to at most `points` rows.

        Raises
        ------
        InputError
            An unknown signal.
        """
        with self._lock:
            sequence, rows = self.sequence, self._memory.last_s(min(max(seconds, 0.0), 3600.0))
        return _trend(sequence, envelope(rows, max(1, min(points, MOST_POINTS))), signals)

    def between(
        self, start_s: float, stop_s: float, signals: Sequence[str] | None = None, points: int = 600
    ) -> LiveTrend:
        """Return a span of bench time at the finest stored level, reduced to at most `points` rows.

        Raises
        ------
        InputError
            An unknown signal.
        """
        with self._lock:
            sequence, rows = self.sequence, self._memory.between(start_s, stop_s)
        return _trend(sequence, envelope(rows, max(1, min(points, MOST_POINTS))), signals)

    def windows(self, signal: str, start_s: float, stop_s: float) -> SignalWindows:
        """Return all windows of a torque in a span of the last two minutes.

        Raises
        ------
        InputError
            The signal isn't a torque.
        """
        if signal not in TORQUE_SIGNALS:
            raise InputError(
                Message("signal {name!r}", signal[:80]),
                Message("one of {list}", ", ".join(TORQUE_SIGNALS)),
            )
        self._watch()
        found = self._windows[signal].window(start_s, np.nextafter(stop_s, np.inf))
        if found is None:
            return SignalWindows(np.empty(0), np.empty(0))
        return SignalWindows(found.time_s, found["value_nm"])

    def latest(self) -> dict[str, LatestValue]:
        """Return the newest value of every signal with its age."""
        self._watch()
        now = time.monotonic()
        with self._lock:
            newest, seen, faults = self._newest.copy(), self._seen_at.copy(), self._faults
        return {
            signal.name: LatestValue(
                float(newest[place]) if np.isfinite(newest[place]) else None,
                float(now - seen[place]),
                faults.get(signal.name, ""),
            )
            for place, signal in enumerate(SIGNALS)
        }


TORQUE_SIGNALS = tuple(
    f"{side}_{kind}_nm" for side in SIDES for kind in ("torque", "raw", "reference")
)


def _trend(
    sequence: int, rows: Rows, signals: Sequence[str] | None, *, missed: int = 0
) -> LiveTrend:
    places = _places(signals)
    return LiveTrend(
        sequence,
        rows.time_s,
        {name: rows.mean[place] for name, place in places.items()},
        {name: rows.low[place] for name, place in places.items()},
        {name: rows.high[place] for name, place in places.items()},
        missed,
    )


def _places(signals: Sequence[str] | None) -> dict[str, int]:
    if signals is None:
        return _INDEX
    unknown = [name for name in signals if name not in _INDEX]
    if unknown:
        raise InputError(
            Message("signal {name!r}", unknown[0][:80]), Message("one of {list}", ", ".join(_INDEX))
        )
    return {name: _INDEX[name] for name in signals}
