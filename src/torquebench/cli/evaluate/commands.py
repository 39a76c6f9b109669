"""`torquebench evaluate`: evaluate tables of static calibrations from other benches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from dataclasses import field as data_field
from datetime import date, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape
from rich.text import Text

from torquebench import calibration
from torquebench.cli.evaluate.dynamics import dynamics
from torquebench.cli.evaluate.lubrication import lubrication
from torquebench.cli.options import (
    DEFAULT_DATA,
    HELP_MARKUP,
    DataOption,
    RangeOption,
    TableOptions,
    check_output,
    day_or_time,
    moment_in_utc,
    performed_at,
    stated_reference,
    tell_columns,
)
from torquebench.cli.reports import Told
from torquebench.cli.terminal.console import narrow_table, out, say, say_file, warn
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations.result import HIDDEN
from torquebench.reports.page import Page

if TYPE_CHECKING:
    from torquebench.calibration import (
        CalibrationData,
        CalibrationResults,
        Deviation,
        Profile,
        ReferenceStandard,
        SideBySide,
    )
    from torquebench.campaign.external_calibration import ExternalCalibration, RegisteredTable
    from torquebench.uncertainty import CertifiedUncertainty

app = typer.Typer(
    name="evaluate",
    help="Evaluate tables that were measured on any bench.",
    rich_markup_mode=HELP_MARKUP,
    no_args_is_help=True,
)


@app.callback()
def _tables() -> None:
    """Evaluate tables that were measured on another bench."""


@dataclass(frozen=True)
class RegistrationOptions:
    """Data of an external calibration for its registration: person, place, equipment, standard."""

    reference_due: Annotated[
        datetime | None,
        typer.Option(
            parser=moment_in_utc, metavar="DAY", help="Last day of the standard's certificate."
        ),
    ] = None
    reference_performed: Annotated[
        datetime | None,
        typer.Option(
            parser=moment_in_utc, metavar="DAY", help="Day of the standard's calibration."
        ),
    ] = None
    reference_serial: Annotated[str, typer.Option(help="Serial number of the standard.")] = ""
    reference_model: Annotated[str, typer.Option(help="Type of the standard.")] = ""
    reference_certificate: Annotated[
        str, typer.Option(help="Number of the standard's certificate.")
    ] = ""
    reference_laboratory: Annotated[
        str, typer.Option(help="Laboratory that has calibrated the standard.")
    ] = ""
    register: Annotated[
        bool,
        typer.Option("--register", help="Register it, so that a certificate can be issued."),
    ] = False
    transducer: Annotated[str, typer.Option(help="Serial number of the transducer.")] = ""
    manufacturer: Annotated[str, typer.Option(help="Manufacturer of the transducer.")] = ""
    transducer_model: Annotated[str, typer.Option(help="Type of the transducer.")] = ""
    indicator: Annotated[
        str, typer.Option(help="Counter or amplifier that the transducer was read with.")
    ] = ""
    place: Annotated[str, typer.Option(help="Bench or laboratory where it was measured.")] = ""
    measured_by: Annotated[
        str, typer.Option(help="Who measured it: one of the people in laboratory.toml.")
    ] = ""
    records: DataOption = DEFAULT_DATA

    def standard(self) -> ReferenceStandard:
        """Return the reference standard."""
        from torquebench.calibration import ReferenceStandard

        due = None if self.reference_due is None else self.reference_due.date()
        return ReferenceStandard(self.reference_serial, self.reference_certificate, due)

    def circumstances(
        self,
        points: CalibrationData,
        performed: datetime,
        measured_by: str,
        resolution_nm: float,
        uncertainty: CertifiedUncertainty | float,
    ) -> ExternalCalibration:
        """Return the data to register with a table, before it is evaluated."""
        from torquebench.campaign.external_calibration import (
            ExternalCalibration,
            check_circumstances,
        )
        from torquebench.records import Equipment, Report

        serial, range_nm = points.transducer_serial, points.range_nm
        standard = self.standard()
        circumstances = ExternalCalibration(
            performed=performed,
            measured_by=measured_by,
            place=self.place,
            transducer=Equipment(
                "transducer", serial, self.manufacturer, self.transducer_model, range_nm
            ),
            indicator=points.counter_identity,
            reference=Report(
                "calibrator",
                standard.serial,
                standard.certificate_number,
                laboratory=self.reference_laboratory,
                performed=None
                if self.reference_performed is None
                else self.reference_performed.date(),
                due=standard.due,
            ),
            reference_model=self.reference_model,
            resolution_nm=resolution_nm,
            reference_uncertainty=uncertainty,
        )
        check_circumstances(circumstances)
        return circumstances


@dataclass(frozen=True, kw_only=True)
class EvaluatedStatic(Told):
    """A calibration in steps; `results` as in the file of `--out`."""

    points: int
    range_nm: float
    columns: Sequence[Mapping[str, Any]]
    profile: Mapping[str, str]
    data_sha256: str
    deviations: Sequence[calibration.Deviation]
    results: Any
    calibration: str | None
    model: str | None
    described: Any = data_field(metadata=HIDDEN)

    @property
    def failed(self) -> bool:
        """Whether the profile refuses a certificate."""
        return any(each.consequence == "refuse" for each in self.deviations)

    def page(self) -> Page:
        """Return its description."""
        page: Page = self.described()
        return page


@app.command("static")
def static(
    data: Annotated[
        Path, typer.Argument(help="A table (CSV, Excel, TDMS, …) with reading_nm and standard_nm.")
    ],
    resolution: Annotated[float, typer.Option(min=0, help="Resolution of the indication, N·m.")],
    reference_uncertainty: Annotated[
        str | None,
        typer.Option(
            metavar="U|FILE",
            help="U (k = 2) of the standard: in % as `0.02 of torque` or `0.02 of range`, or the "
            "file of its certificate: a digital one (XML) or a table with torque_nm and "
            "expanded_uncertainty_nm; that of the table's comments by default.",
        ),
    ] = None,
    profile: Annotated[
        str | None,
        typer.Option(
            help="A profile for comparison: a name, or the path of a .toml; with --register "
            "`staircase` by default."
        ),
    ] = None,
    range_nm: RangeOption = None,
    model: Annotated[
        Path | None, typer.Option(help="A model file: results after its compensation too.")
    ] = None,
    performed: Annotated[
        date | None,
        typer.Option(
            parser=day_or_time,
            metavar="DAY",
            help="Day of the measurement, as 2026-01-31, or its time; now by default.",
        ),
    ] = None,
    result: Annotated[
        Path | None, typer.Option("--out", help="A JSON file with every number.")
    ] = None,
    degree: Annotated[
        int, typer.Option(min=1, max=3, help="Degree of the curve; smaller with few steps.")
    ] = 3,
    with_regression: Annotated[
        bool,
        typer.Option(
            "--regression", help="State slope, intercept, standard error of estimate and r², too."
        ),
    ] = False,
    *,
    table: TableOptions,
    registration: RegistrationOptions,
) -> EvaluatedStatic:
    """Evaluate a calibration in steps: deviations, uncertainty, class, raw and compensated.

    Any number of series, mounting positions and steps is pooled and evaluated by the table's own
    steps. The zero of each series is subtracted, unless a comment states "# tared = true". With
    --profile or --register the table is compared with a profile, each deviation is named with its
    clause, and the exit code is 1 if the profile refuses a certificate because of one. With
    --register, the table with its equipment and conditions is registered, whatever the exit code.
    """
    from torquebench.calibration import check_steps, load_profile
    from torquebench.compensation import load_model
    from torquebench.tables import check_kept, read_calibration_table

    chosen = load_profile(profile or "staircase") if profile or registration.register else None
    if chosen is not None:
        check_steps(chosen)
    if result is not None:
        check_output(result, data, endings=(".json",))
    person = ""
    if registration.register:
        check_kept(data)
        person = _person(registration.records, registration.measured_by)
    moment = performed_at(performed)
    found_table = read_calibration_table(
        data,
        range_nm=range_nm,
        transducer_serial=registration.transducer,
        counter_identity=registration.indicator,
        remark=warn,
        mapping=table.column or (),
        conversion=table.conversion(),
        model=None if model is None else load_model(model),
    )
    columns = tell_columns(found_table.columns.understood, found_table.columns.notes)
    read = found_table.data

    from torquebench.calibration import (
        CalibrationRecord,
        assign_nominal,
        calibration_results,
        find_deviations,
        own_steps,
    )
    from torquebench.reports.evaluation_report import static_page
    from torquebench.uncertainty import CertifiedUncertainty

    points = own_steps(read) if chosen is None else assign_nominal(read, chosen)
    deviations: tuple[Deviation, ...] = ()
    if chosen is not None:
        record = CalibrationRecord(points, moment, registration.standard())
        deviations = find_deviations(record, chosen)
    stated = _reference(reference_uncertainty, points, data.name)
    circumstances = None
    if registration.register:
        circumstances = registration.circumstances(points, moment, person, resolution, stated)
    certified = stated
    if isinstance(certified, float):
        certified = CertifiedUncertainty.of_torque(1e-2 * certified)
    results = calibration_results(
        points,
        resolution_nm=resolution,
        reference=certified,
        torque_nm=None if model is None else _compensated(model, points),
        degree=degree,
    )
    if not results.directions and circumstances is None:
        raise InputError(
            Message.joined(results.remarks, "; "),
            "a table in steps",
            "torquebench fit takes a table that isn't in steps",
        )
    _print_heading(points, chosen)
    _print_results(results, with_regression=with_regression)
    if chosen is not None:
        _print_deviations(deviations)
    content: dict[str, Any] = {
        "profile": {} if chosen is None else {"name": chosen.name, "sha256": chosen.sha256},
        "data_sha256": points.sha256(),
        "deviations": list(deviations),
        "remarks": list(results.remarks),
        "results": {
            each.name: getattr(results, each.name)
            for each in fields(results)
            if each.name not in ("data", "torque_nm", "remarks")
        },
    }
    if result is not None:
        from torquebench.atomic_write import atomic_write
        from torquebench.records import json_text

        atomic_write(result, json_text(content, indent=2) + "\n")
        say_file("Every number", result)
    entered = None
    if circumstances is not None and chosen is not None:
        entered = _register(registration.records, data, points, chosen, circumstances, model)
    if any(each.consequence == "refuse" for each in deviations):
        warn("the profile refuses a certificate for this calibration")
    return EvaluatedStatic(
        headline=Message("{count} deviations from the profile.", len(deviations))
        if chosen is not None
        else Message("{count} points.", len(points)),
        simulated=points.simulated,
        remarks=results.remarks,
        run_ids=() if entered is None else (entered.run_id,),
        points=len(points),
        range_nm=points.range_nm,
        columns=columns,
        profile=content["profile"],
        data_sha256=content["data_sha256"],
        deviations=deviations,
        results=content["results"],
        calibration=None
        if entered is None
        else f"calibration-{entered.calibration.calibration_id}",
        model=None
        if entered is None or entered.model is None
        else f"model-{entered.model.model_id}",
        described=lambda: static_page(
            data.name, chosen, deviations, results, with_regression=with_regression
        ),
    )


def _person(folder: Path, name: str) -> str:
    """Return the laboratory's spelling of a person's name; raise an error for an unknown person."""
    if not name:
        return ""
    from torquebench.reports.certificate import kept_letterhead, person_among

    return person_among(name, kept_letterhead(folder).people)


def _reference(
    stated: str | None, points: CalibrationData, source: str
) -> CertifiedUncertainty | float:
    """Return the standard's U (k = 2), in % of the torque or as a function of torque."""
    from torquebench.campaign.chains import remark_another_standard

    if stated is None:
        if points.reference is None:
            raise InputError(
                Message("{source} without U of the standard", source),
                "a table with a comment reference_uncertainty, or the option",
                "give --reference-uncertainty",
            )
        return points.reference.certified
    from torquebench.uncertainty import CertifiedUncertainty

    given = _given(stated, points)
    certified = CertifiedUncertainty.of_torque(1e-2 * given) if isinstance(given, float) else given
    remark_another_standard(points, certified, source, warn)
    return given


