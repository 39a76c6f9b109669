"""Reducer tests from tables of any bench: columns, options and evaluation, by name.

A class for each: its fields are the options of `torquebench evaluate`, its docstring the help. They
import the evaluations only when used, so that help lists them quickly.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from torquebench.campaign.reducers.catalogue import TESTS, TestName
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.units import ARCMIN, ARCSEC

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from torquebench.reducers import FrictionResult, ReducerDescription

    Table = Mapping[str, NDArray[np.float64]]

MA_PER_A = 1e3
"""Currents of a table are in mA."""
Evaluated = tuple[Any, dict[str, Any]]
"""A result, and the settings that options and reducer together determine."""


@dataclass(frozen=True)
class Option:
    """An option's help, and its smallest and largest value."""

    about: str
    least: float | None = None
    most: float | None = None


TorqueUncertaintyOption = Annotated[
    float, Option("Standard uncertainty of the torque, % of reading.", least=0)
]
ZeroUncertaintyOption = Annotated[float, Option("Standard uncertainty of the zero, N·m.", least=0)]
LargestUncertaintyOption = Annotated[
    float | None, Option("Refuse U above this share of the value, %.", least=0)
]
RatioOption = Annotated[
    float | None,
    Option("Input revolutions per output revolution; negative if the output reverses."),
]
ToleranceOption = Annotated[
    float | None, Option("Largest range of the speeds of one point, rpm.", least=0)
]
ZeroedOption = Annotated[
    bool, Option("The torque was zeroed at rest: estimate no offset from both directions.")
]


@dataclass(frozen=True, kw_only=True)
class TableEvaluation(ABC):
    """A reducer test that is evaluated from a table.

    Attributes
    ----------
    name : str
        Of the command.
    title : str
        Of the test, in reports; an option in braces stands for its value.
    test : str
        The test on the bench whose figures show the result; empty for none.
    columns : mapping of str to str
        Kind of each quantity in the table, by its name.
    needed : tuple of str
        Quantities that the table must have.
    described : bool
        Whether a reducer's description has values or limits for it.
    several : bool
        Whether its table may consist of several files.

    A table also has the number of each row in its file, ``row``.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    test: ClassVar[TestName | Literal[""]] = ""
    columns: ClassVar[Mapping[str, str]]
    needed: ClassVar[tuple[str, ...]]
    described: ClassVar[bool] = True
    several: ClassVar[bool] = True

    keep_outliers: Annotated[
        bool, Option("Evaluate single samples far from their neighbours with the others.")
    ] = False

    def required(self) -> tuple[str, ...]:
        """Return the needed quantities with these options."""
        return self.needed

    def check(self, _reducer: ReducerDescription | None, /) -> None:
        """Refuse options that can't be evaluated, before the table is read."""
        return

    @abstractmethod
    def evaluate(self, table: Table, reducer: ReducerDescription | None, /) -> Evaluated:
        """Return the result and its settings."""

    def figures(self, result: Any) -> tuple[tuple[str, str], ...]:
        """Return the result's figures as pairs of an ``<svg>`` element and a caption."""
        return TESTS[self.test].work().figures(result) if self.test else ()


@dataclass(frozen=True, kw_only=True)
class MotorEvaluation(TableEvaluation, ABC):
    """An evaluation whose torque may be that of a motor by its current."""

    torque_constant: Annotated[
        float | None,
        Option("N·m per A: the torque is that of the current in a column `current`.", least=1e-12),
    ] = None
    driven: ClassVar[str] = "torque"

    def required(self) -> tuple[str, ...]:
        """Return the needed quantities: with a torque constant the current in place of a torque."""
        if self.torque_constant is None:
            return self.needed
        return tuple("current" if name == self.driven else name for name in self.needed)

    def by_current(self, table: Table) -> Table:
        """Return the table with the torque of the current, if a torque constant is given."""
        if self.torque_constant is None:
            return table
        return {**table, self.driven: table["current"] * (self.torque_constant / MA_PER_A)}


@dataclass(frozen=True, kw_only=True)
class GearedEvaluation(MotorEvaluation, ABC):
    """An evaluation whose columns may be those of the motor before the reducer."""

    ratio: Annotated[
        float | None,
        Option("Motor's turns per output turn: results are those at the output, without a loss."),
    ] = None
    motor_columns: Annotated[
        Literal["all", "motion", "torque"],
        Option("Which columns are the motor's, with --ratio: motion is angle or speed."),
    ] = "all"

    def at_output(self, table: Table) -> Table:
        """Return torques, angles and speeds at the output."""
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


