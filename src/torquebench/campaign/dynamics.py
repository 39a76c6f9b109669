"""Dynamics of a measuring chain, from recorded runs to a file with the inverse filter."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torquebench.atomic_write import atomic_write
from torquebench.chain import Dynamics, MeasuringChain, Readings, effect_from
from torquebench.compensation import StoredModel, load_model
from torquebench.dynamics import (
    PARAMETERS,
    Delay,
    Inertia,
    InverseFilter,
    Known,
    MotorInertia,
    Shaft,
    Sine,
    Steps,
    TransferFunction,
    Vibration,
    design_inverse,
    identify,
    identify_delay,
    identify_inertia,
    identify_vibration,
    shaft_of,
    shaft_on_bench,
)
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.records import json_text, sha256_of_file
from torquebench.tables import (
    Conversion,
    Table,
    TableColumns,
    check_model,
    model_conversion,
    read_table,
)

FORMAT = "torquebench dynamics 1"
_UNEVEN = 0.01
_STEPS = ("time_s", "reading_nm", "standard_nm", "segment", "period_s")
_DELAY_SHARE = 0.1
"""Assumed limit of the error of a reference's delay, as a share of the delay in its data sheet."""
_FASTER = 11.0
"""Default ratio of the readings' rate to the chain's bandwidth."""
_UNCOMPENSATED = 0.1
"""Relative standard uncertainty of an inertia identified from uncompensated readings."""


@dataclass(frozen=True, eq=False)
class IdentifiedDynamics:
    """Identified dynamics of a chain.

    Attributes
    ----------
    inertia : Inertia or None
        Inertia, if an empty run with ramps was given.
    simulated : bool
        Whether a table is marked as simulated.
    sha256 : dict of str to str
        Hash of every table, by its name.
    shaft : Shaft or None
        Stiffness and damping, where the inertia is known.
    vibration : Vibration or None
        Vibration of the bench, if the runs have steps of torque on it.
    """

    transfer: TransferFunction
    designed: InverseFilter
    inertia: Inertia | None
    simulated: bool
    sha256: dict[str, str]
    shaft: Shaft | None = None
    vibration: Vibration | None = None

    @property
    def effect(self) -> Dynamics:
        """The dynamics as an effect of a measuring chain."""
        simulated = " (simulated)" if self.simulated else ""
        return Dynamics.of(f"identified from {', '.join(self.sha256)}{simulated}", self.designed)


def identify_dynamics(
    runs: Sequence[Path],
    empty: Path | None = None,
    *,
    model: Path | None = None,
    window_s: float | None = None,
    bandwidth_hz: float | None = None,
    interval_s: float | None = None,
    motor: MotorInertia | None = None,
) -> IdentifiedDynamics:
    """Identify the dynamics of a chain from tables, and design the inverse filter.

    Parameters
    ----------
    runs : sequence of pathlib.Path
        Tables with time_s, reading_nm and standard_nm: steps or sines of a known torque; or tables
        of `turn --profile dynamics`.
    empty : pathlib.Path, optional
        Table of an empty run with ramps: time_s, reading_nm, speed_rpm and, if there is one,
        acceleration_rad_s2.
    model : pathlib.Path, optional
        Model file of the chain: readings are compensated by its static curve first, along the
        history of each record. Ramps have small torques, where a chain's curve bends most at the
        reversal.
    window_s : float, optional
        Length of the counter's window; the sample interval where not given.
    bandwidth_hz : float, optional
        Wanted bandwidth, see `design_inverse`.
    interval_s : float, optional
        Time between the readings that are to be filtered; by default that of the runs, and for runs
        of `turn` the longest round one that allows the bandwidth.
    motor : MotorInertia, optional
        Moment of inertia of the motor for runs of `turn`; from their tables by default.

    Raises
    ------
    InputError
        If the tables lack a column, or don't identify a quantity.
    """
    # the static curve only: inertia and dynamics are yet to be identified
    stored = None if model is None else load_model(model)
    chain = None if stored is None else MeasuringChain(stored.model)

    def torque_of(table: _Table) -> NDArray[np.float64]:
        """Return a run's torques: compensated if a chain is given."""
        if chain is None:
            return table["reading_nm"]
        record = Readings(table["reading_nm"], time_s=table["time_s"])
        return chain.torque(record).value_nm

    if not runs:
        raise InputError("no table with a known torque", "one at least")
    tables = {path: read_table(path) for path in runs}
    on_bench = [path for path, table in tables.items() if "segment" in table]
    if on_bench and len(on_bench) < len(tables):
        raise InputError(
            Message("{on_bench} of `turn --profile dynamics` beside other tables", on_bench[0]),
            "one kind of tables",
        )
    known, hashes, simulated = [], {}, False
    for path, content in {} if on_bench else tables.items():
        table = _Table(path, content, ("time_s", "reading_nm", "standard_nm"), stored)
        known.append(Known(table.interval_s, torque_of(table), table["standard_nm"]))
        hashes[path.name] = table.sha256
        simulated = simulated or table.simulated
    inertia = None
    if empty is not None:
        table = _Table(empty, read_table(empty), ("time_s", "reading_nm", "speed_rpm"), stored)
        inertia = identify_inertia(
            table["time_s"],
            torque_of(table),
            table["speed_rpm"],
            table.acceleration,
        )
        if chain is None:
            bent = _UNCOMPENSATED * inertia.inertia_kgm2
            u = float(np.hypot(inertia.standard_uncertainty_kgm2, bent))
            inertia = replace(inertia, standard_uncertainty_kgm2=u)
        hashes[empty.name] = table.sha256
        simulated = simulated or table.simulated
    if on_bench:
        bench = _OnBench.of(tables)
        transfer, identified = bench.chain(motor, inertia)
        step_s = _interval(transfer) if interval_s is None else interval_s
        transfer = replace(transfer, window_s=step_s if window_s is None else window_s)
        return IdentifiedDynamics(
            transfer,
            design_inverse(transfer, step_s, bandwidth_hz),
            inertia,
            simulated or bench.simulated,
            {**bench.sha256, **hashes},
            identified,
            bench.vibration,
        )
    counted_s = known[0].interval_s
    transfer = identify(known, counted_s if window_s is None else window_s)
    if interval_s is not None and window_s is None:
        transfer = replace(transfer, window_s=interval_s)
    designed = design_inverse(
        transfer, counted_s if interval_s is None else interval_s, bandwidth_hz
    )
    shaft = None if inertia is None else shaft_of(transfer, inertia)
    return IdentifiedDynamics(transfer, designed, inertia, simulated, hashes, shaft)


