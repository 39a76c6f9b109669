"""Re-evaluation of all recorded runs: on one processor, on all, or on a cluster."""

from __future__ import annotations

import hashlib
import json
import logging
import tempfile
import traceback
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import Any, Protocol

from sqlalchemy import insert, text

from torquebench import __version__
from torquebench.calibration import RAW
from torquebench.errors import InputError, RecordError, TorquebenchError
from torquebench.message import Message
from torquebench.progress import NO_PROGRESS, Progress
from torquebench.records import MANIFEST
from torquebench.uncertainty import Verdict
from torquebench_plant.database import Plant
from torquebench_plant.folders import FolderStore
from torquebench_plant.questions import Answer
from torquebench_plant.schema import reevaluations

# -- one run, the same on any computer ------------------------------------------------------------

BUDGETS_ONLY = "no recording: only U and verdicts, from the stored budgets"
"""Remark about a reducer test whose folder has no recording."""


@dataclass(frozen=True)
class SealedFolder:
    """A folder in the plant's store, and the hash of its manifest in the chain."""

    url: str
    manifest_sha256: str


@dataclass(frozen=True)
class RunTask:
    """A run to be evaluated again.

    Parameters
    ----------
    bench_key : int
    run_id, kind : str
    store : str
        URL of the plant's folders.
    folder : SealedFolder
        Folder of the run.
    fitted_to : mapping of str to tuple of str and SealedFolder
        For a check or verification: kind and calibration of its models, by their names in the
        result.
    earlier : mapping of str to float
        Original results, by the names of `Reevaluated.values`.
    """

    bench_key: int
    run_id: str
    kind: str
    store: str
    folder: SealedFolder
    fitted_to: Mapping[str, tuple[str, SealedFolder]] = field(default_factory=dict)
    earlier: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Reevaluated:
    """Results of a run with this version.

    Parameters
    ----------
    bench_key : int
    run_id : str
    values : str
        Names with units to numbers, as canonical JSON: equal bits give equal text.
    problem : str
        Reason for missing results; otherwise empty.
    remark : str
        Remark about values that weren't evaluated again; otherwise empty.
    """

    bench_key: int
    run_id: str
    values: str
    problem: str = ""
    remark: str = ""


