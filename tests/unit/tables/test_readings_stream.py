"""Files of readings compensated block by block: the same numbers, wherever blocks end."""

import io
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.watching import Watching

from torquebench.errors import InputError
from torquebench.tables import ReadingsTable, compensate_file, compensating
from torquebench.tables.formats import text as text_format


@pytest.fixture(autouse=True, params=[64, 1 << 23])
def _blocks(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a block end within nearly every line, and never."""
    monkeypatch.setattr(text_format, "BLOCK_BYTES", request.param)
    monkeypatch.setattr(compensating, "_BLOCK_ROWS", request.param)


def compensate(table: ReadingsTable) -> tuple[np.ndarray, ...]:
    for row in np.flatnonzero(np.abs(table.reading_nm) > 100.0):
        reading = f"{table.reading_nm[row]:g} N·m"
        raise InputError(f"{table.place(int(row))}: {reading} is outside the calibrated range")
    branch = np.zeros(len(table)) if table.branch is None else table.branch
    return table.reading_nm + branch, branch * 1.0, 0.5 + 0.0 * branch


def result(folder: Path, content: str, encoding: str = "utf-8", name: str = "torque.csv") -> str:
    (folder / "readings.csv").write_bytes(content.encode(encoding))
    compensate_file(folder / "readings.csv", folder / name, compensate)
    return (folder / name).read_text(encoding="utf-8")


ADDED = "torque_nm,additional_torque_nm,expanded_uncertainty_nm"


def test_columns_come_first_as_they_are_and_three_are_added(tmp_path: Path) -> None:
    rows = "".join(f"{n},{n % 90}.50,{'up' if n % 2 else 'down'}\n" for n in range(300))
    text = result(tmp_path, f"# simulated = true\nn,reading_nm,branch\n{rows}")
    head, header, *lines = text.splitlines()
    assert head == "# simulated = true"
    assert header == f"n,reading_nm,branch,{ADDED}"
    assert lines == [
        f"{n},{n % 90}.50,{'up' if n % 2 else 'down'},"
        f"{n % 90 + 0.5 + (1 if n % 2 else -1):g},{1 if n % 2 else -1},0.5"
        for n in range(300)
    ]


def test_summary_and_progress(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("reading_nm,branch\n1,up\n2,down\n" * 1 + "3,up\n" * 200)
    watching = Watching()
    done = compensate_file(tmp_path / "a.csv", tmp_path / "b.csv", compensate, progress=watching)
    assert (done.rows, done.lowest_nm, done.highest_nm) == (202, -1.0, 1.0)
    assert done.largest_uncertainty_nm == 0.5
    assert not done.simulated
    assert watching.stages == [(f"Compensating {tmp_path / 'a.csv'}", 100)]
    assert watching.done == sorted(watching.done)
    assert watching.done[-1] == 100


@pytest.mark.parametrize("name", ["a.csv", "a.parquet"])
def test_memory_holds_a_block_and_never_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr(text_format, "BLOCK_BYTES", 1 << 12)
    monkeypatch.setattr(compensating, "_BLOCK_ROWS", 1 << 10)
    (tmp_path / "a.csv").write_text("reading_nm\n" + "1.5\n" * 20_000)
    pq.write_table(pa.table({"reading_nm": [1.5] * 20_000}), tmp_path / "a.parquet")
    sizes = []

    def counted(table: ReadingsTable) -> tuple[np.ndarray, ...]:
        sizes.append(len(table))
        return compensate(table)

    compensate_file(tmp_path / name, tmp_path / f"torque{name[1:]}", counted)
    assert sum(sizes) >= 20_000
    assert max(sizes) <= 1 << 11


@pytest.mark.parametrize(
    "content",
    [
        'reading_nm,note\n1.5,"a, b"\n2.5,"line\none"\n3.5,"say ""x"""\n',
        "reading_nm\n1.5\n\n# between\n2.5\n\n",
        "reading_nm;note\n1,5;ä\n2,5;\n",
        "reading_nm\tnote\r\n1.5\tx\r\n2.5\t\r\n",
        "reading_nm\n1.5\n2.5",
        "reading_knm\n0.0015\n0.0025\n",
        "reading_nm\n+1.5\n \N{MINUS SIGN}2.5\n",
    ],
    ids=["quotes", "comments", "decimal comma", "tabs", "no last line end", "kN·m", "signs"],
)
def test_what_laboratories_write(tmp_path: Path, content: str) -> None:
    from torquebench.tables import read_readings

    text = result(tmp_path, content)
    before = read_readings(tmp_path / "readings.csv")
    after = read_readings(tmp_path / "torque.csv")
    assert after.reading_nm.tolist() == before.reading_nm.tolist()
    for name in before.table.names:
        assert after.table.texts(name) == before.table.texts(name)
    torque = [cell.replace(",", ".") for cell in after.table.texts("torque_nm")]
    assert [float(each) for each in torque] == before.reading_nm.tolist()
    assert text.endswith("\n")


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252"])
def test_encodings(tmp_path: Path, encoding: str) -> None:
    content = "reading_nm;prüfer\n" + "1,5;Müller\n" * 40
    assert "1,5;Müller;1,5;" in result(tmp_path, content, encoding)


def test_headers_stay_as_the_file_writes_them(tmp_path: Path) -> None:
    text = result(tmp_path, "Reading_Nm,Operator\n" + "1.5,Ana\n" * 40)
    assert text.startswith("Reading_Nm,Operator,torque_nm,")


