"""Efficiency over torque and speed: η = T_o/(R·T_i) when the input drives, with iso-lines."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import Delaunay, QhullError

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.preparation import (
    BLOCKS,
    OUTLYING,
    Samples,
    decimal_step,
    grouped,
    is_ramp,
    repeat_outliers,
    windows_of,
)
from torquebench.reducers.quantities import (
    Finding,
    LimitedQuantity,
    ResultQuantity,
    budget,
    common_of_both,
    distinct_texts,
    refuse,
    unsteady_temperature,
)
from torquebench.reducers.torque_uncertainty import KnownTorque, TorqueUncertainty, over
from torquebench.uncertainty import Budget, BudgetLine, Shared
from torquebench.units import RAD_S_PER_RPM

if TYPE_CHECKING:
    from torquebench.reducers.description import DataSheetLimits

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Side = Literal["input", "output"]
SAME_POINT, SAME_VALUE = 0.01, 0.05
"""Largest difference of repeated points, as a share of the largest torque or speed and of their
own."""
AT_REST = 0.01
"""Share of the largest speed below which a log's shaft is at rest."""


# -- points -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class EfficiencyPoint:
    """Efficiency at one torque and one speed.

    Parameters
    ----------
    key : str
        Name for programs, unique within a result.
    driving : {"input", "output"}
        Which side drives.
    speed_rpm : float
        Input speed, 1/min, clockwise positive.
    torque_nm : float
        Output torque, N·m, magnitude.
    efficiency : Budget
        In %.
    loss_w : float
        Power that is lost, W.
    points : int
        Number of steady points in the mean.
    temperature_c : float
        Mean; NaN where it wasn't measured.
    nominal_torque_nm, nominal_speed_rpm : float
        Set point that the point is named by: torque as a magnitude, speed with its sign; the
        means of the step where none was given.
    both : bool
        Whether the point is the mean of both directions.
    """

    key: str
    driving: Side
    speed_rpm: float
    torque_nm: float
    efficiency: Budget
    loss_w: float
    points: int
    temperature_c: float
    nominal_torque_nm: float
    nominal_speed_rpm: float
    both: bool = False

    @property
    def quantity(self) -> ResultQuantity:
        """The value under its name, for tables and reports."""
        title = Message(
            "efficiency at {nominal_torque_nm:.4g} N·m, {nominal_speed_rpm:.5g} rpm{both}{value}",
            self.nominal_torque_nm,
            self.nominal_speed_rpm,
            ", mean of both directions" if self.both else "",
            ", output drives" if self.driving == "output" else "",
        )
        return ResultQuantity(self.key, title, self.efficiency)

    def input_torque_nm(self, ratio: float) -> float:
        """Return the magnitude of the input torque, N·m."""
        share = self.efficiency.value / 100.0
        ideal = self.torque_nm / abs(ratio)
        return ideal / share if self.driving == "input" else ideal * share


