"""Export a run as a folder that can be read without this software."""

import contextlib
import csv
import io
import shutil
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from torquebench import __version__
from torquebench.atomic_write import atomic_write
from torquebench.calibration import CalibrationData
from torquebench.campaign.bench_chains import referenced
from torquebench.columns import Column, column_of, short_names
from torquebench.errors import InputError, RecordError, TorquebenchError
from torquebench.message import Message
from torquebench.records import (
    CalibrationEntry,
    Registry,
    RunFolder,
    RunSummary,
    folder_changes,
    json_text,
    sha256_of_file,
)
from torquebench.reports.certificate import (
    Issue,
    build_record,
    certificate_files,
    run_data,
)
from torquebench.reports.export_words import file_words
from torquebench.tables import calibration_csv, reference_remarks


@dataclass(frozen=True)
class ExportedRun:
    """Written files of an export.

    Parameters
    ----------
    folder : pathlib.Path
    files : tuple of str
        Names of all files in it.
    remarks : tuple of str
        Missing parts and integrity findings, as in README.txt.
    """

    folder: Path
    files: tuple[str, ...]
    remarks: tuple[str, ...]


@dataclass
class _Export:
    """Writes the files of an export and collects columns and remarks for its README."""

    folder: Path
    columns: dict[str, list[Column]] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)

    def write(self, name: str, content: str | bytes) -> None:
        atomic_write(self.folder / name, content)

    def table(
        self,
        name: str,
        columns: list[Column],
        rows: Iterator[list[Any]],
        notes: Mapping[str, object] | None = None,
    ) -> None:
        """Write a CSV file that begins with notes as comment lines."""
        text = io.StringIO()
        text.writelines(f"# {key} = {value}\n" for key, value in (notes or {}).items())
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow([column.name for column in columns])
        writer.writerows(rows)
        self.write(name, text.getvalue())
        self.columns[name] = columns


def export_run(registry: Registry, run: RunSummary, folder: Path) -> ExportedRun:
    """Write all data of a run in open formats, with a README that explains files and columns.

    Parameters
    ----------
    registry : Registry
    run : RunSummary
        A sealed run, completed or not.
    folder : pathlib.Path
        A folder that doesn't exist yet, or is empty.

    Raises
    ------
    InputError
        Where the folder isn't empty or can't be written.
    RecordError
        Where the run isn't sealed.
    """
    source = RunFolder.open(run.folder)
    if not source.sealed:
        raise RecordError(
            Message("run {run_id} isn't sealed", run.run_id),
            "a sealed run",
            "wait for its end, or recover it",
        )
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(
            Message("{folder} isn't empty", folder), "a new folder", "give another --out"
        )
    folder.mkdir(parents=True, exist_ok=True)
    export = _Export(folder)
    if run.simulated:
        export.remarks.append("SIMULATED: every number here comes from a simulated bench.")
    export.remarks += [
        f"NOT INTACT: {each}" for each in folder_changes(run.folder, run.manifest_sha256)
    ]
    _copy_originals(export, source)
    for write in (_write_documents, _write_annotations, _write_raw):
        try:
            write(export, source)
        except RecordError as error:
            export.remarks.append(f"UNREADABLE: {error}")
    calibrations = [each for each in registry.calibrations() if each.run_id == run.run_id]
    _write_registry(export, registry, run, calibrations)
    for calibration in calibrations:
        try:
            _write_calibration(export, source, calibration)
        except (InputError, RecordError) as error:
            export.remarks.append(f"UNREADABLE: {error}")
        _write_models(export, registry, calibration)
        _write_certificates(export, registry, calibration)
    if not calibrations:
        export.remarks.append(
            "No certificate: only a run that measured a registered calibration has one."
        )
    _write_readme(export, run)
    names = sorted(
        path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()
    )
    hashes = "".join(f"{sha256_of_file(folder / name)}  {name}\n" for name in names)
    export.write("SHA256SUMS.txt", hashes)
    return ExportedRun(folder, (*names, "SHA256SUMS.txt"), tuple(export.remarks))


def _copy_originals(export: _Export, source: RunFolder) -> None:
    """Copy the sealed files unchanged, so that the manifest's hashes still match."""
    target = export.folder / "original"
    shutil.copytree(source.path, target)
    for name in ("run.json", "results.json"):
        path = source.path / name
        if path.is_file():
            export.write(name, path.read_bytes())


def _write_documents(export: _Export, source: RunFolder) -> None:
    """Write one table for each stream of events."""
    notes = _notes(source)
    for _, document in list(source.documents("descriptor")):
        uid, keys = document["uid"], document["data_keys"]

        def rows(uid: str = uid, keys: Mapping[str, Any] = keys) -> Iterator[list[Any]]:
            for _, event in source.documents("event"):
                if event["descriptor"] == uid:
                    yield [event["time"], *(event["data"].get(key, "") for key in keys)]

        columns = [
            replace(column_of(name), stated_unit=str(keys[key].get("units") or ""))
            for key, name in short_names(list(keys)).items()
        ]
        name = f"{document.get('name', 'events')}.csv"
        export.table(name, [column_of("unix_time_s"), *columns], rows(), notes)


def _write_annotations(export: _Export, source: RunFolder) -> None:
    """Write what people noted while it was recorded, beside the bench times of the samples."""
    annotations = source.annotations()
    if annotations:
        texts = [Column("note", "text of the annotation"), Column("who", "who made it")]
        rows = ([each["bench_time_s"], each["note"], each["who"]] for each in annotations)
        export.table("annotations.csv", [column_of("time_s"), *texts], rows)


