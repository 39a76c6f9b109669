"""Short jobs: zero, the daily check, and the certificate.

`jobs.details` has the types of their details.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from torquebench.bench.roles import SIDES, Side
from torquebench.campaign.checking import check_module
from torquebench.campaign.doubts import VERIFICATION_STANDARD, doubts_before
from torquebench.campaign.measuring import RunAbortedError
from torquebench.errors import RecordError
from torquebench.message import Message
from torquebench.panel.service.fields import Flag, Identifier, Number, ProfileName
from torquebench.panel.service.jobs.details import (
    CertificateDetails,
    CheckDetails,
    ZeroDetails,
    ZeroOfSide,
)
from torquebench.panel.service.jobs.previews import staircase_preview
from torquebench.panel.service.jobs.runner import JobContext, JobKind, JobRequest, Workplace
from torquebench.panel.service.jobs.values import JobPreview, JobResult
from torquebench.procedures import rehearse, zero_modules
from torquebench.procedures import verify as verify_plan
from torquebench.reports.certificate import (
    Issue,
    build_record,
    issue_certificate,
    kept_letterhead,
)

__all__ = ["CHECK_KINDS", "CertificateOptions", "CertificateRequest", "CheckRequest", "ZeroRequest"]


class ZeroRequest(JobRequest):
    """Take the unloaded bench's reading for zero."""

    sides: Annotated[tuple[Side, ...], Field(min_length=1, max_length=2)] = SIDES


class CheckRequest(JobRequest):
    """Check one module against the check standard: the daily check."""

    side: Side
    profile: ProfileName = "check"
    tolerance_percent_fs: Annotated[Number, Field(gt=0, le=100.0)] = 0.1
    bench_clear: Flag = False


class CertificateOptions(JobRequest):
    """Options of a certificate."""

    languages: Annotated[
        tuple[Literal["en", "de", "zh"], ...], Field(min_length=1, max_length=3)
    ] = ("en",)
    tolerance_percent_fs: Annotated[Number, Field(gt=0, le=100.0)] = 0.1
    number: Annotated[str, Field(max_length=64, pattern=r"^([A-Za-z0-9][A-Za-z0-9_-]*)?$")] = ""


class CertificateRequest(CertificateOptions):
    """Issue the certificate of a calibration; the caller has signed with the password."""

    calibration_id: Identifier


def run_zero(context: JobContext, request: ZeroRequest) -> JobResult:
    """Zero the modules and register it for the drift charts."""
    station, job = context.station, context.job
    sides = tuple(dict.fromkeys(request.sides))
    job.start("Zeroing", len(sides))
    record = station.run(
        zero_modules(station.devices, sides),
        kind="zero",
        metadata={"operator": context.actor.label},
        progress=job,
    )
    if record.exit_status != "success":
        raise RunAbortedError(record)
    job.reach(len(sides))
    zeros: dict[Side, ZeroOfSide] = {}
    for side in sides:
        transducer = station.description.module(side).transducer
        frequency_hz = record.result[side].frequency_hz
        deviation_hz = frequency_hz - transducer.scale().nominal_zero_hz
        zero_nm = deviation_hz / transducer.nominal_sensitivity_hz_per_nm
        zeros[side] = ZeroOfSide(frequency_hz, zero_nm)
    words = Message.joined(
        Message("{side} {zero_nm:+.3g} N·m", side, zeros[side].zero_nm) for side in sides
    )
    return JobResult(
        headline=Message("Zero measured; difference from the nominal zero: {sides}.", words),
        simulated=station.description.simulated,
        run_ids=(record.run_id,),
        details=ZeroDetails(zeros.get("input"), zeros.get("output")),
    )


def preview_check(place: Workplace, request: CheckRequest) -> JobPreview:
    """Rehearse a daily check."""
    station = place.station
    profile = place.settings.profile(request.profile)
    steps = profile.staircase(station.description.module(request.side).range_nm)
    plan = verify_plan(station.devices, request.side, profile, steps)
    rehearsal = rehearse(station.devices, plan)
    doubts = tuple(doubts_before(station, VERIFICATION_STANDARD))
    return staircase_preview(request.side, "check", _check_title(request), rehearsal, doubts)


