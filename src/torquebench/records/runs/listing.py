"""The list of runs, read directly from the SQLite file without an object mapper.

`Registry.runs` returns more fields, but importing SQLAlchemy takes longer than reading the newest
of 100 000 runs.
"""

import os
import sqlite3
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import NamedTuple

from torquebench.records.files import UNREADABLE
from torquebench.records.read_only import sqlite_reader
from torquebench.records.registry.schema_version import SCHEMA_VERSION, VERSIONS_TABLE

_NEWEST = """
    SELECT run_id, started, coalesce(status, 'running'), bench, simulated
    FROM runs LEFT JOIN run_ends ON run_ends.run_key = runs.id
    ORDER BY started DESC, runs.id DESC LIMIT ?
"""

_WITHOUT_RESULT = """
    SELECT 1 FROM runs JOIN run_ends ON run_ends.run_key = runs.id
    WHERE kind >= :kind || '-' AND kind < :kind || '.' AND status = 'completed'
    AND runs.id NOT IN (SELECT run_key FROM {table} WHERE run_key IS NOT NULL)
    AND run_ends.id NOT IN (SELECT subject_key FROM amendments WHERE subject = 'run_ends')
    LIMIT 1
"""
_RESULTS = {"calibrate": "calibrations", "check": "checks", "verify": "verifications"}
_INTERRUPTED = """
    SELECT 1 FROM runs JOIN run_ends ON run_ends.run_key = runs.id
    WHERE kind >= 'calibrate-' AND kind < 'calibrate.' AND started > ?
    AND status IN ('interrupted', 'aborted', 'failed') LIMIT 1
"""
RECENT = timedelta(days=30)


class RunLine(NamedTuple):
    """A run in a list, with fields of `RunSummary`."""

    run_id: str
    started: datetime
    status: str
    bench: str
    simulated: bool


def maybe_unfinished(file: Path) -> bool:
    """Return quickly whether a registry in SQLite may have an unfinished run.

    False is certain; after True, `unfinished_runs` lists them.
    """
    runs = file.parent / "runs"
    try:
        with (
            sqlite_reader(file) as address,
            closing(sqlite3.connect(address, uri=True, timeout=5.0)) as connection,
        ):
            ended = {
                name
                for (name,) in connection.execute(
                    "SELECT run_id FROM runs JOIN run_ends ON run_ends.run_key = runs.id"
                )
            }
            if runs.is_dir() and not ended.issuperset(each.name for each in os.scandir(runs)):
                return True
            recent = (datetime.now(UTC) - RECENT).strftime("%Y-%m-%d %H:%M:%S")
            if connection.execute(_INTERRUPTED, (recent,)).fetchone():
                return True
            return any(
                connection.execute(
                    _WITHOUT_RESULT.replace("{table}", table), {"kind": kind}
                ).fetchone()
                for kind, table in _RESULTS.items()
            )
    except (sqlite3.Error, *UNREADABLE):
        return True


def newest_runs(file: Path, limit: int) -> list[RunLine] | None:
    """Return the newest runs of a registry in SQLite, the newest first.

    Parameters
    ----------
    file : pathlib.Path
        The registry's file.
    limit : int
        Largest number of runs.

    Returns
    -------
    list of RunLine or None
        None if the file isn't a registry of this version; `Registry.open` then reports the problem.
    """
    try:
        with (
            sqlite_reader(file) as address,
            closing(sqlite3.connect(address, uri=True, timeout=5.0)) as connection,
        ):
            found = connection.execute(f"SELECT version_num FROM {VERSIONS_TABLE}").fetchone()
            if found is None or found[0] != SCHEMA_VERSION:
                return None
            return [
                RunLine(
                    run_id,
                    datetime.fromisoformat(started).replace(tzinfo=UTC),
                    status,
                    bench,
                    bool(simulated),
                )
                for run_id, started, status, bench, simulated in connection.execute(
                    _NEWEST, (limit,)
                )
            ]
    except (sqlite3.Error, *UNREADABLE):
        return None
