"""The memory in a transducer's connector: pages with checksums, as binary file or hexadecimal text.

A 1-wire memory has pages of 32 bytes. The first byte of each makes the page's sum a multiple
of 256.
"""

from __future__ import annotations

import re
from pathlib import Path

from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["PAGE_BYTES", "SIZES", "read_file", "read_memory", "write_memory"]

PAGE_BYTES = 32
SIZES = {"DS2430A": 32, "DS2431": 128, "DS2433": 512, "DS28EC20": 2560}
"""Bytes of the usual memories."""

_HEXADECIMAL = re.compile(rb"(?:0x)?[0-9A-Fa-f\s,:-]+")


def read_memory(content: bytes, *, checksums: bool = True) -> bytes:
    """Return the bits of a data sheet from a memory's content.

    Parameters
    ----------
    content : bytes
        A file's content: binary, or hexadecimal digits as ASCII.
    checksums : bool, default True
        Whether each page begins with its checksum. Virtual data sheets in files have none.

    Returns
    -------
    data : bytes

    Raises
    ------
    InputError
        If a page's checksum is wrong, pages are cut off, or the memory is empty.

    Examples
    --------
    >>> read_memory(b"1F 40 62", checksums=False).hex()
    '1f4062'
    """
    data = _binary(content)
    if not checksums:
        return data
    if not data or len(data) % PAGE_BYTES:
        raise InputError(
            Message("a memory of {size} bytes", len(data)),
            Message("pages of {page_bytes} bytes with a checksum each", PAGE_BYTES),
            "read the whole memory, or give --no-checksums for a sheet without them",
        )
    pages = [data[start : start + PAGE_BYTES] for start in range(0, len(data), PAGE_BYTES)]
    for number, page in enumerate(pages, 1):
        blank = not page.strip(b"\0") or not page.strip(b"\xff")
        if sum(page) % 256 and not blank:
            right = -sum(page[1:]) % 256
            raise InputError(
                Message("page {number}: checksum 0x{page:02X}", number, page[0]),
                Message("0x{right:02X} for these {page_bytes} bytes", right, PAGE_BYTES - 1),
                "read the memory again; give --no-checksums for a sheet without checksums",
            )
    written = [page for page in pages if page.strip(b"\xff")]
    return b"".join(page[1:] for page in written) if written else data


def write_memory(data: bytes, size: int, *, checksums: bool = True) -> bytes:
    """Return the content of a memory.

    Parameters
    ----------
    data : bytes
        Bits of a data sheet.
    size : int
        Bytes of the memory, whole pages.
    checksums : bool, default True
        Whether to give each page its checksum; without, only the sheet is returned.

    Returns
    -------
    content : bytes
        Content, as long as the memory.

    Raises
    ------
    InputError
        When the sheet is longer than the memory.
    """
    if not checksums:
        return data
    if size <= 0 or size % PAGE_BYTES:
        raise InputError(
            Message("a memory of {size} bytes", size),
            Message("whole pages of {page_bytes} bytes", PAGE_BYTES),
        )
    room = size // PAGE_BYTES * (PAGE_BYTES - 1)
    if len(data) > room:
        raise InputError(
            Message("a data sheet of {count} bytes", len(data)),
            Message("{room} bytes in a memory of {size}", room, size),
            "use a larger memory, or fewer segments and powers",
        )
    padded = data.ljust(room, b"\0")
    pages = [padded[start : start + PAGE_BYTES - 1] for start in range(0, room, PAGE_BYTES - 1)]
    return b"".join(bytes([-sum(page) % 256]) + page for page in pages)


def _binary(content: bytes) -> bytes:
    if not content.strip() or not _HEXADECIMAL.fullmatch(content.strip()):
        return content
    digits = re.sub(rb"0x|[\s,:-]", b"", content)
    if len(digits) % 2:
        raise InputError(
            Message("{count} hexadecimal digits", len(digits)), "two a byte", "copy all of them"
        )
    return bytes.fromhex(digits.decode("ascii"))


def read_file(path: Path, *, checksums: bool = True) -> bytes:
    """Read a memory's file; see `read_memory`."""
    try:
        content = path.read_bytes()
    except OSError as problem:
        raise InputError(
            Message("{path}: {strerror}", path, problem.strerror or problem),
            "a file that can be read",
        ) from problem
    return read_memory(content, checksums=checksums)
