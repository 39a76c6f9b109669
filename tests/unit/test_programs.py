"""The programs of the tests are looked for before anything is installed."""

import os
import subprocess
import sys
from pathlib import Path

from tests import programs

ROOT = Path(__file__).parents[2]


def test_missing_programs_are_named_at_once_with_the_line_that_installs_them() -> None:
    done = subprocess.run(
        [sys.executable, "-I", ROOT / "tests" / "programs.py"],
        env={**os.environ, "PATH": "/nowhere"},  # without apt, as for an ordinary user
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == 2
    assert done.stdout == ""
    for name in ("git", "cc", "curl", "chromium", "chromedriver"):
        assert f"  {name} " in done.stderr
    *_, line = done.stderr.strip().splitlines()
    assert line.startswith("  sudo apt-get update && sudo apt-get install ")
    assert "gcc libc6-dev curl" in line


def test_a_program_can_be_wanted_alone() -> None:
    assert programs.missing(["cc"]) == []
    assert programs.program("no such program") is None


def test_the_tests_start_no_program_that_is_not_looked_for() -> None:
    makefile = (ROOT / "Makefile").read_text()
    assert "test: programs" in makefile
    assert (ROOT / ".ci" / "run").read_text().rstrip().endswith("\nmake test")
