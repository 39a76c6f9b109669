import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from torquebench.panel.service.live.rings import LevelRing, Rows, TrendMemory, envelope

VALUES = st.lists(st.one_of(st.floats(-1e6, 1e6), st.just(float("nan"))), min_size=1, max_size=300)


def filled(values: list[float], capacity: int = 50, factors: tuple[int, ...] = (3, 2)):
    memory = TrendMemory(1, capacity, factors)
    for number, value in enumerate(values):
        row = np.array([value])
        memory.append(float(number), row, row, row)
    return memory


@given(VALUES, st.integers(1, 40))
def test_an_envelope_loses_no_extreme(values: list[float], points: int) -> None:
    column = np.array([values])
    rows = Rows(np.arange(len(values), dtype=float), column, column, column)
    found = envelope(rows, points)
    assert found.time_s.size == min(points, len(values))
    assert found.time_s[-1] == rows.time_s[-1]
    if np.isfinite(column).any():
        assert np.nanmax(found.high) == np.nanmax(column)
        assert np.nanmin(found.low) == np.nanmin(column)
    else:
        assert not np.isfinite(found.high).any()


@given(VALUES)
def test_coarser_levels_keep_every_extreme_of_the_rows_that_they_join(values: list[float]) -> None:
    memory = filled(values, capacity=1000)
    joined = len(values) // 3 * 3
    coarse = memory.levels[1].newest(1000)
    assert coarse.time_s.size == joined // 3
    part = np.array(values[:joined])
    if np.isfinite(part).any():
        assert np.nanmax(coarse.high) == np.nanmax(part)
        assert np.nanmin(coarse.low) == np.nanmin(part)


def test_memory_is_bounded_and_older_times_come_from_coarser_rows() -> None:
    memory = filled([float(number) for number in range(1000)])
    assert [level.newest(10**6).time_s.size for level in memory.levels] == [50, 50, 50]
    assert memory.last_s(10.0).time_s.tolist() == [float(n) for n in range(989, 1000)]
    longer = memory.last_s(120.0)
    assert longer.time_s.size == 41
    assert longer.time_s[0] <= 1000 - 120


def test_a_spike_of_one_row_is_seen_in_the_longest_trend() -> None:
    values = [0.0] * 299
    values[100] = 42.0
    memory = filled(values)
    assert memory.last_s(1e9).high.max() == 42.0


def test_newest_rows_come_in_order_around_the_ring_end() -> None:
    ring = LevelRing(1, 4)
    for number in range(7):
        row = np.array([float(number)])
        ring.append(float(number), row, row, row)
    assert ring.newest(3).mean[0].tolist() == [4.0, 5.0, 6.0]
    assert ring.covered_s == 3.0
    assert ring.full
