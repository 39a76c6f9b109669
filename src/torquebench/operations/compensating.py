"""Compensation models in files: fit, apply, verify, export, and compute budgets."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as data_field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from torquebench import calibration, compensation, uncertainty
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations.operation import (
    WHOLE,
    Flag,
    ModelName,
    Name,
    Number,
    Request,
    Values,
    field,
    on_files,
)
from torquebench.operations.place import Place
from torquebench.operations.readings import (
    Range,
    Reference,
    TorqueTable,
    Without,
    columns_fact,
    stated_reference,
)
from torquebench.operations.result import HIDDEN, Result
from torquebench.progress import Progress
from torquebench.reports.page import Facts, Page, Section, Table
from torquebench.units import DEGREE, HOURS_PER_DAY, MS_PER_S

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from torquebench.calibration import CalibrationData
    from torquebench.chain import MeasuringChain, Readings, Torque
    from torquebench.compensation import StoredModel
    from torquebench.tables import ReadingsTable, TableColumns
    from torquebench.tables import Table as ReadTable

TOLERANCE_PERCENT_FS = 0.1
"""Tolerance of the source papers."""
BRANCHES = {"up": 1, "down": -1, "unknown": 0}

# -- requests -------------------------------------------------------------------------------

Model = Annotated[Path, field("A model file that `fit` wrote.", title="Model file", argument=True)]
Limits = Annotated[
    Path | None,
    field("Bench description: its limits count where the chain has no record.", local=True),
]
Filter = Annotated[
    Path | None,
    field("A file of `evaluate dynamics`: the inverse filter, for quick torques."),
]
ZeroTemperature = Annotated[
    Number | None,
    field("Temperature of the transducer at which the zero was taken."),
]


class FitRequest(TorqueTable):
    """Fit a compensation model to a calibration.

    The default model averages over all effects that the chain may have, including a plain straight
    line or quadratic. With empty runs, temperature, rotation and inertia are identified, too, from
    runs with nothing mounted and from points at other temperatures and speeds. --compare compares
    it with all other kinds by cross-validation over steps; --model selects another kind. The
    options that state uncertainties enter U of every torque; `budget` lists what is missing. U of
    the standard is that of the tables' comments, as `turn` and `export` write it, unless
    --reference states another. --dynamics makes the inverse filter part of the chain, in files and
    live. If the points contradict each other, the check fails and the model file is marked.
    """

    basic = ("tables", "range_nm", "model", "one_direction", "serial", "reference")

    tables: Annotated[
        tuple[Path, ...],
        field(
            "Tables (CSV, Excel, TDMS, …) with reading_nm and standard_nm: one calibration, or "
            "several of one chain at other temperatures and speeds.",
            argument=True,
            min_length=1,
        ),
    ]
    range_nm: Range = None
    model: Annotated[
        ModelName, field("Kind of model.", choices="models", examples=("polynomial-3",))
    ] = "hybrid"
    parameters: Annotated[
        Values,
        field(
            "A parameter of the model. Of published-network: mapping (residual, direct), start "
            "(nguyen-widrow, small-uniform), hidden, epochs, learning_rate, target_error_nm, "
            "random_state.",
            max_length=20,
        ),
    ] = {}  # noqa: RUF012 - pydantic copies it
    compare: Annotated[Flag, field("Compare all kinds of model; that takes a while.")] = False
    out: Annotated[
        Path, field("The model file to write.", title="Model file", output=(".json",))
    ] = Path("model.json")
    one_direction: Annotated[Flag, field("The chain is loaded in one direction only.")] = False
    outliers: Annotated[
        Literal["downweight", "refuse", "keep"],
        field("Treatment of outliers, which are always named."),
    ] = "downweight"
    empty: Annotated[
        tuple[Path, ...],
        field(
            "A table of an empty run: time_s, reading_nm, speed_rpm, temperature_c. May be "
            "repeated, for runs at other temperatures.",
            title="Empty runs",
        ),
    ] = ()
    dynamics: Filter = None
    without: Without = ()
    serial: Annotated[
        str, field("Serial number of the transducer.", title="Transducer, serial number")
    ] = ""
    counter: Annotated[str, field("Clock that timed the pulses.")] = ""
    reference: Reference = None
    profile: Annotated[
        Name | None,
        field(
            "Profile that states limits of size for its transducers.",
            choices="profiles:steps",
        ),
    ] = None
    accept: Annotated[
        str,
        field(
            "Why a calibration that contradicts itself is used; with --by.",
            max_length=500,
            local=True,
        ),
    ] = ""
    by: Annotated[str, field("Who decides so.", max_length=120, local=True)] = ""


class ApplyRequest(TorqueTable):
    """Compensate readings: add torque, additional torque and expanded uncertainty (k = 2).

    U is that of the whole measuring chain; `budget` shows its contributions. The columns branch,
    speed_rpm, temperature_c and standard_error_nm are used if they exist; a quantity that wasn't
    measured increases U by its possible effect on this chain. A file with time_s is one record in
    time order: without a column acceleration_rad_s2 the acceleration is computed from the speed,
    and without a column branch the branch from the earlier readings. Rows are single readings,
    unless a comment states "# window_s = 0.5", or "# steady = true" for steady means as in a
    calibration.
    """

    basic = ("model", "readings", "out")

    model: Model
    readings: Annotated[
        Path,
        field(
            "A table (CSV, Parquet, TDMS, …) with reading_nm; - reads CSV.",
            title="Table",
            argument=True,
        ),
    ]
    out: Annotated[
        Path,
        field(
            "The table to write, in any format that is written; its ending states which.",
            title="File",
            output=("table",),
            examples=("torque.csv",),
        ),
    ]
    zero_age_h: Annotated[Number | None, field("Hours since the zero was taken.", ge=0)] = None
    zero_temperature_c: ZeroTemperature = None
    dynamics: Filter = None
    without: Without = ()
    bench: Limits = None


class VerifyRequest(TorqueTable):
    """Verify a model on points that it wasn't fitted to; the check fails if out of tolerance.

    Every series of the table is a group. --other shows other models beside it; the verdict is that
    of MODEL. Points of a chain with empty runs may be at any speed and temperature within its
    measured range; their zero is that of the calibration unless --zero-temperature states another.
    """

    basic = ("model", "table", "tolerance_percent_fs")

    model: Model
    table: Annotated[
        Path, field("A table with reading_nm and standard_nm; series = group.", argument=True)
    ]
    tolerance_percent_fs: Annotated[
        Number,
        field("Largest allowed error of a single reading.", title="Tolerance", unit="% FS", ge=0),
    ] = TOLERANCE_PERCENT_FS
    zero_temperature_c: ZeroTemperature = None
    without: Without = ()
    others: Annotated[
        tuple[Path, ...],
        field(
            "Another model beside it, for comparison. May be repeated.",
            title="Other model files",
        ),
    ] = ()
    bench: Limits = None


class ExportRequest(Request):
    """Compile a model to a table for other programs: CSV, C header, Structured Text or ONNX.

    The file states its largest deviation from the model, on the calibrated loop and over partial
    loops. C header and Structured Text (IEC 61131-3, for PLCs) have a function for the branch.
    """

    model: Model
    out: Annotated[
        Path,
        field(
            "The file to write: NAME.csv, .h, .st or .onnx.",
            title="File",
            output=(".csv", ".h", ".st", ".onnx"),
            examples=("table.csv",),
        ),
    ]
    decimal_comma: Annotated[Flag, field("CSV with decimal commas and semicolons.")] = False
    no_uncertainty: Annotated[Flag, field("Leave the uncertainty out.")] = False


class BudgetRequest(Request):
    """Compute the uncertainty budget of readings by the GUM, checked by Monte Carlo.

    U is the one that `apply`, `measure`, the panel and certificates state for the same reading
    under the same conditions. A condition that isn't given contributes with its possible range.
    Limits given as options replace those in the model's file. Both methods are compared by the
    criterion of JCGM 101, clause 8. If they differ, state the larger of the two intervals.
    """

    basic = ("model", "readings_nm", "branch", "speed_rpm", "temperature_c", "reference")

    model: Model
    readings_nm: Annotated[
        tuple[Number, ...],
        field("A reading; may be repeated.", title="Reading", min_length=1, max_length=100),
    ]
    branch: Annotated[Literal["up", "down", "unknown"], field("Branch of the reading.")] = "unknown"
    steady: Annotated[Flag, field("A steady mean, as the points of a calibration.")] = False
    standard_error_nm: Annotated[Number | None, field("Standard error of the reading.", ge=0)] = (
        None
    )
    speed_rpm: Annotated[Number | None, field("Speed of the shaft.")] = None
    acceleration_rad_s2: Annotated[Number | None, field("Acceleration of the shaft.")] = None
    angle_deg: Annotated[Number | None, field("Angle of the shaft.")] = None
    window_s: Annotated[Number | None, field("Length of the reading's window.", ge=0)] = None
    temperature_c: Annotated[Number | None, field("Temperature of the transducer.")] = None
    zero_temperature_c: ZeroTemperature = None
    zero_age_h: Annotated[Number | None, field("Hours since the zero was taken.", ge=0)] = None
    age_days: Annotated[Number | None, field("Days since the calibration.", unit="d", ge=0)] = None
    averaged: Annotated[Number, field("Number of separate loadings in the mean.", ge=1)] = 1.0
    reference: Reference = None
    span_limit: Annotated[
        Number | None,
        field("Limit of the span's change, % of torque per 10 K.", ge=0),
    ] = None
    zero_limit: Annotated[
        Number | None,
        field("Limit of the zero's change, % of range per 10 K.", ge=0),
    ] = None
    drift: Annotated[
        Number | None,
        field("Limit of the span's drift, % of torque a year.", ge=0),
    ] = None
    zero_nm: Annotated[Number | None, field("Standard uncertainty of the zero.", ge=0)] = None
    seed: Annotated[int, field("Seed of the Monte Carlo check.", ge=0, le=2**32 - 1), WHOLE] = 0
    bench: Limits = None


# -- results --------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class FittedModel(Result):
    """A model that was fitted to a table; `comparison` with `--compare`."""

    range_nm: float
    points: int
    kind: str
    title: str
    raw: calibration.ErrorSummary
    fitted: calibration.ErrorSummary
    scatter_nm: float | None
    contradictions: Sequence[calibration.Contradiction]
    comparison: Sequence[compensation.ModelScore] | None
    columns: Sequence[Mapping[str, Any]]
    accepted: str = data_field(metadata=HIDDEN)
    """Who has accepted contradictions, and why."""
    fit: Any = data_field(metadata=HIDDEN)
    """The `FitResult`, what was identified from empty runs, and how columns were understood."""

    @property
    def failed(self) -> bool:
        """Whether the points contradict each other, and nobody has accepted that."""
        return bool(self.contradictions) and not self.accepted

    def page(self) -> Page:
        """Return its description."""
        from torquebench.reports.fit_report import fit_page
        from torquebench.reports.turning_report import identified_section

        fitted, turning, understood = self.fit
        page = fit_page(fitted)
        first, *others = page.sections
        sections = [replace(first, blocks=[*first.blocks, *columns_fact(*understood)]), *others]
        if turning.effects:
            sections.append(identified_section(turning.effects, turning.remarks, self.range_nm))
        facts = []
        for each in self.contradictions:
            clause = Message("{allowed} (clause {clause})", each.allowed, each.clause)
            allowed = clause if each.clause else each.allowed
            facts += [("contradiction", each.found), ("allowed", allowed), ("cause", each.cause)]
        if facts:
            decision = self.accepted or (
                "find the cause and measure again, or override this with a name and a reason: "
                "--accept REASON --by NAME"
            )
            facts.append(("accepted by" if self.accepted else "do", decision))
            sections.append(Section("Contradictions", "", [Facts([f for f in facts if f[1]])]))
        return replace(page, sections=sections)


@dataclass(frozen=True, kw_only=True)
class AppliedModel(Result):
    """Readings that were compensated."""

    rows: int
    lowest_nm: float
    highest_nm: float
    largest_uncertainty_nm: float
    unmeasured: Sequence[str]
    not_in_u: Sequence[str]
    columns: Sequence[Mapping[str, Any]]
    delay_s: float | None
    understood: Any = data_field(metadata=HIDDEN)

    def page(self) -> Page:
        """Return its description."""
        facts: list[tuple[str, str]] = [
            (
                "Additional torque",
                Message("{low:.4g} to {high:.4g} N·m", self.lowest_nm, self.highest_nm),
            ),
            ("U (k = 2)", Message("up to {u:.3g} N·m", self.largest_uncertainty_nm)),
        ]
        if self.delay_s is not None:
            told = Message(
                "each torque belongs to the time of its row; the filter uses readings up to "
                "{delay:.4g} ms later",
                MS_PER_S * self.delay_s,
            )
            facts.append(("Inverse filter", told))
        if self.unmeasured:
            told = Message(
                "not in the file, U contains its possible range: {names}",
                Message.joined(self.unmeasured),
            )
            facts.append(("Not measured", told))
        facts += _no_record(self.not_in_u)
        blocks = [Facts(facts), *columns_fact(*self.understood)]
        return Page("Compensated readings", "", [Section("", "", blocks)], simulated=self.simulated)


def _no_record(missing: Sequence[str]) -> list[tuple[str, str]]:
    """Return the fact that names influences without a record; none if all have one."""
    from torquebench.chain import not_in_u

    sentence = not_in_u(missing)
    return [] if sentence is None else [("No record", sentence)]


@dataclass(frozen=True, kw_only=True)
class VerifiedFile(Result):
    """Models at points that they weren't fitted to; the verdict is that of the second entry."""

    range_nm: float
    groups: int
    points: int
    models: Sequence[calibration.ModelVerification]
    tolerance_percent_fs: float
    not_in_u: Sequence[str]
    columns: Sequence[Mapping[str, Any]]
    cells: Sequence[calibration.Cell] | None
    described: Any = data_field(metadata=HIDDEN)
    """Points, torques by title, names of points and model, torque of a rotating chain, columns."""

    def page(self) -> Page:
        """Return its description; of a rotating chain with errors over its speed."""
        from torquebench.reports.errors_table import errors_table
        from torquebench.reports.verification_report import Verified, verification_page

        points, torques, facts, turning, understood = self.described
        titles = ("raw reading", *torques)
        verified = [Verified("raw reading", points.reading_nm)]
        verified += [Verified(title, torque.value_nm) for title, torque in torques.items()]
        _, compensated, *_ = self.models
        facts = [
            *facts,
            ("U (k = 2)", Message("up to {u:.3g} N·m", compensated.expanded_uncertainty_nm)),
        ]
        if (found := compensated.repeatability) is not None:
            told = Message(
                "{nm:.3g} N·m ({percent:.3g} % FS)", found.pooled_nm, found.pooled_percent_fs
            )
            facts.append(("Repeatability over the groups", told))
        facts += _no_record(self.not_in_u)
        page = verification_page(points, verified, facts, self.tolerance_percent_fs)
        tables = []
        for caption, name in (
            ("Errors against the standard.", "against_standard"),
            ("Errors against the true torque.", "against_truth"),
            ("Errors averaged over the groups.", "averaged"),
        ):
            errors = [
                (title, error)
                for title, each in zip(titles, self.models, strict=True)
                if (error := getattr(each, name))
            ]
            if errors:
                tables.append(errors_table(errors, caption, 1))
        first, *others = page.sections
        sections = [
            replace(first, blocks=[*first.blocks, *tables, *columns_fact(understood)]),
            *others,
        ]
        if turning is not None:
            from torquebench.reports.turning_report import turning_section

            sections.append(turning_section(points, turning, self.tolerance_percent_fs))
        return replace(page, sections=sections)


