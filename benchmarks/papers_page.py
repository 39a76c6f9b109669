"""Page of the documentation about the papers, with figures measured on simulated benches.

``python -m benchmarks.papers_page --write`` does what ``torquebench papers --whole`` does, and
writes docs/explanation/papers-item-by-item.md and docs/images/papers. ``--tables FOLDER`` takes the
tables that ``torquebench papers-tables`` wrote instead of measuring.
"""

from __future__ import annotations

import argparse
import dataclasses
import re
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from torquebench.operations.papers import PapersRequest, papers_page_of
from torquebench.progress import NO_PROGRESS
from torquebench.reports.page import Diagram, Facts, Figure, Page, Section, Table
from torquebench.reports.page_pdf import write_report

DOCS = Path(__file__).parents[1] / "docs"
PAGE = DOCS / "explanation" / "papers-item-by-item.md"
IMAGES = DOCS / "images" / "papers"
INTRODUCTION = """\
*Simulated. Written by `python -m benchmarks.papers_page --write`, which does what \
[`torquebench papers --whole`](source-papers.md) does; tables of more than 24 cells are only \
there. Verdicts on simulated benches say what the method can reach, not what a real bench does.*

"""
LARGEST_TABLE = 24
"""Largest number of cells of a table in the documentation; the command's own page has all
tables."""
LEFT_OUT = "*Tables in the page of the command.*"
REPEATED = "groups at other torques"
"""Part of the captions of tables that repeat other tables of the item for other torques."""
COMMON_NAME = "Simulated reducer bench, preset nominal, "
"""Common part of the benches' names, left out in tables, where the seed is enough."""
WHOLE = "Worst error of the polynomial divided by that of the model"
"""Beginning of the caption of the one larger table that the documentation shows: item 15's."""
LONG_NUMBER = re.compile(r"\b([1-9]\d*\.\d{2})\d+")
"""Numbers to shorten; those below 1 are kept, because they may be scales of letters."""


def smaller(svg: str) -> str:
    """Return a figure with coordinates to a hundredth of a point.

    Examples
    --------
    >>> smaller('<use transform="translate(12.34567 0.123456) scale(0.015625)"/>')
    '<use transform="translate(12.34 0.123456) scale(0.015625)"/>'
    """
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    return LONG_NUMBER.sub(r"\1", re.sub(r"\n\s*", "\n", svg))


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ").replace(COMMON_NAME, "")


def _verdicts(summary: Table) -> Table:
    """Return a table of items and verdicts without reasons, which the page gives below."""
    rows = [[row[0], row[3]] for row in summary.rows]
    return dataclasses.replace(summary, header=("item", "here"), rows=rows)


def _table(table: Table) -> str:
    cells = (1 + len(table.rows)) * len(table.header)
    large = cells > LARGEST_TABLE and not table.caption.startswith(WHOLE)
    if large or REPEATED in table.caption:
        return ""
    align = "---" if table.words else "---:"
    lines = [
        "| " + " | ".join(map(_cell, table.header)) + " |",
        "| --- |" + f" {align} |" * (len(table.header) - 1),
        *("| " + " | ".join(map(_cell, row)) + " |" for row in table.rows),
    ]
    caption = f"\n\n{table.caption}" if table.caption else ""
    return "\n".join(lines) + caption


def markdown(page: Page, images: Path) -> str:
    """Return the page as Markdown, and write its figures."""
    images.mkdir(parents=True, exist_ok=True)
    for old in images.glob("*.svg"):
        old.unlink()
    parts = [f"# {page.title}", page.subtitle]
    for section in page.sections:
        parts += [f"## {section.heading}", *_section(section, images)]
    return "\n\n".join(part for part in parts if part) + "\n"


def _section(section: Section, images: Path) -> Iterator[str]:
    yield section.text
    number, drawn = section.heading.partition(".")[0], 0
    shown = []
    for block in section.blocks:
        if isinstance(block, Facts):
            rows = "\n".join(f"| {_cell(name)} | {_cell(value)} |" for name, value in block.items)
            shown.append(f"| what | value |\n| --- | --- |\n{rows}")
        elif isinstance(block, Table):
            shown.append(_table(_verdicts(block) if section.heading == "Summary" else block))
        elif isinstance(block, Figure | Diagram):
            drawn += 1
            path = images / f"item-{number}-{drawn}.svg"
            path.write_text(smaller(block.svg), encoding="utf-8")
            shown.append(f"![Item {number}](../images/papers/{path.name})\n\n*{block.caption}*")
    yield from shown if any(shown) else [LEFT_OUT]


def main(arguments: Sequence[str] | None = None) -> None:
    """Make the page, and write it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tables", type=Path, nargs="*", default=())
    parser.add_argument("--out", type=Path, help="folder for the page as HTML and PDF")
    parser.add_argument("--write", action="store_true")
    chosen = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        request = PapersRequest(tables=tuple(chosen.tables), whole=True)
        page = papers_page_of(request, Path(folder) / "papers.study", NO_PROGRESS)
    if chosen.out is not None:
        for kind in ("html", "pdf"):
            write_report(page, chosen.out / f"papers.{kind}")
    page = dataclasses.replace(page, subtitle=INTRODUCTION + page.subtitle)
    with tempfile.TemporaryDirectory() as folder:
        text = markdown(page, IMAGES if chosen.write else Path(folder))
    if chosen.write:
        PAGE.write_text(text, encoding="utf-8")
    else:
        print(text)


if __name__ == "__main__":
    main()
