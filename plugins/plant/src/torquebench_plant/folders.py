"""Sealed run folders on a share or in an object store, by fsspec.

``file://`` is a mounted share, ``s3://`` an S3 store (by Arrow's client); other protocols work if a
library for fsspec is installed.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from torquebench.atomic_write import replacing
from torquebench.errors import InputError, RecordError
from torquebench.message import Message
from torquebench.records import EDGE_ARCHIVE, MANIFEST

__all__ = ["FolderStore", "PushedFolder"]

BLOCK = 4 * 2**20
STAYS = (EDGE_ARCHIVE,)
"""Raw edges are too large to send; they stay on the bench."""


@dataclass(frozen=True)
class PushedFolder:
    """A run folder that was copied to the plant's store.

    Parameters
    ----------
    url : str
        URL of the folder in the store.
    size : int
        Number of copied bytes.
    left_out : tuple of str
        Names of files that remain at the bench.
    """

    url: str
    size: int
    left_out: tuple[str, ...]


class FolderStore:
    """Storage of a plant's sealed run folders.

    Parameters
    ----------
    url : str
        ``file:///srv/plant``, ``s3://bucket/folder`` or another URL of fsspec. Keys of an S3 store
        come from the usual places (``AWS_ACCESS_KEY_ID``, ``~/.aws``), its address from
        ``AWS_ENDPOINT_URL``.

    Raises
    ------
    InputError
        The protocol isn't known, or its library isn't installed.
    """

    def __init__(self, url: str) -> None:
        self.url = url.rstrip("/")
        self.protocol = urlsplit(url).scheme or "file"
        self._fs = _filesystem(self.url, self.protocol)

    def path(self, url: str) -> str:
        """Return the path in the store's file system for a URL."""
        parts = urlsplit(url)
        return parts.path if self.protocol == "file" else f"{parts.netloc}{parts.path}"

    def duckdb_path(self, url: str) -> str:
        """Return the path by which DuckDB reads a URL of this store; see `offer_to`."""
        return self.path(url) if self.protocol == "file" else f"plant://{self.path(url)}"

    def offer_to(self, connection: Any) -> None:
        """Let a DuckDB connection read this store through this process's client."""
        if self.protocol != "file":
            connection.register_filesystem(_offered(self._fs))

    def read(self, url: str) -> bytes:
        """Return the content of a file.

        Raises
        ------
        RecordError
            The file doesn't exist, or the store doesn't answer.
        """
        try:
            with self._fs.open(self.path(url), "rb") as file:
                content: bytes = file.read()
                return content
        except OSError as error:
            raise RecordError(
                Message("{path} can't be read: {problem}", url, error),
                "a file in the plant's store",
            ) from error

    def put(self, url: str, content: bytes) -> None:
        """Write a file completely or not at all."""
        self._write(url, io.BytesIO(content))

    def push(self, folder: Path, manifest_sha256: str, url: str) -> PushedFolder:
        """Copy a sealed run folder, and check each file against the manifest.

        The manifest is copied last: a folder without a manifest is incomplete and is sent again.

        Raises
        ------
        RecordError
            A file doesn't match its seal, or the store refuses it.
        """
        sealed = (folder / MANIFEST).read_bytes()
        if hashlib.sha256(sealed).hexdigest() != manifest_sha256:
            raise RecordError(
                Message("{folder} was changed after the run was registered", folder / MANIFEST),
                Message("SHA-256 {sha256}", manifest_sha256),
                "torquebench records restore brings it back from a backup",
            )
        files: Mapping[str, Mapping[str, Any]] = json.loads(sealed)["files"]
        size = len(sealed)
        for name, entry in files.items():
            if name in STAYS:
                continue
            size += int(entry["bytes"])
            with (folder / name).open("rb") as file:
                self._write(f"{url}/{name}", file, str(entry["sha256"]))
        self.put(f"{url}/{MANIFEST}", sealed)
        return PushedFolder(url, size, tuple(name for name in files if name in STAYS))

    def manifest(self, url: str, manifest_sha256: str) -> bytes:
        """Return the manifest of an arrived folder.

        Raises
        ------
        RecordError
            The manifest can't be read, or its hash isn't the one in the chain.
        """
        sealed = self.read(f"{url}/{MANIFEST}")
        if hashlib.sha256(sealed).hexdigest() != manifest_sha256:
            raise RecordError(
                Message("{url}/{manifest} has another hash than the chain states", url, MANIFEST)
            )
        return sealed

    def verify(self, url: str, manifest_sha256: str) -> list[str]:
        """Return the differences of an arrived folder from its seal."""
        try:
            sealed = self.manifest(url, manifest_sha256)
        except RecordError as error:
            return [error.found]
        problems = []
        for name, entry in json.loads(sealed)["files"].items():
            if name in STAYS:
                continue
            try:
                found = self._sha256(f"{url}/{name}")
            except OSError as error:
                problems.append(f"{url}/{name} can't be read: {error}")
                continue
            if found != entry["sha256"]:
                problems.append(f"{url}/{name} was changed")
        return problems

    def _sha256(self, url: str) -> str:
        digest = hashlib.sha256()
        with self._fs.open(self.path(url), "rb") as file:
            while block := file.read(BLOCK):
                digest.update(block)
        return digest.hexdigest()

    def _write(self, url: str, source: Any, sha256: str = "") -> None:
        try:
            digest = hashlib.sha256()
            with self._writing(self.path(url)) as file:
                while block := source.read(BLOCK):
                    digest.update(block)
                    file.write(block)
                if sha256 and digest.hexdigest() != sha256:
                    raise RecordError(
                        Message("{source} was changed after sealing", getattr(source, "name", url)),
                        Message("SHA-256 {sha256}", sha256),
                        "torquebench records restore brings it back from a backup",
                    )
        except OSError as error:
            raise RecordError(
                Message("{url} can't be written: {error}", url, error),
                "a store that can be reached and written",
                "arrived folders are kept; push again later",
            ) from error

    @contextlib.contextmanager
    def _writing(self, target: str) -> Iterator[Any]:
        """Yield a file that appears in the store only if the block ends without error."""
        if self.protocol == "file":
            self._fs.makedirs(Path(target).parent.as_posix(), exist_ok=True)
            with replacing(Path(target)) as part, part.open("wb") as file:
                yield file
            return
        try:
            with self._fs.open(target, "wb") as file:
                yield file
        except RecordError:
            self._fs.rm(target)
            raise


