"""Comparison of specimens of one type, and of one specimen before and after an endurance run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf

import numpy as np

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.quantities import Contribution, budget
from torquebench.uncertainty import Budget

__all__ = [
    "COMMON_CONTRIBUTIONS",
    "Change",
    "SpecimenComparison",
    "change_between",
    "compare_specimens",
]

COMMON_CONTRIBUTIONS = frozenset(
    {
        "torque scale",
        "torque branch",
        "compensation model",
        "bearing drag",
        "input torque scale",
        "output torque scale",
        "input torque model",
        "output torque model",
        "input bearing drag",
        "output bearing drag",
        "angle scale",
        "angle",
        "bench compliance",
        "encoders",
    }
)
"""Names of contributions common to two evaluations on one bench (fully correlated)."""


@dataclass(frozen=True)
class Change:
    """Change of a value of one specimen.

    Parameters
    ----------
    key : str
    change : Budget
        After less before, in the unit of both; common contributions cancel.
    relative_percent : float
        Of the value before; NaN where that is 0.
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
        Over the specimens: spread, and common contributions.
    spread : float
        Standard deviation between specimens (of their values), in the unit.
    outliers : tuple of str
        Serial numbers that differ from the median of the others by more than three times the
        robust spread and more than U of the difference. Needs four specimens or more.
    """

    key: str
    specimens: Mapping[str, Budget]
    mean: Budget
    spread: float
    outliers: tuple[str, ...]


def change_between(key: str, before: Budget, after: Budget, *, same_bench: bool = True) -> Change:
    """Return the change of a value, systematic parts that both share treated as correlated.

    A contribution of `COMMON_CONTRIBUTIONS` acts on both values in the same way: of it only the
    difference of both contributions remains. All others are independent.

    Parameters
    ----------
    key : str
        Name of the value.
    before, after : Budget
        The same value of the same specimen, in one unit.
    same_bench : bool
        Whether both were measured on one bench with one calibration; otherwise no contribution
        cancels.

    Raises
    ------
    InputError
        Where the units differ.

    Examples
    --------
    >>> scale, noise = Contribution("torque scale", 0.5), Contribution("loops", 0.1)
    >>> found = change_between(
    ...     "stiffness", budget(100.0, "N·m/arcmin", [scale, noise]),
    ...     budget(97.0, "N·m/arcmin", [scale, noise]),
    ... )
    >>> round(found.change.value, 6), round(found.change.standard_uncertainty, 3)
    (-3.0, 0.141)
    >>> found.significant
    True
    """
    if before.unit != after.unit:
        raise InputError(
            Message("{key} in {unit} and in {after_unit}", key, before.unit, after.unit), "one unit"
        )
    parts: list[Contribution] = []
    shared = COMMON_CONTRIBUTIONS if same_bench else frozenset()
    for name in sorted({line.name for line in (*before.lines, *after.lines)}):
        first = [line for line in before.lines if line.name == name]
        second = [line for line in after.lines if line.name == name]
        if name in shared:
            signed = sum(line.sensitivity * line.contribution for line in second) - sum(
                line.sensitivity * line.contribution for line in first
            )
            freedom = min(line.degrees_of_freedom for line in (*first, *second))
            parts.append(Contribution(name, abs(signed), freedom, float(np.sign(signed)) or 1.0))
            continue
        for when, lines in (("before", first), ("after", second)):
            parts += [
                Contribution(f"{name}, {when}", line.contribution, line.degrees_of_freedom)
                for line in lines
            ]
    change = budget(after.value - before.value, before.unit, parts)
    relative = 100.0 * change.value / abs(before.value) if before.value else float("nan")
    return Change(key, change, relative, abs(change.value) > change.expanded_uncertainty())


def compare_specimens(key: str, specimens: Mapping[str, Budget]) -> SpecimenComparison:
    """Compare one value of several specimens of one type, by serial number.

    Raises
    ------
    InputError
        Fewer than two specimens, or units that differ.

    Examples
    --------
    >>> found = compare_specimens("backlash", {
    ...     serial: budget(value, "arcmin", [Contribution("loops", 0.01)])
    ...     for serial, value in (("A", 0.50), ("B", 0.52), ("C", 0.51), ("D", 0.95))
    ... })
    >>> found.outliers
    ('D',)
    """
    if len(specimens) < 2:
        raise InputError(Message("{count} specimens", len(specimens)), "at least two to compare")
    units = {each.unit for each in specimens.values()}
    if len(units) > 1:
        raise InputError(
            Message("{cell} in {place}", key, " and in ".join(sorted(units))), "one unit"
        )
    values = np.array([each.value for each in specimens.values()])
    spread = float(np.std(values, ddof=1))
    parts = [Contribution("specimens", spread / values.size**0.5, values.size - 1.0)]
    for name in sorted(COMMON_CONTRIBUTIONS):
        found = [
            sum(line.contribution for line in each.lines if line.name == name)
            for each in specimens.values()
        ]
        parts.append(Contribution(name, float(np.mean(found)), inf))
    serials = list(specimens)
    outliers = tuple(
        serial
        for index, serial in enumerate(serials)
        if _is_outlier(index, serials, specimens, values)
    )
    mean = budget(float(values.mean()), units.pop(), parts)
    return SpecimenComparison(key, dict(specimens), mean, spread, outliers)


def _is_outlier(
    index: int,
    serials: Sequence[str],
    specimens: Mapping[str, Budget],
    values: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
) -> bool:
    others = np.delete(values, index)
    if others.size < 3:
        return False
    middle = float(np.median(others))
    robust = 1.4826 * float(np.median(np.abs(others - middle)))
    nearest = serials[
        int(np.argmin(np.where(np.arange(values.size) == index, inf, np.abs(values - middle))))
    ]
    change = change_between("", specimens[nearest], specimens[serials[index]]).change
    distance = abs(float(values[index]) - middle)
    return distance > 3.0 * robust and distance > change.expanded_uncertainty()