@dataclass(frozen=True, eq=False)
class EfficiencyMap:
    """Efficiency over a grid of torque and speed.

    Parameters
    ----------
    ratio : float
        Input turns for one output turn, negative where reversed.
    points : tuple of EfficiencyPoint
        Points, sorted by driving side, speed and torque.
    means : tuple of EfficiencyPoint
        Mean of both directions where both were driven: errors of the zeros cancel.
    """

    ratio: float
    points: tuple[EfficiencyPoint, ...]
    findings: tuple[Finding, ...]
    means: tuple[EfficiencyPoint, ...] = ()

    def _of(self, driving: Side, direction: float) -> list[EfficiencyPoint]:
        """Return the points of one driving side and direction of rotation."""
        return [
            point
            for point in self.points
            if point.driving == driving and point.speed_rpm * direction > 0.0
        ]

    def grid(
        self, driving: Side = "input", direction: int = 1, size: int = 41
    ) -> tuple[Floats, Floats, Floats]:
        """Return speeds (rpm), torques (N·m) and interpolated efficiencies (%), for iso-lines.

        Between the points the input torque is interpolated linearly in torque and speed, which
        follows friction better than interpolating the efficiency itself. The efficiencies have
        the shape (torques, speeds) and are NaN outside the measured points.
        """
        chosen = self._of(driving, direction)
        if not chosen:
            raise InputError(
                Message("no point with the {driving} driving", driving), "points in this direction"
            )
        speed, torque, drive = self._columns(chosen)
        speeds = np.linspace(speed.min(), speed.max(), size)
        torques = np.linspace(torque.min(), torque.max(), size)
        places = np.meshgrid(speeds, torques)
        weight = _weights(speed, torque, places[0].ravel(), places[1].ravel())
        between = np.asarray((weight @ drive).reshape(size, size))
        ideal = torques[:, None] / abs(self.ratio)
        share = ideal / between if driving == "input" else between / ideal
        return speeds, torques, 100.0 * share

    def _columns(self, points: Sequence[EfficiencyPoint]) -> tuple[Floats, Floats, Floats]:
        """Return speeds, output torques and input torques of points."""
        rows = [
            (point.speed_rpm, point.torque_nm, point.input_torque_nm(self.ratio))
            for point in points
        ]
        speed, torque, drive = np.array(rows, dtype=np.float64).reshape(-1, 3).T
        return speed, torque, drive

    def at(self, torque_nm: float, speed_rpm: float, driving: Side = "input") -> Budget:
        """Return the interpolated efficiency in % at an output torque and an input speed.

        Raises
        ------
        InputError
            Outside the measured points.
        """
        chosen = self._of(driving, speed_rpm)
        speed, torque, drive = self._columns(chosen)
        point = np.array([speed_rpm]), np.array([torque_nm])
        weight = _weights(speed, torque, *point)[0] if chosen else np.array([np.nan])
        if np.isnan(weight[0]):
            raise InputError(
                Message("{torque_nm:g} N·m at {speed_rpm:g} rpm", torque_nm, speed_rpm),
                "a torque and speed within the measured points",
                "measure there, or ask within the map",
            )
        ideal = torque_nm / abs(self.ratio)
        between = float(weight @ drive)
        share = ideal / between if driving == "input" else between / ideal
        if not all(
            np.isfinite(chosen_point.efficiency.standard_uncertainty) for chosen_point in chosen
        ):
            return Budget(100.0 * share, inf, inf, (), "%")
        # An interpolated input torque and the efficiency have the same relative contributions.
        pull = weight * drive / between
        parts: list[BudgetLine] = []
        for name in sorted(
            {line.name for chosen_point in chosen for line in chosen_point.efficiency.lines}
        ):
            relative = np.zeros(len(chosen))
            freedom, shared = np.inf, Shared.NOTHING
            for index, chosen_point in enumerate(chosen):
                for line in (line for line in chosen_point.efficiency.lines if line.name == name):
                    relative[index] = (
                        line.sensitivity * line.contribution / chosen_point.efficiency.value
                    )
                    freedom, shared = min(freedom, line.degrees_of_freedom), line.shared
            size = float(pull @ relative)
            if shared is Shared.NOTHING:
                size = float(np.linalg.norm(pull * relative))
            sign = float(np.sign(size)) or 1.0
            parts.append(BudgetLine(name, 100.0 * share * abs(size), freedom, sign, shared))
        return budget(100.0 * share, "%", parts)

    def quantities(self) -> tuple[ResultQuantity, ...]:
        """Return the values under their names, for tables and reports."""
        return tuple(item.quantity for item in (*self.means, *self.points))

    def limited(self, limits: DataSheetLimits) -> Iterator[LimitedQuantity]:
        """Return the values that the data sheet limits; those without a limit may be left out."""
        for limit in limits.efficiency:
            for sign in (1.0, -1.0):
                try:
                    estimate = self.at(limit.torque_nm, sign * limit.speed_rpm)
                except InputError:
                    continue
                title = Message(
                    "efficiency at {torque:g} N·m, {speed:g} rpm",
                    limit.torque_nm,
                    sign * limit.speed_rpm,
                )
                key = f"efficiency_{limit.torque_nm:g}_nm_{sign * limit.speed_rpm:g}_rpm"
                yield LimitedQuantity(key, title, estimate, lower=limit.percent)


