"""Store and forward: a bench's records are sent to the plant when the link is up.

A bench always writes to its own registry and folders first. The plant knows the last link of each
bench's hash chain, and sending continues from there; repeated data changes nothing.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from sqlalchemy import text
from sqlalchemy.engine import URL

from torquebench.atomic_write import atomic_write
from torquebench.errors import InputError, RecordError, TorquebenchError
from torquebench.message import Message
from torquebench.progress import NO_PROGRESS, Progress
from torquebench.records import Registry, RunFolder, UnavailableError, json_text
from torquebench.records.chain import ChainHead
from torquebench.records.registry import (
    DISCARDED,
    Activation,
    CalibrationEntry,
    ModelEntry,
    RunEnd,
)
from torquebench_plant.database import PlantDatabase
from torquebench_plant.facts import facts_of, points_table
from torquebench_plant.folders import FolderStore

__all__ = ["LINK_FILE", "BenchLink", "Forwarded", "forward", "note_withdrawal"]

LINK_FILE = "plant.json"
"""File in a data directory with the bench's identity in a plant, and the last sent link."""
BATCH = 1000
"""Links in one transaction: an interruption loses at most this many."""
MISSING = 200
"""Number of folders requested at a time."""


@dataclass
class Forwarded:
    """Result of one round of sending.

    Parameters
    ----------
    bench : str
        Number and name of the bench.
    head : ChainHead
        End of the chain at the plant now.
    entries, folders : int
        How many were sent.
    size : int
        Bytes of the folders.
    withdrawn : list of str
        Local records that the plant has withdrawn, in words.
    problems : list of str
        Folders that couldn't be sent, and why; they are tried again next time.
    """

    bench: str
    head: ChainHead
    entries: int = 0
    folders: int = 0
    size: int = 0
    withdrawn: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class _Mine:
    """Identity of this bench in the plant."""

    number: int
    name: str
    plant: str
    folders: str
    first_sha256: str | None
    head: ChainHead


class BenchLink(PlantDatabase):
    """The bench's end of the link to its plant; the URL is the one that `register` printed."""

    def mine(self) -> _Mine:
        """Return this bench's identity in the plant.

        Raises
        ------
        InputError
            The URL belongs to another bench.
        """
        with self.transaction() as connection:
            row = connection.execute(text("SELECT * FROM plant.my_bench()")).one_or_none()
        if row is None:
            raise InputError(
                Message("{username} is no bench of the plant {name}", self.url.username, self.name),
                "the URL that `torquebench plant register` printed for this bench",
                "register the bench, or ask the administrator of the plant's registry",
            )
        head = ChainHead(row.head_sequence, row.head_sha256)
        return _Mine(row.bench_key, row.name, row.plant, row.folders, row.first_sha256, head)

    def append(self, entries: list[dict[str, Any]]) -> ChainHead:
        """Append links of the chain; the plant checks that they continue its last link."""
        query = text("SELECT sequence, sha256 FROM plant.append(CAST(:links AS json))")
        with self.transaction() as connection:
            row = connection.execute(query, {"links": json.dumps(entries)}).one()
        return ChainHead(row.sequence, row.sha256)

    def missing_folders(self) -> list[tuple[str, str]]:
        """Return sealed runs whose folders haven't arrived, with the hash of their manifest."""
        with self.transaction() as connection:
            rows = connection.execute(
                text("SELECT run_id, manifest_sha256 FROM plant.my_missing_folders(:most)"),
                {"most": MISSING},
            )
            return [(row.run_id, row.manifest_sha256) for row in rows]

    def arrived(self, pushed: list[dict[str, Any]]) -> int:
        """Report arrived folders with their facts; return the number of new ones."""
        query = text("SELECT plant.arrived(CAST(:pushed AS json))")
        with self.transaction() as connection:
            return int(connection.scalar(query, {"pushed": json_text(pushed)}) or 0)

    def withdrawals(self) -> list[tuple[str, str, str]]:
        """Return runs of this bench that the plant withdrew and the bench doesn't know of."""
        with self.transaction() as connection:
            rows = connection.execute(text("SELECT * FROM plant.my_withdrawals()"))
            return [(row.run_id, row.withdrawn_by, row.reason) for row in rows]


def forward(
    registry: Registry,
    url: str | URL,
    progress: Progress = NO_PROGRESS,
    *,
    told: Callable[[str], None] = lambda _said: None,
) -> Forwarded:
    """Send the plant everything that it doesn't have yet, and apply its withdrawals.

    May be interrupted anywhere and restarted: it continues from the end of the chain in the plant.

    Parameters
    ----------
    registry : Registry
        Of the bench.
    url : str or sqlalchemy.URL
        The bench's URL of the plant.
    progress : Progress
    told : callable
        Called with each problem.

    Raises
    ------
    UnavailableError
        The link is down; everything stays with the bench.
    RecordError
        The plant's end of the chain isn't in this registry: it isn't the one that was sent so far.
    """
    with BenchLink(url) as link:
        mine = link.mine()
        _check_same(registry, mine)
        done = Forwarded(f"{mine.number} {mine.name}", mine.head)
        _send_entries(registry, link, done, progress)
        _note_link(registry, mine, done.head)
        for run_id, by, reason in link.withdrawals():
            done.withdrawn.append(note_withdrawal(registry, run_id, by=by, reason=reason))
        if done.withdrawn:
            _send_entries(registry, link, done, progress)
        _send_folders(registry, link, mine, done, progress, told)
        _note_link(registry, mine, done.head)
    return done