def reevaluate_run(task: RunTask) -> Reevaluated:
    """Fit and evaluate one recorded run with this version.

    The original models of a calibration are fitted again; a check or verification is evaluated with
    its models fitted again; a reducer test is evaluated from its recording. For a reducer test of
    version 0.1, which has no recording, U and verdicts are computed again from the stored budgets,
    and `remark` says so. Every file is checked against the manifest first.

    The result doesn't depend on other processes: it uses one thread, no clock and no random
    numbers.

    Returns
    -------
    Reevaluated
        With a `problem` if the run can't be evaluated, so that other runs go on.
    """
    from threadpoolctl import threadpool_limits

    try:
        with threadpool_limits(1):
            values, remark = _evaluated(task)
    except TorquebenchError as error:
        return Reevaluated(task.bench_key, task.run_id, "{}", str(error))
    except Exception as error:  # a folder with unexpected content mustn't stop the other runs
        return Reevaluated(task.bench_key, task.run_id, "{}", _unexpected(error))
    finite = {name: value for name, value in values.items() if abs(value) < float("inf")}
    text = json.dumps(finite, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return Reevaluated(task.bench_key, task.run_id, text, remark=remark)


def _unexpected(error: Exception) -> str:
    """Describe unexpected content: the error, and the file and line that raised it."""
    if isinstance(error, KeyError):
        what = Message("a value {key} is missing", str(error.args[0]) if error.args else "?")
    else:
        what = Message("{name}: {error}", type(error).__name__, str(error) or "without a message")
    last = traceback.extract_tb(error.__traceback__)[-1]
    return Message(
        "unexpected content ({what}; {file}, line {line})", what, Path(last.filename).name,
        last.lineno,
    )  # fmt: skip


def _evaluated(task: RunTask) -> tuple[dict[str, float], str]:
    store = FolderStore(task.store)
    if task.kind.startswith("test-"):
        return _tested(store, task.folder)
    if task.kind.startswith("calibrate-"):
        return _calibrated(store, task.folder), ""
    return _verified(store, task), ""


def _content(store: FolderStore, folder: SealedFolder, name: str) -> Any:
    return json.loads(_file(store, folder, name))


def _file(store: FolderStore, folder: SealedFolder, name: str) -> bytes:
    """Return a file's content from a sealed folder if its hash is the sealed one."""
    sealed = store.manifest(folder.url, folder.manifest_sha256)
    if name == MANIFEST:
        return sealed
    entry = json.loads(sealed)["files"].get(name)
    if entry is None:
        raise RecordError(
            Message("{url} contains no {name}", folder.url, name), "a run with results"
        )
    content = store.read(f"{folder.url}/{name}")
    if hashlib.sha256(content).hexdigest() != entry["sha256"]:
        raise RecordError(Message("{url}/{name} was changed after sealing", folder.url, name))
    return content


def _measured(store: FolderStore, folder: SealedFolder) -> Any:
    """Return the measured data of a calibration, check or verification, as a `Measured`."""
    from torquebench.campaign.registering import read_measured
    from torquebench.records import RunFolder

    with tempfile.TemporaryDirectory(prefix="torquebench-run-") as place:
        path = Path(place) / folder.url.rpartition("/")[2]
        path.mkdir()
        for name in (MANIFEST, "run.json", "events.jsonl", "results.json"):
            (path / name).write_bytes(_file(store, folder, name))
        return read_measured(RunFolder.open(path))


def _fitted(store: FolderStore, folder: SealedFolder, kind: str | None = None) -> list[Any]:
    """Fit a calibration again: with all models of the original run, or with one kind."""
    from torquebench.campaign.bench_chains import recorded_effects
    from torquebench.campaign.fitting import ModelChoice, fit_models
    from torquebench.compensation import RECOMMENDED
    from torquebench.records import REGISTERS

    measured = _measured(store, folder)
    data, metadata = measured.result.data, measured.record.metadata
    wanted = metadata.get(REGISTERS) or {"models": [{"name": RECOMMENDED}]}
    choices = [ModelChoice(**each) for each in wanted["models"]]
    if kind is not None:
        choices = [each for each in choices if each.name == kind] or [ModelChoice(kind)]
    effects = recorded_effects(metadata, data)
    return [
        (data, each)
        for each in fit_models(data, choices, effects=effects, limits=measured.profile.plausibility)
    ]


def _calibrated(store: FolderStore, folder: SealedFolder) -> dict[str, float]:
    from torquebench.calibration import span_errors
    from torquebench.campaign.fitting import fit_metrics

    values: dict[str, float] = {}
    for data, each in _fitted(store, folder):
        for name, value in fit_metrics(each, data).items():
            if name != "fit_seconds":
                values[f"{each.name} {name}"] = float(value)
        values[f"{each.name} contradictions"] = float(len(each.contradictions))
        for direction, value in span_errors(data).items():
            values[f"span_error_percent {direction}"] = value
    return values


def _verified(store: FolderStore, task: RunTask) -> dict[str, float]:
    from torquebench.calibration import verify

    measured = _measured(store, task.folder)
    chains = {
        name: _fitted(store, folder, kind)[0][1].chain
        for name, (kind, folder) in task.fitted_to.items()
    }
    found = verify(measured.result.data, chains)
    values = {}
    for each in found.models:
        values[f"{each.name} worst_percent_fs"] = each.against_standard.worst_percent_fs
        values[f"{each.name} rms_percent_fs"] = each.against_standard.rms_percent_fs
    return values


def _tested(store: FolderStore, folder: SealedFolder) -> tuple[dict[str, float], str]:
    from torquebench.bench import BenchDescription
    from torquebench.campaign.reducers.recorded import RecordedTest
    from torquebench.records import RECORDING

    results = _content(store, folder, "results.json")  # the original results are those of its seal
    if RECORDING not in _content(store, folder, MANIFEST)["files"]:
        return _budgets(results, folder.url), BUDGETS_ONLY
    recorded = RecordedTest.read(_file(store, folder, RECORDING), f"{folder.url}/{RECORDING}")
    bench = _content(store, folder, "run.json")["bench"]
    values = {}
    for each in recorded.evaluated(BenchDescription.model_validate(bench)).quantities:
        values[f"{each.key} value"] = each.value
        values[f"{each.key} expanded_uncertainty"] = each.expanded_uncertainty
        if each.limit:
            values[f"{each.key} passes"] = float(each.verdict is Verdict.PASS)
    return values, ""


def _budgets(results: Any, url: str) -> dict[str, float]:
    from torquebench.campaign.reducers.results import budget_from_plain
    from torquebench.uncertainty import Tolerance, decide
    from torquebench_plant.statistics import limits_in_words

    rows = results.get("quantities") if isinstance(results, Mapping) else None
    if not isinstance(rows, list):
        raise RecordError(
            Message("{url}: results.json has no quantities of a reducer test", url),
            "a run folder with a recording or with budgets",
        )
    values = {}
    for row in rows:
        if "budget" not in row:
            raise RecordError(
                Message("{url}: no recording, and no budget of {quantity}", url, row["key"]),
                "a run folder with a recording or with budgets",
                "test the specimen again",
            )
        estimate = budget_from_plain(row["budget"])
        expanded = estimate.expanded_uncertainty()
        values[f"{row['key']} value"] = estimate.value
        values[f"{row['key']} expanded_uncertainty"] = expanded
        lower, upper = limits_in_words(row.get("limit") or "")
        if lower is not None or upper is not None:
            decision = decide(
                estimate.value,
                expanded,
                Tolerance(lower, upper),
                degrees_of_freedom=estimate.degrees_of_freedom,
            )
            # A short test passes conditionally at best.
            passes = decision.verdict is Verdict.PASS and not results.get("short")
            values[f"{row['key']} passes"] = float(passes)
    return values


# -- all runs ------------------------------------------------------------------------------------

CHUNK = 8
"""Runs per task: many reduce messages, few reduce the loss after a stop."""
AHEAD = 4
"""Waiting chunks per worker: enough to keep it busy with little memory."""
PATIENCE_S = 30.0
"""Time without results after which the presence of workers is checked, s."""
SAME = 1e-9
"""Largest relative difference of a value that is treated as unchanged."""
PAGE = 1000
"""Runs listed at a time: memory doesn't grow with their number."""
KINDS = ("calibrate", "check", "verify", "test")

_WANTED = """
FROM plant.runs r
JOIN plant.benches b ON b.bench_key = r.bench_key AND b.replaced_by IS NULL
JOIN plant.folders f ON f.bench_key = r.bench_key AND f.run_id = r.run_id
WHERE r.withdrawn IS NULL AND r.status = 'completed'
  AND NOT EXISTS (SELECT 1 FROM plant.reevaluations d WHERE d.label = :label
    AND d.bench_key = r.bench_key AND d.run_id = r.run_id AND d.problem = '')
  AND split_part(r.kind, '-', 1) = ANY(CAST(:kinds AS text[]))
  AND (CAST(:bench AS integer) IS NULL OR r.bench_key = :bench)
"""
_TASKS = f"""
SELECT r.bench_key, r.run_id, r.id, r.kind, r.manifest_sha256, f.url {_WANTED}
  AND (r.bench_key, r.id) > (:after_bench, :after_run)
  AND :tried = EXISTS (SELECT 1 FROM plant.reevaluations t WHERE t.label = :label
    AND t.bench_key = r.bench_key AND t.run_id = r.run_id AND t.id <= :last)
ORDER BY r.bench_key, r.id LIMIT :most
"""
_LAST_ID = "SELECT coalesce(max(id), 0) FROM plant.reevaluations WHERE label = :label"
_KNOWN = """
SELECT count(*) FROM (SELECT DISTINCT bench_key, run_id FROM plant.reevaluations
  WHERE label = :label AND problem = '') AS evaluated
"""
_LAST = """
SELECT DISTINCT ON (bench_key, run_id) * FROM plant.reevaluations WHERE label = :{label}
ORDER BY bench_key, run_id, id DESC
"""
_MODELS = """
SELECT c.run_key, m.kind, m.metrics, c.summary
FROM plant.calibrations c JOIN plant.models m ON m.bench_key = c.bench_key
  AND m.calibration_key = c.id
WHERE c.bench_key = :bench AND c.run_key IS NOT NULL ORDER BY m.id
"""
_FITTED_TO = """
SELECT v.run_key, m.kind, v.summary, f.url, f.manifest_sha256
FROM (SELECT bench_key, run_key, model_key, summary FROM plant.verifications
  UNION ALL SELECT bench_key, run_key, model_key, summary FROM plant.checks) AS v
JOIN plant.models m ON m.bench_key = v.bench_key AND m.id = v.model_key
JOIN plant.calibrations c ON c.bench_key = m.bench_key AND c.id = m.calibration_key
JOIN plant.runs r ON r.bench_key = c.bench_key AND r.id = c.run_key
JOIN plant.folders f ON f.bench_key = r.bench_key AND f.run_id = r.run_id
WHERE v.bench_key = :bench AND v.run_key IS NOT NULL ORDER BY m.id
"""
_QUANTITIES = """
SELECT run_id, quantity, value, expanded_uncertainty, verdict, "limit" FROM plant.results
WHERE bench_key = :bench
"""


@dataclass(frozen=True)
class Reevaluation:
    """Result of a re-evaluation.

    Parameters
    ----------
    label : str
        Label under which the results are stored.
    done, known : int
        Numbers of runs that were evaluated or tried now, and that were evaluated before.
    problems : int
        Number of runs that couldn't be evaluated now.
    """

    label: str
    done: int
    known: int
    problems: int


class _Pool(Protocol):
    def results(self, tasks: Iterator[list[RunTask]]) -> Iterator[list[Reevaluated]]: ...


def reevaluate(
    plant: Plant,
    scheduler: str = "processes",
    *,
    workers: int | None = None,
    label: str = __version__,
    kinds: Sequence[str] = KINDS,
    bench: int | None = None,
    limit: int | None = None,
    progress: Progress = NO_PROGRESS,
) -> Reevaluation:
    """Refit and evaluate recorded runs with this version, and store the results in addition.

    May be interrupted and restarted: results stored under the label aren't repeated, and runs that
    couldn't be evaluated are tried again. Results don't depend on the scheduler, to the last bit.

    Parameters
    ----------
    plant : Plant
        Plant, opened with a role that may write.
    scheduler : str, default "processes"
        ``"serial"``, ``"processes"`` (one a processor), or the address of a Dask cluster whose
        workers have this version and reach the folders.
    workers : int, optional
        Number of processes.
    label : str, optional
        Label of the results; the version by default.
    kinds : sequence of str
        Kinds among ``"calibrate"``, ``"check"``, ``"verify"``, ``"test"``.
    bench : int, optional
        Only this bench.
    limit : int, optional
        Largest number of runs to evaluate.
    progress : Progress

    Raises
    ------
    InputError
        An unknown kind of run, or a cluster that doesn't answer.
    RecordError
        No worker is left, or workers have another version; finished results are kept.
    """
    unknown = sorted(set(kinds) - set(KINDS))
    if unknown:
        raise InputError(Message("kinds of run {unknown}", ", ".join(unknown)), ", ".join(KINDS))
    with plant.transaction() as connection:
        given: dict[str, Any] = {"label": label, "kinds": list(kinds), "bench": bench}
        wanted = connection.scalar(text(f"SELECT count(*) {_WANTED}"), given) or 0
        known = connection.scalar(text(_KNOWN), given)
        given["last"] = connection.scalar(text(_LAST_ID), given)
    wanted = wanted if limit is None else min(wanted, limit)
    progress.start("Evaluating again", max(wanted, 1))
    done = problems = 0
    with _pool(scheduler, workers) as pool:
        earlier: dict[tuple[int, str], RunTask] = {}
        for found in pool.results(_chunks(plant, _listed(plant, given, wanted), earlier)):
            tasks = [earlier.pop((each.bench_key, each.run_id)) for each in found]
            _keep(plant, label, tasks, found)
            done += len(found)
            problems += sum(bool(each.problem) for each in found)
            progress.reach(done)
    progress.finish(
        Message(
            "{done} runs{problems}",
            done,
            Message(", {problems} can't be", problems) if problems else "",
        )
    )
    return Reevaluation(label, done, int(known or 0), problems)


def _listed(plant: Plant, given: Mapping[str, Any], most: int) -> Iterator[Any]:
    """Yield the runs to be evaluated, page by page; those that were tried before come last."""
    for tried in (False, True):
        place = {"tried": tried, "after_bench": 0, "after_run": 0}
        while most > 0:
            with plant.transaction() as connection:
                asked = {**given, **place, "most": min(PAGE, most)}
                page = connection.execute(text(_TASKS), asked).all()
            if not page:
                break
            yield from page
            most -= len(page)
            place |= {"after_bench": page[-1].bench_key, "after_run": page[-1].id}


def _chunks(
    plant: Plant, rows: Iterable[Any], handed: dict[tuple[int, str], RunTask]
) -> Iterator[list[RunTask]]:
    """Yield tasks in chunks, and record the pending ones."""
    store = plant.folders_url
    chunk: list[RunTask] = []
    known: _Bench | None = None
    for row in rows:
        if known is None or known.number != row.bench_key:
            known = _Bench(plant, row.bench_key)
        task = known.task(row, store)
        handed[task.bench_key, task.run_id] = task
        chunk.append(task)
        if len(chunk) == CHUNK:
            yield chunk
            chunk = []
    if chunk:
        yield chunk


class _Bench:
    """Results of one bench at the time of measurement."""

    def __init__(self, plant: Plant, number: int) -> None:
        self.number = number
        self._earlier: dict[Any, dict[str, float]] = {}
        self._fitted_to: dict[int, dict[str, tuple[str, SealedFolder]]] = {}
        given = {"bench": number}
        with plant.transaction() as connection:
            for row in connection.execute(text(_MODELS), given):
                values = self._earlier.setdefault(row.run_key, {})
                for name, value in row.metrics.items():
                    if isinstance(value, int | float) and name != "fit_seconds":
                        values[f"{row.kind} {name}"] = float(value)
                for direction, value in (row.summary.get("span_error_percent") or {}).items():
                    values[f"span_error_percent {direction}"] = float(value)
            for row in connection.execute(text(_FITTED_TO), given):
                folder = SealedFolder(row.url, row.manifest_sha256)
                models = row.summary.get("models") or ()
                names = [each["name"] for each in models if each["name"] != RAW] or [row.kind]
                self._fitted_to.setdefault(row.run_key, {})[names[0]] = row.kind, folder
                values = self._earlier.setdefault(row.run_key, {})
                if "signed_worst_percent_fs" in row.summary:  # of a check
                    worst = abs(float(row.summary["signed_worst_percent_fs"]))
                    values[f"{row.kind} worst_percent_fs"] = worst
                for model in models:
                    for name in ("worst_percent_fs", "rms_percent_fs"):
                        values[f"{model['name']} {name}"] = model["against_standard"][name]
            for row in connection.execute(text(_QUANTITIES), given):
                values = self._earlier.setdefault(row.run_id, {})
                values[f"{row.quantity} value"] = row.value
                if row.expanded_uncertainty is not None:
                    values[f"{row.quantity} expanded_uncertainty"] = row.expanded_uncertainty
                if row.limit and row.verdict:
                    values[f"{row.quantity} passes"] = float(row.verdict == "pass")

    def task(self, row: Any, store: str) -> RunTask:
        tested = row.kind.startswith("test-")
        return RunTask(
            row.bench_key,
            row.run_id,
            row.kind,
            store,
            SealedFolder(row.url, row.manifest_sha256),
            fitted_to=self._fitted_to.get(row.id, {}),
            earlier=self._earlier.get(row.run_id if tested else row.id, {}),
        )


def _keep(plant: Plant, label: str, tasks: Sequence[RunTask], found: Sequence[Reevaluated]) -> None:
    now = datetime.now(UTC)
    content = [
        {
            "bench_key": each.bench_key,
            "run_id": each.run_id,
            "label": label,
            "software_version": __version__,
            "manifest_sha256": task.folder.manifest_sha256,
            "earlier": dict(task.earlier),
            "values": each.values,
            "problem": each.problem,
            "remark": each.remark,
            "evaluated": now,
        }
        for task, each in zip(tasks, found, strict=True)
    ]
    with plant.transaction() as connection:
        connection.execute(insert(reevaluations), content)


def _evaluate_all(tasks: list[RunTask]) -> list[Reevaluated]:
    return [reevaluate_run(task) for task in tasks]


class _Serial:
    def results(self, tasks: Iterator[list[RunTask]]) -> Iterator[list[Reevaluated]]:
        return map(_evaluate_all, tasks)


class _Cluster:
    def __init__(self, client: Any) -> None:
        self._client = client

    def results(self, tasks: Iterator[list[RunTask]]) -> Iterator[list[Reevaluated]]:
        """Yield results as they arrive; at the end evaluate the runs of lost workers one by one.

        Raises
        ------
        RecordError
            No worker is left, or the scheduler doesn't answer.
        """
        suspects: list[tuple[RunTask, str]] = []
        yield from self._together(tasks, suspects)
        for task, _ in tuple(suspects):
            suspects.clear()
            yield from self._together(iter([[task]]), suspects)
            for each, worker in suspects:
                said = Message("its workers were killed, {worker} last; see their log", worker)
                yield [Reevaluated(each.bench_key, each.run_id, "{}", said)]

    def _together(
        self, tasks: Iterator[list[RunTask]], suspects: list[tuple[RunTask, str]]
    ) -> Iterator[list[Reevaluated]]:
        """Yield results as they arrive; add runs whose worker was lost, with the worker's name."""
        from distributed import KilledWorker, wait
        from distributed.client import FutureCancelledError

        running: dict[Any, list[RunTask]] = {}

        def submit(chunks: Iterable[list[RunTask]]) -> None:
            for chunk in chunks:
                # pure=False: a run that failed for a temporary reason has to be evaluated again.
                running[self._client.submit(_evaluate_all, chunk, pure=False)] = chunk

        submit(islice(tasks, AHEAD * max(len(self._client.ncores()), 1)))
        while running:
            try:
                ended = wait(list(running), timeout=PATIENCE_S, return_when="FIRST_COMPLETED")
            except TimeoutError:
                if not self._client.ncores():
                    raise _worker_lost("no worker is left") from None
                continue
            for future in ended.done:
                chunk = running.pop(future)
                try:
                    yield future.result()
                except KilledWorker as error:
                    worker = str(error.last_worker.address)
                    suspects += [(task, worker) for task in chunk]
                except FutureCancelledError as error:
                    raise _worker_lost("the scheduler has gone") from error
                future.release()
                submit(islice(tasks, 1))


def _worker_lost(found: str) -> RecordError:
    return RecordError(
        Message("{found} while runs were evaluated again", found),
        "workers that live until their runs are evaluated",
        "see their log, and whether memory was enough; what is done is kept: the same command "
        "goes on from there, with fewer --workers or --scheduler serial if need be",
    )


@contextmanager
def _pool(scheduler: str, workers: int | None) -> Iterator[_Pool]:
    if scheduler == "serial":
        yield _Serial()
        return
    from distributed import Client, LocalCluster

    if scheduler == "processes":
        with (
            LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                dashboard_address=None,
                silence_logs=logging.ERROR,
            ) as cluster,
            Client(cluster) as client,
        ):
            yield _Cluster(client)
        return
    try:
        client = Client(scheduler, timeout="5s")
    except (OSError, ValueError) as error:
        raise InputError(
            Message("scheduler {scheduler!r}: {error}", scheduler, error),
            "serial, processes, or the address of a Dask cluster such as tcp://server:8786",
        ) from error
    with client:
        versions = set(client.run(_version).values())
        if versions != {__version__}:
            said = ", ".join(sorted(versions)) or "no workers"
            raise RecordError(
                Message("workers of {scheduler} have torquebench {said}", scheduler, said),
                Message("torquebench {version} on every worker", __version__),
                "install this version there, with the extra plant",
            )
        yield _Cluster(client)


