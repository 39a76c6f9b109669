"""Columns by the names and units that laboratories give them."""

from pathlib import Path

import pytest

from torquebench.calibration import CalibrationData
from torquebench.errors import InputError
from torquebench.records import read_calibration_csv, read_readings_csv


def read(folder: Path, content: str, *mapping: str, encoding: str = "utf-8") -> CalibrationData:
    (folder / "a.csv").write_bytes(content.encode(encoding))
    return read_calibration_csv(folder / "a.csv", mapping=mapping)


@pytest.mark.parametrize(
    ("header", "encoding"),
    [
        ("Anzeige [N·m];Referenz [N·m];Reihe;Ast", "utf-8"),
        ("Anzeige [Nm];Normal [Nm];Messreihe;Ast", "cp1252"),
        ("Anzeige / Nm;Sollwert / Nm;Referenz in Nm;Reihe;Ast", "utf-8"),
        ("示值 [N·m];标准值 [N·m];序列;行程", "gbk"),
        ("示值(Nm);标准扭矩(Nm);系列;行程", "utf-16"),
        ("Indication [Nm];Reference [Nm];series;branch", "utf-8"),
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
    readings = read_readings_csv(tmp_path / "a.csv")
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
        ("a,b", ["reading=a[V]"], "the unit v in reading=a"),
        ("a,b", ["reading=a[Nm]", "reading=b[Nm]"], "two columns for reading_nm"),
        ("Drehmoment,b", [], "--column 'reading=drehmoment\\[Nm\\]'"),
        ("扭矩 [Nm],b", [], "--column 'reading=扭矩\\[Nm\\]'"),
        ("Anzeige,Referenz", [], "--column 'reading=anzeige\\[Nm\\]'"),
    ],
)
def test_what_is_missing_is_suggested(
    tmp_path: Path, header: str, mapping: list[str], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        read(tmp_path, f"{header}\n1,1\n2,2\n", *mapping)