def test_chinese(tmp_path: Path) -> None:
    text = result(tmp_path, "reading_nm,备注\n" + "1.5,加载\n" * 40, "gbk")
    assert "1.5,加载,1.5,0,0.5" in text


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("x", "line 203, column reading_nm: 'x'"),
        ("#DIV/0!", "line 203, column reading_nm: '#DIV/0!'"),
        ("nan", "line 203, column reading_nm: 'nan'"),
        ("101", "line 203, column reading_nm: 101 N·m is outside the calibrated range"),
        ("1,2", "line 203: 2 values in a table of 1"),
    ],
)
def test_a_mistake_is_named_with_its_line_and_nothing_is_written(
    tmp_path: Path, line: str, message: str
) -> None:
    content = "# note\nreading_nm\n" + "1.5\n" * 200 + line + "\n" + "2.5\n" * 50
    with pytest.raises(InputError, match=message):
        result(tmp_path, content)
    assert [path.name for path in tmp_path.iterdir()] == ["readings.csv"]


def test_mixed_decimal_marks_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="decimal commas and points mixed"):
        result(tmp_path, "reading_nm;n\n" + "1,5;1\n" * 100 + "1.5;1\n")


@pytest.mark.parametrize("content", ["", "# only\n", "reading_nm\n", "torque_nm\n1\n"])
def test_nothing_to_compensate_is_refused(tmp_path: Path, content: str) -> None:
    with pytest.raises(InputError):
        result(tmp_path, content)
    assert not (tmp_path / "torque.csv").exists()


def test_a_file_that_is_compensated_already_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has a column torque_nm already"):
        result(tmp_path, "reading_nm,torque_nm\n1.5,1.6\n")


def test_an_ending_of_no_format_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"torque\.xls; allowed: CSV .*Parquet"):
        result(tmp_path, "reading_nm\n1\n", name="torque.xls")


class TestParquet:
    def test_types_and_units_stay_and_columns_are_added(self, tmp_path: Path) -> None:
        field = pa.field("Reading_kNm", pa.float32(), metadata={"unit": "kN·m"})
        numbers = np.linspace(-0.09, 0.09, 300, dtype=np.float32)
        schema = pa.schema([field, ("branch", pa.int8()), ("note", pa.string())])
        columns = [pa.array(numbers), pa.array([1] * 300, pa.int8()), pa.array(["a"] * 300)]
        source = tmp_path / "readings.parquet"
        pq.write_table(pa.table(columns, schema=schema), source)
        compensate_file(source, tmp_path / "torque.parquet", compensate)
        table = pq.read_table(tmp_path / "torque.parquet")
        assert table.column_names == [*schema.names, *ADDED.split(",")]
        assert table.schema.field(0).type == pa.float32()
        assert table.schema.field(0).metadata[b"unit"] == "kN·m".encode()
        assert table["Reading_kNm"].to_numpy().tolist() == numbers.tolist()
        assert table["torque_nm"].to_numpy() == pytest.approx(1e3 * numbers + 1.0, rel=1e-6)

    def test_csv_becomes_numbers_and_text(self, tmp_path: Path) -> None:
        (tmp_path / "a.csv").write_text("reading_nm,branch\n" + "1.5,up\n" * 100)
        compensate_file(tmp_path / "a.csv", tmp_path / "b.parquet", compensate)
        table = pq.read_table(tmp_path / "b.parquet")
        assert table["reading_nm"].to_pylist() == [1.5] * 100
        assert table["branch"].to_pylist() == ["up"] * 100
        assert table["torque_nm"].to_pylist() == [2.5] * 100

    def test_only_values_that_repeat_get_a_dictionary(self, tmp_path: Path) -> None:
        """Looking for repeated torques took as long as writing them."""
        readings = np.linspace(-90.0, 90.0, 1000)
        columns = {"reading_nm": readings, "temperature_c": np.round(readings / 50.0)}
        pq.write_table(pa.table(columns), tmp_path / "a.parquet")
        compensate_file(tmp_path / "a.parquet", tmp_path / "b.parquet", compensate)
        group = pq.read_metadata(tmp_path / "b.parquet").row_group(0)
        written = {
            column.path_in_schema: column.has_dictionary_page
            for column in map(group.column, range(group.num_columns))
        }
        assert written == {
            "reading_nm": False,
            "temperature_c": True,
            "torque_nm": False,
            "additional_torque_nm": True,
            "expanded_uncertainty_nm": True,
        }

    def test_to_csv(self, tmp_path: Path) -> None:
        pq.write_table(pa.table({"reading_nm": [1.5], "note": ["a, b"]}), tmp_path / "a.parquet")
        compensate_file(tmp_path / "a.parquet", tmp_path / "b.csv", compensate)
        lines = (tmp_path / "b.csv").read_text().splitlines()
        assert lines == [f"reading_nm,note,{ADDED}", '1.5,"a, b",1.5,0,0.5']

    @pytest.mark.parametrize("bad", [None, float("nan"), 200.0])
    def test_a_mistake_is_named_with_its_row(self, tmp_path: Path, bad: float | None) -> None:
        pq.write_table(pa.table({"reading_nm": [1.5] * 99 + [bad]}), tmp_path / "a.parquet")
        with pytest.raises(InputError, match="row 100, column reading_nm"):
            compensate_file(tmp_path / "a.parquet", tmp_path / "b.csv", compensate)
        assert not (tmp_path / "b.csv").exists()

    def test_a_file_that_is_none_is_refused(self, tmp_path: Path) -> None:
        (tmp_path / "a.parquet").write_text("reading_nm\n1\n")
        with pytest.raises(InputError, match="can't read"):
            compensate_file(tmp_path / "a.parquet", tmp_path / "b.csv", compensate)


def test_standard_input_and_output(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"reading_nm\n1.5\n")))
    compensate_file(Path("-"), Path("-"), compensate)
    assert capfdbinary.readouterr().out.decode() == f"reading_nm,{ADDED}\n1.5,1.5,0,0.5\n"