@dataclass(frozen=True, kw_only=True)
class Hysteresis(GearedEvaluation):
    """Evaluate torque-angle loops: stiffness, backlash, lost motion, hysteresis loss.

    Columns: torque and angle; optionally position (label of the output position), loop (its number)
    and demanded (requested torque); time if the inertia of a flange is given. Input locked, load at
    the output.
    """

    name = title = test = "hysteresis"
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
    several = False

    rated_torque: Annotated[float | None, Option("Rated torque at the output, N·m.", least=0)] = (
        None
    )
    rule: Annotated[
        Literal["nabtesco", "spinea", "harmonic-drive", "yaskawa"] | None,
        Option("Definition of lost motion."),
    ] = None
    interval: Annotated[
        tuple[float, float] | None, Option("Interval of the stiffness, % of the rated torque.")
    ] = None
    regions: Annotated[tuple[float, float] | None, Option("T1 and T2 of three regions, N·m.")] = (
        None
    )
    settling_loops: Annotated[
        int, Option("Loops left out at the start of each position.", least=0)
    ] = 0
    closure: Annotated[
        float, Option("Gap that counts as closed, % of the width.", least=0, most=100)
    ] = 5.0
    bench_compliance: Annotated[float, Option("Twist of the bench, arcmin per N·m.", least=0)] = 0.0
    compliance_uncertainty: Annotated[
        float, Option("Its standard uncertainty, arcmin per N·m.", least=0)
    ] = 0.0
    flange_inertia: Annotated[
        float | None,
        Option("Moment of inertia between transducer and reducer, kg·m².", least=0),
    ] = None
    inertia_uncertainty: Annotated[
        float, Option("Its expanded uncertainty (k = 2), %.", least=0)
    ] = 10.0
    torque_uncertainty: TorqueUncertaintyOption = 0.0
    zero_uncertainty: ZeroUncertaintyOption = 0.0
    branch_uncertainty: Annotated[
        float, Option("Standard uncertainty between the branches, N·m.", least=0)
    ] = 0.0
    angle_uncertainty: Annotated[
        float, Option("Standard uncertainty of an angle, arcsec.", least=0)
    ] = 0.0

    def required(self) -> tuple[str, ...]:
        """Return the needed quantities: also the time if the inertia of a flange is given."""
        needed = super().required()
        return needed if self.flange_inertia is None else (*needed, "time")

    def check(self, reducer: ReducerDescription | None, /) -> None:
        """Refuse loops without a rated torque."""
        if self.rated_torque is None and reducer is None:
            raise InputError("no rated torque", "--rated-torque, or --reducer")

    def evaluate(self, table: Table, reducer: ReducerDescription | None, /) -> Evaluated:
        """Evaluate the loops; the lost-motion rule and the torques are the reducer's by default."""
        from torquebench.reducers import (
            FlangeInertia,
            LoopSettings,
            LoopUncertainty,
            evaluate_hysteresis,
        )

        table, flange = self.at_output(table), None
        if self.flange_inertia is not None:
            flange = FlangeInertia(self.flange_inertia, self.inertia_uncertainty)
        interval = None
        if self.interval is not None:
            interval = (self.interval[0] / 100.0, self.interval[1] / 100.0)
        loop = LoopSettings(
            rated_torque_nm=self.rated_torque or (reducer.rated_torque_nm if reducer else 0.0),
            rule=self.rule or (reducer.lost_motion_rule if reducer else "nabtesco"),
            stiffness_interval=interval or (reducer.stiffness_interval if reducer else (0.5, 1.0)),
            region_torques_nm=self.regions or (reducer.region_torques_nm if reducer else None),
            settling_loops=self.settling_loops,
            closure_share=self.closure / 100.0,
        )
        result = evaluate_hysteresis(
            table["torque"],
            table["angle"],
            loop,
            position=table.get("position"),
            loop=table.get("loop"),
            demanded_nm=table.get("demanded"),
            bench_compliance_rad_per_nm=self.bench_compliance * ARCMIN,
            time_s=table.get("time"),
            flange=flange,
            uncertainty=LoopUncertainty(
                torque_relative=self.torque_uncertainty / 100.0,
                torque_zero_nm=self.zero_uncertainty,
                torque_branch_nm=self.branch_uncertainty,
                angle_rad=self.angle_uncertainty * ARCSEC,
                bench_compliance_rad_per_nm=self.compliance_uncertainty * ARCMIN,
            ),
            row=table["row"],
            keep_outliers=self.keep_outliers,
        )
        return result, {"loop": loop, "flange": flange}


