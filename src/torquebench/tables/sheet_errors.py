"""Errors in the cells of spreadsheets, such as ``#DIV/0!``, which readers of values leave empty."""

from __future__ import annotations

import posixpath
import re
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO
from xml.etree import ElementTree

__all__ = ["cell_errors"]

_RELATION = "{http://schemas.openxmlformats.org/officeDocument/2006/relationships}id"
_STRICT = "{http://purl.oclc.org/ooxml/officeDocument/relationships}id"
_MARK = re.compile(rb"""\bt=["']e["']|:value-type=["']error["']""")
_LONGEST_MARK = 32


def cell_errors(path: Path, sheet: str) -> dict[tuple[int, int], str]:
    """Return the errors that the cells of a sheet hold, by row and column from 0.

    Of .xlsx, .xlsm and .ods; the binary formats (.xls, .xlsb) have none here.

    Parameters
    ----------
    path : pathlib.Path
        The workbook.
    sheet : str
        Name of the sheet.
    """
    kind = path.suffix.lower()
    if kind not in (".xlsx", ".xlsm", ".ods"):
        return {}
    with zipfile.ZipFile(path) as book:
        part = "content.xml" if kind == ".ods" else _part_of(book, sheet)
        if part not in book.namelist():
            return {}
        with book.open(part) as content:
            if not _has_errors(content):
                return {}
        with book.open(part) as content:
            return dict(_of_open_document(content, sheet) if kind == ".ods" else _of_sheet(content))


def _has_errors(content: IO[bytes]) -> bool:
    """Return whether a sheet's text marks an error; parsing large sheets takes seconds."""
    kept = b""
    while piece := content.read(1 << 20):
        if _MARK.search(kept + piece):
            return True
        kept = piece[-_LONGEST_MARK:]
    return False


def _name(element: ElementTree.Element) -> str:
    return element.tag.rpartition("}")[2]


def _attribute(element: ElementTree.Element, name: str, space: str = "") -> str:
    """Return an attribute by its name without the namespace, of which versions have several."""
    for key, value in element.attrib.items():
        if key.rpartition("}")[2] == name and space in key:
            return value
    return ""


def _part_of(book: zipfile.ZipFile, sheet: str) -> str:
    """Return the file inside an .xlsx with a sheet's cells, or ""."""
    names = book.namelist()
    workbook, relations = "xl/workbook.xml", "xl/_rels/workbook.xml.rels"
    if workbook not in names or relations not in names:
        return ""
    numbers = [
        each.get(_RELATION) or each.get(_STRICT)
        for each in ElementTree.fromstring(book.read(workbook)).iter()
        if _name(each) == "sheet" and each.get("name") == sheet
    ]
    for each in ElementTree.fromstring(book.read(relations)):
        if each.get("Id") in numbers:
            return posixpath.normpath(posixpath.join("/xl", each.get("Target", ""))).lstrip("/")
    return ""


def _of_sheet(content: IO[bytes]) -> Iterator[tuple[tuple[int, int], str]]:
    row = column = -1
    for event, element in ElementTree.iterparse(content, ("start", "end")):
        name = _name(element)
        if event == "start" and name == "row":
            row, column = int(element.get("r", row + 2)) - 1, -1
        elif event == "start" and name == "c":
            place = element.get("r", "")
            column = _column(place) if place else column + 1
        elif event == "end" and name == "c":
            if element.get("t") == "e":
                value = next((each.text for each in element if _name(each) == "v"), "")
                yield (row, column), value or ""
        elif event == "end" and name == "row":
            element.clear()


def _column(place: str) -> int:
    """Return the column of a cell's name.

    >>> _column("A4"), _column("AB12")
    (0, 27)
    """
    number = 0
    for letter in place.rstrip("0123456789"):
        number = 26 * number + ord(letter) - ord("A") + 1
    return number - 1


def _of_open_document(content: IO[bytes], sheet: str) -> Iterator[tuple[tuple[int, int], str]]:
    inside, row, column = False, 0, 0
    found: list[tuple[int, str]] = []
    for event, element in ElementTree.iterparse(content, ("start", "end")):
        name = _name(element)
        if name == "table" and event == "start":
            inside, row = _attribute(element, "name", "table") == sheet, 0
        elif event == "start" and name == "table-row":
            column, found = 0, []
        elif event == "end" and name in ("table-cell", "covered-table-cell"):
            if _attribute(element, "value-type", "calcext") == "error":
                found.append((column, "".join(element.itertext()).strip()))
            column += int(_attribute(element, "number-columns-repeated") or 1)
        elif event == "end" and name == "table-row":
            if inside:
                yield from (((row, place), text) for place, text in found)
            row += int(_attribute(element, "number-rows-repeated") or 1)
            element.clear()