def _given(stated: str, points: CalibrationData) -> CertifiedUncertainty | float:
    """Return U by the option's text."""
    number, _, of = stated.strip().partition(" of ")
    try:
        percent = float(number.rstrip("% "))
    except ValueError:
        of = ""
    if of != "torque":
        option = "--reference-uncertainty"
        certified = stated_reference(stated, points.range_nm, points.side, option=option)
        assert certified is not None
        return certified
    if not 0.0 <= percent <= 10.0:
        raise InputError(
            Message("--reference-uncertainty {stated}", stated), "0 to 10 % of the torque"
        )
    return percent


def _register(
    folder: Path,
    table: Path,
    points: CalibrationData,
    profile: Profile,
    circumstances: ExternalCalibration,
    model: Path | None,
) -> RegisteredTable:
    from torquebench.campaign.external_calibration import register_table
    from torquebench.records import Registry
    from torquebench.records.signatures import operator_name

    with Registry.open(folder) as registry:
        entered = register_table(
            registry, table, points, profile, circumstances, operator=operator_name(), model=model
        )
    say(f"Entered as calibration-{entered.calibration.calibration_id}.")
    if entered.model is not None:
        say(f"Compensation: model-{entered.model.model_id}.")
    say(f"Run: {entered.run_id}")
    return entered