SLACK = 0.01
"""Share of the range by which a point may lie outside."""


def _weights(speed: Floats, torque: Floats, at_speed: Floats, at_torque: Floats) -> Floats:
    """Return linear interpolation weights, shape (targets, points); NaN outside the points.

    Examples
    --------
    >>> speed, torque = np.array([1.0, 1.0, 3.0, 3.0]), np.array([5.0, 9.0, 5.0, 9.0])
    >>> weight = _weights(speed, torque, np.array([2.0, 5.0]), np.array([6.0, 6.0]))
    >>> round(float(weight[0] @ (speed + torque)), 9), bool(np.isnan(weight[1, 0]))
    (8.0, True)
    """
    axes: list[Floats] = []
    places: list[Floats] = []
    for column, place in ((speed, at_speed), (torque, at_torque)):
        width = float(np.ptp(column))
        if width <= SLACK * float(np.abs(column).max()):
            middle = float(column.mean())
            outside = np.abs(place - middle) > SLACK * abs(middle)
            places.append(np.where(outside, np.nan, 0.0))
            continue
        scaled = (place - column.min()) / width
        scaled = np.where((scaled < -SLACK) | (scaled > 1 + SLACK), np.nan, np.clip(scaled, 0, 1))
        places.append(scaled)
        axes.append((column - column.min()) / width)
    result = np.full((at_speed.size, speed.size), np.nan)
    inside = np.flatnonzero(~(np.isnan(places[0]) | np.isnan(places[1])))
    if not axes:
        result[inside] = 1.0 / speed.size
    elif len(axes) == 1:
        place = places[0] if np.ptp(speed) > SLACK * float(np.abs(speed).max()) else places[1]
        result[inside] = _weights_on_line(axes[0], place[inside])
    else:
        result[inside] = _weights_in_plane(np.column_stack(axes), np.column_stack(places)[inside])
    return result


def _weights_on_line(axis: Floats, place: Floats) -> Floats:
    """Return the weights of linear interpolation along one axis."""
    order = np.argsort(axis, kind="stable")
    units = np.eye(axis.size)[order]
    columns = [np.interp(place, axis[order], units[:, k]) for k in range(axis.size)]
    return np.column_stack(columns)


def _weights_in_plane(points: Floats, places: Floats) -> Floats:
    """Return weights for interpolating between points at places in a plane; NaN outside."""
    try:
        mesh = Delaunay(points)
    except QhullError:  # all points on one oblique line
        far = points[np.argmax(np.ptp(points, axis=0))]
        return _weights_on_line(points @ far, places @ far)
    simplex = mesh.find_simplex(places, tol=1e-9)
    weight = np.full((places.shape[0], points.shape[0]), np.nan)
    for row in np.flatnonzero(simplex >= 0):
        transform = mesh.transform[simplex[row]]
        part = transform[:2] @ (places[row] - transform[2])
        weight[row] = 0.0
        weight[row, mesh.simplices[simplex[row]]] = [*part, 1.0 - part.sum()]
    return weight


# -- evaluation -------------------------------------------------------------------------------


