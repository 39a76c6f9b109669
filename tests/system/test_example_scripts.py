import ast
import runpy
from pathlib import Path

import pytest

from torquebench.tables import read_calibration, read_readings, read_table

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
READERS = {
    "calibration": read_calibration,
    "verification": read_calibration,
    "readings": read_readings,
    "loops": read_table,
}
SCRIPTS = sorted(EXAMPLES.glob("[!_]*.py"))


@pytest.mark.nightly  # the gallery of the documentation compares models by day
@pytest.mark.parametrize("script", SCRIPTS, ids=[script.stem for script in SCRIPTS])
def test_an_example_runs_and_is_short(script, capsys):
    text = script.read_text(encoding="utf-8")
    assert len(text.splitlines()) < 30
    assert "simulated" in ast.get_docstring(ast.parse(text))
    runpy.run_path(str(script), run_name="__main__")
    told = capsys.readouterr().out
    assert told
    if script.stem == "fit_compare_apply":  # shows what compensation is worth
        fresh = [line.split() for line in told.splitlines() if "fresh" in line]
        raw, compensated = (float(line[3]) for line in fresh)
        assert compensated < 0.2 * raw


def test_example_tables_are_simulated_and_say_so():
    tables = sorted(EXAMPLES.glob("*.csv"))
    assert tables
    for path in tables:
        reader = READERS[path.stem.split("-")[0]]
        assert reader(path).simulated
        assert "simulated" in path.read_text(encoding="utf-8")
