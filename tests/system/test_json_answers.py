"""Commands print the JSON that the types of their results and the documentation promise."""

import json
import shutil
from pathlib import Path
from typing import Any

import jsonschema  # type: ignore[import-untyped]
import pytest
from tests.support.draws import some
from tests.system.command_line import run

from torquebench.cli import whole_command
from torquebench.cli.measure import MeasuredInterval
from torquebench.cli.output_options import RESULTS
from torquebench.operations import OPERATIONS, Preview, json_schemas

EXAMPLES = Path(__file__).parents[2] / "examples"
CALIBRATION = EXAMPLES / "calibration-output.csv"
VERIFICATION = EXAMPLES / "verification-output.csv"
LOOPS = EXAMPLES / "loops-rv-40e.csv"
READINGS = EXAMPLES / "readings-output.csv"


whole_command()  # fills the types of results


def named(arguments: tuple[object, ...]) -> str:
    words = [str(each) for each in arguments]
    known = {*RESULTS, *OPERATIONS}
    return next(" ".join(words[:k]) for k in (1, 2) if " ".join(words[:k]) in known)


def misfits(value: Any, kind: Any) -> list[str]:
    """Return where a value differs from the schema of its type."""
    schema, parts = json_schemas([kind])
    whole = {**schema[kind], "components": {"schemas": parts}}
    validator = jsonschema.Draft202012Validator(whole)
    unknown = value.keys() - parts[kind.__name__]["properties"].keys()
    return [*(f"{name}: not declared" for name in unknown), *map(str, validator.iter_errors(value))]


def checked(arguments: tuple[object, ...], text: str) -> dict[str, Any]:
    """Return the answer in what a command printed, held against its declaration."""
    written = json.loads(text)
    name = named(arguments)
    assert written["command"] == name
    assert written["error"] is None
    kind = RESULTS.get(name) or OPERATIONS[name].result
    assert misfits(written["answer"], Preview if "--dry-run" in arguments else kind) == []
    answer: dict[str, Any] = written["answer"]
    return answer


def in_records(folder: Path, arguments: tuple[object, ...]) -> tuple[object, ...]:
    tables = ("fit", "apply", "verify", "export", "budget", "mechanics", "evaluate")
    return () if arguments[0] in tables else ("--data", folder / "data")


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two calibrations of the output module, a check, and a fitted table."""
    folder = tmp_path_factory.mktemp("answers")
    for arguments in (
        ("calibrate", "output", "--step", "25", "--json"),
        ("calibrate", "output", "--step", "25", "--json"),
        ("check", "output", "--json"),
        ("fit", CALIBRATION, "--range", "2000", "--json"),
    ):
        done = run(*arguments, *in_records(folder, arguments), cwd=folder)
        assert done.returncode == 0, done.stderr
        checked(arguments, done.stdout)
    policy = folder / "data" / "laboratory.toml"
    policy.write_text('[policy]\nunreviewed = "state"\n', encoding="utf-8")
    return folder


@pytest.fixture
def records(measured: Path, tmp_path: Path) -> Path:
    """A copy for one test alone: what another test has done to the records isn't in it."""
    return shutil.copytree(measured, tmp_path / "records")


@pytest.mark.parametrize(
    "arguments",
    some([
        ("calibrate", "both", "--dry-run"),
        ("records", "backup", "backup"),
        ("records", "restore", "backup"),
        ("records", "rebuild"),
        ("records", "finish"),
        ("records", "compare", "calibration-1", "calibration-2"),
        ("turn", "output", "--out", "run.csv", "--dry-run"),
        ("test", "starting", "--dry-run"),
        ("verification", "output", "--groups", "2", "--points", "8"),
        ("test", "no-load", "--short"),
        ("certificate", "latest"),
        ("fit", CALIBRATION, "--range", "2000", "--out", "other.json"),
        ("apply", "model.json", READINGS, "--out", "torque.csv"),
        ("verify", "model.json", VERIFICATION),
        ("export", "model.json", "--out", "model.csv"),
        ("budget", "model.json", "--reading", "500", "--reading", "-20"),
        ("mechanics", "additional-torque"),
        ("mechanics", "sections"),
        ("records", "list"),
        ("records", "list", "runs"),
        ("records", "show", "latest"),
        ("records", "show", "model-1"),
        ("records", "show", "calibration-1"),
        ("records", "verify"),
        ("records", "audit", "latest"),
        ("records", "export", "latest", "--out", "exported"),
        ("records", "export-data", "latest", "--out", "samples.csv"),
        ("records", "review", "calibration-1", "--by", "Anna"),
        ("records", "amend", "calibration-1", "measured_by=Anna", "--by", "Ben", "--reason", "x"),
        ("records", "use", "model-1", "--by", "Anna", "--reason", "a trial"),
        ("records", "add-equipment", "calibrator", "C-7"),
        ("doctor",),
        ("evaluate", "hysteresis", LOOPS, "--reducer", "rv-40e"),
        ("evaluate", "static", CALIBRATION, "--range", "2000", "--resolution", "0.01",
         "--reference-uncertainty", "0.02 of torque"),
    ], by_day=8),  # test_interfaces compares the others' answers with those of the API
    ids=lambda arguments: " ".join(str(each) for each in arguments[:2]),
)  # fmt: skip
def test_answers_are_as_declared(records: Path, arguments: tuple[object, ...]) -> None:
    if arguments == ("records", "restore", "backup"):
        run("records", "backup", "backup", *in_records(records, arguments), cwd=records)
    done = run(*arguments, "--json", *in_records(records, arguments), cwd=records)
    assert done.returncode in (0, 1), done.stderr
    answer = checked(arguments, done.stdout)
    folders = (records, records / "data" / answer.get("folder", ""))
    for file in answer.get("files", ()):
        assert any((folder / file).exists() for folder in folders)


def test_measured_lines_come_one_by_one(records: Path) -> None:
    given = ("measure", "--count", "2", "--interval", "0.1", "--json")
    done = run(*given, *in_records(records, given), cwd=records)
    assert done.returncode == 0, done.stderr
    *lines, last = done.stdout.splitlines()
    printed = [json.loads(line)["line"] for line in lines]
    assert [misfits(line, MeasuredInterval) for line in printed] == [[], []]
    assert json.loads(lines[0])["line"]["output"]["state"] == "compensated"
    assert checked(("measure",), last)["lines"] == 2


def test_an_error_is_json_too(tmp_path: Path) -> None:
    done = run("verify", "no.json", "no.csv", "--json", cwd=tmp_path)
    assert done.returncode == 2
    written = json.loads(done.stdout)
    assert (written["exit_code"], bool(written["error"]["found"])) == (2, True)


def test_quiet_prints_nothing_where_all_is_well(records: Path) -> None:
    done = run("verify", "model.json", VERIFICATION, "--quiet", cwd=records)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
