"""The open data set of chains that turn: written with its truth, judged against it."""

import json
from pathlib import Path

import numpy as np
import pytest
from benchmarks import rotating_data

from torquebench.errors import InputError
from torquebench.tables import read_calibration, read_empty_run, read_table


@pytest.mark.nightly
def test_the_data_set_is_written_with_its_truth_and_judged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert rotating_data.main([str(tmp_path), "--chains", "1"]) == 0
    folders = sorted(tmp_path.iterdir())
    assert len(folders) == 6
    folder = tmp_path / "smooth-0"
    points = read_calibration(folder / "calibration.csv")
    assert points.simulated
    assert points.speed_rpm is not None
    assert {0.0} < set(np.abs(points.speed_rpm).round().tolist())
    assert len(read_empty_run(folder / "empty-38.csv")) > 1000
    readings, truth = read_table(folder / "readings.csv"), read_table(folder / "truth.csv")
    read, true = readings.numbers("reading_nm"), truth.numbers("torque_nm")
    assert 0.0 < np.sqrt(np.mean((read - true) ** 2)) < 0.01 * points.range_nm

    assert rotating_data.main([str(tmp_path), "--judge"]) == 1  # nothing to judge yet
    u = np.full(true.size, 0.02)
    table = np.column_stack([true + 0.01, u])
    header = "torque_nm,expanded_uncertainty_nm"
    np.savetxt(folder / "torque.csv", table, "%.9g", ",", header=header, comments="")
    capsys.readouterr()
    assert rotating_data.main([str(tmp_path), "--judge"]) == 0
    assert "100.0 %" in capsys.readouterr().out
    assert rotating_data.judged(folder)[1:3] == ["0.0200", "0.0200"]

    measured = json.loads((folder / "chain.json").read_text())
    (folder / "chain.json").write_text(json.dumps({**measured, "format": "mine"}))
    with pytest.raises(InputError, match="format"):
        rotating_data.judged(folder)
