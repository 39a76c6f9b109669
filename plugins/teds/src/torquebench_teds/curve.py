"""Fit a data sheet's calibration curve to a compensation, and compute its error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench_teds.bits import Constant, Single
from torquebench_teds.templates import CALIBRATION_CURVE, TEMPLATES, TORQUE, Array, Field

if TYPE_CHECKING:
    from torquebench.compensation import CompensationTable
    from torquebench_teds.sheet import Section

__all__ = ["CurveFit", "fit_curve", "torque_span"]

FloatArray = NDArray[np.float64]

LARGEST_POWER = 9
"""Higher powers don't improve coefficients of 32 bits."""
_SEGMENTS_TRIED = (*range(1, 9), 10, 12, 16, 20, 24, 32, 40, 48, 64)
_ENOUGH = 0.9
"""The smallest curve is chosen whose residual is below the least residual divided by this."""
_NEGLIGIBLE = 1e-6
"""Share of full scale below which residuals count as equal."""
_READINGS = 2001


@dataclass(frozen=True)
class CurveFit:
    """A calibration curve of a compensation, with its error.

    Attributes
    ----------
    values : mapping
        Domain and segments of template 41.
    segments, power : int
        Number of segments, and the highest power.
    residual_nm : float
        Largest deviation of the curve, as it will be read from the memory, from the compensated
        torque where the branch isn't known, in N·m.
    branch_residual_nm : float
        Largest deviation from it on a known branch: one curve can't hold a hysteresis.
    range_nm : float
        Full scale.
    """

    values: Mapping[str, Any]
    segments: int
    power: int
    residual_nm: float
    branch_residual_nm: float
    range_nm: float

    @property
    def residual_percent_fs(self) -> float:
        """Residual in % of full scale."""
        return 100.0 * self.residual_nm / self.range_nm

    @property
    def branch_residual_percent_fs(self) -> float:
        """Residual on a known branch in % of full scale."""
        return 100.0 * self.branch_residual_nm / self.range_nm


def _field(array: Array, name: str) -> Any:
    return next(each for each in array.fields if each.name == name)


_SEGMENTS: Array = next(
    each for each in TEMPLATES[CALIBRATION_CURVE].fields if isinstance(each, Array)
)
_START: Field = _field(_SEGMENTS, "start_percent")
_TERMS: Array = _field(_SEGMENTS, "terms")
_MOST_SEGMENTS = (1 << _SEGMENTS.width) - 1


def curve_bits(segments: int, power: int) -> int:
    """Return how many bits of a memory a curve takes, without the calibration's date."""
    term = sum(each.kind.width for each in _TERMS.fields if isinstance(each, Field))
    return _SEGMENTS.width + segments * (_START.kind.width + _TERMS.width + (power + 1) * term)


def fit_curve(
    table: CompensationTable,
    span_nm: tuple[float, float],
    *,
    segments: int | None = None,
    power: int | None = None,
    most_bits: int | None = None,
) -> CurveFit:
    """Fit a calibration curve to a compensation.

    The curve is a function of the electrical value: of x, the reading's share of the electrical
    span (0 to 1), it gives the torque in % of the physical span, as amplifiers read it.

    Parameters
    ----------
    table : CompensationTable
    span_nm : tuple of float
        Lowest and highest torque of the sheet's bridge template in N·m.
    segments : int, optional
        Segments of equal width; by default as many as bring something.
    power : int, optional
        Highest power; by default as many as bring something.
    most_bits : int, optional
        Bits of the memory that are left for segments, see `curve_bits`; no limit by default. If not
        even one segment fits, the smallest curve is returned.

    Returns
    -------
    fit : CurveFit

    Raises
    ------
    InputError
        When the span isn't within the calibrated range, or a number is out of range.
    """
    low, high = span_nm
    if not low < high or low < table.reading_low_nm or high > table.reading_high_nm:
        raise InputError(
            Message("span {low:g} to {high:g} N·m of the sheet", low, high),
            Message(
                "within the calibrated {reading_low_nm:g} to {reading_high_nm:g} N·m",
                table.reading_low_nm,
                table.reading_high_nm,
            ),
            "set min_physical and max_physical, or calibrate over the whole span",
        )
    for name, number, most in (
        ("segments", segments, _MOST_SEGMENTS),
        ("power", power, LARGEST_POWER),
    ):
        if number is not None and not 1 <= number <= most:
            raise InputError(
                Message("{name} {number}", name, number),
                Message("1 to {most}", most),
                Message("give another --{name}", name),
            )
    sizes = sorted(
        (curve_bits(many, highest), many, highest)
        for many in (_SEGMENTS_TRIED if segments is None else (segments,))
        for highest in (range(1, LARGEST_POWER + 1) if power is None else (power,))
    )
    fitting = [each for each in sizes if most_bits is None or each[0] <= most_bits] or sizes[:1]
    fits = [_fitted(table, span_nm, many, highest) for _, many, highest in fitting]
    negligible = _NEGLIGIBLE * table.full_scale_nm
    enough = max(min(each.residual_nm for each in fits), negligible) / _ENOUGH
    return next(each for each in fits if each.residual_nm <= enough)