@dataclass(frozen=True, kw_only=True)
class ExportedModel(Result):
    """A model's table for other programs; branch: +1 rising, -1 falling magnitude, 0 unknown."""

    intervals: int
    degree: int
    branch_aware: bool
    low_nm: float
    high_nm: float
    largest_deviation_nm: float
    partial_loops_deviation_nm: float

    def page(self) -> Page:
        """Return its description."""
        span = Message("{low:g} to {high:g} N·m", self.low_nm, self.high_nm)
        loops = Message("{deviation:.3g} N·m", self.partial_loops_deviation_nm)
        facts = [("Range", span), ("Largest deviation over partial loops", loops)]
        return Page("Exported model", "", [Section("", "", [Facts(facts)])])


@dataclass(frozen=True)
class BudgetedReading:
    """The budget of one compensated reading, and the interval of Monte Carlo.

    k is 2: u of curve and scatter contains Student's factor for `student_degrees_of_freedom`.
    """

    reading_nm: float
    branch: str
    student_degrees_of_freedom: float
    torque_nm: float
    standard_uncertainty_nm: float
    coverage_factor: float
    expanded_uncertainty_nm: float
    lines: Sequence[uncertainty.BudgetLine]
    monte_carlo_low_nm: float
    monte_carlo_high_nm: float
    agrees: bool


