"""Results of torque-angle loops: the makers' rules, the values with U, and defects by name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.quantities import Finding, LimitedQuantity, ResultQuantity
from torquebench.reducers.torque_uncertainty import StandardUncertainties
from torquebench.uncertainty import Budget
from torquebench.units import ARCMIN, DEG_PER_RAD

if TYPE_CHECKING:
    from torquebench.reducers.description import DataSheetLimits

Floats = NDArray[np.float64]

# -- rules ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class LostMotionRule:
    """A maker's definition of lost motion.

    Lost motion = ½[θ↑(+p) + θ↓(+p)] − ½[θ↑(−p) + θ↓(−p)] with p a share of the rated torque.

    Parameters
    ----------
    share : float
        p as a share of the rated torque.
    positions : {"mean", "worst"}
        Whether the mean or the worst of all output positions counts.
    least_positions : int
        Number of output positions that the maker requires.
    source : str
        Standard or maker that defines the rule.
    """

    name: str
    share: float
    positions: Literal["mean", "worst"]
    least_positions: int
    source: str

    def words(self) -> str:
        """Return the rule in words, as a report has to state it.

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
    settling_loops : int
        Loops at the start of each position that are excluded as preload.
    closure_share : float
        Largest gap between the start and the end of a loop, and largest drift from loop to loop, as
        a share of its width in angle.
    """

    rated_torque_nm: float
    rule: str = "nabtesco"
    stiffness_interval: tuple[float, float] = (0.5, 1.0)
    region_torques_nm: tuple[float, float] | None = None
    window_share: float = 0.05
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
        Standard uncertainty from the calibration, as a share of reading; common to all loops.
    torque_mounting : float
        Standard uncertainty from the mounting, as a share of reading; common to all loops.
    torque_zero_nm : float
        Of the torque's zero, N·m; common to both branches of a loop, fresh for each position.
    torque_branch_nm : float
        Standard uncertainty of the torque of one branch relative to the other by the calibration,
        N·m; independent between branches, common to all loops. Lost motion may have this error with
        equal signs on both sides.
    torque_loading_nm : float
        The same, by the loading (position in the chain's own hysteresis loop, creep, drift within a
        loop), N·m.
    angle_rad : float
        Of an angle of one branch (encoder interpolation), rad; independent between the branches and
        the signs, common to all loops.
    angle_relative : float
        Standard uncertainty of the angle's scale, as a share.
    bench_compliance_rad_per_nm : float
        Standard uncertainty of the bench's own compliance, rad/(N·m).
    """

    torque_relative: float = 0.0
    torque_mounting: float = 0.0
    torque_zero_nm: float = 0.0
    torque_branch_nm: float = 0.0
    torque_loading_nm: float = 0.0
    angle_rad: float = 0.0
    angle_relative: float = 0.0
    bench_compliance_rad_per_nm: float = 0.0