def evaluate_efficiency(
    input_torque_nm: ArrayLike,
    output_torque_nm: ArrayLike,
    speed_rpm: ArrayLike,
    ratio: float,
    *,
    temperature_c: ArrayLike | None = None,
    nominal_torque_nm: ArrayLike | None = None,
    nominal_speed_rpm: ArrayLike | None = None,
    input_uncertainty: KnownTorque | None = None,
    output_uncertainty: KnownTorque | None = None,
    largest_share: float | None = None,
    steady: bool = False,
    row: ArrayLike | None = None,
    keep_outliers: bool = False,
) -> EfficiencyMap:
    """Evaluate the efficiency from steady points, or from the steady windows of a log.

    The side that puts power in drives: η = T_o/(R·T_i) when the input drives, R·T_i/T_o when the
    output does. u(η)/η = √((u_To/T_o)² + (u_Ti/T_i)²).

    Parameters
    ----------
    input_torque_nm, output_torque_nm : array of float, shape (n,)
        Torque that the drive puts on the input, and torque that the output puts on its load, of
        each steady point, N·m, clockwise positive: power T_i·ω_i flows in and T_o·ω_o out.
    speed_rpm : array of float, shape (n,)
        Input speed, 1/min, clockwise positive.
    ratio : float
        Input turns for one output turn; negative where the output turns against the input.
    temperature_c : array of float, shape (n,), optional
    nominal_torque_nm, nominal_speed_rpm : array of float, shape (n,), optional
        Set points by which repeats are put together and results are named; by default points
        within 1 % of the largest torque and of the largest speed, and 5 % of their own, are one.
    input_uncertainty, output_uncertainty : TorqueUncertainty or sequence of them, optional
        One uncertainty for all points, or one for each.
    largest_share : float, optional
        Refuse the result where U exceeds this share of the efficiency at any point.
    steady : bool
        Whether each row is a steady point; otherwise the windows of a log are looked for.
    row : array of int, shape (n,), optional
        Number of each sample in its file, for messages.
    keep_outliers : bool
        Evaluate outliers with the others.

    Raises
    ------
    InputError
        Where the columns can't be used, all points lose more than they get, or gain power
        (swapped columns, a wrong sign or ratio), or the uncertainty exceeds `largest_share`.

    Examples
    --------
    >>> found = evaluate_efficiency([5.0, 2.7], [320.0, 160.0], [600.0, 600.0], 80.0)
    >>> [round(point.efficiency.value, 1) for point in found.points]
    [74.1, 80.0]
    """
    if not (np.isfinite(ratio) and abs(ratio) > 0.0):
        raise InputError(Message("ratio {ratio}", ratio), "input turns for one output turn, not 0")
    samples = Samples.of(
        1,
        row=row,
        keep=keep_outliers,
        input_nm=input_torque_nm,
        output_nm=output_torque_nm,
        speed_rpm=speed_rpm,
        demanded_nm=nominal_torque_nm,
        demanded_rpm=nominal_speed_rpm,
        temperature_c=temperature_c,
        index=np.arange(np.size(np.asarray(speed_rpm)), dtype=np.float64),
    )
    resolution = (decimal_step(samples["input_nm"]), decimal_step(samples["output_nm"]))
    size = samples.row.size
    if not steady:
        samples = windows_of(samples, ("speed_rpm", "output_nm"), ("input_nm", "output_nm"))
    logged = samples.row.size != size
    speed = samples["speed_rpm"]
    resting = np.abs(speed) <= (AT_REST * float(np.max(np.abs(speed))) if logged else 0.0)
    if resting.all():
        raise InputError(
            "a speed of 0 in all rows", "points at which the input turns", "check the column"
        )
    samples = samples.where(~resting)
    drive, load, speed = (samples[name] for name in ("input_nm", "output_nm", "speed_rpm"))
    power_in, power_out = drive * np.sign(speed), load * np.sign(speed) / ratio
    driving = np.where((power_in > 0) & (power_out > 0), 1, 0)
    driving = np.where((power_in < 0) & (power_out < 0), -1, driving)
    findings = _sign_findings(driving, samples.row)
    share = np.where(driving == 1, power_out / np.where(power_in == 0, 1, power_in), np.nan)
    share = np.where(driving == -1, power_in / np.where(power_out == 0, 1, power_out), share)
    _check_gain(share, drive, load)
    rows = _Steady.of(samples, share, driving, float(ratio), resolution).without_outliers()
    uncertainties = [
        _chosen(uncertainty_of_side, rows.samples["index"])
        for uncertainty_of_side in (input_uncertainty, output_uncertainty)
    ]
    points = rows.points((uncertainties[0], uncertainties[1]))
    warmth = rows.samples.get("temperature_c", float("nan"))
    stated = any(
        uncertainty_of_side is not None
        for uncertainty_of_side in (input_uncertainty, output_uncertainty)
    )
    findings += _findings(points, warmth, rows.repeated, logged, stated)
    for point in points:
        if largest_share is not None:
            refuse(point.efficiency, largest_share, point.quantity.title)
    every = (*rows.samples.findings, *findings)
    return EfficiencyMap(float(ratio), points, every, _both_directions(points))


