"""Torque-angle loops: stiffness, backlash, lost motion and hysteresis loss, with uncertainties."""

from collections.abc import Callable
from dataclasses import replace
from math import inf

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.columns import finite_columns, labels
from torquebench.reducers.loops.branches import cut_loops, smoothed, turning_points
from torquebench.reducers.loops.features import features_of, key_points_of
from torquebench.reducers.loops.findings import (
    check_closure,
    check_columns,
    loop_findings,
)
from torquebench.reducers.loops.flange_torque import FlangeInertia, torque_at_flange
from torquebench.reducers.loops.results import HysteresisResult, LoopFeatures, StiffnessRegions
from torquebench.reducers.loops.ripple import (
    NOTHING_LEFT,
    Record,
    RippleLeft,
    what_it_hid,
    without_ripple,
)
from torquebench.reducers.loops.rules import LoopSettings, LoopUncertainty
from torquebench.reducers.quantities import Contribution, Finding, budget
from torquebench.reducers.repeatability import over_positions
from torquebench.reducers.saturation import torque_saturation
from torquebench.uncertainty import Budget, Shared
from torquebench.units import ARCMIN, NM_PER_RAD_OF_NM_PER_ARCMIN

__all__ = ["evaluate_hysteresis"]


def evaluate_hysteresis(
    torque_nm: ArrayLike,
    angle_rad: ArrayLike,
    settings: LoopSettings,
    *,
    position: ArrayLike | None = None,
    loop: ArrayLike | None = None,
    demanded_nm: ArrayLike | None = None,
    bench_compliance_rad_per_nm: float = 0.0,
    resolution_rad: float = 0.0,
    time_s: ArrayLike | None = None,
    flange: FlangeInertia | None = None,
    uncertainty: LoopUncertainty | None = None,
) -> HysteresisResult:
    """Evaluate torque-angle loops, input locked and output loaded.

    Branches are fitted locally (`LocalLines`); stiffness is ΔT/Δθ by least squares over its
    interval on the branches that are being loaded. Values are means over the loops of a position
    and over positions (the worst position if the rule requires it); a torque uncertainty becomes an
    angle uncertainty through the local slope of the loop. If the torque has a ripple, branches are
    evaluated at the outermost angles (`loop_ripple`), with the torque less the one that accelerates
    a known flange (`torque_at_flange`).

    Parameters
    ----------
    torque_nm : array of float, shape (n,)
        Torque at the output in the order of measurement, N·m.
    angle_rad : array of float, shape (n,)
        Angle of the output against the locked input, rad; any zero.
    settings : LoopSettings
        Rated torque, rules and intervals.
    position : array of float, shape (n,), optional
        Label of the output position of each sample; one position by default.
    loop : array of int, shape (n,), optional
        Number of the loop at its position; found from the torque's reversals by default, and
        where labelled loops don't begin and end at their largest torque.
    demanded_nm : array of float, shape (n,), optional
        Commanded torque of the drive, only to detect saturation.
    bench_compliance_rad_per_nm : float
        The bench's own twist per torque between the encoder and the reducer, which is subtracted.
    resolution_rad : float
        Step of the angle's counts: it narrows a loop that is read where the angle is outermost.
    time_s : array of float, shape (n,), optional
        At an even rate but for gaps; only needed with `flange`.
    flange : FlangeInertia, optional
        Rotating parts between the transducer and the reducer.
    uncertainty : LoopUncertainty, optional
        Of torque, angle and compliance; by default none, so that only repeatability counts.

    Raises
    ------
    InputError
        Where the data can't be used: not finite, no whole loop, a loop that doesn't close,
        swapped columns, a loop that never reaches the stiffness interval, a flange without times.
    """
    torque, measured = finite_columns(16, torque_nm=torque_nm, angle_rad=angle_rad)
    place = labels(position, torque.size, 0.0, "position")
    number = None if loop is None else labels(loop, torque.size, 0.0, "loop")
    demanded = None if demanded_nm is None else labels(demanded_nm, torque.size, 0.0, "demand")
    known = uncertainty or LoopUncertainty()
    angle = measured - bench_compliance_rad_per_nm * torque
    for label in np.unique(place):
        here = place == label
        check_columns(torque[here], angle[here], settings.rated_torque_nm)
    findings = torque_saturation(torque, demanded)
    if flange is not None:
        torque, known = _at_reducer(time_s, torque, angle, flange, known, resolution_rad)
    record = Record(torque, angle, place, number)
    steady, ripple = without_ripple(record, resolution_rad)
    loops, blurred = _loops(steady, settings)
    left = NOTHING_LEFT
    if ripple is not None:
        left, found = what_it_hid(
            ripple, loops, _loops(record, settings)[0], at_reducer=flange is not None
        )
        findings.append(found)
    check_closure(loops, settings)
    findings += [*blurred, *loop_findings(loops, settings)]
    stiffness, positive, negative = _stiffnesses(loops, settings, known)
    return HysteresisResult(
        settings=settings,
        stiffness=stiffness,
        stiffness_positive=positive,
        stiffness_negative=negative,
        backlash=_backlash(loops, known, left),
        lost_motion=_lost_motion(loops, settings, known, left),
        energy=_energy(loops, known, left),
        regions=_regions(loops, settings, known),
        loops=tuple(loops),
        key_points=key_points_of(loops[0], settings),
        findings=tuple(findings),
    )


