"""Lines of charts: an uncertainty is a bar about its value, limits have a name."""

import math

import pytest

from torquebench.panel.components.charts import Line, _legend, error_bars, limit_lines


def test_each_value_has_a_bar_of_its_own() -> None:
    bars = error_bars("± U", [1.0, 2.0], [0.1, 0.2])
    assert not bars.points
    assert bars.x == pytest.approx([0, 0, math.nan, 1, 1, math.nan], nan_ok=True)
    assert bars.y == pytest.approx([0.9, 1.1, math.nan, 1.8, 2.2, math.nan], nan_ok=True)


def test_two_limits_are_one_entry_of_the_legend() -> None:
    limits = limit_lines("Tolerance", -2000.0, 2000.0, -2.0, 2.0)
    assert limits.title == "Tolerance"
    assert limits.dashed
    assert limits.y == pytest.approx([-2.0, -2.0, math.nan, 2.0, 2.0], nan_ok=True)


def test_a_legend_wraps_on_a_phone_until_it_has_to_scroll() -> None:
    lines = [Line(name, [], [], "--ink") for name in ("raw", "model", "model", "other", "fourth")]
    found = [_legend(lines[:count]) for count in (1, 4, 5)]
    assert [each["show"] for each in found] == [False, True, True]
    assert [each["type"] for each in found] == ["plain", "plain", "scroll"]
