"""Queries of records for pages and clients by identifiers; requests never contain a path."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from typing import Any

import numpy as np
from sqlalchemy import or_

from torquebench.campaign import find_interrupted, read_interrupted
from torquebench.campaign.drifting import DriftSeries, drift_of
from torquebench.chain import load_chain
from torquebench.columns import short_names
from torquebench.errors import InputError, RecordError, TorquebenchError
from torquebench.message import Message
from torquebench.operations.calibrating import CalibratedModule
from torquebench.operations.checking import VerifiedModule, stored_verification
from torquebench.operations.models import stored_module
from torquebench.operations.reducers import report_path
from torquebench.panel.service.live.markers import Marker
from torquebench.panel.service.live.rings import Rows, envelope
from torquebench.panel.service.problems import NotFoundError
from torquebench.panel.service.records.views import (
    CalibrationDetail,
    ErrorCurve,
    InterruptedView,
    RunDetail,
    RunPage,
    RunTable,
    UnfinishedView,
)
from torquebench.records import (
    CalibrationEntry,
    CertificateEntry,
    CheckEntry,
    ModelEntry,
    Registry,
    RunFolder,
    RunSummary,
    folder_changes,
    sha256_of_file,
    unfinished_runs,
)
from torquebench.records.runs.time_check import (
    clock_behind,
    doubts_of_calibrations,
    doubts_of_runs,
)
from torquebench.records.signatures import Signature
from torquebench.reports.certificate import archive_folder, run_data

RUN_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")
MEDIA = {".pdf": "application/pdf", ".xml": "application/xml", ".json": "application/json"}
MOST_ROWS = 500
POINTS = "points"
"""Stream of a run's measured points."""


