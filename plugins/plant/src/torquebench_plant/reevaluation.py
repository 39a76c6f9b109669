"""Re-evaluation of one recorded run with this version, the same on any computer."""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from torquebench.errors import RecordError
from torquebench.message import Message
from torquebench.records.runs.folder import MANIFEST
from torquebench.uncertainty import Verdict
from torquebench_plant.folders import FolderStore

__all__ = ["BUDGETS_ONLY", "Reevaluated", "RunTask", "SealedFolder", "reevaluate_run"]

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
        Of the run.
    fitted_to : mapping of str to tuple of str and SealedFolder
        Of a check or verification: kind and calibration of its models, by the names that the
        result has them under.
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
        What wasn't evaluated again; otherwise empty.
    """

    bench_key: int
    run_id: str
    values: str
    problem: str = ""
    remark: str = ""


def reevaluate_run(task: RunTask) -> Reevaluated:
    """Fit and evaluate one recorded run with this version.

    A calibration is fitted again with the models that it was begun with; a check or verification is
    evaluated with its models fitted again; a reducer test is evaluated from its recording. Of a
    reducer test without a recording, by version 0.1, U and verdicts are computed again from the
    stored budgets, and `remark` says so. Every file is checked against the manifest first.

    Nothing of it depends on the processor's other work: one thread, no clock, no chance.

    Returns
    -------
    Reevaluated
        With `problem` where the run can't be evaluated; other runs aren't held up.
    """
    from threadpoolctl import threadpool_limits

    try:
        with threadpool_limits(1):
            values, remark = _evaluated(task)
    except Exception as error:  # whatever one folder contains, the other runs are evaluated
        said = getattr(error, "found", "") or f"{type(error).__name__}: {error}"
        return Reevaluated(task.bench_key, task.run_id, "{}", said)
    finite = {name: value for name, value in values.items() if abs(value) < float("inf")}
    text = json.dumps(finite, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return Reevaluated(task.bench_key, task.run_id, text, remark=remark)


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
    """Return a file of a sealed folder if it still matches its seal."""
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


def _measured(store: FolderStore, folder: SealedFolder) -> tuple[Any, Any]:
    """Return the measured data of a calibration, check or verification, and its profile."""
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

    measured, profile = _measured(store, folder)
    data, metadata = measured.result.data, measured.record.metadata
    wanted = metadata.get(REGISTERS) or {"models": [{"name": RECOMMENDED}]}
    choices = [ModelChoice(**each) for each in wanted["models"]]
    if kind is not None:
        choices = [each for each in choices if each.name == kind] or [ModelChoice(kind)]
    effects = recorded_effects(metadata, data)
    return [
        (data, each)
        for each in fit_models(data, choices, effects=effects, limits=profile.plausibility)
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

    measured, _ = _measured(store, task.folder)
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

    if RECORDING not in _content(store, folder, MANIFEST)["files"]:
        return _budgets(_content(store, folder, "results.json")), BUDGETS_ONLY
    recorded = RecordedTest.read(_file(store, folder, RECORDING), f"{folder.url}/{RECORDING}")
    bench = _content(store, folder, "run.json")["bench"]
    values = {}
    for each in recorded.evaluated(BenchDescription.model_validate(bench)).quantities:
        values[f"{each.key} value"] = each.value
        values[f"{each.key} expanded_uncertainty"] = each.expanded_uncertainty
        if each.limit:
            values[f"{each.key} passes"] = float(each.verdict is Verdict.PASS)
    return values, ""


def _budgets(results: Any) -> dict[str, float]:
    from torquebench.campaign.reducers.results import budget_from_plain
    from torquebench.uncertainty import Tolerance, decide
    from torquebench_plant.statistics import limits_in_words

    values = {}
    for row in results["quantities"]:
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
