"""Efficiency over torque and speed: η = T_o/(R·T_i) when the input drives, with iso-lines."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.preparation import finite_columns
from torquebench.reducers.efficiencies.grid import interpolated, weights_at
from torquebench.reducers.efficiencies.points import (
    EfficiencyPoint,
    Side,
    SteadyPoints,
    both_directions,
    points_of,
)
from torquebench.reducers.quantities import (
    Contribution,
    Finding,
    LimitedQuantity,
    ResultQuantity,
    budget,
    refuse,
    unsteady_temperature,
)
from torquebench.reducers.torque_uncertainty import KnownTorque, TorqueUncertainty
from torquebench.uncertainty import Budget, Shared

if TYPE_CHECKING:
    from torquebench.reducers.description import DataSheetLimits

__all__ = ["EfficiencyMap", "EfficiencyPoint", "evaluate_efficiency"]


@dataclass(frozen=True, eq=False)
class EfficiencyMap:
    """Efficiency over a grid of torque and speed.

    Parameters
    ----------
    ratio : float
        Input turns for one output turn, negative where reversed.
    points : tuple of EfficiencyPoint
        By driving side, speed and torque.
    findings : tuple of Finding
    means : tuple of EfficiencyPoint
        Mean of both directions where both were driven: errors of the zeros cancel.
    """

    ratio: float
    points: tuple[EfficiencyPoint, ...]
    findings: tuple[Finding, ...]
    means: tuple[EfficiencyPoint, ...] = ()

    def _of(self, driving: Side, direction: float) -> list[EfficiencyPoint]:
        return [
            each
            for each in self.points
            if each.driving == driving and each.speed_rpm * direction > 0.0
        ]

    def grid(
        self, driving: Side = "input", direction: int = 1, size: int = 41
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return speeds (rpm), torques (N·m) and interpolated efficiencies (%), for iso-lines.

        Between the points the input torque is interpolated linearly in torque and speed, which
        follows friction better than interpolating the efficiency itself. The efficiencies have
        the shape (torques, speeds) and are NaN outside the measured points.

        Raises
        ------
        InputError
            Where there is no point of this side and direction.
        """
        mine = self._of(driving, direction)
        if not mine:
            raise InputError(
                Message("no point with the {driving} driving", driving), "points in this direction"
            )
        speed = np.array([each.speed_rpm for each in mine])
        torque = np.array([each.torque_nm for each in mine])
        drive = np.array([each.input_torque_nm(self.ratio) for each in mine])
        speeds = np.linspace(speed.min(), speed.max(), size)
        torques = np.linspace(torque.min(), torque.max(), size)
        found = interpolated(speed, torque, drive, speeds, torques)
        ideal = torques[:, None] / abs(self.ratio)
        share = ideal / found if driving == "input" else found / ideal
        return speeds, torques, 100.0 * share

    def at(self, torque_nm: float, speed_rpm: float, driving: Side = "input") -> Budget:
        """Return the interpolated efficiency in % at an output torque and an input speed.

        Raises
        ------
        InputError
            Outside the measured points.
        """
        mine = self._of(driving, speed_rpm)
        speed = np.array([each.speed_rpm for each in mine])
        torque = np.array([each.torque_nm for each in mine])
        weight = weights_at(speed, torque, speed_rpm, torque_nm)
        if weight is None:
            raise InputError(
                Message("{torque_nm:g} N·m at {speed_rpm:g} rpm", torque_nm, speed_rpm),
                "a torque and speed within the measured points",
                "measure there, or ask within the map",
            )
        drive = np.array([each.input_torque_nm(self.ratio) for each in mine])
        ideal = torque_nm / abs(self.ratio)
        found = float(weight @ drive)
        share = ideal / found if driving == "input" else found / ideal
        # Relative contributions of the input torques are those of the share.
        pull = weight * drive / found
        parts: list[Contribution] = []
        for name in sorted({line.name for each in mine for line in each.efficiency.lines}):
            relative = np.zeros(len(mine))
            freedom, shared = np.inf, Shared.NOTHING
            for index, each in enumerate(mine):
                for line in (line for line in each.efficiency.lines if line.name == name):
                    relative[index] = line.sensitivity * line.contribution / each.efficiency.value
                    freedom, shared = min(freedom, line.degrees_of_freedom), line.shared
            size = float(pull @ relative)
            if shared is Shared.NOTHING:
                size = float(np.linalg.norm(pull * relative))
            sign = float(np.sign(size)) or 1.0
            parts.append(Contribution(name, 100.0 * share * abs(size), freedom, sign, shared))
        return budget(100.0 * share, "%", parts)

    def quantities(self) -> tuple[ResultQuantity, ...]:
        """Return the values under their names, for tables and reports."""
        return tuple(each.quantity for each in (*self.means, *self.points))

    def limited(self, limits: DataSheetLimits) -> Iterator[LimitedQuantity]:
        """Return the values that the data sheet limits; those without a limit may be left out."""
        for limit in limits.efficiency:
            for sign in (1.0, -1.0):
                try:
                    found = self.at(limit.torque_nm, sign * limit.speed_rpm)
                except InputError:
                    continue
                title = Message(
                    "efficiency at {torque:g} N·m, {speed:g} rpm",
                    limit.torque_nm,
                    sign * limit.speed_rpm,
                )
                key = f"efficiency_{limit.torque_nm:g}_nm_{sign * limit.speed_rpm:g}_rpm"
                yield LimitedQuantity(key, title, found, lower=limit.percent)


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
) -> EfficiencyMap:
    """Evaluate the efficiency from steady points.

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
        within 1 % of the largest torque and of the largest speed count as one.
    input_uncertainty, output_uncertainty : TorqueUncertainty or sequence of them, optional
        The same at all points, or of each.
    largest_share : float, optional
        Refuse the result where U exceeds this share of the efficiency at any point.

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
    drive, load, speed = finite_columns(
        1, input_torque_nm=input_torque_nm, output_torque_nm=output_torque_nm, speed_rpm=speed_rpm
    )
    if not (np.isfinite(ratio) and abs(ratio) > 0.0):
        raise InputError(Message("ratio {ratio}", ratio), "input turns for one output turn, not 0")
    if np.any(speed == 0.0):
        raise InputError("a point at 0 rpm", "points at which the input turns", "remove it")
    warmth = np.full(speed.size, np.nan)
    if temperature_c is not None:
        (warmth,) = finite_columns(speed.size, temperature_c=temperature_c)
    power_in, power_out = drive * np.sign(speed), load * np.sign(speed) / ratio
    driving = np.where((power_in > 0) & (power_out > 0), 1, 0)
    driving = np.where((power_in < 0) & (power_out < 0), -1, driving)
    findings = _sign_findings(driving)
    share = np.where(driving == 1, power_out / np.where(power_in == 0, 1, power_in), np.nan)
    share = np.where(driving == -1, power_in / np.where(power_out == 0, 1, power_out), share)
    _check_gain(share, drive, load)
    set_torque, set_speed = load, speed
    if nominal_torque_nm is not None:
        (set_torque,) = finite_columns(load.size, nominal_torque_nm=nominal_torque_nm)
    if nominal_speed_rpm is not None:
        (set_speed,) = finite_columns(load.size, nominal_speed_rpm=nominal_speed_rpm)
    known = (input_uncertainty or TorqueUncertainty(), output_uncertainty or TorqueUncertainty())
    steady = SteadyPoints(
        drive, load, speed, warmth, share, driving, np.abs(set_torque), set_speed, float(ratio)
    )
    points = points_of(steady, known)
    findings += _findings(points, warmth, speed.size)
    for each in points:
        if largest_share is not None:
            refuse(
                each.efficiency,
                largest_share,
                Message(
                    "efficiency at {torque:.4g} N·m, {speed:.0f} rpm",
                    each.torque_nm,
                    each.speed_rpm,
                ),
            )
    return EfficiencyMap(float(ratio), points, tuple(findings), both_directions(points))


def _sign_findings(driving: NDArray[np.int64]) -> list[Finding]:
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
    worst = int(np.argmax(driving == 0))
    return [
        Finding(
            "no power flows through",
            Message(
                "{lost} points where both sides receive power and the efficiency is 0 "
                "(the first: point {first})",
                lost,
                worst + 1,
            ),
            "they are left out: the load is smaller than the friction there",
        )
    ]


def _check_gain(
    share: NDArray[np.float64], drive: NDArray[np.float64], load: NDArray[np.float64]
) -> None:
    found = share[np.isfinite(share)]
    swapped = bool(np.median(np.abs(drive)) > np.median(np.abs(load)))
    if np.all(found > 1.0) or (swapped and np.all(found < 0.05)):
        raise InputError(
            Message(
                "efficiencies of {lowest:.4g} % to {highest:.4g} %",
                100 * found.min(),
                100 * found.max(),
            ),
            "more than 5 % and at most 100 %",
            "input and output torque are swapped: name the columns the other way round"
            if swapped
            else "check the ratio, the zeros and which column is which",
        )


def _findings(
    points: tuple[EfficiencyPoint, ...], warmth: NDArray[np.float64], size: int
) -> list[Finding]:
    findings = []
    over = [each for each in points if each.efficiency.value > 100.0]
    if over:
        worst = max(over, key=lambda each: each.efficiency.value)
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
    if len(points) == size:
        findings.append(
            Finding(
                "no repeats",
                "every point was measured once: the stated repeatability of the chain is used",
                "measure each point twice or more",
            )
        )
    remedy = "warm up until the temperature is steady, and measure again"
    return [*findings, *unsteady_temperature(warmth, remedy, severe=True)]
