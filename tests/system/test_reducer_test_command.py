"""`torquebench test` on the simulated bench."""

import json

import pytest
from typer.testing import CliRunner

from torquebench.cli import app
from torquebench.errors import InputError


def run(*arguments: str) -> str:
    found = CliRunner().invoke(app, ["test", *arguments], catch_exceptions=False)
    assert found.exit_code == 0, found.output
    return found.output


def test_a_full_test_is_rehearsed_without_leaving_anything(tmp_path):
    said = run("full", "--reducer", "rv-40e", "--dry-run", "--data", str(tmp_path / "data"))
    assert "412 N·m" in said
    assert "nothing was moved" in said
    assert not (tmp_path / "data").exists()


def test_a_transmission_error_is_measured_judged_and_kept(tmp_path):
    said = run(
        "transmission-error", "--short", "--reducer", "rv-40e", "--serial", "A1",
        "--data", str(tmp_path),
    )  # fmt: skip
    assert "simulated" in said
    (results,) = (tmp_path / "runs").glob("*test-transmission-error*/results.json")
    kept = json.loads(results.read_text(encoding="utf-8"))
    assert kept["serial"] == "A1"
    assert kept["quantities"]


def test_an_unknown_test_is_refused():
    with pytest.raises(InputError, match="hysteresis"):
        run("stiffness")