@dataclass(frozen=True, kw_only=True)
class Budgets(Result):
    """One budget a reading."""

    readings: Sequence[BudgetedReading]
    not_in_u: str
    checks: Sequence[str] = data_field(metadata=HIDDEN)

    def page(self) -> Page:
        """Return its description."""
        sections = [_contributions(*each) for each in zip(self.readings, self.checks, strict=True)]
        return Page("Uncertainty budget", self.not_in_u, sections)


def _contributions(reading: BudgetedReading, sentence: str) -> Section:
    """Describe the contributions, the largest first, and the result."""
    rows = [
        (line.name, f"{line.contribution:.3g}", str(line.distribution), f"{100 * line.share:.1f} %")
        for line in sorted(reading.lines, key=lambda each: -each.contribution)
        if line.contribution != 0.0
    ]
    facts = [
        (
            "torque",
            Message(
                "{torque:.7g} N·m, u = {u:.3g} N·m, k = {k:.2f}, U = {expanded:.2g} N·m",
                reading.torque_nm,
                reading.standard_uncertainty_nm,
                reading.coverage_factor,
                reading.expanded_uncertainty_nm,
            ),
        ),
        ("check", sentence),
        (
            "Monte Carlo",
            Message(
                "{low:.7g} to {high:.7g} N·m",
                reading.monte_carlo_low_nm,
                reading.monte_carlo_high_nm,
            ),
        ),
    ]
    title = Message("reading {reading:g} N·m, branch {branch}", reading.reading_nm, reading.branch)
    table = Table(("quantity", "u N·m", "distribution", "share"), rows)
    return Section(title, "", [table, Facts(facts)])


