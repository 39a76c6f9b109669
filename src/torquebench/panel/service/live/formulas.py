"""Formulas of computed channels: an expression over live signals whose units are checked.

`simpleeval` walks the syntax tree; it gets numbers with units, names, arithmetic and four functions
only, so that a formula reaches nothing else.
"""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torquebench.message import Message
from torquebench.panel.service.live.hub import SIGNALS
from torquebench.units import (
    ARCMIN,
    DEGREE,
    NM_PER_RAD_OF_NM_PER_ARCMIN,
    RAD_S_PER_RPM,
    name_without_unit,
)

Array = NDArray[np.float64]
Powers = tuple[float, float, float]
"""Exponents of N·m, s and K in a unit; angles are numbers."""
BASES = ("N·m", "s", "K")
NUMBER: Powers = (0.0, 0.0, 0.0)
LARGEST_POWER = 6.0

RESULT_UNITS: Mapping[str, tuple[float, Powers]] = {
    "1": (1.0, NUMBER),
    "%": (0.01, NUMBER),
    "N·m": (1.0, (1.0, 0.0, 0.0)),
    "W": (1.0, (1.0, -1.0, 0.0)),
    "kW": (1e3, (1.0, -1.0, 0.0)),
    "rpm": (RAD_S_PER_RPM, (0.0, -1.0, 0.0)),
    "rad/s": (1.0, (0.0, -1.0, 0.0)),
    "rad/s²": (1.0, (0.0, -2.0, 0.0)),
    "°": (DEGREE, NUMBER),
    "arcmin": (ARCMIN, NUMBER),
    "rad": (1.0, NUMBER),
    "N·m/arcmin": (NM_PER_RAD_OF_NM_PER_ARCMIN, (1.0, 0.0, 0.0)),
    "kg·m²": (1.0, (1.0, 2.0, 0.0)),
    "s": (1.0, (0.0, 1.0, 0.0)),
    "°C": (1.0, (0.0, 0.0, 1.0)),
    "K": (1.0, (0.0, 0.0, 1.0)),
}
"""Units of signals and results: factor to N·m, rad, s and K, and exponents.

Temperatures count from 0 °C.
"""
_UNIT_NAMES = {
    "Nm": "N·m", "W": "W", "kW": "kW", "rpm": "rpm", "deg": "°", "rad": "rad", "s": "s", "K": "K",
}  # fmt: skip
FORMULA_NAMES: Mapping[str, str] = {name_without_unit(each.name): each.name for each in SIGNALS}
"""Signal by the name that formulas use."""
_UNITS = {each.name: each.unit for each in SIGNALS}


@dataclass(frozen=True, eq=False)
class _Quantity:
    """Values in N·m, rad, s and K with their unit."""

    value: Array | float
    powers: Powers = NUMBER

    def _like(self, other: _Quantity, value: Array | float) -> _Quantity:
        if self.powers != other.powers:
            raise ValueError(
                Message(
                    "{first} and {second} are added or compared: both need the same unit",
                    _unit_text(self.powers),
                    _unit_text(other.powers),
                )
            )
        return _Quantity(value, self.powers)

    def _raised(self, exponent: float) -> _Quantity:
        powers = tuple(exponent * power for power in self.powers)
        return _Quantity(np.power(self.value, exponent), (powers[0], powers[1], powers[2]))

    def __add__(self, other: _Quantity) -> _Quantity:
        return self._like(other, self.value + other.value)

    def __sub__(self, other: _Quantity) -> _Quantity:
        return self._like(other, self.value - other.value)

    def __mul__(self, other: _Quantity) -> _Quantity:
        (a, b, c), (d, e, f) = self.powers, other.powers
        return _Quantity(self.value * other.value, (a + d, b + e, c + f))

    def __truediv__(self, other: _Quantity) -> _Quantity:
        return self * other._raised(-1.0)

    def __pow__(self, other: _Quantity) -> _Quantity:
        exponent = np.max(other.value)
        if other.powers != NUMBER or np.ndim(other.value) or abs(exponent) > LARGEST_POWER:
            raise ValueError(
                Message("an exponent is a number between −{limit:g} and {limit:g}", LARGEST_POWER)
            )
        return self._raised(float(exponent))

    def __neg__(self) -> _Quantity:
        return _Quantity(-self.value, self.powers)

    def __pos__(self) -> _Quantity:
        return self


