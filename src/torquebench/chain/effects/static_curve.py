"""The static curve of a chain with its hysteresis: a fitted compensation model."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from torquebench.chain.effect import Effect
from torquebench.chain.readings import FloatArray, Known, Readings
from torquebench.chain.torque import Component
from torquebench.compensation import FEATURES, CompensationModel, HistoryCompensator, features
from torquebench.compensation.hysteresis import LiveTorque
from torquebench.compensation.table import CompensationTable, compile_table
from torquebench.elementwise import Values, functions_for, in_columns
from torquebench.errors import InputError
from torquebench.uncertainty import Distribution, Shared

CORRELATION_SHARE = 0.1
"""Distance of readings, as a share of full scale, from which on the curve's errors are treated as
independent, as are those on opposite branches. A smooth curve's errors are correlated over longer
distances; a shorter distance only makes the U of a comparison larger.
"""
_SQUARE_ROOT_3 = 3.0**0.5
_SQUARE_ROOT_2 = 2.0**0.5


@dataclass(frozen=True)
class StaticCurve(Effect):
    """Additional torque of a fitted model, and the remaining uncertainty of the calibration.

    If the model distinguishes the branches of a hysteresis loop, the branch of each row is used. If
    it is unknown, the middle of the loop is used, with half the loop as the half-width of an
    arcsine distribution, because a reading is more probably on one of the branches than between
    them.

    Parameters
    ----------
    model : CompensationModel
        Fitted.
    """

    title: ClassVar[str] = "static curve with hysteresis"
    needs: ClassVar[tuple[str, ...]] = ("reading_nm", "branch")
    model: CompensationModel

    @property
    def low_nm(self) -> float:
        """Lowest reading that was calibrated, margin included, N·m."""
        return float(self.model.reading_low_nm_)

    @property
    def high_nm(self) -> float:
        """Highest reading that was calibrated, margin included, N·m."""
        return float(self.model.reading_high_nm_)

    @cached_property
    def branch_aware(self) -> bool:
        """Whether the model has branches."""
        return "branch" in self.model.used_features and self._columns > FEATURES.index("branch")

    @property
    def table(self) -> CompensationTable | None:
        """Compiled table of the model, within 1e-6 of full scale, or 1e-5 if that takes too long.

        It compensates every reading, and is stored with the model, which several chains share. None
        if the model uses speed or temperature, or has jumps: then the model itself is evaluated.
        """
        tables = self.model.tables_
        if self.branch_aware not in tables:
            tables[self.branch_aware] = self._compiled()
        table: CompensationTable | None = tables[self.branch_aware]
        return table

    def _compiled(self) -> CompensationTable | None:
        """Return the model's table; None if it can't have one."""
        if {"speed_rpm", "temperature_c"}.intersection(self.model.used_features):
            return None  # the columns change while a model is in use
        try:
            return compile_table(self.model, branches=self.branch_aware)
        except InputError:
            return None

    @property
    def _columns(self) -> int:
        return int(self.model.n_features_in_)

    def inside(self, reading_nm: Values) -> Any:
        """Return which readings are within the calibrated range; False for NaN."""
        return (reading_nm >= self.low_nm) & (reading_nm <= self.high_nm)

    def stream(self) -> Effect:
        """Return a tracker of the branch by earlier readings, if the model has branches."""
        if self.branch_aware and self.table is not None:
            return _FollowedCurve(self.record, self, HistoryCompensator(self.table))
        return self

    def components(self, readings: Readings, torque_nm: Values) -> tuple[Component, ...]:
        """Return curve and hysteresis for the given branch of each reading."""
        torque_nm = np.atleast_1d(torque_nm)
        count = torque_nm.size
        if not self.branch_aware:
            torque, curve = self._evaluate(readings, torque_nm, np.zeros(count))
            return (self._curve(torque_nm, np.zeros(count), torque, curve),)
        up, up_curve = self._evaluate(readings, torque_nm, np.ones(count))
        down, down_curve = self._evaluate(readings, torque_nm, -np.ones(count))
        branch = np.zeros(count) if readings.branch is None else np.sign(readings.branch)
        middle, half = 0.5 * (up + down), 0.5 * (up - down)
        curve = np.where(branch > 0, up_curve, down_curve)
        curve = np.where(branch == 0, np.maximum(up_curve, down_curve), curve)
        unknown = np.where(branch == 0, np.abs(half), 0.0)
        return (
            self._curve(torque_nm, branch, middle, curve),
            Component(
                "hysteresis",
                Shared.LOADING,
                unknown / _SQUARE_ROOT_2,
                half * branch,
                distribution=Distribution.ARCSINE,
            ),
        )

    def _curve(
        self, reading_nm: Values, branch: Values, torque_nm: Values, u_nm: Values
    ) -> Component:
        """Return the curve's correction; errors are alike at close readings of one branch."""
        length_nm = CORRELATION_SHARE * float(self.model.full_scale_nm_)
        place = in_columns(reading_nm, reading_nm / length_nm, 0.5 * branch)
        return Component("static curve", Shared.CALIBRATION, u_nm, torque_nm - reading_nm, place)

    def _evaluate(
        self, readings: Readings, reading_nm: FloatArray, branch: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return torque and the curve's standard uncertainty; NaN outside the calibrated range."""
        inside = self.inside(reading_nm)
        torque, deviation = np.full((2, reading_nm.size), np.nan)
        accepted, sides = reading_nm[inside], branch[inside]
        if self.table is not None:
            signs = sides.astype(np.int8)
            torque[inside] = self.table.torque(accepted, signs)
            deviation[inside] = self.table.standard_uncertainty(accepted, signs)
        elif accepted.size:
            speed, temperature = (
                _rows(values, inside) for values in (readings.speed_rpm, readings.temperature_c)
            )
            X = features(accepted, sides, 0, speed, temperature)[:, : self._columns]
            try:
                torque[inside], deviation[inside] = self.model.predict(X, return_std=True)
            except InputError:  # the model refuses this speed or temperature
                torque[:] = deviation[:] = np.nan
        return torque, deviation


def _rows(values: Known, inside: np.ndarray[Any, np.dtype[np.bool_]]) -> FloatArray:
    every = np.broadcast_to(np.nan if values is None else values, inside.shape)
    return np.asarray(every[inside], dtype=np.float64)


@dataclass(frozen=True)
class _FollowedCurve(Effect):
    """The static curve along one stream, in which each reading moves the play operators."""

    title: ClassVar[str] = StaticCurve.title
    curve: StaticCurve
    history: HistoryCompensator

    def copy(self) -> Effect:
        return _FollowedCurve(self.record, self.curve, self.history.copy())

    def forget(self) -> None:
        self.history.forget()

    def take_zero(self) -> None:
        self.history.take_zero()

    def components(self, readings: Readings, torque_nm: Values) -> tuple[Component, ...]:
        """Return curve and hysteresis of the next readings; NaN outside the calibrated range."""
        inside = self.curve.inside(torque_nm)
        if functions_for(torque_nm).all(inside):
            return self._parts(torque_nm, self.history.push(torque_nm))
        torque_nm, inside = np.atleast_1d(torque_nm), np.atleast_1d(inside)
        followed = LiveTorque(*np.full((5, torque_nm.size), np.nan))
        finite = np.isfinite(torque_nm)
        cuts = np.flatnonzero(np.diff(finite)) + 1
        ends = np.concatenate(([0], cuts, [torque_nm.size]))
        for start, stop in pairwise(ends.tolist()):
            run = slice(start, stop)
            if start == stop:
                continue
            if not finite[start]:
                self.history.forget()
                continue
            live, kept = self.history.push(torque_nm[run]), inside[run]
            for values, new in zip(followed, live, strict=True):
                values[run][kept] = new[kept]
        return self._parts(torque_nm, followed)

    def _parts(self, reading_nm: Values, live: LiveTorque) -> tuple[Component, ...]:
        """Return curve and hysteresis of readings whose position in the loop was followed."""
        return (
            self.curve._curve(
                reading_nm, live.coordinate, live.middle_nm, live.curve_uncertainty_nm
            ),
            Component(
                "hysteresis",
                Shared.LOADING,
                live.half_width_nm / _SQUARE_ROOT_3,
                live.torque_nm - live.middle_nm,
                distribution=Distribution.RECTANGULAR,
            ),
        )
