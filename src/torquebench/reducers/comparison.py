"""Comparison of specimens of one type, and of one specimen before and after an endurance run."""

from collections.abc import Mapping
from dataclasses import dataclass

from torquebench.uncertainty import Budget

__all__ = [
    "COMMON_CONTRIBUTIONS",
    "Change",
    "SpecimenComparison",
    "change_between",
    "compare_specimens",
]

COMMON_CONTRIBUTIONS = frozenset(
    {"torque scale", "angle scale", "torque branch", "angle", "bench compliance", "encoders"}
)
"""Names of contributions that two evaluations on one bench have in common (fully correlated)."""


@dataclass(frozen=True)
class Change:
    """How a value of one specimen changed.

    Parameters
    ----------
    key : str
    change : Budget
        After less before, in the unit of both; what both have in common cancels.
    relative_percent : float
        Of the value before.
    significant : bool
        Whether the change exceeds its expanded uncertainty.
    """

    key: str
    change: Budget
    relative_percent: float
    significant: bool


@dataclass(frozen=True)
class SpecimenComparison:
    """A value of several specimens of one type.

    Parameters
    ----------
    key : str
    specimens : mapping of str to Budget
        By serial number.
    mean : Budget
        Over the specimens: spread, and what all have in common.
    spread : float
        Standard deviation between specimens (of their values), in the unit.
    outliers : tuple of str
        Serial numbers that differ from the median of the others by more than three times the
        robust spread and more than U of the difference.
    """

    key: str
    specimens: Mapping[str, Budget]
    mean: Budget
    spread: float
    outliers: tuple[str, ...]


def change_between(key: str, before: Budget, after: Budget) -> Change:
    """Return the change of a value, systematic parts that both share treated as correlated.

    Raises
    ------
    InputError
        Where the units differ.
    """
    raise NotImplementedError


def compare_specimens(key: str, specimens: Mapping[str, Budget]) -> SpecimenComparison:
    """Compare one value of several specimens of one type, by serial number.

    Raises
    ------
    InputError
        Fewer than two specimens, or units that differ.
    """
    raise NotImplementedError
