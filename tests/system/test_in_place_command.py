"""Calibrated alone against in place, as a user sees it."""

import re
from pathlib import Path

from tests.system.command_line import run


def test_the_chain_is_seen_in_place_only(tmp_path: Path) -> None:
    result = run("in-place", "output", "--quick", "--report", "r.html", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "- simulated" in result.stdout
    found = {
        name: float(value)
        for name, value in re.findall(r"(?m)^(.+?)\s+(\d+\.\d+) *$", result.stdout)
    }
    assert found["in place"] < 0.2 * found["transducer alone"]
    assert found["transducer alone"] > 0.2
    assert "<svg" in (tmp_path / "r.html").read_text()
    assert not (tmp_path / "torquebench-data").exists()


def test_a_table_of_another_kind_is_refused(tmp_path: Path) -> None:
    (tmp_path / "alone.csv").write_text("a,b\n1,2\n")
    result = run("in-place", "output", "--alone", "alone.csv", cwd=tmp_path)
    assert result.returncode == 2
    assert "alone.csv" in result.stderr
