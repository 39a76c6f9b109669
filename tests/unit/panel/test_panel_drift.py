"""The drift of a transducer as lines over time, each of which the legend names."""

import math
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from torquebench.calibration.drift import individuals_chart
from torquebench.campaign.drifting import DriftSeries
from torquebench.panel.pages.records.overview import drift_lines
from torquebench.panel.text import Text

BEGAN = datetime(2026, 11, 23, 7, 20, tzinfo=UTC)


def series(values: list[float]) -> DriftSeries:
    moments = tuple(BEGAN + timedelta(minutes=5 * place) for place in range(len(values)))
    chart = individuals_chart(np.array(values)) if len(values) > 2 else None
    return DriftSeries("Zero", "% FS", moments, tuple(values), 0.1, chart, None, None, False, True)


def test_limits_are_a_line_with_a_name_over_moments() -> None:
    found = series([0.04, 0.05, 0.06, 0.05])
    values, centre, limits = drift_lines(Text("en"), found)
    assert [each.title for each in (values, centre, limits)] == [
        "values", "centre", "control limits"
    ]  # fmt: skip
    assert values.x[0] == BEGAN.timestamp()
    assert values.x[-1] == BEGAN.timestamp() + 900.0
    assert found.chart is not None
    low, high = found.chart.lower, found.chart.upper
    assert limits.y == pytest.approx([low, low, math.nan, high, high], nan_ok=True)
    assert limits.dashed


def test_few_values_have_no_limits() -> None:
    assert [each.title for each in drift_lines(Text("zh"), series([0.04, 0.05]))] == ["数值"]