# -- fit ------------------------------------------------------------------------------------


def check_fit(place: Place, request: FitRequest) -> Iterable[str]:
    """Raise an error for an unknown parameter, or a decision without a name or a reason."""
    if request.parameters:
        from torquebench.operations.calibrating import model_choices

        model_choices([request.model], request.parameters)
    if bool(request.accept.strip()) != bool(request.by.strip()):
        raise InputError(
            "a decision without a name" if request.accept.strip() else "a name without a decision",
            "both: the name of the person who uses the model, and the reason",
            "give --accept REASON --by NAME",
        )
    if request.profile is not None:
        place.library.profile(request.profile)
    return ()


def run_fit(place: Place, request: FitRequest, progress: Progress) -> FittedModel:
    """Fit a model to one calibration or several, and write its file."""
    from torquebench.tables import maps_one, read_empty_run

    remark = place.remarks.append
    limits = None if request.profile is None else place.library.profile(request.profile)
    others = [*request.tables, *request.empty]
    read = {
        file.name: request.calibration(
            file,
            remark,
            range_nm=request.range_nm,
            both_directions=not request.one_direction and len(request.tables) == 1,
            transducer_serial=request.serial,
            counter_identity=request.counter,
            mapping=maps_one(request.column, file, [each for each in others if each != file]),
        )
        for file in request.tables
    }
    understood = [each.columns.understood for each in read.values()]
    runs = [read_empty_run(file, request.column) for file in request.empty]

    from torquebench.campaign.chains import mounting_effect, reference_effect
    from torquebench.campaign.fitting import fit_table, store_model, table_metrics
    from torquebench.campaign.turning import identify_turning, joined_tables

    names = ", ".join(read)
    points = joined_tables({name: each.data for name, each in read.items()}, remark)
    certified = stated_reference(request.reference, points.range_nm, points.side)
    standard = reference_effect(points, certified, names, remark)
    turning = identify_turning(points, runs, progress)
    fitted = fit_table(
        turning.points,
        names,
        request.model,
        progress,
        request.outliers,
        compared=request.compare,
        limits=None if limits is None else limits.plausibility,
        parameters=dict(request.parameters),
    )
    accepted = f"{request.by.strip()}: {request.accept.strip()}" if request.by.strip() else ""
    store_model(
        request.out,
        fitted.model,
        points,
        table_metrics(fitted),
        (
            *turning.effects,
            *standard,
            *mounting_effect(turning.points),
            *_changes(request.dynamics, request.without, "stated with the fit"),
        ),
        fitted.contradictions,
        accepted=accepted if fitted.contradictions else "",
    )
    compared = fitted.comparison
    return FittedModel(
        headline=Message("{source}: {title}", fitted.source, fitted.title),
        simulated=fitted.data.simulated,
        remarks=(*place.remarks, *turning.remarks, *fitted.remarks),
        files=(str(request.out),),
        range_nm=fitted.data.range_nm,
        points=len(fitted.data),
        kind=fitted.name,
        title=fitted.title,
        raw=fitted.raw,
        fitted=fitted.fitted,
        scatter_nm=None if fitted.noise is None else fitted.noise.standard_deviation_nm,
        contradictions=fitted.contradictions,
        comparison=None if compared is None else compared.scores,
        columns=[column for each in understood for column in each.described()],
        accepted=accepted,
        fit=(fitted, turning, understood),
    )


