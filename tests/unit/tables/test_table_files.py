"""Tables of every format through the one reader, as a whole and in batches."""

import json
import re
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import openpyxl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from asammdf import MDF, Signal
from nptdms import ChannelObject, RootObject, TdmsWriter
from tests.support.draws import nightly
from tests.watching import Watching

from torquebench.chain.readings import MEASURED
from torquebench.columns import column_of
from torquebench.errors import InputError
from torquebench.tables import (
    READING_COLUMNS,
    compensate_file,
    read_calibration,
    read_readings,
    read_table,
)

Columns = dict[str, tuple[str, list[Any]]]

CALIBRATION: Columns = {
    "time_s": ("s", [0.0, 1.0, 2.0, 3.0, 4.0]),
    "Drehmoment": ("kN·m", [0.0, 0.005, 0.0101, 0.0052, 0.0]),
    "Reference": ("N·m", [0.0, 5.0, 10.0, 5.0, 0.0]),
    "branch": ("", [1, 1, 1, -1, -1]),
}


def write_csv(path: Path, columns: Columns) -> None:
    names = [
        f"{name} [{unit}]" if unit not in ("", "s") else name for name, (unit, _) in columns.items()
    ]
    rows = zip(*(values for _, values in columns.values()), strict=True)
    lines = [";".join(names), *(";".join(str(v).replace(".", ",") for v in row) for row in rows)]
    path.write_bytes(("# range_nm = 12\n" + "\n".join(lines) + "\n").encode("cp1252"))


def write_parquet(path: Path, columns: Columns) -> None:
    fields = [pa.field(n, pa.array(v).type, metadata={"unit": u}) for n, (u, v) in columns.items()]
    arrays = [pa.array(values) for _, values in columns.values()]
    schema = pa.schema(fields, metadata={"range_nm": "12"})
    pq.write_table(pa.Table.from_arrays(arrays, schema=schema), path)


def write_excel(path: Path, columns: Columns) -> None:
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append(["# range_nm = 12"])
    sheet.append(
        [
            f"{name} [{unit}]" if unit not in ("", "s") else name
            for name, (unit, _) in columns.items()
        ]
    )
    for row in zip(*(values for _, values in columns.values()), strict=True):
        sheet.append(list(row))
    book.save(path)


def write_tdms(path: Path, columns: Columns) -> None:
    channels = [
        ChannelObject("bench", name, np.array(values), {"unit_string": unit})
        for name, (unit, values) in columns.items()
    ]
    with TdmsWriter(path) as writer:
        writer.write_segment([RootObject({"range_nm": 12.0}), *channels])


def write_mdf4(path: Path, columns: Columns) -> None:
    time_s = np.array(columns["time_s"][1])
    with MDF(version="4.10") as file:
        entry = '<common_properties><e name="range_nm">12</e></common_properties>'
        file.header.comment = f"<HDcomment><TX/>{entry}</HDcomment>"
        file.append(
            [
                Signal(np.array(values), time_s, unit=unit, name=name)
                for name, (unit, values) in columns.items()
                if name != "time_s"
            ],
            common_timebase=True,
        )
        file.save(path)


def write_hdf5(path: Path, columns: Columns) -> None:
    with h5py.File(path, "w") as file:
        file.attrs["range_nm"] = 12.0
        for name, (unit, values) in columns.items():
            file.create_dataset(f"bench/{name}", data=values).attrs["unit"] = unit


def write_jsonl(path: Path, columns: Columns) -> None:
    head = {"remarks": {"range_nm": "12"}, "units": {name: u for name, (u, _) in columns.items()}}
    rows = zip(*(values for _, values in columns.values()), strict=True)
    lines = [head, *(dict(zip(columns, row, strict=True)) for row in rows)]
    path.write_text("\n".join(json.dumps(line) for line in lines), encoding="utf-8")


WRITERS: dict[str, Callable[[Path, Columns], None]] = {
    "csv": write_csv,
    "parquet": write_parquet,
    "xlsx": write_excel,
    "tdms": write_tdms,
    "mf4": write_mdf4,
    "h5": write_hdf5,
    "jsonl": write_jsonl,
}