def _chosen(uncertainty: KnownTorque | None, index: Floats) -> KnownTorque:
    """Return the uncertainties of selected points."""
    if uncertainty is None or isinstance(uncertainty, TorqueUncertainty):
        return uncertainty or TorqueUncertainty()
    return [uncertainty[int(row)] for row in index]


@dataclass(frozen=True, eq=False)
class _Steady:
    """Steady points with their efficiency as a share, driving side, and groups of repeats.

    `driving` is 1 where the input drives, -1 where the output does, 0 where neither; `torque_step`
    and `speed_step` number the set points; `nominal_nm` and `nominal_rpm` name them.
    """

    samples: Samples
    share: Floats
    driving: NDArray[np.int64]
    ratio: float
    resolution: tuple[float, float]
    torque_step: NDArray[np.int64]
    speed_step: NDArray[np.int64]
    nominal_nm: Floats
    nominal_rpm: Floats

    @classmethod
    def of(
        cls,
        samples: Samples,
        share: Floats,
        driving: NDArray[np.int64],
        ratio: float,
        resolution: tuple[float, float],
    ) -> _Steady:
        """Group points by their set points, demanded or measured."""
        load, speed = np.abs(samples["output_nm"]), samples["speed_rpm"]
        torques, torque_step = _steps(load, samples.columns.get("demanded_nm"), sized=True)
        speeds, speed_step = _steps(speed, samples.columns.get("demanded_rpm"), sized=False)
        if is_ramp(speed, speed_step) or is_ramp(load, torque_step):
            raise InputError(
                "a ramp of torque or speed: no two samples belong to one point",
                "steady points, or a log with windows in which torque and speed stand",
                "hold each torque and speed for some seconds",
            )
        return cls(
            samples, share, driving, ratio, resolution, torque_step, speed_step, torques, speeds
        )

    @property
    def group(self) -> NDArray[np.int64]:
        """Number of the point that each row belongs to."""
        keys = np.column_stack([self.torque_step, self.speed_step, self.driving])
        return np.unique(keys, axis=0, return_inverse=True)[1].ravel().astype(np.int64)

    @property
    def repeated(self) -> bool:
        """Whether any point was measured more than once."""
        used = np.isfinite(self.share)
        return bool(np.bincount(self.group[used]).max(initial=0) > 1)

    def where(self, rows: Mask) -> _Steady:
        """Return some of the points."""
        columns = ("share", "driving", "torque_step", "speed_step", "nominal_nm", "nominal_rpm")
        return replace(
            self,
            samples=self.samples.where(rows),
            **{name: getattr(self, name)[rows] for name in columns},
        )

    def without_outliers(self) -> _Steady:
        """Leave out points far from their repeats, or whose loss is far from a plane of losses."""
        used = np.isfinite(self.share)
        bad = np.zeros(used.size, dtype=np.bool_)
        loss = np.abs(self.samples["input_nm"]) - np.abs(self.samples["output_nm"] / self.ratio)
        # Scatter may be in proportion to the torque or not: an outlier has to stand out in both the
        # share and the loss.
        for measure in (self.share, loss):
            bad[used] = repeat_outliers(measure[used], self.group[used]) & (
                bad[used] | (measure is self.share)
            )
        for side in (1, -1):
            chosen = used & (self.driving == side)
            bad[chosen] |= self._off_plane(chosen)
        samples = self.samples.less({"efficiency": bad})
        if samples.row.size == bad.size:
            return replace(self, samples=samples)
        return replace(self.where(~bad), samples=samples)

    def _off_plane(self, rows: Mask) -> Mask:
        """Find losses far from a plane over torque and speed that is fitted robustly."""
        ideal = np.abs(self.samples["output_nm"][rows] / self.ratio)
        speed = np.abs(self.samples["speed_rpm"][rows])
        loss = np.abs(self.samples["input_nm"][rows]) - ideal
        if loss.size < LEAST_PLANE:
            return np.zeros(loss.size, dtype=np.bool_)
        basis = np.column_stack([np.ones(loss.size), ideal, speed])
        basis = basis[:, np.append(True, np.ptp(basis[:, 1:], axis=0) > 0.0)]
        basis /= np.abs(basis).max(axis=0)
        weight = np.ones(loss.size)
        for _ in range(30):  # least absolute deviations
            plane, *_ = np.linalg.lstsq(basis * weight[:, None], loss * weight, rcond=None)
            deviation = np.abs(loss - basis @ plane)
            weight = 1.0 / np.sqrt(
                np.maximum(deviation, 1e-6 * max(float(deviation.max()), 1e-300))
            )
        input_nm = self.samples["input_nm"][rows]
        least = np.maximum(SAME_VALUE * np.abs(input_nm), 3.0 * decimal_step(input_nm))
        return np.asarray(deviation > np.maximum(OUTLYING * float(np.median(deviation)), least))

    def points(self, uncertainties: tuple[KnownTorque, KnownTorque]) -> tuple[EfficiencyPoint, ...]:
        """Return the mean of the repeats at every torque and speed, by driving side.

        The scatter of repeats is pooled over the speeds and directions of one torque: in shares of
        the efficiency it grows as the torque falls.
        """
        used, group = np.isfinite(self.share), self.group
        members = {
            int(number): np.flatnonzero(used & (group == number))
            for number in np.unique(group[used])
        }
        pooled = self._scatter(list(members.values()))
        texts = dict(
            zip(
                members,
                _names([(self.nominal_nm[r[0]], self.nominal_rpm[r[0]]) for r in members.values()]),
                strict=True,
            )
        )
        points = []
        for number, rows in members.items():
            step = int(self.torque_step[rows[0]])
            alike = [member for member in members.values() if self.torque_step[member[0]] == step]
            scatter = self._scatter(alike) or pooled
            points.append(self._point(rows, uncertainties, scatter, texts[number]))
        return tuple(
            sorted(
                points,
                key=lambda each: (each.driving, each.nominal_speed_rpm, each.nominal_torque_nm),
            )
        )

    def _scatter(self, members: Sequence[NDArray[np.intp]]) -> tuple[float, int] | None:
        """Return the pooled relative standard deviation of repeats, with its degrees of freedom."""
        freedom = sum(rows.size - 1 for rows in members)
        if not freedom:
            return None
        squares = sum(
            float(np.sum((self.share[rows] / self.share[rows].mean() - 1.0) ** 2))
            for rows in members
        )
        return float(np.sqrt(squares / freedom)), freedom

    def _point(
        self,
        rows: NDArray[np.intp],
        uncertainties: tuple[KnownTorque, KnownTorque],
        scatter: tuple[float, int] | None,
        name: str,
    ) -> EfficiencyPoint:
        """Return the mean efficiency of some rows with its budget."""
        samples = self.samples.where(rows)
        here = np.zeros(self.share.size, dtype=np.bool_)
        here[rows] = True
        value = 100.0 * float(self.share[rows].mean())
        drive, load = (float(samples[column].mean()) for column in ("input_nm", "output_nm"))
        speed = float(samples["speed_rpm"].mean())
        turn = 1.0 if self.driving[rows[0]] == 1 else -1.0
        parts: list[BudgetLine] = []
        for side, torque, of, pull, rpm, step in (
            ("input", drive, over(uncertainties[0], here), -turn, speed, self.resolution[0]),
            (
                "output",
                load,
                over(uncertainties[1], here),
                turn,
                speed / self.ratio,
                self.resolution[1],
            ),
        ):
            size = value / abs(torque)
            signed = pull * float(np.sign(torque))
            by_speed = size * of.speed_nm_per_rpm * abs(rpm)
            parts += [
                BudgetLine(
                    f"{side} torque scale", value * of.relative, inf, pull, Shared.CALIBRATION
                ),
                BudgetLine(f"{side} torque zero", size * of.zero_nm, inf, signed, Shared.ZEROING),
                BudgetLine(
                    f"{side} torque model", size * of.model_nm, inf, pull, Shared.CALIBRATION
                ),
                BudgetLine(f"{side} zero by speed", by_speed, inf, signed, Shared.CALIBRATION),
                BudgetLine(
                    f"{side} mounting and drag", size * of.mounting_nm, inf, pull, Shared.MOUNTING
                ),
                BudgetLine(
                    f"{side} loading effects", size * of.loading_nm, inf, pull, Shared.LOADING
                ),
            ]
            own = samples.columns.get(f"own_{side}_nm")
            if own is not None:
                noise = size * float(np.linalg.norm(own)) / rows.size
                parts.append(BudgetLine(f"{side} noise", noise, (BLOCKS - 1.0) * rows.size))
            if scatter is not None or own is not None:
                parts.append(BudgetLine(f"{side} resolution", size * step / 12.0**0.5))
            if scatter is None:
                parts.append(BudgetLine(f"{side} chain repeatability", size * of.repeatability_nm))
        if scatter is not None:
            error = value * scatter[0] / rows.size**0.5
            parts.append(BudgetLine("repeatability", error, scatter[1]))
        omega = RAD_S_PER_RPM * float(np.abs(samples["speed_rpm"]).mean())
        driven: Side = "input" if turn > 0 else "output"
        return EfficiencyPoint(
            key=f"efficiency_{driven}_{name}",
            driving=driven,
            speed_rpm=speed,
            torque_nm=abs(load),
            efficiency=budget(value, "%", parts),
            loss_w=abs(abs(drive) - abs(load / self.ratio)) * omega,
            points=int(rows.size),
            temperature_c=float(samples.get("temperature_c", float("nan")).mean()),
            nominal_torque_nm=float(self.nominal_nm[rows[0]]),
            nominal_speed_rpm=float(self.nominal_rpm[rows[0]]),
        )


