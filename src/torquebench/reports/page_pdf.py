"""The same report as a PDF: the page of `page`, set by Typst with its figures."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any

import typst

from torquebench import __version__
from torquebench.atomic_write import atomic_write, is_standard_output
from torquebench.errors import InputError
from torquebench.reports.certificate.fonts import fonts_for
from torquebench.reports.page import Facts, Figure, Page, Table, write_page

__all__ = ["check_suffix", "page_pdf", "write_report"]

SUFFIXES = (".html", ".pdf")


def page_pdf(page: Page) -> bytes:
    """Return a report as PDF: the same sections, tables and figures as on the HTML page.

    Parameters
    ----------
    page : Page
        The report.

    Raises
    ------
    InputError
        Where there is no font for the text.
    """
    figures: dict[str, str] = {}
    content: dict[str, Any] = {
        "title": page.title,
        "subtitle": page.subtitle,
        "badge": "simulated" if page.simulated else "",
        "footer": f"torquebench {__version__}" + (" · simulated" if page.simulated else ""),
        "sections": [
            {
                "heading": section.heading,
                "text": section.text,
                "blocks": [_plain(block, figures) for block in section.blocks],
            }
            for section in page.sections
        ],
    }
    fonts, content["fonts"] = fonts_for(_texts(content))
    with tempfile.TemporaryDirectory(prefix="torquebench-report-") as scratch:
        folder = Path(scratch)
        template = resources.files("torquebench.reports") / "templates" / "page.typ"
        (folder / "main.typ").write_bytes(template.read_bytes())
        for name, svg in figures.items():
            (folder / name).write_text(svg, encoding="utf-8")
        text = json.dumps(content, ensure_ascii=False)
        (folder / "content.json").write_text(text, encoding="utf-8")
        compiler = typst.Compiler(str(folder / "main.typ"), root=str(folder), font_paths=fonts)
        try:
            document = compiler.compile(format="pdf")
        except typst.TypstError as error:
            raise InputError(
                f"the report can't be set: {error}", remedy="write it as .html instead"
            ) from error
    assert isinstance(document, bytes)
    return document


def _plain(block: Facts | Table | Figure, figures: dict[str, str]) -> dict[str, Any]:
    """Return a block for the template, and put its figure aside."""
    if isinstance(block, Facts):
        return {"kind": "facts", "rows": [list(item) for item in block.items]}
    if isinstance(block, Table):
        return {
            "kind": "table",
            "header": list(block.header),
            "rows": [list(row) for row in block.rows],
            "caption": block.caption,
            "sentences": list(block.sentences),
            "emphasised": block.emphasised,
            "words": block.words,
        }
    name = f"figure-{len(figures) + 1}.svg"
    figures[name] = block.svg
    return {"kind": "figure", "file": name, "caption": block.caption}


def _texts(content: Any) -> Iterator[str]:
    if isinstance(content, str):
        yield content
    elif isinstance(content, dict | list):
        for value in content.values() if isinstance(content, dict) else content:
            yield from _texts(value)


def write_report(page: Page, path: Path) -> Path:
    """Write a report as HTML or as PDF, by the file's suffix; whole or not at all.

    Parameters
    ----------
    page : Page
    path : pathlib.Path
        Ends in ``.html`` or ``.pdf``; standard output takes HTML.

    Raises
    ------
    InputError
        Where it ends otherwise.

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
    """Refuse a report's name that isn't one of HTML or PDF, before any work is done for it.

    Raises
    ------
    InputError
    """
    if path.suffix.lower() not in SUFFIXES and not is_standard_output(path):
        raise InputError(str(path), f"a file that ends in {' or '.join(SUFFIXES)}")
