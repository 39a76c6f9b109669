"""Efficiency over torque and speed: η = T_o/(R·T_i) when the input drives, with iso-lines."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.reducers.columns import finite_columns
from torquebench.reducers.efficiency_grid import interpolated, weights_at
from torquebench.reducers.no_load import TorqueUncertainty
from torquebench.reducers.quantities import (
    Contribution,
    Finding,
    ResultQuantity,
    budget,
    refuse,
)
from torquebench.uncertainty import Budget

__all__ = ["EfficiencyMap", "EfficiencyPoint", "evaluate_efficiency"]

Side = Literal["input", "output"]
RAD_S_PER_RPM = 2.0 * np.pi / 60.0
SAME_POINT = 0.01
"""Share of the largest torque and speed within which points count as repeats."""


@dataclass(frozen=True)
class EfficiencyPoint:
    """Efficiency at one torque and one speed.

    Parameters
    ----------
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
        How many steady points the mean is of.
    temperature_c : float
        Mean; NaN where it wasn't measured.
    nominal_torque_nm, nominal_speed_rpm : float
        Set point that the point is named by: torque as a magnitude, speed with its sign; the
        means where none was given.
    """

    driving: Side
    speed_rpm: float
    torque_nm: float
    efficiency: Budget
    loss_w: float
    points: int
    temperature_c: float
    nominal_torque_nm: float
    nominal_speed_rpm: float

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
        By driving side, speed and torque.
    findings : tuple of Finding
    """

    ratio: float
    points: tuple[EfficiencyPoint, ...]
    findings: tuple[Finding, ...]

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
            raise InputError(f"no point with the {driving} driving", "points in this direction")
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
                f"{torque_nm:g} N·m at {speed_rpm:g} rpm",
                "a torque and speed within the measured points",
                "measure there, or ask within the map",
            )
        drive = np.array([each.input_torque_nm(self.ratio) for each in mine])
        ideal = torque_nm / abs(self.ratio)
        found = float(weight @ drive)
        share = ideal / found if driving == "input" else found / ideal
        # Relative contributions of the input torques carry over to the share.
        pull = weight * drive / found
        parts: list[Contribution] = []
        for name in sorted({line.name for each in mine for line in each.efficiency.lines}):
            relative = np.zeros(len(mine))
            freedom = np.inf
            for index, each in enumerate(mine):
                for line in (line for line in each.efficiency.lines if line.name == name):
                    relative[index] = line.sensitivity * line.contribution / each.efficiency.value
                    freedom = min(freedom, line.degrees_of_freedom)
            shared = name != "repeatability"
            size = abs(float(pull @ relative)) if shared else float(np.linalg.norm(pull * relative))
            parts.append(Contribution(name, 100.0 * share * size, freedom))
        return budget(100.0 * share, "%", parts)

    def quantities(self) -> tuple[ResultQuantity, ...]:
        """Return the values under their names, for tables and reports."""
        return tuple(
            ResultQuantity(
                f"efficiency_{each.driving}_{each.nominal_torque_nm:.0f}_nm_"
                f"{each.nominal_speed_rpm:+.0f}_rpm",
                f"efficiency at {each.nominal_torque_nm:.4g} N·m, {each.nominal_speed_rpm:.0f} rpm"
                + (", output drives" if each.driving == "output" else ""),
                each.efficiency,
            )
            for each in self.points
        )


