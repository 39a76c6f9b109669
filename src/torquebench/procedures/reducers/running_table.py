"""Steady points of both sides with a turning input, and the zeros between the points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from bluesky.utils import Msg
from numpy.typing import NDArray

from torquebench.bench.devices import BenchDevices, SteadySettings
from torquebench.bench.roles import SIDES, Side
from torquebench.chain import Torque, joined
from torquebench.procedures.reducers.setup import check_followed, temperature_c
from torquebench.procedures.setup import Plan, power_on, set_mode
from torquebench.procedures.zeroing import measure_zero, zero

FloatArray = NDArray[np.float64]
Row = Mapping[str, Any]
SLACK_SHARE = 0.003
"""Loading accuracy plus additional torque of a healthy module, as a share of its range."""


@dataclass(frozen=True, eq=False)
class RunningRecording:
    """Steady torques of both sides at each point of a test with turning input.

    Parameters
    ----------
    nominal_rpm, nominal_nm : float64[n]
        Requested input speed and output torque.
    speed_rpm : mapping of side to float64[n]
        Mean speeds, clockwise positive, 1/min.
    torque_nm : mapping of side to float64[n]
        Torque that the module applies, compensated where `compensated`, less the zero interpolated
        between the zeros before and after, N·m.
    standard_error_nm : mapping of side to float64[n]
        Standard error of each mean, N·m.
    stated : mapping of side to Torque or None
        Torque of the measuring chain at each point; None without an active one.
    zero_uncertainty_nm : mapping of side to float
        Standard uncertainty of the zero, N·m.
    true_torque_nm : mapping of side to float64[n] or None
        True torque of the twin; None on a real bench.
    direction, branch, repeat : int[n]
        +1 clockwise; +1 while the speed rises; 1, 2, 3.
    series : int[n]
        Number of the preceding zero: the points of a series share its error.
    temperature_c : float64[n]
        Temperature of the reducer, °C; NaN without a probe.
    time_s : float64[n]
        Bench time, s.
    unsettled : int
        Number of points of which a reading still drifted.
    """

    nominal_rpm: FloatArray
    nominal_nm: FloatArray
    speed_rpm: dict[Side, FloatArray]
    torque_nm: dict[Side, FloatArray]
    standard_error_nm: dict[Side, FloatArray]
    stated: dict[Side, Torque | None]
    zero_uncertainty_nm: dict[Side, float]
    true_torque_nm: dict[Side, FloatArray] | None
    direction: NDArray[np.int64]
    branch: NDArray[np.int64]
    repeat: NDArray[np.int64]
    series: NDArray[np.int64]
    temperature_c: FloatArray
    time_s: FloatArray
    compensated: dict[Side, bool]
    unsettled: int


@dataclass(frozen=True)
class RunningPoint:
    """One point: its set point, and its place in the test."""

    speed_rpm: float
    torque_nm: float
    branch: int
    repeat: int


@dataclass
class RunningTable:
    """Collector of points and of the zeros between them."""

    devices: BenchDevices
    sides: tuple[Side, ...]
    points: list[RunningPoint] = field(default_factory=list)
    rows: list[dict[Side, Row]] = field(default_factory=list)
    torques: list[dict[Side, Torque | None]] = field(default_factory=list)
    temperatures: list[float] = field(default_factory=list)
    zeros: dict[Side, list[tuple[float, float, float]]] = field(
        default_factory=lambda: {side: [] for side in SIDES}
    )
    """For each zeroing: bench time, signal, and the compensated torque for a reading of 0."""

    def zero(self, duration_s: float) -> Plan[None]:
        """Zero all sides in use; afterwards the last of them is driven, with the drive on."""
        for side in self.sides[:-1]:
            measured = yield from measure_zero(self.devices, side, duration_s=duration_s)
            self._zero(side, measured.signal)
        side = self.sides[-1]
        measured = yield from zero(self.devices, side, duration_s=duration_s)
        self._zero(side, measured.signal)
        for other in self.sides[:-1]:
            yield from set_mode(self.devices, other, "driven")
            yield from power_on(self.devices, other)

    def _zero(self, side: Side, signal: float) -> None:
        """Keep a zero with the torque that the chain then states for it."""
        context = self.devices.context
        active, standing = context.acquisition.compensation(side), 0.0
        if active is not None:
            standing = float(_in_small_cycles(active.standing()).value_nm[0])
        self.zeros[side].append((context.clock.now(), signal, standing))

    def take(self, point: RunningPoint, settings: SteadySettings) -> Plan[None]:
        """Measure the steady torques of all sides in use over the same window."""
        for side in self.sides:
            yield Msg("prepare", self.devices.module(side).steady, settings, group="reducer")
        yield Msg("wait", None, group="reducer")
        for side in self.sides:
            yield Msg("trigger", self.devices.module(side).steady, group="reducer")
        yield Msg("wait", None, group="reducer")
        yield Msg("create", None, name="points")
        rows: dict[Side, Row] = {}
        for side in self.sides:
            steady = self.devices.module(side).steady
            reading = yield Msg("read", steady)
            prefix = f"{steady.name}-"
            rows[side] = {k.removeprefix(prefix): v["value"] for k, v in reading.items()}
        yield Msg("read", self.devices.point)
        warm = yield from temperature_c(self.devices)
        yield Msg("save")
        check_followed(rows["input"], point.speed_rpm, 0.0, "input")
        if "output" in rows:
            slack_nm = SLACK_SHARE * self.devices.context.description.output.range_nm
            check_followed(rows["output"], 0.0, point.torque_nm, "output", slack_nm=slack_nm)
        self.points.append(point)
        self.rows.append(rows)
        self.torques.append({side: self.devices.module(side).steady.torque for side in self.sides})
        self.temperatures.append(warm)

    # -- results ----------------------------------------------------------------------------

    def compensated(self) -> bool:
        """Return whether every torque of all sides in use was compensated."""
        return all(self._modelled(side) for side in self.sides)

    def _modelled(self, side: Side) -> bool:
        return bool(self.rows) and all("torque_nm" in rows[side] for rows in self.rows)

    def recording(self) -> RunningRecording:
        """Return all points as columns."""
        truth_known = all("true_torque_nm" in row for rows in self.rows for row in rows.values())
        model = {side: self._modelled(side) for side in self.sides}
        torque: dict[Side, FloatArray] = {}
        stated: dict[Side, Torque | None] = {}
        for side in self.sides:
            torques = [torques[side] for torques in self.torques]
            known = [torque for torque in torques if torque is not None] if model[side] else []
            found = _in_small_cycles(joined(known)) if known else None
            stated[side] = found
            value = self._column(side, "reading_nm") if found is None else found.value_nm
            torque[side] = value - self._drift(side)[0]
        return RunningRecording(
            nominal_rpm=np.array([point.speed_rpm for point in self.points]),
            nominal_nm=np.array([point.torque_nm for point in self.points]),
            speed_rpm={side: self._column(side, "speed_rpm") for side in self.sides},
            torque_nm=torque,
            standard_error_nm={
                side: self._column(side, "reading_standard_error_nm") for side in self.sides
            },
            stated=stated,
            zero_uncertainty_nm={side: self._drift(side)[1] for side in self.sides},
            true_torque_nm={side: self._column(side, "true_torque_nm") for side in self.sides}
            if truth_known
            else None,
            direction=np.array([int(np.sign(point.speed_rpm)) for point in self.points], np.int64),
            branch=np.array([point.branch for point in self.points], dtype=np.int64),
            repeat=np.array([point.repeat for point in self.points], dtype=np.int64),
            series=self._interval("input"),
            temperature_c=np.array(self.temperatures),
            time_s=self._column("input", "time_s"),
            compensated=model,
            unsettled=sum(any(not row["settled"] for row in rows.values()) for rows in self.rows),
        )

    def _column(self, side: Side, name: str) -> FloatArray:
        return np.array([rows[side][name] for rows in self.rows], dtype=np.float64)

    def _interval(self, side: Side) -> NDArray[np.int64]:
        """Return the number of the last zero before each point."""
        at = [zeroing[0] for zeroing in self.zeros[side]]
        return np.maximum(np.searchsorted(at, self._column(side, "time_s")) - 1, 0)

    def _drift(self, side: Side) -> tuple[FloatArray, float]:
        """Return the interpolated reading at standstill for each point, and its u, N·m.

        The zero is interpolated linearly between zeroings; half of its change is the limit of a
        rectangular distribution. Depending on its hysteresis, a chain may return a torque other
        than 0 for a reading of 0: this is subtracted as well.
        """
        zeros = self.zeros[side]
        if not zeros or not self.rows:
            return np.zeros(len(self.rows)), 0.0
        at, signal, standing = np.array(zeros).T
        per_nm = self.devices.context.description.module(side).transducer.nominal_sensitivity
        before = self._interval(side)
        moved = np.interp(self._column(side, "time_s"), at, signal) - signal[before]
        spread = float(np.sqrt(np.mean(np.diff(signal) ** 2))) if len(zeros) > 1 else 0.0
        return moved / per_nm + standing[before], 0.5 * spread / per_nm / np.sqrt(3.0)


def _in_small_cycles(torque: Torque) -> Torque:
    """Return torques for the middle of the chain's hysteresis loop, whatever its branch.

    The small cycles of a test lie inside the calibration's hysteresis loop, with a zero of their
    own. The weights of the play operators aren't known well enough for these cycles: the no-load
    torques of two simulated RV-40E benches had errors of up to 2 % with the stated position in the
    loop and of up to 0.7 % with its middle. The difference remains as an uncertainty.
    """
    return torque.without("hysteresis")
