"""Files that people hand in for operations, and files that operations write for them.

A file is named by a reference such as ``0f3a…/table.csv``, which is also its path in the folder in
which computations run. No other path reaches an operation, so nobody reads the server's files.
"""

from __future__ import annotations

import os
import re
import secrets
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations import Request, Result, parameters
from torquebench.panel.service.problems import NotFoundError

LARGEST_FILE = 512 * 1024
"""Largest uploaded file, bytes."""
MOST_FILES = 200
"""Number of files that are kept, the newest."""
LONGEST_NAME = 120
_REFERENCE = re.compile(r"[0-9a-f]{16}/[^/\\\0#]+(#.*)?")

Asked = TypeVar("Asked", bound=Request)


class FileStore:
    """Keeps files until the server ends."""

    def __init__(self) -> None:
        self._temporary = tempfile.TemporaryDirectory(prefix="torquebench-")
        self.folder = Path(self._temporary.name)

    def close(self) -> None:
        """Remove all files."""
        self._temporary.cleanup()

    def add(self, content: bytes, name: str = "") -> str:
        """Store a file and return its reference; of its name only the last part is used.

        Raises
        ------
        InputError
            The file is too large.
        """
        if len(content) > LARGEST_FILE:
            raise InputError(
                Message("an upload of {count} bytes", len(content)),
                Message("at most {limit} bytes of a file", LARGEST_FILE),
                "evaluate a larger file by the command line",
            )
        reference = self._new(name)
        (self.folder / reference).write_bytes(content)
        return reference

    def _new(self, name: str) -> str:
        """Make a folder for a file, and remove the oldest ones."""
        kept = sorted(self.folder.iterdir(), key=os.path.getmtime)
        for old in kept[: max(0, len(kept) - MOST_FILES + 1)]:
            shutil.rmtree(old)
        plain = "".join(c if c.isprintable() and c not in '/\\#:*?"<>|,' else "_" for c in name)
        plain = plain.strip(". ")[-LONGEST_NAME:] or "table.csv"
        folder = secrets.token_hex(8)
        (self.folder / folder).mkdir()
        return f"{folder}/{plain}"

    def has(self, reference: str) -> bool:
        """Return whether a file is still kept."""
        return bool(_REFERENCE.fullmatch(reference)) and (self.folder / reference).is_file()

    def path(self, reference: str) -> Path:
        """Return the path of a stored file.

        Raises
        ------
        NotFoundError
            There is no such file.
        """
        path = self.folder / reference.partition("#")[0]
        if not _REFERENCE.fullmatch(reference) or not path.is_file():
            raise NotFoundError(
                Message("no file {name!r}", reference[:LONGEST_NAME]),
                "a file that was handed in",
                "hand it in again",
            )
        return path

    def checked(self, request: Asked, *, absolute: bool) -> Asked:
        """Return a request with all files checked, and places for the files to be written.

        The places are absolute for work that isn't done in the folder.

        Raises
        ------
        NotFoundError
            A file wasn't handed in.
        """
        written: dict[str, Any] = {}
        for each in parameters(type(request)):
            value = getattr(request, each.name)
            if each.local or value is None:
                continue
            several = isinstance(value, tuple)
            paths: tuple[Any, ...] = value if several else (value,)
            if each.output:
                root = self.folder if absolute else Path()
                places = tuple(root / self._new(path.name) for path in paths)
                written[each.name] = places if several else places[0]
            elif each.kind == "path":
                for path in paths:
                    self.path(str(path))
            elif each.file and re.search(r"[/\\]", value):
                self.path(value)
        return request.model_copy(update=written)

    def named(self, result: Result) -> Result:
        """Return a result whose files are those that exist here."""
        here = tuple(each for each in result.files if _REFERENCE.fullmatch(each))
        return result if here == result.files else replace(result, files=here)

    def copied(self, result: Result) -> Result:
        """Return the result of an operation of the bench with copies of its files."""
        written = [Path(name) for name in result.files]
        references = []
        for path in (path for path in written if path.is_absolute() and path.is_file()):
            if path.parent.parent == self.folder:
                references.append(path.relative_to(self.folder).as_posix())
                continue
            references.append(self._new(path.name))
            shutil.copyfile(path, self.folder / references[-1])
        return replace(result, files=tuple(references))


@dataclass(frozen=True)
class KnownNames:
    """The profiles and reducers of one request, for another process."""

    known: Mapping[str, Any]

    @classmethod
    def of(cls, library: Any, request: Request) -> KnownNames:
        """Look up the names in a request."""
        known = {}
        for each in parameters(type(request)):
            kind = each.names.partition(":")[0]
            if kind in ("profiles", "reducers") and (name := getattr(request, each.name)):
                known[name] = (library.profile if kind == "profiles" else library.reducer)(name)
        return cls(known)

    def profile(self, name: str) -> Any:
        """Return a profile."""
        return self.known[name]

    turning = reducer = profile
