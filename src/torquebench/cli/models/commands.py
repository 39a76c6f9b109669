"""`torquebench fit`, `apply` and `verify`: fit, apply and verify compensation models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as data_field
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from torquebench import calibration, compensation
from torquebench.cli.chain_words import tell_missing
from torquebench.cli.models.parameters import ParameterOption, model_parameters
from torquebench.cli.options import (
    RangeOption,
    ReferenceOption,
    TableOptions,
    WithoutOption,
    check_output,
    stated_reference,
    tell_columns,
)
from torquebench.cli.reports import Told
from torquebench.cli.terminal.console import out, say, say_file, warn, write_contradictions
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations.result import HIDDEN
from torquebench.reports.page import Page
from torquebench.units import MS_PER_S

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from torquebench.calibration import CalibrationData
    from torquebench.campaign.results import FitResult
    from torquebench.chain import Effect, MeasuringChain, Readings, Torque
    from torquebench.compensation import StoredModel
    from torquebench.tables import ReadingsTable, Table, TableColumns

__all__ = ["LimitsOption", "apply", "chain_of", "fit", "verify"]

ModelArgument = Annotated[Path, typer.Argument(help="A model file that `fit` wrote.")]
LimitsOption = Annotated[
    Path | None,
    typer.Option(
        "--bench", help="Bench description: its limits count where the chain has no record."
    ),
]
SOURCES_TOLERANCE_PERCENT_FS = 0.1
DEFAULT_KIND = "hybrid"


class Outliers(StrEnum):
    """Treatment of outliers."""

    DOWNWEIGHT = "downweight"
    REFUSE = "refuse"
    KEEP = "keep"


@dataclass(frozen=True, kw_only=True)
class FittedModel(Told):
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
    accepted: bool = data_field(metadata=HIDDEN)
    fit: Any = data_field(metadata=HIDDEN)
    """The `FitResult`, for the report."""
    turning: Any = data_field(metadata=HIDDEN)
    """What was identified from empty runs."""

    @property
    def failed(self) -> bool:
        """Whether the points contradict each other, and nobody has accepted that."""
        return bool(self.contradictions) and not self.accepted

    def page(self) -> Page:
        """Return its description; drawing it takes a third of the time of a fit."""
        from torquebench.reports.fit_report import fit_page
        from torquebench.reports.turning_report import identified_section

        page = fit_page(self.fit)
        if not self.turning.effects:
            return page
        section = identified_section(self.turning.effects, self.turning.remarks, self.range_nm)
        return replace(page, sections=[*page.sections, section])


@dataclass(frozen=True, kw_only=True)
class AppliedModel(Told):
    """Readings that were compensated."""

    rows: int
    lowest_nm: float
    highest_nm: float
    largest_uncertainty_nm: float
    unmeasured: Sequence[str]
    columns: Sequence[Mapping[str, Any]]


@dataclass(frozen=True, kw_only=True)
class VerifiedModel(Told):
    """Models at points that they weren't fitted to; the verdict is that of the second entry."""

    range_nm: float
    groups: int
    points: int
    models: Sequence[calibration.ModelVerification]
    tolerance_percent_fs: float
    passed: bool
    not_in_u: Sequence[str]
    columns: Sequence[Mapping[str, Any]]
    cells: Sequence[calibration.Cell] | None
    described: Any = data_field(metadata=HIDDEN)

    def page(self) -> Page:
        """Return its description."""
        page: Page = self.described()
        return page


