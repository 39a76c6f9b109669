"""Build the record of a certificate from a calibration in the registry."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, date, datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torquebench import __version__
from torquebench.bench.mounting_record import MountingRecord
from torquebench.calibration import (
    RAW,
    CalibrationData,
    find_deviations,
    refuse_deviations,
)
from torquebench.campaign.bench_chains import check_standard, used_chain
from torquebench.campaign.checking import judge_check
from torquebench.campaign.fitting import model_title
from torquebench.campaign.registering import run_data as run_data
from torquebench.errors import InputError, RecordError
from torquebench.message import Message
from torquebench.records import (
    Activation,
    CalibrationEntry,
    Equipment,
    Registry,
    Review,
    RunFolder,
    VerificationEntry,
)
from torquebench.records.accounts import Accounts, name_key
from torquebench.records.signatures import Signature
from torquebench.reports.certificate.record import (
    Act,
    CertificateRecord,
    Conformity,
    DeviationStatement,
    Item,
    Method,
    Party,
    Reference,
    VerificationSummary,
)
from torquebench.reports.certificate.results import (
    chain_against,
    conformity_of,
    evaluate_results,
    turning_budget,
    turning_range,
)
from torquebench.reports.certificate.source import Source
from torquebench.reports.certificate.static import static_tables

DEFAULT_TOLERANCE_PERCENT_FS = 0.1
"""0.1 % of full scale: the accuracy of the published instrument (doi 10.1177/00202940221103308)."""

UNREVIEWED = {
    "unverified": "its model isn't verified on fresh points",
    "outside": "its verification is outside the tolerance",
    "unchecked": "no second person checked it before it was put into use",
    "self_signed": "the person who authorises it measured or entered it",
    "typed_check": "the review was typed, not signed",
    "typed_use": "the activation was typed, not signed in",
    "typed_authorisation": "the authorisation was typed, not signed",
    "unknown_person": "whether the person who measured is another one is unknown",
}
"""Messages for each condition that makes a certificate unreviewed."""


@dataclass(frozen=True)
class Issue:
    """Decisions of the person who issues a certificate.

    Parameters
    ----------
    authorised_by : sequence of str
        Authorising persons, at least one.
    laboratory, customer : Party
        An unnamed laboratory is accepted for a simulated calibration only.
    languages : sequence of str
        Languages of the certificate; the first one is authoritative.
    tolerance_percent_fs : float or None
        Tolerance of the statement of conformity; None for no statement.
    number : str
        Unique number; if empty, it is made from transducer and calibration.
    issued : datetime.date, optional
        Today (UTC) by default.
    draft : bool
        Whether this is a preview; it needs no authorising person and can't be registered.
    refuse_unreviewed : bool
        Whether an unreviewed calibration is refused instead of stated on every page.
    review : Review, optional
        Review of the calibration to be registered with the certificate; see `prepare_review`.
    signature : Signature, optional
        How the authorising person was authenticated; by default typed by the user of this computer.
    require_signatures : bool
        Whether typed reviews, activations and authorisations don't count.
    model_id : int, optional
        For a draft: the model to be activated; by default the active one, or the latest.
    """

    authorised_by: Sequence[str]
    laboratory: Party = field(default_factory=Party)
    customer: Party = field(default_factory=Party)
    languages: Sequence[str] = ("en",)
    tolerance_percent_fs: float | None = DEFAULT_TOLERANCE_PERCENT_FS
    number: str = ""
    issued: date | None = None
    draft: bool = False
    refuse_unreviewed: bool = True
    review: Review | None = None
    signature: Signature | None = None
    require_signatures: bool = False
    model_id: int | None = None


def calibration_of(registry: Registry, run_id: str) -> CalibrationEntry:
    """Return the calibration that a run measured.

    Raises
    ------
    RecordError
        Where the run doesn't exist or isn't sealed.
    InputError
        Where the run isn't a calibration.
    """
    run = registry.run(run_id)
    if run.finished is None:
        raise RecordError(
            Message("run {run_id} isn't sealed: it still runs, or was interrupted", run_id),
            "a completed, sealed run",
            "wait for its end, or calibrate again",
        )
    number = registry.calibration_of_run(run_id)
    if number is not None:
        return registry.calibration(number)
    raise InputError(
        Message(
            "run {run_id} ({kind}, {status}) has no registered calibration",
            run_id,
            run.kind,
            run.status,
        ),
        "a completed calibration run",
        "list them with `torquebench records list calibrations`",
    )


def build_record(
    registry: Registry, calibration: CalibrationEntry, issue: Issue
) -> CertificateRecord:
    """Collect everything that the certificate of a calibration states.

    Run folder and model file are compared with their registered hashes, and the points with the
    profile of the run.

    Parameters
    ----------
    registry : Registry
    calibration : CalibrationEntry
        A calibration measured by a run of this registry. If it has a model, results are stated
        before and after compensation.
    issue : Issue

    Raises
    ------
    RecordError
        Where the run isn't sealed or was changed, deviates from its profile in a way that the
        profile doesn't allow, or the number exists already.
    InputError
        If no person authorises, a real laboratory has no name, or the calibration has no run.
    """
    names = _authorising(issue)
    source = Source.of(registry, calibration, issue.model_id if issue.draft else None)
    data = source.data
    _require_laboratory(source, issue)
    deviations = find_deviations(source.calibration_record(), source.profile)
    refuse_deviations(deviations)
    results = evaluate_results(
        data,
        source.chain,
        source.reference,
        tolerance_percent_fs=issue.tolerance_percent_fs,
        resolution_nm=source.stated_resolution_nm or 0.0,
    )
    static, zero_hysteresis = static_tables(
        data, source.profile, source.chain, source.reference, source.resolution_nm
    )
    measured_by = calibration.measured_by or source.run.operator
    verification = _verification(registry, source, issue.tolerance_percent_fs)
    acts = _Acts.of(registry, source, calibration, issue)
    unreviewed = _unreviewed(source, calibration, issue, verification, acts)
    if unreviewed and issue.refuse_unreviewed and not issue.draft:
        raise RecordError(
            Message(
                "calibration {number}: {what}",
                calibration.calibration_id,
                "; ".join(UNREVIEWED[each] for each in unreviewed),
            ),
            "verified within its tolerance on fresh points, checked by a second person before it "
            "went into use, authorised by somebody who didn't measure, signed where the "
            "laboratory has accounts",
            "verify it (`torquebench verification`), have it reviewed (`torquebench "
            "records review`), activate its model again (`torquebench records use`), or "
            "have another person sign",
        )
    earlier = registry.certificates(calibration.calibration_id)
    return CertificateRecord(
        number=issue.number or _number(calibration, len(earlier)),
        languages=tuple(dict.fromkeys(issue.languages)),
        draft=issue.draft,
        simulated=source.run.simulated or data.simulated,
        laboratory=issue.laboratory,
        customer=issue.customer,
        item=_item(registry, source, calibration),
        method=_method(source, calibration),
        reference=source.reference,
        calibrated_from=source.run.started.date(),
        calibrated_to=(source.run.finished or source.run.started).date(),
        issued=issue.issued or datetime.now(UTC).date(),
        run_id=source.run.run_id,
        calibration_id=calibration.calibration_id,
        temperature_c=_extremes(data.temperature_c),
        compensation=_compensation(source),
        results=results.rows,
        budget=results.budget,
        budget_step=results.budget_step,
        budget_freedom=results.budget_freedom,
        conformity=_worse(results.conformity, verification),
        verification=verification,
        static=static,
        zero_hysteresis=zero_hysteresis,
        deviations=(
            *(DeviationStatement(each.clause, each.found, each.allowed) for each in deviations),
            *missing_statements(source.reference),
        ),
        measured_by=measured_by,
        checked_by=", ".join(dict.fromkeys(each.checked_by for each in acts.reviews)),
        authorised_by=names,
        software_version=__version__,
        files=source.files(calibration),
        model_file="" if source.model_entry is None else source.model_entry.file.name,
        registry_head=str(registry.head()),
        supersedes=earlier[0].number if earlier else "",
        unreviewed=unreviewed,
        acts=tuple(acts.stated(measured_by, calibration.signature, ", ".join(names))),
        loading_accuracy=_loading(data),
        readings="" if data.scale is None else data.scale.formula,
        turning="" if source.chain is None else turning_range(source.chain),
        turning_budget=None
        if source.chain is None
        else turning_budget(data, source.chain, source.reference),
        not_in_u=()
        if source.chain is None
        else chain_against(source.reference, data.range_nm, source.chain).missing(),
        **_mounting(source),
    )


def _loading(data: CalibrationData) -> str:
    """Return the loading accuracy as text; empty where no nominal torques were requested."""
    percent = data.loading_accuracy_percent
    return "" if not percent else Message("{percent:.2g} % of range", percent)


def missing_statements(reference: Reference) -> Iterator[DeviationStatement]:
    """Yield what ISO/IEC 17025 requires of the standard's certificate and what is missing."""
    clause = "ISO/IEC 17025 7.8.4.1 c"
    if not reference.certificate_number:
        yield DeviationStatement(
            clause, "the number of the standard's certificate isn't stated", "stated"
        )
    if reference.performed is None:
        yield DeviationStatement(
            clause, "the date of the standard's certificate isn't stated", "stated"
        )