@dataclass(frozen=True, kw_only=True)
class Friction(GearedEvaluation):
    """Evaluate friction over speed: Coulomb, viscous and Stribeck parts, each direction.

    From points, from a log with steady windows, or from a ramp of speed.

    Columns: speed and torque, both clockwise positive; optionally branch (1 rising, -1 falling
    speed), temperature and demanded (requested speed).
    """

    name = title = "friction"
    columns: ClassVar = {
        "speed": "speed",
        "torque": "torque",
        "current": "current",
        "branch": "label",
        "temperature": "temperature",
        "demanded": "speed",
    }
    needed = ("speed", "torque")
    described = False

    form: Annotated[str, Option("best, or the parts: coulomb, coulomb-viscous, ….")] = "best"
    exponent: Annotated[int, Option("Of the Stribeck part.", least=1, most=2)] = 2
    tolerance: ToleranceOption = None
    zeroed: ZeroedOption = False
    zero_uncertainty: ZeroUncertaintyOption = 0.0
    largest_uncertainty: LargestUncertaintyOption = None

    def evaluate(self, table: Table, _reducer: ReducerDescription | None, /) -> Evaluated:
        """Fit the parts of friction."""
        from torquebench.reducers import evaluate_friction

        table = self.at_output(table)
        result = evaluate_friction(
            table["speed"],
            table["torque"],
            table.get("branch"),
            systematic_uncertainty_nm=self.zero_uncertainty,
            exponent=1 if self.exponent == 1 else 2,
            form=self.form,  # type: ignore[arg-type] # checked by evaluate_friction
            tolerance_rpm=self.tolerance,
            temperature_c=table.get("temperature"),
            demanded_rpm=table.get("demanded"),
            zeroed=self.zeroed,
            row=table["row"],
            keep_outliers=self.keep_outliers,
        )
        if self.largest_uncertainty is not None:
            result.require(self.largest_uncertainty / 100.0)
        return result, {}

    def figures(self, result: FrictionResult) -> tuple[tuple[str, str], ...]:
        """Draw the torque over speed with the fitted parts."""
        import numpy as np

        from torquebench.campaign.reducers.kinds.no_load import fitted_friction
        from torquebench.figures import friction_figure

        curve = result.curve
        fitted = fitted_friction(result, float(np.max(np.abs(curve.speed_rpm))))
        once = np.ones(curve.points.size)
        figure = friction_figure(curve.speed_rpm, curve.torque_nm, once, fit=fitted)
        return ((figure, "Friction torque at each speed, and the fitted parts."),)


@dataclass(frozen=True, kw_only=True)
class NoLoad(MotorEvaluation):
    """Evaluate no-load running torque at each speed, with the parts of friction.

    Columns: speed and torque at the input, both clockwise positive; optionally repeat, branch (1
    rising, -1 falling speed), temperature and demanded (requested speed, which groups the points).
    """

    name = title = test = "no-load"
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

    tolerance: ToleranceOption = None
    zeroed: ZeroedOption = False
    reference_temperature: Annotated[
        float | None, Option("Bring torques to this temperature, °C.")
    ] = None
    torque_uncertainty: TorqueUncertaintyOption = 0.0
    zero_uncertainty: ZeroUncertaintyOption = 0.0
    largest_uncertainty: LargestUncertaintyOption = None

    def evaluate(self, table: Table, _reducer: ReducerDescription | None, /) -> Evaluated:
        """Evaluate the torque at each speed."""
        from torquebench.reducers import TorqueUncertainty, evaluate_no_load

        table = self.by_current(table)
        result = evaluate_no_load(
            table["speed"],
            table["torque"],
            nominal_rpm=table.get("demanded"),
            repeat=table.get("repeat"),
            branch=table.get("branch"),
            temperature_c=table.get("temperature"),
            uncertainty=TorqueUncertainty(self.torque_uncertainty / 100.0, self.zero_uncertainty),
            tolerance_rpm=self.tolerance,
            reference_temperature_c=self.reference_temperature,
            largest_share=_share(self.largest_uncertainty),
            zeroed=self.zeroed,
            row=table["row"],
            keep_outliers=self.keep_outliers,
        )
        return result, {}


@dataclass(frozen=True, kw_only=True)
class Breakaway(MotorEvaluation):
    """Evaluate starting or back-driving torque: the torque at the first motion of each ramp.

    Columns: time, angle and torque of the driven side; optionally run (number of the ramp) and
    position.
    """

    name = "breakaway"
    title = "{kind} torque"
    test = "starting"
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
        Literal["starting", "back-driving"], Option("Driven from the input, or the output.")
    ]
    presliding: Annotated[float, Option("Elastic motion before break-away, arcmin.", least=0)] = 0.0
    torque_uncertainty: TorqueUncertaintyOption = 0.0
    zero_uncertainty: ZeroUncertaintyOption = 0.0
    largest_uncertainty: LargestUncertaintyOption = None

    def evaluate(self, table: Table, _reducer: ReducerDescription | None, /) -> Evaluated:
        """Evaluate the ramps."""
        from torquebench.reducers import TorqueUncertainty, evaluate_breakaway

        table = self.by_current(table)
        result = evaluate_breakaway(
            table["time"],
            table["angle"],
            table["torque"],
            kind=self.kind,
            run=table.get("run"),
            position=table.get("position"),
            uncertainty=TorqueUncertainty(self.torque_uncertainty / 100.0, self.zero_uncertainty),
            presliding_rad=self.presliding * ARCMIN,
            largest_share=_share(self.largest_uncertainty),
            row=table["row"],
            keep_outliers=self.keep_outliers,
        )
        return result, {}


