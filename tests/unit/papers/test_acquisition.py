"""Frequency acquisition and changing torque: what the page states was counted or filtered."""

import time

import pytest

from torquebench.papers import acquisition
from torquebench.papers.factors import FREQUENCIES_HZ, changing_torque
from torquebench.reports.page import Table
from torquebench.signals import EdgeBlock, FrequencyCounter
from torquebench.signals.record import Record


def test_a_stream_is_taken_whole() -> None:
    stream = acquisition.streamed(0.5)
    assert (stream.blocks, stream.lost, stream.faults) == (50, 0, 0)
    assert stream.edges_per_s == pytest.approx(4 * 60e3, rel=0.4)


def test_a_card_whose_blocks_nobody_takes_in_time_loses_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Slow(FrequencyCounter):
        """Counter that takes twenty times as long as a block lasts."""

        def push(self, block: EdgeBlock) -> Record:
            time.sleep(0.02)
            return super().push(block)

    monkeypatch.setattr(acquisition, "FrequencyCounter", Slow)
    monkeypatch.setattr(acquisition, "HELD_BLOCKS", 1)
    monkeypatch.setattr(acquisition, "BLOCK_S", 1e-3)
    assert acquisition.streamed(0.01).lost > 0


def test_counters_scatter_as_their_budget_states() -> None:
    answer, (budget, counted) = acquisition.acquisition_blocks()
    assert answer.verdict == "met"
    assert isinstance(budget, Table)
    assert isinstance(counted, Table)
    parts = [float(row[1]) for row in budget.rows]
    assert parts[-1] == pytest.approx(2.0 * sum(u**2 for u in parts[:-1]) ** 0.5, rel=0.01)
    for name, stated, measured in counted.rows:
        assert float(measured) == pytest.approx(float(stated), rel=0.2), name


def test_a_filter_that_was_identified_from_steps_holds_for_sines_and_other_steps() -> None:
    before, after, (table, _) = changing_torque()
    assert isinstance(table, Table)
    assert before > 100.0 > 5.0 > after
    *sines, step = ([float(cell) for cell in row[1:] if cell != "–"] for row in table.rows)
    assert len(sines) == len(FREQUENCIES_HZ)
    for raw, late, filtered, left in sines:
        assert abs(filtered) < abs(raw)
        assert abs(left) < abs(late)
    assert step[1] < 2.0 < 50.0 < step[0]