def _mounting(source: Source) -> dict[str, Any]:
    """Return the mounting's conditions as fields of the certificate's record."""
    record = MountingRecord.of_run(source.folder.metadata)
    return {} if record is None else record.stated()


def _unreviewed(
    source: Source,
    calibration: CalibrationEntry,
    issue: Issue,
    verification: VerificationSummary | None,
    acts: _Acts,
) -> tuple[str, ...]:
    """Return the keys of `UNREVIEWED` that apply to the calibration and its signatures."""
    found = []
    # The person who enters a table counts like the person who measured.
    entered_by = str(source.folder.metadata.get("entered_by") or "")
    doers = (calibration.measured_by, source.run.operator, entered_by)
    measured = {name_key(name) for name in doers if name.strip()}
    model, tolerance = source.model_entry, issue.tolerance_percent_fs
    if model is not None and verification is None:
        found.append("unverified")
    limit_nm = float("inf") if tolerance is None else tolerance / 100.0 * calibration.range_nm
    if model is not None and verification is not None and verification.worst_after_nm > limit_nm:
        found.append("outside")
    reviews = [each for each in acts.reviews if name_key(each.checked_by) not in measured]
    activation = acts.activation
    if not reviews or (
        activation is not None and min(each.checked for each in reviews) > activation.activated
    ):
        found.append("unchecked")
    same = acts.accounts.same_person(calibration.signature, acts.authorisation)
    if any(name_key(name) in measured for name in issue.authorised_by) or same:
        found.append("self_signed")
    if issue.require_signatures:
        found += _unsigned(calibration, reviews, acts, same)
    return tuple(found)


