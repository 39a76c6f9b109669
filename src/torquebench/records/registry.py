"""The registry: instruments, runs, calibrations, models, activations and verifications."""

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import aliased

from torquebench.calibration import CalibrationData, VerificationResult
from torquebench.errors import ModelMismatchError, RecordError
from torquebench.records.database import Database, as_json, instrument_row, run_row
from torquebench.records.entries import (
    Activation,
    CalibrationEntry,
    Instrument,
    InstrumentKind,
    ModelEntry,
    RunSummary,
    VerificationEntry,
)
from torquebench.records.files import sha256_of_file
from torquebench.records.run_folder import RunFolder
from torquebench.records.schema import (
    ActivationRow,
    CalibrationRow,
    InstrumentRow,
    ModelRow,
    RunRow,
    VerificationRow,
)

__all__ = ["Registry"]


class Registry(Database):
    """The records of a data directory, in SQLite by default and in PostgreSQL by URL.

    It is opened by `Registry.open` for a data directory, or by a database URL and the data
    directory; see `Database`.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder, Registry.open(Path(folder)) as registry:
    ...     registry.add_instrument(Instrument("transducer", "T-1", range_nm=2000.0))
    ...     [instrument.serial for instrument in registry.instruments()]
    ['T-1']
    """

    # Instruments

    def add_instrument(self, instrument: Instrument) -> None:
        """Register an instrument, or bring what is known of it up to date."""
        with self.session() as session:
            row = instrument_row(session, instrument.kind, instrument.serial)
            row.manufacturer = instrument.manufacturer
            row.model = instrument.model
            row.range_nm = instrument.range_nm
            row.details = as_json(instrument.details)

    def instruments(self, kind: InstrumentKind | None = None) -> list[Instrument]:
        """Return the registered instruments, all or of one kind, by kind and serial."""
        query = select(InstrumentRow).order_by(InstrumentRow.kind, InstrumentRow.serial)
        if kind is not None:
            query = query.where(InstrumentRow.kind == kind)
        with self.session() as session:
            return [
                Instrument(
                    kind=row.kind,  # type: ignore[arg-type] # only these kinds are written
                    serial=row.serial,
                    manufacturer=row.manufacturer,
                    model=row.model,
                    range_nm=row.range_nm,
                    details=row.details,
                )
                for row in session.scalars(query)
            ]

    # Runs

    def add_run(self, summary: RunSummary) -> None:
        """Register a run when it starts.

        Raises
        ------
        RecordError
            Where the identifier is taken.
        """
        with self.session() as session:
            if session.scalar(select(RunRow.id).where(RunRow.run_id == summary.run_id)):
                raise RecordError(f"run {summary.run_id} is registered", "a new identifier")
            values = {**vars(summary), "folder": self.stored(summary.folder)}
            session.add(RunRow(**values))

    def finish_run(self, folder: RunFolder, finished: datetime | None = None) -> None:
        """Enter how a sealed run ended, and the hash of its manifest.

        Parameters
        ----------
        folder : RunFolder
            The sealed run.
        finished : datetime.datetime, optional
            When it ended, with time zone; by default when it was sealed.

        Raises
        ------
        RecordError
            Where the run isn't registered or isn't sealed.
        """
        manifest = folder.manifest
        with self.session() as session:
            row = run_row(session, folder.run_id)
            row.status = manifest["status"]
            row.reason = manifest["reason"]
            row.finished = finished or datetime.fromisoformat(manifest["sealed"])
            row.manifest_sha256 = sha256_of_file(folder.path / "manifest.json")

    def runs(self, limit: int = 100, offset: int = 0, kind: str | None = None) -> list[RunSummary]:
        """Return runs, the newest first.

        Parameters
        ----------
        limit, offset : int
            How many, and how many of the newest to pass over.
        kind : str, optional
            Only runs of this kind.
        """
        query = select(RunRow).order_by(RunRow.started.desc(), RunRow.id.desc())
        if kind is not None:
            query = query.where(RunRow.kind == kind)
        query = query.limit(limit).offset(offset)
        with self.session() as session:
            return [
                self._summary(row) for row in session.scalars(query.limit(limit).offset(offset))
            ]

    def run(self, run_id: str) -> RunSummary:
        """Return one run.

        Raises
        ------
        RecordError
            Where it isn't registered.
        """
        with self.session() as session:
            return self._summary(run_row(session, run_id))

    # Calibrations and models

    def add_calibration(
        self,
        data: CalibrationData,
        *,
        performed: datetime | None = None,
        run_id: str | None = None,
        standard_serial: str = "",
        profile_name: str = "",
        profile_sha256: str = "",
        summary: Mapping[str, Any] | None = None,
    ) -> CalibrationEntry:
        """Register a calibration; its transducer and counter are registered where they aren't yet.

        Parameters
        ----------
        data : CalibrationData
            The table, with transducer serial and counter identity.
        performed : datetime.datetime, optional
            When, with time zone; now by default.
        run_id : str, optional
            The run that measured it.
        standard_serial : str
            Serial of the calibrator.
        profile_name, profile_sha256 : str
            The profile that was followed.
        summary : mapping, optional
            What else to keep beside it.

        Raises
        ------
        RecordError
            Where transducer or counter aren't named, or the run isn't registered.
        """
        if not data.transducer_serial or not data.counter_identity:
            raise RecordError(
                f"a calibration of transducer {data.transducer_serial!r} "
                f"with counter {data.counter_identity!r}",
                "the serial of the transducer and the identity of its counter",
                "name both in the table or the bench description",
            )
        with self.session() as session:
            row = CalibrationRow(
                run=None if run_id is None else run_row(session, run_id),
                transducer=instrument_row(session, "transducer", data.transducer_serial),
                counter=instrument_row(session, "counter", data.counter_identity),
                performed=performed or datetime.now(UTC),
                range_nm=data.range_nm,
                points=len(data),
                data_sha256=data.sha256(),
                profile_name=profile_name,
                profile_sha256=profile_sha256,
                simulated=data.simulated,
                summary=as_json(summary or {}),
            )
            if standard_serial:
                row.standard_key = instrument_row(session, "calibrator", standard_serial).id
            session.add(row)
            session.flush()
            return _calibration_entry(row)

    def calibrations(self, transducer_serial: str | None = None) -> list[CalibrationEntry]:
        """Return calibrations, all or of one transducer, the newest first."""
        query = select(CalibrationRow).order_by(CalibrationRow.id.desc())
        if transducer_serial is not None:
            query = query.join(CalibrationRow.transducer).where(
                InstrumentRow.serial == transducer_serial
            )
        with self.session() as session:
            return [_calibration_entry(row) for row in session.scalars(query)]

    def add_model(
        self,
        calibration: CalibrationEntry,
        *,
        kind: str,
        file: Path,
        side: str = "",
        metrics: Mapping[str, Any] | None = None,
        created: datetime | None = None,
    ) -> ModelEntry:
        """Register a fitted model by its file.

        Parameters
        ----------
        calibration : CalibrationEntry
            What it was fitted to.
        kind : str
            Kind of model.
        file : pathlib.Path
            The model file, which is hashed.
        side : str
            ``"input"`` or ``"output"``.
        metrics : mapping, optional
            Errors of its cross-validation.
        created : datetime.datetime, optional
            When, with time zone; now by default.

        Raises
        ------
        RecordError
            Where the file is missing.
        """
        if not file.is_file():
            raise RecordError(f"model file {file} is missing", "a model file")
        with self.session() as session:
            row = ModelRow(
                calibration_key=calibration.calibration_id,
                kind=kind,
                file=self.stored(file),
                file_sha256=sha256_of_file(file),
                range_nm=calibration.range_nm,
                side=side,
                metrics=as_json(metrics or {}),
                created=created or datetime.now(UTC),
            )
            session.add(row)
            session.flush()
            return self._model_entry(row)

    def model(self, model_id: int) -> ModelEntry:
        """Return one model.

        Raises
        ------
        RecordError
            Where it isn't registered.
        """
        with self.session() as session:
            row = session.get(ModelRow, model_id)
            if row is None:
                raise RecordError(f"model {model_id} isn't registered", "a registered model")
            return self._model_entry(row)

    def models(self, transducer_serial: str | None = None) -> list[ModelEntry]:
        """Return models, all or of one transducer, the newest first."""
        query = select(ModelRow).order_by(ModelRow.id.desc())
        if transducer_serial is not None:
            query = (
                query.join(ModelRow.calibration)
                .join(CalibrationRow.transducer)
                .where(InstrumentRow.serial == transducer_serial)
            )
        with self.session() as session:
            return [self._model_entry(row) for row in session.scalars(query)]

    # Activation

    def activate(self, model_id: int, *, operator: str = "", reason: str = "") -> None:
        """Put a model into use for the transducer and the counter that it was made with.

        Raises
        ------
        RecordError
            Where the model isn't registered.
        """
        with self.session() as session:
            model = session.get(ModelRow, model_id)
            if model is None:
                raise RecordError(f"model {model_id} isn't registered", "a registered model")
            session.add(
                ActivationRow(
                    transducer_key=model.calibration.transducer_key,
                    counter_key=model.calibration.counter_key,
                    model=model,
                    activated=datetime.now(UTC),
                    operator=operator,
                    reason=reason,
                )
            )

    def deactivate(
        self,
        transducer_serial: str,
        counter_identity: str,
        *,
        operator: str = "",
        reason: str = "",
    ) -> None:
        """Take the compensation of a chain out of use; the history keeps what was active."""
        with self.session() as session:
            session.add(
                ActivationRow(
                    transducer_key=instrument_row(session, "transducer", transducer_serial).id,
                    counter_key=instrument_row(session, "counter", counter_identity).id,
                    model=None,
                    activated=datetime.now(UTC),
                    operator=operator,
                    reason=reason,
                )
            )

    def active_model(self, transducer_serial: str, counter_identity: str) -> ModelEntry | None:
        """Return the model in use for a transducer read by a counter, or None.

        Raises
        ------
        ModelMismatchError
            Where the transducer has a model in use, but only together with another counter: a
            timebase error is part of what was calibrated.
        """
        latest = {
            activation.counter_identity: activation.model_id
            for activation in self.activations(transducer_serial)
        }
        model_id = latest.get(counter_identity)
        if model_id is not None:
            return self.model(model_id)
        others = sorted(name for name, other in latest.items() if other is not None)
        if others and counter_identity not in latest:
            raise ModelMismatchError(
                f"transducer {transducer_serial} is read by counter {counter_identity}",
                f"counter {', '.join(others)}, which its model was made with",
                "calibrate again with this counter",
            )
        return None

    def activations(self, transducer_serial: str) -> list[Activation]:
        """Return the history of a transducer's models in use, the oldest first."""
        counter = aliased(InstrumentRow)
        query = (
            select(ActivationRow, counter.serial)
            .join(InstrumentRow, ActivationRow.transducer_key == InstrumentRow.id)
            .join(counter, ActivationRow.counter_key == counter.id)
            .where(InstrumentRow.serial == transducer_serial)
            .order_by(ActivationRow.id)
        )
        with self.session() as session:
            return [
                Activation(
                    model_id=row.model_key,
                    transducer_serial=transducer_serial,
                    counter_identity=identity,
                    activated=row.activated,
                    operator=row.operator,
                    reason=row.reason,
                )
                for row, identity in session.execute(query)
            ]

    # Verifications

    def add_verification(
        self,
        model_id: int,
        result: VerificationResult,
        *,
        run_id: str | None = None,
        performed: datetime | None = None,
    ) -> None:
        """Register what a verification found for a model.

        Raises
        ------
        RecordError
            Where the model or the run isn't registered.
        """
        with self.session() as session:
            model = session.get(ModelRow, model_id)
            if model is None:
                raise RecordError(f"model {model_id} isn't registered", "a registered model")
            session.add(
                VerificationRow(
                    model=model,
                    run=None if run_id is None else run_row(session, run_id),
                    performed=performed or datetime.now(UTC),
                    data_sha256=result.data_sha256,
                    simulated=result.simulated,
                    summary=as_json(result),
                )
            )

    def verifications(self, model_id: int) -> list[VerificationEntry]:
        """Return what verifications found for a model, the oldest first."""
        query = (
            select(VerificationRow)
            .where(VerificationRow.model_key == model_id)
            .order_by(VerificationRow.id)
        )
        with self.session() as session:
            return [
                VerificationEntry(
                    model_id=row.model_key,
                    run_id=row.run.run_id if row.run else None,
                    performed=row.performed,
                    data_sha256=row.data_sha256,
                    simulated=row.simulated,
                    summary=row.summary,
                )
                for row in session.scalars(query)
            ]

    def _summary(self, row: RunRow) -> RunSummary:
        names = [name for name in RunSummary.__dataclass_fields__ if name != "folder"]
        values = {name: getattr(row, name) for name in names}
        return RunSummary(**values, folder=self.root / row.folder)

    def _model_entry(self, row: ModelRow) -> ModelEntry:
        calibration = row.calibration
        return ModelEntry(
            model_id=row.id,
            calibration_id=row.calibration_key,
            kind=row.kind,
            file=self.root / row.file,
            file_sha256=row.file_sha256,
            range_nm=row.range_nm,
            side=row.side,
            transducer_serial=calibration.transducer.serial,
            counter_identity=calibration.counter.serial,
            metrics=row.metrics,
            created=row.created,
            simulated=calibration.simulated,
        )


def _calibration_entry(row: CalibrationRow) -> CalibrationEntry:
    return CalibrationEntry(
        calibration_id=row.id,
        run_id=row.run.run_id if row.run else None,
        transducer_serial=row.transducer.serial,
        counter_identity=row.counter.serial,
        performed=row.performed,
        range_nm=row.range_nm,
        points=row.points,
        data_sha256=row.data_sha256,
        profile_name=row.profile_name,
        profile_sha256=row.profile_sha256,
        simulated=row.simulated,
        summary=row.summary,
    )
