"""Perform several operations one after the other, from a file; the panel has a similar queue."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as dataclass_field
from pathlib import Path
from typing import Annotated, Any

from torquebench.errors import InputError, TorquebenchError
from torquebench.message import Message
from torquebench.operations.catalogue import find_operation
from torquebench.operations.operation import Flag, Operation, Request, field
from torquebench.operations.place import EndedError, Place
from torquebench.operations.preview import Preview, joined_previews
from torquebench.operations.result import HIDDEN, Result
from torquebench.progress import Progress
from torquebench.reports.page import Page, Section, Table
from torquebench.validation import parse_toml, validated


class QueuedRequest(Request):
    """An entry of the queue: an operation and the fields of its request."""

    name: Annotated[str, field("Name of the operation.", max_length=100)]
    request: Annotated[dict[str, Any], field("Fields of its request.")] = {}  # noqa: RUF012 - pydantic copies it


class QueueFile(Request):
    """Operations in their order."""

    operation: Annotated[
        tuple[QueuedRequest, ...], field("The operations.", min_length=1, max_length=500)
    ]


class RunRequest(Request):
    """Perform several operations on one bench, one after the other.

    The TOML file has a table [[operation]] for each: `name = "calibrate"` and
    `request = {side = "both"}` with the fields that the operation has in the HTTP API. All are
    validated before the first begins. An error ends the queue, and so does a check that fails.
    """

    queue: Annotated[Path, field("The TOML file.", argument=True, local=True)]
    keep_going: Annotated[Flag, field("Continue after a failed check; never after an error.")] = (
        False
    )


@dataclass(frozen=True)
class QueuedResult:
    """One operation of the queue; `result` is null if it failed or wasn't started."""

    name: str
    title: str
    headline: str
    failed: bool
    result: Any


@dataclass(frozen=True, kw_only=True)
class QueueResult(Result):
    """The operations of a queue."""

    operations: Sequence[QueuedResult]
    results: Sequence[Any] = dataclass_field(metadata=HIDDEN)

    @property
    def failed(self) -> bool:
        """Whether any operation failed or wasn't started."""
        return any(each.failed for each in self.operations)

    def page(self) -> Page:
        """Return a page: a table of the operations, followed by their results."""
        rows = [(each.title, each.headline) for each in self.operations]
        sections = [Section("", "", [Table(("operation", "result"), rows, words=True)])]
        for result in self.results:
            page = result.page()
            first, *others = page.sections
            sections += [replace(first, heading=page.title), *others]
        return Page("Queue", "", sections, simulated=self.simulated)


def queued_operation(
    name: str, request: Mapping[str, Any], *, local: bool = False
) -> tuple[Operation, Request]:
    """Return an operation that a queue may contain, and its validated request.

    Raises
    ------
    InputError
        The operation doesn't exist, needs a person's password, or its request is invalid.
    """
    operation = find_operation(name)
    if not operation.served or (operation.signed and not local):
        raise InputError(
            Message("{name} in a queue", operation.name), "an operation that needs no signature"
        )
    if not local and (own := [each for each in operation.local_fields if each in request]):
        raise InputError(
            Message("{name}: {fields}", operation.name, ", ".join(own)), "fields of the HTTP API"
        )
    return operation, validated(operation.request, request, operation.name)


def _entries(path: Path) -> list[tuple[Operation, Request]]:
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            Message("{path}: {error}", path, reason), "a readable TOML file in UTF-8"
        ) from error
    listed = validated(QueueFile, parse_toml(text, str(path)), str(path)).operation
    entries = []
    for number, each in enumerate(listed, start=1):
        try:
            entries.append(queued_operation(each.name, each.request, local=True))
        except InputError as error:
            raise InputError(
                Message("{path}, operation {number}: {found}", path, number, error.found),
                error.allowed,
                error.remedy,
            ) from error
    return entries


def check_queue(_place: Place, request: RunRequest) -> Sequence[str]:
    """Raise an error for invalid requests; the bench is checked later, before each operation."""
    _entries(request.queue)
    return ()


def preview_queue(place: Place, request: RunRequest) -> Preview:
    """Rehearse every operation; one that needs an earlier one's results gives a remark."""
    previews, remarks = [], []
    for operation, each in _entries(request.queue):
        title = operation.title(each)
        try:
            operation.doubts(place, each)
            if operation.preview is not None:
                previews.append(operation.preview(place, each))
                continue
        except TorquebenchError as error:
            remarks.append(Message("{title}, at present: {found}.", title, error.found))
        previews.append(Preview(title, 0.0, 0))
    title = Message("{count} operations", len(previews))
    shown = replace(joined_previews(previews, title), title=title)
    return replace(shown, remarks=(*shown.remarks, *remarks))


def run_queue(place: Place, request: RunRequest, progress: Progress) -> QueueResult:
    """Perform the operations until one fails."""
    from torquebench.campaign import RunAbortedError

    entries = _entries(request.queue)
    done: list[QueuedResult] = []
    results: list[Result] = []
    ended = False
    for number, (operation, each) in enumerate(entries, start=1):
        name, title = operation.name, operation.title(each)
        if ended:
            done.append(QueuedResult(name, title, "not begun", failed=True, result=None))
            continue
        progress.start(Message("{number} of {count}: {title}", number, len(entries), title))
        place.check()
        try:
            operation.doubts(place, each)
            result = operation.run(place, each, progress)
        except (RunAbortedError, EndedError):
            raise
        except TorquebenchError as error:
            words = Message.joined(filter(None, (error.found, error.remedy)), "; ")
            done.append(QueuedResult(name, title, words, failed=True, result=None))
            ended = True
            continue
        results.append(result)
        done.append(QueuedResult(name, title, result.headline, result.failed, result.plain()))
        ended = result.failed and not request.keep_going
    return QueueResult(
        headline=Message("{done} of {count} operations are done.", len(results), len(entries)),
        simulated=place.station.description.simulated,
        run_ids=tuple(dict.fromkeys(run for each in results for run in each.run_ids)),
        remarks=tuple(remark for each in results for remark in each.remarks),
        files=tuple(file for each in results for file in each.files),
        operations=done,
        results=results,
    )


RUN = Operation(
    "run",
    RunRequest,
    run_queue,
    lambda request: Message("Queue {name}", request.queue.name),
    preview_queue,
    check_queue,
    where="bench",
    local=True,
    moves=True,
    loads=True,
    can_pause=True,
    activates=True,
)
