"""Columns by the names and units that laboratories give them."""

from pathlib import Path

import pyarrow as pa
import pytest

from torquebench.calibration import CalibrationData
from torquebench.errors import InputError
from torquebench.tables import (
    ReadingsTable,
    TableColumns,
    read_calibration,
    read_readings,
    table_of_arrow,
)


def read(folder: Path, content: str, *mapping: str, encoding: str = "utf-8") -> CalibrationData:
    (folder / "a.csv").write_bytes(content.encode(encoding))
    return read_calibration(folder / "a.csv", mapping=mapping)


@pytest.mark.parametrize(
    ("header", "encoding"),
    [
        ("Anzeige [N·m];Referenz [N·m];Reihe;Ast", "utf-8"),
        ("Anzeige [Nm];Normal [Nm];Messreihe;Ast", "cp1252"),
        ("Anzeige / Nm;Sollwert / Nm;Referenz in Nm;Reihe;Ast", "utf-8"),
        ("示值 [N·m];标准值 [N·m];序列;行程", "gbk"),
        ("示值(Nm);标准扭矩(Nm);系列;行程", "utf-16"),
        ("Indication [Nm];Reference [Nm];series;branch", "utf-8"),
        ("Prüfling [Nm];Bezugswert [Nm];Reihe;Auf/Ab", "utf-8-sig"),
        ("DUT (N·m);Standard torque (N·m);Series;Load direction", "utf-8"),
        ("测量扭矩[Nm];标准转矩[Nm];系列;加载方向", "gb18030"),
        ("Anzeige [N·m];Bezug [N·m];Reihe;Richtung", "utf-16-le"),
        ("示值(N·m);标准值(N·m);序列;方向", "utf-16-be"),
    ],
)
def test_common_names_are_understood(tmp_path: Path, header: str, encoding: str) -> None:
    extra = "10;" if "Sollwert" in header else ""
    rows = f"10,1;{extra}10,0;1;auf\n5,2;{extra}5,0;1;ab\n"
    data = read(tmp_path, f"{header}\n{rows}", encoding=encoding)
    assert data.reading_nm.tolist() == [10.1, 5.2]
    assert data.standard_nm.tolist() == [10.0, 5.0]
    assert data.series.tolist() == [1, 1]
    assert data.branch.tolist() == [1, -1]


@pytest.mark.parametrize(
    ("header", "up", "down"),
    [
        ("Richtung", "auf", "ab"),
        ("Direction", "increasing", "decreasing"),
        ("方向", "加载", "卸载"),
        ("direction", "Ascending", "DESCENDING"),
        ("Richtung", "aufsteigend", "absteigend"),
        ("加载方向", "正行程", "反行程"),
        ("方向", "上升", "下降"),
    ],
)
def test_a_direction_of_loading_is_a_branch(
    tmp_path: Path, header: str, up: str, down: str
) -> None:
    table = f"reading_nm;standard_nm;{header}\n10,1;10;{up}\n5,2;5;{down}\n"
    assert read(tmp_path, table).branch.tolist() == [1, -1]
    (tmp_path / "r.csv").write_text(f"reading_nm;{header}\n10,1;{up}\n5,2;{down}\n")
    branch = read_readings(tmp_path / "r.csv").branch
    assert branch is not None
    assert branch.tolist() == [1, -1]


def test_a_direction_of_loading_in_a_frame() -> None:
    frame = pa.table({"reading_nm": [10.1, 5.2], "Richtung": ["auf", "ab"]})
    table = table_of_arrow(frame, "a frame")
    branch = ReadingsTable.of(table, TableColumns(table, ("reading_nm",))).branch
    assert branch is not None
    assert branch.tolist() == [1, -1]


def test_a_direction_of_torque_stays_one(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="minus sign"):
        read(tmp_path, "reading_nm;standard_nm;Richtung\n10,1;10;links\n")


