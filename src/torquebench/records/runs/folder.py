"""The folder of one run: its documents, raw samples and results, sealed by a manifest."""

from __future__ import annotations

import hashlib
import json
import os
import re
import secrets
import shutil
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import torquebench
from torquebench.atomic_write import atomic_write, create_private, private_folder, sync_folder
from torquebench.errors import InputError, RecordError, TorquebenchError
from torquebench.message import Message
from torquebench.records.files import (
    EDGE_STREAM,
    UNREADABLE,
    json_text,
    read_json,
    read_object,
    revived,
    sha256_of_file,
    with_messages,
)
from torquebench.records.runs.event_lines import (
    Damage,
    ReadLines,
    checked_line,
    read_lines,
    with_copies,
)

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from torquebench.records.edges.stream import RecordedEdges
    from torquebench.records.streams.raw_stream import RawReading
    from torquebench.signals import EdgeBlock

RunStatus = Literal["completed", "aborted", "failed", "interrupted"]

_METADATA = "run.json"
_EVENTS = "events.jsonl"
_COPIES = "copies.jsonl"
"""File with copies of an unsealed run's metadata, start and descriptors, against damage.
"""
ANNOTATION = "annotation"
"""Name of the documents with notes of people."""
_RUN = "run"
"""Name of the first line, a copy of the metadata."""
_DAMAGED = ".damaged"
"""Suffix of the name under which a damaged file is kept unchanged."""
_RESULTS = "results.json"
MANIFEST = "manifest.json"
"""The file that seals a run folder."""
_RECOVERY = "recovery.json"


def new_run_id(kind: str, started: datetime | None = None) -> str:
    """Return a new identifier of a run: UTC time, kind and four random digits.

    Parameters
    ----------
    kind : str
        Kind of run, such as ``"calibrate-output"``: letters, digits and hyphens.
    started : datetime.datetime, optional
        When it starts, with time zone; now by default.

    Raises
    ------
    InputError
        Where the kind contains characters that a folder's name can't have.

    Examples
    --------
    >>> new_run_id("verify-input", datetime(2025, 1, 31, 12, 0, tzinfo=UTC))
    '20250131T120000Z-verify-input-...'
    """
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9-]*", kind):
        raise InputError(Message("kind of run {kind!r}", kind), "letters, digits and hyphens")
    moment = (started or datetime.now(UTC)).astimezone(UTC)
    return f"{moment:%Y%m%dT%H%M%SZ}-{kind}-{secrets.token_hex(2)}"


@dataclass(frozen=True)
class Recovery:
    """Result of recovering a folder that wasn't sealed.

    Parameters
    ----------
    documents : int
        Complete documents that were kept.
    raw_rows : int
        Complete raw samples that were kept.
    torn_document_bytes, torn_raw_bytes, torn_edge_bytes : int
        Bytes of an incomplete last document, block of samples or block of edges, which were
        removed.
    damages : tuple of Damage
        Damages by which documents were lost. The damaged file is kept as ``events.jsonl.damaged``.
    lost_at_end : int
        Number of lost documents after the last complete one.
    damaged_files : tuple of str
        Files that couldn't be read completely; each is kept unchanged.
    """

    documents: int
    raw_rows: int
    torn_document_bytes: int
    torn_raw_bytes: int
    torn_edge_bytes: int = 0
    damages: tuple[Damage, ...] = ()
    lost_at_end: int = 0
    damaged_files: tuple[str, ...] = ()