class RecordQueries:
    """The registry of the open bench, and its checks.

    Parameters
    ----------
    registry : Registry
    """

    def __init__(self, registry: Registry) -> None:
        self._registry = registry

    # -- runs -------------------------------------------------------------------------------

    def runs(
        self,
        text: str = "",
        *,
        kind: str | None = None,
        side: str | None = None,
        status: str | None = None,
        since: datetime | None = None,
        until: datetime | None = None,
        limit: int = 50,
        offset: int = 0,
    ) -> RunPage:
        """Search the runs, the newest first.

        Parameters
        ----------
        text : str
            Words in identifier, kind, operator or profile.
        kind, side, status : str, optional
            Exact value; `kind` may also be the beginning of a kind, such as "calibrate".
        since, until : datetime.datetime, optional
            Range of the start time, with time zone.
        limit, offset : int
        """
        run: Any = RunSummary
        wanted: list[Any] = []
        for word in text[:200].split():
            columns = (run.run_id, run.kind, run.operator, run.profile_name)
            wanted.append(or_(*(each.icontains(word, autoescape=True) for each in columns)))
        if kind is not None:
            wanted.append(run.kind.startswith(kind[:64], autoescape=True))
        if side is not None:
            wanted.append(run.side == side[:16])
        if status is not None:
            wanted.append(run.status == status[:32])
        if since is not None:
            wanted.append(run.started >= since)
        if until is not None:
            wanted.append(run.started < until)
        limit, offset = min(max(limit, 1), MOST_ROWS), min(max(offset, 0), 10**9)
        runs = self._registry.runs(limit, offset, None, *wanted)
        self._doubt(runs)
        behind = clock_behind(self._registry)
        total = self._registry.number_of_runs(*wanted)
        return RunPage(tuple(runs), total, offset, (behind,) if behind else ())

    def _doubt(self, runs: Sequence[RunSummary]) -> None:
        """Add the implausible times to runs."""
        doubts = doubts_of_runs(self._registry, [run.run_id for run in runs])
        for run in runs:
            run.doubts = doubts.get(run.run_id, ())

    def run(self, run_id: str, *, check: bool = True) -> RunDetail:
        """Return everything about one run.

        Parameters
        ----------
        run_id : str
        check : bool
            Whether to compare its files with the hashes in its seal.

        Raises
        ------
        NotFoundError
            No run has this identifier.
        RecordError
            Its folder is missing.
        """
        run = self._run(run_id)
        self._doubt([run])
        folder = RunFolder.open(run.folder)
        metadata = {
            key: value for key, value in folder.metadata.items() if key not in ("bench", "folder")
        }
        calibration = next(
            (entry for entry in self._registry.calibrations() if entry.run_id == run_id), None
        )
        changes: list[str] = []
        if check and run.finished is not None:
            changes = folder_changes(run.folder, run.manifest_sha256)
        if folder.sealed:  # as a message with template, for the translation
            run.reason = folder.manifest["reason"]
        return RunDetail(
            run,
            metadata,
            folder.results if folder.sealed else None,
            tuple(_tables(folder)),
            None if calibration is None else calibration.calibration_id,
            tuple(changes),
            tuple(_annotations(folder)),
        )

    def _run(self, run_id: str) -> RunSummary:
        if not RUN_ID.fullmatch(run_id):
            raise NotFoundError(
                Message("no run {run!r}", run_id[:80]), "an identifier of the list of runs"
            )
        try:
            return self._registry.run(run_id)
        except RecordError:
            raise NotFoundError(
                Message("no run {run}", run_id), "an identifier of the list of runs"
            ) from None

    def run_columns(self, run_id: str) -> tuple[str, ...]:
        """Return the columns of a run's raw stream other than time."""
        raw = RunFolder.open(self._run(run_id).folder).raw()
        return tuple(name for name in raw.columns if name != "time_s")

    def run_trend(
        self,
        run_id: str,
        columns: Sequence[str],
        points: int = 1000,
        span_s: tuple[float, float] | None = None,
    ) -> Rows:
        """Return raw samples of a run over time, reduced without losing extremes.

        Parameters
        ----------
        run_id : str
        columns : sequence of str
        points : int
            Largest number of rows.
        span_s : (float, float), optional
            Span whose samples are wanted, s from the run's first sample; by default all.

        Returns
        -------
        Rows
            Rows with the signals in the order of `columns`.

        Raises
        ------
        NotFoundError
            The run or a column doesn't exist.
        """
        raw = RunFolder.open(self._run(run_id).folder).raw().columns
        for name in columns:
            if name not in raw or name == "time_s":
                raise NotFoundError(
                    Message("no column {name!r} in {run}", name[:80], run_id), ", ".join(raw)
                )
        if not columns or "time_s" not in raw:
            raise InputError("no column", "one of the run's columns")
        values = np.array([np.asarray(raw[name], dtype=np.float64) for name in columns])
        time_s = np.asarray(raw["time_s"], dtype=np.float64)
        if span_s is not None and time_s.size:
            after_s = time_s - time_s[0]
            shown = (after_s >= span_s[0]) & (after_s <= span_s[1] + 1e-9)
            time_s, values = time_s[shown], values[:, shown]
        rows = Rows(time_s, values, values, values)
        return envelope(rows, min(max(points, 1), 5000))

    def run_begin_s(self, run_id: str) -> float:
        """Return the bench time of a run's first raw sample, s; 0 without samples."""
        time_s = RunFolder.open(self._run(run_id).folder).raw().columns.get("time_s")
        return 0.0 if time_s is None or not len(time_s) else float(time_s[0])

    def run_errors(self, run_id: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the standard's torques of a run's points, and the errors of its raw readings, N·m.

        Raises
        ------
        NotFoundError
            The run doesn't exist, or has no points against a standard.
        """
        for part in _tables(RunFolder.open(self._run(run_id).folder)):
            if part.stream == POINTS and (errors := part.errors) is not None:
                return errors
        raise NotFoundError(
            Message("run {run} has no points against a standard", run_id),
            "a calibration, a verification or a daily check",
        )

    # -- calibrations -----------------------------------------------------------------------

    def calibrations(
        self, transducer_serial: str | None = None, limit: int = 100
    ) -> list[CalibrationEntry]:
        """Return calibrations, the newest first."""
        limit = min(max(limit, 1), MOST_ROWS)
        return self._doubted(self._registry.calibrations(transducer_serial, limit=limit))

    def _doubted(self, entries: list[CalibrationEntry]) -> list[CalibrationEntry]:
        """Add doubts to calibrations: expired standards and implausible times."""
        numbers = [entry.calibration_id for entry in entries]
        doubts = doubts_of_calibrations(self._registry, numbers)
        for entry in entries:
            entry.doubts = doubts.get(entry.calibration_id, ())
        return entries

    def calibration(self, calibration_id: int) -> CalibrationDetail:
        """Return a calibration with its models, verifications and certificates.

        Raises
        ------
        NotFoundError
            No record has this number.
        """
        try:
            entry = self._registry.calibration(calibration_id)
        except RecordError:
            raise NotFoundError(
                Message("no calibration {number}", calibration_id),
                "a number of the list of calibrations",
            ) from None
        models = tuple(
            model
            for model in self.models(entry.transducer_serial)
            if model.calibration_id == calibration_id
        )
        (calibration,) = self._doubted([entry])
        return CalibrationDetail(
            calibration,
            models,
            tuple(
                verification
                for model in models
                for verification in self._registry.verifications(model.model_id)
            ),
            tuple(self._registry.reviews("calibrations", calibration_id)),
            tuple(self._registry.certificates(calibration_id)),
            tuple(self._registry.activations(entry.transducer_serial)),
            Signature("signed", "", covers=self._registry.covered(calibration_id)).sha256,
        )

    def unfinished(self) -> list[UnfinishedView]:
        """Return the unfinished runs that no process is writing, the oldest first."""
        return [
            UnfinishedView(run.run_id, run.kind, run.state.value, run.found, run.remedy)
            for run in unfinished_runs(self._registry)
        ]

    def interrupted(self, run_id: str = "") -> InterruptedView | None:
        """Return a run that can be resumed, by default the newest calibration; else None.

        After None, an attempt to resume states the reason.
        """
        registry = self._registry
        try:
            if not run_id:
                kinds = ((run.run_id, run.kind) for run in registry.runs())
                run_id = next((name for name, kind in kinds if kind.startswith("calibrate-")), "")
            if not run_id:
                return None
            interrupted = read_interrupted(registry, find_interrupted(registry, run_id))
            kept = len(interrupted.kept)
        except TorquebenchError:
            return None
        return InterruptedView(
            run_id=run_id,
            side=interrupted.side,
            profile=interrupted.profile.title,
            interrupted=interrupted.interrupted,
            points=len(interrupted.points),
            kept=kept,
            total=sum(step.recorded for step in interrupted.steps),
        )

    def module(self, calibration_id: int) -> CalibratedModule:
        """Return a calibration with points and models, from its run and its models' files.

        Raises
        ------
        RecordError
            The calibration isn't registered, or its records were changed.
        """
        return stored_module(self._registry, calibration_id)

    def verified(self, calibration_id: int) -> VerifiedModule | None:
        """Return the last verification of a calibration's models; None before the first."""
        return stored_verification(self._registry, calibration_id)

    def models(self, transducer_serial: str | None = None) -> list[ModelEntry]:
        """Return models; their attribute `active` says which are in use."""
        return self._registry.models(transducer_serial)

    def model_file(self, model_id: int) -> tuple[bytes, str]:
        """Return a model's file, checked by its registered hash, and its name.

        Raises
        ------
        NotFoundError
            No record has this number.
        RecordError
            The file is missing or was changed.
        """
        try:
            entry = self._registry.model(model_id)
        except RecordError:
            raise NotFoundError(
                Message("no model {number}", model_id), "a number of the list of models"
            ) from None
        return entry.check_file().read_bytes(), entry.file.name

    def error_curve(self, calibration_id: int, model_id: int | None = None) -> ErrorCurve:
        """Return the error of a chain over torque, raw and compensated by a model.

        Raises
        ------
        NotFoundError
            The calibration doesn't exist, or hasn't got this model.
        RecordError
            The run or the model's file was changed.
        """
        detail = self.calibration(calibration_id)
        run_id = detail.calibration.run_id
        if run_id is None:
            raise NotFoundError(
                Message("calibration {number} has no run", calibration_id), "one of this bench"
            )
        data = run_data(RunFolder.open(self._run(run_id).folder))
        errors: Any = ()
        if model_id is not None:
            if model_id not in {model.model_id for model in detail.models}:
                raise NotFoundError(
                    Message("calibration {number} has no model {model}", calibration_id, model_id),
                    "one of its models",
                )
            chain = load_chain(self._registry.model(model_id).check_file())
            torque = chain.compensated(data.readings())
            errors = tuple((torque.value_nm - data.standard_nm).tolist())
        performed = detail.calibration.performed
        return ErrorCurve(
            calibration_id,
            f"{detail.calibration.transducer_serial}, {performed:%Y-%m-%d %H:%M}",
            tuple(data.standard_nm.tolist()),
            tuple((data.reading_nm - data.standard_nm).tolist()),
            tuple(int(branch) for branch in data.branch),
            model_id,
            errors,
        )

    def drift(
        self, transducer_serial: str, tolerance_percent: float = 0.1
    ) -> tuple[DriftSeries, ...]:
        """Return span, zero and checks of a transducer over time, with control charts."""
        serials = self.transducers()
        if transducer_serial not in serials:
            raise NotFoundError(
                Message("no transducer {serial!r}", transducer_serial[:80]), ", ".join(serials)
            )
        models = self._registry.models(transducer_serial)
        return drift_of(
            self._registry, transducer_serial, tolerance_percent=tolerance_percent, models=models
        )

    def transducers(self) -> list[str]:
        """Return the serial numbers of all registered transducers."""
        return [entry.serial for entry in self._registry.equipment("transducer")]

    # -- certificates -----------------------------------------------------------------------

    def certificates(self) -> list[CertificateEntry]:
        """Return all certificates, the newest first."""
        return self._registry.certificates()

    def checks(self, run_id: str) -> list[CheckEntry]:
        """Return the registered check of a run, if it was a check."""
        return self._registry.entries(CheckEntry, run_id=run_id)

    def has_report(self, run_id: str) -> bool:
        """Whether a run has a report as PDF."""
        return bool(RUN_ID.fullmatch(run_id)) and report_path(self._registry, run_id).is_file()

    def report_file(self, run_id: str) -> bytes:
        """Return the report of a reducer test as PDF.

        Raises
        ------
        NotFoundError
            The run doesn't exist, or has no report.
        """
        if not self.has_report(run_id):
            raise NotFoundError(
                Message("no report of {run!r}", run_id[:80]),
                "the first run of a reducer test on this panel",
                "test the specimen again",
            )
        return report_path(self._registry, run_id).read_bytes()

    def certificate_file(self, number: str, name: str) -> tuple[bytes, str]:
        """Return one file of a certificate and its media type, checked by its registered hash.

        Raises
        ------
        NotFoundError
            The certificate doesn't exist, or hasn't got this file.
        RecordError
            The file is missing or was changed.
        """
        entries = [entry for entry in self._registry.certificates() if entry.number == number]
        if not entries or name not in entries[0].files:
            raise NotFoundError(
                Message("no file {name!r} of a certificate {number!r}", name[:80], number[:80]),
                "a file of the list of certificates",
            )
        path = archive_folder(self._registry, entries[0].number) / name
        if not path.is_file() or sha256_of_file(path) != entries[0].files[name]:
            raise RecordError(
                Message("{name} of certificate {number} is missing or was changed", name, number),
                "the file as it was issued",
                "restore it from a backup",
            )
        return path.read_bytes(), MEDIA.get(path.suffix, "application/octet-stream")


def _annotations(folder: RunFolder) -> Iterator[Marker]:
    for number, found in enumerate(folder.annotations(), start=1):
        at = datetime.fromtimestamp(found["time"], UTC)
        yield Marker(number, found["bench_time_s"], at, found["note"], found["who"])


def _tables(folder: RunFolder) -> Iterator[RunTable]:
    streams: dict[str, dict[str, Any]] = {}
    rows: dict[str, list[dict[str, Any]]] = {}
    for name, document in folder.documents():
        if name == "descriptor":
            streams[document["uid"]] = document
            rows[document["uid"]] = []
        elif name == "event" and document["descriptor"] in rows:
            rows[document["descriptor"]].append(document["data"])
    for uid, descriptor in streams.items():
        keys = short_names(list(descriptor["data_keys"]))
        units = {
            short: str(descriptor["data_keys"][key].get("units") or "")
            for key, short in keys.items()
        }
        columns = {short: [row.get(key) for row in rows[uid]] for key, short in keys.items()}
        yield RunTable(str(descriptor.get("name", "")), units, columns)
