"""Evaluation rules of torque-angle loops: makers' rules by name, intervals, input uncertainties."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from types import MappingProxyType
from typing import Literal

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.torque_uncertainty import StandardUncertainties

__all__ = ["LOST_MOTION_RULES", "LoopSettings", "LoopUncertainty", "LostMotionRule"]


@dataclass(frozen=True)
class LostMotionRule:
    """A maker's definition of lost motion.

    Lost motion = ½[θ↑(+p) + θ↓(+p)] − ½[θ↑(−p) + θ↓(−p)] with p a share of the rated torque.

    Parameters
    ----------
    name : str
    share : float
        p as a share of the rated torque.
    positions : {"mean", "worst"}
        Whether the mean or the worst of all output positions counts.
    least_positions : int
        Number of output positions that the maker requires.
    source : str
        Whose rule it is.
    """

    name: str
    share: float
    positions: Literal["mean", "worst"]
    least_positions: int
    source: str

    def words(self) -> str:
        """Say the rule in words, as a report has to state it.

        Examples
        --------
        >>> LOST_MOTION_RULES["yaskawa"].words()
        'Yaskawa: at ±5 % of the rated torque, worst of at least 4 positions'
        """
        where = "mean of all positions" if self.positions == "mean" else "worst"
        if self.least_positions > 1:
            where = Message(
                "{where} of at least {least_positions} positions", where, self.least_positions
            )
        return Message(
            "{source}: at ±{share:g} % of the rated torque, {where}",
            self.source,
            100 * self.share,
            where,
        )


LOST_MOTION_RULES: Mapping[str, LostMotionRule] = MappingProxyType(
    {
        rule.name: rule
        for rule in (
            LostMotionRule("nabtesco", 0.03, "mean", 1, "Nabtesco"),
            LostMotionRule("spinea", 0.03, "mean", 1, "Spinea"),
            LostMotionRule("harmonic-drive", 0.04, "mean", 1, "Harmonic Drive"),
            LostMotionRule("yaskawa", 0.05, "worst", 4, "Yaskawa"),
        )
    }
)
"""Rules by name."""


@dataclass(frozen=True)
class LoopSettings:
    """Evaluated features of a loop, and their definitions.

    Parameters
    ----------
    rated_torque_nm : float
        T_N at the output, N·m.
    rule : str
        Name of the lost motion rule, one of `LOST_MOTION_RULES`.
    stiffness_interval : pair of float
        Interval of the stiffness as shares of T_N.
    region_torques_nm : pair of float or None
        T1 and T2 for three regions of stiffness; None for none.
    window_share : float
        Largest half width of the window of a local fit, as a share of the loop's largest
        torque; narrower where the branch bends.
    least_samples : int
        Least samples in each local fit.
    settling_loops : int
        Loops at the start of each position that are excluded as preload.
    closure_share : float
        Largest gap between the start and the end of a loop, as a share of its width in angle.
    """

    rated_torque_nm: float
    rule: str = "nabtesco"
    stiffness_interval: tuple[float, float] = (0.5, 1.0)
    region_torques_nm: tuple[float, float] | None = None
    window_share: float = 0.05
    least_samples: int = 8
    settling_loops: int = 0
    closure_share: float = 0.05

    def __post_init__(self) -> None:
        if not (isfinite(self.rated_torque_nm) and self.rated_torque_nm > 0.0):
            raise InputError(
                Message("rated torque {rated_torque_nm} N·m", self.rated_torque_nm), "above 0 N·m"
            )
        if self.rule not in LOST_MOTION_RULES:
            raise InputError(
                Message("rule {rule!r}", self.rule),
                Message("one of {list}", ", ".join(LOST_MOTION_RULES)),
            )
        low, high = self.stiffness_interval
        if not 0.0 <= low < high <= 1.5:
            raise InputError(
                Message("stiffness interval {low:g} to {high:g} T_N", low, high),
                "0 or more, rising",
            )

    @property
    def lost_motion_rule(self) -> LostMotionRule:
        """The rule with its share and source."""
        return LOST_MOTION_RULES[self.rule]


@dataclass(frozen=True)
class LoopUncertainty(StandardUncertainties):
    """Standard uncertainties (k = 1) of a loop's torque and angle.

    Parameters
    ----------
    torque_relative : float
        Of the calibration, as a share of reading; common to all loops.
    torque_mounting : float
        Of the mounting, as a share of reading; common to all loops.
    torque_zero_nm : float
        Of the torque's zero, N·m; common to both branches of a loop, fresh for each position.
    torque_branch_nm : float
        Standard uncertainty of the torque of one branch relative to the other by the calibration,
        N·m; independent between branches, common to all loops. Lost motion may have this error with
        equal signs on both sides.
    torque_loading_nm : float
        The same by the loading (place in the chain's own hysteresis loop, creep, drift within a
        loop), N·m.
    angle_rad : float
        Of an angle of one branch (encoder interpolation, resolution), rad; independent between
        the branches and the signs, common to all loops.
    angle_relative : float
        Of the angle's scale, as a share.
    bench_compliance_rad_per_nm : float
        Of the bench's own compliance, rad/(N·m).
    """

    torque_relative: float = 0.0
    torque_mounting: float = 0.0
    torque_zero_nm: float = 0.0
    torque_branch_nm: float = 0.0
    torque_loading_nm: float = 0.0
    angle_rad: float = 0.0
    angle_relative: float = 0.0
    bench_compliance_rad_per_nm: float = 0.0