def fit(
    data: Annotated[
        list[Path],
        typer.Argument(
            help="Tables (CSV, Excel, TDMS, …) with reading_nm and standard_nm: one calibration, "
            "or several of one chain at other temperatures and speeds."
        ),
    ],
    range_nm: RangeOption = None,
    model: Annotated[
        str | None,
        typer.Option(help="Kind of model; `hybrid` by default."),
    ] = None,
    parameter: ParameterOption = None,
    compare: Annotated[
        bool,
        typer.Option("--compare", help="Compare all kinds of model; that takes a while."),
    ] = False,
    result: Annotated[Path, typer.Option("--out", help="The model file to write.")] = Path(
        "model.json"
    ),
    one_direction: Annotated[
        bool,
        typer.Option("--one-direction", help="The chain is loaded in one direction only."),
    ] = False,
    outliers: Annotated[
        Outliers, typer.Option(help="Treatment of outliers, which are always named.")
    ] = Outliers.DOWNWEIGHT,
    empty: Annotated[
        list[Path] | None,
        typer.Option(
            help="A table of an empty run: time_s, reading_nm, speed_rpm, temperature_c. "
            "May be repeated, for runs at other temperatures."
        ),
    ] = None,
    dynamics: Annotated[
        Path | None, typer.Option(help="A file of `evaluate dynamics`, as an effect of the chain.")
    ] = None,
    without: WithoutOption = None,
    serial: Annotated[str, typer.Option(help="Serial number of the transducer.")] = "",
    counter: Annotated[str, typer.Option(help="Clock that timed the pulses.")] = "",
    reference: ReferenceOption = None,
    profile: Annotated[
        str | None, typer.Option(help="Profile that states limits of size for its transducers.")
    ] = None,
    accept: Annotated[
        str,
        typer.Option(
            metavar="REASON", help="Why a calibration that contradicts itself is used; with --by."
        ),
    ] = "",
    by: Annotated[str, typer.Option(metavar="NAME", help="Who decides so.")] = "",
    *,
    table: TableOptions,
) -> FittedModel:
    """Fit a compensation model to a calibration.

    The default model averages over all effects that the chain may have, including a plain straight
    line or quadratic. With --empty, temperature, rotation and inertia are identified, too, from
    runs with nothing mounted and from points at other temperatures and speeds. --compare compares
    it with all other kinds by cross-validation over steps; --model selects another kind. The
    options that state uncertainties enter U of every torque; `budget` lists what is missing. U of
    the standard is that of the tables' comments, as `turn` and `export` write it, unless
    --reference states another.
    --dynamics makes the inverse filter part of the chain, in files and live. If the points
    contradict each other, the exit code is 1 and the model file is marked.
    """
    from torquebench.calibration import load_profile
    from torquebench.compensation import check_kind
    from torquebench.tables import maps_one, read_calibration_table, read_empty_run

    inputs = [*data, *(empty or ()), *([] if dynamics is None else [dynamics])]
    check_output(result, *inputs, endings=(".json",))
    if model is not None:
        check_kind(model)
    parameters = model_parameters(model or DEFAULT_KIND, parameter)
    if bool(accept.strip()) != bool(by.strip()):
        raise InputError(
            "a decision without a name" if accept.strip() else "a name without a decision",
            "both: the name of the person who uses the model, and the reason",
            "give --accept REASON --by NAME",
        )
    limits = None if profile is None else load_profile(profile).plausibility
    others = [*data, *(empty or ())]
    assigned, conversion = table.column or (), table.conversion()
    read = {
        file.name: read_calibration_table(
            file,
            range_nm=range_nm,
            both_directions=not one_direction and len(data) == 1,
            transducer_serial=serial,
            counter_identity=counter,
            remark=warn,
            mapping=maps_one(assigned, file, [each for each in others if each != file]),
            conversion=conversion,
        )
        for file in data
    }
    columns: list[dict[str, Any]] = []
    for name, each in read.items():
        shown = name if len(read) > 1 else ""
        columns += tell_columns(each.columns.understood, each.columns.notes, shown)
    tables = {name: each.data for name, each in read.items()}
    runs = [read_empty_run(file, assigned) for file in empty or ()]

    from torquebench.campaign.chains import mounting_effect, reference_effect
    from torquebench.campaign.fitting import fit_table, store_model, table_metrics
    from torquebench.campaign.turning import identify_turning, joined_tables
    from torquebench.chain import SwitchedOff
    from torquebench.cli.tables import effects_table
    from torquebench.cli.terminal.progress import TerminalProgress
    from torquebench.compensation import RECOMMENDED

    points = joined_tables(tables, warn)
    certified = stated_reference(reference, points.range_nm, points.side)
    standard = reference_effect(points, certified, ", ".join(tables), warn)
    off: tuple[Effect, ...] = ()
    if without:
        off = (SwitchedOff.of("stated with the fit", *without),)
    if dynamics is not None:
        from torquebench.campaign.dynamics import load_dynamics

        off = (load_dynamics(dynamics), *off)
    with TerminalProgress() as progress:
        turning = identify_turning(points, runs, progress)
        fitted = fit_table(
            turning.points,
            ", ".join(file.name for file in data),
            model or RECOMMENDED,
            progress,
            outliers.value,
            compared=compare,
            limits=limits,
            parameters=parameters,
        )
    for remark in (*turning.remarks, *fitted.remarks):
        warn(remark)
    _print_fit(fitted)
    if turning.effects:
        out().print(effects_table(turning.effects, points.range_nm))
    store_model(
        result,
        fitted.model,
        points,
        table_metrics(fitted),
        (
            *turning.effects,
            *standard,
            *mounting_effect(turning.points),
            *off,
        ),
        fitted.contradictions,
        accepted=f"{by.strip()}: {accept.strip()}" if by and fitted.contradictions else "",
    )
    say_file("Model", result)
    if fitted.contradictions:
        write_contradictions(
            fitted.contradictions,
            f"accepted by {by}: {accept}"
            if by
            else "find the cause and measure again, or override this with a name and a reason: "
            "--accept REASON --by NAME",
        )
    compared = fitted.comparison
    return FittedModel(
        headline=Message("{source}: {title}", fitted.source, fitted.title),
        simulated=fitted.data.simulated,
        range_nm=fitted.data.range_nm,
        points=len(fitted.data),
        kind=fitted.name,
        title=fitted.title,
        raw=fitted.raw,
        fitted=fitted.fitted,
        scatter_nm=None if fitted.noise is None else fitted.noise.standard_deviation_nm,
        contradictions=fitted.contradictions,
        comparison=None if compared is None else compared.scores,
        columns=columns,
        accepted=bool(by),
        fit=fitted,
        turning=turning,
    )


