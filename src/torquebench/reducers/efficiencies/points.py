"""Points of an efficiency map: means of repeats with their budgets, and of both directions."""

from dataclasses import dataclass
from math import inf
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from torquebench.message import Message
from torquebench.reducers.quantities import Contribution, ResultQuantity, budget, common_of_both
from torquebench.reducers.torque_uncertainty import KnownTorque, over
from torquebench.uncertainty import Budget, Shared
from torquebench.units import RAD_S_PER_RPM

__all__ = ["EfficiencyPoint", "Side", "SteadyPoints", "both_directions", "points_of"]

FloatArray = NDArray[np.float64]
Side = Literal["input", "output"]
SAME_POINT = 0.01
"""Share of the largest torque and speed within which points are treated as repeats."""


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
        Number of steady points in the mean.
    temperature_c : float
        Mean; NaN where it wasn't measured.
    nominal_torque_nm, nominal_speed_rpm : float
        Set point that the point is named by: torque as a magnitude, speed with its sign; the
        means where none was given.
    both : bool
        Whether it is the mean of both directions.
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
    both: bool = False

    @property
    def quantity(self) -> ResultQuantity:
        """The value under its name, for tables and reports."""
        sign = "" if self.both else "+"
        return ResultQuantity(
            f"efficiency_{self.driving}_{self.nominal_torque_nm:.0f}_nm_"
            f"{self.nominal_speed_rpm:{sign}.0f}_rpm",
            Message(
                "efficiency at {nominal_torque_nm:.4g} N·m, {nominal_speed_rpm:.0f} "
                "rpm{both}{value}",
                self.nominal_torque_nm,
                self.nominal_speed_rpm,
                ", mean of both directions" if self.both else "",
                ", output drives" if self.driving == "output" else "",
            ),
            self.efficiency,
        )

    def input_torque_nm(self, ratio: float) -> float:
        """Return the magnitude of the input torque, N·m."""
        share = self.efficiency.value / 100.0
        ideal = self.torque_nm / abs(ratio)
        return ideal / share if self.driving == "input" else ideal * share


@dataclass(frozen=True, eq=False)
class SteadyPoints:
    """Steady points as columns.

    Parameters
    ----------
    drive_nm, load_nm, speed_rpm, temperature_c : array of float, shape (n,)
        Input torque, output torque on its load, input speed, and temperature (NaN without).
    share : array of float, shape (n,)
        Efficiency of each point; NaN where no power flows through.
    driving : array of int, shape (n,)
        1 where the input drives, -1 where the output does, 0 where neither.
    set_torque_nm, set_speed_rpm : array of float, shape (n,)
        Set points: torque as a magnitude, speed with its sign.
    ratio : float
    """

    drive_nm: FloatArray
    load_nm: FloatArray
    speed_rpm: FloatArray
    temperature_c: FloatArray
    share: FloatArray
    driving: NDArray[np.int64]
    set_torque_nm: FloatArray
    set_speed_rpm: FloatArray
    ratio: float


def points_of(
    steady: SteadyPoints, known: tuple[KnownTorque, KnownTorque]
) -> tuple[EfficiencyPoint, ...]:
    """Return the mean of the repeats at every torque and speed, by driving side.

    The scatter of repeats is pooled over the speeds and directions of one torque: in shares of
    the efficiency it grows as the torque falls.

    Parameters
    ----------
    steady : SteadyPoints
    known : pair of TorqueUncertainty or of sequences of them
        Of the input and of the output, the same at all points or of each.
    """
    used = np.isfinite(steady.share)
    torque_step = _clustered(steady.set_torque_nm)
    keys = [torque_step, _clustered(steady.set_speed_rpm), steady.driving]
    group = np.unique(np.column_stack(keys), axis=0, return_inverse=True)[1].ravel()
    points = []
    for step in np.unique(torque_step[used]):
        members = [
            used & (group == number) for number in np.unique(group[used & (torque_step == step)])
        ]
        squares = sum(
            float(np.sum((steady.share[here] / steady.share[here].mean() - 1.0) ** 2))
            for here in members
        )
        freedom = sum(int(np.count_nonzero(here)) - 1 for here in members)
        scatter = float(np.sqrt(squares / freedom)) if freedom else None
        points += [_point(steady, here, known, scatter, freedom) for here in members]
    return tuple(
        sorted(
            points, key=lambda each: (each.driving, each.nominal_speed_rpm, each.nominal_torque_nm)
        )
    )


