"""Evaluate calibrations of other benches from their tables, and enter them in the records."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from dataclasses import field as data_field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from torquebench import calibration
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations.operation import (
    WHOLE,
    Day,
    Flag,
    Name,
    Number,
    Operation,
    field,
    on_files,
)
from torquebench.operations.place import Place
from torquebench.operations.readings import (
    DayOrTime,
    Range,
    TorqueTable,
    columns_fact,
    stated_reference,
)
from torquebench.operations.result import HIDDEN, Result
from torquebench.progress import Progress
from torquebench.reports.page import Page

if TYPE_CHECKING:
    from torquebench.calibration import CalibrationData, Profile
    from torquebench.campaign.external_calibration import ExternalCalibration
    from torquebench.compensation import StoredModel
    from torquebench.uncertainty import CertifiedUncertainty

MOST_DEVIATIONS = 200
"""Largest number of deviations in a result; an unsuitable table causes one per line."""


class StaticTable(TorqueTable):
    """Evaluate a calibration in steps: deviations, uncertainty, class, raw and compensated.

    Any number of series, mounting positions and steps is pooled and evaluated by the table's own
    steps. The zero of each series is subtracted, unless a comment states "# tared = true". With a
    profile, the table is compared with it, each deviation is named with its clause, and the check
    fails if the profile refuses a certificate because of one.
    """

    basic = ("table", "resolution_nm", "reference_uncertainty", "profile", "range_nm", "model")

    table: Annotated[
        Path,
        field(
            "A table (CSV, Excel, TDMS, …) with reading_nm and standard_nm.",
            title="Table",
            argument=True,
        ),
    ]
    resolution_nm: Annotated[Number, field("Resolution of the indication.", ge=0, le=1e6)]
    reference_uncertainty: Annotated[
        str | None,
        field(
            "U (k = 2) of the standard: in % as `0.02 of torque` or `0.02 of range`, or the file "
            "of its certificate: a digital one (XML) or a table with torque_nm and "
            "expanded_uncertainty_nm; that of the table's comments by default.",
            unit=" ",
            file=True,
            max_length=300,
            examples=("0.02 of torque",),
        ),
    ] = None
    profile: Annotated[
        Name | None,
        field(
            "A profile for comparison: a name, or the path of a .toml.", choices="profiles:steps"
        ),
    ] = None
    range_nm: Range = None
    model: Annotated[
        Path | None,
        field("A model file: results after its compensation too.", title="Model file"),
    ] = None
    performed: Annotated[
        DayOrTime | None,
        field("Day of the measurement, as 2026-01-31, or its time; now by default."),
    ] = None
    reference_due: Annotated[Day | None, field("Last day of the standard's certificate.")] = None
    reference_serial: Annotated[
        str,
        field("Serial number of the standard.", title="Standard, serial number", max_length=120),
    ] = ""
    reference_certificate: Annotated[
        str,
        field(
            "Number of the standard's certificate.",
            title="Certificate of the standard",
            max_length=120,
        ),
    ] = ""
    transducer: Annotated[
        str,
        field(
            "Serial number of the transducer.", title="Transducer, serial number", max_length=120
        ),
    ] = ""
    indicator: Annotated[
        str,
        field("Counter or amplifier that the transducer was read with.", max_length=120),
    ] = ""
    degree: Annotated[
        int,
        field("Degree of the curve; smaller with few steps.", ge=1, le=3),
        WHOLE,
    ] = 3
    regression: Annotated[
        Flag,
        field("State slope, intercept, standard error of estimate and r², too."),
    ] = False
    out: Annotated[
        Path | None, field("A JSON file with every number.", local=True, output=(".json",))
    ] = None

    @property
    def compared(self) -> str | None:
        """Name of the profile for comparison."""
        return self.profile

    def moment(self) -> datetime:
        """Return when it was measured; raise an error for a time in the future."""
        from torquebench.validation import past_moment

        return past_moment(self.performed or datetime.now().astimezone())


class ImportedTable(StaticTable):
    """Enter a calibration of another bench, so that models can be fitted and certificates issued.

    The table is evaluated, compared with a profile (`staircase` by default) and registered with its
    equipment and conditions, whatever it deviates in: `evaluate static` shows this beforehand. The
    check fails if the profile refuses a certificate.
    """

    basic = (
        *("table", "resolution_nm", "measured_by"),
        *("transducer", "indicator", "reference_serial"),
    )

    measured_by: Annotated[
        str, field("Who measured it: one of the laboratory's people.", max_length=120)
    ] = ""
    manufacturer: Annotated[
        str,
        field("Manufacturer of the transducer.", title="Maker of the transducer", max_length=120),
    ] = ""
    transducer_model: Annotated[
        str, field("Type of the transducer.", title="Model of the transducer", max_length=120)
    ] = ""
    place: Annotated[
        str, field("Bench or laboratory where it was measured.", title="Place", max_length=120)
    ] = ""
    reference_performed: Annotated[Day | None, field("Day of the standard's calibration.")] = None
    reference_model: Annotated[
        str, field("Type of the standard.", title="Model of the standard", max_length=120)
    ] = ""
    reference_laboratory: Annotated[
        str,
        field(
            "Laboratory that has calibrated the standard.",
            title="Laboratory that certified it",
            max_length=120,
        ),
    ] = ""

    @property
    def compared(self) -> str:
        """Name of the profile for comparison."""
        return self.profile or "staircase"


@dataclass(frozen=True, kw_only=True)
class EvaluatedStatic(Result):
    """A calibration in steps; `results` as in the file of `--out`."""

    points: int
    range_nm: float
    columns: Sequence[Mapping[str, Any]]
    profile: Mapping[str, str]
    data_sha256: str
    deviations: Sequence[calibration.Deviation]
    results: Any
    evaluated: Any = data_field(metadata=HIDDEN)
    """The `CalibrationResults`."""
    compared: Any = data_field(metadata=HIDDEN)
    """The `Profile`, None without one."""
    table: Any = data_field(metadata=HIDDEN)
    """Name of the table, how its columns were understood, and whether lines are stated."""

    @property
    def failed(self) -> bool:
        """Whether the profile refuses a certificate."""
        return any(each.consequence == "refuse" for each in self.deviations)

    def page(self) -> Page:
        """Return its description."""
        from torquebench.reports.evaluation_report import static_page

        name, understood, regression = self.table
        return static_page(
            name,
            self.compared,
            self.deviations,
            self.evaluated,
            with_regression=regression,
            conversions=columns_fact(understood),
        )


@dataclass(frozen=True, kw_only=True)
class EnteredTable(EvaluatedStatic):
    """A calibration of another bench that was entered in the records."""

    calibration: str
    model: str | None


@dataclass(frozen=True)
class ReadTable:
    """A table that was read and evaluated, and what a record of it needs."""

    result: EvaluatedStatic
    points: CalibrationData
    stated: CertifiedUncertainty | float
    model: StoredModel | None
    text: str
    sha256: str


def check_static(place: Place, request: StaticTable) -> Iterable[str]:
    """Raise an error for an unsuitable profile, or a moment in the future."""
    from torquebench.calibration import check_steps

    request.moment()
    if request.compared is not None:
        check_steps(place.library.profile(request.compared))
    return ()


def read_static(request: StaticTable, profile: Profile | None, _progress: Progress) -> ReadTable:
    """Read and evaluate a table, without records."""
    remarks: list[str] = []
    stored = None
    if request.model is not None:
        from torquebench.compensation import load_model

        stored = load_model(request.model)
    table = request.calibration(
        request.table,
        remarks.append,
        range_nm=request.range_nm,
        transducer_serial=request.transducer,
        counter_identity=request.indicator,
        model=stored,
    )
    read, understood = table.data, table.columns.understood

    from torquebench.calibration import (
        CalibrationRecord,
        ReferenceStandard,
        assign_nominal,
        calibration_results,
        find_deviations,
        own_steps,
    )
    from torquebench.records import sha256_of_file
    from torquebench.tables import table_text
    from torquebench.uncertainty import CertifiedUncertainty

    points = own_steps(read) if profile is None else assign_nominal(read, profile)
    deviations: tuple[calibration.Deviation, ...] = ()
    if profile is not None:
        standard = ReferenceStandard(
            request.reference_serial, request.reference_certificate, request.reference_due
        )
        record = CalibrationRecord(points, request.moment(), standard)
        deviations = find_deviations(record, profile)
    stated = _reference(request.reference_uncertainty, points, request.table.name, remarks)
    certified = stated
    if isinstance(certified, float):
        certified = CertifiedUncertainty.of_torque(1e-2 * certified)
    compensated = None
    if stored is not None:
        from torquebench.chain import MeasuringChain

        compensated = MeasuringChain.of(stored).torque(points.readings()).value_nm
    results = calibration_results(
        points,
        resolution_nm=request.resolution_nm,
        reference=certified,
        torque_nm=compensated,
        degree=request.degree,
    )
    if any(each.consequence == "refuse" for each in deviations):
        remarks.append("the profile refuses a certificate for this calibration")
    result = EvaluatedStatic(
        headline=Message("{count} points.", len(points))
        if profile is None
        else Message("{count} deviations from the profile.", len(deviations)),
        simulated=points.simulated,
        remarks=(*remarks, *results.remarks),
        points=len(points),
        range_nm=points.range_nm,
        columns=understood.described(),
        profile={} if profile is None else {"name": profile.name, "sha256": profile.sha256},
        data_sha256=points.sha256(),
        deviations=deviations[:MOST_DEVIATIONS],
        results={
            each.name: getattr(results, each.name)
            for each in fields(results)
            if each.name not in ("data", "torque_nm", "remarks")
        },
        evaluated=results,
        compared=profile,
        table=(request.table.name, understood, request.regression),
    )
    kept = isinstance(request, ImportedTable)
    return ReadTable(
        result,
        points,
        stated,
        stored,
        table_text(request.table) if kept else "",
        sha256_of_file(request.table) if kept else "",
    )


def run_static(place: Place, request: StaticTable, progress: Progress) -> EvaluatedStatic:
    """Evaluate a table; write every number if a file is named."""
    from dataclasses import replace

    profile = None if request.compared is None else place.library.profile(request.compared)
    result = read_static(request, profile, progress).result
    if not result.evaluated.directions:
        raise InputError(
            Message.joined(result.evaluated.remarks, "; "),
            "a table in steps",
            "torquebench fit takes a table that isn't in steps",
        )
    return replace(result, files=_written(request, result))


def _written(request: StaticTable, result: EvaluatedStatic) -> tuple[str, ...]:
    if request.out is None:
        return ()
    from torquebench.atomic_write import atomic_write
    from torquebench.records import json_text

    names = ("profile", "data_sha256", "deviations", "remarks", "results")
    content = {name: getattr(result, name) for name in names}
    atomic_write(request.out, json_text(content, indent=2) + "\n")
    return (str(request.out),)


def check_import(place: Place, request: ImportedTable) -> Iterable[str]:
    """Raise an error for a table from a stream, or a person who isn't of the laboratory."""
    from torquebench.tables import check_kept

    check_kept(request.table)
    _person(place, request.measured_by)
    return check_static(place, request)


