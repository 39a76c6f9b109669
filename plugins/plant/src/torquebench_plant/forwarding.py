"""Store and forward: a bench's records are sent to the plant when the link is up.

A bench always writes to its own registry and folders first. The plant knows the last link of each
bench's hash chain, and sending continues from there; repeated data changes nothing.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from sqlalchemy import text
from sqlalchemy.engine import URL

from torquebench.atomic_write import atomic_write
from torquebench.calibration import OPTIONAL_COLUMNS, REQUIRED_COLUMNS
from torquebench.errors import InputError, RecordError, TorquebenchError
from torquebench.message import Message
from torquebench.progress import NO_PROGRESS, Progress
from torquebench.records import ChainHead, Registry, RunFolder, UnavailableError, json_text
from torquebench.records.registry import (
    DISCARDED,
    Activation,
    CalibrationEntry,
    ModelEntry,
    RunEnd,
)
from torquebench.units import DAY, DAYS_PER_YEAR, HOUR
from torquebench_plant.database import CLOCK_REFUSED_S, CLOCK_WARNED_S, PlantDatabase
from torquebench_plant.folders import FolderStore

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
        Numbers of sent entries and folders.
    size : int
        Bytes of the sent folders.
    withdrawn : list of str
        Messages about local records that the plant has withdrawn.
    problems : list of str
        Folders that couldn't be sent, with reasons; they are sent again next time.
    clock : str
        Message about a wrong clock of the bench; empty if the clock is right.
    """

    bench: str
    head: ChainHead
    entries: int = 0
    folders: int = 0
    size: int = 0
    withdrawn: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    clock: str = ""


@dataclass(frozen=True)
class _Mine:
    """Identity of this bench in the plant, and the lead of its clock over the plant's, s."""

    number: int
    name: str
    plant: str
    folders: str
    first_sha256: str | None
    head: ChainHead
    ahead_s: float


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
            now = connection.scalar(text("SELECT clock_timestamp()"))
            assert now is not None
            ahead_s = (datetime.now(UTC) - now).total_seconds()
            row = connection.execute(text("SELECT * FROM plant.my_bench()")).one_or_none()
        if row is None:
            raise InputError(
                Message("{username} is no bench of the plant {name}", self.url.username, self.name),
                "the URL that `torquebench plant register` printed for this bench",
                "register the bench, or ask the administrator of the plant's registry",
            )
        head = ChainHead(row.head_sequence, row.head_sha256)
        return _Mine(
            row.bench_key, row.name, row.plant, row.folders, row.first_sha256, head, ahead_s
        )

    def append(self, entries: list[dict[str, Any]]) -> ChainHead:
        """Append links of the chain; the plant checks that they continue its last link."""
        query = text("SELECT sequence, sha256 FROM plant.append(CAST(:links AS json))")
        try:
            with self.transaction() as connection:
                row = connection.execute(query, {"links": json.dumps(entries)}).one()
        except RecordError as error:
            if "first_sha256" in str(error.__cause__):
                raise RecordError(
                    "this data directory begins as that of another bench of the plant: it is a "
                    "copy",
                    "one bench, one data directory",
                    "send from the other bench's directory with the other bench's URL; a new "
                    "bench begins with an empty data directory",
                ) from error
            raise
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
        """Report arrived folders with their results; return the number of new folders."""
        query = text("SELECT plant.arrived(CAST(:pushed AS json))")
        with self.transaction() as connection:
            return int(connection.scalar(query, {"pushed": json_text(pushed)}) or 0)

    def withdrawals(self) -> list[tuple[str, str, str]]:
        """Return runs of this bench whose withdrawal by the plant the bench hasn't recorded yet."""
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
        Registry of the bench.
    url : str or sqlalchemy.URL
        The bench's URL of the plant.
    progress : Progress
    told : callable
        Called with each problem.

    Raises
    ------
    UnavailableError
        The link is down; all records remain at the bench.
    RecordError
        The plant's last link isn't in this registry, so another registry was sent before.
    """
    with BenchLink(url) as link:
        mine = link.mine()
        _check_same(registry, mine)
        done = Forwarded(f"{mine.number} {mine.name}", mine.head, clock=_check_clock(mine))
        _send_entries(registry, link, done, progress)
        _note_link(registry, mine, done.head)
        for run_id, by, reason in link.withdrawals():
            done.withdrawn.append(note_withdrawal(registry, run_id, by=by, reason=reason))
        if done.withdrawn:
            _send_entries(registry, link, done, progress)
        _send_folders(registry, link, mine, done, progress, told)
        _note_link(registry, mine, done.head)
    return done


def _check_clock(mine: _Mine) -> str:
    """Return a message if this bench's clock is wrong; refuse a clock that is wrong by a day."""
    if abs(mine.ahead_s) < CLOCK_WARNED_S:
        return ""
    units = ((DAYS_PER_YEAR * DAY, "years"), (DAY, "days"), (HOUR, "h"), (1.0, "s"))
    unit_s, unit = next(each for each in units if abs(mine.ahead_s) >= each[0])
    said = Message(
        "the clock of this bench is {time:.3g} {unit} ahead of the plant's"
        if mine.ahead_s > 0
        else "the clock of this bench is {time:.3g} {unit} behind the plant's",
        abs(mine.ahead_s) / unit_s,
        unit,
    )
    if abs(mine.ahead_s) < CLOCK_REFUSED_S:
        return said
    raise InputError(
        said,
        "a clock within a day of the plant's: it dates what is due and what drifts",
        "set the clock, best by NTP, and send again; the records stay here until then",
    )