def _changes(dynamics: Path | None, without: Sequence[str], reason: str) -> list[Any]:
    """Return the inverse filter in a file, and the effects that aren't corrected."""
    from torquebench.chain import SwitchedOff

    changes: list[Any] = []
    if dynamics is not None:
        from torquebench.campaign.dynamics import load_dynamics

        changes.append(load_dynamics(dynamics))
    if without:
        changes.append(SwitchedOff.of(reason, *without))
    return changes


def _chain(stored: StoredModel, bench: Path | None) -> MeasuringChain:
    """Return the chain of a model file, with a bench's limits if a description is given."""
    from torquebench.chain import MeasuringChain

    if bench is None:
        return MeasuringChain.of(stored)
    from torquebench.bench import load_bench
    from torquebench.bench.chain_effects import chain_on_bench

    return chain_on_bench(stored, load_bench(bench))


def _remark_contradictions(place: Place, stored: StoredModel) -> None:
    made = stored.provenance
    if made.contradictions:
        accepted = Message(" Accepted by {who}.", made.accepted) if made.accepted else ""
        place.remarks.append(
            Message(
                "the calibration of this model contradicts itself: {contradictions}{accepted}",
                " ".join(made.contradictions),
                accepted,
            )
        )


# -- apply ----------------------------------------------------------------------------------


