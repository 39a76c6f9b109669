import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.support.draws import nightly
from tests.system import killed_writers

from torquebench.records import RunFolder

LONGEST_S = 1000.0
"""On a busy computer with a slow disk the kills take their time."""


@pytest.mark.timeout(1.2 * LONGEST_S)
@pytest.mark.parametrize("kills", [3, nightly(50)])
def test_nothing_acknowledged_is_lost_by_kills_at_any_moment(kills: int, tmp_path: Path) -> None:
    writers = subprocess.run(
        [sys.executable, killed_writers.__file__, str(tmp_path), str(kills), "4711"],
        capture_output=True,
        text=True,
        check=True,
        timeout=LONGEST_S,
    )
    acknowledged = json.loads(writers.stdout)
    assert len(acknowledged) == kills
    written = 0
    for name, (documents, rows, tick) in acknowledged.items():
        if not (tmp_path / name / "run.json").exists():  # killed before anything was acknowledged
            assert (documents, rows, tick) == (0, 0, 0)
            continue
        folder = RunFolder.open(tmp_path / name)
        if not folder.sealed:
            folder.recover()
        folder.verify()
        check_documents(folder, documents)
        check_samples(folder, rows)
        check_edges(folder, tick)
        written += tick > 0
    assert written > kills // 2, "the children were killed before they wrote"


def check_documents(folder: RunFolder, acknowledged: int) -> None:
    numbers = [document["seq_num"] for _, document in folder.documents("event")]
    assert numbers == list(range(len(numbers)))
    assert len(numbers) >= acknowledged


def check_samples(folder: RunFolder, acknowledged: int) -> None:
    raw = folder.raw()
    assert raw.rows >= acknowledged
    for index in range(raw.rows // killed_writers.ROWS):
        place = slice(index * killed_writers.ROWS, (index + 1) * killed_writers.ROWS)
        for column, values in killed_writers.samples(index).items():
            np.testing.assert_array_equal(raw.columns[column][place], values)


def check_edges(folder: RunFolder, acknowledged: int) -> None:
    found = list(folder.edges())
    channels = killed_writers.CHANNELS
    assert len(found) % len(channels) == 0
    for place, each in enumerate(found):
        index, channel = divmod(place, len(channels))
        expected = killed_writers.edges(index)[channels[channel]]
        assert each.channel == channels[channel]
        assert each.block.stop_tick == expected.stop_tick
        np.testing.assert_array_equal(each.block.ticks, expected.ticks)
    covered = found[-1].block.stop_tick if found else 0
    assert covered >= acknowledged
