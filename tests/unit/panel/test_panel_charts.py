"""Lines of charts: an uncertainty is a bar about its value, limits have a name."""

import math
import re
from importlib import resources

import numpy as np
import pytest

from torquebench import figures
from torquebench.panel.components.charts import (
    COLOURS,
    Line,
    _legend,
    error_bars,
    limit_lines,
    palette,
)
from torquebench.panel.components.page_view import _lines
from torquebench.panel.pages.live.chart import COLOURS as LIVE
from torquebench.panel.text import Text
from torquebench.reports.curve_figures import Panel


@pytest.mark.parametrize("side", ["", "input", "output"])
def test_a_curve_has_the_same_colour_on_paper_on_a_result_and_live(side: str) -> None:
    on_paper = dict(zip(figures.COLOURS, COLOURS, strict=False))
    both = list(zip(figures.palette(side), palette(side), strict=False))
    assert [on_paper[paper] for paper, _ in both if paper in on_paper] == [
        screen for paper, screen in both if paper in on_paper
    ]
    x = np.zeros(2)
    curves = [figures.Curve("raw", x, x, raw=True), figures.Curve("model", x, x)]
    raw, compensated = _lines(Text("en"), Panel(curves, "x", "y", side=side))
    assert (raw.colour, compensated.colour) == (LIVE["raw_nm"], LIVE[side or "input"])
    assert palette(side).count(LIVE["reference_nm"]) == (side == "")  # the standard's own


LOOK = (resources.files("torquebench.panel") / "static" / "panel.css").read_text("utf-8")


def test_texts_have_one_scale_of_sizes_and_boxes_a_grid_of_4_px() -> None:
    sizes = re.findall(r"^([^@/\n]*)\{[^{}]*?font-size: (\d+)px", LOOK, re.M)
    texts = {int(size) for rule, size in sizes if "q-icon" not in rule}
    assert texts == {11, 13, 15, 18, 22, 44}  # 11: names of pages and bench on a phone
    spaces = re.findall(r"(?:padding|margin|gap)[a-z-]*: ([^;]*)", LOOK)
    off = {int(px) for space in spaces for px in re.findall(r"\b(\d+)px", space)}
    assert {px for px in off if px % 4 and px > 2} == set()


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