# -- values -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class KeyPoint:
    """A point of the loop that a figure marks, such as ``"θ↑(+3 %)"``."""

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
        Angle while the torque rises and falls, less the bench's own twist and drift.
    """

    torque_nm: Floats
    rising_rad: Floats
    falling_rad: Floats


@dataclass(frozen=True)
class Feature:
    """Value of one loop, with standard uncertainties by noise, counts and interpolation."""

    value: float
    noise: float = 0.0
    step: float = 0.0
    between: float = 0.0

    @classmethod
    def mean(cls, first: Feature, second: Feature) -> Feature:
        """Return the mean of two features: noise is independent, other errors may be alike."""
        return cls(
            0.5 * (first.value + second.value),
            0.5 * float(np.hypot(first.noise, second.noise)),
            0.5 * (first.step + second.step),
            0.5 * (first.between + second.between),
        )


@dataclass(frozen=True, eq=False)
class LoopFeatures:
    """Values of one single loop.

    Parameters
    ----------
    position, loop : float, int
        Label of the output position, and number of the loop there (from 1).
    backlash, lost_motion : Feature
        rad.
    compliance_positive, compliance_negative : Feature
        Over the stiffness interval at positive and at negative torque, rad/(N·m).
    regions : tuple of Feature or None
        1/K1, 1/K2, 1/K3, rad/(N·m); None if not requested or not reached.
    energy : Feature
        Loop energy, J.
    closure_rad, closure_noise_rad : float
        Angle at the end of the loop less that at its start, at the same torque; and the standard
        uncertainty of that.
    slope_at_zero, slope_at_lost_motion, slope_difference_at_zero : float
        Mean slope of both branches at zero torque and at ±p of the rule, and falling less rising
        slope at zero, rad/(N·m).
    largest_torque_nm : float
        Reached on both sides.
    """

    position: float
    loop: int
    curve: LoopCurve
    backlash: Feature
    lost_motion: Feature
    compliance_positive: Feature
    compliance_negative: Feature
    regions: tuple[Feature | None, ...]
    energy: Feature
    closure_rad: float
    closure_noise_rad: float
    slope_at_zero: float
    slope_at_lost_motion: float
    slope_difference_at_zero: float
    largest_torque_nm: float

    @property
    def compliance(self) -> Feature:
        """The mean of both sides: equal torques, angles averaged."""
        return Feature.mean(self.compliance_positive, self.compliance_negative)

    @property
    def width_rad(self) -> float:
        """Range of the angle."""
        return float(np.ptp([self.curve.rising_rad, self.curve.falling_rad]))


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
        Lost motion by the rule, arcmin.
    energy : Budget
        Hysteresis loss of a cycle, J.
    regions : StiffnessRegions or None
        Stiffness in the regions that `LoopSettings.region_torques_nm` requests.
    loops : tuple of LoopFeatures
        Every loop that was evaluated, in order.
    key_points : tuple of KeyPoint
        Key points of the first loop, for figures.
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
        estimates = {quantity.key: quantity for quantity in self.quantities()}
        for key, lower, upper in (
            ("stiffness", limits.stiffness_nm_per_arcmin, None),
            ("backlash", None, limits.backlash_arcmin),
            ("lost_motion", None, limits.lost_motion_arcmin),
            ("hysteresis_loss", None, limits.hysteresis_loss_j),
        ):
            yield LimitedQuantity(key, estimates[key].title, estimates[key].estimate, lower, upper)


# -- defects ----------------------------------------------------------------------------------

PRELOAD_SHARE = 0.06
"""A loop whose smallest stiffness is beyond this share of the rated torque has a preload."""
SOFTER = 2.0
WIDEST_TWIST_RAD = 0.5


def check_columns(torque: Floats, angle: Floats, rated_torque_nm: float) -> None:
    """Refuse columns that are swapped, constant, or of opposite signs."""
    for name, column in (("torque", torque), ("angle", angle)):
        if np.ptp(column) == 0.0:
            raise InputError(
                Message("the {name} stands still at {column:.6g}", name, column[0]),
                Message("{name}s that change", name),
                "check the channel",
            )
    torque_range, angle_range = float(np.ptp(torque)), float(np.ptp(angle))
    if torque_range < 0.1 * rated_torque_nm and angle_range > 0.5 * rated_torque_nm:
        raise InputError(
            Message(
                "a torque of {torque_range:.4g} N·m over an angle of {angle_range:.4g} rad",
                torque_range,
                angle_range,
            ),
            Message("loops to about {rated_torque_nm:g} N·m", rated_torque_nm),
            "torque and angle are swapped: name the columns the other way round",
        )
    if angle_range > WIDEST_TWIST_RAD and torque_range < 2.5 * rated_torque_nm:
        raise InputError(
            Message("an angle that moves by {degrees:.4g}°", angle_range * DEG_PER_RAD),
            Message(
                "a twist of at most {degrees:.3g}° with one side locked",
                WIDEST_TWIST_RAD * DEG_PER_RAD,
            ),
            "check the angle's unit, that one side is locked, and label the output positions; the "
            "angle of a motor with a locked output needs the ratio",
        )
    if float(np.corrcoef(torque, angle)[0, 1]) < 0.0:
        raise InputError(
            "an angle that falls while the torque rises",
            "torque and angle of one sign",
            "reverse the sign of one of them",
        )


class OpenLoopError(InputError):
    """A torque-angle loop doesn't close; `loop` has its features."""

    def __init__(self, loop: LoopFeatures, found: str, allowed: str = "", remedy: str = "") -> None:
        super().__init__(found, allowed, remedy)
        self.loop = loop

    def __reduce__(self) -> tuple[Any, ...]:
        return (type(self), (self.loop, self.found, self.allowed, self.remedy))


