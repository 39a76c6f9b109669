"""`make plant`: three simulated benches, a link that is cut, and nothing lost."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from tests import postgresql_server

if postgresql_server.binaries() is None and not os.environ.get("CI"):
    __test__ = False  # conftest.py says in the report's head that PostgreSQL is left out

ROOT = Path(__file__).parents[3]


@pytest.mark.nightly
def test_the_demonstration_loses_nothing() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "plugins.plant.example.demonstration"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "6 runs were measured, 6 are in the plant: 0 lost, 0 twice" in done.stdout
    assert "communication error" in done.stdout