def _at_reducer(
    time_s: ArrayLike | None,
    torque: NDArray[np.float64],
    angle: NDArray[np.float64],
    flange: FlangeInertia,
    known: LoopUncertainty,
    resolution_rad: float,
) -> tuple[NDArray[np.float64], LoopUncertainty]:
    """Return the torque at the reducer, and its uncertainty."""
    if time_s is None:
        raise InputError(
            Message("a flange of {flange}, but no times", flange),
            "the time of each sample: how fast the flange swings follows from it",
            "give the times, or leave the flange's inertia out",
        )
    at_reducer, added = torque_at_flange(
        time_s, torque, angle, flange, angle_uncertainty_rad=resolution_rad / 12.0**0.5
    )
    branch = float(np.hypot(known.torque_branch_nm, np.sqrt(np.mean(added**2))))
    return at_reducer, replace(known, torque_branch_nm=branch)


def _loops(record: Record, settings: LoopSettings) -> tuple[list[LoopFeatures], list[Finding]]:
    """Cut a record into loops and evaluate each of them."""
    torque, angle, blurred = _less_noise(record.torque_nm, record.angle_rad, record.position)
    return [
        features_of(raw, torque, angle, settings)
        for raw in cut_loops(torque, record.position, record.loop)
        if raw.number > settings.settling_loops
    ], blurred


def _less_noise(
    torque: NDArray[np.float64], angle: NDArray[np.float64], place: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], list[Finding]]:
    """Average noisy torques over time at each position, with a remark."""
    torque, angle = torque.copy(), angle.copy()
    widest = 1
    for label in np.unique(place):
        here = place == label
        branches = turning_points(torque[here]).size - 1
        torque[here], angle[here], width = smoothed(torque[here], angle[here], branches)
        widest = max(widest, width)
    if widest == 1:
        return torque, angle, []
    return (
        torque,
        angle,
        [
            Finding(
                "noisy torque",
                Message(
                    "torque and angle were averaged over {count} neighbouring samples, "
                    "because noise of the torque blurs the loop where it is steep",
                    widest,
                ),
                "filter both channels alike, or ramp more slowly",
            )
        ],
    )


def _over(
    loops: list[LoopFeatures], value: Callable[[LoopFeatures], float]
) -> tuple[float, list[Contribution]]:
    values = np.array([value(each) for each in loops])
    return over_positions(values, np.array([each.position for each in loops]))


def _mean(loops: list[LoopFeatures], value: Callable[[LoopFeatures], float]) -> float:
    return float(np.mean([value(each) for each in loops]))