@pytest.mark.parametrize("ending", WRITERS)
def test_units_come_from_headers_or_properties_and_channels_go_by_name(
    tmp_path: Path, ending: str
) -> None:
    path = tmp_path / f"calibration.{ending}"
    WRITERS[ending](path, CALIBRATION)
    data = read_calibration(path, mapping=["reading=-Drehmoment"])
    np.testing.assert_allclose(data.reading_nm, [0.0, -5.0, -10.1, -5.2, 0.0])
    assert data.standard_nm.tolist() == [0.0, 5.0, 10.0, 5.0, 0.0]
    assert data.branch.tolist() == [1, 1, 1, -1, -1]
    assert data.time_s is not None
    assert data.time_s.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert data.range_nm == 12.0
    with pytest.raises(InputError, match=r"is in kN·m, the option in N·m"):
        read_calibration(path, mapping=["reading=Drehmoment[Nm]"])


@pytest.mark.parametrize("ending", ["parquet", "tdms", nightly("mf4"), "h5", "jsonl"])
def test_every_quantity_of_readings_is_a_column_in_its_unit(tmp_path: Path, ending: str) -> None:
    """A name such as acceleration_rad_s2 and its stated unit agree."""
    path, values = tmp_path / f"readings.{ending}", [1.0, 2.0, 3.0]
    WRITERS[ending](path, {name: (column_of(name).unit, values) for name in READING_COLUMNS})
    readings = read_readings(path).readings()
    for name in ("reading_nm", "time_s", *MEASURED):
        assert getattr(readings, name).tolist() == values
    assert np.asarray(readings.counter_nm).tolist() == values


