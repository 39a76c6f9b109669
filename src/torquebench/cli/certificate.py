"""`torquebench certificate`: issue the certificate of a calibration, or check one."""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from torquebench.cli.console import answer, note, say, say_file, warn
from torquebench.cli.failure import CHECK_FAILED
from torquebench.cli.options import DEFAULT_DATA, DataOption, check_output_folder, data_directory
from torquebench.errors import InputError

if TYPE_CHECKING:
    from torquebench.records import CalibrationEntry, Registry
    from torquebench.reports.certificate import (
        CertificateCheck,
        CertificateRecord,
        Issue,
        IssuedCertificate,
    )

__all__ = ["find_calibration", "register"]


class Language(StrEnum):
    """What a certificate is written in."""

    en = "en"
    de = "de"
    zh = "zh"


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("certificate")(certificate)


def certificate(
    run: Annotated[
        str | None,
        typer.Argument(help="A calibration run or its beginning, `latest`, or `calibration-3`."),
    ] = None,
    check: Annotated[
        str | None,
        typer.Option(
            "--check", metavar="FILE", help="Check a PDF, XML or JSON file, or a QR code's text."
        ),
    ] = None,
    language: Annotated[
        list[Language] | None, typer.Option(help="Repeat it for one PDF a language; en by default.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for a copy of the files beside the archive's.")
    ] = None,
    authorised_by: Annotated[
        list[str] | None,
        typer.Option(help="Who answers for it; repeatable. By default whoever is logged in."),
    ] = None,
    checked_by: Annotated[
        str, typer.Option(help="Who has looked over the calibration; entered as a review.")
    ] = "",
    laboratory: Annotated[
        Path | None,
        typer.Option(help="TOML file of laboratory and customer; laboratory.toml in the data."),
    ] = None,
    tolerance: Annotated[
        float,
        typer.Option(min=1e-6, max=100, help="Tolerance of the error after it, % of full scale."),
    ] = 0.1,
    conformity: Annotated[
        bool, typer.Option(help="Whether it states conformity with the tolerance.")
    ] = True,
    number: Annotated[str, typer.Option(help="Its unique number; made up by default.")] = "",
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Issue the certificate of a calibration as PDF and digital XML, or check one.

    Run folder and model are compared with their registered hashes first. Where the calibration
    departs from its profile, the certificate states it or is refused, as the profile says.
    """
    from torquebench.records import Registry

    if (run is None) == (check is None):
        raise InputError(
            "neither a run nor --check" if run is None else "both a run and --check",
            "one of them",
            "name a calibration run, or a file to check",
        )
    with Registry.open(data_directory(data)) as registry:
        if check is not None:
            _check(registry, check)
            return
        assert run is not None
        calibration = find_calibration(registry, run)

        from torquebench.reports.certificate import build_record, issue_certificate

        if out is not None:
            check_output_folder(out)
        judged = tolerance if conformity else None
        issue = _issue(registry, language, authorised_by, laboratory, judged, number)
        unrefused = replace(issue, refuse_unreviewed=issue.refuse_unreviewed and not checked_by)
        record = registry.patiently(lambda: build_record(registry, calibration, unrefused))
        if checked_by:  # entered only where nothing refuses the certificate
            registry.review(
                "calibrations", calibration.calibration_id, checked_by=checked_by, accepted=True
            )
            record = build_record(registry, calibration, issue)
        _tell_doubts(registry, record)
        _issued(issue_certificate(registry, record, out))


def _tell_doubts(registry: Registry, record: CertificateRecord) -> None:
    """Warn of a standard that had expired, and of a clock that dates the certificate wrongly."""
    from torquebench.records.time_check import clock_behind, expired_on

    reference, behind = record.reference, clock_behind(registry)
    if expired_on(record.calibrated_to, reference.due):
        warn(
            f"calibrated on {record.calibrated_to} against {reference.serial}, whose certificate "
            f"{reference.certificate_number} expired on {reference.due}"
        )
    if behind:
        warn(f"{behind}; the certificate is dated {record.issued}")


def find_calibration(registry: Registry, name: str) -> CalibrationEntry:
    """Return the calibration that a name of the command line means.

    Raises
    ------
    InputError
        Where there is none, or several.
    RecordError
        Where the run isn't sealed.
    """
    kind, _, number = name.partition("-")
    if kind == "calibration" and number.isdecimal():
        return registry.calibration(int(number))
    if name == "latest":
        newest = registry.calibrations(limit=1)
        if not newest:
            raise InputError("no calibration is registered", "one", "run `torquebench calibrate`")
        return newest[0]
    found = registry.runs_beginning(name, limit=2)
    if not found:
        raise InputError(f"no run {name!r}", "a name from `torquebench records list`")
    if len(found) > 1 and found[0].run_id != name:
        raise InputError(f"several runs begin with {name!r}", "one run", "give more of its id")

    from torquebench.reports.certificate import calibration_of

    return calibration_of(registry, found[0].run_id)


def _issue(
    registry: Registry,
    language: list[Language] | None,
    authorised_by: list[str] | None,
    laboratory: Path | None,
    tolerance: float | None,
    number: str,
) -> Issue:
    from torquebench.campaign.measuring import operator_name
    from torquebench.reports.certificate import (
        Issue,
        kept_letterhead,
        person_among,
        read_letterhead,
    )

    if number and not all(mark.isalnum() or mark in "-_." for mark in number):
        raise InputError(f"number {number!r}", "letters, digits, hyphens, dots and underscores")
    letterhead = (
        kept_letterhead(registry.root) if laboratory is None else read_letterhead(laboratory)
    )
    names = authorised_by or [operator_name()]
    if letterhead.people:
        names = [person_among(each, letterhead.people, "authorised by") for each in names]
    issuer, customer = letterhead.parties
    if not authorised_by:
        note(f"authorised by {names[0]}, who is logged in; --authorised-by names somebody else")
    return Issue(
        names,
        languages=tuple(each.value for each in language or [Language.en]),
        tolerance_percent_fs=tolerance,
        number=number,
        laboratory=issuer,
        customer=customer,
        refuse_unreviewed=letterhead.refuses_unreviewed,
    )


def _issued(issued: IssuedCertificate) -> None:
    record = issued.record
    simulated = " - simulated" if record.simulated else ""
    say(f"[bold]Certificate {escape(record.number)}[/bold]{simulated}")
    conformity = record.conformity
    if conformity is None:
        say("It states no conformity.")
    else:
        say(
            f"{conformity.verdict.label}: tolerance {conformity.tolerance_percent_fs:g} % of full "
            f"scale, guard band w = U"
        )
    if record.unreviewed:
        from torquebench.reports.certificate import UNREVIEWED

        warn(
            "every page says that it isn't reviewed: "
            + "; ".join(UNREVIEWED[each] for each in record.unreviewed)
        )
    if record.supersedes:
        say(f"It replaces {escape(record.supersedes)}.")
    for path in issued.files:
        say_file("", path)
    for deviation in record.deviations:
        warn(f"it states a deviation: {deviation.found} (clause {deviation.clause})")
    answer(
        number=record.number,
        simulated=record.simulated,
        verdict=None if conformity is None else conformity.verdict,
        tolerance_percent_fs=None if conformity is None else conformity.tolerance_percent_fs,
        unreviewed=list(record.unreviewed),
        deviations=list(record.deviations),
        supersedes=record.supersedes,
    )
    if record.compensation and record.verification is None:
        warn("no verification at fresh points is registered for this compensation; it says so")


def _check(registry: Registry, given: str) -> None:
    from torquebench.reports.certificate import check_certificate

    found = check_certificate(registry, given)
    _say_check(found)
    if not found.matches:
        raise typer.Exit(CHECK_FAILED)


def _say_check(found: CertificateCheck) -> None:
    answer(
        number=found.number,
        matches=found.matches,
        findings=list(found.findings),
        schema=found.schema,
        replaced_by=found.replaced_by,
    )
    for finding in found.findings:
        say(f"[red]no match[/red]  {escape(finding)}")
    if found.matches and found.entry is not None:
        say(
            f"[green]matches[/green]  certificate {escape(found.number)}, issued "
            f"{found.entry.issued:%Y-%m-%d}, authorised by {escape(found.entry.authorised_by)}"
        )
    if found.schema == "valid":
        say("schema and schematron of DCC 3.3.0: valid")
    elif found.schema == "not checked":
        warn("schema not checked: pip install 'torquebench[dcc]'")
    if found.replaced_by:
        warn(f"certificate {found.number} was replaced by {found.replaced_by}")