def _compensated(file: Path, points: CalibrationData) -> Any:
    from torquebench.chain import load_chain

    return load_chain(file).torque(points.readings()).value_nm


def _print_heading(points: CalibrationData, profile: Profile | None) -> None:
    simulated = " - simulated" if points.simulated else ""
    chain = f", transducer {points.transducer_serial}" if points.transducer_serial else ""
    say(f"[bold]{len(points)} points, {points.range_nm:g} N·m{escape(chain)}{simulated}[/bold]")
    if profile is not None:
        checked = "" if profile.verified else ", not checked against a licensed text"
        say(f"profile {escape(profile.name)} (SHA-256 {profile.sha256[:12]}…{checked})")


def _print_deviations(deviations: tuple[Deviation, ...]) -> None:
    if not deviations:
        say("no deviation from the profile")
        return
    table = narrow_table(
        "Deviations from the profile, and their consequence for the certificate",
        columns=("|", ""),
        headings=False,
    )
    for each in deviations:
        refused = each.consequence == "refuse"
        table.add_row("[red]refused[/red]" if refused else "stated", escape(each.found))
        table.add_row("", f"allowed: {escape(each.allowed)}", style="dim")
        table.add_row("", f"clause {escape(each.clause)}", style="dim")
    out().print(table)


def _print_results(results: CalibrationResults, *, with_regression: bool) -> None:
    from torquebench.reports.evaluation_report import QUANTITIES, regression_table

    for remark in results.remarks:
        warn(remark)
    for direction in results.directions:
        for title, side in (("before", direction.before), ("after", direction.after)):
            if side is not None:
                heading = f"{direction.name}, {title} compensation, % of reading"
                out().print(Text(heading, style="bold"))
                _print_side(side)
    say(QUANTITIES)
    if with_regression:
        header, rows = regression_table(results)
        table = narrow_table(columns=["|", *(f">{name}" for name in header[1:])])
        for row in rows:
            table.add_row(*row)
        out().print(table)
    for title, zero in (("before", results.zero_before), ("after", results.zero_after)):
        if zero is not None:
            say(
                f"zero hysteresis {title} compensation: {zero.worst_nm:.4g} N·m at worst "
                f"({zero.worst_percent_fs:.3g} % FS) over {zero.cycles} cycles"
            )


def _print_side(side: SideBySide) -> None:
    """Print all quantities, one line per step, the curve and the class."""
    from torquebench.reports.evaluation_report import residual_zero, static_quantities

    header, rows = static_quantities(side)
    table = narrow_table(
        columns=[f">{name}" for name in header], caption=residual_zero(side.evaluation)
    )
    for row in rows:
        table.add_row(*row)
    out().print(table)
    say(f"{side.interpolation.equation} (degree {side.interpolation.degree}, N·m)")
    say(side.class_words)


for command in (dynamics, lubrication):
    app.command()(command)