LEAST_PLANE = 12
"""Fewest points whose losses are compared with a plane."""


def _steps(
    values: Floats, demanded: Floats | None, *, sized: bool
) -> tuple[Floats, NDArray[np.int64]]:
    """Return each row's set point and its number: the demanded value, or a mean of close values."""
    if demanded is not None:
        names = np.abs(demanded) if sized else demanded
        return names, np.unique(names, return_inverse=True)[1].ravel().astype(np.int64)
    near = np.minimum(SAME_POINT * float(np.max(np.abs(values))), SAME_VALUE * np.abs(values))
    step = grouped(values, near)
    means = np.bincount(step, weights=values) / np.bincount(step)
    return means[step], step


def _names(points: Sequence[tuple[float, float]]) -> list[str]:
    """Name points by torque and speed, with just enough decimals to tell them apart."""
    torques = [text.removeprefix("+") for text in distinct_texts([torque for torque, _ in points])]
    speeds = distinct_texts([speed for _, speed in points])
    return [f"{torque}_nm_{speed}_rpm" for torque, speed in zip(torques, speeds, strict=True)]


def _both_directions(points: tuple[EfficiencyPoint, ...]) -> tuple[EfficiencyPoint, ...]:
    """Return the mean of both directions at each torque and speed that was driven in both."""
    means = []
    fastest = max((abs(point.nominal_speed_rpm) for point in points), default=0.0)
    largest = max((point.nominal_torque_nm for point in points), default=0.0)
    taken: set[str] = set()
    for forward in (point for point in points if point.nominal_speed_rpm > 0.0):
        for other in points:
            same = (
                other.driving == forward.driving
                and other.key not in taken
                and abs(other.nominal_speed_rpm + forward.nominal_speed_rpm) <= SAME_POINT * fastest
                and abs(other.nominal_torque_nm - forward.nominal_torque_nm) <= SAME_POINT * largest
            )
            if same:
                taken.add(other.key)
                means.append(_mean(forward, other))
                break
    return tuple(means)