def _filesystem(url: str, protocol: str) -> Any:
    import fsspec

    if protocol == "s3":
        from fsspec.implementations.arrow import ArrowFSWrapper
        from pyarrow.fs import S3FileSystem

        endpoint = os.environ.get("AWS_ENDPOINT_URL_S3") or os.environ.get("AWS_ENDPOINT_URL")
        options: dict[str, Any] = {"allow_bucket_creation": False}
        if endpoint:
            parts = urlsplit(endpoint)
            options |= {"endpoint_override": parts.netloc, "scheme": parts.scheme}
            options["region"] = os.environ.get("AWS_REGION") or "us-east-1"
        return ArrowFSWrapper(S3FileSystem(**options))
    try:
        return fsspec.filesystem(protocol)
    except (ValueError, ImportError) as error:
        raise InputError(
            Message("folders in {url}: {error}", url, error),
            "file:///… or s3://…, or an installed fsspec library",
        ) from error


def _offered(store: Any) -> Any:
    """Return a file system for DuckDB: ``plant://`` and a path of the store."""
    from fsspec import AbstractFileSystem

    class Offered(AbstractFileSystem):
        protocol = "plant"
        cachable = False

        def _open(self, path: str, mode: str = "rb", **_options: Any) -> Any:
            return store.open(path, mode)

        def info(self, path: str, **_options: Any) -> Any:
            return store.info(self._strip_protocol(path))

        def modified(self, path: str) -> Any:
            return store.modified(self._strip_protocol(path))

        def glob(self, path: str, **_options: Any) -> list[str]:
            return [path]  # DuckDB requests only complete names, never patterns

    return Offered()