def _arcmin(value: float, parts: list[Contribution]) -> Budget:
    return budget(value / ARCMIN, "arcmin", _scaled(parts, 1.0 / ARCMIN))


def _scaled(parts: list[Contribution], factor: float) -> list[Contribution]:
    return [
        replace(part, standard_uncertainty=factor * part.standard_uncertainty) for part in parts
    ]


def _scale(known: LoopUncertainty, factor: float) -> tuple[Contribution, Contribution]:
    """Return contributions of errors in proportion to the torque."""
    return (
        Contribution("torque scale", known.torque_relative * factor, shared=Shared.CALIBRATION),
        Contribution("mounting", known.torque_mounting * factor, shared=Shared.MOUNTING),
    )


def _branch(known: LoopUncertainty, factor: float) -> tuple[Contribution, Contribution]:
    """Return contributions of errors of one branch of a loop against the other."""
    return (
        Contribution("torque branch", known.torque_branch_nm * factor, shared=Shared.CALIBRATION),
        Contribution("loading effects", known.torque_loading_nm * factor, shared=Shared.LOADING),
    )


def _backlash(loops: list[LoopFeatures], known: LoopUncertainty, left: RippleLeft) -> Budget:
    value, parts = _over(loops, lambda each: each.backlash_rad)
    slope = _mean(loops, lambda each: abs(each.slope_at_zero_rad_per_nm))
    tilt = _mean(loops, lambda each: abs(each.slope_difference_at_zero_rad_per_nm))
    positions = len({each.position for each in loops})
    parts += [
        *_branch(known, 2.0**0.5 * slope),
        Contribution(
            "torque zero", known.torque_zero_nm * tilt / positions**0.5, shared=Shared.ZEROING
        ),
        Contribution("angle", 2.0**0.5 * known.angle_rad, shared=Shared.MOUNTING),
        Contribution("angle scale", known.angle_relative * abs(value), shared=Shared.CALIBRATION),
        Contribution("local fit", _mean(loops, lambda each: each.backlash_error_rad)),
        Contribution("torque ripple", left.backlash_rad),
    ]
    return _arcmin(value, parts)


def _lost_motion(
    loops: list[LoopFeatures], settings: LoopSettings, known: LoopUncertainty, left: RippleLeft
) -> Budget:
    rule = settings.lost_motion_rule
    chosen = loops
    if rule.positions == "worst":
        by_position = {
            label: [each for each in loops if each.position == label]
            for label in dict.fromkeys(each.position for each in loops)
        }
        chosen = max(by_position.values(), key=lambda each: _mean(each, _lost))
    value, parts = _over(chosen, _lost)
    slope = _mean(chosen, lambda each: abs(each.slope_at_lost_motion_rad_per_nm))
    share = rule.share * settings.rated_torque_nm
    positions = len({each.position for each in chosen})
    parts += [
        # The residual of a compensated step at reversal is equal on both branches and has the
        # torque's sign: both ends add.
        *_branch(known, 2.0 * slope),
        Contribution(
            "torque zero", known.torque_zero_nm * slope / positions**0.5, shared=Shared.ZEROING
        ),
        *_scale(known, 2.0 * share * slope),
        Contribution("angle", known.angle_rad, shared=Shared.MOUNTING),
        Contribution("angle scale", known.angle_relative * abs(value), shared=Shared.CALIBRATION),
        Contribution(
            "bench compliance",
            known.bench_compliance_rad_per_nm * 2.0 * share,
            inf,
            -1.0,
            Shared.CALIBRATION,
        ),
        Contribution("local fit", _mean(chosen, lambda each: each.lost_motion_error_rad)),
        Contribution("torque ripple", left.lost_motion_rad),
    ]
    return _arcmin(value, parts)


def _lost(each: LoopFeatures) -> float:
    return each.lost_motion_rad