def _mean(forward: EfficiencyPoint, other: EfficiencyPoint) -> EfficiencyPoint:
    """Return the mean of both directions of rotation: common errors stay, others average out."""
    parts = common_of_both(forward.efficiency, other.efficiency)
    alone = [
        line for point in (forward, other) for line in point.efficiency.lines if not line.common
    ]
    for name in dict.fromkeys(line.name for line in alone):
        both = [line for line in alone if line.name == name]
        size = float(np.linalg.norm([line.contribution for line in both]))
        # scatter and degrees of freedom are pooled over both directions
        freedom = min(line.degrees_of_freedom for line in both)
        parts.append(BudgetLine(name, 0.5 * size, freedom))
    return EfficiencyPoint(
        key=forward.key.replace("_nm_+", "_nm_"),
        driving=forward.driving,
        speed_rpm=0.5 * (forward.speed_rpm - other.speed_rpm),
        torque_nm=0.5 * (forward.torque_nm + other.torque_nm),
        efficiency=budget(0.5 * (forward.efficiency.value + other.efficiency.value), "%", parts),
        loss_w=0.5 * (forward.loss_w + other.loss_w),
        points=forward.points + other.points,
        temperature_c=0.5 * (forward.temperature_c + other.temperature_c),
        nominal_torque_nm=forward.nominal_torque_nm,
        nominal_speed_rpm=forward.nominal_speed_rpm,
        both=True,
    )