def _point(
    steady: SteadyPoints,
    here: NDArray[np.bool_],
    known: tuple[KnownTorque, KnownTorque],
    scatter: float | None,
    freedom: int,
) -> EfficiencyPoint:
    value = 100.0 * float(steady.share[here].mean())
    drive, load = float(steady.drive_nm[here].mean()), float(steady.load_nm[here].mean())
    speed, count = float(steady.speed_rpm[here].mean()), int(np.count_nonzero(here))
    turn = 1.0 if steady.driving[here][0] == 1 else -1.0
    parts: list[Contribution] = []
    for name, torque, of, pull, rpm in (
        ("input", drive, over(known[0], here), -turn, speed),
        ("output", load, over(known[1], here), turn, speed / steady.ratio),
    ):
        size = value / abs(torque)
        signed = pull * float(np.sign(torque))
        parts += [
            Contribution(
                f"{name} torque scale", value * of.relative, inf, pull, Shared.CALIBRATION
            ),
            Contribution(f"{name} torque zero", size * of.zero_nm, inf, signed, Shared.ZEROING),
            Contribution(f"{name} torque model", size * of.model_nm, inf, pull, Shared.CALIBRATION),
            Contribution(
                f"{name} zero by speed",
                size * of.speed_nm_per_rpm * abs(rpm),
                inf,
                signed,
                Shared.CALIBRATION,
            ),
            Contribution(
                f"{name} mounting and drag", size * of.mounting_nm, inf, pull, Shared.MOUNTING
            ),
            Contribution(
                f"{name} loading effects", size * of.loading_nm, inf, pull, Shared.LOADING
            ),
        ]
        if scatter is None:
            parts.append(Contribution(f"{name} chain repeatability", size * of.repeatability_nm))
    if scatter is not None:
        parts.append(Contribution("repeatability", value * scatter / count**0.5, freedom))
    omega = RAD_S_PER_RPM * float(np.abs(steady.speed_rpm[here]).mean())
    lost = abs(abs(drive) - abs(load / steady.ratio)) * omega
    return EfficiencyPoint(
        driving="input" if turn > 0 else "output",
        speed_rpm=speed,
        torque_nm=abs(load),
        efficiency=budget(value, "%", parts),
        loss_w=lost,
        points=count,
        temperature_c=float(steady.temperature_c[here].mean()),
        nominal_torque_nm=float(steady.set_torque_nm[here].mean()),
        nominal_speed_rpm=float(steady.set_speed_rpm[here].mean()),
    )


def _clustered(values: FloatArray) -> NDArray[np.int64]:
    order = np.argsort(values, kind="stable")
    gap = np.diff(values[order], prepend=values[order[0]])
    number = np.empty(values.size, dtype=np.int64)
    number[order] = np.cumsum(gap > SAME_POINT * np.abs(values).max())
    return number


def both_directions(points: tuple[EfficiencyPoint, ...]) -> tuple[EfficiencyPoint, ...]:
    """Return the mean of both directions at each torque and speed that both were driven at."""
    means = []
    fastest = max((abs(each.nominal_speed_rpm) for each in points), default=0.0)
    largest = max((each.nominal_torque_nm for each in points), default=0.0)
    for forward in (each for each in points if each.nominal_speed_rpm > 0.0):
        for other in points:
            same = (
                other.driving == forward.driving
                and abs(other.nominal_speed_rpm + forward.nominal_speed_rpm) <= SAME_POINT * fastest
                and abs(other.nominal_torque_nm - forward.nominal_torque_nm) <= SAME_POINT * largest
            )
            if same:
                means.append(_mean(forward, other))
                break
    return tuple(means)


def _mean(forward: EfficiencyPoint, other: EfficiencyPoint) -> EfficiencyPoint:
    parts = common_of_both(forward.efficiency, other.efficiency)
    alone = [line for each in (forward, other) for line in each.efficiency.lines if not line.common]
    for name in dict.fromkeys(line.name for line in alone):
        both = [line for line in alone if line.name == name]
        size = float(np.linalg.norm([line.contribution for line in both]))
        # scatter and degrees of freedom are pooled over both directions
        freedom = min(line.degrees_of_freedom for line in both)
        parts.append(Contribution(name, 0.5 * size, freedom))
    return EfficiencyPoint(
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
