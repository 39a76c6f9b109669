"""What results show on the Chinese panel is Chinese: titles, captions, curves' names."""

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from torquebench.calibration import CalibrationData
from torquebench.operations import find_operation
from torquebench.operations.mechanics import Mechanics
from torquebench.operations.papers import PapersRequest, papers_page_of
from torquebench.operations.place import PackagedLibrary, Place
from torquebench.papers.in_place import in_place_page
from torquebench.papers.items import HARDWARE, SUB_SYSTEMS
from torquebench.papers.models import BP_RESIDUAL, RECOMMENDED_NAME, fit_module
from torquebench.papers.page import BEYOND, INTERFACE, PURPOSE, study_blocks
from torquebench.papers.study import FAMILIES, Row, contenders
from torquebench.papers.tables import ModuleTables
from torquebench.progress import NO_PROGRESS
from torquebench.reports.page import Diagram, Facts, Figure, Page, Section, Table, drawn
from torquebench.translations import has_words, translated

EXAMPLES = Path(__file__).parents[3] / "examples"
FIELD = Path(__file__).parents[1] / "reducers" / "field"
EVALUATED = ("breakaway", "efficiency", "transmission-error", "hysteresis")
ADDRESSES = {row[-1] for rows in (BEYOND, INTERFACE, PURPOSE) for row in rows}
"""Commands, and addresses of the HTTP API and of tests."""


def in_place() -> Page:
    up = np.linspace(0.0, 2000.0, 11)
    torque = np.concatenate([up, up[::-1], -up, -up[::-1]])
    branch = np.repeat([1, -1, 1, -1], 11)
    reading = torque * (1.0 + 1e-3) + 0.2 * branch
    data = CalibrationData(reading, torque, np.ones(44, int), branch, 2000.0, side="output")
    module = ModuleTables(data, data, None, data)
    return in_place_page("Lab 3", "output", fit_module(module, (BP_RESIDUAL, RECOMMENDED_NAME)))


def evaluated(name: str, file: str, **request: object) -> Page:
    operation = find_operation(f"evaluate {name}")
    asked = operation.request.model_validate({"data": [FIELD / file], **request})
    place = Place("", PackagedLibrary())
    return operation.run(place, asked, NO_PROGRESS).page()


def mechanics(name: str) -> Page:
    operation = find_operation(f"mechanics {name}")
    found = operation.run(cast(Place, None), operation.request(), NO_PROGRESS)
    assert isinstance(found, Mechanics)
    assert found.page().sections[0].blocks
    return Page(found.headline, "", found.page().sections)


def texts(page: Page) -> Iterator[str]:
    """Yield every text of a page, with the names of curves and axes."""
    yield page.title
    for section in page.sections:
        yield from (section.heading, section.text)
        for block in drawn(section.blocks):
            if isinstance(block, Facts):
                yield from (each for pair in block.items for each in pair)
            if isinstance(block, Table):
                yield from (*block.header, *(cell for row in block.rows for cell in row))
            if isinstance(block, Table | Figure | Diagram):
                yield block.caption
            if isinstance(block, Diagram):
                for panel in block.panels:
                    yield from (panel.title, panel.abscissa, panel.ordinate)
                    yield from (curve.label for curve in panel.curves)


def papers() -> Page:
    study = [
        Row(family, "50 rising", each.title, 3.0, 2.0, 2.5, 20, 3, 20)
        for family in FAMILIES
        for each in contenders()
    ]
    answer, blocks = study_blocks(study, 2)
    tables = (Table(("here",), rows) for rows in (BEYOND, INTERFACE, PURPOSE))
    facts = (Facts([*HARDWARE.items(), *((each, "") for each in SUB_SYSTEMS)]),)
    measured = papers_page_of(
        PapersRequest(tables=(EXAMPLES / "calibration-output.csv",), study=False),
        Path("none"),
        NO_PROGRESS,
    )
    own = Section(answer.ours, answer.why, (*blocks, *tables, *facts))
    return replace(measured, sections=[*measured.sections, own])


@pytest.mark.parametrize(
    "page",
    [
        in_place,
        *(partial(mechanics, each) for each in ("additional-torque", "sections")),
        partial(evaluated, "breakaway", "breakaway_staircase.csv", kind="back-driving"),
        partial(evaluated, "efficiency", "efficiency_chain.csv", ratio=10.0),
        partial(
            evaluated,
            "transmission-error",
            "te_large_error_one_turn.csv",
            ratio=10.0,
            highest_order=1.0,
        ),
        partial(evaluated, "hysteresis", EXAMPLES / "loops-rv-40e.csv", reducer="rv-40e"),
        pytest.param(papers, marks=pytest.mark.nightly),
    ],
    ids=["in-place", "additional-torque", "sections", *EVALUATED, "papers"],
)
def test_what_the_panel_shows_is_chinese(page: Callable[[], Page]) -> None:
    said = {
        each
        for each in texts(page())
        if has_words(each) and re.search("[a-z]{2}", each) and each not in ADDRESSES
    }
    assert len(said) > 5
    said = {each for each in said if not re.search(r"\.csv$| = \w", each)}
    assert [each for each in sorted(said) if translated(each, "zh") == each] == []