def run_import(place: Place, request: ImportedTable, progress: Progress) -> EnteredTable:
    """Evaluate a table and register it."""
    from torquebench.campaign.external_calibration import check_circumstances, register_table

    profile = place.library.profile(request.compared)
    read = place.compute(read_static, request, profile, progress=progress)
    circumstances = _circumstances(request, read, _person(place, request.measured_by))
    check_circumstances(circumstances)
    entered = register_table(
        place.registry,
        read.text,
        read.points,
        profile,
        circumstances,
        operator=place.operator,
        signature=place.signature,
        model=read.model,
        called=request.table.name,
        sha256=read.sha256,
    )
    number = entered.calibration.calibration_id
    result: EvaluatedStatic = read.result
    values = {each.name: getattr(result, each.name) for each in fields(result)}
    return EnteredTable(
        **values
        | {
            "headline": Message("Entered as calibration-{number}.", number),
            "run_ids": (entered.run_id,),
            "files": _written(request, result),
        },
        calibration=f"calibration-{number}",
        model=None if entered.model is None else f"model-{entered.model.model_id}",
    )


def _person(place: Place, name: str) -> str:
    """Return the laboratory's spelling of a person's name; raise an error for an unknown person."""
    if not name:
        return ""
    from torquebench.reports.certificate import kept_letterhead, person_among

    return person_among(name, (*place.people(), *kept_letterhead(place.registry.root).people))


