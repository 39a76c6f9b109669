"""What a sealed run must hold to be read again as a calibration."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from torquebench.calibration import load_profile
from torquebench.campaign.registering import read_measured
from torquebench.campaign.resuming import _placed
from torquebench.errors import RecordError

DATA = {
    "reading_nm": [1.0, 2.0],
    "standard_nm": [1.0, 2.0],
    "series": [1, 1],
    "branch": [1, 1],
    "range_nm": 10.0,
}


@pytest.mark.parametrize(
    "results",
    [None, {}, {"data": {"reading_nm": [1.0]}}, {"data": DATA}, {"data": DATA | {"x": 1}}],
)
def test_a_run_without_a_calibrations_result_is_refused(results: Any) -> None:
    folder: Any = SimpleNamespace(results=results, metadata={}, path=Path("run-1"))
    with pytest.raises(RecordError, match="run-1"):
        read_measured(folder)


def test_a_placed_point_of_version_0_1_0_is_not_rebuilt() -> None:
    steps = load_profile("staircase").staircase(50.0)
    series = max(step.series for step in steps) + 1
    row = {"series": series, "step": 0, "branch": 1}
    assert _placed(steps, (series, 0), {**row, "target_nm": 5.0}, 50.0) is None
    assert _placed(steps, (series, 0), {**row, "nominal_nm": 5.0}, 50.0) is not None