def _unsigned(
    calibration: CalibrationEntry, reviews: Sequence[Review], acts: _Acts, same: bool | None
) -> Iterator[str]:
    """Yield the keys of `UNREVIEWED` that apply if the laboratory requires signatures."""
    signed = [each for each in reviews if each.signature is not None and each.signature.signed]
    if reviews and not signed:
        yield "typed_check"
    used = acts.activation
    if used is not None and (used.signature is None or not used.signature.account):
        yield "typed_use"
    if not acts.authorisation.signed:
        yield "typed_authorisation"
    related = [acts.accounts.same_person(calibration.signature, each.signature) for each in signed]
    if same is None or (signed and not any(each is False for each in related)):
        yield "unknown_person"


@dataclass(frozen=True)
class _Acts:
    """Registered reviews and activation on which a certificate is based.

    `reviews` are the accepted reviews that cover the present calibration, model and verification.
    """

    accounts: Accounts
    reviews: tuple[Review, ...]
    activation: Activation | None
    authorisation: Signature

    @classmethod
    def of(
        cls, registry: Registry, source: Source, calibration: CalibrationEntry, issue: Issue
    ) -> _Acts:
        model = source.model_entry
        used = [] if model is None else registry.activations(calibration.transducer_serial)
        activation = next(
            (each for each in reversed(used) if model and each.model_id == model.model_id), None
        )
        covers = registry.covered(calibration.calibration_id)
        wanted = {"calibration": covers["calibration"]}
        if model is not None:
            names = (f"model-{model.model_id}", f"verification of model-{model.model_id}")
            wanted |= {name: covers[name] for name in names if name in covers}
        reviews = [
            each
            for each in (
                *registry.reviews("calibrations", calibration.calibration_id),
                *([] if issue.review is None else [issue.review]),
            )
            if each.accepted
            and (each.signature is None or wanted.items() <= dict(each.signature.covers).items())
        ]
        signature = (issue.signature or Signature.typed()).about(covers)
        return cls(Accounts.of(registry.root), tuple(reviews), activation, signature)

    def stated(self, measured_by: str, measured: Signature | None, names: str) -> Iterator[Act]:
        """Yield who measured, reviewed, activated and authorised, as the certificate states it."""
        yield self._act("measured", measured_by, None, measured)
        for review in {each.checked_by: each for each in self.reviews}.values():
            yield self._act("checked", review.checked_by, review.checked, review.signature)
        if self.activation is not None and self.activation.operator:
            used = self.activation
            yield self._act("used", used.operator, used.activated, used.signature)
        if names:
            yield self._act("authorised", names, datetime.now(UTC), self.authorisation)

    def _act(
        self, role: str, name: str, moment: datetime | None, signature: Signature | None
    ) -> Act:
        settings = (
            self.accounts.set_by_others(signature.account, moment)
            if signature is not None and signature.account and moment is not None
            else []
        )
        covers = signature.sha256 if signature is not None and signature.covers else ""
        days = tuple(dict.fromkeys((at.date(), by) for at, by in settings))
        stated = None if signature is None else signature.about({})
        return Act(role, name, moment, stated, covers, days)