_OPERATORS: Mapping[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
_FUNCTIONS: Mapping[str, Callable[..., _Quantity]] = {
    "abs": lambda x: _Quantity(np.abs(x.value), x.powers),
    "sqrt": lambda x: x._raised(0.5),
    "min": lambda x, y: x._like(y, np.minimum(x.value, y.value)),
    "max": lambda x, y: x._like(y, np.maximum(x.value, y.value)),
}
_NODES = (ast.Name, ast.UnaryOp, ast.BinOp, ast.Call)


def _constant(node: ast.Constant) -> _Quantity:
    if not isinstance(node.value, int | float):
        raise TypeError(type(node.value).__name__)
    return _Quantity(np.float64(node.value))


def _unit_text(powers: Powers) -> str:
    parts = [f"{base}^{power:g}" for base, power in zip(BASES, powers, strict=True) if power]
    return "·".join(parts).replace("^1·", "·").removesuffix("^1") or "1"


@lru_cache(maxsize=256)
def _parsed(formula: str) -> ast.expr:
    try:
        return ast.parse(formula.strip(), mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        raise ValueError(Message("{formula!r} is not a formula", formula)) from None


def names_in(formula: str) -> tuple[str, ...]:
    """Return the live signals that a formula uses."""
    names = (node.id for node in ast.walk(_parsed(formula)) if isinstance(node, ast.Name))
    return tuple(dict.fromkeys(FORMULA_NAMES[name] for name in names if name in FORMULA_NAMES))


def computed(
    formula: str, unit: str, signals: Mapping[str, Array | float], ratio: float
) -> Array | float:
    """Return the values of a formula in a unit.

    Parameters
    ----------
    formula : str
        Expression over `FORMULA_NAMES`, units and ``ratio``.
    unit : str
        One of `RESULT_UNITS`.
    signals : mapping of str to float64[n] or float
        Values by the name of the signal, in its unit.
    ratio : float
        Ratio of the reducer.

    Returns
    -------
    float64[n] or float
        NaN where the formula has no finite value.

    Raises
    ------
    ValueError
        The formula can't be computed, or its unit is another one.

    Examples
    --------
    >>> signals = {"output_torque_nm": np.array([100.0]), "output_speed_rpm": np.array([30.0])}
    >>> computed("output_torque * output_speed", "W", signals, 100.0).round(2)
    array([314.16])
    """
    from simpleeval import InvalidExpression, SimpleEval

    def named(node: ast.Name) -> _Quantity:
        if node.id == "ratio":
            return _Quantity(ratio)
        if node.id in _UNIT_NAMES:
            return _Quantity(*RESULT_UNITS[_UNIT_NAMES[node.id]])
        signal = FORMULA_NAMES.get(node.id)
        if signal is None:
            raise ValueError(Message("there is no signal {name!r}", node.id))
        factor, powers = RESULT_UNITS[_UNITS[signal]]
        return _Quantity(factor * signals[signal], powers)

    evaluator = SimpleEval(dict(_OPERATORS), dict(_FUNCTIONS), named)
    evaluator.nodes = {kind: evaluator.nodes[kind] for kind in _NODES} | {ast.Constant: _constant}
    try:
        with np.errstate(all="ignore"):
            result = evaluator.eval(formula, _parsed(formula))
    except (InvalidExpression, TypeError, AttributeError, RecursionError):
        allowed = ", ".join(("+ − * / **", *_FUNCTIONS))
        raise ValueError(
            Message("{formula!r} has more than {allowed} and names", formula, allowed)
        ) from None
    factor, powers = RESULT_UNITS[unit]
    if not isinstance(result, _Quantity) or result.powers != powers:
        found = _unit_text(getattr(result, "powers", NUMBER))
        raise ValueError(
            Message(
                "{formula!r} is in {found}, which is no multiple of {unit}", formula, found, unit
            )
        )
    values = np.asarray(result.value, dtype=np.float64) / factor
    return np.where(np.isfinite(values), values, np.nan)[()]