def check_closure(loops: Sequence[LoopFeatures], settings: LoopSettings) -> None:
    """Refuse loops that don't close."""
    for loop in loops:
        gap = loop.closure_rad
        if abs(gap) <= max(settings.closure_share * loop.width_rad, 6.0 * loop.closure_noise_rad):
            continue
        raise OpenLoopError(
            loop,
            Message(
                "loop {loop} at position {position:g} doesn't close: its end is "
                "{degrees:.3g} arcmin off its start ({closure_rad:.3g} % of its width)",
                loop.loop,
                loop.position,
                gap / ARCMIN,
                100 * gap / loop.width_rad,
            ),
            Message("at most {closure_share:g} % of the width", 100 * settings.closure_share),
            "preload to the rated torque first, check clamps and encoder for slip and the "
            "locked side for creeping",
        )


def loop_findings(loops: Sequence[LoopFeatures], settings: LoopSettings) -> list[Finding]:
    """Return findings about the evaluated loops."""
    findings = []
    positions = {loop.position for loop in loops}
    rule = settings.lost_motion_rule
    if len(loops) < 3 * len(positions):
        few: str = "a single whole loop"
        if len(loops) > 1:
            few = Message("{loops} whole loops at one position", len(loops))
        if len(positions) > 1:
            few = Message(
                "{loops} whole loops at {positions} positions", len(loops), len(positions)
            )
        if len(loops) == len(positions):
            few = Message("{few}: U doesn't contain how they repeat", few)
        findings.append(Finding("few loops", few, "record at least three loops at each position"))
    if len(positions) < rule.least_positions:
        findings.append(
            Finding(
                "few positions",
                Message(
                    "{positions} output positions; {source} asks for {count}",
                    len(positions),
                    rule.source,
                    rule.least_positions,
                ),
                "repeat the loops at more output positions",
            )
        )
    hidden = _preload(loops, settings)
    if hidden is not None:
        findings.append(hidden)
    if any(loop.backlash.value < -6.0 * _spread(loop.backlash) for loop in loops):
        findings.append(
            Finding(
                "loop runs backwards",
                "the falling branch lies below the rising one: the loop would gain energy",
                "check for a delay between torque and angle, and the signs of both",
                severe=True,
            )
        )
    return findings


def _spread(feature: Feature) -> float:
    return float(np.linalg.norm([feature.noise, feature.step, feature.between]))


def _preload(loops: Sequence[LoopFeatures], settings: LoopSettings) -> Finding | None:
    """Return a finding if loops are much softer far from zero torque than at it."""
    centres = []
    for loop in loops:
        curve = loop.curve
        width = 0.02 * settings.rated_torque_nm
        grid = np.arange(curve.torque_nm[0] + width, curve.torque_nm[-1] - width, 0.5 * width)
        grid = grid[np.abs(grid) < 0.8 * loop.largest_torque_nm]
        middle = 0.0
        for branch in (curve.rising_rad, curve.falling_rad):
            ends = [np.interp(grid + s * width, curve.torque_nm, branch) for s in (-1.0, 1.0)]
            softness = (ends[1] - ends[0]) / (2.0 * width)
            peak = int(np.argmax(softness))
            if softness[peak] < SOFTER * float(np.median(softness)):
                return None
            middle += 0.5 * float(grid[peak])
        centres.append(middle)
    found = float(np.median(centres))
    if abs(found) <= PRELOAD_SHARE * settings.rated_torque_nm:
        return None
    return Finding(
        "backlash hidden by preload",
        Message(
            "the loop is softest around {found:.4g} N·m instead of 0 N·m: a constant "
            "torque keeps the flanks together, and the width at zero torque doesn't "
            "show the backlash",
            found,
        ),
        "remove the preload (weight on a horizontal shaft, brake, coupling), check the zero",
        severe=True,
    )
