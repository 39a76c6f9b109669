"""Small files that expand to more than a computer has, written by the usual libraries."""

import re
import zipfile
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import openpyxl
import pyarrow as pa
import pyarrow.parquet as pq
import scipy.io

SHEET = "xl/worksheets/sheet1.xml"


def far_cell(path: Path) -> None:
    """A sheet with a cell at XFD1048576: 5 kB, 17 thousand million cells."""
    book = openpyxl.Workbook()
    sheet = book.active
    for row in (["reading_nm", "standard_nm"], [0.0, 0.0], [10.1, 10.0]):
        sheet.append(row)
    sheet["XFD1048576"] = 1.0
    book.save(path)


def far_cell_undeclared(path: Path) -> None:
    """The same, and the sheet doesn't say how large it is."""
    _changed(path, lambda xml: re.sub(rb"<dimension[^>]*/>", b"", xml))


def far_cell_denied(path: Path) -> None:
    """The same, and the sheet says that it is small."""
    small = b'<dimension ref="A1:B3"/>'
    _changed(path, lambda xml: re.sub(rb"<dimension[^>]*/>", small, xml))


def long_cell(path: Path) -> None:
    """900 MB in one cell of a sheet: 900 kB."""
    far_cell(path)
    parts = _parts(path)
    begin, end = re.split(rb'<c r="XFD1048576".*?</c>', parts.pop(SHEET), maxsplit=1)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as book:
        for name, content in parts.items():
            book.writestr(name, content)
        with book.open(SHEET, "w") as sheet:
            sheet.write(begin + b'<c r="C3" t="inlineStr"><is><t>')
            for _ in range(900):
                sheet.write(b"a" * 1_000_000)
            sheet.write(b"</t></is></c>" + end)


def long_line(path: Path) -> None:
    """900 MB in one cell of a text; on disk it has next to no bytes."""
    with path.open("wb") as file:
        file.write(b'reading_nm,standard_nm\n1,1\n"a')
        file.truncate(900_000_000)  # NUL characters


def many_rows(path: Path) -> None:
    """100 million rows, 1.6 GB."""
    schema = pa.schema([("reading_nm", pa.float64()), ("standard_nm", pa.float64())])
    rows = pa.table([np.zeros(4_000_000), np.ones(4_000_000)], schema=schema)
    with pq.ParquetWriter(path, schema, compression="zstd") as file:
        for _ in range(25):
            file.write_table(rows, row_group_size=len(rows))


def one_long_word(path: Path) -> None:
    """1600 cells of 1 MB each, stored once: 1.1 kB."""
    word = pa.DictionaryArray.from_arrays(pa.array([0] * 1600, pa.int32()), ["x" * 1_000_000])
    numbers = [float(n) for n in range(1600)]
    table = pa.table(
        {"reading_nm": numbers, "note": word.cast(pa.string()), "standard_nm": numbers}
    )
    pq.write_table(table, path, compression="zstd")


def fill_values(path: Path) -> None:
    """Twice 2·10⁹ values that aren't stored: 1.7 kB."""
    with h5py.File(path, "w") as file:
        for name in ("reading_nm", "standard_nm"):
            file.create_dataset(name, (2_000_000_000,), "f8", chunks=(1 << 20,))


def packed_zeros(path: Path) -> None:
    """Twice 30 million zeros: 60 kB."""
    zeros = np.zeros(30_000_000, np.uint8)
    scipy.io.savemat(path, {"reading_nm": zeros, "standard_nm": zeros}, do_compression=True)


FILES: dict[str, Callable[[Path], None]] = {
    "far-cell.xlsx": far_cell,
    "far-cell-undeclared.xlsx": far_cell_undeclared,
    "far-cell-denied.xlsx": far_cell_denied,
    "long-cell.xlsx": long_cell,
    "long-line.csv": long_line,
    "many-rows.parquet": many_rows,
    "one-long-word.parquet": one_long_word,
    "fill-values.h5": fill_values,
    "packed-zeros.mat": packed_zeros,
}


def _parts(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as book:
        return {name: book.read(name) for name in book.namelist()}


def _changed(path: Path, change: Callable[[bytes], bytes]) -> None:
    far_cell(path)
    parts = _parts(path)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as book:
        for name, content in parts.items():
            book.writestr(name, change(content) if name == SHEET else content)
