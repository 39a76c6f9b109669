"""Slices of a block: the counter is read in slices so that the supervisor sees them at once."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from torquebench.bench.drivers.base import AngleSamples, CounterBlock
from torquebench.errors import BenchError
from torquebench.message import Message
from torquebench.signals import EdgeBlock

__all__ = ["joined", "joined_edges", "slices_of"]


def slices_of(block_s: float, fast_check_s: float) -> int:
    """Return the number of slices of about `fast_check_s` in a block, at least 1.

    Examples
    --------
    >>> slices_of(0.05, 0.005), slices_of(0.05, 0.02), slices_of(0.05, 1.0)
    (10, 2, 1)
    """
    return max(1, int(block_s / fast_check_s + 1e-9))


def joined(parts: Sequence[CounterBlock]) -> CounterBlock:
    """Put slices that follow each other together to one block.

    Channels that were selected or deselected meanwhile aren't in it: the next block has them
    completely.

    Raises
    ------
    BenchError
        A slice doesn't begin where the one before it stops.
    """
    first, last = parts[0], parts[-1]
    if len(parts) == 1:
        return first
    whole = set.intersection(*(set(part.edges) for part in parts))
    edges = {
        name: joined_edges(name, [part.edges[name] for part in parts])
        for name in first.edges
        if name in whole
    }
    angles = {}
    for side, angle in first.angles.items():
        samples = [part.angles[side] for part in parts]
        angles[side] = AngleSamples(
            np.concatenate([sample.time_s for sample in samples]),
            np.concatenate([sample.counts for sample in samples]),
            angle.counts_per_revolution,
        )
    return CounterBlock(first.start_s, last.stop_s, edges, angles, waiting_s=last.waiting_s)


def joined_edges(name: str, blocks: Sequence[EdgeBlock]) -> EdgeBlock:
    """Put the edges of a channel together; raises like `joined`."""
    if len(blocks) == 1:
        return blocks[0]
    for before, after in itertools.pairwise(blocks):
        if after.start_tick != before.stop_tick:
            raise BenchError(
                Message(
                    "{name}: slices from tick {start_tick} to {stop_tick} and from "
                    "{after_start_tick}",
                    name,
                    before.start_tick,
                    before.stop_tick,
                    after.start_tick,
                ),
                "slices without a gap",
                "check the counter's driver",
            )
    falling = [block.falling_ticks for block in blocks if block.falling_ticks is not None]
    return EdgeBlock(
        np.concatenate([block.ticks for block in blocks]),
        blocks[0].start_tick,
        blocks[-1].stop_tick,
        blocks[0].timebase_hz,
        np.concatenate(falling) if len(falling) == len(blocks) else None,
    )
