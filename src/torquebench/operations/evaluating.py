"""Evaluate reducer tests from tables of any bench: columns, options and evaluation of each test.

Evaluations are imported only when used, so that help lists the operations quickly.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from dataclasses import field as data_field
from functools import partial
from pathlib import Path
from string import Formatter
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from torquebench import campaign, reducers
from torquebench.campaign.reducers.catalogue import TESTS, TestName
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations.operation import (
    WHOLE,
    Flag,
    Name,
    Number,
    Operation,
    Request,
    field,
    on_files,
)
from torquebench.operations.place import Place
from torquebench.operations.result import HIDDEN, ExplainedError, Result
from torquebench.progress import Progress
from torquebench.reports.page import Page
from torquebench.units import ARCMIN, ARCSEC, DEG_PER_RAD

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Table = Mapping[str, NDArray[np.float64]]

MA_PER_A = 1e3
"""Milliamperes per ampere; tables state currents in mA."""
Evaluated = tuple[Any, dict[str, Any]]
"""A result, and the settings determined by options and reducer."""
TABLE = "A table with a header (CSV, Excel, TDMS, …)"

# -- requests -------------------------------------------------------------------------------

TorqueUncertainty = Annotated[
    Number, field("Standard uncertainty of the torque, % of reading.", ge=0)
]
ZeroUncertainty = Annotated[Number, field("Standard uncertainty of the zero.", ge=0)]
LargestUncertainty = Annotated[
    Number | None, field("Refuse U above this share of the value.", ge=0)
]
Ratio = Annotated[
    Number | None,
    field("Input revolutions per output revolution; negative if the output reverses."),
]
SpeedTolerance = Annotated[Number | None, field("Largest range of the speeds of one point.", ge=0)]
Zeroed = Annotated[
    Flag, field("The torque was zeroed at rest: estimate no offset from both directions.")
]


class TableEvaluation(Request, ABC):
    """A reducer test that is evaluated from a table.

    Attributes
    ----------
    title : str
        Title of the test; an option in braces stands for its value.
    test : str
        The test on the bench whose figures show the result; empty for none.
    columns : mapping of str to str
        Kind of quantity of each column, by the column's name.
    needed : tuple of str
        Quantities that the table must have.

    A table also has the number of each row in its file, ``row``.
    """

    title: ClassVar[str]
    test: ClassVar[TestName | Literal[""]] = ""
    columns: ClassVar[Mapping[str, str]]
    needed: ClassVar[tuple[str, ...]]

    data: Annotated[
        tuple[Path, ...],
        field(
            f"{TABLE}, or several. A torque or speed may stand in a comment or in the file's name, "
            "as `300rpm`.",
            argument=True,
            min_length=1,
        ),
    ]
    column: Annotated[
        tuple[str, ...],
        field(
            "Assigns a header to a quantity: NAME=Header[unit]; a minus sign before the header "
            "reverses the sign. May be repeated."
        ),
    ] = ()
    where: Annotated[
        tuple[str, ...], field("Use only rows with Header=value,value. May be repeated.")
    ] = ()
    keep_outliers: Annotated[
        Flag, field("Also evaluate outliers: single samples far from their neighbours.")
    ] = False
    output: Annotated[
        Path | None,
        field("Folder for a file with all results and the curves.", local=True, output=("folder",)),
    ] = None

    def required(self) -> tuple[str, ...]:
        """Return the needed quantities with these options."""
        return self.needed

    def described(self, _place: Place) -> reducers.ReducerDescription | None:
        """Return the reducer's description, if one is named."""
        return None

    def check(self, _reducer: reducers.ReducerDescription | None, /) -> None:
        """Raise an error for invalid options, before the table is read."""
        return

    @abstractmethod
    def evaluate(self, table: Table, reducer: reducers.ReducerDescription | None, /) -> Evaluated:
        """Return the result and its settings."""

    def figures(self, result: Any) -> tuple[tuple[str, str], ...]:
        """Return the result's figures as pairs of an ``<svg>`` element and a caption."""
        return TESTS[self.test].work().figures(result) if self.test else ()


class DescribedEvaluation(TableEvaluation, ABC):
    """An evaluation for which a reducer's description has values or limits."""

    reducer: Annotated[
        Name | None,
        field(
            "Its description: a .toml file, or a packaged type's name.",
            choices="reducers",
            examples=("rv-40e",),
        ),
    ] = None

    def described(self, place: Place) -> reducers.ReducerDescription | None:
        """Return the reducer's description, if one is named."""
        return None if self.reducer is None else place.library.reducer(self.reducer)


