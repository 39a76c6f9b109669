import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from torquebench.bench.samples import AcquiredBlock, SampleRing, Viewer


@given(
    st.lists(st.integers(0, 7), max_size=60),
    st.integers(7, 20),
    st.floats(-1, 200),
    st.floats(0, 50),
)
def test_a_window_holds_what_was_appended_as_far_as_it_is_kept(
    counts: list[int], capacity: int, start: float, length: float
) -> None:
    ring = SampleRing(columns=1, capacity=capacity)
    everything = np.arange(sum(counts), dtype=float)
    position = 0
    for count in counts:
        rows = everything[position : position + count]
        ring.append(rows, -rows)
        position += count
    kept = everything[-capacity:] if everything.size else everything
    expected = kept[(kept >= start) & (kept < start + length)]
    window = ring.window(start, start + length)
    assert window[0].tolist() == expected.tolist()
    assert window[1].tolist() == (-expected).tolist()
    last = ring.last()
    assert (last is None) == (everything.size == 0)
    if last is not None:
        assert last[0] == everything[-1]


def block(index: int) -> AcquiredBlock:
    return AcquiredBlock(index, index * 0.05, (index + 1) * 0.05, {}, {}, {}, {}, {})


@given(st.integers(1, 20), st.integers(0, 60))
def test_a_slow_viewer_keeps_the_newest_and_counts_what_it_lost(maximum: int, puts: int) -> None:
    viewer = Viewer(maximum)
    for index in range(puts):
        viewer.put(block(index))
    kept = [item.index for item in list(iter(lambda: viewer.get(0.0), None))]
    assert kept == list(range(max(0, puts - maximum), puts))
    assert viewer.dropped == max(0, puts - maximum)
    assert viewer.get(timeout_s=0.0) is None


def test_a_viewer_returns_the_oldest_first() -> None:
    viewer = Viewer()
    viewer.put(block(1))
    viewer.put(block(2))
    first = viewer.get()
    assert first is not None
    assert first.index == 1
