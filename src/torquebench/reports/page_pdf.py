"""Reports as PDF, typeset by Typst."""

from __future__ import annotations

import math
import re
from importlib import resources
from pathlib import Path
from typing import Any

from torquebench import __version__
from torquebench.atomic_write import atomic_write, is_standard_output
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reports.page import Diagram, Facts, Figure, Page, Table, drawn, write_page

SUFFIXES = (".html", ".pdf")
LINE = 110
"""Number of characters in a table's row."""
GAP = 4
"""Width of the space between two columns, in characters."""
_TOGETHER = re.compile(
    r"(?<=\d) (?=(?:%|N·m|mm|rpm|bar|epochs|N·m/arcmin|arcmin|arcsec)(?!\w)|\d{3}(?!\d))"
    r"|(?<=[≤≥<>]) (?=\d)"
)


def page_pdf(page: Page) -> bytes:
    """Return a report as PDF: the same sections, tables and figures as on the HTML page.

    Parameters
    ----------
    page : Page
        The report.

    Raises
    ------
    InputError
        Where no installed font has the text's characters.
    """
    import typst

    from torquebench.reports.certificate.setting import typeset

    figures: dict[str, str] = {}
    content: dict[str, Any] = {
        "title": page.title,
        "subtitle": page.subtitle,
        "badge": "simulated" if page.simulated else "",
        "footer": f"torquebench {__version__}" + (" · simulated" if page.simulated else ""),
        "sections": [
            {
                "heading": section.heading,
                "text": _unbroken(section.text),
                "blocks": [_plain(block, figures) for block in drawn(section.blocks)],
            }
            for section in page.sections
        ],
    }
    template = resources.files("torquebench.reports") / "templates" / "page.typ"
    try:
        return typeset(template, content, figures, format="pdf")[0]
    except typst.TypstError as error:
        raise InputError(
            Message("the report can't be typeset: {error}", error),
            remedy="write it as .html instead",
        ) from error


def _unbroken(text: str) -> str:
    """Keep a number and its unit on one line."""
    return _TOGETHER.sub("\N{NO-BREAK SPACE}", text)


def _shares(table: Table) -> list[float]:
    """Return each column's share of the remaining width; 0 means the width of its text.

    Columns of numbers are as wide as their text. Columns of sentences share the rest by their
    length; without sentences, the last column of a table of words or the first column of another
    table gets the rest. If the columns of numbers need more than a line, their headings are
    wrapped.
    """
    columns = list(zip(table.header, *table.rows, strict=True))
    wide = sum(max(map(len, column)) + GAP for column in columns)
    if not any(table.sentences):
        shares = [0.0] * len(columns)
        if wide <= LINE:
            shares[-1 if table.words else 0] = 1.0
        return shares
    numbers = [
        max(len(head) // 2, *map(len, (*head.split(), *cells))) + GAP if not sentences else 0
        for (head, *cells), sentences in zip(columns, table.sentences, strict=True)
    ]
    whole = sum(
        max(map(len, column)) + GAP
        for column, sentences in zip(columns, table.sentences, strict=True)
        if not sentences
    )
    texts = [
        math.sqrt(sum(map(len, column))) if sentences else 0.0
        for column, sentences in zip(columns, table.sentences, strict=True)
    ]
    if whole <= 0.6 * LINE:
        return texts
    left = max(LINE - sum(numbers), LINE // 4)
    return [
        float(number or left * text / sum(texts))
        for number, text in zip(numbers, texts, strict=True)
    ]


def _plain(block: Facts | Table | Figure | Diagram, figures: dict[str, str]) -> dict[str, Any]:
    """Return a block for the template, and store its figure as a separate file."""
    if isinstance(block, Facts):
        return {"kind": "facts", "rows": [[name, _unbroken(text)] for name, text in block.items]}
    if isinstance(block, Table):
        return {
            "kind": "table",
            "header": list(block.header),
            "rows": [[_unbroken(cell) for cell in row] for row in block.rows],
            "caption": _unbroken(block.caption),
            "shares": _shares(block),
            "sentences": list(block.sentences),
            "emphasised": block.emphasised,
            "words": block.words,
        }
    name = f"figure-{len(figures) + 1}.svg"
    figures[name] = block.svg
    return {"kind": "figure", "file": name, "caption": _unbroken(block.caption)}


def write_report(page: Page, path: Path) -> Path:
    """Write a report as HTML or PDF by the file's suffix, completely or not at all.

    Parameters
    ----------
    page : Page
    path : pathlib.Path
        File that ends in ``.html`` or ``.pdf``, or standard output, which gets HTML.

    Raises
    ------
    InputError
        Where the suffix is another one.

    Examples
    --------
    >>> write_report(Page("A", "", []), Path("report.docx"))
    Traceback (most recent call last):
    torquebench.errors.InputError: report.docx; allowed: a file that ends in .html or .pdf
    """
    check_suffix(path)
    if path.suffix.lower() != ".pdf":
        return write_page(page, path)
    path.parent.mkdir(parents=True, exist_ok=True)
    atomic_write(path, page_pdf(page))
    return path


def check_suffix(path: Path) -> None:
    """Raise an error if a report's name isn't that of an HTML or PDF file.

    Raises
    ------
    InputError
    """
    if path.suffix.lower() not in SUFFIXES and not is_standard_output(path):
        raise InputError(str(path), Message("a file that ends in {endings}", " or ".join(SUFFIXES)))
    if path.suffix.lower() == ".pdf":
        import typst  # noqa: F401 - where it isn't installed, its extra is named