class MotorEvaluation(TableEvaluation, ABC):
    """An evaluation whose torque may be computed from a motor's current."""

    torque_constant: Annotated[
        Number | None,
        field("N·m per A: the torque is that of the current in a column `current`.", ge=1e-12),
    ] = None
    driven: ClassVar[str] = "torque"

    def required(self) -> tuple[str, ...]:
        """Return the needed quantities; with a torque constant, the current replaces the torque."""
        if self.torque_constant is None:
            return self.needed
        return tuple("current" if name == self.driven else name for name in self.needed)

    def by_current(self, table: Table) -> Table:
        """Return the table with torque computed from current, if a torque constant is given."""
        if self.torque_constant is None:
            return table
        return {**table, self.driven: table["current"] * (self.torque_constant / MA_PER_A)}


class GearedEvaluation(MotorEvaluation, ABC):
    """An evaluation whose columns may be of the motor, on the input side of the reducer."""

    ratio: Annotated[
        Number | None,
        field("Motor's turns per output turn: converts results to the output, without losses."),
    ] = None
    motor_columns: Annotated[
        Literal["all", "motion", "torque"],
        field("Which columns are the motor's, with --ratio: motion is angle or speed."),
    ] = "all"

    def at_output(self, table: Table) -> Table:
        """Convert torques, angles and speeds of the motor to the output."""
        table = self.by_current(table)
        if self.ratio is None:
            return table
        if not (math.isfinite(self.ratio) and self.ratio):
            raise InputError(
                Message("ratio {ratio}", self.ratio), "input turns for one output turn, not 0"
            )
        factors = {}
        if self.motor_columns != "motion":
            factors["torque"] = self.ratio
        if self.motor_columns != "torque":
            factors |= {"angle": 1.0 / self.ratio, "speed": 1.0 / self.ratio}
        return {
            name: values * factors.get(self.columns.get(name, ""), 1.0)
            for name, values in table.items()
        }


