"""Tables of errors stay within 80 columns and keep their digits."""

import io

import numpy as np
from rich.console import Console

from torquebench.calibration import summarise_errors
from torquebench.cli.tables import error_blocks


def test_blocks_fit_into_80_columns_and_mark_the_recommended() -> None:
    rng = np.random.default_rng(1)
    truth = np.linspace(-2000.0, 2000.0, 41)
    summary = summarise_errors(truth + rng.normal(0.0, 30.0, 41), truth, 2000.0)
    rows = [("raw reading", summary), ("*physics + Gaussian process", summary)]
    console = Console(file=io.StringIO(), width=80)
    for part in error_blocks([("against the standard", rows), ("left out", [])]):
        console.print(part)
    lines = console.file.getvalue().splitlines()
    assert max(len(line.rstrip()) for line in lines) <= 80
    text = "\n".join(lines)
    assert "* physics + Gaussian process" in text
    assert "left out" not in text
    assert "% rdg" in text
