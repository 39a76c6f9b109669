"""What diagnoses survives what it diagnoses: any value in any column, any content in any file."""

import contextlib
import shutil
import sqlite3
from pathlib import Path

import pytest
from sqlalchemy import Boolean
from tests.support.draws import nightly, some
from tests.unit.station.data_directories import filled_directory
from typer.testing import CliRunner

from torquebench.cli import app
from torquebench.records import Registry
from torquebench.records.registry import metadata
from torquebench.station.data_check import check_data_directory

DEEP = "[" * 100_000
HOSTILE = {
    "deep JSON": DEEP,
    "deep object": '{"a":' * 50_000,
    "invalid JSON": "{",
    "another type": '"text"',
    "list": "[1, 2]",
    "blob": b"\xff\xfe\x00\x01",
    "not UTF-8": "not UTF-8",
    "empty": "",
    "huge number": "9" * 400,
    "number": 1e300,
}


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = filled_directory(tmp_path_factory.mktemp("filled") / "data")
    with Registry.open(data) as registry:
        registry.review("calibrations", 1, checked_by="Ben")
        registry.amend("runs", 1, {"operator": "Anna"}, amended_by="Ben", reason="misspelt")
        registry.note_rebuilt(["run-1"], by="Ben", anew=False)
        registry.activate(1, operator="Ben", reason="checked")
    with contextlib.closing(sqlite3.connect(data / "registry.sqlite")) as connection:
        triggers = connection.execute("SELECT name FROM sqlite_master WHERE type = 'trigger'")
        for (name,) in triggers.fetchall():
            connection.execute(f"DROP TRIGGER {name}")
        connection.execute("PRAGMA journal_mode=DELETE")
    return data


@pytest.fixture
def data(filled: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(filled, tmp_path / "data"))


def set_value(data: Path, table: str, column: str, value: object) -> int:
    """Put a value into a column of the first row; return how many rows it changed."""
    with contextlib.closing(sqlite3.connect(data / "registry.sqlite")) as connection:
        connection.execute("PRAGMA foreign_keys=OFF")
        where = f"WHERE rowid = (SELECT min(rowid) FROM {table})"
        if value == "not UTF-8":
            change = f"UPDATE {table} SET \"{column}\" = CAST(x'fffe' AS TEXT) {where}"
            changed = connection.execute(change).rowcount
        else:
            same = connection.execute(f'SELECT "{column}" FROM {table} {where}').fetchone()
            if same is not None and same[0] == value:
                return 0
            change = f'UPDATE OR IGNORE {table} SET "{column}" = ? {where}'
            changed = connection.execute(change, (value,)).rowcount
        connection.commit()
    return changed


def listed(data: Path) -> tuple[str, int]:
    result = CliRunner().invoke(app, ["records", "list", "--data", str(data)])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.output, result.exit_code


LISTED = {"runs", "run_ends", "calibrations", "models", "activations", "equipment"}
"""Tables that `records list` reads."""


@pytest.mark.parametrize(
    "name", some(sorted(metadata.tables, key=lambda name: (name not in LISTED, name)), by_day=2)
)
def test_any_value_in_any_column_is_named_and_the_rest_is_compared(data: Path, name: str) -> None:
    file, table = data / "registry.sqlite", metadata.tables[name]
    untouched, whole = file.read_bytes(), check_data_directory(data, folders=False)
    values = list(HOSTILE.items())
    for number, column in enumerate(table.columns):
        if column.primary_key or isinstance(column.type, Boolean):  # reads as true or false
            continue
        what, value = values[number % len(values)]  # another one for each column
        file.write_bytes(untouched)
        if not set_value(data, name, column.name, value):
            continue  # without a row, or as it was
        report = check_data_directory(data, folders=False)
        assert set(report.findings) - set(whole.findings), (what, column)
        compared = report.records == whole.records
        assert compared or any(each.kind == "database" for each in report.findings), what
        if name in LISTED:
            output = listed(data)[0]
            # what can be read of the other lists is there
            lists = {"Runs", "Calibrations", "Models", "Equipment"}
            assert len([each for each in lists if each in output]) >= 3, (what, column, output)


@pytest.mark.parametrize(("table", "column"), [("runs", "operator"), ("calibrations", "summary")])
def test_a_missing_column_is_named_and_the_rest_is_compared(
    data: Path, table: str, column: str
) -> None:
    with contextlib.closing(sqlite3.connect(data / "registry.sqlite")) as connection:
        connection.execute(f"ALTER TABLE {table} DROP COLUMN {column}")
        connection.commit()
    (data / "runs" / "run-3" / "results.json").write_text("{}", encoding="utf-8")
    named = [str(each) for each in check_data_directory(data).findings]
    assert f"table {table}: differs from what was made" in named
    assert any(f"{table} 1, {column}: None instead of" in each for each in named), named
    assert any("run-3/results.json was added" in each for each in named), named
    output, code = listed(data)
    assert code == 1
    assert f"{table}.{column}" in " ".join(output.split())
    assert "DRIVE-1" in output  # the other lists are there


@pytest.mark.parametrize(
    "name", some(["run.json", "events.jsonl", "manifest.json", "results.json"], by_day=1)
)
@pytest.mark.parametrize("sealed", [True, nightly(False)])
def test_any_content_of_a_runs_file_is_named_and_the_rest_is_compared(
    data: Path, name: str, sealed: bool
) -> None:
    folder = data / "runs" / "run-2"
    if not sealed:
        (folder / "manifest.json").unlink()
    for value in HOSTILE.values():
        content = value if isinstance(value, bytes) else str(value).encode()
        (folder / name).write_bytes(content)
        changed = data / "models" / "run-2-polynomial.json"
        changed.write_text("changed", encoding="utf-8")
        named = [str(each) for each in check_data_directory(data).findings]
        assert any("run-2" in each and "polynomial" not in each for each in named), named
        assert any("polynomial.json: changed" in each for each in named)
        output, _ = listed(data)
        assert "run-1" in output
        assert "calibration-1" in output
