"""The list of runs comes up without the libraries that it doesn't need."""

import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

import torquebench
from torquebench import records
from torquebench.records import Registry, RunSummary
from torquebench.records.runs.listing import newest_runs

START = datetime(2025, 1, 31, 12, 0, tzinfo=UTC)


def add_runs(registry: Registry, folder: Path) -> None:
    for number in range(5):
        ended = number != 3
        registry.add_run(
            RunSummary(
                run_id=f"run-{number}",
                kind="calibrate-output",
                started=START + timedelta(minutes=number % 3),
                simulated=number % 2 == 0,
                software_version="0.1",
                folder=folder / "runs" / f"run-{number}",
                finished=START + timedelta(hours=1) if ended else None,
                status="aborted" if ended else "running",
                bench="bench A",
            )
        )


def test_the_short_way_lists_what_the_registry_lists(tmp_path: Path) -> None:
    with Registry.open(tmp_path) as registry:
        add_runs(registry, tmp_path)
        wanted = [
            (run.run_id, run.started, run.status, run.bench, run.simulated)
            for run in registry.runs(limit=4)
        ]
        found = newest_runs(tmp_path / "registry.sqlite", 4)  # while it is open and written
    assert found is not None
    assert [tuple(line) for line in found] == wanted


def test_what_is_no_registry_of_this_version_is_left_to_the_registry(tmp_path: Path) -> None:
    assert newest_runs(tmp_path / "missing.sqlite", 4) is None
    other = tmp_path / "other.sqlite"
    other.write_bytes(b"no database at all, but long enough to be taken for one" * 20)
    assert newest_runs(other, 4) is None
    assert not (tmp_path / "missing.sqlite").exists()


def loaded_by(statement: str, *arguments: str) -> set[str]:
    code = f"import sys\n{statement}\nsys.stderr.write(' '.join(sys.modules))"
    result = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True
    )
    return {name.partition(".")[0] for name in result.stderr.split()}


def test_listing_runs_loads_neither_numerics_nor_an_object_mapper(tmp_path: Path) -> None:
    with Registry.open(tmp_path) as registry:
        add_runs(registry, tmp_path)
    command = "from torquebench.cli import app\napp(standalone_mode=False)"
    loaded = loaded_by(command, "records", "list", "runs", "--data", str(tmp_path))
    assert not loaded & {"sqlalchemy", "numpy", "scipy", "sklearn", "numba", "pandas"}


def test_opening_a_registry_loads_no_numerics() -> None:
    loaded = loaded_by("from torquebench.records import Registry")
    assert "sqlalchemy" in loaded
    assert not loaded & {"scipy", "sklearn", "numba", "pandas"}


def test_every_public_name_is_there() -> None:
    for name in records.__all__:
        assert getattr(records, name) is not None
    assert set(records.__all__) <= set(dir(records))
    with pytest.raises(AttributeError, match="nothing"):
        _ = records.nothing
    with pytest.raises(AttributeError, match="nothing"):
        _ = torquebench.nothing
    assert torquebench.__version__
