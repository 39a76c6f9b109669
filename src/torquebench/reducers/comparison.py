"""Comparison of specimens of one type, and of one specimen before and after an endurance run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.quantities import budget, together
from torquebench.uncertainty import Budget, BudgetLine, Shared


@dataclass(frozen=True)
class Change:
    """Change of a value of one specimen.

    Parameters
    ----------
    change : Budget
        Value after less value before, in the unit of both; errors of one calibration cancel.
    relative_percent : float
        Change in % of the value before; NaN where that value is 0.
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
    specimens : mapping of str to Budget
        By serial number.
    mean : Budget
        Over the specimens: spread, and errors of the calibration.
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


def change_between(
    key: str, before: Budget, after: Budget, *, same_calibration: bool = True
) -> Change:
    """Return the change of a value, without the errors that both values share.

    Between two tests a specimen is mounted and zeroed again: only errors of the calibration are
    common, and of those only the difference of both contributions remains. All others are
    independent.

    Parameters
    ----------
    key : str
        Name of the value.
    before, after : Budget
        The same value of the same specimen, in one unit.
    same_calibration : bool
        Whether both were measured on one bench with one calibration; otherwise no contribution
        cancels.

    Raises
    ------
    InputError
        Where the units differ.

    Examples
    --------
    >>> scale = BudgetLine("torque scale", 0.5, shared=Shared.CALIBRATION)
    >>> noise = BudgetLine("loops", 0.1)
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
    parts: list[BudgetLine] = []
    for name in sorted({line.name for line in (*before.lines, *after.lines)}):
        cancels: list[tuple[float, BudgetLine]] = []
        for when, sign, value in (("before", -1.0, before), ("after", 1.0, after)):
            for line in (line for line in value.lines if line.name == name):
                if same_calibration and line.shared is Shared.CALIBRATION:
                    cancels.append((sign, line))
                else:
                    parts.append(replace(line.times(1.0), name=f"{name}, {when}"))
        if cancels:
            parts.append(together(cancels))
    change = budget(after.value - before.value, before.unit, parts)
    relative = 100.0 * change.value / abs(before.value) if before.value else float("nan")
    return Change(key, change, relative, abs(change.value) > change.expanded_uncertainty())


def compare_specimens(
    key: str, specimens: Mapping[str, Budget], *, same_calibration: bool = True
) -> SpecimenComparison:
    """Compare one value of several specimens of one type, by serial number.

    Errors of the calibration are those of the mean as well; everything that a mounting, a zero or a
    test changes is in the spread between the specimens.

    Parameters
    ----------
    key : str
        Name of the value.
    specimens : mapping of str to Budget
        By serial number.
    same_calibration : bool
        Whether all were measured on one bench with one calibration; otherwise no contribution
        cancels in the difference of two specimens.

    Raises
    ------
    InputError
        Fewer than two specimens, or units that differ.

    Examples
    --------
    >>> found = compare_specimens("backlash", {
    ...     serial: budget(value, "arcmin", [BudgetLine("loops", 0.01)])
    ...     for serial, value in (("A", 0.50), ("B", 0.52), ("C", 0.51), ("D", 0.95))
    ... })
    >>> found.outliers
    ('D',)
    """
    if len(specimens) < 2:
        raise InputError(Message("{count} specimens", len(specimens)), "at least two to compare")
    units = {specimen.unit for specimen in specimens.values()}
    if len(units) > 1:
        raise InputError(
            Message("{cell} in {place}", key, " and in ".join(sorted(units))), "one unit"
        )
    values = np.array([specimen.value for specimen in specimens.values()])
    spread = float(np.std(values, ddof=1))
    parts = [BudgetLine("specimens", spread / values.size**0.5, values.size - 1.0)]
    every = [line for specimen in specimens.values() for line in specimen.lines]
    systematic = [line for line in every if line.shared is Shared.CALIBRATION]
    for name in sorted({line.name for line in systematic}):
        here = [(1.0 / values.size, line) for line in systematic if line.name == name]
        parts.append(together(here))
    serials = list(specimens)
    outliers = tuple(
        serial
        for index, serial in enumerate(serials)
        if _is_outlier(index, serials, specimens, values, same_calibration=same_calibration)
    )
    mean = budget(float(values.mean()), units.pop(), parts)
    return SpecimenComparison(key, dict(specimens), mean, spread, outliers)


def _is_outlier(
    index: int,
    serials: Sequence[str],
    specimens: Mapping[str, Budget],
    values: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
    *,
    same_calibration: bool,
) -> bool:
    """Return whether a specimen is far from the others' median, by scatter and by U."""
    others = np.delete(values, index)
    if others.size < 3:
        return False
    middle = float(np.median(others))
    robust = 1.4826 * float(np.median(np.abs(others - middle)))
    nearest = serials[
        int(np.argmin(np.where(np.arange(values.size) == index, inf, np.abs(values - middle))))
    ]
    change = change_between(
        "", specimens[nearest], specimens[serials[index]], same_calibration=same_calibration
    ).change
    distance = abs(float(values[index]) - middle)
    return distance > 3.0 * robust and distance > change.expanded_uncertainty()
