"""An append-only file whose end is known to be on the disk."""

import os
from pathlib import Path
from typing import Any

from torquebench.atomic_write import create_private
from torquebench.errors import RecordError
from torquebench.message import Message


class DurableFile:
    """Appends data completely: if a write fails, it removes the incomplete data and ends the file.

    Python's raw files may write only a part of the data (on a full disk) and just return its size.
    This class writes until all data are written. If that fails, it truncates the file to its last
    synchronised size, so that no reader gets partial data. It has the methods that PyArrow calls.

    Parameters
    ----------
    path : pathlib.Path
        File to create; it must not exist yet.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = create_private(path)
        self._synchronised = 0
        self.failed = False

    def write(self, data: Any) -> int:
        """Write all of a buffer; return its size in bytes."""
        view = memoryview(data).cast("B")
        written = 0
        while written < len(view):
            written += self._file.write(view[written:]) or 0
        return written

    def synchronise(self) -> None:
        """Wait until everything that was written is on the disk."""
        os.fsync(self._file.fileno())
        self._synchronised = self._file.tell()

    def failure(self, error: OSError) -> RecordError:
        """Truncate the file to its synchronised data, close it, and return the error to raise."""
        self.failed = True
        try:
            self._file.truncate(self._synchronised)
            self._file.seek(self._synchronised)
            self._file.close()
        except OSError as second:  # a failed disk can't be truncated
            error.add_note(f"and incomplete data couldn't be removed: {second}")
        return RecordError(
            Message("{path} can't be written ({strerror})", self._path, error.strerror or error),
            "space on a working disk",
            "make room on the disk or repair it; the run must stop",
        )

    def flush(self) -> None:
        """Do nothing: nothing is buffered."""

    @property
    def closed(self) -> bool:
        """Whether the file is closed."""
        return self._file.closed

    def close(self) -> None:
        """Close the file; further calls do nothing."""
        self._file.close()
