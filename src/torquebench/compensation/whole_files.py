"""Complete files or none."""

from __future__ import annotations

import os
import uuid
from pathlib import Path

from torquebench.errors import RecordError

__all__ = ["write_whole"]


def write_whole(path: Path, content: bytes, what: str = "") -> Path:
    """Write a file so that its old content stays until the new one is complete.

    Parameters
    ----------
    path : Path
        An existing file is replaced.
    content : bytes
    what : str, optional
        What the file is, for the error.

    Returns
    -------
    path : Path

    Raises
    ------
    RecordError
        When the file can't be written.
    """
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex}")
    try:
        with temporary.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as problem:
        temporary.unlink(missing_ok=True)
        raise RecordError(
            f"{what} {path} can't be written ({problem.strerror})".lstrip(),
            remedy="choose a folder that exists and can be written to",
        ) from problem
    return path