class RunWriter:
    """Writes the folder of one run; it can be subscribed to Bluesky's run engine.

    Every document is on the disk when the call returns, so that an acknowledged point survives a
    kill and a power cut. Documents and samples may come from different threads.

    Parameters
    ----------
    path : pathlib.Path
        The run's folder, which must not exist yet.
    metadata : mapping
        Metadata at the start.
    """

    def __init__(self, path: Path, metadata: Mapping[str, Any]) -> None:
        # Imported here, because a list of runs doesn't need Arrow.
        from torquebench.records.edges.stream import EdgeStream
        from torquebench.records.streams.raw_stream import RawStream

        try:
            private_folder(path.parent)
            path.mkdir(mode=0o700)
        except FileExistsError as error:
            raise RecordError(
                Message("{path} exists", path), "a new run", "runs are never overwritten"
            ) from error
        except OSError as error:
            raise RecordError(
                Message("can't create {path}: {strerror}", path, error.strerror)
            ) from error
        self.path = path
        self.folder = RunFolder(path)
        self._lock = threading.Lock()
        self._open = True
        content = {
            **metadata,
            "run_id": path.name,
            "created": datetime.now(UTC),
            "software_version": torquebench.__version__,
        }
        self._lines = 0
        try:
            atomic_write(path / _METADATA, _checked_json(content), private=True)
            sync_folder(path.parent)
            self._events = create_private(path / _EVENTS)
            self._copies = create_private(path / _COPIES)
            self.document(_RUN, content)
        except (OSError, TorquebenchError) as error:
            shutil.rmtree(path, ignore_errors=True)  # an incomplete folder is removed
            remedy = "make room on the disk or repair it"
            raise RecordError(
                Message("can't create {path} ({error})", path, error), "", remedy
            ) from error
        self._raw = RawStream(path / "raw.arrow")
        self._edges = EdgeStream(path / EDGE_STREAM)
        sync_folder(path)

    @property
    def run_id(self) -> str:
        """Identifier of the run: the folder's name."""
        return self.path.name

    def __call__(self, name: str, document: Mapping[str, Any]) -> None:
        """Append one event-model document, as Bluesky's callback; see `document`."""
        self.document(name, document)

    def document(self, name: str, document: Mapping[str, Any]) -> None:
        """Append one event-model document and wait until it is on the disk.

        Parameters
        ----------
        name : str
            ``"start"``, ``"descriptor"``, ``"event"``, ``"stop"`` or another document's name.
        document : mapping
            Its content.

        Raises
        ------
        RecordError
            Where the run is sealed or the disk fails.
        """
        with self._lock:
            self._require_open()
            line = checked_line(self.run_id, self._lines + 1, name, document)
            self._lines += 1  # even a failed write may be on the disk
            try:
                _append(self._events, line)
                if not name.startswith("event"):
                    _append(self._copies, line)
            except OSError as error:
                raise RecordError(
                    Message(
                        "{path}: a document can't be written ({error})", self.path / _EVENTS, error
                    ),
                    "",
                    "check the disk; the run must stop",
                ) from error

    def samples(self, columns: Mapping[str, ArrayLike]) -> None:
        """Append one block of raw samples; it is on the disk within a second.

        Parameters
        ----------
        columns : mapping of str to array, shape (n,), or scalar
            Samples by column; the first call fixes columns and types.

        Raises
        ------
        RecordError
            Where columns differ from those before, the run is sealed, or the disk fails.
        """
        self._raw.append(columns)

    def edges(self, blocks: Mapping[str, EdgeBlock]) -> None:
        """Append the edges of one interval; they are on the disk within a second; see `EdgeStream`.

        Raises
        ------
        RecordError
            Where the run is sealed or the disk fails.
        """
        self._edges.append(blocks)

    @property
    def acknowledged_rows(self) -> int:
        """Number of raw samples that are safely on the disk."""
        return self._raw.acknowledged_rows

    @property
    def acknowledged_tick(self) -> int | None:
        """Tick before which the edges of all channels are on the disk; None before any write."""
        return self._edges.acknowledged_tick

    def write_results(self, results: Any) -> None:
        """Write the run's results to ``results.json``.

        Parameters
        ----------
        results : mapping, dataclass or pydantic model
            The results; arrays become lists.
        """
        self.write_file(_RESULTS, json_text(with_messages(results), indent=2) + "\n")

    def write_file(self, name: str, content: str | bytes) -> Path:
        """Write another file of the run, completely or not at all, and return its path.

        Raises
        ------
        InputError
            If the name isn't a plain file name or is reserved for the folder's own files.
        """
        if name != Path(name).name or name in (
            _METADATA,
            _EVENTS,
            _COPIES,
            MANIFEST,
            "raw.arrow",
            EDGE_STREAM,
        ):
            raise InputError(
                Message("file name {name!r} in a run folder", name),
                "a plain file name that the run folder doesn't use itself",
            )
        with self._lock:
            self._require_open()
            atomic_write(self.path / name, content, private=True)
        return self.path / name

    def write_files(self, contents: Mapping[str, str | bytes]) -> None:
        """Write other files of the run by their names; see `write_file`."""
        for name, content in contents.items():
            self.write_file(name, content)

    def seal(self, status: RunStatus = "completed", reason: str = "") -> RunFolder:
        """Close the run and write its manifest, after which the folder mustn't change.

        Parameters
        ----------
        status : {"completed", "aborted", "failed", "interrupted"}
            How the run ended.
        reason : str
            Why the run wasn't completed.
        """
        self.close()
        _seal(self.path, status, reason)
        return self.folder

    def close(self) -> None:
        """Close all files without sealing; further calls do nothing."""
        with self._lock:
            if not self._open:
                return
            self._open = False
            self._events.close()
            self._copies.close()
        try:
            self._raw.close()
        finally:
            self._edges.close()

    def discard(self) -> None:
        """Remove the whole folder of a run that couldn't be started."""
        self.close()
        shutil.rmtree(self.path, ignore_errors=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _kind: object, error: BaseException | None, _traceback: object) -> None:
        """Seal the folder if it isn't sealed: as completed, or as failed because of the error."""
        if self.folder.sealed:
            return
        if error is None:
            self.seal()
        else:
            self.seal("failed", Message("{name}: {error}", type(error).__name__, error))

    def _require_open(self) -> None:
        if not self._open:
            raise RecordError(
                Message("{name} is closed", self.path), "documents before the run is sealed"
            )