# -- defects ----------------------------------------------------------------------------------


def _sign_findings(driving: NDArray[np.int64], row: NDArray[np.int64]) -> list[Finding]:
    """Report points through which no power flows; refuse a test that has only such points."""
    lost = int(np.count_nonzero(driving == 0))
    if lost == driving.size:
        raise InputError(
            Message("input torque and output torque of unlike sign at all {lost} points", lost),
            "the torque on the input and the torque that the output puts on its load, "
            "clockwise positive",
            "reverse the sign of the output torque, or make the ratio negative if the output turns "
            "against the input",
        )
    if not lost:
        return []
    return [
        Finding(
            "no power flows through",
            Message(
                "{lost} points where both sides receive power and the efficiency is 0 "
                "(the first: row {first})",
                lost,
                row[int(np.argmax(driving == 0))],
            ),
            "they are left out: the load is smaller than the friction there",
        )
    ]


def _check_gain(share: Floats, drive: Floats, load: Floats) -> None:
    """Refuse efficiencies that swapped columns or a wrong ratio explain."""
    finite = share[np.isfinite(share)]
    swapped = bool(np.median(np.abs(drive)) > np.median(np.abs(load)))
    if np.all(finite > 1.0) or (swapped and np.all(finite < 0.05)):
        raise InputError(
            Message(
                "efficiencies of {lowest:.4g} % to {highest:.4g} %",
                100 * finite.min(),
                100 * finite.max(),
            ),
            "more than 5 % and at most 100 %",
            "input and output torque are swapped: name the columns the other way round"
            if swapped
            else "check the ratio, the zeros and which column is which",
        )


def _findings(
    points: tuple[EfficiencyPoint, ...],
    warmth: Floats,
    repeated: bool,
    logged: bool,
    stated: bool,
) -> list[Finding]:
    """Report efficiencies above 100 %, lack of repeats and other doubts about the points."""
    findings = []
    above = [point for point in points if point.efficiency.value > 100.0]
    if above:
        worst = max(above, key=lambda each: each.efficiency.value)
        surely = worst.efficiency.value - worst.efficiency.expanded_uncertainty() > 100.0
        findings.append(
            Finding(
                "efficiency above 100 %",
                Message(
                    "{efficiency:.2f} % at {torque:.4g} N·m, {speed:.0f} rpm",
                    worst.efficiency.value,
                    worst.torque_nm,
                    worst.speed_rpm,
                ),
                "zero both transducers again, and check ratio and calibration",
                severe=surely,
            )
        )
    if not repeated:
        if logged:
            in_u = "every point was driven once: U contains the noise of each window only"
        elif stated:
            in_u = "every point was measured once: U contains what was stated only"
        else:
            in_u = "every point was measured once: U is unknown"
        findings.append(Finding("no repeats", in_u, "measure each point twice or more"))
    remedy = "warm up until the temperature is steady, and measure again"
    return [*findings, *unsteady_temperature(warmth, remedy, severe=True)]
