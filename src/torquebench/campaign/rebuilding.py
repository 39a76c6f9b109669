"""Rebuild or complete a registry from the other files of the data directory.

A run's folder states what was measured, on which bench and by whom; model files state the fitted
points; certificates include their record. Later statements of people (reviews, amendments,
adjustments, activations) are in the registry only.
"""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from torquebench.bench.description import BenchDescription
from torquebench.calibration import Contradiction
from torquebench.campaign.registering import FittedFile, register_calibration, run_data
from torquebench.compensation import StoredModel, load_model
from torquebench.errors import RecordError, TorquebenchError
from torquebench.message import Message
from torquebench.progress import NO_PROGRESS, Progress
from torquebench.records import (
    CertificateEntry,
    Registry,
    RunFolder,
    sha256_of_file,
)
from torquebench.records.files import read_json
from torquebench.records.registry.database import REGISTRY_FILE
from torquebench.records.registry.database_check import (
    damage_of_file,
    index_damage_only,
    mend_schema,
    schema_changes,
)
from torquebench.records.runs.lock import RunLock
from torquebench.station.backup import require_file_registry
from torquebench.station.bench_lock import BenchLock
from torquebench.station.data_check import run_folders
from torquebench.station.entering import enter_run, require_original
from torquebench.station.registration import register_equipment
from torquebench.validation import validated

DAMAGED_REGISTRY = "registry-damaged-"
"""Prefix of the name under which a damaged registry is kept."""
NOT_REBUILT = (
    "which model is in use: put it into use on the panel, or calibrate",
    "reviews and amendments: who checked what, and what records should have said",
    "equipment, certificates of standards, parts and adjustments that were entered by hand",
    "verdicts of checks, and what verifications found: `torquebench records list runs` names their "
    "runs, `records finish RUN` registers them again",
    "accounts, passwords and settings of the panel, which lie in panel.sqlite: `records restore`",
)
"""Entries that exist in the registry only, so that they can't be rebuilt."""


@dataclass
class Rebuilt:
    """Entries made from the data directory.

    Attributes
    ----------
    anew : bool
        Whether a new registry was created.
    mended : list of str
        Recreated parts of the database: indexes, triggers.
    aside : pathlib.Path or None
        Copy of the original registry.
    runs, calibrations, models, certificates : list of str
        Names of the entries that were made.
    unfitted : list of str
        Runs of calibrations without a model file: `records finish` fits and registers them.
    problems : list of str
        Data that couldn't be entered, and why.
    """

    anew: bool = False
    mended: list[str] = field(default_factory=list)
    aside: Path | None = None
    runs: list[str] = field(default_factory=list)
    calibrations: list[str] = field(default_factory=list)
    models: list[str] = field(default_factory=list)
    certificates: list[str] = field(default_factory=list)
    unfitted: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)


def rebuild(data: Path, by: str, progress: Progress = NO_PROGRESS) -> Rebuilt:
    """Recreate a lost or damaged registry, and enter missing data.

    A sound registry is only added to. A damaged one is kept under another name; where only its
    indexes or triggers are damaged, it stays and those are made again.

    Parameters
    ----------
    by : str
        Person, for the record.
    progress : Progress
        Receives the progress of the entries.

    Raises
    ------
    InputError
        If the registry is on a server, or a bench is open.
    """
    require_file_registry("rebuilding")
    done = Rebuilt()
    with BenchLock(None, data):
        _mend(data, done)
        with Registry(f"sqlite:///{(data / REGISTRY_FILE).resolve()}", data) as registry:
            entered = {run.run_id for run in registry.runs(limit=None)}
            missing = [
                run_folder for run_folder in run_folders(data) if run_folder.name not in entered
            ]
            progress.start("Entering runs", len(missing))
            for number, folder in enumerate(missing):
                progress.reach(number, folder.name)
                _enter(registry, folder, done)
            progress.reach(len(missing))
            _enter_certificates(registry, data, done)
            if done.anew or done.runs:
                registry.note_rebuilt(done.runs, by=by, anew=done.anew)
    return done


def _mend(data: Path, done: Rebuilt) -> None:
    """Repair the registry, or remove a damaged one that can't be repaired."""
    file = data / REGISTRY_FILE
    if not file.exists() or not file.stat().st_size:
        done.anew = True
        return
    damage = damage_of_file(file)
    if index_damage_only(damage):
        _keep_aside(file, done)
        with closing(sqlite3.connect(file)) as connection:
            connection.execute("REINDEX")
        done.mended.append("indexes")
        damage = damage_of_file(file)
    if not damage:
        try:
            with Registry(f"sqlite:///{file.resolve()}", data) as registry:
                changes = list(schema_changes(registry))
                if not changes:
                    return
                _keep_aside(file, done)
                done.mended += mend_schema(registry)
                if not list(schema_changes(registry)):
                    return
        except RecordError:
            pass
    _keep_aside(file, done)
    for ending in ("", "-wal", "-shm"):
        file.with_name(f"{file.name}{ending}").unlink(missing_ok=True)
    done.anew = True


