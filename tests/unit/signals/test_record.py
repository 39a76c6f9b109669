"""Records and the history of their most recent rows."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.errors import InputError
from torquebench.signals import History, PulseTrainFault, Record, SignalFaultKind


def rows(first: int, count: int) -> Record:
    number = np.arange(first, first + count)
    return Record(
        {
            "time_s": 0.1 * number,
            "counts": number,
            "parts": np.column_stack((number, -number)).astype(np.float64),
        }
    )


def same(one: Record, other: Record) -> bool:
    return set(one) == set(other) and all(
        one[name].dtype == other[name].dtype and np.array_equal(one[name], other[name])
        for name in one
    )


@given(
    sizes=st.lists(st.integers(0, 12), min_size=1, max_size=30),
    capacity=st.integers(1, 20),
    window=st.tuples(st.floats(-1.0, 40.0), st.floats(-1.0, 40.0)),
    wanted=st.integers(1, 25),
)
def test_a_history_is_the_end_of_everything_appended(sizes, capacity, window, wanted):
    history, parts, first = History(capacity), [], 0
    for size in sizes:
        part = rows(first, size)
        history.append(part)
        parts.append(part)
        first += size
    if first == 0:
        assert history.latest() is None
        assert history.window(*window) is None
        return
    kept = Record.join(parts).at(slice(max(first - capacity, 0), None))
    assert len(history) == len(kept)
    assert same(history.latest(wanted), kept.at(slice(-wanted, None)))
    start_s, stop_s = sorted(window)
    assert same(history.window(start_s, stop_s), kept.window(start_s, stop_s))


def test_a_window_is_a_copy_that_later_rows_dont_change():
    history = History(4)
    history.append(rows(0, 4))
    before = history.window(0.0, 1.0)
    history.append(rows(4, 4))
    assert same(before, rows(0, 4))


def test_other_columns_begin_a_history_afresh():
    history = History(8)
    history.append(rows(0, 3))
    history.append(Record({"time_s": np.array([5.0])}))
    assert len(history) == 1
    history.append(Record({"time_s": np.array([6.0]), "parts": np.zeros((1, 2))}))
    history.append(Record({"time_s": np.array([7.0]), "parts": np.zeros((1, 3))}))
    assert len(history) == 1


def test_columns_have_one_length_and_single_values_count_for_all_rows():
    record = Record({"time_s": [0.0, 1.0], "speed_rpm": 3.0})
    assert record["speed_rpm"].tolist() == [3.0, 3.0]
    assert record.with_columns(branch=np.ones(2))["branch"].tolist() == [1, 1]
    with pytest.raises(InputError, match="2, 3 rows"):
        Record({"time_s": [0.0, 1.0], "speed_rpm": [1.0, 2.0, 3.0]})


def test_a_fault_takes_the_number_and_keeps_the_first_reason():
    record = Record(
        {
            "time_s": np.array([0.0, 0.1, 0.2]),
            "frequency_hz": np.array([np.nan, 2.0, 3.0]),
            "fault": np.array([SignalFaultKind.NO_PULSES, 0, 0], dtype=np.uint8),
        }
    )
    marked = record.marked(np.array([True, True, False]), SignalFaultKind.STUCK, "frequency_hz")
    assert marked["fault"].tolist() == [SignalFaultKind.NO_PULSES, SignalFaultKind.STUCK, 0]
    assert np.isnan(marked["frequency_hz"]).tolist() == [True, True, False]
    with pytest.raises(PulseTrainFault, match=r"input: no pulses .* at 0 s \(2 of 3 windows"):
        marked.raise_on_fault("input")
    assert marked.at(slice(2, None)).raise_on_fault() is not None


def test_a_window_that_ends_before_it_begins_is_empty():
    history = History(8)
    history.append(Record({"time_s": np.arange(6.0)}))
    for start_s, stop_s in ((4.0, 1.0), (9.0, -1.0), (2.0, 2.0)):
        assert len(history.window(start_s, stop_s)) == 0
        assert len(history.latest().window(start_s, stop_s)) == 0