class Hysteresis(GearedEvaluation, DescribedEvaluation):
    """Evaluate torque-angle loops: stiffness, backlash, lost motion, hysteresis loss.

    Columns: torque and angle; optionally position (label of the output position), loop (its number)
    and demanded (requested torque); time if the inertia of a flange is given. Input locked, load at
    the output.
    """

    title = test = "hysteresis"
    basic = ("data", "reducer", "rated_torque_nm", "rule", "ratio", "torque_constant")
    columns: ClassVar = {
        "torque": "torque",
        "current": "current",
        "angle": "angle",
        "position": "label",
        "loop": "label",
        "demanded": "torque",
        "time": "time",
    }
    needed = ("torque", "angle")

    data: Annotated[tuple[Path, ...], field(f"{TABLE}.", argument=True, min_length=1, max_length=1)]

    rated_torque_nm: Annotated[Number | None, field("Rated torque at the output.", ge=0)] = None
    rule: Annotated[
        Literal["nabtesco", "spinea", "harmonic-drive", "yaskawa"] | None,
        field("Definition of lost motion."),
    ] = None
    interval_percent: Annotated[
        tuple[Number, Number] | None, field("Interval of the stiffness, % of the rated torque.")
    ] = None
    regions_nm: Annotated[tuple[Number, Number] | None, field("T1 and T2 of three regions.")] = None
    settling_loops: Annotated[
        int, field("Number of first loops at each position to leave out.", ge=0), WHOLE
    ] = 0
    closure_percent: Annotated[
        Number, field("Largest gap of a closed loop, % of its width.", ge=0, le=100)
    ] = 5.0
    bench_compliance_arcmin_per_nm: Annotated[
        Number, field("Twist of the bench per torque.", ge=0)
    ] = 0.0
    compliance_uncertainty_arcmin_per_nm: Annotated[
        Number, field("Standard uncertainty of that twist.", ge=0)
    ] = 0.0
    flange_inertia_kgm2: Annotated[
        Number | None,
        field("Moment of inertia between transducer and reducer.", ge=0),
    ] = None
    inertia_uncertainty_percent: Annotated[
        Number, field("Its expanded uncertainty (k = 2).", ge=0)
    ] = 10.0
    torque_uncertainty_percent: TorqueUncertainty = 0.0
    zero_uncertainty_nm: ZeroUncertainty = 0.0
    branch_uncertainty_nm: Annotated[
        Number, field("Standard uncertainty between the branches.", ge=0)
    ] = 0.0
    angle_uncertainty_arcsec: Annotated[
        Number, field("Standard uncertainty of an angle.", ge=0)
    ] = 0.0

    def required(self) -> tuple[str, ...]:
        """Return the needed quantities: also the time if the inertia of a flange is given."""
        needed = super().required()
        return needed if self.flange_inertia_kgm2 is None else (*needed, "time")

    def check(self, reducer: reducers.ReducerDescription | None, /) -> None:
        """Raise an error without a rated torque."""
        if self.rated_torque_nm is None and reducer is None:
            raise InputError("no rated torque", "--rated-torque, or --reducer")

    def evaluate(self, table: Table, reducer: reducers.ReducerDescription | None, /) -> Evaluated:
        """Evaluate the loops; by default with the reducer's lost-motion rule and torques."""
        table, flange = self.at_output(table), None
        if self.flange_inertia_kgm2 is not None:
            flange = reducers.FlangeInertia(
                self.flange_inertia_kgm2, self.inertia_uncertainty_percent
            )
        interval = None
        if self.interval_percent is not None:
            interval = (self.interval_percent[0] / 100.0, self.interval_percent[1] / 100.0)
        loop = reducers.LoopSettings(
            rated_torque_nm=self.rated_torque_nm or (reducer.rated_torque_nm if reducer else 0.0),
            rule=self.rule or (reducer.lost_motion_rule if reducer else "nabtesco"),
            stiffness_interval=interval or (reducer.stiffness_interval if reducer else (0.5, 1.0)),
            region_torques_nm=self.regions_nm or (reducer.region_torques_nm if reducer else None),
            settling_loops=self.settling_loops,
            closure_share=self.closure_percent / 100.0,
        )
        result = reducers.evaluate_hysteresis(
            table["torque"],
            table["angle"],
            loop,
            position=table.get("position"),
            loop=table.get("loop"),
            demanded_nm=table.get("demanded"),
            bench_compliance_rad_per_nm=self.bench_compliance_arcmin_per_nm * ARCMIN,
            time_s=table.get("time"),
            flange=flange,
            uncertainty=reducers.LoopUncertainty(
                torque_relative=self.torque_uncertainty_percent / 100.0,
                torque_zero_nm=self.zero_uncertainty_nm,
                torque_branch_nm=self.branch_uncertainty_nm,
                angle_rad=self.angle_uncertainty_arcsec * ARCSEC,
                bench_compliance_rad_per_nm=self.compliance_uncertainty_arcmin_per_nm * ARCMIN,
            ),
            row=table["row"],
            keep_outliers=self.keep_outliers,
        )
        return result, {"loop": loop, "flange": flange}


class Friction(GearedEvaluation):
    """Evaluate friction over speed: Coulomb, viscous and Stribeck parts, each direction.

    From points, from a log with steady windows, or from a ramp of speed.

    Columns: speed and torque, both clockwise positive; optionally branch (1 rising, -1 falling
    speed), temperature and demanded (requested speed).
    """

    title = "friction"
    basic = ("data", "form", "zeroed", "tolerance_rpm", "ratio", "torque_constant")
    columns: ClassVar = {
        "speed": "speed",
        "torque": "torque",
        "current": "current",
        "branch": "label",
        "temperature": "temperature",
        "demanded": "speed",
    }
    needed = ("speed", "torque")

    form: Annotated[str, field("best, or the parts: coulomb, coulomb-viscous, ….")] = "best"
    exponent: Annotated[int, field("Exponent of the Stribeck part.", ge=1, le=2), WHOLE] = 2
    tolerance_rpm: SpeedTolerance = None
    zeroed: Zeroed = False
    zero_uncertainty_nm: ZeroUncertainty = 0.0
    largest_uncertainty_percent: LargestUncertainty = None

    def evaluate(self, table: Table, _reducer: reducers.ReducerDescription | None, /) -> Evaluated:
        """Fit the parts of friction."""
        table = self.at_output(table)
        result = reducers.evaluate_friction(
            table["speed"],
            table["torque"],
            table.get("branch"),
            systematic_uncertainty_nm=self.zero_uncertainty_nm,
            exponent=1 if self.exponent == 1 else 2,
            form=self.form,  # type: ignore[arg-type] # checked by evaluate_friction
            tolerance_rpm=self.tolerance_rpm,
            temperature_c=table.get("temperature"),
            demanded_rpm=table.get("demanded"),
            zeroed=self.zeroed,
            row=table["row"],
            keep_outliers=self.keep_outliers,
        )
        if self.largest_uncertainty_percent is not None:
            result.require(self.largest_uncertainty_percent / 100.0)
        return result, {}

    def figures(self, result: reducers.FrictionResult) -> tuple[tuple[str, str], ...]:
        """Draw the torque over speed with the fitted parts."""
        import numpy as np

        from torquebench.campaign.reducers.kinds.no_load import fitted_friction
        from torquebench.figures import friction_figure

        curve = result.curve
        fitted = fitted_friction(result, float(np.max(np.abs(curve.speed_rpm))))
        once = np.ones(curve.points.size)
        figure = friction_figure(curve.speed_rpm, curve.torque_nm, once, fit=fitted)
        return ((figure, "Friction torque at each speed, and the fitted parts."),)


