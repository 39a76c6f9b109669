"""Decisions have a number each, and every text that names one names a decision that there is."""

import re
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs" / "decisions").glob("*.md"))
SECTION = re.compile(r"^## (\d+)\. \S", re.M)
SOURCES = ("src/**/*.py", "plugins/**/*.py", "plugins/*/docs/*.md", "docs/**/*.md")


def sections(page: Path) -> list[int]:
    return [int(number) for number in SECTION.findall(page.read_text(encoding="utf-8"))]


def test_a_number_stands_for_one_decision_and_each_page_is_in_their_order() -> None:
    numbers = Counter(number for page in PAGES for number in sections(page))
    assert numbers
    assert [number for number, times in numbers.items() if times > 1] == []
    assert all(sections(page) == sorted(sections(page)) for page in PAGES)
    assert [page.name for page in PAGES if page.name[0].isdigit()] == []


def test_texts_name_decisions_that_there_are() -> None:
    there = {number for page in PAGES for number in sections(page)}
    wrong = [
        f"{path.relative_to(ROOT)}: {number}"
        for pattern in SOURCES
        for path in ROOT.glob(pattern)
        if not {"generated", "_build"} & set(path.parts)
        for number in re.findall(r"decision (\d+)", path.read_text(encoding="utf-8"))
        if int(number) not in there
    ]
    assert wrong == []
