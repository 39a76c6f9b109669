"""The audit log's hash chain: the hash of each line includes that of the line before."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

AUDIT_FILE = "audit.jsonl"
"""Name of the log in its folder, and of a run's part of the log in the run's folder."""
DROPPED = "old log dropped"
"""Event of a line that states the last line of deleted older logs."""
_START = "0" * 64
_CHAIN = re.compile(
    rb', "log_line": ([0-9]+), "previous_sha256": "([0-9a-f]{64})", "sha256": "([0-9a-f]{64})"\}$'
)


@dataclass(frozen=True)
class AuditEnd:
    """Number and hash of a line of the log, which determine everything before it.

    Parameters
    ----------
    line : int
        Number of the line, from 1; 0 for a log without lines.
    sha256 : str
        Hash of the line, which depends on all lines before it.
    """

    line: int = 0
    sha256: str = _START


@dataclass(frozen=True)
class _Place:
    """A line's position in the chain, and whether its hash is right."""

    end: AuditEnd
    previous_sha256: str
    intact: bool


def chained(line: str, end: AuditEnd) -> tuple[bytes, AuditEnd]:
    """Return a JSON line with number and hashes, line feed included, and the new end of the log.

    Examples
    --------
    >>> line, end = chained('{"event": "bench opens"}', AuditEnd())
    >>> json.loads(line)["log_line"], end.line
    (1, 1)
    """
    body = f'{line[:-1]}, "log_line": {end.line + 1}, "previous_sha256": "{end.sha256}"'.encode()
    digest = hashlib.sha256(body).hexdigest()
    return body + f', "sha256": "{digest}"}}\n'.encode(), AuditEnd(end.line + 1, digest)


def files_aside(folder: Path) -> list[Path]:
    """Return the archived logs, the oldest first."""
    return sorted(folder.glob("audit-*.jsonl"))


def last_end(folder: Path, content: bytes) -> AuditEnd:
    """Return the last complete line of a log's content, or else of the archived logs.

    In a log that began before lines were chained, the first chained line has the hash of everything
    before it.
    """
    for line in reversed(content.split(b"\n")):
        parsed = _place(line)
        if parsed is not None and parsed.intact:
            return parsed.end
    if content:
        return AuditEnd(0, hashlib.sha256(content).hexdigest())
    aside = files_aside(folder)
    newest = aside[-1].read_bytes() if aside else b""
    return last_end(folder, newest) if newest else AuditEnd()


def audit_end(path: Path) -> AuditEnd:
    """Return the last complete line of a run's part of the log; line 0 if there is none."""
    if not path.exists():
        return AuditEnd()
    places = (_place(line) for line in reversed(path.read_bytes().split(b"\n")))
    return next((place.end for place in places if place is not None and place.intact), AuditEnd())


@dataclass
class AuditCheck:
    """Result of a comparison of the log with its chain.

    Attributes
    ----------
    lines : int
        Lines that were compared.
    problems : list of (str, str)
        Place and defect; empty if the log is unchanged.
    """

    lines: int = 0
    problems: list[tuple[str, str]] = field(default_factory=list)


def check_audit(folder: Path, noted: Iterable[tuple[AuditEnd, str]] = ()) -> AuditCheck:
    """Compare every line of the log with its chain, and the chain with recorded ends.

    Parameters
    ----------
    folder : pathlib.Path
        Folder of the log, which may be in use.
    noted : iterable of (AuditEnd, str)
        Ends that were recorded elsewhere, each with its place.
    """
    walk = _Walk(folder, noted)
    for file in (*files_aside(folder), folder / AUDIT_FILE):
        if file.exists():
            walk.file(file)
    walk.finish()
    return walk.check


class _Walk:
    """One pass over all lines of a log."""

    def __init__(self, folder: Path, noted: Iterable[tuple[AuditEnd, str]]) -> None:
        self.check = AuditCheck()
        self._folder = folder
        self._noted = {end.line: (end.sha256, where) for end, where in noted if end.line}
        self._end: AuditEnd | None = None
        self._first = 0
        self._dropped = 0
        self._damaged = False
        self._older = ""

    def file(self, file: Path) -> None:
        """Check the lines of the next file; only the last file may end in an incomplete line."""
        content = file.read_bytes()
        *lines, torn = content.split(b"\n")
        position = 0
        for number, line in enumerate(lines, start=1):
            self._line(f"{file}, line {number}", line, content[:position])
            position += len(line) + 1
        if torn and file.name != AUDIT_FILE:  # the next line of the log is still being written
            self._problem(str(file), "its last line is incomplete")

    def _line(self, where: str, line: bytes, before: bytes) -> None:
        """Check the next line of a log against the hash of the line before it."""
        self.check.lines += 1
        place = _place(line)
        if place is None and self._end is None:
            self._older = (
                self._older or where
            )  # older than the chain, whose first line includes its hash
            return
        if place is None or not place.intact:
            self._damaged = True
            self._problem(where, "was changed after it was written")
            return
        if self._end is None:
            self._begins(where, place, before)
        elif place.end.line != self._end.line + 1 and not self._damaged:
            missing = place.end.line - self._end.line - 1
            self._problem(where, f"{missing} lines before it are missing")
        elif place.previous_sha256 != self._end.sha256 and not self._damaged:
            self._problem(where, "doesn't continue the line before")
        self._damaged = False
        self._end = place.end
        if self._noted.get(place.end.line, ("", ""))[0] == place.end.sha256:
            del self._noted[place.end.line]
        if DROPPED.encode() in line[:40]:
            self._dropped = max(self._dropped, int(json.loads(line)["last_line"]))

    def _begins(self, where: str, parsed: _Place, before: bytes) -> None:
        """Check the first chained line against the lines before it, which older versions wrote."""
        self._first = parsed.end.line
        expected = hashlib.sha256(before).hexdigest() if before else _START
        if self._damaged or (self._first == 1 and parsed.previous_sha256 == expected):
            return
        if self._first == 1:
            self._problem(where, "the lines before it were changed")
        elif self._older:
            self._problem(self._older, "was changed after it was written")

    def finish(self) -> None:
        """Report missing first lines, and an end before a line that was noted elsewhere."""
        if self._first > self._dropped + 1 and not self.check.problems:
            self._problem(
                str(self._folder), f"lines {self._dropped + 1} to {self._first - 1} are missing"
            )
        missing = {line for line in self._noted if line > self._dropped}
        if not missing or self.check.problems:  # a damaged line can't be the recorded end
            return
        line = max(missing)
        found = "there is no log" if self._end is None else f"the log ends with {self._end.line}"
        if self._end is not None and line <= self._end.line:
            found = "the log has another one"
        self._problem(str(self._folder), f"line {line} is noted in {self._noted[line][1]}, {found}")

    def _problem(self, where: str, what: str) -> None:
        self.check.problems.append((where, what))


def _place(line: bytes) -> _Place | None:
    """Return a line's place in the chain of hashes; None for a line that is older than it."""
    match = _CHAIN.search(line)
    if match is None:
        return None
    number, previous, digest = match.groups()
    body = line[: match.start(3) - len(', "sha256": "')]
    intact = hashlib.sha256(body).hexdigest() == digest.decode()
    return _Place(AuditEnd(int(number), digest.decode()), previous.decode(), intact)
