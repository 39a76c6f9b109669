"""Results of a torque-angle loop."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from torquebench.message import Message
from torquebench.reducers.loops.rules import LoopSettings, LostMotionRule
from torquebench.reducers.quantities import Finding, LimitedQuantity, ResultQuantity
from torquebench.uncertainty import Budget

if TYPE_CHECKING:
    from torquebench.reducers.description import DataSheetLimits

__all__ = ["HysteresisResult", "KeyPoint", "LoopCurve", "LoopFeatures", "StiffnessRegions"]


@dataclass(frozen=True)
class KeyPoint:
    """A point of the loop that a figure marks.

    Parameters
    ----------
    label : str
        Such as ``"θ↑(+3 %)"``.
    torque_nm, angle_rad : float
    """

    label: str
    torque_nm: float
    angle_rad: float


@dataclass(frozen=True, eq=False)
class LoopCurve:
    """Both branches of one loop at even torques, from local fits.

    Parameters
    ----------
    torque_nm : array of float, shape (n,)
        Rising, from the loop's lowest to its highest torque.
    rising_rad, falling_rad : array of float, shape (n,)
        Angle while the torque rises and falls, less the bench's own twist.
    rising_standard_error_rad, falling_standard_error_rad : array of float, shape (n,)
        Of the local fits.
    """

    torque_nm: NDArray[np.float64]
    rising_rad: NDArray[np.float64]
    falling_rad: NDArray[np.float64]
    rising_standard_error_rad: NDArray[np.float64]
    falling_standard_error_rad: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LoopFeatures:
    """Values of one single loop.

    Parameters
    ----------
    position, loop : float, int
        Label of the output position, and number of the loop there (from 1).
    curve : LoopCurve
    backlash_rad, lost_motion_rad : float
    stiffness_positive_nm_per_rad, stiffness_negative_nm_per_rad : float
        Over the stiffness interval at positive and at negative torque.
    regions_nm_per_rad : array of float, shape (3,)
        K1, K2, K3; NaN if not requested.
    energy_j : float
        Loop energy.
    closure_rad : float
        Angle at the end of the loop less that at its start, at the same torque.
    slope_at_zero_rad_per_nm : float
        Mean of both branches' slope at zero torque.
    slope_at_lost_motion_rad_per_nm : float
        Mean slope at ±p of the lost motion rule.
    slope_difference_at_zero_rad_per_nm : float
        Falling less rising slope at zero torque.
    largest_torque_nm : float
        Reached on both sides.
    backlash_error_rad, lost_motion_error_rad : float
        Standard errors by the local fits.
    """

    position: float
    loop: int
    curve: LoopCurve
    backlash_rad: float
    lost_motion_rad: float
    stiffness_positive_nm_per_rad: float
    stiffness_negative_nm_per_rad: float
    regions_nm_per_rad: NDArray[np.float64]
    energy_j: float
    closure_rad: float
    slope_at_zero_rad_per_nm: float
    slope_at_lost_motion_rad_per_nm: float
    slope_difference_at_zero_rad_per_nm: float
    largest_torque_nm: float
    backlash_error_rad: float
    lost_motion_error_rad: float


@dataclass(frozen=True)
class StiffnessRegions:
    """Three regions of stiffness, as makers of harmonic reducers state them.

    Parameters
    ----------
    first_corner_nm, second_corner_nm : float
        T1 and T2.
    first, second, third : Budget or None
        K1 up to T1, K2 from T1 to T2, K3 above; N·m/rad. None where the loop doesn't go far
        enough into a region.
    """

    first_corner_nm: float
    second_corner_nm: float
    first: Budget | None
    second: Budget | None
    third: Budget | None


@dataclass(frozen=True, eq=False)
class HysteresisResult:
    """Stiffness, backlash, lost motion and loss of a reducer from torque-angle loops.

    Parameters
    ----------
    settings : LoopSettings
        Rated torque, rule and intervals that were used.
    stiffness : Budget
        Mean of both torque directions over the interval, N·m/arcmin.
    stiffness_positive, stiffness_negative : Budget
        Each direction, N·m/arcmin.
    backlash : Budget
        Loop width at zero torque, arcmin.
    lost_motion : Budget
        By the rule, arcmin.
    energy : Budget
        Hysteresis loss of a cycle, J.
    regions : StiffnessRegions or None
        If `LoopSettings.region_torques_nm` requests them.
    loops : tuple of LoopFeatures
        Every loop that was evaluated, in order.
    key_points : tuple of KeyPoint
        Of the first loop: for figures.
    findings : tuple of Finding
        Remarks about the data.
    """

    settings: LoopSettings
    stiffness: Budget
    stiffness_positive: Budget
    stiffness_negative: Budget
    backlash: Budget
    lost_motion: Budget
    energy: Budget
    regions: StiffnessRegions | None
    loops: tuple[LoopFeatures, ...]
    key_points: tuple[KeyPoint, ...]
    findings: tuple[Finding, ...]

    @property
    def rule(self) -> LostMotionRule:
        """The lost motion rule that was used."""
        return self.settings.lost_motion_rule

    def quantities(self) -> tuple[ResultQuantity, ...]:
        """Return the values under their names, for tables and reports."""
        low, high = self.settings.stiffness_interval
        interval = Message(
            "{low:g}-{high:g} % of the rated torque, loading branches", 100 * low, 100 * high
        )
        rows = [
            ResultQuantity("stiffness", "torsional stiffness", self.stiffness, interval),
            ResultQuantity(
                "stiffness_positive", "stiffness, clockwise", self.stiffness_positive, interval
            ),
            ResultQuantity(
                "stiffness_negative",
                "stiffness, counter-clockwise",
                self.stiffness_negative,
                interval,
            ),
        ]
        if self.regions is not None:
            t1, t2 = self.regions.first_corner_nm, self.regions.second_corner_nm
            for key, title, estimate, where in (
                ("stiffness_1", "stiffness K1", self.regions.first, Message("0 to {t1:g} N·m", t1)),
                (
                    "stiffness_2",
                    "stiffness K2",
                    self.regions.second,
                    Message("{low:g} to {high:g} N·m", t1, t2),
                ),
                (
                    "stiffness_3",
                    "stiffness K3",
                    self.regions.third,
                    Message("above {low:g} N·m", t2),
                ),
            ):
                if estimate is not None:
                    rows.append(ResultQuantity(key, title, estimate, where))
        rows += [
            ResultQuantity("backlash", "backlash", self.backlash, "loop width at zero torque"),
            ResultQuantity("lost_motion", "lost motion", self.lost_motion, self.rule.words()),
            ResultQuantity("hysteresis_loss", "hysteresis loss", self.energy, "per loop"),
        ]
        return tuple(rows)

    def limited(self, limits: DataSheetLimits) -> Iterator[LimitedQuantity]:
        """Return the values that the data sheet limits; those without a limit may be left out."""
        estimates = {each.key: each for each in self.quantities()}
        for key, lower, upper in (
            ("stiffness", limits.stiffness_nm_per_arcmin, None),
            ("backlash", None, limits.backlash_arcmin),
            ("lost_motion", None, limits.lost_motion_arcmin),
            ("hysteresis_loss", None, limits.hysteresis_loss_j),
        ):
            yield LimitedQuantity(key, estimates[key].title, estimates[key].estimate, lower, upper)