@dataclass(frozen=True)
class RunFolder:
    """The folder of a run that is running, was killed, or is sealed.

    Parameters
    ----------
    path : pathlib.Path
        The folder.
    """

    path: Path

    @classmethod
    def create(
        cls, runs: Path, metadata: Mapping[str, Any], *, kind: str, run_id: str | None = None
    ) -> RunWriter:
        """Create the folder of a new run and return its writer.

        Parameters
        ----------
        runs : pathlib.Path
            Folder of all runs.
        metadata : mapping
            Metadata: operator, serials, profile and its hash, bench, simulated or not.
        kind : str
            Kind of run, such as ``"calibrate-output"``.
        run_id : str, optional
            Identifier; a new one by default.
        """
        identifier = run_id or new_run_id(kind)
        return RunWriter(runs / identifier, {"kind": kind, **metadata})

    @classmethod
    def open(cls, path: Path) -> Self:
        """Return the run in a folder.

        Raises
        ------
        RecordError
            Where the folder contains no run.
        """
        if not (path / _METADATA).is_file():
            raise RecordError(
                Message("no run in {path}", path), Message("a folder with {metadata}", _METADATA)
            )
        return cls(path)

    @property
    def run_id(self) -> str:
        """Identifier of the run: the folder's name when the run began."""
        try:
            if not self.sealed:
                stated = [(_read_checked_json(self.path / _METADATA) or {})["run_id"]]
            else:
                files = (_METADATA, MANIFEST)
                stated = [str(read_json(self.path / each)["run_id"]) for each in files]
        except (RecordError, KeyError, TypeError):  # damaged, or of 0.1.0
            return self.path.name
        return str(stated[0]) if len(set(stated)) == 1 else self.path.name

    @property
    def copy_of(self) -> str:
        """Identifier of the run if the folder was copied or renamed; otherwise empty."""
        return "" if self.run_id == self.path.name else self.run_id

    @property
    def sealed(self) -> bool:
        """Whether the run has ended and has its manifest."""
        return (self.path / MANIFEST).is_file()

    @property
    def metadata(self) -> dict[str, Any]:
        """Metadata at the start.

        In a run that isn't sealed, the checksum is compared; if it is wrong, the copy is read.

        Raises
        ------
        RecordError
            Where neither the file nor its copy can be read.
        """
        path = self.path / _METADATA
        if self.sealed:
            content = read_object(path)
            content.pop("sha256", None)
            return content
        found = _read_checked_json(path)
        if found is None:
            found = next(
                (line.document for line in self._read_lines().lines if line.name == _RUN), None
            )
        if found is None:
            raise RecordError(
                Message("{path} is damaged, and so is its copy in {events}", path, _EVENTS),
                "a file with its checksum",
                "restore the folder from a backup, or measure again",
            )
        return found

    @property
    def recovery(self) -> Recovery | None:
        """Result of the run's recovery; None if its writer sealed it."""
        path = self.path / _RECOVERY
        if not path.exists():
            return None
        known = Recovery.__dataclass_fields__
        content = {name: value for name, value in read_json(path).items() if name in known}
        damages = tuple(Damage(**each) for each in content.pop("damages", ()))
        files = tuple(content.pop("damaged_files", ()))
        return Recovery(**content, damages=damages, damaged_files=files)

    @property
    def damages(self) -> tuple[Damage, ...]:
        """Damages by which documents were lost before the run was sealed."""
        if not self.sealed:
            return self._read_lines().damages
        found = self.recovery
        return () if found is None else found.damages

    @property
    def manifest(self) -> dict[str, Any]:
        """Status, time of sealing, and hash and size of every file."""
        path = self.path / MANIFEST
        try:
            content: dict[str, Any] = revived(read_object(path))
        except UNREADABLE as error:
            raise RecordError(
                Message("{path} can't be read: {problem}", path, error), "a manifest"
            ) from error
        return content

    @property
    def results(self) -> Any:
        """Results of the run; None without results."""
        path = self.path / _RESULTS
        try:
            return revived(read_json(path)) if path.exists() else None
        except UNREADABLE as error:
            raise RecordError(
                Message("{path} can't be read: {problem}", path, error), "results as JSON"
            ) from error

    def documents(self, name: str | None = None) -> Iterator[tuple[str, dict[str, Any]]]:
        """Yield the run's documents with their names.

        From a run that isn't sealed, every document with a correct checksum is read; `damages`
        lists the missing ones. The documents of a sealed run are protected by its manifest; see
        `verify`.

        Parameters
        ----------
        name : str, optional
            Only documents of this name.

        Raises
        ------
        RecordError
            Where a line of a sealed run isn't a document.
        """
        for found, document in self._sealed_documents() if self.sealed else self._open_documents():
            if found != _RUN and name in (None, found):
                yield found, document

    def annotations(self) -> list[dict[str, Any]]:
        """Return the annotations that people made while it was recorded, in the order of time."""
        found = [document for _, document in self.documents(ANNOTATION)]
        return sorted(found, key=lambda each: float(each["bench_time_s"]))

    def points(self) -> Iterator[dict[str, Any]]:
        """Yield the event documents of the acknowledged points, without zeros and other streams."""
        streams = set()
        for name, document in self.documents():
            if name == "descriptor" and document.get("name") == "points":
                streams.add(document["uid"])
            elif name == "event" and document["descriptor"] in streams:
                yield document

    def _open_documents(self) -> Iterator[tuple[str, dict[str, Any]]]:
        for line in self._read_lines().lines:
            yield line.name, line.document

    def _sealed_documents(self) -> Iterator[tuple[str, dict[str, Any]]]:
        path = self.path / _EVENTS
        lines = path.read_bytes().splitlines() if path.exists() else []
        for number, line in enumerate(lines, start=1):
            try:
                entry = json.loads(line)
                found, document = entry["name"], entry["doc"]
            except UNREADABLE as error:
                raise RecordError(
                    Message("{path}, line {number} isn't a document", path, number),
                    'lines of the form {"name": ..., "doc": ...}',
                ) from error
            yield found, document

    def _read_lines(self) -> ReadLines:
        """Return the lines of an unsealed run, including the copies."""
        damaged = self.path / (_EVENTS + _DAMAGED)  # exists after an interrupted recovery
        own = read_lines(
            _content(damaged if damaged.exists() else self.path / _EVENTS), self.run_id
        )
        return with_copies(own, read_lines(_content(self.path / _COPIES), self.run_id).lines)

    def raw(self) -> RawReading:
        """Read the raw samples; an incomplete last block is skipped and reported."""
        from torquebench.records.streams.raw_stream import read_raw

        return read_raw(self.path)

    def edges(self) -> Iterator[RecordedEdges]:
        """Yield the recorded edges, block by block; an incomplete end is skipped."""
        from torquebench.records.edges.archive import read_edges

        return read_edges(self.path)

    def verify(self) -> None:
        """Check every file against the manifest.

        Raises
        ------
        RecordError
            Naming the first file that was changed, removed or added after sealing.
        """
        if not self.sealed:
            raise RecordError(
                Message("{path} isn't sealed", self.path), "a sealed run", "recover it first"
            )
        listed = self.manifest.get("files")
        if not isinstance(listed, dict):
            raise RecordError(Message("{path} lists no files", self.path / MANIFEST), "a manifest")
        present = _files_of(self.path)
        for name, entry in listed.items():
            if name not in present:
                raise RecordError(
                    Message("{path} was removed after sealing", self.path / name), "all files"
                )
            registered = entry.get("sha256") if isinstance(entry, dict) else None
            if sha256_of_file(self.path / name) != registered:
                raise RecordError(
                    Message("{source} was changed after sealing", self.path / name),
                    Message("SHA-256 {sha256}", registered),
                    "restore the file from a backup",
                )
        for name in present:
            if name not in listed:
                raise RecordError(
                    Message("{path} was added after sealing", self.path / name),
                    "the files of the manifest",
                )

    def recover(self) -> Recovery:
        """Seal a folder after a kill or a power cut.

        It is sealed as interrupted, or as completed if it has results, because they are written
        after the last measurement. Documents with a correct checksum and complete samples are kept.
        An incomplete last line or block and damaged parts are removed; ``recovery.json`` reports
        both, and a damaged file is kept unchanged under another name. Missing data aren't replaced.

        Raises
        ------
        RecordError
            Where the folder is sealed already.
        """
        from torquebench.records.edges.stream import damage_to

        if self.sealed:
            raise RecordError(Message("{folder} is sealed", self.path), "a run that wasn't sealed")
        damaged = [*self._recover_metadata()]
        read = self._read_lines()
        documents = b"".join(line.text + b"\n" for line in read.lines)
        if read.damages:
            damaged += _kept_aside(self.path / _EVENTS)
        if documents != _content(self.path / _EVENTS):
            atomic_write(self.path / _EVENTS, documents, private=True)
        for leftover in self.path.glob(".*.part"):
            leftover.unlink()
        last = max((line.number for line in read.lines), default=0)
        report = Recovery(
            sum(line.name != _RUN for line in read.lines),
            0,
            read.torn_bytes,
            0,
            damages=read.damages,
            lost_at_end=sum(each.lines for each in read.damages if each.first_line > last),
        )
        try:
            raw = self.raw()
            report = replace(report, raw_rows=raw.rows, torn_raw_bytes=raw.torn_bytes)
            if raw.damaged:
                damaged += _kept_aside(self.path / "raw.arrow")
        except RecordError:
            damaged += _kept_aside(self.path / "raw.arrow", move=True)
        try:
            torn, blocks = damage_to(self.path / EDGE_STREAM)
            report = replace(report, torn_edge_bytes=torn)
            if blocks:
                damaged += _kept_aside(self.path / EDGE_STREAM)
        except RecordError:
            damaged += _kept_aside(self.path / EDGE_STREAM, move=True)
        report = replace(report, damaged_files=tuple(damaged))
        atomic_write(self.path / _RECOVERY, json_text(report, indent=2) + "\n", private=True)
        if (self.path / _RESULTS).exists() and not report.damages:
            _seal(self.path, "completed", "")
        else:
            _seal(self.path, "interrupted", "the run wasn't closed and was recovered")
        return report

    def _recover_metadata(self) -> Iterator[str]:
        """Restore damaged metadata from its copy, if there is one."""
        path = self.path / _METADATA
        if _read_checked_json(path) is not None:
            return
        try:
            content = self.metadata
        except RecordError:
            yield _METADATA
            return
        yield from _kept_aside(path)
        atomic_write(path, _checked_json(content), private=True)


