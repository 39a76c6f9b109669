"""Calibrated alone against in place, as a user sees it."""

import re
from pathlib import Path

from tests.system.command_line import run


def test_the_chain_is_seen_in_place_only(tmp_path: Path) -> None:
    result = run("in-place", "output", "--quick", "--report", "r.html", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "- simulated" in result.stdout
    row = re.search(r"(?m)^Simulated reducer bench: output (.+)$", result.stdout)
    assert row
    _raw, alone, in_place, _rising = map(float, row[1].split())
    assert in_place < 0.2 * alone
    assert alone > 0.2
    assert "<svg" in (tmp_path / "r.html").read_text()


def test_a_table_of_another_kind_is_refused(tmp_path: Path) -> None:
    (tmp_path / "alone.csv").write_text("a,b\n1,2\n")
    result = run("in-place", "output", "--alone", "alone.csv", cwd=tmp_path)
    assert result.returncode == 2
    assert "alone.csv" in result.stderr
