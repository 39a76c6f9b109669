"""Sensitivity coefficients: partial derivatives of a measurement function."""

from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["DerivativeMethod", "MeasurementFunction", "sensitivities"]

MeasurementFunction = Callable[..., Any]
"""f(x1, x2, ...) of the input quantities in their order; written with NumPy functions, it takes
floats, arrays and (for complex-step derivatives) complex numbers alike."""

DerivativeMethod = Literal["auto", "complex-step", "differences"]

_COMPLEX_STEP = 1e-30
_SHRINK = 1.4
_LEVELS = 10


def sensitivities(
    function: MeasurementFunction,
    values: Sequence[float],
    scales: Sequence[float],
    method: DerivativeMethod = "auto",
) -> NDArray[np.float64]:
    """Partial derivatives of `function` at `values`.

    Parameters
    ----------
    function : callable
        Measurement function of n floats.
    values : sequence of n floats
        Where the derivatives are taken.
    scales : sequence of n floats
        Over which each input is expected to vary (its standard uncertainty); sets the first step
        of the differences.
    method : {"auto", "complex-step", "differences"}
        ``complex-step`` is exact to rounding for functions that are analytic (no ``abs``, no
        comparison, no interpolation). ``differences`` extrapolates central differences
        (Ridders, Advances in Engineering Software 4, 1982). ``auto`` uses the complex step where
        the differences confirm it, else the differences.

    Returns
    -------
    ndarray of shape (n,)
        Derivatives.

    Raises
    ------
    InputError
        When the function is not finite around the point, or not analytic where
        ``complex-step`` is demanded.

    Examples
    --------
    >>> sensitivities(lambda a, b: a * np.exp(b), [2.0, 0.0], [0.1, 0.1]).round(9).tolist()
    [1.0, 2.0]
    """
    point = [float(value) for value in values]
    result = np.empty(len(point))
    for index, (value, scale) in enumerate(zip(point, scales, strict=True)):
        exact = None if method == "differences" else _complex_step(function, point, index)
        if method == "complex-step":
            if exact is None:
                raise InputError(
                    Message(
                        "the measurement function takes no complex number as input {index}",
                        index + 1,
                    ),
                    "a function of analytic NumPy operations",
                    'use method="differences"',
                )
            result[index] = exact
            continue
        extrapolated, error = _differences(function, point, index, abs(scale) or abs(value) or 1.0)
        if exact is None and not np.isfinite(extrapolated):
            raise InputError(
                Message(
                    "the measurement function is not finite around input {index} = {value:g}",
                    index + 1,
                    value,
                ),
                "finite results within the input's uncertainty",
            )
        # near a pole the differences fail, the complex step doesn't
        agrees = not np.isfinite(extrapolated) or abs((exact or 0.0) - extrapolated) <= max(
            10.0 * error, 1e-6 * abs(extrapolated), 1e-12
        )
        result[index] = exact if exact is not None and agrees else extrapolated
    return result


def _complex_step(function: MeasurementFunction, point: list[float], index: int) -> float | None:
    moved: list[complex] = [complex(value) for value in point]
    step = _COMPLEX_STEP * max(1.0, abs(point[index]))
    moved[index] += 1j * step
    try:
        with np.errstate(all="ignore"):
            outcome = function(*moved)
        derivative = float(np.imag(outcome)) / step
    except (TypeError, ValueError, AttributeError):
        return None
    return derivative if np.isfinite(derivative) else None


def _differences(
    function: MeasurementFunction, point: list[float], index: int, scale: float
) -> tuple[float, float]:
    """Return the derivative and its error by Ridders' extrapolated central differences."""
    # a step far below the value's own size would be lost in rounding
    step = max(0.5 * scale, 1e-3 * abs(point[index]))

    def slope(width: float) -> float:
        upper, lower = list(point), list(point)
        upper[index] += width
        lower[index] -= width
        try:
            with np.errstate(all="ignore"):
                rise = float(function(*upper)) - float(function(*lower))
        except ArithmeticError:
            return np.nan
        return rise / (upper[index] - lower[index])

    for _ in range(_LEVELS):
        if np.isfinite(slope(step)):
            break
        step /= 2.0
    previous = [slope(step)]
    best, error = previous[0], np.inf
    for _ in range(1, _LEVELS):
        step /= _SHRINK
        current = [slope(step)]
        factor = _SHRINK**2
        for below in previous:
            current.append((current[-1] * factor - below) / (factor - 1.0))
            factor *= _SHRINK**2
            estimate = max(abs(current[-1] - current[-2]), abs(current[-1] - below))
            if estimate <= error:
                best, error = current[-1], estimate
        if abs(current[-1] - previous[-1]) >= 2.0 * error:
            break
        previous = current
    return best, float(error)
