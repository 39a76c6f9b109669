"""Blocks: joined, cut again, and handed to watchers."""

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from torquebench.bench.blocks import CONDITIONS, Block, Viewer
from torquebench.chain import Component, Torque
from torquebench.signals import EdgeBlock, Record
from torquebench.uncertainty import Shared


def measured(index: int) -> Block:
    """Return a block of five windows."""
    start_s = 0.05 * index
    time_s = start_s + 0.005 + 0.01 * np.arange(5)
    reading = Record({"time_s": time_s, "reading_nm": 10.0 * index + np.arange(5)})
    conditions = Record({"time_s": np.array([start_s + 0.05]), "input_c": np.array([20.0 + index])})
    edges = EdgeBlock(np.array([1000 * index + 5]), 1000 * index, 1000 * index + 1000, 1e6)
    records = {"input_torque": reading, CONDITIONS: conditions}
    return Block(start_s, start_s + 0.05, {"input_torque": edges}, records)


def test_joined_blocks_are_cut_into_themselves() -> None:
    blocks = [measured(index) for index in range(4)]
    assert all(after.follows(before) for before, after in itertools.pairwise(blocks))
    assert not blocks[2].follows(blocks[0])
    joined = Block.join(blocks)
    assert joined.edges["input_torque"].ticks.tolist() == [5, 1005, 2005, 3005]
    value = joined.records["input_torque"]["reading_nm"]
    torque = Torque(value, (Component("counter", Shared.NOTHING, 0.1 * value),))
    joined = Block(joined.start_s, joined.stop_s, {}, joined.records, {"input": torque})
    for block in blocks:
        part = joined.part(block.start_s, block.stop_s)
        for name, record in block.records.items():
            for column in record:
                np.testing.assert_array_equal(part.records[name][column], record[column])
        reading = block.records["input_torque"]["reading_nm"]
        np.testing.assert_array_equal(part.torques["input"].value_nm, reading)
        np.testing.assert_array_equal(part.torques["input"].standard_uncertainty_nm, 0.1 * reading)
        assert part.condition("input_c") == block.condition("input_c")


def block(index: int) -> Block:
    return Block(float(index), index + 1.0)


@given(st.integers(1, 20), st.integers(0, 60))
def test_a_slow_viewer_keeps_the_newest_and_counts_what_it_lost(maximum: int, puts: int) -> None:
    viewer = Viewer(maximum)
    for index in range(puts):
        viewer.put(block(index))
    kept = [item.start_s for item in list(iter(lambda: viewer.get(0.0), None))]
    assert kept == list(range(max(0, puts - maximum), puts))
    assert viewer.dropped == max(0, puts - maximum)
    assert viewer.get(timeout_s=0.0) is None


def test_a_viewer_returns_the_oldest_first() -> None:
    viewer = Viewer()
    viewer.put(block(1))
    viewer.put(block(2))
    first = viewer.get()
    assert first is not None
    assert first.start_s == 1.0
