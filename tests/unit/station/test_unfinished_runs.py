import sqlite3
from datetime import UTC, datetime
from pathlib import Path

from torquebench.records import Registry, RunFolder, RunSummary
from torquebench.station import recover_unfinished


def test_a_run_that_the_registry_can_not_take_is_no_recovered_run(tmp_path: Path) -> None:
    with Registry.open(tmp_path) as registry:
        writer = RunFolder.create(tmp_path / "runs", {}, kind="zero")
        registry.add_run(
            RunSummary(
                run_id=writer.run_id,
                kind="zero",
                started=datetime.now(UTC),
                simulated=True,
                software_version="1",
                folder=writer.path,
            )
        )
        writer.close()  # as a kill leaves it
        with sqlite3.connect(tmp_path / "registry.sqlite") as database:
            database.execute(
                "CREATE TRIGGER full BEFORE INSERT ON run_ends "
                "BEGIN SELECT RAISE(ABORT, 'database or disk is full'); END"
            )
        database.close()
        (found,) = recover_unfinished(registry)
        assert "database or disk is full" in found.problem
        assert "make room" in found.advice
        assert [run.status for run in registry.runs()] == ["running"]
        with sqlite3.connect(tmp_path / "registry.sqlite") as database:
            database.execute("DROP TRIGGER full")
        database.close()
        (found,) = recover_unfinished(registry)
        assert not found.problem
        assert [run.status for run in registry.runs()] == ["interrupted"]
        assert recover_unfinished(registry) == ()