def _stiffness_budget(
    value: float,
    repeats: list[Contribution],
    torque_range_nm: float,
    known: LoopUncertainty,
    *,
    per: float,
    unit: str,
) -> Budget:
    """Budget of a stiffness in N·m/rad, divided by `per` into its unit."""
    angle_range = torque_range_nm / abs(value)
    parts = [
        *repeats,
        *_scale(known, abs(value)),
        *_branch(known, 2.0**0.5 / torque_range_nm * abs(value)),
        Contribution(
            "angle",
            2.0**0.5 * known.angle_rad / angle_range * abs(value),
            inf,
            -1.0,
            Shared.MOUNTING,
        ),
        Contribution(
            "angle scale", known.angle_relative * abs(value), inf, -1.0, Shared.CALIBRATION
        ),
        Contribution(
            "bench compliance",
            known.bench_compliance_rad_per_nm * value**2,
            shared=Shared.CALIBRATION,
        ),
    ]
    return budget(value / per, unit, _scaled(parts, 1.0 / per))


def _of_compliances(
    loops: list[LoopFeatures], stiffness: Callable[[LoopFeatures], float]
) -> tuple[float, list[Contribution]]:
    """Return the stiffness from the mean compliance: angles averaged at equal torque."""
    compliance, parts = _over(loops, lambda each: 1.0 / stiffness(each))
    return 1.0 / compliance, _scaled(parts, 1.0 / compliance**2)


def _stiffnesses(
    loops: list[LoopFeatures], settings: LoopSettings, known: LoopUncertainty
) -> tuple[Budget, Budget, Budget]:
    low, high = settings.stiffness_interval
    reach = (high - low) * settings.rated_torque_nm

    def both(each: LoopFeatures) -> float:
        # The mean of compliances: equal torques on both sides, angles averaged.
        positive, negative = each.stiffness_positive_nm_per_rad, each.stiffness_negative_nm_per_rad
        return 2.0 / (1.0 / positive + 1.0 / negative)

    found = []
    for choose in (
        both,
        lambda each: each.stiffness_positive_nm_per_rad,
        lambda each: each.stiffness_negative_nm_per_rad,
    ):
        value, parts = _of_compliances(loops, choose)
        found.append(
            _stiffness_budget(
                value, parts, reach, known, per=NM_PER_RAD_OF_NM_PER_ARCMIN, unit="N·m/arcmin"
            )
        )
    return found[0], found[1], found[2]


def _regions(
    loops: list[LoopFeatures], settings: LoopSettings, known: LoopUncertainty
) -> StiffnessRegions | None:
    if settings.region_torques_nm is None:
        return None
    first, second = settings.region_torques_nm
    largest = min(each.largest_torque_nm for each in loops)
    budgets: list[Budget | None] = []
    for k, reach in enumerate((first, second - first, largest - second)):
        if any(np.isnan(each.regions_nm_per_rad[k]) for each in loops):
            budgets.append(None)
            continue
        value, parts = _of_compliances(loops, _region(k))
        budgets.append(_stiffness_budget(value, parts, reach, known, per=1.0, unit="N·m/rad"))
    return StiffnessRegions(first, second, budgets[0], budgets[1], budgets[2])


def _region(number: int) -> Callable[[LoopFeatures], float]:
    return lambda each: float(each.regions_nm_per_rad[number])


def _energy(loops: list[LoopFeatures], known: LoopUncertainty, left: RippleLeft) -> Budget:
    value, parts = _over(loops, lambda each: each.energy_j)
    twist = _mean(loops, _twist)
    load = _mean(loops, lambda each: 2.0 * each.largest_torque_nm)
    parts += [
        *_scale(known, abs(value)),
        Contribution("angle scale", known.angle_relative * abs(value), shared=Shared.CALIBRATION),
        *_branch(known, 2.0**0.5 * twist),
        Contribution("angle", 2.0**0.5 * known.angle_rad * load, shared=Shared.MOUNTING),
        Contribution("torque ripple", left.energy_j),
    ]
    return budget(value, "J", parts)


def _twist(each: LoopFeatures) -> float:
    ends: NDArray[np.float64] = np.concatenate([each.curve.rising_rad, each.curve.falling_rad])
    return float(np.ptp(ends))
