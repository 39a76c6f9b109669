"""The command answers at once and says what it can do within 80 columns."""

import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest
from tests.system.command_line import run, widest_line

import torquebench

COMMANDS = (
    "demo",
    "calibrate",
    "fit",
    "apply",
    "export",
    "budget",
    "verify",
    "measure",
    "doctor",
    "records",
)


def test_version(tmp_path: Path) -> None:
    result = run("--version", cwd=tmp_path)
    assert (result.returncode, result.stdout.strip()) == (
        0,
        f"torquebench {torquebench.__version__}",
    )


def test_the_package_runs_as_a_module() -> None:
    command = [sys.executable, "-m", "torquebench", "--version"]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    assert result.stdout.strip() == f"torquebench {torquebench.__version__}"


def test_help_names_every_command(tmp_path: Path) -> None:
    result = run("--help", cwd=tmp_path)
    assert result.returncode == 0
    for name in COMMANDS:
        assert name in result.stdout


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys, torquebench.cli; "
        "print(sorted({'numpy', 'scipy', 'sklearn', 'bluesky', 'numba', 'matplotlib', 'sqlalchemy'}"
        " & set(sys.modules)))"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == "[]"


@pytest.mark.parametrize("name", COMMANDS)
def test_help_of_a_command_fits_80_columns(name: str, tmp_path: Path) -> None:
    result = run(name, "--help", cwd=tmp_path)
    assert result.returncode == 0
    assert widest_line(result.stdout) <= 80


def test_help_flows_and_shows_what_stands_in_brackets(tmp_path: Path) -> None:
    said = run("evaluate", "hysteresis", "--help", cwd=tmp_path).stdout
    assert "NAME=Header[unit]" in said
    paragraph = said[said.index("Columns:") : said.index("locked, load at the output")]
    lines = [line.strip() for line in paragraph.splitlines()]
    # A line ends where the next word has no place, not where it does in the code.
    for line, following in pairwise(lines):
        assert len(line) + 1 + len(following.split()[0]) > 76


def test_an_unknown_option_is_bad_input(tmp_path: Path) -> None:
    result = run("demo", "--nonsense", cwd=tmp_path)
    assert result.returncode == 2
    assert "--nonsense" in result.stderr
