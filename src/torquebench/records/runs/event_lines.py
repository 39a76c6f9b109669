"""Document lines of an unsealed run; every line has a number and a checksum.

A line is recognised by its beginning and end, not by line feeds, so that damage affects only the
damaged lines. The checksum includes the run's identifier, so that lines of another run, as a broken
file system may leave them, aren't accepted.
"""

import hashlib
import json
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from torquebench.records.files import UNREADABLE, json_text

_BEGIN = re.compile(rb'\{"line": [0-9]+, "name": ')
_END = re.compile(rb', "sha256": "([0-9a-f]{64})"\}')
_TAIL = len(', "sha256": ""}') + 64
_TRIED = 16
"""How many possible beginnings are tried for one end, as a document may contain the pattern."""


@dataclass(frozen=True)
class CheckedLine:
    """A document whose checksum is correct.

    Parameters
    ----------
    number : int
        Number of the document in the run, from 1, without gaps.
    name, document : str, dict
        Name and content of the document.
    text : bytes
        The original line without its line feed.
    """

    number: int
    name: str
    document: dict[str, Any]
    text: bytes


@dataclass(frozen=True)
class Damage:
    """A damaged part of a file.

    Parameters
    ----------
    first_line, last_line : int
        The lost documents, from the numbers of the lines around the damage; at the end of the file,
        from its line feeds. If none was lost, `last_line` is smaller than `first_line`.
    offset, bytes : int
        Position of the damage in the file, and its size.
    """

    first_line: int
    last_line: int
    offset: int
    bytes: int

    @property
    def lines(self) -> int:
        """Number of lost documents."""
        return self.last_line - self.first_line + 1

    def __str__(self) -> str:
        lines = f"line {self.first_line}"
        if self.lines > 1:
            lines += f" to {self.last_line}"
        if not self.bytes:
            return f"{lines} missing"
        return f"{lines} damaged ({self.bytes} bytes from byte {self.offset} on)"


@dataclass(frozen=True)
class ReadLines:
    """Lines and damages read from a file.

    Parameters
    ----------
    lines : tuple of CheckedLine
        Every line whose checksum is correct, sorted by number.
    damages : tuple of Damage
        Damaged parts between and after these lines.
    torn_bytes : int
        Size of an incomplete last line, as after a kill.
    """

    lines: tuple[CheckedLine, ...]
    damages: tuple[Damage, ...] = ()
    torn_bytes: int = 0


def checked_line(run_id: str, number: int, name: str, document: Any) -> bytes:
    r"""Return a document as a line with number, checksum and line feed.

    Examples
    --------
    >>> checked_line("run-1", 1, "event", {"seq_num": 1}).decode()
    '{"line": 1, "name": "event", "doc": {"seq_num": 1}, "sha256": "..."}\n'
    """
    body = json_text({"line": number, "name": name, "doc": document})[:-1].encode()
    return body + f', "sha256": "{_digest(run_id, body)}"}}\n'.encode()


def read_lines(content: bytes, run_id: str) -> ReadLines:
    """Return every undamaged line of a file, and the damages.

    Examples
    --------
    >>> lines = [checked_line("run-1", number, "event", {"seq_num": number}) for number in (1, 2)]
    >>> read = read_lines(lines[0].replace(b'num": 1', b'num": 5') + lines[1], "run-1")
    >>> [line.number for line in read.lines], [str(each) for each in read.damages]
    ([2], ['line 1 damaged (129 bytes from byte 0 on)'])
    """
    lines: dict[int, CheckedLine] = {}
    damages: list[Damage] = []
    position, number = 0, 0
    for begin, line in _found(content, run_id):
        gap = content[position:begin].strip(b"\n")
        if gap or line.number > number + 1:
            damages.append(Damage(number + 1, max(line.number - 1, number), position, len(gap)))
        lines.setdefault(line.number, line)
        position, number = begin + len(line.text), max(number, line.number)
    rest = content[position:].lstrip(b"\n")
    # A complete line ends with a line feed; without one it is truncated.
    lost = rest.count(b"\n")
    if lost:
        damages.append(Damage(number + 1, number + lost, len(content) - len(rest), len(rest)))
    ordered = tuple(lines[key] for key in sorted(lines))
    return ReadLines(ordered, tuple(damages), 0 if lost else len(rest))


def with_copies(read: ReadLines, copies: Iterable[CheckedLine]) -> ReadLines:
    """Return the lines, and missing ones from their copies in a second file.

    A damage is dropped if no line is missing any more.
    """
    own = {line.number: line for line in read.lines}
    last = max((*own, *(each.last_line for each in read.damages)), default=0)
    lines = {line.number: line for line in copies if line.number <= last} | own
    damages = tuple(
        each
        for each in read.damages
        if not all(number in lines for number in range(each.first_line, each.last_line + 1))
    )
    return ReadLines(tuple(lines[key] for key in sorted(lines)), damages, read.torn_bytes)


def _found(content: bytes, run_id: str) -> Iterator[tuple[int, CheckedLine]]:
    """Yield every line with a valid checksum, and its position."""
    begin = gap = 0
    for text in content.split(b"\n"):
        line = _line(text, run_id)
        if line is not None:
            yield from _between(content, gap, begin, run_id)
            yield begin, line
            gap = begin + len(text)
        begin += len(text) + 1
    yield from _between(content, gap, len(content), run_id)


def _between(
    content: bytes, begin: int, end: int, run_id: str
) -> Iterator[tuple[int, CheckedLine]]:
    """Yield the valid lines in a damaged part, where line feeds may be missing."""
    for last in _END.finditer(content, begin, end):
        begins = [each.start() for each in _BEGIN.finditer(content, begin, last.start())]
        for first in reversed(begins[-_TRIED:]):
            line = _line(content[first : last.end()], run_id)
            if line is not None:
                yield first, line
                begin = last.end()
                break


def _line(text: bytes, run_id: str) -> CheckedLine | None:
    body, digest = text[:-_TAIL], _END.fullmatch(text[-_TAIL:])
    if digest is None or _digest(run_id, body) != digest[1].decode():
        return None
    try:
        entry = json.loads(body + b"}")
        return CheckedLine(entry["line"], entry["name"], entry["doc"], text)
    except UNREADABLE:
        return None


def _digest(run_id: str, body: bytes) -> str:
    return hashlib.sha256(run_id.encode() + b"\n" + body).hexdigest()
