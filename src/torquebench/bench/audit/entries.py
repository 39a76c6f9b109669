"""The audit log: one JSON line for every command to the bench, alarm, run and acknowledgement.

It is stored beside the records (`audit/audit.jsonl` in the data directory), and each run's part
also in the run's folder, where the manifest seals it. A line is written before its command is
given, so that the command is recorded even if it crashes the process.

Every line carries its number, the hash of the line before and its own hash: a later change, removal
or insertion breaks the chain. Lines removed at the end are detected by the line numbers and hashes
in run folders and registry.
"""

from __future__ import annotations

import json
import os
import queue
import threading
from collections.abc import Callable, Iterator, Mapping, MutableMapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import structlog

from torquebench.atomic_write import private_folder
from torquebench.bench.audit.chain import (
    AUDIT_FILE,
    DROPPED,
    AuditEnd,
    chained,
    files_aside,
    last_end,
)
from torquebench.message import Message

AUDIT_FOLDER = "audit"
"""Folder of the log in a data directory."""
LARGEST_BYTES = 8_000_000
"""Size above which a log is archived, under the time of its end, B."""
KEPT_FILES = 64
"""Number of archived logs that are kept; runs have their own part in any case."""


class AuditLog:
    """Writer of the log, whose lines name bench, run and operator; safe to use from any thread.

    A failing disk never prevents a command: the failure is reported once, by `on_failure`, and the
    next line is tried again.

    Parameters
    ----------
    folder : pathlib.Path
        Folder of the log; created with the first line.
    bench_time : callable
        Bench time, s.
    largest_bytes, kept_files : int
        Size above which a log is archived, and number of archived logs that are kept.

    Attributes
    ----------
    on_failure : callable
        Called with the reason when a line couldn't be written; not again before a line was written.
    """

    def __init__(
        self,
        folder: Path,
        *,
        bench: str,
        bench_time: Callable[[], float] = lambda: 0.0,
        largest_bytes: int = LARGEST_BYTES,
        kept_files: int = KEPT_FILES,
    ) -> None:
        self.path = folder / AUDIT_FILE
        self.on_failure: Callable[[str], None] = lambda _failure: None
        self._bench_time = bench_time
        self._largest = largest_bytes
        self._kept = kept_files
        self._lock = threading.RLock()
        self._waiting: queue.Queue[str | None] = queue.Queue()
        self._starting = threading.Lock()
        self._writer: threading.Thread | None = None
        self._file: int | None = None
        self._end = AuditEnd()
        self._size = 0
        self._part: int | None = None
        self._failed = False
        self._logger = structlog.wrap_logger(
            _Sink(self._write_line, self._soon),
            processors=[
                self._stamp,
                structlog.processors.TimeStamper(fmt="iso", utc=True, key="time"),
                structlog.processors.JSONRenderer(
                    serializer=json.dumps, ensure_ascii=False, default=str
                ),
            ],
            wrapper_class=structlog.BoundLogger,
            context_class=dict,
            cache_logger_on_first_use=False,
        ).bind(bench=bench)

    def _stamp(
        self, _logger: Any, _method: str, event: MutableMapping[str, Any]
    ) -> Mapping[str, Any]:
        """Add the bench time to an entry."""
        return {**event, "bench_time_s": round(self._bench_time(), 6)}

    # -- context ----------------------------------------------------------------------------

    def bind(self, **values: str) -> None:
        """Add these values to every further line."""
        with self._lock:
            self._logger = self._logger.bind(**values)

    def begin_run(self, run_id: str, operator: str, folder: Path) -> None:
        """Add run and operator to every further line, and write it to the run's folder too."""
        with self._lock:
            self._logger = self._logger.bind(run=run_id, operator=operator)
            try:
                self._part = os.open(folder / AUDIT_FILE, _APPEND, 0o600)
            except OSError as error:
                self._fails(f"{folder / AUDIT_FILE}: {error.strerror}")

    def end_run(self) -> None:
        """End the binding of lines to a run."""
        self._waiting.join()
        with self._lock:
            self._logger = self._logger.try_unbind("run", "operator")
            if self._part is not None:
                os.close(self._part)
                self._part = None

    def write(self, event: str, /, **values: Any) -> None:
        """Append a line: an event and its values."""
        self._logger.info(event, **values)

    def write_soon(self, event: str, /, **values: Any) -> None:
        """Append a line with the present time, from a separate thread.

        The caller doesn't wait for the disk. `close` ends the thread.
        """
        self._logger.debug(event, **values)

    def close(self) -> None:
        """Close the files. A later line opens the log again."""
        self._end_writer()
        with self._lock:
            self._close_log()
            if self._part is not None:
                os.close(self._part)
                self._part = None

    # -- files ------------------------------------------------------------------------------

    def _soon(self, line: str) -> None:
        """Append a line in the writer's thread, so that the caller doesn't wait for the disk."""
        self._start_writer()
        self._waiting.put(line)

    def _start_writer(self) -> None:
        """Start the thread that writes waiting entries, unless it is running."""
        with self._starting:
            if self._writer is None:
                self._writer = threading.Thread(
                    target=self._write_waiting, name="torquebench-audit", daemon=True
                )
                self._writer.start()

    def _end_writer(self) -> None:
        """End the thread that writes, after all waiting entries."""
        with self._starting:
            writer, self._writer = self._writer, None
            if writer is not None:
                self._waiting.put(None)
                writer.join()

    def _write_waiting(self) -> None:
        """Write waiting lines in their order until the log is closed."""
        while True:
            line = self._waiting.get()
            try:
                if line is None:
                    return
                self._write_line(line)
            finally:
                self._waiting.task_done()

    @property
    def end(self) -> AuditEnd:
        """The last line that was written since the log was opened."""
        with self._lock:
            return self._end

    def _write_line(self, line: str) -> None:
        """Append a line, chained to the one before, to the log and to the run's part of it."""
        with self._lock:
            content = line.encode() + b"\n"
            try:
                file = self._opened()
                content, end = chained(line, self._end)
                _write_all(file, content)
                self._end = end
                self._size += len(content)
                if self._size > self._largest:
                    self._put_log_aside()
            except OSError as error:
                self._close_log()  # the next line opens it again and cuts off an incomplete one
                self._fails(f"{self.path}: {error.strerror or error}")
            else:
                self._failed = False
            try:
                if self._part is not None:
                    _write_all(self._part, content)
            except OSError as error:
                self._fails(
                    Message("the run's part of the log: {strerror}", error.strerror or error)
                )

    def _opened(self) -> int:
        """Return the log's file descriptor; on opening, an incomplete last line is cut off."""
        if self._file is None:
            private_folder(self.path.parent)
            self._file = os.open(self.path, _APPEND, 0o600)
            content = self.path.read_bytes()
            complete = content.rfind(b"\n") + 1
            if complete < len(content):  # a kill or a power failure in the middle of a line
                os.ftruncate(self._file, complete)
            self._end = last_end(self.path.parent, content[:complete])
            self._size = complete
            if complete < len(content):
                torn = content[complete:].decode(errors="replace")
                self._note("incomplete line removed", text=torn)
        return self._file

    def _note(self, event: str, **values: Any) -> None:
        """Append a line about the log itself."""
        time = datetime.now(UTC).isoformat().replace("+00:00", "Z")
        line = json.dumps({"event": event, **values, "time": time}, ensure_ascii=False)
        content, end = chained(line, self._end)
        _write_all(self._opened(), content)
        self._end = end
        self._size += len(content)

    def _close_log(self) -> None:
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def _put_log_aside(self) -> None:
        """Archive the log, continue in a new file, and delete the oldest of too many archives."""
        self._close_log()
        self.path.rename(self.path.with_name(f"audit-{datetime.now(UTC):%Y%m%dT%H%M%S%fZ}.jsonl"))
        for old in files_aside(self.path.parent)[: -self._kept]:
            last = last_end(old.parent, old.read_bytes())
            old.unlink(missing_ok=True)
            self._note(DROPPED, file=old.name, last_line=last.line, last_sha256=last.sha256)

    def _fails(self, failure: str) -> None:
        """Report a failure once, until a line is written again."""
        told, self._failed = self._failed, True
        if not told:
            self.on_failure(failure)


_APPEND = os.O_WRONLY | os.O_CREAT | os.O_APPEND


class _Sink:
    """Output of structlog, which appends its lines to the log."""

    def __init__(self, write: Callable[[str], None], write_soon: Callable[[str], None]) -> None:
        self.info = write  # structlog calls them by these names
        self.debug = write_soon


def _write_all(file: int, content: bytes) -> None:
    """Write all bytes to a file descriptor."""
    written = 0
    while written < len(content):
        written += os.write(file, content[written:])


def read_audit(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the lines of a log file, or of a folder's log and all its archives, oldest first.

    A line truncated by a power failure is left out.

    Parameters
    ----------
    path : pathlib.Path
        A file, or the folder of the log; it may be missing.
    """
    files = [*files_aside(path), path / AUDIT_FILE] if path.is_dir() else [path]
    for file in files:
        if not file.exists():
            continue
        with file.open(encoding="utf-8", errors="replace") as lines:
            for line in lines:
                try:
                    entry = json.loads(line)
                except ValueError:
                    continue
                if isinstance(entry, dict):
                    yield entry
