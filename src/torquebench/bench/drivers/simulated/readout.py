"""The read-out of a simulated standard that delivers torque, like a standard on a bus."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from torquebench.bench.blocks import Block
from torquebench.bench.description import BenchDescription, StandardDescription
from torquebench.bench.drivers.base import Identity
from torquebench.bench.roles import SIDES, Side, reference_channel
from torquebench.signals import FrequencyCounter, Record


class SimulatedReadout:
    """A standard with its own counter, which delivers torque instead of edges."""

    def __init__(self, description: BenchDescription) -> None:
        self._counting = description.counter
        self._standard: StandardDescription | None = None
        self._counters: dict[Side, FrequencyCounter] = {}
        self._samples: dict[Side, list[Record]] = {side: [] for side in SIDES}

    def connect(self, standard: StandardDescription | None) -> None:
        """Connect to the mounted standard."""
        self._standard = standard
        self._samples = {side: [] for side in SIDES}
        counting = self._counting
        self._counters = {
            side: FrequencyCounter("regression", counting.window_s, counting.timebase_hz)
            for side in SIDES
        }

    @property
    def channels(self) -> frozenset[str]:
        """Channels whose edges the read-out counts."""
        return frozenset(reference_channel(side) for side in SIDES if self._standard is not None)

    def take(self, block: Block) -> Block:
        """Remove the standard's edges from a block, and count them."""
        edges = dict(block.edges)
        if self._standard is not None:
            for side in SIDES:
                frequency = self._counters[side].push(edges.pop(reference_channel(side)))
                scale = self._standard.transducer(side).scale()
                self._samples[side].append(scale.readings(frequency))
        return replace(block, edges=edges)

    def identity(self) -> Identity:
        """Name plate of the mounted standard's read-out."""
        serial = self._standard.serial if self._standard is not None else "none mounted"
        return Identity("reference", "simulated", "read-out of the twin", serial)

    @property
    def period_s(self) -> float:
        """Period of the values: a window of the read-out's counter."""
        return self._counting.window_s

    def read(self, side: Side, until_s: float, timed_s: float) -> Record:
        """Return the samples since the last call; NaN without a signal."""
        del until_s, timed_s  # later times haven't been simulated yet
        samples, self._samples[side] = self._samples[side], []
        if not samples:
            return Record({"time_s": np.empty(0), "signal": np.empty(0)})
        stated = Record.join(samples)
        return Record({"time_s": stated.time_s, "signal": stated["reading_nm"]})

    def close(self) -> None:
        """Disconnect."""
        self.connect(None)