def check_apply(_place: Place, request: ApplyRequest) -> Iterable[str]:
    """Raise an error for tables that can't be read or written."""
    from torquebench.tables import check_read, check_written

    check_read(request.readings)
    check_written(request.out)
    return ()


class _Compensation:
    """Compensates a table in pieces.

    Parameters
    ----------
    request : ApplyRequest
    stored : StoredModel
    """

    def __init__(self, request: ApplyRequest, stored: StoredModel) -> None:
        from torquebench.chain import RecordedStream

        self._request, self._stored = request, stored
        changes = _changes(request.dynamics, request.without, "stated with apply")
        self.chain = _chain(stored, request.bench).with_effects(changes)
        self.filter: Any = changes[0] if request.dynamics is not None else None
        self._stream = RecordedStream(self.chain)
        self.unmeasured: dict[str, None] = {}
        self.understood: list[Any] = []
        self.notes: list[str] = []

    def check(self, file: ReadTable, columns: TableColumns) -> None:
        """Raise an error for readings of another chain, and keep how columns were understood."""
        from torquebench.tables import check_model

        check_model(self._stored, file, columns)
        self.understood.append(columns.understood)
        self.notes += file.notes

    def _readings(self, table: ReadingsTable) -> Readings:
        request = self._request
        return table.readings(
            zero_age_h=request.zero_age_h, zero_temperature_c=request.zero_temperature_c
        )

    def _checked(self, table: ReadingsTable) -> Readings:
        block = self._readings(table)
        if self.filter is not None:
            self.filter.check_rate(block.time_s)
        return block

    def _columns(self, known: Readings, torque: Torque) -> tuple[NDArray[np.float64], ...]:
        self.unmeasured.update(dict.fromkeys(self.chain.unmeasured(known)))
        return torque.value_nm, torque.value_nm - known.reading_nm, torque.expanded_uncertainty_nm

    def rows(self, table: ReadingsTable) -> tuple[NDArray[np.float64], ...]:
        """Compensate rows that don't depend on each other."""
        block = self._checked(table)
        return self._columns(block, self.chain.torque(block, table.place))

    def follow(
        self, table: ReadingsTable, following: ReadingsTable | None
    ) -> tuple[NDArray[np.float64], ...]:
        """Compensate the next rows of one record in time order."""
        block = self._checked(table)
        after = None if following is None else self._readings(following)
        torque = self._stream.torque(block, after)
        if not torque.has_number.all():
            self.chain.refuse(block, table.place)
        return self._columns(self._stream.completed_last, torque)


