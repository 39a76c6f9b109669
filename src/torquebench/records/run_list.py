"""The list of runs straight from the SQLite file: a list isn't worth loading an object mapper for.

`Registry.runs` knows more of each run, but importing SQLAlchemy alone takes longer than reading
the newest of 100 000 runs does.
"""

import sqlite3
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from torquebench.records.read_only import sqlite_reader
from torquebench.records.schema_version import SCHEMA_VERSION, VERSIONS_TABLE

__all__ = ["RunLine", "newest_runs"]

_NEWEST = """
    SELECT run_id, started, coalesce(status, 'running'), bench, simulated
    FROM runs LEFT JOIN run_ends ON run_ends.run_key = runs.id
    ORDER BY started DESC, runs.id DESC LIMIT ?
"""


class RunLine(NamedTuple):
    """What a list shows of a run; the fields mean what `RunSummary` says."""

    run_id: str
    started: datetime
    status: str
    bench: str
    simulated: bool


def newest_runs(file: Path, limit: int) -> list[RunLine] | None:
    """Return the newest runs of a registry in SQLite, the newest first.

    Parameters
    ----------
    file : pathlib.Path
        The registry's file.
    limit : int
        How many at most.

    Returns
    -------
    list of RunLine or None
        None where the file isn't a registry of this version; `Registry.open` says what it is.
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
    except sqlite3.Error:
        return None
