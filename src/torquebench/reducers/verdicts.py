"""Verdicts on results against a data sheet, with guard bands."""

from dataclasses import dataclass

from torquebench.reducers.breakaway import BreakawayResult
from torquebench.reducers.description import ReducerDescription
from torquebench.reducers.efficiency import EfficiencyMap
from torquebench.reducers.loop_results import HysteresisResult
from torquebench.reducers.no_load import NoLoadResult
from torquebench.reducers.transmission_error import TransmissionErrorResult
from torquebench.uncertainty import Budget, Decision

__all__ = ["AnyResult", "QuantityVerdict", "verdicts"]

AnyResult = (
    HysteresisResult | NoLoadResult | BreakawayResult | TransmissionErrorResult | EfficiencyMap
)


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

    Returns an empty tuple where the data sheet limits nothing that the result holds.
    """
    raise NotImplementedError