class NoLoad(MotorEvaluation, DescribedEvaluation):
    """Evaluate no-load running torque at each speed, with the parts of friction.

    Columns: speed and torque at the input, both clockwise positive; optionally repeat, branch (1
    rising, -1 falling speed), temperature and demanded (requested speed, which groups the points).
    """

    title = test = "no-load"
    basic = (
        "data",
        "reducer",
        "zeroed",
        "tolerance_rpm",
        "reference_temperature_c",
        "torque_constant",
    )
    columns: ClassVar = {
        "speed": "speed",
        "torque": "torque",
        "current": "current",
        "repeat": "label",
        "branch": "label",
        "temperature": "temperature",
        "demanded": "speed",
    }
    needed = ("speed", "torque")

    tolerance_rpm: SpeedTolerance = None
    zeroed: Zeroed = False
    reference_temperature_c: Annotated[
        Number | None, field("Temperature to which torques are corrected.")
    ] = None
    torque_uncertainty_percent: TorqueUncertainty = 0.0
    zero_uncertainty_nm: ZeroUncertainty = 0.0
    largest_uncertainty_percent: LargestUncertainty = None

    def evaluate(self, table: Table, _reducer: reducers.ReducerDescription | None, /) -> Evaluated:
        """Evaluate the torque at each speed."""
        table = self.by_current(table)
        result = reducers.evaluate_no_load(
            table["speed"],
            table["torque"],
            nominal_rpm=table.get("demanded"),
            repeat=table.get("repeat"),
            branch=table.get("branch"),
            temperature_c=table.get("temperature"),
            uncertainty=reducers.TorqueUncertainty(
                self.torque_uncertainty_percent / 100.0, self.zero_uncertainty_nm
            ),
            tolerance_rpm=self.tolerance_rpm,
            reference_temperature_c=self.reference_temperature_c,
            largest_share=_share(self.largest_uncertainty_percent),
            zeroed=self.zeroed,
            row=table["row"],
            keep_outliers=self.keep_outliers,
        )
        return result, {}


class Breakaway(MotorEvaluation, DescribedEvaluation):
    """Evaluate starting or back-driving torque: the torque at the first motion of each ramp.

    Columns: time, angle and torque of the driven side; optionally run (number of the ramp) and
    position.
    """

    title = "{kind} torque"
    test = "starting"
    basic = ("data", "reducer", "kind", "presliding_arcmin", "torque_constant", "keep_outliers")
    columns: ClassVar = {
        "time": "time",
        "angle": "angle",
        "torque": "torque",
        "current": "current",
        "run": "label",
        "position": "label",
    }
    needed = ("time", "angle", "torque")

    kind: Annotated[
        Literal["starting", "back-driving"], field("Driven from the input, or the output.")
    ]
    presliding_arcmin: Annotated[Number, field("Elastic motion before break-away.", ge=0)] = 0.0
    torque_uncertainty_percent: TorqueUncertainty = 0.0
    zero_uncertainty_nm: ZeroUncertainty = 0.0
    largest_uncertainty_percent: LargestUncertainty = None

    def evaluate(self, table: Table, _reducer: reducers.ReducerDescription | None, /) -> Evaluated:
        """Evaluate the ramps."""
        table = self.by_current(table)
        result = reducers.evaluate_breakaway(
            table["time"],
            table["angle"],
            table["torque"],
            kind=self.kind,
            run=table.get("run"),
            position=table.get("position"),
            uncertainty=reducers.TorqueUncertainty(
                self.torque_uncertainty_percent / 100.0, self.zero_uncertainty_nm
            ),
            presliding_rad=self.presliding_arcmin * ARCMIN,
            largest_share=_share(self.largest_uncertainty_percent),
            row=table["row"],
            keep_outliers=self.keep_outliers,
        )
        return result, {}