def run_apply(place: Place, request: ApplyRequest, progress: Progress) -> AppliedModel:
    """Compensate a file of readings."""
    from torquebench.compensation import load_model

    stored = load_model(request.model)

    from torquebench.tables import compensate_file, model_conversion

    conversion = model_conversion(stored, request.conversion())
    _remark_contradictions(place, stored)
    compensation = _Compensation(request, stored)
    done = compensate_file(
        request.readings,
        request.out,
        compensation.rows,
        timed=compensation.follow,
        mapping=request.column,
        conversion=conversion,
        check=compensation.check,
        progress=progress,
    )
    understood, delay = compensation.understood, compensation.filter
    return AppliedModel(
        headline=Message("{rows} readings compensated.", done.rows),
        remarks=(*place.remarks, *dict.fromkeys(compensation.notes)),
        files=(str(request.out),),
        **vars(done),
        unmeasured=list(compensation.unmeasured),
        not_in_u=list(compensation.chain.missing()),
        columns=[column for each in understood for column in each.described()],
        delay_s=None if delay is None else delay.delay_s,
        understood=understood,
    )


# -- verify ---------------------------------------------------------------------------------


def run_verify(place: Place, request: VerifyRequest, _progress: Progress) -> VerifiedFile:
    """Verify a model, and others beside it."""
    from torquebench.compensation import load_model

    stored = load_model(request.model)
    others = {f"model {path.stem}": load_model(path) for path in request.others}
    read = request.calibration(request.table, place.remarks.append, model=stored)
    for other in others.values():  # raises an error for another chain
        request.calibration(request.table, lambda _remark: None, model=other)
    points = read.data
    if points.sha256() == stored.provenance.training_data_sha256:
        place.remarks.append("the model was fitted to these points: this isn't a verification")
    _remark_contradictions(place, stored)

    from torquebench.calibration import cells
    from torquebench.calibration import verify as verify_models

    off = _changes(None, request.without, "stated with verify")
    chains = {
        name: _chain(each, request.bench).with_effects(off)
        for name, each in {"model": stored, **others}.items()
    }
    torques = {name: _torque(each, points, request) for name, each in chains.items()}
    chain, torque = chains["model"], torques["model"]
    result = verify_models(points, chains, torques)
    titles = [
        _title(stored),
        *(f"{name.removeprefix('model ')}: {_title(each)}" for name, each in others.items()),
    ]
    worst = result.models[1].against_standard.worst_percent_fs
    tolerance = request.tolerance_percent_fs
    return VerifiedFile(
        headline=Message(
            "worst error {percent:.3g} % FS: within the tolerance of {tolerance:g} % FS"
            if worst <= tolerance
            else "worst error {percent:.3g} % FS: out of the tolerance of {tolerance:g} % FS",
            worst,
            tolerance,
        ),
        verdict="pass" if worst <= tolerance else "fail",
        simulated=result.simulated,
        remarks=tuple(place.remarks),
        range_nm=result.range_nm,
        groups=result.groups,
        points=result.points,
        models=result.models,
        tolerance_percent_fs=tolerance,
        not_in_u=list(chain.missing()),
        columns=read.columns.understood.described(),
        cells=cells(points, torque) if chain.turns else None,
        described=(
            points,
            dict(zip(titles, torques.values(), strict=True)),
            [("Points", request.table.name), ("Model", request.model.name)],
            torque if chain.turns else None,
            read.columns.understood,
        ),
    )


def _torque(chain: MeasuringChain, points: CalibrationData, request: VerifyRequest) -> Torque:
    """Return a chain's torque at points, including points at speed."""
    readings = points.readings(
        zero_temperature_c=request.zero_temperature_c, zeroed_each_series=not chain.turns
    )
    return chain.torque(readings)


def _title(stored: StoredModel) -> str:
    from torquebench.campaign.fitting import model_title

    return model_title(stored.model.kind, stored.model.kind_parameters)


# -- export and budget ----------------------------------------------------------------------


def check_export(_place: Place, request: ExportRequest) -> Iterable[str]:
    """Raise an error for a format that doesn't exist, or decimal commas in another than CSV."""
    from torquebench.compensation.export.formats import check_export

    check_export(request.out, decimal_comma=request.decimal_comma)
    return ()


