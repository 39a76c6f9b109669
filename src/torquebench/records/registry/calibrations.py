"""The registry's calibrations, models and their activation, verifications and checks."""

from collections.abc import Mapping, Sequence
from datetime import UTC, date, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sqlalchemy import select
from sqlalchemy.orm import Session, aliased

from torquebench.errors import InputError, ModelMismatchError, RecordError
from torquebench.message import Message
from torquebench.records.files import sha256_of_file
from torquebench.records.registry.database import (
    Database,
    as_json,
    entry_of,
    equipment_row,
    row_of,
    run_row,
)
from torquebench.records.registry.entries import (
    Activation,
    CalibrationEntry,
    CheckEntry,
    ModelEntry,
    VerificationEntry,
)
from torquebench.records.registry.schema import (
    ActivationRow,
    CalibrationRow,
    CheckRow,
    EquipmentRow,
    ModelRow,
    RunRow,
    VerificationRow,
)

if TYPE_CHECKING:
    from torquebench.calibration import CalibrationData, Contradiction, VerificationResult

__all__ = ["CalibrationRecords"]


class CalibrationRecords(Database):
    """Calibrations, models, activations, verifications and checks."""

    def add_calibration(
        self,
        data: "CalibrationData",
        *,
        performed: datetime | None = None,
        run_id: str | None = None,
        standard_serial: str = "",
        profile_name: str = "",
        profile_sha256: str = "",
        measured_by: str = "",
        due: date | None = None,
        files: Mapping[str, str] | None = None,
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
        measured_by : str
            Who did it. Its review is entered later; see `review`.
        due : datetime.date, optional
            When the chain is to be calibrated again.
        files : mapping of str to str, optional
            SHA-256 of the files that hold it, by their names.
        summary : mapping, optional
            Further data to store with it. The errors of its span are always kept: control charts
            are drawn from them.

        Raises
        ------
        RecordError
            Where transducer or counter aren't named, or the run isn't registered.
        """
        from torquebench.calibration import span_errors  # not imported for lists of records

        if not data.transducer_serial or not data.counter_identity:
            raise RecordError(
                Message(
                    "a calibration of transducer {transducer_serial!r} with counter "
                    "{counter_identity!r}",
                    data.transducer_serial,
                    data.counter_identity,
                ),
                "the serial of the transducer and the identity of its counter",
                "name both in the table or the bench description",
            )
        with self.writing() as session:
            row = CalibrationRow(
                run=None if run_id is None else run_row(session, run_id),
                transducer=equipment_row(session, "transducer", data.transducer_serial),
                counter=equipment_row(session, "counter", data.counter_identity),
                performed=performed or datetime.now(UTC),
                measured_by=measured_by,
                range_nm=data.range_nm,
                valid_low_nm=float(min(data.standard_nm.min(), 0.0)),
                valid_high_nm=float(max(data.standard_nm.max(), 0.0)),
                due=due,
                points=len(data),
                data_sha256=data.sha256(),
                profile_name=profile_name,
                profile_sha256=profile_sha256,
                simulated=data.simulated,
                files=dict(files or {}),
                summary=as_json({**(summary or {}), "span_error_percent": span_errors(data)}),
            )
            if standard_serial:
                row.standard_key = equipment_row(session, "calibrator", standard_serial).id
            session.add(row)
            session.flush()
            return _calibration_entry(row)

    def calibration(self, calibration_id: int) -> CalibrationEntry:
        """Return one calibration.

        Raises
        ------
        RecordError
            Where it isn't registered.
        """
        with self.session() as session:
            row = session.get(CalibrationRow, calibration_id)
            if row is None:
                raise RecordError(
                    Message("calibration {calibration_id} isn't registered", calibration_id),
                    "a registered calibration",
                )
            return _calibration_entry(row)

    def calibrations(
        self, transducer_serial: str | None = None, *, limit: int | None = None
    ) -> list[CalibrationEntry]:
        """Return calibrations, all or of one transducer, the newest first."""
        query = select(CalibrationRow).order_by(CalibrationRow.id.desc()).limit(limit)
        if transducer_serial is not None:
            query = query.join(CalibrationRow.transducer).where(
                EquipmentRow.serial == transducer_serial
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
        contradictions: "Sequence[Contradiction]" = (),
        created: datetime | None = None,
    ) -> ModelEntry:
        """Register a fitted model by its file.

        Parameters
        ----------
        calibration : CalibrationEntry
            The calibration that it was fitted to.
        kind : str
            Kind of model.
        file : pathlib.Path
            The model file, which is hashed.
        side : str
            ``"input"`` or ``"output"``.
        metrics : mapping, optional
            Errors of its cross-validation.
        contradictions : sequence of Contradiction
            Contradictions of its calibration; it is then activated only by a person's decision.
        created : datetime.datetime, optional
            When, with time zone; now by default.

        Raises
        ------
        RecordError
            Where the file is missing.
        """
        if not file.is_file():
            raise RecordError(Message("model file {file} is missing", file), "a model file")
        with self.writing() as session:
            row = ModelRow(
                calibration_key=calibration.calibration_id,
                kind=kind,
                file=self.stored(file),
                file_sha256=sha256_of_file(file),
                range_nm=calibration.range_nm,
                side=side,
                metrics=as_json(
                    {
                        **(metrics or {}),
                        **({"contradictions": contradictions} if contradictions else {}),
                    }
                ),
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
            return self._model_entry(_model(session, model_id))

    def models(
        self, transducer_serial: str | None = None, *, limit: int | None = None
    ) -> list[ModelEntry]:
        """Return models, all or of one transducer, the newest first."""
        query = select(ModelRow).order_by(ModelRow.id.desc()).limit(limit)
        if transducer_serial is not None:
            query = (
                query.join(ModelRow.calibration)
                .join(CalibrationRow.transducer)
                .where(EquipmentRow.serial == transducer_serial)
            )
        with self.session() as session:
            return [self._model_entry(row) for row in session.scalars(query)]

    # Activation

    def activate(
        self,
        model_id: int,
        *,
        operator: str = "",
        reason: str = "",
        despite_contradictions: bool = False,
    ) -> None:
        """Put a model into use for the transducer and the counter that it was made with.

        Parameters
        ----------
        model_id : int
        operator, reason : str
            Person and reason of the decision.
        despite_contradictions : bool
            Whether the operator, by name and with a reason, takes a model whose calibration
            contradicts itself.

        Raises
        ------
        RecordError
            Where the model isn't registered, or its calibration contradicts itself.
        InputError
            Where such a model is taken without a name or a reason.
        """
        with self.writing() as session:
            model = _model(session, model_id)
            contradictions = self._model_entry(model).contradictions
            if contradictions and not despite_contradictions:
                raise RecordError(
                    Message(
                        "the calibration of model-{number} contradicts itself: {what}",
                        model_id,
                        Message.joined((each.found for each in contradictions), "; "),
                    ),
                    "a plausible calibration",
                    "find the cause and calibrate again, or take it by name and with a reason",
                )
            if contradictions and not (operator.strip() and reason.strip()):
                raise InputError(
                    Message(
                        "model-{model_id}, whose calibration contradicts itself, without a reason",
                        model_id,
                    )
                    if operator.strip()
                    else Message(
                        "model-{model_id}, whose calibration contradicts itself, without a name",
                        model_id,
                    ),
                    "the name of who takes it, and the reason",
                )
            if contradictions:
                reason = Message("although its calibration contradicts itself: {reason}", reason)
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
        """Deactivate the compensation of a chain; the history keeps earlier ones."""
        with self.writing() as session:
            session.add(
                ActivationRow(
                    transducer_key=equipment_row(session, "transducer", transducer_serial).id,
                    counter_key=equipment_row(session, "counter", counter_identity).id,
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
            If the transducer's active model belongs to another counter: a timebase error is part of
            the calibration.
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
                Message(
                    "transducer {transducer_serial} is read by counter {counter_identity}",
                    transducer_serial,
                    counter_identity,
                ),
                Message("counter {others}, which its model was made with", ", ".join(others)),
                "calibrate again with this counter",
            )
        return None

    def activations(self, transducer_serial: str) -> list[Activation]:
        """Return the history of a transducer's models in use, the oldest first."""
        counter = aliased(EquipmentRow)
        query = (
            select(ActivationRow, counter.serial)
            .join(EquipmentRow, ActivationRow.transducer_key == EquipmentRow.id)
            .join(counter, ActivationRow.counter_key == counter.id)
            .where(EquipmentRow.serial == transducer_serial)
            .order_by(ActivationRow.id)
        )
        with self.session() as session:
            return [
                entry_of(
                    Activation,
                    row,
                    model_id=row.model_key,
                    transducer_serial=transducer_serial,
                    counter_identity=identity,
                )
                for row, identity in session.execute(query)
            ]

    # Verifications

    def add_verification(
        self,
        model_id: int,
        result: "VerificationResult",
        *,
        run_id: str | None = None,
        performed: datetime | None = None,
        measured_by: str = "",
    ) -> None:
        """Register a verification's results for a model.

        Raises
        ------
        RecordError
            Where the model or the run isn't registered.
        """
        with self.writing() as session:
            model = _model(session, model_id)
            session.add(
                VerificationRow(
                    model=model,
                    run=None if run_id is None else run_row(session, run_id),
                    performed=performed or datetime.now(UTC),
                    measured_by=measured_by,
                    data_sha256=result.data_sha256,
                    simulated=result.simulated,
                    summary=as_json(result),
                )
            )

    def verifications(self, model_id: int) -> list[VerificationEntry]:
        """Return the verifications of a model, the oldest first."""
        query = (
            select(VerificationRow)
            .where(VerificationRow.model_key == model_id)
            .order_by(VerificationRow.id)
        )
        with self.session() as session:
            return [
                entry_of(VerificationEntry, row, model_id=row.model_key, run_id=_run_id(row.run))
                for row in session.scalars(query)
            ]

    # Checks

    def add_check(self, entry: CheckEntry) -> None:
        """Register a quick check against the check standard.

        Raises
        ------
        RecordError
            Where its run isn't registered.
        """
        with self.writing() as session:
            row = row_of(
                CheckRow,
                entry,
                transducer=equipment_row(session, "transducer", entry.transducer_serial),
                run=None if entry.run_id is None else run_row(session, entry.run_id),
                model_key=entry.model_id,
                summary=as_json(entry.summary),
            )
            if entry.standard_serial:
                standard = equipment_row(session, "verification-standard", entry.standard_serial)
                row.standard_key = standard.id
            session.add(row)

    def checks(self, transducer_serial: str) -> list[CheckEntry]:
        """Return the checks of a transducer, the oldest first."""
        query = (
            select(CheckRow)
            .join(CheckRow.transducer)
            .where(EquipmentRow.serial == transducer_serial)
            .order_by(CheckRow.performed, CheckRow.id)
        )
        with self.session() as session:
            return [
                entry_of(
                    CheckEntry,
                    row,
                    transducer_serial=transducer_serial,
                    standard_serial=row.standard.serial if row.standard else "",
                    model_id=row.model_key,
                    run_id=_run_id(row.run),
                )
                for row in session.scalars(query)
            ]

    def _model_entry(self, row: ModelRow) -> ModelEntry:
        calibration = row.calibration
        return entry_of(
            ModelEntry,
            row,
            model_id=row.id,
            calibration_id=row.calibration_key,
            file=self.root / row.file,
            transducer_serial=calibration.transducer.serial,
            counter_identity=calibration.counter.serial,
            simulated=calibration.simulated,
        )


def _calibration_entry(row: CalibrationRow) -> CalibrationEntry:
    return entry_of(
        CalibrationEntry,
        row,
        calibration_id=row.id,
        run_id=_run_id(row.run),
        transducer_serial=row.transducer.serial,
        counter_identity=row.counter.serial,
        standard_serial=row.standard.serial if row.standard else "",
        valid_nm=(row.valid_low_nm, row.valid_high_nm),
    )


def _model(session: Session, model_id: int) -> ModelRow:
    row = session.get(ModelRow, model_id)
    if row is None:
        raise RecordError(
            Message("model {model_id} isn't registered", model_id), "a registered model"
        )
    return row


def _run_id(row: RunRow | None) -> str | None:
    return None if row is None else row.run_id