class TransmissionError(DescribedEvaluation):
    """Evaluate transmission error over output revolutions: peak to peak and orders.

    Columns: input and output (angles of both encoders at the same moments), optionally time. Both
    directions may follow each other. A reciprocating motion under one revolution gives backlash and
    lost motion.
    """

    test = "transmission-error"
    title = "transmission error"
    basic = ("data", "reducer", "ratio", "highest_order", "wrapped", "keep_outliers")
    columns: ClassVar = {"input": "angle", "output": "angle", "time": "time"}
    needed = ("input", "output")

    data: Annotated[tuple[Path, ...], field(f"{TABLE}.", argument=True, min_length=1, max_length=1)]

    ratio: Ratio = None
    highest_order: Annotated[
        Number | None,
        field("Per output revolution; three times the ratio by default.", ge=1),
    ] = None
    wrapped: Annotated[Flag, field("Both angles start again after each revolution.")] = False
    output_uncertainty_arcsec: Annotated[
        Number, field("Standard uncertainty of the output encoder.", ge=0)
    ] = 0.0
    input_uncertainty_arcsec: Annotated[
        Number, field("Standard uncertainty of the input encoder.", ge=0)
    ] = 0.0

    def evaluate(self, table: Table, reducer: reducers.ReducerDescription | None, /) -> Evaluated:
        """Evaluate revolutions or shorter strokes; the reducer determines the highest order."""
        driving, driven = table["input"], table["output"]
        if self.wrapped:
            driving, driven = reducers.unwrapped(driving), reducers.unwrapped(driven)
        ratio = _ratio(self.ratio, reducer)
        known = reducers.AngleUncertainty(
            self.output_uncertainty_arcsec * ARCSEC, self.input_uncertainty_arcsec * ARCSEC
        )
        if reducers.turned_one_way(driving, ratio) < 1.0 and self.highest_order is None:
            strokes = reducers.evaluate_swings(
                driving,
                driven,
                ratio,
                uncertainty=known,
                row=table["row"],
                keep_outliers=self.keep_outliers,
            )
            return strokes, {"highest_order": None}
        order = self.highest_order or (reducer.highest_error_order if reducer else None)
        result = reducers.evaluate_transmission_error(
            driving,
            driven,
            ratio,
            time_s=table.get("time"),
            highest_order=order,
            uncertainty=known,
            row=table["row"],
            keep_outliers=self.keep_outliers,
        )
        return result, {"highest_order": order}


class Efficiency(MotorEvaluation, DescribedEvaluation):
    """Evaluate efficiency over torque and speed from steady points, or from a log.

    Columns: input_torque and output_torque (the torque on the load), speed of the input, all
    clockwise positive; optionally demanded_torque (at the output) and demanded_speed, which group
    the points, and temperature.
    """

    title = test = "efficiency"
    basic = (
        "data",
        "reducer",
        "ratio",
        "input_uncertainty_percent",
        "output_uncertainty_percent",
        "torque_constant",
    )
    columns: ClassVar = {
        "input_torque": "torque",
        "current": "current",
        "output_torque": "torque",
        "speed": "speed",
        "demanded_torque": "torque",
        "demanded_speed": "speed",
        "temperature": "temperature",
    }
    needed = ("input_torque", "output_torque", "speed")
    driven = "input_torque"

    ratio: Ratio = None
    input_uncertainty_percent: TorqueUncertainty = 0.0
    input_zero_nm: ZeroUncertainty = 0.0
    output_uncertainty_percent: TorqueUncertainty = 0.0
    output_zero_nm: ZeroUncertainty = 0.0
    largest_uncertainty_percent: LargestUncertainty = None

    def evaluate(self, table: Table, reducer: reducers.ReducerDescription | None, /) -> Evaluated:
        """Evaluate the points."""
        table = self.by_current(table)
        result = reducers.evaluate_efficiency(
            table["input_torque"],
            table["output_torque"],
            table["speed"],
            _ratio(self.ratio, reducer),
            temperature_c=table.get("temperature"),
            nominal_torque_nm=table.get("demanded_torque"),
            nominal_speed_rpm=table.get("demanded_speed"),
            input_uncertainty=reducers.TorqueUncertainty(
                self.input_uncertainty_percent / 100.0, self.input_zero_nm
            ),
            output_uncertainty=reducers.TorqueUncertainty(
                self.output_uncertainty_percent / 100.0, self.output_zero_nm
            ),
            largest_share=_share(self.largest_uncertainty_percent),
            row=table["row"],
            keep_outliers=self.keep_outliers,
        )
        return result, {}