def _keep_aside(file: Path, done: Rebuilt) -> None:
    """Copy the unchanged registry and its log before the rebuild."""
    if done.aside is not None:
        return
    name = f"{DAMAGED_REGISTRY}{datetime.now(UTC):%Y%m%dT%H%M%S%fZ}.sqlite"
    done.aside = file.with_name(name)
    for ending in ("", "-wal"):
        source = file.with_name(f"{file.name}{ending}")
        if source.exists():
            shutil.copy2(source, file.with_name(f"{name}{ending}"))


def _enter(registry: Registry, path: Path, done: Rebuilt) -> None:
    """Enter one run with its bench, its calibration and its models."""
    try:
        folder = RunFolder.open(path)
        require_original(folder)
        lock = RunLock(path)
        if not lock.held:
            return
        try:
            if not folder.sealed:
                folder.recover()
            folder.verify()
            bench = folder.metadata.get("bench")
            if bench:
                source = Message("the bench in the record of {name}", path.name)
                register_equipment(registry, validated(BenchDescription, bench, source))
            enter_run(registry, folder)
            done.runs.append(path.name)
            _enter_calibration(registry, folder, done)
        finally:
            lock.release()
    except (TorquebenchError, OSError, KeyError, TypeError, ValueError) as error:
        found = error.found if isinstance(error, TorquebenchError) else repr(error)
        done.problems.append(f"{path.name}: {found}")


def _enter_calibration(registry: Registry, folder: RunFolder, done: Rebuilt) -> None:
    """Enter the calibration of a run's folder again, with the models that were fitted to it."""
    metadata, results = folder.metadata, folder.results
    kind = str(metadata.get("kind", ""))
    measured = isinstance(results, Mapping) and isinstance(results.get("data"), Mapping)
    if not (kind.startswith("calibrate-") or "table" in metadata) or not measured:
        return
    if folder.manifest["status"] != "completed":
        return
    models = list(_models_of(registry.root / "models", run_data(folder).sha256(), done))
    if not models and kind.startswith("calibrate-"):  # no result was registered
        done.unfitted.append(folder.run_id)
        return
    files = [
        FittedFile(
            file.name,
            stored.model.kind,
            file,
            dict(stored.provenance.metrics),
            [
                Contradiction.of_text(contradiction)
                for contradiction in stored.provenance.contradictions
            ],
        )
        for file, stored in models
    ]
    registered = register_calibration(
        registry, folder, files, rebuilt="entered again from the run's folder"
    )
    done.calibrations.append(
        f"calibration-{registered.calibration.calibration_id} ({folder.run_id})"
    )
    done.models += [f"model-{model.model_id} ({name})" for name, model in registered.models.items()]


def _models_of(folder: Path, data_sha256: str, done: Rebuilt) -> Iterator[tuple[Path, StoredModel]]:
    """Yield the model files that were fitted to the points of a calibration."""
    for file in sorted(folder.glob("*.json")):
        if data_sha256.encode() not in file.read_bytes():
            continue
        try:
            stored = load_model(file)
        except TorquebenchError as error:
            done.problems.append(f"{file.name}: {error.found}")
            continue
        if stored.provenance.training_data_sha256 == data_sha256:
            yield file, stored


def _enter_certificates(registry: Registry, data: Path, done: Rebuilt) -> None:
    """Enter every archived certificate whose calibration is registered."""
    archive = data / "certificates"
    issued = {each.number for each in registry.certificates()}
    calibrations = {entry.run_id: entry for entry in registry.calibrations()}
    found = [
        (record, file.parent)
        for file in sorted(archive.glob("*/*.json"))
        if (record := _certificate(file)) is not None
    ]
    # A certificate that replaces another one is issued after it.
    for record, folder in sorted(found, key=lambda each: (each[0]["issued"], each[0]["number"])):
        if record["number"] in issued or folder.name != record["number"]:
            continue
        entry = calibrations.get(record["run_id"])
        if entry is None:
            done.problems.append(
                f"certificate {record['number']}: run {record['run_id']} has no calibration"
            )
            continue
        certificate = CertificateEntry.of_record(
            record,
            {
                path.name: sha256_of_file(path)
                for path in sorted(folder.iterdir())
                if path.is_file()
            },
            registry.stored(folder),
            issued=datetime.fromisoformat(record["issued"]).replace(tzinfo=UTC),
            calibration_id=entry.calibration_id,
            rebuilt="entered again from its record",
        )
        if certificate.supersedes not in (*issued, ""):
            done.problems.append(
                f"certificate {record['number']} replaces {certificate.supersedes}, "
                "which isn't archived here"
            )
            certificate = replace(certificate, supersedes="")
        registry.add_certificate(certificate)
        issued.add(record["number"])
        done.certificates.append(record["number"])


def _certificate(file: Path) -> dict[str, Any] | None:
    """Return a file's content if it is the record of a certificate."""
    wanted = {
        *("number", "run_id", "authorised_by", "issued", "simulated", "deviations", "conformity"),
        *("languages", "method", "supersedes"),
    }
    try:
        content = read_json(file)
    except RecordError:
        return None
    return content if isinstance(content, dict) and wanted <= content.keys() else None
