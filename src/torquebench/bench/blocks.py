"""Blocks: measurements of the instruments over an interval of bench time, and queues of viewers."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from torquebench.bench.roles import Side, angle_channel, torque_channel
from torquebench.chain.torque import Torque, joined
from torquebench.signals import EdgeBlock, Record, SignalFaultKind

KEPT_S = 120.0
"""Time for which the recent values of every channel are kept, s of bench time."""
CONDITIONS = "conditions"
"""Name of the record with one row for each block: speeds, accelerations and temperatures."""


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """All data of one interval of bench time, first as measured, then evaluated.

    A driver delivers edges by channel, or records for channels that the instrument counts itself:
    torque channels with `frequency_hz`, `frequency_uncertainty_hz` and `fault` or, of an amplifier,
    with `signal`, encoders with `angle_counts` (unwrapped, clockwise positive), each with `time_s`.
    The evaluation adds `reading_nm` and `counter_nm` of every torque channel, and `conditions`. In
    fast simulated time several blocks may be joined.

    Attributes
    ----------
    start_s, stop_s : float
        Bench time of the interval, s.
    records : mapping of channel to Record
        An encoder that delivers nothing has an empty record, or none.
    torques : mapping of side to Torque
        Compensated torque in the rows of the side's torque channel.
    waiting_s : float, optional
        Backlog of the counter, s; None if it doesn't state it.
    """

    start_s: float
    stop_s: float
    edges: Mapping[str, EdgeBlock] = field(default_factory=dict)
    records: Mapping[str, Record] = field(default_factory=dict)
    torques: Mapping[Side, Torque] = field(default_factory=dict)
    waiting_s: float | None = None

    @property
    def timed_s(self) -> float:
        """Bench time that had at least passed when the block was read, s."""
        return self.stop_s + (self.waiting_s or 0.0)

    def torque(self, side: Side) -> Record | None:
        """Return the record of a module's torque channel; None if the channel isn't timed."""
        return self.records.get(torque_channel(side))

    def angle(self, side: Side) -> Record | None:
        """Return the record of an encoder; None without one."""
        return self.records.get(angle_channel(side))

    def condition(self, name: str) -> float:
        """Return a speed, an acceleration or a temperature at the block's end; NaN if unknown."""
        conditions = self.records.get(CONDITIONS)
        values = None if conditions is None else conditions.get(name)
        return math.nan if values is None else float(values[-1])

    def speed_rad_s(self, side: Side) -> float:
        """Return the mean speed of a side; NaN if its encoder is silent."""
        return self.condition(f"{side}_speed_rad_s")

    def temperature_c(self, probe: str) -> float:
        """Return the temperature of a probe; NaN if it is silent."""
        return self.condition(f"{probe}_c")

    def joins(self, before: Block) -> bool:
        """Return whether it follows another block, and its torques have the same components."""

        def components(block: Block) -> dict[Side, list[str]]:
            return {side: [c.name for c in t.components] for side, t in block.torques.items()}

        return self.follows(before) and components(self) == components(before)

    def follows(self, before: Block) -> bool:
        """Return whether the block continues the signals of another block without a gap."""
        return (
            self.records.keys() == before.records.keys()
            and abs(self.start_s - before.stop_s) < 1e-9
            and all(
                len(record) > 0
                and len(earlier := before.records[name]) > 0
                and (
                    len(earlier) < 2
                    or record.time_s[0] - earlier.time_s[-1]
                    < 1.5 * (earlier.time_s[-1] - earlier.time_s[-2])
                )
                for name, record in self.records.items()
            )
        )

    @classmethod
    def join(cls, blocks: Sequence[Block]) -> Block:
        """Concatenate consecutive blocks, with the channels and torques that all of them have."""
        first, last = blocks[0], blocks[-1]
        if len(blocks) == 1:
            return first
        edges = set.intersection(*(set(block.edges) for block in blocks))
        records = set.intersection(*(set(block.records) for block in blocks))
        torques = set.intersection(*(set(block.torques) for block in blocks))
        return cls(
            first.start_s,
            last.stop_s,
            {n: EdgeBlock.join([b.edges[n] for b in blocks]) for n in first.edges if n in edges},
            {n: Record.join([b.records[n] for b in blocks]) for n in first.records if n in records},
            {s: joined([b.torques[s] for b in blocks]) for s in first.torques if s in torques},
            waiting_s=last.waiting_s,
        )

    def part(self, start_s: float, stop_s: float) -> Block:
        """Return the values of one of the joined blocks, without its edges."""
        nearly, torques, records = 1e-9, {}, {}
        for name, record in self.records.items():
            later_s = nearly if name == CONDITIONS else -nearly  # rows at the end of a block
            records[name] = record.window(start_s + later_s, stop_s + later_s)
        for side, torque in self.torques.items():
            time_s = self.records[torque_channel(side)].time_s
            first, stop = time_s.searchsorted((start_s - nearly, stop_s - nearly)).tolist()
            torques[side] = torque.at(slice(first, stop))
        return replace(
            self, start_s=start_s, stop_s=stop_s, edges={}, records=records, torques=torques
        )


def fault_of(record: Record) -> SignalFaultKind:
    """Return the fault of a record's last row."""
    return SignalFaultKind(int(record["fault"][-1])) if len(record) else SignalFaultKind.NONE


@dataclass(eq=False)
class Viewer:
    """Bounded queue of blocks for a viewer: it drops the oldest blocks and counts them.

    `waits` lets acquisition wait for room instead, for fast simulated time only. `patience_s` is
    for how long blocks of a bench at rest may be held back, to be evaluated and given as one.
    """

    maximum: int = 100
    waits: bool = False
    dropped: int = 0
    patience_s: float = 0.0
    _blocks: deque[Block] = field(default_factory=deque)
    _condition: threading.Condition = field(default_factory=threading.Condition)

    def put(self, block: Block) -> None:
        """Add a block (called by acquisition)."""
        with self._condition:
            if self.waits:
                self._condition.wait_for(lambda: len(self._blocks) < self.maximum or not self.waits)
            if len(self._blocks) >= self.maximum:
                self._blocks.popleft()
                self.dropped += 1
            self._blocks.append(block)
            self._condition.notify_all()

    def get(self, timeout_s: float = 1.0) -> Block | None:
        """Return the oldest waiting block; None if none arrives in time."""
        with self._condition:
            self._condition.wait_for(lambda: self._blocks, timeout_s)
            if not self._blocks:
                return None
            self._condition.notify_all()
            return self._blocks.popleft()

    def close(self) -> None:
        """Let acquisition wait no longer."""
        with self._condition:
            self.waits = False
            self._condition.notify_all()