def evaluate_efficiency(
    input_torque_nm: ArrayLike,
    output_torque_nm: ArrayLike,
    speed_rpm: ArrayLike,
    ratio: float,
    *,
    temperature_c: ArrayLike | None = None,
    nominal_torque_nm: ArrayLike | None = None,
    nominal_speed_rpm: ArrayLike | None = None,
    input_uncertainty: TorqueUncertainty | None = None,
    output_uncertainty: TorqueUncertainty | None = None,
    largest_temperature_range_k: float = 2.0,
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
    input_uncertainty, output_uncertainty : TorqueUncertainty, optional
    largest_temperature_range_k : float
        Above this the temperature counts as unsteady, which is a finding.
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
        raise InputError(f"ratio {ratio}", "input turns for one output turn, not 0")
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
    targets = _groups(set_torque, set_speed, driving)
    known = (input_uncertainty or TorqueUncertainty(), output_uncertainty or TorqueUncertainty())
    named = (np.abs(set_torque), set_speed)
    points = _points(targets, share, drive, load, speed, warmth, ratio, driving, known, named)
    findings += _findings(points, warmth, largest_temperature_range_k, speed.size)
    for each in points:
        if largest_share is not None:
            refuse(
                each.efficiency,
                largest_share,
                f"efficiency at {each.torque_nm:.4g} N·m, {each.speed_rpm:.0f} rpm",
            )
    return EfficiencyMap(float(ratio), points, tuple(findings))


def _sign_findings(driving: NDArray[np.int64]) -> list[Finding]:
    lost = int(np.count_nonzero(driving == 0))
    if lost == driving.size:
        raise InputError(
            f"input torque and output torque of unlike sign at all {lost} points",
            "the torque on the input and the torque that the output puts on its load, "
            "clockwise positive",
            "turn the sign of the output torque, or make the ratio negative if the output turns "
            "against the input",
        )
    if not lost:
        return []
    worst = int(np.argmax(driving == 0))
    return [
        Finding(
            "no power flows through",
            f"{lost} points where both sides put power in and the efficiency is 0 (the first: "
            f"point {worst + 1})",
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
            f"efficiencies of {100 * found.min():.4g} % to {100 * found.max():.4g} %",
            "more than 5 % and at most 100 %",
            "input and output torque are swapped: name the columns the other way round"
            if swapped
            else "check the ratio, the zeros and which column is which",
        )


def _groups(
    torque: NDArray[np.float64], speed: NDArray[np.float64], driving: NDArray[np.int64]
) -> NDArray[np.intp]:
    """Return a number for each point by torque, speed and driving side."""
    keys = [_clustered(torque), _clustered(speed), driving]
    found = np.unique(np.column_stack(keys), axis=0, return_inverse=True)[1]
    return np.asarray(found, dtype=np.intp).ravel()


def _clustered(values: NDArray[np.float64]) -> NDArray[np.int64]:
    order = np.argsort(values, kind="stable")
    gap = np.diff(values[order], prepend=values[order[0]])
    number = np.empty(values.size, dtype=np.int64)
    number[order] = np.cumsum(gap > SAME_POINT * np.abs(values).max())
    return number


def _points(
    group: NDArray[np.intp],
    share: NDArray[np.float64],
    drive: NDArray[np.float64],
    load: NDArray[np.float64],
    speed: NDArray[np.float64],
    warmth: NDArray[np.float64],
    ratio: float,
    driving: NDArray[np.int64],
    known: tuple[TorqueUncertainty, TorqueUncertainty],
    named: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> tuple[EfficiencyPoint, ...]:
    used = np.isfinite(share)
    squares, freedom = 0.0, 0
    for number in np.unique(group[used]):
        here = used & (group == number)
        squares += float(np.sum((share[here] / share[here].mean() - 1.0) ** 2))
        freedom += int(np.count_nonzero(here)) - 1
    scatter = float(np.sqrt(squares / freedom)) if freedom else 0.0
    points = []
    for number in np.unique(group[used]):
        here = used & (group == number)
        value = 100.0 * float(share[here].mean())
        torque_in = float(np.abs(drive[here]).mean())
        torque_out = float(np.abs(load[here]).mean())
        turn = 1.0 if driving[here][0] == 1 else -1.0
        count = int(np.count_nonzero(here))
        sign_in, sign_out = np.sign(drive[here][0]), np.sign(load[here][0])
        parts = [
            Contribution("input torque scale", value * known[0].relative, sensitivity=-turn),
            Contribution("output torque scale", value * known[1].relative, sensitivity=turn),
            Contribution(
                "input torque zero",
                value * known[0].zero_nm / torque_in,
                sensitivity=-turn * sign_in,
            ),
            Contribution(
                "output torque zero",
                value * known[1].zero_nm / torque_out,
                sensitivity=turn * sign_out,
            ),
        ]
        if freedom:
            parts.append(Contribution("repeatability", value * scatter / count**0.5, freedom))
        omega = RAD_S_PER_RPM * float(np.abs(speed[here]).mean())
        points.append(
            EfficiencyPoint(
                driving="input" if turn > 0 else "output",
                speed_rpm=float(speed[here].mean()),
                torque_nm=torque_out,
                efficiency=budget(value, "%", parts),
                loss_w=abs(torque_in - torque_out / abs(ratio)) * omega,
                points=count,
                temperature_c=float(warmth[here].mean()),
                nominal_torque_nm=float(named[0][here].mean()),
                nominal_speed_rpm=float(named[1][here].mean()),
            )
        )
    return tuple(
        sorted(
            points, key=lambda each: (each.driving, each.nominal_speed_rpm, each.nominal_torque_nm)
        )
    )


def _findings(
    points: tuple[EfficiencyPoint, ...], warmth: NDArray[np.float64], limit_k: float, size: int
) -> list[Finding]:
    findings = []
    over = [each for each in points if each.efficiency.value > 100.0]
    if over:
        worst = max(over, key=lambda each: each.efficiency.value)
        surely = worst.efficiency.value - worst.efficiency.expanded_uncertainty() > 100.0
        findings.append(
            Finding(
                "efficiency above 100 %",
                f"{worst.efficiency.value:.2f} % at {worst.torque_nm:.4g} N·m, "
                f"{worst.speed_rpm:.0f} rpm",
                "zero both transducers again, and check ratio and calibration",
                severe=surely,
            )
        )
    if len(points) == size:
        findings.append(
            Finding(
                "no repeats",
                "every point was measured once: repeatability isn't in the uncertainty",
                "measure each point twice or more",
            )
        )
    if not np.all(np.isnan(warmth)) and np.ptp(warmth) > limit_k:
        findings.append(
            Finding(
                "unsteady temperature",
                f"{warmth.min():.1f} to {warmth.max():.1f} °C over the map "
                f"(allowed: a range of {limit_k:g} K)",
                "warm up until the temperature is steady, and measure again",
                severe=True,
            )
        )
    return findings