def _append(file: Any, line: bytes) -> None:
    """Append a line and wait until it is on the disk."""
    written = 0
    while written < len(line):
        written += file.write(line[written:]) or 0
    os.fsync(file.fileno())


def _content(path: Path) -> bytes:
    return path.read_bytes() if path.exists() else b""


def _kept_aside(path: Path, *, move: bool = False) -> Iterator[str]:
    """Keep a damaged file under another name, if none was kept yet; yield its name."""
    kept = path.with_name(path.name + _DAMAGED)
    if move:
        path.replace(kept)
    elif not kept.exists():
        atomic_write(kept, path.read_bytes(), private=True)
    yield path.name


def _checked_json(content: Mapping[str, Any]) -> str:
    """Return content as JSON text that includes its checksum."""
    digest = hashlib.sha256(json_text(content).encode()).hexdigest()
    return json_text({**content, "sha256": digest}, indent=2) + "\n"


def _read_checked_json(path: Path) -> dict[str, Any] | None:
    """Return the content written by `_checked_json`; None if it was changed."""
    try:
        content = json.loads(path.read_bytes())
        digest = content.pop("sha256")
        text = json_text(content).encode()
    except (OSError, RecordError, *UNREADABLE):
        return None
    return content if digest == hashlib.sha256(text).hexdigest() else None


def _files_of(folder: Path) -> list[str]:
    names = (path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    return sorted(name for name in names if name != MANIFEST)


def _seal(folder: Path, status: RunStatus, reason: str) -> None:
    from torquebench.records.edges.archive import seal_edges
    from torquebench.records.streams.raw_stream import seal_raw

    if (folder / MANIFEST).exists():
        raise RecordError(
            Message("{folder} is sealed", folder), "one seal", "records are never overwritten"
        )
    seal_raw(folder)
    seal_edges(folder)
    (folder / _COPIES).unlink(missing_ok=True)  # from here on the manifest protects the metadata
    files = {
        name: {"sha256": sha256_of_file(folder / name), "bytes": (folder / name).stat().st_size}
        for name in _files_of(folder)
    }
    manifest = {
        "run_id": RunFolder(folder).run_id,
        "status": status,
        "reason": reason,
        "sealed": datetime.now(UTC),
        "software_version": torquebench.__version__,
        "files": files,
    }
    atomic_write(
        folder / MANIFEST, json_text(with_messages(manifest), indent=2) + "\n", private=True
    )