def run_export(_place: Place, request: ExportRequest, _progress: Progress) -> ExportedModel:
    """Compile a model and write the table."""
    from torquebench.compensation import compile_table, export_table, load_model

    stored = load_model(request.model)

    from torquebench.chain import MeasuringChain
    from torquebench.compensation.export.branches import partial_loop_deviation

    table = compile_table(stored.model, uncertainty=not request.no_uncertainty)
    export_table(request.out, table, stored.provenance, decimal_comma=request.decimal_comma)
    percent = 100.0 * table.bound_nm / table.full_scale_nm
    return ExportedModel(
        headline=Message(
            "{count} {degree} intervals for {branches}; the table deviates from the model by at "
            "most {bound:.2g} N·m ({percent:.1g} % FS).",
            table.curve.intervals,
            {1: "linear", 3: "cubic"}[table.curve.degree],
            "each branch" if table.curve.branch_aware else "any branch",
            table.bound_nm,
            percent,
        ),
        remarks=(
            *("the table is the static curve: temperature, rotation and inertia aren't in it",)
            * MeasuringChain.of(stored).turns,
        ),
        files=(str(request.out),),
        intervals=table.curve.intervals,
        degree=table.curve.degree,
        branch_aware=table.curve.branch_aware,
        low_nm=table.reading_low_nm,
        high_nm=table.reading_high_nm,
        largest_deviation_nm=table.bound_nm,
        partial_loops_deviation_nm=partial_loop_deviation(table),
    )


def run_budget(_place: Place, request: BudgetRequest, _progress: Progress) -> Budgets:
    """Compute the budget of each reading."""
    from torquebench.compensation import load_model

    stored = load_model(request.model)

    import numpy as np

    from torquebench.campaign.chains import stated_effects
    from torquebench.chain import not_in_u, readings_of_rows

    chain, range_nm = _chain(stored, request.bench), stored.provenance.range_nm
    chain = chain.with_effects(
        stated_effects(
            chain,
            range_nm,
            reference=stated_reference(request.reference, range_nm),
            span_percent_per_10k=request.span_limit,
            zero_percent_per_10k=request.zero_limit,
            drift_percent_per_year=request.drift,
            zero_nm=request.zero_nm,
        )
    )
    values = request.readings_nm
    rows = {
        "reading_nm": np.array(values),
        "branch": np.full(len(values), BRANCHES[request.branch]),
        "standard_error_nm": request.standard_error_nm,
        "speed_rpm": request.speed_rpm,
        "acceleration_rad_s2": request.acceleration_rad_s2,
        "angle_rad": None if request.angle_deg is None else request.angle_deg * DEGREE,
        "temperature_c": request.temperature_c,
    }
    known = readings_of_rows(
        rows,
        steady=request.steady,
        window_s=request.window_s,
        zero_age_h=request.zero_age_h,
        zero_temperature_c=request.zero_temperature_c,
    )
    age_h = None if request.age_days is None else HOURS_PER_DAY * request.age_days
    torque = chain.torque(
        replace(known, zero_nm=request.zero_nm, calibration_age_h=age_h, loadings=request.averaged)
    )
    freedom = stored.model.scatter_freedom
    found = [
        torque.check(row, generator=np.random.default_rng(request.seed))
        for row in range(len(values))
    ]
    return Budgets(
        headline=Message(
            "k = 2: curve and scatter contain Student's factor for {freedom:.3g} degrees of "
            "freedom.",
            freedom,
        ),
        remarks=tuple(each.sentence() for each in found if not each.agrees),
        readings=[
            BudgetedReading(
                reading_nm=value,
                branch=request.branch,
                student_degrees_of_freedom=freedom,
                torque_nm=each.budget.value,
                standard_uncertainty_nm=each.budget.standard_uncertainty,
                coverage_factor=each.budget.coverage_factor(),
                expanded_uncertainty_nm=each.budget.expanded_uncertainty(),
                lines=each.budget.lines,
                monte_carlo_low_nm=each.monte_carlo.low,
                monte_carlo_high_nm=each.monte_carlo.high,
                agrees=each.agrees,
            )
            for value, each in zip(values, found, strict=True)
        ],
        not_in_u=not_in_u(chain.missing()) or "",
        checks=[each.sentence() for each in found],
    )


FIT = on_files(
    "fit",
    FitRequest,
    run_fit,
    lambda request: Message("fit a model to {name}", request.tables[0].name),
    check_fit,
    quick=False,
)
APPLY = on_files(
    "apply",
    ApplyRequest,
    run_apply,
    lambda request: Message("compensate {name}", request.readings.name),
    check_apply,
)
VERIFY = on_files(
    "verify",
    VerifyRequest,
    run_verify,
    lambda request: Message("verify {name}", request.model.name),
)
EXPORT = on_files(
    "export",
    ExportRequest,
    run_export,
    lambda request: Message("export {name}", request.model.name),
    check_export,
)
BUDGET = on_files(
    "budget",
    BudgetRequest,
    run_budget,
    lambda request: Message("budget of {name}", request.model.name),
)
