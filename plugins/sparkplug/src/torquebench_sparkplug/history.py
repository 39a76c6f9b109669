"""Unsent data, stored in a file of limited size until a broker has taken them."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from torquebench.errors import RecordError
from torquebench.message import Message
from torquebench_sparkplug.payload import Metric, Payload, decode, encode

__all__ = ["History", "Kept"]

OVERHEAD_BYTES = 32
"""Approximate size of a row of the table, bytes."""


@dataclass(frozen=True)
class Kept:
    """Values of one device that were read at one time."""

    number: int
    device: str
    metrics: tuple[Metric, ...]


class History:
    """Records in the order in which they were read; the oldest are removed first.

    It also stores the number of the last connection, which continues after a restart.

    Parameters
    ----------
    path : path
        An SQLite file, made on first use.
    limit_mb : float

    Examples
    --------
    >>> import tempfile
    >>> from torquebench_sparkplug.payload import DataType
    >>> folder = tempfile.TemporaryDirectory()
    >>> history = History(Path(folder.name) / "sparkplug.sqlite", limit_mb=1.0)
    >>> history.keep([("input", (Metric("Speed/Value", None, 5, DataType.DOUBLE, 1.5),))])
    >>> [record.metrics[0].value for record in history.oldest(10)]
    [1.5]
    >>> history.close(); folder.cleanup()
    """

    def __init__(self, path: Path, limit_mb: float) -> None:
        self.path = path
        self._limit = int(limit_mb * 1e6)
        try:
            self._file = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
            self._file.execute("PRAGMA journal_mode = WAL")
            self._file.execute("PRAGMA synchronous = NORMAL")
            self._file.execute(
                "CREATE TABLE IF NOT EXISTS history (number INTEGER PRIMARY KEY AUTOINCREMENT,"
                " device TEXT NOT NULL, payload BLOB NOT NULL)"
            )
            self._file.execute(
                "CREATE TABLE IF NOT EXISTS state (name TEXT PRIMARY KEY, value INTEGER NOT NULL)"
            )
            query = "SELECT count(*), coalesce(sum(length(payload)), 0) FROM history"
            self.waiting, size = self._file.execute(query).fetchone()
        except sqlite3.Error as error:
            raise RecordError(
                Message("{path}: {error}", path, error),
                "a readable file",
                "move it away; what waits in it isn't sent",
            ) from error
        self._bytes = int(size) + self.waiting * OVERHEAD_BYTES

    @property
    def lost(self) -> int:
        """Records dropped since the file was made."""
        return self._state("lost")

    @property
    def bdseq(self) -> int:
        """Number of the next connection: 0 at first, then one more, 0 after 255."""
        return self._state("bdseq")

    def connected(self) -> None:
        """Note that the number was used."""
        self._set("bdseq", (self.bdseq + 1) % 256)

    def keep(self, records: Iterable[tuple[str, Sequence[Metric]]]) -> None:
        """Add records; their metrics have names and types."""
        rows = [(device, encode(Payload(tuple(metrics)))) for device, metrics in records]
        if not rows:
            return
        self._file.execute("BEGIN")
        self._file.executemany("INSERT INTO history (device, payload) VALUES (?, ?)", rows)
        self.waiting += len(rows)
        self._bytes += sum(len(payload) + OVERHEAD_BYTES for _, payload in rows)
        self._make_room()
        self._file.execute("COMMIT")

    def _make_room(self) -> None:
        if self._bytes <= self._limit:
            return
        gone = 0
        with closing(self._file.cursor()) as found:
            found.execute("SELECT number, length(payload) FROM history ORDER BY number")
            for number, size in found:
                if self._bytes <= self._limit:
                    break
                self._bytes -= size + OVERHEAD_BYTES
                gone, last = gone + 1, number
        self._file.execute("DELETE FROM history WHERE number <= ?", (last,))
        self.waiting -= gone
        self._set("lost", self.lost + gone)

    def oldest(self, count: int) -> list[Kept]:
        """Return the oldest records."""
        query = "SELECT number, device, payload FROM history ORDER BY number LIMIT ?"
        rows = self._file.execute(query, (count,)).fetchall()
        return [Kept(number, device, decode(payload).metrics) for number, device, payload in rows]

    def forget(self, number: int) -> None:
        """Remove the records up to a number: a broker has them."""
        where = "FROM history WHERE number <= ?"
        query = f"SELECT count(*), coalesce(sum(length(payload)), 0) {where}"
        count, size = self._file.execute(query, (number,)).fetchone()
        self._file.execute(f"DELETE {where}", (number,))
        self.waiting -= count
        self._bytes -= size + count * OVERHEAD_BYTES

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _state(self, name: str) -> int:
        row = self._file.execute("SELECT value FROM state WHERE name = ?", (name,)).fetchone()
        return 0 if row is None else int(row[0])

    def _set(self, name: str, value: int) -> None:
        self._file.execute("INSERT OR REPLACE INTO state VALUES (?, ?)", (name, value))
