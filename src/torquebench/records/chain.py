"""The hash chain over all records, which reveals later changes."""

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, date, datetime
from typing import Any

START = "0" * 64
"""Predecessor hash of the first link."""


@dataclass(frozen=True)
class ChainHead:
    """The last link of a chain; a copy kept elsewhere proves later that no record was changed.

    Parameters
    ----------
    sequence : int
        Number of the last record; 0 for an empty registry.
    sha256 : str
        Its hash, which covers all records before it.
    """

    sequence: int
    sha256: str

    def __str__(self) -> str:
        return f"{self.sequence}:{self.sha256}"


@dataclass(frozen=True)
class Link:
    """One record as entered.

    Parameters
    ----------
    sequence : int
        1 for the first record of a registry.
    table, key : str, int
        Which row it is.
    recorded : str
        Moment of the entry in UTC, ISO 8601.
    content : str
        All fields of the row as canonical JSON.
    previous_sha256, sha256 : str
        Hash of the link before, and of this one.
    """

    sequence: int
    table: str
    key: int
    recorded: str
    content: str
    previous_sha256: str
    sha256: str

    def expected_sha256(self) -> str:
        """Compute the link's hash from its content."""
        covered = [
            self.sequence,
            self.table,
            self.key,
            self.recorded,
            self.content,
            self.previous_sha256,
        ]
        try:
            text = json.dumps(covered, ensure_ascii=False, separators=(",", ":"))
        except TypeError:  # a damaged value that isn't text
            return ""
        return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def canonical(content: Mapping[str, Any]) -> str:
    """Return the fields of a row as JSON that is the same on every database.

    Keys are sorted, moments are in UTC with microseconds, numbers are written so that they are
    read back exactly.

    Raises
    ------
    TypeError, ValueError
        Where a field contains values that aren't numbers, text, dates and JSON, or a NaN.

    Examples
    --------
    >>> canonical({"serial": "T-1", "range_nm": 50.0})
    '{"range_nm":50.0,"serial":"T-1"}'
    """
    return json.dumps(
        content,
        sort_keys=True,
        ensure_ascii=False,
        allow_nan=False,
        separators=(",", ":"),
        default=_moment,
    )


def _moment(value: object) -> str:
    if isinstance(value, datetime):
        return value.astimezone(UTC).isoformat(timespec="microseconds")
    if isinstance(value, date):
        return value.isoformat()
    raise TypeError(f"a {type(value).__name__} in a record")


def seal(head: ChainHead, table: str, key: int, recorded: datetime, content: str) -> Link:
    """Return the link for a new row at the end of a chain.

    Examples
    --------
    >>> head = ChainHead(0, START)
    >>> link = seal(head, "runs", 1, datetime(2025, 1, 31, tzinfo=UTC), '{"kind":"zero"}')
    >>> link.sequence, link.sha256 == link.expected_sha256()
    (1, True)
    """
    link = Link(
        head.sequence + 1,
        table,
        key,
        _moment(recorded),
        content,
        head.sha256,
        sha256="",
    )
    return Link(**{**vars(link), "sha256": link.expected_sha256()})


def broken_links(links: Iterable[Link]) -> Iterator[tuple[Link, str]]:
    """Yield every link that was changed after it was appended, and what is wrong with it.

    Parameters
    ----------
    links : iterable of Link
        All links, by sequence.
    """
    head = ChainHead(0, START)
    for link in links:
        if link.sequence != head.sequence + 1:
            count = link.sequence - head.sequence - 1
            yield link, f"{count} entries before entry {link.sequence} are missing"
        elif link.previous_sha256 != head.sha256:
            yield link, f"entry {link.sequence} doesn't continue entry {head.sequence}"
        if link.sha256 != link.expected_sha256():
            yield link, f"entry {link.sequence} doesn't have the hash that it was sealed with"
        head = ChainHead(link.sequence, link.sha256)


def changed_fields(
    registered: Mapping[str, Any], present: Mapping[str, Any]
) -> list[tuple[str, Any, Any]]:
    """Return the fields in which a row differs from its registration, with both values.

    A field that a later version of the schema added isn't compared.

    Examples
    --------
    >>> changed_fields({"range_nm": 50.0, "serial": "T-1"}, {"range_nm": 60.0, "serial": "T-1"})
    [('range_nm', 50.0, 60.0)]
    """
    return [
        (name, value, present.get(name))
        for name, value in registered.items()
        if name not in present or canonical({"": present[name]}) != canonical({"": value})
    ]
