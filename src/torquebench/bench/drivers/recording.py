"""Record of a session with instruments: what was sent and answered, with times, as lines of JSON.

The first line states version, bench and the sections of `[driver]`. Each following line has `t_s`,
`instrument`, `address`, `event` and `text`. Events are "sent" and "received" (lines of text),
"answer" (what a request gave) and "failure". Sections contain no passwords, and none are sent.
"""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TextIO

from torquebench.errors import InputError
from torquebench.message import Message

LONGEST_TEXT = 2000


class _Session:
    def __init__(self, file: TextIO) -> None:
        self._file, self._lock, self._began_s = file, threading.Lock(), time.monotonic()

    def write(self, fields: Mapping[str, Any]) -> None:
        """Write a line of the recording with its time."""
        with self._lock:
            t_s = round(time.monotonic() - self._began_s, 6)
            print(json.dumps({"t_s": t_s} | dict(fields), ensure_ascii=False), file=self._file)
            self._file.flush()


_session: _Session | None = None


def recording() -> bool:
    """Return whether a session is being recorded."""
    return _session is not None


def note(instrument: str, address: str, event: str, text: object) -> None:
    """Record an event, if a session is being recorded."""
    if _session is not None:
        content = str(text)[:LONGEST_TEXT]
        _session.write(
            {"instrument": instrument, "address": address, "event": event, "text": content}
        )


@contextlib.contextmanager
def recorded(path: Path | None, header: Mapping[str, Any]) -> Iterator[None]:
    """Record everything that drivers exchange within the block; None records nothing.

    Raises
    ------
    InputError
        The file exists or can't be written.
    """
    global _session
    if path is None:
        yield
        return
    try:
        file = path.open("x", encoding="utf-8")
    except OSError as error:
        raise InputError(
            Message("{path}: {error}", path, error.strerror or error),
            "a new file in a folder that can be written",
            "choose another name",
        ) from error
    with file:
        _session = _Session(file)
        _session.write(header)
        try:
            yield
        finally:
            _session = None