def _circumstances(request: ImportedTable, read: ReadTable, person: str) -> ExternalCalibration:
    from torquebench.campaign.external_calibration import ExternalCalibration
    from torquebench.records import Equipment, Report

    points = read.points
    return ExternalCalibration(
        performed=request.moment(),
        measured_by=person,
        place=request.place,
        transducer=Equipment(
            "transducer",
            points.transducer_serial,
            request.manufacturer,
            request.transducer_model,
            points.range_nm,
        ),
        indicator=points.counter_identity,
        reference=Report(
            "calibrator",
            request.reference_serial,
            request.reference_certificate,
            laboratory=request.reference_laboratory,
            performed=request.reference_performed,
            due=request.reference_due,
        ),
        reference_model=request.reference_model,
        resolution_nm=request.resolution_nm,
        reference_uncertainty=read.stated,
    )


def _reference(
    stated: str | None, points: CalibrationData, source: str, remarks: list[str]
) -> CertifiedUncertainty | float:
    """Return the standard's U (k = 2), in % of the torque or as a function of torque."""
    from torquebench.campaign.chains import remark_another_standard
    from torquebench.uncertainty import CertifiedUncertainty

    if stated is None:
        if points.reference is None:
            raise InputError(
                Message("{source} without U of the standard", source),
                "a table with a comment reference_uncertainty, or the option",
                "give --reference-uncertainty",
            )
        return points.reference.certified
    given = _given(stated, points)
    certified = CertifiedUncertainty.of_torque(1e-2 * given) if isinstance(given, float) else given
    remark_another_standard(points, certified, source, remarks.append)
    return given


def _given(stated: str, points: CalibrationData) -> CertifiedUncertainty | float:
    """Return U by the request's text."""
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


STATIC = on_files(
    "evaluate static",
    StaticTable,
    run_static,
    lambda request: Message("evaluate {name}", request.table.name),
    check_static,
)
IMPORT = Operation(
    "records import",
    ImportedTable,
    run_import,
    lambda request: Message("enter {name}", request.table.name),
    check=check_import,
    role="metrologist",
    quick=True,
    begins=True,
    trial="evaluate static",
)