def _authorising(issue: Issue) -> tuple[str, ...]:
    names = tuple(name.strip() for name in issue.authorised_by if name.strip())
    if not (names or issue.draft):
        raise InputError(
            "a certificate without an authorising person", "a name", "give --authorised-by"
        )
    return names


def _require_laboratory(source: Source, issue: Issue) -> None:
    if not (source.run.simulated or issue.laboratory.name or issue.draft):
        raise InputError(
            "a certificate of a real calibration without a laboratory",
            "name, city and country of the laboratory",
            "write them into laboratory.toml in the data directory, or give --laboratory FILE",
        )


def _method(source: Source, calibration: CalibrationEntry) -> Method:
    profile = source.profile
    return Method(
        name=profile.name,
        title=profile.title,
        source=profile.source,
        sha256=calibration.profile_sha256 or profile.sha256,
        verified=profile.verified,
        series=len(set(source.data.series.tolist())),
        points=len(source.data),
        unsettled=source.unsettled,
        placement=_placement(source),
        table=str(source.folder.metadata.get("table", "")),
    )


def _compensation(source: Source) -> str:
    """Return the title of the compensation model; empty without a model."""
    if source.chain is None:
        return ""
    model = source.chain.model
    return model_title(model.kind, model.kind_parameters)


def _placement(source: Source) -> tuple[int, int, int] | None:
    """Return an adaptive calibration's numbers of coarse points, placed points and rounds."""
    found = source.folder.results.get("placement")
    if not found:
        return None
    rounds = found["rounds"]
    coarse, points = int(rounds[0]["points"]), int(rounds[-1]["points"])
    return coarse, points - coarse, len(rounds) - 1


