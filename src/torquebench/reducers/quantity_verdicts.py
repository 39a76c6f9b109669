"""Verdicts on results against a data sheet, with guard bands."""

from collections.abc import Iterator
from dataclasses import dataclass

from torquebench.errors import InputError
from torquebench.reducers.breakaway.evaluation import BreakawayResult
from torquebench.reducers.description import ReducerDescription
from torquebench.reducers.efficiencies.evaluation import EfficiencyMap
from torquebench.reducers.loops.results import HysteresisResult
from torquebench.reducers.running.no_load import NoLoadResult
from torquebench.reducers.transmission.evaluation import TransmissionErrorResult
from torquebench.uncertainty import Budget, Decision, Tolerance, decide

__all__ = ["AnyResult", "QuantityVerdict", "verdicts"]

AnyResult = (
    HysteresisResult | NoLoadResult | BreakawayResult | TransmissionErrorResult | EfficiencyMap
)

_Row = tuple[str, str, Budget, float | None, float | None]
"""Key, title, estimate, lower limit, upper limit."""


@dataclass(frozen=True)
class QuantityVerdict:
    """One value of a result held against its limit.

    Parameters
    ----------
    key : str
        Key of the quantity, as in ``result.quantities()``.
    title : str
    estimate : Budget
    limit : str
        In words with its unit, such as ``"≤ 1 arcmin"``.
    decision : Decision
        Verdict (pass, conditional pass, conditional fail, fail) with guard band w = U.
    """

    key: str
    title: str
    estimate: Budget
    limit: str
    decision: Decision


def verdicts(result: AnyResult, description: ReducerDescription) -> tuple[QuantityVerdict, ...]:
    """Hold every value that the data sheet limits against its limit.

    Parameters
    ----------
    result : HysteresisResult, NoLoadResult, BreakawayResult, TransmissionErrorResult, EfficiencyMap
    description : ReducerDescription

    Returns
    -------
    tuple of QuantityVerdict
        Empty where the data sheet limits nothing that the result holds. A limit at a speed or
        torque that wasn't measured (no-load speed, efficiency point) gives no verdict.
    """
    return tuple(
        _judged(key, title, estimate, lower, upper)
        for key, title, estimate, lower, upper in _rows(result, description)
        if lower is not None or upper is not None
    )


def _judged(
    key: str, title: str, estimate: Budget, lower: float | None, upper: float | None
) -> QuantityVerdict:
    words = [
        f"{sign} {limit:g} {estimate.unit}"
        for sign, limit in (("≥", lower), ("≤", upper))
        if limit is not None
    ]
    decision = decide(
        estimate.value,
        estimate.expanded_uncertainty(),
        Tolerance(lower, upper),
        degrees_of_freedom=estimate.degrees_of_freedom,
    )
    return QuantityVerdict(key, title, estimate, ", ".join(words), decision)


def _rows(result: AnyResult, description: ReducerDescription) -> Iterator[_Row]:
    limits = description.limits
    if isinstance(result, HysteresisResult):
        estimates = {each.key: each for each in result.quantities()}
        for key, lower, upper in (
            ("stiffness", limits.stiffness_nm_per_arcmin, None),
            ("backlash", None, limits.backlash_arcmin),
            ("lost_motion", None, limits.lost_motion_arcmin),
            ("hysteresis_loss", None, limits.hysteresis_loss_j),
        ):
            yield key, estimates[key].title, estimates[key].estimate, lower, upper
    elif isinstance(result, BreakawayResult):
        limit = (
            limits.starting_torque_nm
            if result.kind == "starting"
            else limits.back_driving_torque_nm
        )
        only = result.quantities()[0]
        yield only.key, only.title, only.estimate, None, limit
    elif isinstance(result, TransmissionErrorResult):
        only = result.quantities()[0]
        yield only.key, only.title, only.estimate, None, limits.transmission_error_arcsec
    elif isinstance(result, NoLoadResult):
        yield from _no_load_rows(result, description)
    else:
        yield from _efficiency_rows(result, description)


def _no_load_rows(result: NoLoadResult, description: ReducerDescription) -> Iterator[_Row]:
    for limit in description.limits.no_load:
        for point in result.points:
            if abs(abs(point.speed_rpm) - limit.speed_rpm) <= 0.02 * limit.speed_rpm:
                torque = point.magnitude()
                key = point.key
                yield (
                    key,
                    f"no-load torque at {point.speed_rpm:.0f} rpm",
                    torque,
                    None,
                    (limit.torque_nm),
                )


def _efficiency_rows(result: EfficiencyMap, description: ReducerDescription) -> Iterator[_Row]:
    for limit in description.limits.efficiency:
        for sign in (1.0, -1.0):
            try:
                found = result.at(limit.torque_nm, sign * limit.speed_rpm)
            except InputError:
                continue
            title = f"efficiency at {limit.torque_nm:g} N·m, {sign * limit.speed_rpm:g} rpm"
            key = f"efficiency_{limit.torque_nm:g}_nm_{sign * limit.speed_rpm:g}_rpm"
            yield key, title, found, limit.percent, None
