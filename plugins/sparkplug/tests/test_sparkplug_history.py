"""Unsent data is stored in order, within a size limit, and over a restart."""

from pathlib import Path

import pytest

from torquebench.errors import RecordError
from torquebench_sparkplug.history import History
from torquebench_sparkplug.payload import DataType, Metric


def speed(number: int) -> tuple[Metric, ...]:
    return (Metric("Speed/Value", None, number, DataType.DOUBLE, float(number)),)


def test_records_wait_in_order_over_a_restart(tmp_path: Path) -> None:
    first = History(tmp_path / "s.sqlite", 1.0)
    first.keep(("input", speed(number)) for number in range(5))
    first.connected()
    first.close()
    again = History(tmp_path / "s.sqlite", 1.0)
    assert (again.waiting, again.lost, again.bdseq) == (5, 0, 1)
    kept = again.oldest(3)
    assert [record.metrics for record in kept] == [speed(0), speed(1), speed(2)]
    again.forget(kept[1].number)
    assert again.waiting == 3
    assert [record.metrics for record in again.oldest(9)] == [speed(2), speed(3), speed(4)]
    again.close()


def test_the_oldest_go_when_it_is_full_and_are_counted(tmp_path: Path) -> None:
    history = History(tmp_path / "s.sqlite", 0.1)
    for number in range(3000):
        history.keep([("input", speed(number))])
    assert 0 < history.waiting < 3000
    assert history.lost == 3000 - history.waiting
    kept = history.oldest(3000)
    assert len(kept) == history.waiting
    assert [record.metrics for record in kept] == [speed(n) for n in range(history.lost, 3000)]
    history.forget(kept[-1].number)
    assert history.waiting == 0
    history.keep([("input", speed(1))])
    assert history.oldest(9)[0].number > kept[-1].number  # a number means one record for ever
    history.close()


def test_a_damaged_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "s.sqlite").write_bytes(b"no database" * 100)
    with pytest.raises(RecordError, match=r"s\.sqlite"):
        History(tmp_path / "s.sqlite", 1.0)