def _print_fit(fitted: FitResult) -> None:
    """Print the comparison, if any, and the errors before and after."""
    from torquebench.cli.tables import comparison_table, error_blocks

    data, comparison, noise = fitted.data, fitted.comparison, fitted.noise
    simulated = " - simulated" if data.simulated else ""
    heading = f"{fitted.source}: {len(data)} points, {data.range_nm:g} N·m{simulated}"
    say(f"[bold]{escape(heading)}[/bold]")
    if comparison is not None:
        out().print(comparison_table(comparison, fitted.name))
        for name, reason in comparison.refused.items():
            warn(f"{name} refused the points: {reason}")
    if noise is not None:
        say(f"scatter of repeated points: {noise.standard_deviation_nm:.3g} N·m")
    reason = "" if comparison is None else f" ({comparison.score(fitted.name).reason})"
    say(f"model: [bold]{fitted.title}[/bold]{reason}")
    rows = [("raw reading", fitted.raw), (f"*{fitted.title}", fitted.fitted)]
    for part in error_blocks([("on the points that it was fitted to", rows)]):
        out().print(part)


def apply(
    model: ModelArgument,
    readings: Annotated[
        Path, typer.Argument(help="A table (CSV, Parquet, TDMS, …) with reading_nm; - reads CSV.")
    ],
    result: Annotated[Path, typer.Option("--out", help="The CSV or Parquet file to write.")],
    zero_age: Annotated[
        float | None, typer.Option(min=0, help="Hours since the zero was taken.")
    ] = None,
    zero_temperature: Annotated[
        float | None, typer.Option(help="Temperature of the transducer at zeroing, °C.")
    ] = None,
    dynamics: Annotated[
        Path | None,
        typer.Option(help="A file of `evaluate dynamics`, for quick torques; rows at its rate."),
    ] = None,
    without: WithoutOption = None,
    bench: LimitsOption = None,
    *,
    table: TableOptions,
) -> AppliedModel:
    """Compensate readings: add torque, additional torque and expanded uncertainty (k = 2).

    U is that of the whole measuring chain; `budget` shows its contributions. The columns branch,
    speed_rpm, temperature_c and standard_error_nm are used if they exist; a quantity that wasn't
    measured increases U by its possible effect on this chain. A file with time_s is one record in
    time order: without a column acceleration_rad_s2 the acceleration is computed from the speed,
    and without a column branch the branch from the earlier readings. Rows are single readings,
    unless a comment states "# window_s = 0.5", or "# steady = true" for steady means as in a
    calibration.
    """
    from torquebench.compensation import load_model
    from torquebench.tables import check_model, check_read, check_written, model_conversion

    check_output(result, model, readings, *([] if dynamics is None else [dynamics]))
    check_read(readings)
    check_written(result)
    stored = load_model(model)
    conversion = model_conversion(stored, table.conversion())
    _warn_of_contradictions(stored)

    from torquebench.chain import RecordedStream, SwitchedOff
    from torquebench.cli.terminal.progress import TerminalProgress
    from torquebench.tables import compensate_file

    chain = chain_of(stored, bench)
    filtering = None
    if dynamics is not None:
        from torquebench.campaign.dynamics import load_dynamics

        filtering = load_dynamics(dynamics)
        chain = chain.with_effects([filtering])
    if without:
        chain = chain.with_effects([SwitchedOff.of("stated with apply", *without)])
    stream = RecordedStream(chain)
    unmeasured: dict[str, None] = {}
    described: list[dict[str, Any]] = []

    def checked(file: Table, columns: TableColumns) -> None:
        check_model(stored, file, columns)
        described.extend(tell_columns(columns.understood, file.notes))

    def known(table: ReadingsTable) -> Readings:
        return table.readings(zero_age_h=zero_age, zero_temperature_c=zero_temperature)

    def columns(known: Readings, torque: Torque) -> tuple[NDArray[np.float64], ...]:
        unmeasured.update(dict.fromkeys(chain.unmeasured(known)))
        return torque.value_nm, torque.value_nm - known.reading_nm, torque.expanded_uncertainty_nm

    def compensate(table: ReadingsTable) -> tuple[NDArray[np.float64], ...]:
        block = known(table)
        if filtering is not None:
            filtering.check_rate(block.time_s)
        return columns(block, chain.torque(block, table.place))

    def follow(
        table: ReadingsTable, following: ReadingsTable | None
    ) -> tuple[NDArray[np.float64], ...]:
        block = known(table)
        if filtering is not None:
            filtering.check_rate(block.time_s)
        torque = stream.torque(block, None if following is None else known(following))
        if not torque.has_number.all():
            chain.refuse(block, table.place)
        return columns(stream.completed_last, torque)

    with TerminalProgress() as progress:
        done = compensate_file(
            readings,
            result,
            compensate,
            timed=follow,
            mapping=table.column or (),
            conversion=conversion,
            check=checked,
            progress=progress,
        )
    simulated = " (simulated)" if done.simulated else ""
    say(f"{done.rows} readings compensated{simulated}")
    say(
        f"additional torque {done.lowest_nm:.4g} to {done.highest_nm:.4g} N·m, "
        f"U (k = 2) up to {done.largest_uncertainty_nm:.3g} N·m"
    )
    say_file("Torque", result)
    if filtering is not None:
        say(
            f"each torque belongs to the time of its row; the filter uses readings up to "
            f"{MS_PER_S * filtering.delay_s:.4g} ms later"
        )
    if unmeasured:
        say(f"not in the file, U contains its possible range: {', '.join(unmeasured)}")
    tell_missing(chain.missing())
    return AppliedModel(
        headline=Message("{rows} readings compensated.", done.rows),
        **vars(done),
        unmeasured=list(unmeasured),
        columns=described,
    )