def run_check(context: JobContext, request: CheckRequest) -> JobResult:
    """Load a few steps against the check standard, judge and register."""
    station = context.station
    check = check_module(
        station,
        request.side,
        context.settings.profile(request.profile),
        request.tolerance_percent_fs,
        progress=context.job,
    )
    return JobResult(
        headline=Message(
            "{verdict}: worst {value:+.3g} % FS, tolerance ±{tolerance:g} % FS.",
            check.verdict.label,
            check.worst_percent_fs,
            request.tolerance_percent_fs,
        ),
        verdict=check.verdict.value,
        simulated=check.data.simulated,
        run_ids=(check.run_id,),
        details=CheckDetails(
            side=request.side,
            tolerance_percent_fs=request.tolerance_percent_fs,
            standard_nm=check.data.standard_nm,
            error_nm=check.error_nm,
            expanded_uncertainty_nm=check.expanded_uncertainty_nm,
            verdicts=[decision.verdict for decision in check.judged.decisions],
            not_in_u=check.judged.missing,
        ),
    )


def check_certificate_request(place: Workplace, request: CertificateRequest) -> None:
    """Refuse a calibration that doesn't exist, and a number that is taken."""
    registry = place.station.registry
    registry.calibration(request.calibration_id)
    kept_letterhead(registry.root)
    if any(entry.number == request.number for entry in registry.certificates()):
        raise RecordError(Message("certificate {number} is issued", request.number), "a new number")


def run_certificate(context: JobContext, request: CertificateRequest) -> JobResult:
    """Issue a certificate that the person who started it authorises."""
    registry, job = context.station.registry, context.job
    job.start("Issuing the certificate", 1)
    calibration = registry.patiently(lambda: registry.calibration(request.calibration_id))
    letterhead = kept_letterhead(registry.root)
    laboratory, customer = letterhead.parties
    issue = Issue(
        [context.actor.name],
        languages=request.languages,
        tolerance_percent_fs=request.tolerance_percent_fs,
        number=request.number,
        laboratory=laboratory,
        customer=customer,
        refuse_unreviewed=letterhead.refuses_unreviewed,
        require_signatures=letterhead.requires_signatures(registry.root),
    )
    record = registry.patiently(lambda: build_record(registry, calibration, issue))
    issued = issue_certificate(registry, record)
    job.reach(1)
    conformity = record.conformity
    judged = "" if conformity is None else f": {conformity.verdict.label}"
    return JobResult(
        headline=Message("Certificate {number}{judged}.", record.number, judged),
        verdict="" if conformity is None else conformity.verdict.value,
        simulated=record.simulated,
        calibration_id=calibration.calibration_id,
        certificate=record.number,
        details=CertificateDetails(
            files=[path.name for path in issued.files],
            deviations=[deviation.found for deviation in record.deviations],
            languages=record.languages,
            supersedes=record.supersedes,
            unreviewed=record.unreviewed,
        ),
    )


def _check_title(request: CheckRequest) -> str:
    return Message("Check the {side} module", request.side)


CHECK_KINDS: tuple[JobKind, ...] = (
    JobKind("zero", lambda _asked: "Zeroing", ZeroRequest, run_zero, can_pause=False),
    JobKind(
        "check",
        _check_title,
        CheckRequest,
        run_check,
        preview_check,
        lambda place, asked: place.settings.profile(asked.profile),
    ),
)
CERTIFICATE_KIND = JobKind(
    "certificate",
    lambda asked: Message("Certificate of calibration {number}", asked.calibration_id),
    CertificateRequest,
    run_certificate,
    check=check_certificate_request,
    role="metrologist",
    moves=False,
    can_pause=False,
)
"""Started by `BenchService.issue_certificate` only, which asks for the password."""