def _interval(transfer: TransferFunction) -> float:
    """Return the longest round interval that allows three times the bandwidth."""
    most = 1.0 / (_FASTER * replace(transfer, window_s=0.0).bandwidth_hz())
    decade = 10.0 ** np.floor(np.log10(most))
    return float(decade * max(factor for factor in (1.0, 2.0, 5.0) if factor * decade <= most))


@dataclass(frozen=True, eq=False)
class _OnBench:
    """Runs of `turn --profile dynamics`."""

    vibration: Vibration
    delay: Delay
    motor: MotorInertia | None
    simulated: bool
    sha256: dict[str, str]

    @classmethod
    def of(cls, tables: Mapping[Path, Table]) -> _OnBench:
        """Return the vibration and the delay that steps and sines in the tables show.

        Raises
        ------
        InputError
            The tables don't identify the vibration or the delay.
        """
        steps, sines = list[NDArray[np.float64]](), list[Sine]()
        hashes, remarks, interval_s = {}, dict[str, str](), 0.0
        for path, table in tables.items():
            columns = TableColumns(table, _STEPS[:3])
            hashes[path.name], remarks = sha256_of_file(path), dict(table.remarks)
            time, reading, standard = (
                np.asarray(columns.numbers(table, name), np.float64) for name in _STEPS[:3]
            )
            segment, period = (table.numbers(name) for name in _STEPS[3:])
            interval_s = float(np.median(np.diff(time)))
            for number in np.unique(segment):
                rows = segment == number
                both = np.array([reading[rows], standard[rows]])
                if np.ptp(np.diff(time[rows])) > _UNEVEN * interval_s:
                    raise InputError(
                        Message("{path}: segment {number:g} has gaps", path, number),
                        "an even rate",
                        "repeat the run",
                    )
                period_s = float(period[rows][0])
                if period_s > 0.0:
                    whole_s = int(both.shape[1] * interval_s / period_s) * period_s
                    kept = both[:, : round(whole_s / interval_s)]
                    sines.append(Sine(interval_s, period_s, *kept))
                else:
                    steps.append(both)
        shortest = min((step.shape[1] for step in steps), default=0)
        rows = np.array([step[:, :shortest] for step in steps]).reshape(-1, 2, shortest)
        stacked = Steps(interval_s, rows[:, 0], rows[:, 1])
        vibration = identify_vibration(stacked)
        late = identify_delay(stacked, sines)
        reference_s = float(remarks.get("reference_delay_s", "0"))
        delay = Delay(
            reference_s + late.delay_s,
            float(np.hypot(late.standard_uncertainty_s, _DELAY_SHARE * reference_s / 3.0**0.5)),
        )
        motor = None
        if "motor_inertia_kgm2" in remarks:
            name = "motor_inertia_standard_uncertainty_kgm2"
            motor = MotorInertia(float(remarks["motor_inertia_kgm2"]), float(remarks[name]))
        return cls(vibration, delay, motor, table.simulated, hashes)

    def chain(
        self, motor: MotorInertia | None, inertia: Inertia | None
    ) -> tuple[TransferFunction, Shaft]:
        """Return transfer function and shaft.

        Raises
        ------
        InputError
            An inertia isn't known.
        """
        motor = motor or self.motor
        vibrates = Message(
            "steps that show a vibration of {frequency_hz:.4g} Hz, but not",
            self.vibration.frequency_hz,
        )
        if motor is None:
            raise InputError(
                Message("{vibrates} the inertia that vibrates", vibrates),
                "the inertia of motor and shaft up to the transducer, by their data sheets",
                "give --motor-inertia, or motor_inertia_kgm2 in the bench description before the "
                "run",
            )
        if inertia is None:
            raise InputError(
                Message("{vibrates} the inertia between transducer and flange", vibrates),
                "an empty run with gentle and steep ramps",
                "record one with `torquebench turn --profile identification`, and give it with "
                "--empty and the chain's --model",
            )
        return shaft_on_bench(self.vibration, motor, inertia, self.delay)


