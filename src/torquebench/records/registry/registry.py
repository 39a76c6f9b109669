"""The registry: all records of a data directory, in a hash chain that reveals every change."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from sqlalchemy import func, select

from torquebench.errors import InputError, ModelMismatchError, RecordError
from torquebench.message import Message
from torquebench.records.accounts import Accounts, name_key
from torquebench.records.chain import canonical
from torquebench.records.equipment_kinds import EquipmentKind
from torquebench.records.files import plain_json, sha256_of_file
from torquebench.records.registry.entries import (
    Activation,
    Adjustment,
    Amendment,
    CalibrationEntry,
    CertificateEntry,
    CheckEntry,
    Component,
    ComponentChange,
    Equipment,
    Identity,
    ModelEntry,
    Report,
    Review,
    VerificationEntry,
    Zeroing,
    metadata,
)
from torquebench.records.registry.runs import RunRecords
from torquebench.records.signatures import Signature

if TYPE_CHECKING:
    from torquebench.calibration import Contradiction, VerificationResult

Subject = Literal[
    "equipment",
    "equipment_descriptions",
    "components",
    "adjustments",
    "reports",
    "zeroings",
    "runs",
    "run_ends",
    "calibrations",
    "models",
    "activations",
    "verifications",
    "checks",
    "certificates",
]
"""Tables whose records can be reviewed and amended."""
_DOERS = ("measured_by", "performed_by", "authorised_by", "operator")


class Registry(RunRecords):
    """The records of a data directory, in SQLite by default and in PostgreSQL by URL.

    Open it by `Registry.open` for a data directory, or by `Registry` with a database URL and the
    data directory; see `Database`. Records are added and amended, never changed.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from torquebench.records.registry.entries import Equipment
    >>> with tempfile.TemporaryDirectory() as folder, Registry.open(Path(folder)) as registry:
    ...     registry.add_equipment(Equipment("transducer", "T-1", range_nm=2000.0))
    ...     [equipment.serial for equipment in registry.equipment()], registry.head().sequence
    (['T-1'], 2)
    """

    # -- equipment ------------------------------------------------------------------------------

    def add_equipment(self, equipment: Equipment) -> None:
        """Register new equipment, or changed data of registered equipment."""
        self._add_changed(equipment)

    def equipment(
        self, kind: EquipmentKind | None = None, serial: str | None = None
    ) -> list[Equipment]:
        """Return registered equipment, optionally of one kind or serial, sorted by both."""
        latest = select(func.max(Equipment.number)).group_by(Equipment.equipment_key)
        query = (
            select(Identity, Equipment)
            .outerjoin(
                Equipment,
                (Equipment.equipment_key == Identity.number) & Equipment.number.in_(latest),
            )
            .order_by(Identity.kind, Identity.serial)
        )
        if kind is not None:
            query = query.where(Identity.kind == kind)
        if serial is not None:
            query = query.where(Identity.serial == serial)
        with self.session() as session:
            rows: list[Any] = list(session.execute(query))
            return [
                Equipment(identity.kind, identity.serial)
                if described is None
                else self.complete(described)
                for identity, described in rows
            ]

    def _add_changed(self, entry: Equipment | Report, unimportant: tuple[str, ...] = ()) -> None:
        """Append an entry unless it equals the latest entry of the same equipment."""
        with self.writing():
            latest = self.entries(
                type(entry), newest_first=True, limit=1, kind=entry.kind, serial=entry.serial
            )
            compared = [
                each.name for each in fields(entry) if each.compare and each.name not in unimportant
            ]
            if not latest or any(
                getattr(latest[0], name) != getattr(entry, name) for name in compared
            ):
                self.add(entry)

    def fit_component(
        self,
        whole: tuple[EquipmentKind, str],
        part: tuple[EquipmentKind, str],
        role: str,
        *,
        performed_by: str = "",
        reason: str = "",
        signature: Signature | None = None,
    ) -> None:
        """Register that a part was fitted into a whole and replaces the earlier part.

        Nothing is registered if the part is fitted already.

        Raises
        ------
        InputError
            Where a name belongs to an account and was typed by somebody else.
        """
        Accounts.of(self.root).refuse_typed(performed_by, signature or Signature.typed())
        with self.writing():
            whole_key, part_key = self.equipment_key(*whole), self.equipment_key(*part)
            present = self._fitted(whole_key).get(role)
            if present is not None and present.part_key == part_key:
                return
            what = datetime.now(UTC), performed_by, reason
            if present is not None:
                self.add(ComponentChange(whole_key, present.part_key, role, "removed", *what))
            self.add(ComponentChange(whole_key, part_key, role, "fitted", *what))

    def components(self, whole: tuple[EquipmentKind, str]) -> list[Component]:
        """Return the parts fitted into a whole at present, by role."""
        with self.session():
            identities = {each.number: each for each in self.entries(Identity)}
            fitted = {
                role: (identities[change.part_key], change)
                for (key, each) in identities.items()
                if (each.kind, each.serial) == whole
                for role, change in sorted(self._fitted(key).items())
            }
        return [
            Component(whole, (part.kind, part.serial), role, change.performed, change.performed_by)
            for role, (part, change) in fitted.items()
        ]

    def _fitted(self, whole_key: int) -> dict[str, ComponentChange]:
        """Return the latest change of each role in which a part is fitted."""
        latest = {each.role: each for each in self.entries(ComponentChange, whole_key=whole_key)}
        return {role: change for role, change in latest.items() if change.change == "fitted"}

    def add_adjustment(self, adjustment: Adjustment, signature: Signature | None = None) -> None:
        """Register work on a piece of equipment that may change its indication.

        Raises
        ------
        InputError
            Where a name belongs to an account and was typed by somebody else.
        """
        accounts, typed = Accounts.of(self.root), Signature.typed()
        accounts.refuse_typed(adjustment.performed_by, signature or typed)
        accounts.refuse_typed(adjustment.checked_by, typed)
        self.add(adjustment)

    def adjustments(self, serial: str) -> list[Adjustment]:
        """Return the work on a piece of equipment, the oldest first."""
        return self.entries(Adjustment, serial=serial)

    def add_report(self, report: Report) -> None:
        """Register the certificate of a standard unless the same certificate is registered already.

        Raises
        ------
        RecordError
            Where its file is missing.
        """
        if report.file is not None and not report.file.is_file():
            raise RecordError(
                Message("certificate {file} is missing", report.file), "a file that can be read"
            )
        digest = "" if report.file is None else sha256_of_file(report.file)
        # The same certificate may be in another folder.
        self._add_changed(replace(report, file_sha256=digest), ("file",))

    def reports(self, serial: str) -> list[Report]:
        """Return the certificates of a standard, the newest first."""
        return self.entries(Report, newest_first=True, serial=serial)

    def add_zeroing(self, zeroing: Zeroing) -> None:
        """Register the zero of a transducer.

        Raises
        ------
        RecordError
            Where its run isn't registered.
        """
        self.add(zeroing)

    def zeroings(self, transducer_serial: str) -> list[Zeroing]:
        """Return the zeros of a transducer, the oldest first."""
        return self.entries(Zeroing, order=("performed", "id"), transducer_serial=transducer_serial)

    # -- calibrations ---------------------------------------------------------------------------

    def add_calibration(self, entry: CalibrationEntry) -> CalibrationEntry:
        """Register a calibration, and its transducer and counter if they are new.

        Raises
        ------
        RecordError
            Where transducer or counter aren't named, the run isn't registered, or the same points
            of a real bench are registered already.
        """
        if not entry.transducer_serial or not entry.counter_identity:
            raise RecordError(
                Message(
                    "a calibration of transducer {transducer_serial!r} with counter "
                    "{counter_identity!r}",
                    entry.transducer_serial,
                    entry.counter_identity,
                ),
                "the serial of the transducer and the identity of its counter",
                "name both in the table or the bench description",
            )
        same = self.entries(CalibrationEntry, data_sha256=entry.data_sha256)
        if same and not entry.simulated:  # a simulated bench repeats its noise
            raise RecordError(
                Message(
                    "the points of run {run} are those of calibration-{number}",
                    entry.run_id or "",
                    same[0].calibration_id,
                ),
                "points that aren't registered yet",
                "remove the copy of the run's folder",
            )
        return self.calibration(self.add(entry))

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
        self,
        transducer_serial: str | None = None,
        *,
        limit: int | None = None,
        problems: list[str] | None = None,
    ) -> list[CalibrationEntry]:
        """Return all calibrations, or those of one transducer, the newest first; see `entries`."""
        return self.entries(
            CalibrationEntry,
            newest_first=True,
            limit=limit,
            problems=problems,
            transducer_serial=transducer_serial,
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
            Contradictions in its calibration; if there are any, only a person can activate the
            model.
        created : datetime.datetime, optional
            When it was fitted, with time zone; now by default.

        Raises
        ------
        RecordError
            Where the file is missing.
        """
        if not file.is_file():
            raise RecordError(Message("model file {file} is missing", file), "a model file")
        entry = ModelEntry(
            calibration_id=calibration.calibration_id,
            kind=kind,
            file=file,
            file_sha256=sha256_of_file(file),
            range_nm=calibration.range_nm,
            side=side,
            metrics={
                **(metrics or {}),
                **({"contradictions": contradictions} if contradictions else {}),
            },
            created=created or datetime.now(UTC),
        )
        return self.model(self.add(entry))

    def model(self, model_id: int) -> ModelEntry:
        """Return one model.

        Raises
        ------
        RecordError
            Where it isn't registered.
        """
        for entry in self._in_use(self.entries(ModelEntry, model_id=model_id)):
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
        problems: list[str] | None = None,
    ) -> list[ModelEntry]:
        """Return all models, or those of a transducer or a calibration, the newest first.

        The attribute `active` says whether a model is in use.
        """
        return self._in_use(
            self.entries(
                ModelEntry,
                newest_first=True,
                limit=limit,
                problems=problems,
                transducer_serial=transducer_serial,
                calibration_id=calibration_id,
            )
        )

    def _in_use(self, models: list[ModelEntry]) -> list[ModelEntry]:
        """Set the attribute `active` of models and return them."""
        serials = {model.transducer_serial for model in models}
        latest = {
            (each.transducer_serial, each.counter_identity): each.model_id
            for serial in serials
            for each in self.activations(serial)
        }
        for model in models:
            chain = model.transducer_serial, model.counter_identity
            model.active = latest.get(chain) == model.model_id
        return models

    # -- activation -----------------------------------------------------------------------------

    def activate(
        self,
        model_id: int,
        *,
        operator: str = "",
        reason: str = "",
        despite_contradictions: bool = False,
        signature: Signature | None = None,
    ) -> None:
        """Put a model into use for the transducer and the counter that it was made with.

        Parameters
        ----------
        operator, reason : str
            Person and reason of the decision.
        despite_contradictions : bool
            Whether to activate even a model whose calibration contradicts itself; this needs the
            operator's name and a reason.
        signature : Signature, optional
            How the operator was authenticated; by default typed by the user of this computer.

        Raises
        ------
        RecordError
            Where the model isn't registered, or its calibration contradicts itself.
        InputError
            Where such a model is activated without a name or a reason.
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
                    "find the cause and calibrate again, or activate it despite "
                    "contradictions with a name and a reason",
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
                    "the name of the person who decides, and the reason",
                )
            if contradictions:
                reason = Message("although its calibration contradicts itself: {reason}", reason)
            signature = signature or Signature.typed()
            Accounts.of(self.root).refuse_typed(operator, signature)
            self.add(
                Activation(
                    transducer_serial=model.transducer_serial,
                    counter_identity=model.counter_identity,
                    model_id=model_id,
                    activated=datetime.now(UTC),
                    operator=operator,
                    reason=reason,
                    signature=signature.about(self.covered(model.calibration_id)),
                )
            )

    def deactivate(
        self,
        transducer_serial: str,
        counter_identity: str,
        *,
        operator: str = "",
        reason: str = "",
        signature: Signature | None = None,
    ) -> None:
        """Deactivate the compensation of a chain; earlier activations stay in the history."""
        signature = signature or Signature.typed()
        Accounts.of(self.root).refuse_typed(operator, signature)
        self.add(
            Activation(
                transducer_serial=transducer_serial,
                counter_identity=counter_identity,
                model_id=None,
                activated=datetime.now(UTC),
                operator=operator,
                reason=reason,
                signature=signature,
            )
        )

    def active_model(self, transducer_serial: str, counter_identity: str) -> ModelEntry | None:
        """Return the model in use for a transducer read by a counter, or None.

        Raises
        ------
        ModelMismatchError
            If the transducer's active model was made with another counter, whose timebase error is
            part of the calibration.
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
                Message("counter {others}, with which its model was made", ", ".join(others)),
                "calibrate again with this counter",
            )
        return None

    def activations(self, transducer_serial: str) -> list[Activation]:
        """Return the activations of a transducer's models, the oldest first."""
        return self.entries(Activation, transducer_serial=transducer_serial)

    # -- verifications, checks ------------------------------------------------------------------

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
            summary=plain_json(result),
        )
        self.add(entry)

    def verifications(self, model_id: int) -> list[VerificationEntry]:
        """Return the verifications of a model, the oldest first."""
        return self.entries(VerificationEntry, model_id=model_id)

    def add_check(self, entry: CheckEntry) -> None:
        """Register a quick check against the check standard.

        Raises
        ------
        RecordError
            Where its run isn't registered.
        """
        self.add(entry)

    def checks(self, transducer_serial: str) -> list[CheckEntry]:
        """Return the checks of a transducer, the oldest first."""
        return self.entries(
            CheckEntry, order=("performed", "id"), transducer_serial=transducer_serial
        )

    # -- certificates ---------------------------------------------------------------------------

    def add_certificate(self, entry: CertificateEntry) -> None:
        """Register an issued certificate.

        Raises
        ------
        RecordError
            Where the number exists already, or the calibration or the replaced certificate isn't
            registered.
        """
        with self.writing():
            Accounts.of(self.root).refuse_typed(
                entry.authorised_by, entry.signature or Signature.typed()
            )
            if self.entries(CertificateEntry, number=entry.number):
                raise RecordError(
                    Message("certificate {number} is already issued", entry.number),
                    "a new number",
                    "issue an amended certificate that supersedes it, with a new number",
                )
            self.calibration(entry.calibration_id)
            if entry.supersedes and not self.entries(CertificateEntry, number=entry.supersedes):
                raise RecordError(
                    Message("certificate {supersedes} isn't registered", entry.supersedes),
                    "an issued one",
                )
            self.add(entry)

    def certificates(self, calibration_id: int | None = None) -> list[CertificateEntry]:
        """Return all certificates, or those of one calibration, the newest first."""
        entries = self.entries(CertificateEntry, newest_first=True)
        newer = {entry.supersedes: entry.number for entry in reversed(entries)}
        for entry in entries:
            entry.superseded_by = newer.get(entry.number, "")
        return [each for each in entries if calibration_id in (None, each.calibration_id)]

    # -- reviews, amendments --------------------------------------------------------------------

    def review(self, subject: Subject, subject_id: int, *, checked_by: str, **options: Any) -> None:
        """Register the review of a record; `prepare_review` describes options and errors."""
        with self.writing():
            self.add(self.prepare_review(subject, subject_id, checked_by=checked_by, **options))

    def prepare_review(
        self,
        subject: Subject,
        subject_id: int,
        *,
        checked_by: str,
        accepted: bool = True,
        remark: str = "",
        signature: Signature | None = None,
    ) -> Review:
        """Return the review of a record without registering it.

        Parameters
        ----------
        subject, subject_id : str, int
            The record: its table and number.
        checked_by : str
            The person.
        signature : Signature, optional
            How the reviewer was authenticated; by default typed by the user of this computer.

        Raises
        ------
        RecordError
            If there is no such record, no person is named, or the reviewer measured or entered it.
        """
        signature, accounts = signature or Signature.typed(), Accounts.of(self.root)
        accounts.refuse_typed(checked_by, signature)
        content = self._content(subject, subject_id)
        measured_by = next((content[name] for name in _DOERS if content.get(name)), "")
        entered_by = (content.get("summary") or {}).get("entered by", "")
        doers = [str(each) for each in (measured_by, entered_by) if each]
        own = name_key(checked_by) in map(name_key, doers)
        if content.get("signature"):
            measured = Signature.restored(content["signature"])
            own = own or bool(accounts.same_person(measured, signature))
        if not checked_by.strip() or own:
            raise RecordError(
                Message(
                    "{subject} {subject_id} checked by {checked_by}",
                    subject,
                    subject_id,
                    checked_by.strip() or "nobody",
                ),
                Message("a person other than {doers}", " and ".join(doers)) if doers else "a name",
                "have a second person review it",
            )
        covers: dict[str, str] = {subject: _sha256(content)}
        if subject == "calibrations":
            covers = self.covered(subject_id)
        return Review(
            subject,
            subject_id,
            datetime.now(UTC),
            checked_by.strip(),
            accepted,
            remark,
            signature.about(covers),
        )

    def covered(self, calibration_id: int) -> dict[str, str]:
        """Return the hashes, by name, of the records that a signature under a calibration covers.

        These are the calibration as entered, its models, and the latest verification of each model.
        """
        found = {"calibration": _sha256(self._content("calibrations", calibration_id))}
        for model in self.entries(ModelEntry, calibration_id=calibration_id):
            found[f"model-{model.model_id}"] = model.file_sha256
            verifications = self.verifications(model.model_id)
            if verifications:
                latest = self._content("verifications", verifications[-1].number)
                found[f"verification of model-{model.model_id}"] = _sha256(latest)
        return found

    def reviews(self, subject: Subject, subject_id: int) -> list[Review]:
        """Return the reviews of a record, the oldest first."""
        return self.entries(Review, subject=subject, subject_id=subject_id)

    def amend(
        self,
        subject: Subject,
        subject_id: int,
        changes: Mapping[str, Any],
        *,
        amended_by: str,
        reason: str,
        signature: Signature | None = None,
    ) -> None:
        """Register an amendment of a record; the record itself stays unchanged.

        Parameters
        ----------
        subject, subject_id : str, int
            The record that is amended: its table and number.
        changes : mapping of str to value
            Field to its correct value.
        amended_by, reason : str
            Person and reason.
        signature : Signature, optional
            How the person was authenticated; by default typed by the user of this computer.

        Raises
        ------
        RecordError
            If there is no such record or field, or no person or reason is named.
        """
        for what, given in (
            ("changes", changes),
            ("a name", amended_by.strip()),
            ("a reason", reason.strip()),
        ):
            if not given:
                raise RecordError(
                    Message(
                        "an amendment of {subject} {subject_id} without {what}",
                        subject,
                        subject_id,
                        what,
                    ),
                    "the correct values, the name of the person who amends, and the reason",
                )
        signature = signature or Signature.typed()
        Accounts.of(self.root).refuse_typed(amended_by, signature)
        with self.writing():
            content = self._content(subject, subject_id)
            for name in changes:
                if name not in content or name == "id":
                    known = ", ".join(sorted(set(content) - {"id"}))
                    raise RecordError(
                        Message("{subject} have no field {name}", subject, name), known
                    )
            now, by = datetime.now(UTC), amended_by.strip()
            covers = signature.about({subject: _sha256(content)})
            self.add(Amendment(subject, subject_id, now, by, reason.strip(), changes, covers))

    def amendments(self, subject: Subject, subject_id: int) -> list[Amendment]:
        """Return the amendments of a record, the oldest first."""
        return self.entries(Amendment, subject=subject, subject_id=subject_id)

    def _content(self, subject: Subject, subject_id: int) -> dict[str, Any]:
        """Return the columns of the record that is reviewed or amended."""
        if subject not in get_args(Subject):
            raise RecordError(
                Message("a record of kind {subject}", subject), ", ".join(get_args(Subject))
            )
        table = metadata.tables[subject]
        with self.session() as session:
            row = session.execute(select(table).where(table.c.id == subject_id)).one_or_none()
        if row is None:
            raise RecordError(
                Message("{subject} {subject_id} isn't registered", subject, subject_id),
                "a registered record",
            )
        return dict(row._mapping)


def _sha256(content: Mapping[str, Any]) -> str:
    """Return the hash of a row's content, as in its link of the chain."""
    return hashlib.sha256(canonical(content).encode()).hexdigest()