def verify(
    model: ModelArgument,
    data: Annotated[
        Path, typer.Argument(help="A table with reading_nm and standard_nm; series = group.")
    ],
    tolerance: Annotated[
        float,
        typer.Option(min=0, help="Largest allowed error of a single reading, % of full scale."),
    ] = SOURCES_TOLERANCE_PERCENT_FS,
    zero_temperature: Annotated[
        float | None, typer.Option(help="Temperature at which the points' zero was taken, °C.")
    ] = None,
    without: WithoutOption = None,
    others: Annotated[
        list[Path] | None,
        typer.Option("--with", help="Another model beside it, for comparison. May be repeated."),
    ] = None,
    bench: LimitsOption = None,
    *,
    table: TableOptions,
) -> VerifiedModel:
    """Verify a model on points that it wasn't fitted to; exit code 1 if out of tolerance.

    Every series of the table is a group. --with shows other models beside it; the verdict is that
    of MODEL. Points of a chain with empty runs may be at any speed and temperature within its
    measured range; their zero is that of the calibration unless --zero-temperature states another.
    """
    from torquebench.compensation import load_model
    from torquebench.tables import read_calibration_table

    stored = load_model(model)
    compared = {f"model {path.stem}": load_model(path) for path in others or []}
    options: dict[str, Any] = {"mapping": table.column or (), "conversion": table.conversion()}
    read = read_calibration_table(data, model=stored, remark=warn, **options)
    for other in compared.values():
        read_calibration_table(data, model=other, **options)  # raises an error for another chain
    points = read.data
    columns = tell_columns(read.columns.understood, read.columns.notes)
    if points.sha256() == stored.provenance.training_data_sha256:
        warn("the model was fitted to these points: this isn't a verification")
    _warn_of_contradictions(stored)

    from torquebench.calibration import cells
    from torquebench.calibration import verify as verify_models
    from torquebench.chain import SwitchedOff
    from torquebench.cli.tables import cells_table, print_kept, print_verification

    chains = {name: chain_of(each, bench) for name, each in {"model": stored, **compared}.items()}
    if without:
        off = SwitchedOff.of("stated with verify", *without)
        chains = {name: each.with_effects([off]) for name, each in chains.items()}
    torques = {name: _torque(each, points, zero_temperature) for name, each in chains.items()}
    chain, torque = chains["model"], torques["model"]
    result = verify_models(points, chains, torques)
    titles = [
        _title(stored),
        *(f"{name.removeprefix('model ')}: {_title(each)}" for name, each in compared.items()),
    ]
    print_verification(result, titles)
    _, compensated, *_ = result.models
    if compensated.repeatability is not None:
        found = compensated.repeatability
        say(
            f"repeatability over the groups: {found.pooled_nm:.3g} N·m "
            f"({found.pooled_percent_fs:.3g} % FS)"
        )
    say(f"U (k = 2) of these torques up to {compensated.expanded_uncertainty_nm:.3g} N·m")
    tell_missing(chain.missing())
    if chain.turns:
        out().print(cells_table(points, torque))
    worst = compensated.against_standard.worst_percent_fs
    passed = print_kept("worst error", worst, tolerance)
    return VerifiedModel(
        headline=Message("Worst error {percent:.3g} % FS.", worst),
        verdict="pass" if passed else "fail",
        simulated=result.simulated,
        range_nm=result.range_nm,
        groups=result.groups,
        points=result.points,
        models=result.models,
        tolerance_percent_fs=tolerance,
        passed=passed,
        not_in_u=list(chain.missing()),
        columns=columns,
        cells=cells(points, torque) if chain.turns else None,
        described=lambda: verification_description(
            points,
            dict(zip(titles, torques.values(), strict=True)),
            (("Points", data.name), ("Model", model.name)),
            tolerance,
            torque if chain.turns else None,
        ),
    )