def _version() -> str:
    return __version__


def differences(plant: Plant, label: str = __version__, against: str | None = None) -> Answer:
    """Return every value that changed, appeared or disappeared in this evaluation.

    Parameters
    ----------
    plant : Plant
    label : str, optional
        Label of the evaluation; by default of this version.
    against : str, optional
        Label for comparison; by default the original results.
    """
    query = f"""
        SELECT n.bench_key || ' ' || b.name AS bench, n.run_id, n.values, n.problem,
          n.remark, r.kind,
          CASE WHEN CAST(:against AS text) IS NULL THEN n.earlier ELSE o.values::jsonb END AS old
        FROM ({_LAST.format(label="label")}) AS n
        JOIN plant.benches b ON b.bench_key = n.bench_key
        JOIN plant.runs r ON r.bench_key = n.bench_key AND r.run_id = n.run_id
        LEFT JOIN ({_LAST.format(label="against")}) AS o
          ON o.bench_key = n.bench_key AND o.run_id = n.run_id
        ORDER BY n.bench_key, n.run_id
    """
    columns: dict[str, list[Any]] = {
        name: [] for name in ("bench", "run", "what", "earlier", "now", "change")
    }
    runs = problems = compared = changed = 0
    remarks: Counter[str] = Counter()

    def add(row: Any, what: str, *values: float | None) -> None:
        for name, value in zip(columns, (row.bench, row.run_id, what, *values), strict=True):
            columns[name].append(value)

    with plant.transaction() as connection:
        rows = connection.execution_options(yield_per=1000).execute(
            text(query), {"label": label, "against": against}
        )
        for row in rows:
            runs += 1
            if row.problem:
                problems += 1
                add(row, Message("can't be evaluated: {problem}", row.problem), None, None, None)
                continue
            if row.remark:
                remarks[row.remark] += 1
            old, new, differs = row.old or {}, json.loads(row.values), False
            # Runs other than tests didn't store every value at the time of measurement.
            added = new if old and row.kind.startswith("test-") else ()
            for what in dict.fromkeys((*added, *old)):
                before, now = old.get(what), new.get(what)
                if before is None or now is None:
                    differs = True
                    add(row, what, before, now, None)
                    continue
                compared += 1
                if abs(now - before) > SAME * max(abs(now), abs(before)):
                    differs = True
                    add(row, what, float(before), now, now - before)
            changed += differs
    notes = [
        Message("{many} run: {said}" if many == 1 else "{many} runs: {said}", many, said)
        for said, many in sorted(remarks.items())
    ]
    if not runs:
        notes.append(Message("nothing was evaluated as {label}", label))
    return Answer(
        Message("Evaluated again as {label}", label),
        columns,
        facts={
            "runs": runs,
            "values compared": compared,
            "runs with a change": changed,
            "runs that can't be evaluated": problems,
        },
        notes=tuple(notes),
    )
