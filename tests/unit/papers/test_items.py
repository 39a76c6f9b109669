"""Nothing is shown as the papers' that they don't state."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from benchmarks.papers_page import LEFT_OUT, markdown, smaller

from torquebench.bench.mounting_record import COAXIALITY_LIMIT_MM
from torquebench.figures import Curve
from torquebench.papers.items import HARDWARE, ITEMS, LOADING, SUB_SYSTEMS
from torquebench.papers.mechanics import COAXIALITY_LIMIT_M
from torquebench.papers.page import BEYOND, LIMIT_PERCENT
from torquebench.papers.study import CLAIMED_RATIO, NETWORK_NM, POLYNOMIAL_NM
from torquebench.reports.curve_figures import Panel, panels_figure
from torquebench.reports.page import Diagram, Figure, Page, Section

STATED = {
    int(number): text
    for number, text in tomllib.loads(
        (Path(__file__).parent / "stated.toml").read_text(encoding="utf-8")
    ).items()
}
DOCS = Path(__file__).parents[3] / "docs"
FIGURE = re.compile(r"\d+(?:\.\d+)?")
NAME = re.compile(r"\b(?:[A-Z][A-Za-z]*\d[\w-]*|[A-Z]{2,}\w*|Modrol|LabVIEW)\b")


def said(text: str) -> set[str]:
    """Return every figure and every name of a text, and every word of four letters or more."""
    words = re.findall(r"[a-z]{4,}", text.lower())
    return {*FIGURE.findall(text), *NAME.findall(text), *words}


LINKING = {"found", "from", "full", "takes", "place", "within", "mounting", "both", "directions",
           "under", "supports", "points", "below", "transducers", "above", "claim", "range",
           "mount", "same", "gets", "that", "with", "curve", "module"}  # fmt: skip


def test_all_items_are_there_in_their_order() -> None:
    assert list(ITEMS) == list(STATED) == list(range(1, 23))


@pytest.mark.parametrize("number", ITEMS)
def test_an_item_states_no_more_than_the_papers(number: int) -> None:
    more = said(ITEMS[number].theirs) - said(STATED[number]) - LINKING
    assert more == set()


@pytest.mark.parametrize("name", HARDWARE)
def test_hardware_is_named_as_the_papers_name_it(name: str) -> None:
    theirs = HARDWARE[name]
    if theirs != "not published":
        assert said(theirs) <= said(STATED[3]) | said(STATED[14])


def test_limits_and_claims_are_theirs() -> None:
    def figures(number: int) -> set[float]:
        return {float(each) for each in FIGURE.findall(STATED[number])}

    assert {NETWORK_NM, POLYNOMIAL_NM} <= figures(15)
    assert CLAIMED_RATIO == POLYNOMIAL_NM / NETWORK_NM
    assert LIMIT_PERCENT in figures(14)
    assert 0.5 in figures(16)
    assert COAXIALITY_LIMIT_MM in figures(2)
    assert pytest.approx(1e-3 * COAXIALITY_LIMIT_MM) == COAXIALITY_LIMIT_M
    assert said(LOADING) <= said(STATED[3])
    for name in SUB_SYSTEMS:
        assert name in STATED[1]


def test_letters_keep_their_size_in_the_documentations_figures() -> None:
    assert "scale(0.015625)" in smaller('<use transform="translate(12.3456 0) scale(0.015625)"/>')
    figures = sorted((DOCS / "images" / "papers").glob("*.svg"))
    assert figures
    for path in figures:
        letters = set(re.findall(r"scale\((0\.0\d*)\)", path.read_text(encoding="utf-8")))
        assert letters == {"0.015625"}, path.name


def test_figures_of_every_kind_reach_the_documentation(tmp_path: Path) -> None:
    panel = Panel([Curve("", np.arange(3.0), np.arange(3.0))], "x", "y")
    blocks = (Figure(panels_figure([panel]), "a"), Diagram([panel], "b"))
    text = markdown(Page("p", "", [Section("1. it: met", "", blocks)]), tmp_path)
    assert text.count("![Item 1]") == len(list(tmp_path.glob("*.svg"))) == 2


def test_the_documentations_page_is_current_in_its_words() -> None:
    page = (DOCS / "explanation" / "papers-item-by-item.md").read_text(encoding="utf-8")
    for number, item in ITEMS.items():
        heading, _, rest = page.partition(f"\n## {number}. {item.title}: ")
        assert heading != page, f"item {number}: python -m benchmarks.papers_page --write"
        section = rest.partition("\n## ")[0]
        assert f"Papers: {item.theirs}. Here: " in section
        assert f"Command: {item.command}." in section
        shown = ("| --- |", "](../images/papers/item-", LEFT_OUT)
        assert any(words in section for words in shown), number


def test_what_lies_beyond_the_papers_has_figures_of_the_benchmarks_and_ends_the_page() -> None:
    measured = set(FIGURE.findall((DOCS / "benchmarks.md").read_text(encoding="utf-8")))
    figures = {figure for _, here, _ in BEYOND for figure in FIGURE.findall(here)}
    assert figures - measured - {"3"} == set()
    page = (DOCS / "explanation" / "papers-item-by-item.md").read_text(encoding="utf-8")
    last = page.rpartition("\n## ")[2]
    assert last.startswith("Beyond the papers\n")
    assert all(f"| {subject} | {here} | {where} |" in last for subject, here, where in BEYOND)