def _extremes(values: NDArray[np.float64] | None) -> tuple[float, float] | None:
    return None if values is None else (float(values.min()), float(values.max()))


def _item(registry: Registry, source: Source, calibration: CalibrationEntry) -> Item:
    serial = calibration.transducer_serial
    known = next(iter(registry.equipment("transducer", serial)), Equipment("transducer", serial))
    return Item(
        serial=serial,
        manufacturer=known.manufacturer,
        model=known.model,
        side=source.data.side,
        bench=source.run.bench,
        counter_identity=calibration.counter_identity,
        range_nm=calibration.range_nm,
        in_place=source.folder.metadata.get("bench") is not None,
    )


def _worse(steps: Conformity | None, verification: VerificationSummary | None) -> Conformity | None:
    """Return the worse of two conformities: of the calibration's steps and of the verification."""
    fresh = None if verification is None else verification.conformity
    if steps is None or fresh is None:
        return steps
    return max((fresh, steps), key=lambda each: each.verdict.severity)


def _judged_points(
    registry: Registry,
    source: Source,
    latest: VerificationEntry,
    tolerance_percent_fs: float | None,
) -> Conformity | None:
    """Return the conformity of the verification's points by the certificate's tolerance."""
    if tolerance_percent_fs is None or latest.run_id is None:
        return None
    folder = RunFolder.open(registry.run(latest.run_id).folder)
    data = run_data(folder)
    if data.sha256() != latest.data_sha256:
        raise RecordError(
            Message("the points of verification {run} were changed", latest.run_id),
            "the points as they were registered",
            "restore them from a backup, or verify again",
        )
    entry = source.model_entry
    judged = judge_check(
        data,
        None if entry is None else used_chain(entry, folder.metadata, data),
        standard=check_standard(folder.metadata, data),
        tolerance_percent_fs=tolerance_percent_fs,
    )
    return conformity_of(
        (judged.torque.value_nm - data.standard_nm).tolist(),
        judged.torque.expanded_uncertainty_nm.tolist(),
        data.standard_nm.tolist(),
        judged.decisions,
        tolerance_percent_fs,
        fresh=True,
    )


def _verification(
    registry: Registry, source: Source, tolerance_percent_fs: float | None
) -> VerificationSummary | None:
    """Return the results of the model's latest verification."""
    entry = source.model_entry
    found = [] if entry is None else registry.verifications(entry.model_id)
    if not found:
        return None
    latest = found[-1]
    models = {model["name"]: model for model in latest.summary["models"]}
    raw = models.pop(RAW)
    compensated = next(iter(models.values()))
    averaged = compensated.get("averaged")
    truth = compensated.get("against_truth")
    return VerificationSummary(
        performed=latest.performed.date(),
        points=int(latest.summary["points"]),
        groups=int(latest.summary["groups"]),
        worst_before_nm=float(raw["against_standard"]["worst_nm"]),
        worst_after_nm=float(compensated["against_standard"]["worst_nm"]),
        # Averaged errors of a simulated bench refer to the true torque, which a certificate can't
        # state.
        averaged_after_nm=None if averaged is None or truth else float(averaged["worst_nm"]),
        data_sha256=latest.data_sha256,
        conformity=_judged_points(registry, source, latest, tolerance_percent_fs),
    )


def _number(calibration: CalibrationEntry, issued_before: int) -> str:
    serial = "".join(mark if mark.isalnum() else "-" for mark in calibration.transducer_serial)
    again = f"-{issued_before + 1}" if issued_before else ""
    return f"TB-{calibration.performed:%Y}-{serial}-{calibration.calibration_id:04d}{again}"