def test_the_line_by_which_spreadsheets_name_the_separator_is_passed_over(tmp_path: Path) -> None:
    assert len(read(tmp_path, "sep=;\nreading_nm;standard_nm\n10,1;10\n5,2;5\n")) == 2


def test_a_header_of_something_else_is_suggested(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"standard=Sollwert\[Nm\]"):
        read(tmp_path, "Anzeige [Nm];Sollwert [Nm]\n10,1;10\n")


@pytest.mark.parametrize("number", ["1’200", "1\u202f200,5", "1'200.5", "1.200,5"])
def test_thousands_are_named(tmp_path: Path, number: str) -> None:
    with pytest.raises(InputError, match="no thousands separators"):
        read(tmp_path, f"reading_nm;standard_nm\n{number};10\n")


def test_a_mark_between_thousands_is_no_decimal_mark(tmp_path: Path) -> None:
    """A spreadsheet's 980, 1,200: read as 1.2 it would be wrong without a word."""
    table = "reading_nm;standard_nm\n505;500\n981;980\n{};1200\n"
    for number in ("1,201", "-1.201"):
        with pytest.raises(InputError, match=r"line 4, column reading_nm: .* in a column with 981"):
            read(tmp_path, table.format(number))
    assert read(tmp_path, table.format("1201,5")).reading_nm[-1] == 1201.5
    fine = "reading_nm;standard_nm\n505;500\n981,234;980\n"
    assert read(tmp_path, fine).reading_nm[-1] == 981.234


def test_zeros_of_both_directions_are_no_repetition(tmp_path: Path) -> None:
    rows = "0;0;auf\n10,1;10;auf\n0;0;ab\n0;0;auf\n-10,1;-10;auf\n0;0;ab\n"
    assert len(read(tmp_path, f"reading_nm;standard_nm;Richtung\n{rows}")) == 6


def test_columns_named_by_the_user(tmp_path: Path) -> None:
    data = read(
        tmp_path,
        "Kanal 1;Kanal 2;Lauf\n-0,0101;10;3\n-0,0052;5;3\n",
        *("reading=-Kanal 1[kNm]", "standard=KANAL 2[N·m]", "series=Lauf"),
    )
    assert data.reading_nm.tolist() == pytest.approx([10.1, 5.2])
    assert data.standard_nm.tolist() == [10.0, 5.0]
    assert data.series.tolist() == [3, 3]


def test_readings_too(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("Anzeige [kNm],Ast\n0.01,ab\n")
    readings = read_readings(tmp_path / "a.csv")
    assert readings.reading_nm.tolist() == [10.0]
    assert readings.branch is not None
    assert readings.branch.tolist() == [-1]


@pytest.mark.parametrize(
    ("header", "mapping", "message"),
    [
        ("a,b", ["reading"], "--column reading; allowed: NAME=Header"),
        ("a,b", ["torque=a[Nm]"], "NAME one of reading, standard"),
        ("a,b", ["reading=c[Nm]"], "has no column c; allowed: one of a, b"),
        ("a,b", ["reading=a"], "names no unit.*as in --column 'reading=a"),
        ("a,b", ["reading=a[V]"], "column a is an electrical signal in V.*--sensitivity"),
        ("a,b", ["reading=a[foo]"], "the unit foo in reading=a"),
        ("a,b", ["reading=a[Nm]", "reading=b[Nm]"], "two columns for reading_nm"),
        ("Drehmoment,b", [], "--column 'reading=Drehmoment\\[Nm\\]'"),
        ("T [kN·m],Ref [kN·m]", [], "it has T .*--column 'reading=T\\[kN·m\\]'"),
        ("扭矩 [Nm],b", [], "--column 'reading=扭矩\\[Nm\\]'"),
        ("Anzeige,Referenz", [], "--column 'reading=Anzeige\\[Nm\\]'"),
    ],
)
def test_what_is_missing_is_suggested(
    tmp_path: Path, header: str, mapping: list[str], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        read(tmp_path, f"{header}\n1,1\n2,2\n", *mapping)