@dataclass(frozen=True, kw_only=True)
class TransmissionError(TableEvaluation):
    """Evaluate transmission error over output revolutions: peak to peak and orders.

    Columns: input and output (angles of both encoders at the same moments), optionally time. Both
    directions may follow each other. A motion to and fro under one revolution gives backlash and
    lost motion.
    """

    name = test = "transmission-error"
    title = "transmission error"
    columns: ClassVar = {"input": "angle", "output": "angle", "time": "time"}
    needed = ("input", "output")
    several = False

    ratio: RatioOption = None
    highest_order: Annotated[
        float | None,
        Option("Per output revolution; three times the ratio by default.", least=1),
    ] = None
    wrapped: Annotated[bool, Option("Both angles start again after each revolution.")] = False
    output_uncertainty: Annotated[
        float, Option("Standard uncertainty of the output encoder, arcsec.", least=0)
    ] = 0.0
    input_uncertainty: Annotated[
        float, Option("Standard uncertainty of the input encoder, arcsec.", least=0)
    ] = 0.0

    def evaluate(self, table: Table, reducer: ReducerDescription | None, /) -> Evaluated:
        """Evaluate revolutions, or strokes under one; the highest order is the reducer's."""
        from torquebench.reducers import (
            AngleUncertainty,
            evaluate_swings,
            evaluate_transmission_error,
            turned_one_way,
            unwrapped,
        )

        driving, driven = table["input"], table["output"]
        if self.wrapped:
            driving, driven = unwrapped(driving), unwrapped(driven)
        ratio = _ratio(self.ratio, reducer)
        known = AngleUncertainty(self.output_uncertainty * ARCSEC, self.input_uncertainty * ARCSEC)
        if turned_one_way(driving, ratio) < 1.0 and self.highest_order is None:
            strokes = evaluate_swings(
                driving,
                driven,
                ratio,
                uncertainty=known,
                row=table["row"],
                keep_outliers=self.keep_outliers,
            )
            return strokes, {"highest_order": None}
        order = self.highest_order or (reducer.highest_error_order if reducer else None)
        result = evaluate_transmission_error(
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


@dataclass(frozen=True, kw_only=True)
class Efficiency(MotorEvaluation):
    """Evaluate efficiency over torque and speed from steady points, or from a log.

    Columns: input_torque and output_torque (the torque on the load), speed of the input, all
    clockwise positive; optionally demanded_torque (at the output) and demanded_speed, which group
    the points, and temperature.
    """

    name = title = test = "efficiency"
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

    ratio: RatioOption = None
    input_uncertainty: TorqueUncertaintyOption = 0.0
    input_zero: ZeroUncertaintyOption = 0.0
    output_uncertainty: TorqueUncertaintyOption = 0.0
    output_zero: ZeroUncertaintyOption = 0.0
    largest_uncertainty: LargestUncertaintyOption = None

    def evaluate(self, table: Table, reducer: ReducerDescription | None, /) -> Evaluated:
        """Evaluate the points."""
        from torquebench.reducers import TorqueUncertainty, evaluate_efficiency

        table = self.by_current(table)
        result = evaluate_efficiency(
            table["input_torque"],
            table["output_torque"],
            table["speed"],
            _ratio(self.ratio, reducer),
            temperature_c=table.get("temperature"),
            nominal_torque_nm=table.get("demanded_torque"),
            nominal_speed_rpm=table.get("demanded_speed"),
            input_uncertainty=TorqueUncertainty(self.input_uncertainty / 100.0, self.input_zero),
            output_uncertainty=TorqueUncertainty(self.output_uncertainty / 100.0, self.output_zero),
            largest_share=_share(self.largest_uncertainty),
            row=table["row"],
            keep_outliers=self.keep_outliers,
        )
        return result, {}


def _share(percent: float | None) -> float | None:
    return None if percent is None else percent / 100.0


def _ratio(ratio: float | None, reducer: ReducerDescription | None) -> float:
    if ratio is not None:
        return ratio
    if reducer is None:
        raise InputError("no ratio", "--ratio, or --reducer with a description that contains it")
    return reducer.signed_ratio


EVALUATIONS: Mapping[str, type[TableEvaluation]] = {
    each.name: each
    for each in (Hysteresis, Friction, NoLoad, Breakaway, TransmissionError, Efficiency)
}
