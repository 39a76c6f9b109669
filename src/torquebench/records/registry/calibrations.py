"""The registry's calibrations, models and their activation, verifications and checks."""

from collections.abc import Mapping, Sequence
from datetime import UTC, date, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torquebench.errors import InputError, ModelMismatchError, RecordError
from torquebench.message import Message
from torquebench.records.files import sha256_of_file
from torquebench.records.registry.entries import (
    Activation,
    CalibrationEntry,
    CheckEntry,
    ModelEntry,
    VerificationEntry,
)
from torquebench.records.registry.entry_rows import EntryRecords, as_json

if TYPE_CHECKING:
    from torquebench.calibration import CalibrationData, Contradiction, VerificationResult

__all__ = ["CalibrationRecords"]


class CalibrationRecords(EntryRecords):
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
        low, high = min(data.standard_nm.min(), 0.0), max(data.standard_nm.max(), 0.0)
        entry = CalibrationEntry(
            calibration_id=0,
            run_id=run_id,
            transducer_serial=data.transducer_serial,
            counter_identity=data.counter_identity,
            standard_serial=standard_serial,
            performed=performed or datetime.now(UTC),
            measured_by=measured_by,
            range_nm=data.range_nm,
            valid_nm=(float(low), float(high)),
            due=due,
            points=len(data),
            data_sha256=data.sha256(),
            profile_name=profile_name,
            profile_sha256=profile_sha256,
            simulated=data.simulated,
            files=files or {},
            summary={**(summary or {}), "span_error_percent": span_errors(data)},
        )
        return self.calibration(self._add(entry))

    def calibration(self, calibration_id: int) -> CalibrationEntry:
        """Return one calibration.

        Raises
        ------
        RecordError
            Where it isn't registered.
        """
        for entry in self.entries(CalibrationEntry, calibration_id=calibration_id):
            return entry
        raise RecordError(
            Message("calibration {calibration_id} isn't registered", calibration_id),
            "a registered calibration",
        )

    def calibrations(
        self, transducer_serial: str | None = None, *, limit: int | None = None
    ) -> list[CalibrationEntry]:
        """Return calibrations, all or of one transducer, the newest first."""
        return self.entries(
            CalibrationEntry, newest_first=True, limit=limit, transducer_serial=transducer_serial
        )

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
        found = {"contradictions": contradictions} if contradictions else {}
        entry = ModelEntry(
            model_id=0,
            calibration_id=calibration.calibration_id,
            kind=kind,
            file=file,
            file_sha256=sha256_of_file(file),
            range_nm=calibration.range_nm,
            side=side,
            transducer_serial=calibration.transducer_serial,
            counter_identity=calibration.counter_identity,
            metrics={**(metrics or {}), **found},
            created=created or datetime.now(UTC),
            simulated=calibration.simulated,
        )
        return self.model(self._add(entry))

    def model(self, model_id: int) -> ModelEntry:
        """Return one model.

        Raises
        ------
        RecordError
            Where it isn't registered.
        """
        for entry in self.entries(ModelEntry, model_id=model_id):
            return entry
        raise RecordError(
            Message("model {model_id} isn't registered", model_id), "a registered model"
        )

    def models(
        self,
        transducer_serial: str | None = None,
        *,
        calibration_id: int | None = None,
        limit: int | None = None,
    ) -> list[ModelEntry]:
        """Return models, all or those of a transducer or a calibration, the newest first."""
        return self.entries(
            ModelEntry,
            newest_first=True,
            limit=limit,
            transducer_serial=transducer_serial,
            calibration_id=calibration_id,
        )

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
        with self.writing():
            model = self.model(model_id)
            contradictions = model.contradictions
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
            chain = model.transducer_serial, model.counter_identity
            self._add(Activation(model_id, *chain, datetime.now(UTC), operator, reason))

    def deactivate(
        self,
        transducer_serial: str,
        counter_identity: str,
        *,
        operator: str = "",
        reason: str = "",
    ) -> None:
        """Deactivate the compensation of a chain; the history keeps earlier ones."""
        chain = transducer_serial, counter_identity
        self._add(Activation(None, *chain, datetime.now(UTC), operator, reason))

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
        return self.entries(Activation, transducer_serial=transducer_serial)

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
        entry = VerificationEntry(
            model_id=self.model(model_id).model_id,
            run_id=run_id,
            performed=performed or datetime.now(UTC),
            measured_by=measured_by,
            data_sha256=result.data_sha256,
            simulated=result.simulated,
            summary=as_json(result),
        )
        self._add(entry)

    def verifications(self, model_id: int) -> list[VerificationEntry]:
        """Return the verifications of a model, the oldest first."""
        return self.entries(VerificationEntry, model_id=model_id)

    # Checks

    def add_check(self, entry: CheckEntry) -> None:
        """Register a quick check against the check standard.

        Raises
        ------
        RecordError
            Where its run isn't registered.
        """
        self._add(entry)

    def checks(self, transducer_serial: str) -> list[CheckEntry]:
        """Return the checks of a transducer, the oldest first."""
        return self.entries(
            CheckEntry, order=("performed", "id"), transducer_serial=transducer_serial
        )
