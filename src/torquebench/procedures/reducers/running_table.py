"""Steady points of both sides at turning input, with the zeros between them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from bluesky.utils import Msg
from numpy.typing import NDArray

from torquebench.bench.devices import BenchDevices, SteadySettings
from torquebench.bench.drivers.base import SIDES, Side
from torquebench.compensation import HistoryCompensator, features
from torquebench.procedures.reducers.setup import check_followed, temperature_c
from torquebench.procedures.setup import Plan, power_on, set_mode
from torquebench.procedures.zeroing import measure_zero, zero

__all__ = ["Asked", "RunningRecording", "RunningTable"]

FloatArray = NDArray[np.float64]
Row = Mapping[str, Any]
SLACK_SHARE = 0.003
"""Loading accuracy and additional torque of a healthy module together, as a share of its range."""
LOOP_SHARE = 0.1
"""Torque, as a share of the calibrated range, from which on a cycle opens a transducer's hysteresis
as far as the calibration did."""


@dataclass(frozen=True, eq=False)
class RunningRecording:
    """Steady torques of both sides at each point of a test with turning input.

    Parameters
    ----------
    nominal_rpm, nominal_nm : float64[n]
        Input speed and output torque that were asked for.
    speed_rpm : mapping of side to float64[n]
        Mean speeds, clockwise positive, 1/min.
    torque_nm : mapping of side to float64[n]
        Torque that the module applies, compensated where `compensated`, less what a standing
        shaft reads then: interpolated between the zeros before and after, N·m.
    standard_error_nm : mapping of side to float64[n]
        Standard error of each mean, N·m.
    model_uncertainty_nm : mapping of side to float64[n]
        Standard uncertainty of the active model; NaN without one.
    zero_uncertainty_nm : mapping of side to float
        Standard uncertainty that the zero leaves, N·m.
    true_torque_nm : mapping of side to float64[n] or None
        The twin's; None on a real bench.
    direction, branch, repeat : int[n]
        +1 clockwise; +1 while the speed rises; 1, 2, 3.
    series : int[n]
        Number of the zero before: points of one series share what that got wrong.
    temperature_c : float64[n]
        Of the reducer; NaN without a probe.
    time_s : float64[n]
        Bench time, s.
    compensated : mapping of side to bool
    unsettled : int
        Points that were taken although a reading still drifted.
    """

    nominal_rpm: FloatArray
    nominal_nm: FloatArray
    speed_rpm: dict[Side, FloatArray]
    torque_nm: dict[Side, FloatArray]
    standard_error_nm: dict[Side, FloatArray]
    model_uncertainty_nm: dict[Side, FloatArray]
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
class Asked:
    """One point: what is asked for, and where it stands."""

    speed_rpm: float
    torque_nm: float
    branch: int
    repeat: int


@dataclass
class RunningTable:
    """Gathers points and the zeros between them."""

    devices: BenchDevices
    sides: tuple[Side, ...]
    asked: list[Asked] = field(default_factory=list)
    rows: list[dict[Side, Row]] = field(default_factory=list)
    temperatures: list[float] = field(default_factory=list)
    zeros: dict[Side, list[tuple[float, float, float]]] = field(
        default_factory=lambda: {side: [] for side in SIDES}
    )
    """Of each zeroing: bench time, frequency, and the compensated torque of a reading of 0."""

    def zero(self, duration_s: float) -> Plan[None]:
        """Zero all sides in use; the last of them is driven afterwards, drive on."""
        for side in self.sides[:-1]:
            found = yield from measure_zero(self.devices, side, duration_s=duration_s)
            self._zero(side, found.frequency_hz)
        side = self.sides[-1]
        found = yield from zero(self.devices, side, duration_s=duration_s)
        self._zero(side, found.frequency_hz)
        for other in self.sides[:-1]:
            yield from set_mode(self.devices, other, "driven")
            yield from power_on(self.devices, other)

    def _zero(self, side: Side, frequency_hz: float) -> None:
        context = self.devices.context
        active, standing = context.acquisition.compensation(side), 0.0
        if active is not None:
            probe = context.description.module(side).temperature_probe
            width = int(active.model.n_features_in_)
            at_zero = features(0.0, 0.0, 0.0, 0.0, context.acquisition.temperature_c(probe))
            standing = float(active.model.predict(at_zero[:, :width])[0])
        self.zeros[side].append((context.clock.now(), frequency_hz, standing))

    def take(self, asked: Asked, settings: SteadySettings) -> Plan[None]:
        """Take the steady torques of all sides in use over the same window."""
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
        check_followed(rows["input"], asked.speed_rpm, 0.0, "input")
        if "output" in rows:
            slack_nm = SLACK_SHARE * self.devices.context.description.output.range_nm
            check_followed(rows["output"], 0.0, asked.torque_nm, "output", slack_nm=slack_nm)
        self.asked.append(asked)
        self.rows.append(rows)
        self.temperatures.append(warm)

    # -- what came out ----------------------------------------------------------------------

    def compensated(self) -> bool:
        """Tell whether every torque of all sides in use was compensated."""
        return all(self._modelled(side) for side in self.sides)

    def _modelled(self, side: Side) -> bool:
        return bool(self.rows) and all("torque_nm" in rows[side] for rows in self.rows)

    def recording(self) -> RunningRecording:
        """Return all points as columns."""
        known = all("true_torque_nm" in row for rows in self.rows for row in rows.values())
        model = {side: self._modelled(side) for side in self.sides}
        empty = np.full(len(self.rows), np.nan)
        torque, uncertainty = {}, {}
        for side in self.sides:
            found = (
                self._compensated(side)
                if model[side]
                else (self._column(side, "reading_nm"), empty)
            )
            torque[side], uncertainty[side] = found[0] - self._drift(side)[0], found[1]
        return RunningRecording(
            nominal_rpm=np.array([each.speed_rpm for each in self.asked]),
            nominal_nm=np.array([each.torque_nm for each in self.asked]),
            speed_rpm={side: self._column(side, "speed_rpm") for side in self.sides},
            torque_nm=torque,
            standard_error_nm={
                side: self._column(side, "reading_standard_error_nm") for side in self.sides
            },
            model_uncertainty_nm=uncertainty,
            zero_uncertainty_nm={side: self._drift(side)[1] for side in self.sides},
            true_torque_nm={side: self._column(side, "true_torque_nm") for side in self.sides}
            if known
            else None,
            direction=np.array([int(np.sign(each.speed_rpm)) for each in self.asked], np.int64),
            branch=np.array([each.branch for each in self.asked], dtype=np.int64),
            repeat=np.array([each.repeat for each in self.asked], dtype=np.int64),
            series=self._interval("input"),
            temperature_c=np.array(self.temperatures),
            time_s=self._column("input", "time_s"),
            compensated=model,
            unsettled=sum(any(not row["settled"] for row in rows.values()) for rows in self.rows),
        )

    def _column(self, side: Side, name: str) -> FloatArray:
        return np.array([rows[side][name] for rows in self.rows], dtype=np.float64)

    def _compensated(self, side: Side) -> tuple[FloatArray, FloatArray]:
        """Return compensated torques and the model's standard uncertainty, N·m.

        The small cycles of a test lie inside the calibration's hysteresis loop: on neither of its
        branches, with a zero of their own. So the middle of the loop counts, and the uncertainty
        that the model has on a branch, with what plays leave between that middle and a small cycle.
        """
        active = self.devices.context.acquisition.compensation(side)
        if active is None or active.history is None or active.accepted is not None:
            return self._column(side, "torque_nm"), self._column(side, "torque_uncertainty_nm")
        reading, width = self._column(side, "reading_nm"), int(active.model.n_features_in_)
        middle = active.model.predict(features(reading, 0.0, 0.0)[:, :width])
        rectified = self._column(side, "torque_rectified_nm")
        (up, first), (down, second) = (
            active.model.predict(features(reading, sign, 0.0)[:, :width], return_std=True)
            for sign in (1.0, -1.0)
        )
        # A cycle so far below the loop's own width opens it in proportion only.
        reach_nm = active.history.table.reach_nm
        opened = np.minimum(np.abs(middle) / (LOOP_SHARE * reach_nm), 1.0)
        loop = np.hypot(0.5 * np.abs(up - down) * opened, _in_small_cycles(active.history, reading))
        return middle + rectified, np.hypot(np.maximum(first, second), loop / np.sqrt(3.0))

    def _interval(self, side: Side) -> NDArray[np.int64]:
        """Return the number of the zero before each point."""
        at = [each[0] for each in self.zeros[side]]
        return np.maximum(np.searchsorted(at, self._column(side, "time_s")) - 1, 0)

    def _drift(self, side: Side) -> tuple[FloatArray, float]:
        """Return what a standing shaft would read at each point and its standard uncertainty, N·m.

        The zero goes straight from one zeroing to the next; half of what it moved between two
        of them, as a rectangle, is what that may be wrong by. A model need not give 0 for a
        reading of 0 (the middle of its hysteresis isn't): that is taken off too.
        """
        zeros = self.zeros[side]
        if not zeros or not self.rows:
            return np.zeros(len(self.rows)), 0.0
        at, frequency, standing = np.array(zeros).T
        scale = self.devices.context.description.module(side).transducer
        per_nm = scale.nominal_sensitivity_hz_per_nm
        before = self._interval(side)
        moved = np.interp(self._column(side, "time_s"), at, frequency) - frequency[before]
        spread = float(np.sqrt(np.mean(np.diff(frequency) ** 2))) if len(zeros) > 1 else 0.0
        return moved / per_nm + standing[before], 0.5 * spread / per_nm / np.sqrt(3.0)


def _in_small_cycles(history: HistoryCompensator, reading_nm: FloatArray) -> FloatArray:
    """Return by how much plays shift cycles 0 → x → 0 → −x against the loop's middle, N·m.

    How the plays share the loop isn't known well enough to take that off.
    """
    operator = history.operator
    shift = []
    for reading in reading_nm:
        tracker = operator.tracker()
        tracker.settle(0.0)
        state, _ = tracker.push([reading, 0.0, -reading, 0.0, reading])
        shift.append(operator.amplitude_nm * (state[4] - state[3]))
    return np.abs(np.array(shift, dtype=np.float64))