def _check_same(registry: Registry, mine: _Mine) -> None:
    """Refuse a registry other than the one that this bench has sent so far."""
    noted = _noted(registry.root)
    if noted and (noted["plant"], noted["number"]) != (mine.plant, mine.number):
        raise InputError(
            Message(
                "{root} was sent to a plant as bench {number} {name}, and this URL is "
                "that of bench {mine_number} {mine_name}",
                registry.root,
                noted["number"],
                noted["name"],
                mine.number,
                mine.name,
            ),
            "one bench, one data directory",
            Message(
                "use the URL of bench {number}, or the data directory of bench {mine_number}",
                noted["number"],
                mine.number,
            ),
        )
    if mine.head.sequence and not registry.passes_through(mine.head):
        last = registry.head().sequence
        raise RecordError(
            Message(
                "the plant has {sequence} entries of bench {number} {name}, and this "
                "registry, which ends with entry {last}, doesn't have the last of them",
                mine.head.sequence,
                mine.number,
                mine.name,
                last,
            ),
            "the registry that was sent so far",
            Message(
                "restore it from a backup that has that entry, or, if it was rebuilt, "
                "register it with `torquebench plant register --replaces {number}`",
                mine.number,
            ),
        )


def _send_entries(registry: Registry, link: BenchLink, done: Forwarded, progress: Progress) -> None:
    end = registry.head().sequence
    first = done.head.sequence
    if first >= end:  # nothing to say, each minute
        return
    progress.start("Sending entries", end - first)
    while done.head.sequence < end:
        after = done.head.sequence
        entries = [vars(each) for each in registry.links(after, BATCH)]
        done.head = link.append(entries)
        if done.head.sequence <= after:
            raise RecordError(
                Message("the plant accepted no entry after {after}", after),
                "entries that continue its chain",
            )
        done.entries += len(entries)
        progress.reach(done.head.sequence - first)
    progress.finish()


def _send_folders(
    registry: Registry,
    link: BenchLink,
    mine: _Mine,
    done: Forwarded,
    progress: Progress,
    told: Callable[[str], None],
) -> None:
    store = FolderStore(mine.folders)
    root = f"{store.url}/{mine.number}-{_folder_name(mine.name)}"
    tried: set[str] = set()
    while True:
        missing = [each for each in link.missing_folders() if each[0] not in tried]
        if not missing:
            break
        progress.start("Sending run folders", len(missing))
        for number, (run_id, manifest) in enumerate(missing, 1):
            tried.add(run_id)
            try:
                run = registry.run(run_id)
                pushed = store.push(run.folder, manifest, f"{root}/runs/{run_id}")
                results = RunFolder.open(run.folder).results
                points, points_url = points_table(results, run.started), ""
                if points is not None:
                    points_url = f"{root}/points/{run_id}.parquet"
                    store.put(points_url, points)
            except UnavailableError:
                raise
            except (OSError, TorquebenchError) as error:
                problem = f"run {run_id}: {getattr(error, 'found', '') or error}"
                done.problems.append(problem)
                told(problem)
                continue
            link.arrived(
                [
                    {
                        "run_id": run_id,
                        "manifest_sha256": manifest,
                        "url": pushed.url,
                        "points_url": points_url or None,
                        "bytes": pushed.size,
                        "left_out": pushed.left_out,
                        "facts": facts_of(results),
                    }
                ]
            )
            done.folders += 1
            done.size += pushed.size
            progress.reach(number)
        progress.finish()


def _folder_name(name: str) -> str:
    kept = "".join(mark if mark.isascii() and mark.isalnum() else "-" for mark in name)
    return "-".join(part for part in kept.split("-") if part)[:40] or "bench"


def _noted(data_dir: Path) -> dict[str, Any]:
    try:
        content: dict[str, Any] = json.loads((data_dir / LINK_FILE).read_bytes())
    except (FileNotFoundError, ValueError):
        return {}
    return content


def _note_link(registry: Registry, mine: _Mine, head: ChainHead) -> None:
    content = {
        "plant": mine.plant,
        "number": mine.number,
        "name": mine.name,
        "sent": str(head),
        "at": datetime.now(UTC),
    }
    atomic_write(registry.root / LINK_FILE, json_text(content, indent=2) + "\n")


def note_withdrawal(registry: Registry, run_id: str, *, by: str, reason: str) -> str:
    """Enter at a bench that the plant withdrew one of its runs; return a message.

    A model that was fitted to it is taken out of use.
    """
    with registry.writing():
        (end,) = registry.entries(RunEnd, run_key=registry.run(run_id).number)
        registry.amend(
            "run_ends", end.number, {"status": DISCARDED}, amended_by=by, reason=f"plant: {reason}"
        )
        said = f"run {run_id} withdrawn by {by}: {reason}"
        fitted = [
            model
            for calibration in registry.entries(CalibrationEntry, run_id=run_id)
            for model in registry.entries(ModelEntry, calibration_id=calibration.calibration_id)
        ]
        for model in fitted:
            chain = model.transducer_serial, model.counter_identity
            history = registry.entries(
                Activation, transducer_serial=chain[0], counter_identity=chain[1]
            )
            if history and history[-1].model_id == model.model_id:
                because = f"run {run_id} was withdrawn: {reason}"
                registry.deactivate(*chain, operator=by, reason=because)
                said += f"; model-{model.model_id} is out of use, calibrate again"
    return said