def _share(percent: float | None) -> float | None:
    return None if percent is None else percent / 100.0


def _ratio(ratio: float | None, reducer: reducers.ReducerDescription | None) -> float:
    if ratio is not None:
        return ratio
    if reducer is None:
        raise InputError("no ratio", "--ratio, or --reducer with a description that contains it")
    return reducer.signed_ratio


# -- result ---------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class EvaluatedTable(Result):
    """A reducer test evaluated from a table; findings qualify or forbid its verdict."""

    test: str
    data: str
    columns: Sequence[Mapping[str, Any]]
    quantities: Sequence[campaign.ReducerTestQuantity]
    findings: Sequence[reducers.Finding]
    reducer: Any = data_field(metadata=HIDDEN)
    """The reducer's description, None without one."""
    evaluated: Any = data_field(metadata=HIDDEN)
    """Result of the evaluation, of `torquebench.reducers`."""
    request: Any = data_field(metadata=HIDDEN)
    """The request, which draws the figures."""
    conversions: str = data_field(metadata=HIDDEN)
    """How `columns` with foreign names or units were converted, in words; empty without any."""

    @property
    def failed(self) -> bool:
        """Whether a limit is exceeded, or a finding forbids a verdict."""
        return super().failed or any(each.severe for each in self.findings)

    def page(self) -> Page:
        """Return its description."""
        from torquebench.reports.evaluation_report import evaluation_page

        return evaluation_page(
            self.test,
            self.data,
            self.evaluated,
            self.quantities,
            self.reducer,
            partial(self.request.figures, self.evaluated),
            conversions=self.conversions,
        )


def check_evaluation(place: Place, request: TableEvaluation) -> Iterable[str]:
    """Raise an error for invalid options, or a table from a stream, which can't be hashed."""
    from torquebench.tables import check_kept

    request.check(request.described(place))
    if request.output is not None:
        for file in request.data:
            check_kept(file)
    return ()


def run_evaluation(place: Place, request: TableEvaluation, _progress: Progress) -> EvaluatedTable:
    """Read and evaluate the table; write all results if a folder is named."""
    from torquebench.campaign.reducers.columns import read_columns

    reducer = request.described(place)
    read = read_columns(
        request.data, request.columns, request.required(), request.column, request.where
    )
    place.remarks.extend(read.notes)
    source = ", ".join(file.name for file in request.data)

    from torquebench.campaign.reducers.quantities import result_quantities
    from torquebench.uncertainty import Verdict

    try:
        result, settings = request.evaluate(
            {**read.numbers, "row": read.rows.astype("float64")}, reducer
        )
    except reducers.OpenLoopError as problem:
        from torquebench.reports.evaluation_report import open_loop_page

        loop, why = problem.loop, str(problem)
        raise ExplainedError(
            problem.found,
            problem.allowed,
            problem.remedy,
            partial(open_loop_page, source, loop, why),
        ) from None
    except InputError as problem:
        if not request.keep_outliers:
            raise
        remedy = Message("{remedy}; or leave --keep-outliers out", problem.remedy)
        raise InputError(problem.found, problem.allowed, remedy) from None
    judged = () if reducer is None else reducers.verdicts(result, reducer)
    title = evaluation_title(request)
    files: tuple[str, ...] = ()
    if request.output is not None:
        described = None if reducer is None else reducer.model_dump(mode="json")
        chosen = request.model_dump(
            exclude={"data", "column", "where", "output", "reducer"}, mode="json"
        )
        content = {
            "test": title,
            "settings": {**chosen, **settings, "reducer": described},
            **_numbers(request.data, result, judged),
        }
        files = _written(request.output, content, result)
    verdict = Verdict.worst(each.decision.verdict for each in judged)
    quantities = result_quantities(result, judged)
    findings = tuple(getattr(result, "findings", ()))
    return EvaluatedTable(
        headline=_headline(len(quantities), judged, findings),
        verdict=verdict,
        remarks=tuple(place.remarks),
        files=files,
        test=title,
        data=source,
        columns=read.understood.described(),
        conversions=read.understood.sentence(),
        quantities=quantities,
        findings=findings,
        reducer=reducer,
        evaluated=result,
        request=request,
    )