def _notes(source: RunFolder) -> dict[str, object]:
    """Return the comment lines with which a table of points can be read as a calibration."""
    notes: dict[str, object] = {}
    with contextlib.suppress(RecordError, InputError):
        data = _referenced(source)
        keys = ("range_nm", "side", "transducer_serial", "counter_identity")
        notes = {key: getattr(data, key) for key in keys if getattr(data, key)}
        notes |= reference_remarks(data.reference)
    return notes | ({"simulated": "true"} if source.metadata.get("simulated") else {})


def _referenced(source: RunFolder) -> CalibrationData:
    """Return the points of a run with its reference standard, if the description can be read.

    The description of another version may be unreadable; then the points lack the standard.
    """
    data, serial = run_data(source), str(source.results.get("standard_serial", ""))
    try:
        return referenced(data, source.metadata, serial)
    except (InputError, ValidationError):
        return data


def _write_raw(export: _Export, source: RunFolder) -> None:
    columns = {
        column_of(name, samples=True): values for name, values in source.raw().columns.items()
    }
    if not columns:
        return
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    export.table("raw_samples.csv", list(columns), map(list, rows))


def _write_registry(
    export: _Export, registry: Registry, run: RunSummary, calibrations: list[CalibrationEntry]
) -> None:
    known = []
    for calibration in calibrations:
        number = calibration.calibration_id
        models = registry.models(calibration_id=number)
        known.append(
            {
                "calibration": calibration,
                "models": models,
                "verifications": [
                    each for model in models for each in registry.verifications(model.model_id)
                ],
                "certificates": registry.certificates(number),
                "reviews": registry.reviews("calibrations", number),
                "amendments": registry.amendments("calibrations", number),
            }
        )
    content = {"run": run, "calibrations": known, "chain_end": str(registry.head())}
    export.write("registry.json", json_text(content, indent=2) + "\n")


def _write_calibration(export: _Export, source: RunFolder, calibration: CalibrationEntry) -> None:
    name = "calibration.csv"
    text = calibration_csv(_referenced(source), {"profile": calibration.profile_name})
    export.write(name, text)
    header = next(line for line in text.splitlines() if not line.startswith("#"))
    export.columns[name] = [column_of(column) for column in header.split(",")]


def _write_models(export: _Export, registry: Registry, calibration: CalibrationEntry) -> None:
    for model in registry.models(calibration_id=calibration.calibration_id):
        try:
            content = model.check_file().read_bytes()
        except RecordError as error:
            export.remarks.append(f"NOT INTACT: {error.found}")
            continue
        export.write(f"model-{model.model_id}-{model.kind}.json", content)


def _write_certificates(export: _Export, registry: Registry, calibration: CalibrationEntry) -> None:
    """Write copies of issued certificates, or a draft if there is none."""
    issued = registry.certificates(calibration.calibration_id)
    for entry in issued:
        for name, digest in entry.files.items():
            path = registry.root / entry.archive / name
            if not path.is_file() or sha256_of_file(path) != digest:
                export.remarks.append(f"NOT INTACT: {name} of certificate {entry.number}")
                continue
            export.write(f"certificate-{name}", path.read_bytes())
    if issued:
        return
    try:
        draft = Issue((), number=f"DRAFT-{calibration.calibration_id}", draft=True)
        files = certificate_files(build_record(registry, calibration, draft))
    except TorquebenchError as error:
        export.remarks.append(f"No certificate can be issued: {error}")
        return
    export.remarks.append("No certificate was issued yet: certificate-DRAFT-… is a draft.")
    for name, content in files.items():
        export.write(f"certificate-{name}", content)


def _write_readme(export: _Export, run: RunSummary) -> None:
    names = sorted(path.name for path in export.folder.iterdir())
    lines = [
        f"Run {run.run_id}",
        "=" * (len(run.run_id) + 4),
        "",
        f"A {run.kind} run of torquebench {run.software_version}, a program that measures",
        f"torque on test benches of reducers. It was exported by torquebench {__version__}.",
        "",
        f"Bench: {run.bench}{' (simulated)' if run.simulated else ''}",
        f"Operator: {run.operator or 'not stated'}",
        f"Started: {run.started.isoformat()}",
        f"Finished: {run.finished.isoformat() if run.finished else 'not stated'}",
        f"Status: {run.status}{': ' + run.reason if run.reason else ''}",
        f"Profile: {run.profile_name or 'none'}",
        "",
        *export.remarks,
        "",
        "All text is UTF-8. CSV files have a comma between columns, a point in numbers, and one",
        "header line; lines that begin with # are remarks. An empty cell is a value that wasn't",
        "measured, `nan` one that is missing by a fault. Torques are in N·m, clockwise positive.",
        "",
        "Files",
        "-----",
    ]
    lines += [
        f"{name}\n    {file_words(name)}"
        for name in sorted({*names, "README.txt", "SHA256SUMS.txt"})
    ]
    for name, columns in sorted(export.columns.items()):
        title = f"Columns of {name}"
        lines += ["", title, "-" * len(title)]
        lines += [f"{column.name}\n    {column.sentence}" for column in columns]
    export.write("README.txt", "\n".join(map(_wrapped, lines)) + "\n")


def _wrapped(text: str) -> str:
    """Wrap long lines and keep their indentation."""
    lines = []
    for line in text.split("\n"):
        indent = line[: len(line) - len(line.lstrip())]
        lines += textwrap.wrap(line, 88, subsequent_indent=indent, break_long_words=False) or [""]
    return "\n".join(lines)