def _fitted(
    table: CompensationTable, span_nm: tuple[float, float], segments: int, power: int
) -> CurveFit:
    low, high = span_nm
    kind = _START.kind
    assert isinstance(kind, Constant)
    # segments begin at multiples of the memory's steps
    starts = [
        kind.decode(kind.encode(100.0 * number / segments, "start")) or 0.0
        for number in range(segments)
    ]
    edges = np.append(starts, 100.0) / 100.0
    pieces = []
    for start, left, right in zip(starts, edges[:-1], edges[1:], strict=True):
        # Chebyshev's points: their least-squares polynomial is close to the minimax one
        angle = np.pi * (np.arange(_READINGS // segments + 8 * power) + 0.5)
        share = 0.5 - 0.5 * np.cos(angle / angle.size)
        place = left + (right - left) * share
        percent = 100.0 * (table.torque(low + (high - low) * place) - low) / (high - low)
        fitted = np.polynomial.Polynomial.fit(place, percent, power, domain=[left, right])
        rounded = Single()
        coefficients = np.zeros(power + 1)
        found = fitted.convert().coef
        coefficients[: found.size] = found
        terms = [
            {
                "power": float(exponent),
                "coefficient": rounded.decode(rounded.encode(float(value), "coefficient")),
            }
            for exponent, value in enumerate(coefficients)
        ]
        pieces.append({"start_percent": start, "terms": terms})
    values = {"domain": "electrical", "segments": pieces}
    reading = np.linspace(low, high, _READINGS)
    torque = _evaluate(pieces, (reading - low) / (high - low), span_nm)
    residual = [
        float(np.max(np.abs(torque - table.torque(reading, np.full(reading.size, branch)))))
        for branch in (0, -1, 1)
    ]
    return CurveFit(values, segments, power, residual[0], max(residual[1:]), table.full_scale_nm)


def _evaluate(
    pieces: Sequence[Mapping[str, Any]], share: FloatArray, span: tuple[float, float]
) -> FloatArray:
    starts = np.array([each["start_percent"] for each in pieces]) / 100.0
    number = np.clip(np.searchsorted(starts, share, side="right") - 1, 0, None)
    percent = np.zeros_like(share)
    for index, piece in enumerate(pieces):
        here = number == index
        for term in piece["terms"]:
            percent[here] += term["coefficient"] * share[here] ** term["power"]
    return np.asarray(span[0] + (span[1] - span[0]) * percent / 100.0)


def torque_span(bridge: Section) -> tuple[float, float]:
    """Return the span of a bridge template's sensitivity, in N·m.

    Raises
    ------
    InputError
        When it measures something else, or states no span.
    """
    unit = bridge.values["measurand"]
    low, high = bridge.values["min_physical"], bridge.values["max_physical"]
    electrical = (bridge.values["min_electrical"], bridge.values["max_electrical"])
    if unit != TORQUE:
        raise InputError(Message("a bridge sensor in {unit}", unit), TORQUE, "set measurand to N·m")
    if low is None or high is None or not low < high:
        raise InputError(
            Message("span {low} to {high} N·m", low, high),
            "a lowest below a highest torque",
            "correct the sheet",
        )
    if None in electrical or electrical[0] == electrical[1]:
        raise InputError(
            Message(
                "electrical values {lower} and {upper} V/V",
                electrical[0],
                electrical[1],
            ),
            "two different ones",
            "correct min_electrical and max_electrical",
        )
    return low, high