def _headline(
    quantities: int,
    judged: Sequence[reducers.QuantityVerdict],
    findings: Sequence[reducers.Finding],
) -> str:
    if severe := [each.name for each in findings if each.severe]:
        return Message("Not to be used for a verdict: {findings}.", ", ".join(severe))
    if not judged:
        return Message("{count} quantities, none with a limit.", quantities)
    kept = sum(not each.decision.verdict.failed for each in judged)
    return Message("{kept} of {count} limits met.", kept, len(judged))


def _numbers(
    files: Sequence[Path], result: Any, judged: Sequence[reducers.QuantityVerdict]
) -> dict[str, Any]:
    import hashlib

    from torquebench import __version__
    from torquebench.campaign.reducers.results import plain_budget

    return {
        "software_version": __version__,
        "data": ", ".join(file.name for file in files),
        "data_sha256": ", ".join(hashlib.sha256(each.read_bytes()).hexdigest() for each in files),
        "quantities": [
            {"key": each.key, "title": each.title, "rule": each.rule, **plain_budget(each.estimate)}
            for each in result.quantities()
        ],
        "verdicts": [
            {
                "key": each.key,
                "limit": each.limit,
                "verdict": str(each.decision.verdict),
                "conformance_probability": each.decision.conformance_probability,
                "rule": each.decision.rule(),
            }
            for each in judged
        ],
        "findings": list(getattr(result, "findings", ())),
    }


def _written(output: Path, content: Mapping[str, Any], result: Any) -> tuple[str, ...]:
    """Write all results as JSON and the figures' data as CSV; return the names of the files."""
    from torquebench.atomic_write import atomic_write
    from torquebench.records import json_text

    output.mkdir(parents=True, exist_ok=True)
    atomic_write(output / "result.json", json_text(content, indent=2) + "\n")
    files = [output / "result.json"]
    if rows := _curves(result):
        files.append(output / "curves.csv")
        atomic_write(files[-1], "\n".join(rows) + "\n")
    return tuple(map(str, files))


def _curves(result: Any) -> list[str]:
    """Return the lines of a table of loops, error curves or strokes; none for other results."""
    if hasattr(result, "loops"):
        return [
            "position,loop,torque_nm,rising_rad,falling_rad",
            *(
                f"{loop.position:g},{loop.loop},{t:.8g},{up:.9g},{down:.9g}"
                for loop in result.loops
                for t, up, down in zip(
                    loop.curve.torque_nm, loop.curve.rising_rad, loop.curve.falling_rad, strict=True
                )
            ),
        ]
    if hasattr(result, "directions"):
        name = "direction"
        curves = [(each.direction, each.angle_rad, each.error_arcsec) for each in result.directions]
    elif hasattr(result, "swings"):
        name = "stroke"
        curves = [
            (number, each.angle_rad, each.error_rad / ARCSEC)
            for number, each in enumerate(result.swings, 1)
        ]
    else:
        return []
    return [
        f"{name},angle_deg,error_arcsec",
        *(
            f"{which},{angle:.8g},{error:.6g}"
            for which, angles, errors in curves
            for angle, error in zip(angles * DEG_PER_RAD, errors, strict=True)
        ),
    ]


def evaluation_title(request: TableEvaluation) -> str:
    """Return the name of the test."""
    names = (name for _, name, _, _ in Formatter().parse(request.title) if name)
    return Message(request.title, *(getattr(request, name) for name in names))


def _operation(name: str, request: type[TableEvaluation]) -> Operation:
    """Return the operation that evaluates one test."""
    return on_files(f"evaluate {name}", request, run_evaluation, evaluation_title, check_evaluation)


HYSTERESIS = _operation("hysteresis", Hysteresis)
FRICTION = _operation("friction", Friction)
NO_LOAD = _operation("no-load", NoLoad)
BREAKAWAY = _operation("breakaway", Breakaway)
TRANSMISSION_ERROR = _operation("transmission-error", TransmissionError)
EFFICIENCY = _operation("efficiency", Efficiency)