def save_dynamics(path: Path, identified: IdentifiedDynamics) -> None:
    """Write identified dynamics to a file."""
    raw, compensated = identified.designed.raw, identified.designed.compensated
    content = {
        "format": FORMAT,
        "effect": identified.effect.specification(),
        "transfer_function": {
            name: {
                "value": getattr(identified.transfer, name),
                "standard_uncertainty": identified.transfer.standard_uncertainty(name),
            }
            for name in PARAMETERS
        },
        "covariance": identified.transfer.covariance,
        "window_s": identified.transfer.window_s,
        "inertia": identified.inertia,
        "shaft": identified.shaft,
        "vibration": identified.vibration,
        "step": {"raw": raw, "compensated": compensated},
        "bandwidth_hz": identified.designed.bandwidth_hz,
        "noise_gain": identified.designed.noise_gain,
        "simulated": identified.simulated,
        "tables_sha256": identified.sha256,
    }
    atomic_write(path, json_text(content, indent=2) + "\n")


def load_dynamics(path: Path) -> Dynamics:
    """Return the effect in a file that `save_dynamics` wrote.

    Raises
    ------
    InputError
        The file can't be read or isn't a file of dynamics.
    """
    try:
        content: Any = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as problem:
        raise InputError(
            Message("{path} can't be read: {problem}", path, problem),
            "a file of `torquebench evaluate dynamics`",
        ) from problem
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InputError(
            Message("{path} holds no dynamics", path),
            Message("a file whose format is {format!r}", FORMAT),
            "write one with `torquebench evaluate dynamics`",
        )
    effect = effect_from(content.get("effect", {}))
    if not isinstance(effect, Dynamics):
        raise InputError(Message("{path}: effect {kind!r}", path, effect.kind), "dynamics")
    return effect


class _Table:
    """A table with an even sample rate."""

    def __init__(
        self,
        path: Path,
        table: Table,
        required: tuple[str, ...],
        model: StoredModel | None = None,
    ) -> None:
        conversion = None if model is None else model_conversion(model, Conversion())
        columns = TableColumns(table, required, (), conversion)
        if model is not None:
            check_model(model, table, columns)
        self.values = {key: columns.numbers(table, key) for key in required}
        self.simulated = table.simulated
        self.sha256 = sha256_of_file(path)
        self.acceleration = columns.numbers(table, "acceleration_rad_s2")
        step = np.diff(self["time_s"])
        if step.size < 2 or not np.median(step) > 0.0:
            raise InputError(
                Message("{path}: {size} rows", path, step.size + 1), "rows in the order of time_s"
            )
        self.interval_s = float(np.mean(step))
        uneven = np.abs(step - self.interval_s) > _UNEVEN * self.interval_s
        if uneven.any():
            row = int(np.argmax(uneven))
            raise InputError(
                Message(
                    "{place}: {step:.6g} s after the row before, {interval_s:.6g} s on average",
                    table.place(row + 1, "time_s"),
                    step[row],
                    self.interval_s,
                ),
                "an even rate",
                "cut the table at its gaps, and give time_s with more digits",
            )

    def __getitem__(self, key: str) -> NDArray[np.float64]:
        values = self.values[key]
        assert values is not None
        return values
