"""A bench whose modules have no encoders: everything at rest works, all that turns is refused."""

import json
import re
from pathlib import Path

import pytest
from tests.system.command_line import patient_bench, run

ERROR = "has no encoder"


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    file = patient_bench(tmp_path)
    text = file.read_text(encoding="utf-8")
    without = re.sub(r"^\[(input|output)\.encoder\]\n(?:[^\[\n].*\n|\n)*", "", text, flags=re.M)
    assert without.count("encoder") < text.count("encoder")
    assert ".encoder]" not in without
    file.write_text(without, encoding="utf-8")
    return file


def options(bench: Path) -> list[object]:
    return ["--bench", bench, "--data", bench.parent / "data"]


def test_a_module_is_calibrated_and_checked_at_rest(bench: Path) -> None:
    quick = ("--step", "25", "--repeats", "1", "--yes")
    done = run("calibrate", "input", *quick, *options(bench), cwd=bench.parent)
    assert done.returncode == 0, done.stderr
    done = run("check", "input", "--yes", "--json", *options(bench), cwd=bench.parent)
    assert done.returncode == 0, done.stdout + done.stderr
    done = run("doctor", "--json", *options(bench), cwd=bench.parent)
    findings = json.loads(done.stdout)
    assert "loaded at rest only" in json.dumps(findings)
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize(
    "command",
    [
        ("test", "no-load", "--reducer", "standard", "--yes"),
        ("test", "hysteresis", "--reducer", "standard", "--yes"),
        ("turn", "input", "--yes", "--out", "empty.csv"),
    ],
    ids=lambda words: words[1],
)
def test_what_turns_is_refused_before_anything_moves(bench: Path, command: tuple[str, ...]) -> None:
    done = run(*command, *options(bench), cwd=bench.parent)
    assert done.returncode == 2, done.stdout
    assert ERROR in done.stderr
    assert "[input.encoder]" in done.stderr