@pytest.mark.parametrize("ending", [nightly(each) if each == "mf4" else each for each in WRITERS])
def test_readings_of_any_format_are_compensated_in_batches(
    tmp_path: Path, ending: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("torquebench.tables.compensating._BLOCK_ROWS", 100)
    reading = np.round(np.sin(np.arange(1234.0)), 4)
    source, target = tmp_path / f"readings.{ending}", tmp_path / "torque.csv"
    WRITERS[ending](
        source,
        {"time_s": ("s", np.arange(1234.0).tolist()), "Drehmoment": ("kN·m", reading.tolist())},
    )
    blocks, watching = [], Watching()

    def compensate(readings: Any) -> tuple[Any, ...]:
        blocks.append(len(readings))
        value = readings.reading_nm
        return value + 1.0, np.ones(value.size), np.full(value.size, 0.5)

    done = compensate_file(
        source, target, compensate, mapping=["reading=Drehmoment"], progress=watching
    )
    assert done.rows == sum(blocks) == 1234
    assert ending == "csv" or max(blocks) == 100
    assert watching.done[-1] == 100
    torque = read_table(target)
    assert "Drehmoment [kN·m]" in torque
    np.testing.assert_allclose(
        torque.numbers("torque_nm"), 1000.0 * reading + 1.0, rtol=0, atol=1e-9
    )


def test_a_file_of_several_tables_wants_one_chosen(tmp_path: Path) -> None:
    path = tmp_path / "two.tdms"
    with TdmsWriter(path) as writer:
        writer.write_segment(
            [
                ChannelObject("slow", "temperature_c", np.array([20.0, 21.0])),
                ChannelObject("fast", "reading_nm", np.array([1.0, 2.0, 3.0])),
                ChannelObject("fast", "standard_nm", np.array([1.1, 2.1, 3.1])),
            ]
        )
    with pytest.raises(InputError, match=r"2 tables.*; slow \(temperature_c\).*two.tdms#fast"):
        read_table(path)
    with pytest.raises(InputError, match="no group quick; allowed: one of fast, slow"):
        read_table(Path(f"{path}#quick"))
    assert read_table(Path(f"{path}#fast")).numbers("standard_nm").tolist() == [1.1, 2.1, 3.1]


def test_the_time_of_a_waveform_is_its_step(tmp_path: Path) -> None:
    properties = {"wf_start_offset": 1.0, "wf_increment": 0.25, "unit_string": "Nm"}
    with TdmsWriter(tmp_path / "wave.tdms") as writer:
        writer.write_segment([ChannelObject("g", "reading", np.array([1.0, 2.0, 3.0]), properties)])
    table = read_table(tmp_path / "wave.tdms")
    assert table.names == ("time_s", "reading [Nm]")
    assert table.numbers("time_s").tolist() == [1.0, 1.25, 1.5]


def test_channels_of_other_lengths_are_another_table(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["reading_nm"] = [1.0, 2.0]
        file["marks"] = [1.0, 2.0, 3.0]
    with pytest.raises(InputError, match=r"/ 2 \(reading_nm\)"):
        read_table(tmp_path / "a.h5")
    assert len(read_table(f"{tmp_path / 'a.h5'}#/ 2")) == 2


def test_data_sets_of_records_and_of_matlab_are_tables(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "records.h5", "w") as file:
        kinds = [("reading_nm", ">f4"), ("series", "i8")]
        file["table"] = np.array([(1.5, 1), (2.5, 2)], dtype=kinds)
    with h5py.File(tmp_path / "matlab.h5", "w") as file:
        file["reading_nm"] = np.array([[1.5, 2.5]])
        file["series"] = np.array([[1], [2]])
    for name in ("records.h5", "matlab.h5"):
        table = read_table(tmp_path / name)
        assert table.numbers("reading_nm").tolist() == [1.5, 2.5]
        assert table.texts("series") == ["1", "2"]


@pytest.mark.parametrize(
    ("row", "message"),
    [
        (["5,1", 5.0], None),
        ([None, 5.0], "row 4, column reading_nm: an empty cell"),
        (["=1/0", 5.0], "row 4, column reading_nm"),
    ],
)
def test_cells_of_a_sheet(tmp_path: Path, row: list[Any], message: str | None) -> None:
    book = openpyxl.Workbook()
    book.active.append(["reading_nm", "standard_nm"])
    for cells in ([0.0, 0.0], ["10,1", 10.0], row):
        book.active.append(cells)
    book.save(tmp_path / "a.xlsx")
    if message is None:
        assert read_calibration(tmp_path / "a.xlsx").reading_nm.tolist() == [0.0, 10.1, 5.1]
    else:
        with pytest.raises(InputError, match=message):
            read_calibration(tmp_path / "a.xlsx")


def write_errors_excel(path: Path, rows: list[list[Any]]) -> None:
    book = openpyxl.Workbook()
    book.active.title = "Notes"
    book.active.append(["#REF!"])
    sheet = book.create_sheet("Points")
    for cells in rows:
        sheet.append(cells)
    book.save(path)


def write_errors_ods(path: Path, rows: list[list[Any]]) -> None:
    """Write the document as LibreOffice 7.4 writes it: errors are empty texts that are shown."""

    def cell(value: Any) -> str:
        if isinstance(value, float):
            kind = f'office:value-type="float" office:value="{value}"'
        elif value.startswith("#"):
            kind = 'office:value-type="string" office:string-value="" calcext:value-type="error"'
        else:
            kind = 'office:value-type="string"'
        return f"<table:table-cell {kind}><text:p>{value}</text:p></table:table-cell>"

    def table(name: str, rows: list[list[Any]]) -> str:
        lines = "".join(
            f"<table:table-row>{''.join(map(cell, row))}</table:table-row>" for row in rows
        )
        return f'<table:table table:name="{name}">{lines}</table:table>'

    spaces = " ".join(
        f'xmlns:{name}="{uri}"'
        for name, uri in (
            ("office", "urn:oasis:names:tc:opendocument:xmlns:office:1.0"),
            ("table", "urn:oasis:names:tc:opendocument:xmlns:table:1.0"),
            ("text", "urn:oasis:names:tc:opendocument:xmlns:text:1.0"),
            ("calcext", "urn:org:documentfoundation:names:experimental:calc:xmlns:calcext:1.0"),
        )
    )
    content = (
        f"<office:document-content {spaces}><office:body><office:spreadsheet>"
        f"{table('Notes', [['#REF!']])}{table('Points', rows)}"
        "</office:spreadsheet></office:body></office:document-content>"
    )
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
        file.writestr("META-INF/manifest.xml", "<manifest/>")
        file.writestr("content.xml", content)


@pytest.mark.parametrize("write", [write_errors_excel, write_errors_ods])
@pytest.mark.parametrize(
    ("wrong", "error"),
    [(3, "#DIV/0!"), nightly(4, "#N/A"), nightly(5, "#REF!"), nightly(4, "#NAME?")],
)
def test_an_error_of_a_cell_is_named_with_its_place(
    tmp_path: Path, write: Callable[[Path, list[list[Any]]], None], wrong: int, error: str
) -> None:
    rows: list[list[Any]] = [["reading_nm", "note", "standard_nm"]]
    rows += [[10.1 * n, "as found", 10.0 * n] for n in range(4)]
    rows[wrong - 1][0] = error
    ending = "xlsx" if write is write_errors_excel else "ods"
    path = tmp_path / f"a.{ending}"
    write(path, rows)
    place = re.escape(f"a.{ending}#Points, row {wrong}, column reading_nm: '{error}'")
    named = Path(f"{path}#Points")
    with pytest.raises(InputError, match=f"{place}.*a spreadsheet's error.*correct its formula"):
        read_calibration(named)
    with pytest.raises(InputError, match=f"{place}.*a spreadsheet's error"):
        read_readings(named)


def test_a_last_row_of_errors_is_not_dropped(tmp_path: Path) -> None:
    write_errors_excel(
        tmp_path / "a.xlsx",
        [["reading_nm", "standard_nm"], [0.0, 0.0], [10.1, 10.0], ["#N/A", "#N/A"]],
    )
    with pytest.raises(InputError, match="row 4, column reading_nm: '#N/A'"):
        read_calibration(tmp_path / "a.xlsx#Points")


def test_an_error_in_a_column_that_is_not_used_does_not_matter(tmp_path: Path) -> None:
    rows = [["reading_nm", "standard_nm", "ratio"], [0.0, 0.0, "#DIV/0!"], [10.1, 10.0, 1.01]]
    write_errors_ods(tmp_path / "a.ods", rows)
    data = read_calibration(tmp_path / "a.ods#Points")
    assert data.reading_nm.tolist() == [0.0, 10.1]


def test_a_name_and_a_property_that_state_different_units(tmp_path: Path) -> None:
    write_tdms(tmp_path / "a.tdms", {"reading_nm": ("kN·m", [1.0, 2.0])})
    with pytest.raises(InputError, match="channel reading_nm is in kN·m by its properties"):
        read_table(tmp_path / "a.tdms")


@pytest.mark.parametrize(
    ("ending", "package", "extra"),
    [
        ("xlsx", "python_calamine", "excel"),
        ("tdms", "nptdms", "tdms"),
        ("mf4", "asammdf", "mdf4"),
        ("h5", "h5py", "hdf5"),
    ],
)
def test_a_missing_package_is_named_with_its_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str, package: str, extra: str
) -> None:
    WRITERS[ending](tmp_path / f"a.{ending}", CALIBRATION)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(InputError, match=rf"torquebench\[{extra}\].*torquebench\[tables\]"):
        read_table(tmp_path / f"a.{ending}")


@pytest.mark.parametrize("ending", ["xlsx", "tdms", nightly("mf4"), "h5", "parquet", "jsonl"])
def test_what_is_no_such_file(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"a.{ending}"
    with pytest.raises(InputError, match=f"can't read .*a.{ending}: No such file"):
        read_table(path)
    path.write_text("reading_nm,standard_nm\n1,1\n")
    with pytest.raises(InputError, match=f"a.{ending}"):
        read_table(path)


def test_a_mark_in_the_name_of_a_csv_file_is_part_of_it(tmp_path: Path) -> None:
    (tmp_path / "bench #2.csv").write_text("reading_nm\n1\n")
    assert read_table(tmp_path / "bench #2.csv").numbers("reading_nm").tolist() == [1.0]


@pytest.mark.parametrize("ending", ["csv", "parquet", "arrow", "jsonl"])
def test_a_written_table_is_read_again_with_units_and_gaps(tmp_path: Path, ending: str) -> None:
    source, copy = tmp_path / "readings.parquet", tmp_path / f"torque.{ending}"
    write_parquet(source, {"reading_nm": ("N·m", [1.5, -2.0]), "Drehmoment": ("kN·m", [0.1, 0.2])})

    def compensate(readings: Any) -> tuple[Any, ...]:
        value = readings.reading_nm
        return value, np.zeros(value.size), np.array([np.nan, 0.5])

    compensate_file(source, copy, compensate)
    table = read_table(copy)
    assert table.numbers("torque_nm").tolist() == [1.5, -2.0]
    assert any("Drehmoment" in name for name in table.names)
    with pytest.raises(InputError, match="expanded_uncertainty_nm"):  # its first cell is missing
        table.numbers("expanded_uncertainty_nm")


def test_json_lines_of_other_programs_have_rows_only(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    path.write_text('{"reading_nm": 1.5, "Prüfer": "Ana"}\n{"reading_nm": 2}\n', encoding="utf-8")
    table = read_table(path)
    assert table.numbers("reading_nm").tolist() == [1.5, 2.0]
    assert table.texts("Prüfer") == ["Ana", ""]
    for wrong in ('{"reading_nm": 1.5}\n{"reading_nm": "x', "[1.5]\n", '{"reading_nm": {"a": 1}}'):
        path.write_text(wrong, encoding="utf-8")
        with pytest.raises(InputError, match=r"a\.jsonl"):
            read_table(path).numbers("reading_nm")
