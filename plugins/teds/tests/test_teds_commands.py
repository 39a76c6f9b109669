"""Data sheets by command: shown, edited, and written with a compensation as calibration curve."""

import json
import re
from pathlib import Path

import pytest
from tests.system.command_line import run
from tests.system.test_json_answers import checked

from torquebench_teds import decode, encode, read_file, sheet_from_json, write_memory

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "plugins" / "teds" / "docs" / "use-teds.md"
CALIBRATION = ROOT / "examples" / "calibration-output.csv"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The documentation's sheet, and a model."""
    path = tmp_path_factory.mktemp("teds")
    page = PAGE.read_text("utf-8")
    (found,) = re.findall(r"```json\n(.*?)```", page, re.DOTALL)
    (path / "sheet.json").write_text(found, "utf-8")
    fitted = run("fit", CALIBRATION, "--range", "2000", "--out", "model.json", cwd=path)
    assert fitted.returncode == 0, fitted.stderr
    return path


def test_a_compensation_is_written_with_its_residual(folder: Path) -> None:
    command = ("teds", "write", "sheet.json", "--model", "model.json", "--out", "curve.hex")
    written = run(*command, "--segments", "2", cwd=folder)
    assert written.returncode == 0, written.stderr
    assert re.search(r"at most [\d.e+-]+ N·m \([\d.e+-]+ % FS\)", written.stdout)
    answer = checked(command, run(*command, "--segments", "2", "--json", cwd=folder).stdout)
    one = checked(command, run(*command, "--segments", "1", "--json", cwd=folder).stdout)
    assert answer["curve"]["residual_nm"] < one["curve"]["residual_nm"]
    small = (*command, "--memory", "DS2431")  # 124 bytes, of which the sheet takes 57
    chosen = checked(command, run(*small, "--json", cwd=folder).stdout)
    assert chosen["bytes"] <= 124
    assert chosen["curve"]["residual_nm"] <= one["curve"]["residual_nm"]
    assert one["curve"]["residual_percent_fs"] == pytest.approx(one["curve"]["residual_nm"] / 20.0)
    shown = run("teds", "show", "curve.hex", cwd=folder)
    assert "template 41: calibration curve" in shown.stdout
    assert "hall 3" in shown.stdout


def test_a_sheet_is_read_edited_and_written(folder: Path) -> None:
    data = encode(sheet_from_json(json.loads((folder / "sheet.json").read_text("utf-8"))))
    (folder / "memory.bin").write_bytes(write_memory(data, 128))
    command = ("teds", "read", "memory.bin", "--out", "edited.json")
    answer = checked(command, run(*command, "--json", cwd=folder).stdout)
    assert answer["sheet"]["basic"]["serial"] == 123456
    content = json.loads((folder / "edited.json").read_text("utf-8"))
    content["basic"]["serial"] = 77
    (folder / "edited.json").write_text(json.dumps(content), "utf-8")
    done = run("teds", "write", "edited.json", "--out", "new.bin", "--memory", "DS2431", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert (folder / "new.bin").stat().st_size == 128
    sheet = decode(read_file(folder / "new.bin"))
    assert sheet.basic["serial"] == 77
    assert checked(("teds", "show"), run("teds", "show", "new.bin", "--json", cwd=folder).stdout)


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (("show", "missing.hex"), "missing.hex"),
        (("show", "model.json"), "a sheet with"),
        (("read", "sheet.json", "--out", "sheet.json"), "both input and output"),
        (("write", "model.json", "--out", "refused.hex"), "no sheet"),
        (("write", "sheet.json", "--out", "refused.hex", "--memory", "DS2430A"), "32"),
    ],
)
def test_what_is_no_sheet_is_refused(folder: Path, command: tuple[str, ...], said: str) -> None:
    result = run("teds", *command, cwd=folder)
    assert result.returncode == 2
    assert said in result.stderr or "no sheet" in result.stderr
    assert "do " in result.stderr or "allowed" in result.stderr
    assert not (folder / "refused.hex").exists()