def _check_same(registry: Registry, mine: _Mine) -> None:
    """Refuse a registry that doesn't continue what this bench has sent before."""
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
    if first >= end:  # no message each minute if there is nothing to send
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
    """Record in a bench's registry that the plant withdrew a run; return a message.

    A model fitted to this run is taken out of use.
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


# -- results in a folder that the plant uses
# ----------------------------------------------------------

_COLUMNS = (*REQUIRED_COLUMNS, *OPTIONAL_COLUMNS)


@dataclass(frozen=True)
class RunFacts:
    """Results of a run that a plant uses.

    Parameters
    ----------
    specimen_type, serial : str
        Type and serial number of the tested reducer; empty for other runs.
    quantities : tuple of mapping
        Results of a reducer test: quantity, title, value, U, unit, limit, verdict.
    """

    specimen_type: str = ""
    serial: str = ""
    quantities: tuple[Mapping[str, Any], ...] = ()


def facts_of(results: Any) -> RunFacts:
    """Return the facts in the content of a run's ``results.json``.

    Examples
    --------
    >>> facts_of({"reducer": {"name": "RV-40E"}, "serial": "S-1", "quantities": [
    ...     {"key": "backlash", "title": "Backlash", "value": 0.6, "unit": "arcmin",
    ...      "expanded_uncertainty": 0.1}]}).quantities[0]["value"]
    0.6
    >>> facts_of(None)
    RunFacts(specimen_type='', serial='', quantities=())
    """
    if not (isinstance(results, Mapping) and isinstance(results.get("quantities"), list)):
        return RunFacts()
    try:
        return RunFacts(
            specimen_type=str(results["reducer"]["name"]),
            serial=str(results.get("serial") or ""),
            quantities=tuple(
                {
                    "quantity": row["key"],
                    "title": row["title"],
                    "value": row["value"],
                    "expanded_uncertainty": row.get("expanded_uncertainty"),
                    "unit": row.get("unit", ""),
                    "limit": row.get("limit") or "",
                    "verdict": row.get("verdict") or "",
                }
                for row in results["quantities"]
                if row.get("value") is not None
            ),
        )
    except (
        AttributeError,
        KeyError,
        TypeError,
    ):  # unknown content: kept without results
        return RunFacts()


def points_table(results: Any, started: datetime) -> bytes | None:
    """Return the points of a calibration, check or verification as a Parquet file (zstd).

    Return None if the run has no points. Values common to all points (transducer, range) are
    columns, so that thousands of such files form one table.

    Parameters
    ----------
    results : object
        Content of the run's ``results.json``.
    started : datetime.datetime
    """
    data = results.get("data") if isinstance(results, Mapping) else None
    if not (isinstance(data, Mapping) and data.get("reading_nm")):
        return None
    import pyarrow as pa
    import pyarrow.parquet as pq

    count = len(data["reading_nm"])
    columns: dict[str, Any] = {
        name: pa.array(
            data.get(name) or [None] * count,
            pa.int32() if name in ("series", "branch") else pa.float64(),
        )
        for name in _COLUMNS
    }
    constant = {
        "range_nm": pa.scalar(float(data["range_nm"])),
        "side": pa.scalar(str(data.get("side") or "")),
        "transducer_serial": pa.scalar(str(data.get("transducer_serial") or "")),
        "counter_identity": pa.scalar(str(data.get("counter_identity") or "")),
        "started": pa.scalar(started, pa.timestamp("us", tz="UTC")),
    }
    columns |= {name: pa.repeat(value, count) for name, value in constant.items()}
    sink = io.BytesIO()
    pq.write_table(pa.table(columns), sink, compression="zstd")
    return sink.getvalue()