def chain_of(stored: StoredModel, bench: Path | None) -> MeasuringChain:
    """Return the chain of a model file, with a bench's limits if a description is given."""
    from torquebench.chain import MeasuringChain

    if bench is None:
        return MeasuringChain.of(stored)
    from torquebench.bench import load_bench
    from torquebench.bench.chain_effects import chain_on_bench

    return chain_on_bench(stored, load_bench(bench))


def _torque(
    chain: MeasuringChain, points: CalibrationData, zero_temperature: float | None
) -> Torque:
    """Return a chain's torque at points, including points at speed."""
    readings = points.readings(
        zero_temperature_c=zero_temperature, zeroed_each_series=not chain.turns
    )
    return chain.torque(readings)


def verification_description(
    points: CalibrationData,
    torques: Mapping[str, Torque],
    facts: Sequence[tuple[str, str]],
    tolerance: float,
    turning: Torque | None = None,
) -> Page:
    """Return the report of a verification; of a rotating chain with errors over its speed."""
    from torquebench.reports.verification_report import Verified, verification_page

    verified = [
        Verified("raw reading", points.reading_nm),
        *(Verified(title, torque.value_nm) for title, torque in torques.items()),
    ]
    page = verification_page(points, verified, facts, tolerance)
    if turning is not None:
        from torquebench.reports.turning_report import turning_section

        page = replace(page, sections=[*page.sections, turning_section(points, turning, tolerance)])
    return page


def _title(stored: StoredModel) -> str:
    from torquebench.campaign.fitting import model_title

    return model_title(stored.model.kind, stored.model.kind_parameters)


def _warn_of_contradictions(stored: StoredModel) -> None:
    made = stored.provenance
    if made.contradictions:
        accepted = f" Accepted by {made.accepted}." if made.accepted else ""
        warn(
            f"the calibration of this model contradicts itself: {' '.join(made.contradictions)}"
            f"{accepted}"
        )
