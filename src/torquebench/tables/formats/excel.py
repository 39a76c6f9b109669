"""Spreadsheets: Excel and OpenDocument, by calamine."""

from __future__ import annotations

import posixpath
import re
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from datetime import date, datetime, time, timedelta
from pathlib import Path
from typing import IO, Any
from xml.etree import ElementTree

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.tables.formats import Format, OpenedTable, chosen_part, table_schema
from torquebench.tables.headers import known_name
from torquebench.tables.layout import HEAD_ROWS, find_layout

MOST_EXPANDED = 256 << 20
"""Largest size of a workbook's uncompressed parts together, B."""
MOST_CELLS = 4_000_000
"""Largest number of cells between the first and the last cell of a sheet."""
_ZIP = b"PK\x03\x04"
_OLE = b"\xd0\xcf\x11\xe0"
_COMMENT = re.compile(r"#\s*([A-Za-z_][A-Za-z0-9_]*)\s*[=:](.*)")
_DIMENSION = re.compile(rb'<(?:\w+:)?dimension\s+ref="[A-Z]+[0-9]+:([A-Z]+)([0-9]+)"')


def _open(path: Path, part: str, _: ExitStack) -> OpenedTable:
    import pyarrow as pa
    from python_calamine import CalamineWorkbook

    _check_expanded(path)
    book = CalamineWorkbook.from_path(path)
    sheets: dict[str, Any] = {}
    for name in book.sheet_names:
        sheet = book.get_sheet_by_name(name)
        if sheet.height:
            _check_size(path, name, sheet.height, sheet.width)
            sheets[name] = sheet
    chosen = chosen_part(path, part, dict.fromkeys(sheets, ()), "sheet")
    rows = _with_errors(sheets[chosen].to_python(skip_empty_area=False), path, chosen)
    remarks: dict[str, str] = {}
    filled = [(number, row) for number, row in enumerate(rows, 1) if any(c != "" for c in row)]
    while len(filled) > 1:
        first = str(filled[0][1][0]).strip()
        comment = _COMMENT.match(first)
        if comment is not None:
            remarks[comment[1].lower()] = comment[2].strip()
        elif not first.startswith("# "):
            break
        filled.pop(0)
    layout = find_layout(
        [[_text(cell).strip() for cell in row] for _, row in filled[:HEAD_ROWS]],
        [number for number, _ in filled[:HEAD_ROWS]],
        counted="row",
        known=known_name,
    )
    body = filled[layout.first :]
    arrays = [_of_cells([row[index] for _, row in body]) for index in layout.columns]
    columns = [(name, "", each.type) for name, each in zip(layout.names, arrays, strict=True)]
    schema = table_schema(columns, remarks, numbered=True)
    numbers = pa.array([number for number, _ in body], pa.int64())
    table = pa.Table.from_arrays([*arrays, numbers], schema=schema)
    several = chosen if len(book.sheet_names) > 1 else ""
    return OpenedTable(
        schema, table.to_batches, len(body), part=several, notes=layout.notes, numbered=True
    )


def _check_expanded(path: Path) -> None:
    """Refuse a workbook whose uncompressed parts are too large."""
    if not zipfile.is_zipfile(path):
        return
    with zipfile.ZipFile(path) as book:
        expanded = sum(each.file_size for each in book.infolist())
        if expanded > MOST_EXPANDED:
            raise InputError(
                Message("{path} expands to {size} MB", path, expanded >> 20),
                Message("at most {size} MB", MOST_EXPANDED >> 20),
                "save the sheet with the table alone, or as CSV",
            )
        for each in book.infolist():
            if each.filename.startswith("xl/worksheets/") and each.filename.endswith(".xml"):
                with book.open(each) as content:
                    found = _DIMENSION.search(content.read(4096))
                if found is not None:
                    _check_size(path, "", int(found[2]), _column(found[1].decode()) + 1)


def _check_size(path: Path, sheet: str, height: int, width: int) -> None:
    if height * width > MOST_CELLS:
        raise InputError(
            Message(
                "{path}: a sheet{name} of {height} rows and {width} columns",
                path,
                f" {sheet}" if sheet else "",
                height,
                width,
            ),
            Message("at most {most} cells", MOST_CELLS),
            "delete the cells far outside of the table, or save it as CSV",
        )


def _with_errors(rows: list[list[Any]], path: Path, sheet: str) -> list[list[Any]]:
    """Return a sheet's rows with error values as text, which the reader leaves empty."""
    if all(cell != "" for row in rows for cell in row):
        return rows
    for (row, column), text in _cell_errors(path, sheet).items():
        if row < len(rows) and column < len(rows[row]):
            rows[row][column] = text
    return rows


def _text(cell: Any) -> str:
    if isinstance(cell, float) and cell.is_integer():
        return f"{cell:.0f}"
    return cell.isoformat(" ") if isinstance(cell, datetime) else str(cell)


def _of_cells(cells: Sequence[Any]) -> Any:
    """Return a column of a sheet: numbers, moments or truth values if all cells are, else text."""
    import pyarrow as pa

    values = [None if cell == "" else cell for cell in cells]
    kinds = {type(value) for value in values if value is not None}
    if kinds <= {int, float}:
        return pa.array([None if v is None else float(v) for v in values], pa.float64())
    if len(kinds) == 1 and kinds <= {bool, datetime, date, time, timedelta}:
        return pa.array(values)
    return pa.array([None if v is None else _text(v) for v in values], pa.string())


_RELATION = "{http://schemas.openxmlformats.org/officeDocument/2006/relationships}id"
_STRICT = "{http://purl.oclc.org/ooxml/officeDocument/relationships}id"
_MARK = re.compile(rb"""\bt=["']e["']|:value-type=["']error["']""")
_LONGEST_MARK = 32


def _cell_errors(path: Path, sheet: str) -> dict[tuple[int, int], str]:
    """Return the errors in the cells of a sheet, by row and column from 0.

    Errors are found in .xlsx, .xlsm and .ods, but not in the binary formats (.xls, .xlsb).
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
    """Return whether a sheet's text contains an error value, without slowly parsing it."""
    kept = b""
    while piece := content.read(1 << 20):
        if _MARK.search(kept + piece):
            return True
        kept = piece[-_LONGEST_MARK:]
    return False


def _name(element: ElementTree.Element) -> str:
    return element.tag.rpartition("}")[2]


def _attribute(element: ElementTree.Element, name: str, space: str = "") -> str:
    """Return an attribute by its name without namespace, because versions have different ones."""
    for key, value in element.attrib.items():
        if key.rpartition("}")[2] == name and space in key:
            return value
    return ""


def _part_of(book: zipfile.ZipFile, sheet: str) -> str:
    """Return the name of the part of an .xlsx with a sheet's cells, or ""."""
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
    """Return the column number of a cell's name.

    >>> _column("A4"), _column("AB12")
    (0, 27)
    """
    number = 0
    for letter in place.rstrip("0123456789"):
        number = 26 * number + ord(letter) - ord("A") + 1
    return number - 1


def _of_open_document(content: IO[bytes], sheet: str) -> Iterator[tuple[tuple[int, int], str]]:
    """Yield row, column and text of the cells of a sheet that hold an error."""
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


FORMAT = Format(
    name="excel",
    title="Excel (.xlsx, .xls, .ods)",
    endings=(".xlsx", ".xlsm", ".xlsb", ".xls", ".ods"),
    open=_open,
    begins=(_ZIP, _OLE),
    package="python_calamine",
    extra="excel",
    parts="sheet",
    order=3,
)
