"""A fitted compensation model as a table for fast evaluation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.compensation.columns import FEATURES
from torquebench.compensation.piecewise import (
    LARGEST,
    Curve,
    PiecewisePolynomial,
    approximate,
)
from torquebench.errors import InputError
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.compensation.base import CompensationModel

FloatArray = NDArray[np.float64]


_UNCERTAINTY_TOLERANCE = 1e-6  # of full scale: uncertainties aren't known more closely
_FINE, _COARSE = 1e-6, 1e-5  # largest deviations of the torque, of full scale
_FINE_INTERVALS = 1 << 14


@dataclass(frozen=True)
class CompensationTable:
    """A compiled compensation model; made by `compile_table`.

    Attributes
    ----------
    curve : PiecewisePolynomial
        Compensated torque in N·m.
    uncertainty_curve : PiecewisePolynomial or None
        Standard uncertainty of the model's curve in N·m.
    kind : str
        Kind of the model.
    full_scale_nm : float
        Calibrated range in N·m.
    """

    curve: PiecewisePolynomial
    uncertainty_curve: PiecewisePolynomial | None
    kind: str
    full_scale_nm: float

    @property
    def reading_low_nm(self) -> float:
        """Lowest accepted reading in N·m."""
        return self.curve.low

    @property
    def reading_high_nm(self) -> float:
        """Highest accepted reading in N·m."""
        return self.curve.high

    @property
    def reach_nm(self) -> float:
        """Largest accepted reading in either direction, at most full scale, in N·m."""
        return min(self.full_scale_nm, max(-self.reading_low_nm, self.reading_high_nm))

    @property
    def bound_nm(self) -> float:
        """Largest possible deviation from the model in N·m."""
        return self.curve.bound

    def torque(
        self,
        reading_nm: ArrayLike,
        branch: ArrayLike | None = None,
        *,
        out: FloatArray | None = None,
    ) -> FloatArray:
        """Compensate readings, refusing any outside the calibrated range.

        Parameters
        ----------
        reading_nm : array_like of shape (n,)
            Readings in N·m.
        branch : array_like of shape (n,), optional
            -1, 0 or +1; unknown (0) where not given.
        out : float64 array of shape (n,), optional
            Array for the result; may be `reading_nm` itself.

        Returns
        -------
        torque_nm : float64 array of shape (n,)

        Raises
        ------
        InputError
            If readings are outside the range or NaN; the message has their number and the first
            one.
        """
        reading, signs = _reading(reading_nm), _branch(branch)
        # in place, the evaluation would overwrite the refused reading
        original = reading if out is None or not np.may_share_memory(out, reading) else None
        result = np.empty_like(reading) if out is None else out
        _require_same_shape(reading, signs, result)
        outside = self.curve.evaluate(reading, signs, result)
        if outside:
            detail = ""
            if original is not None:
                index = int(np.argmin(self._inside(original)))
                detail = Message(
                    ", the first {kept:.6g} N·m at position {index}", original[index], index
                )
            raise InputError(
                Message("{outside} readings outside the calibrated range{detail}", outside, detail),
                Message(
                    "{low_nm:.6g} to {high_nm:.6g} N·m, margin included",
                    self.reading_low_nm,
                    self.reading_high_nm,
                ),
                "calibrate over the whole range that is measured",
            )
        return result

    def standard_uncertainty(
        self, reading_nm: ArrayLike, branch: ArrayLike | None = None
    ) -> FloatArray:
        """Return the standard uncertainty of the model's curve.

        Parameters
        ----------
        reading_nm, branch
            As for `torque`; beyond the range, the uncertainty at its limit is returned.

        Returns
        -------
        standard_uncertainty_nm : float64 array of shape (n,)

        Raises
        ------
        InputError
            When the table was compiled without uncertainty.
        """
        if self.uncertainty_curve is None:
            raise InputError(
                "a table without uncertainty",
                "a table with uncertainty",
                "compile the model with its uncertainty",
            )
        reading, signs = _reading(reading_nm), _branch(branch)
        result = np.empty_like(reading)
        _require_same_shape(reading, signs, result)
        self.uncertainty_curve.evaluate(reading, signs, result)
        return result

    @cached_property
    def at(self) -> Callable[..., float]:
        """Return a function of a single reading in N·m and a branch, for plain Python.

        Examples
        --------
        >>> from torquebench.compensation import features, make_model
        >>> reading = np.linspace(-100.0, 100.0, 21)
        >>> model = make_model("polynomial").fit(features(reading), 1.01 * reading)
        >>> round(compile_table(model).at(50.0), 6)
        50.5
        """
        return _scalar_function(self.curve)

    def _inside(self, reading: FloatArray) -> NDArray[np.bool_]:
        return (reading >= self.reading_low_nm) & (reading <= self.reading_high_nm)


def compile_table(
    model: CompensationModel,
    *,
    tolerance: float | None = None,
    uncertainty: bool = True,
    branches: bool = True,
) -> CompensationTable:
    """Compile a fitted model to a table whose deviation is below a proved bound.

    Parameters
    ----------
    model : CompensationModel
        Fitted model of any kind.
    tolerance : float, optional
        Largest deviation of the torque, as a fraction of full scale; the standard uncertainty
        deviates by at most this fraction or 1e-6, whichever is larger. By default 1e-6, or 1e-5 if
        1e-6 needs more than 16,384 intervals: a loop that closes steeply would take minutes.
    uncertainty : bool, default True
        Whether to compile the standard uncertainty as well.
    branches : bool, default True
        Whether to compile the branches; without them it takes a third of the time, and every branch
        counts as unknown.

    Raises
    ------
    InputError
        When the model can't be followed within the tolerance (it jumps elsewhere than at zero).

    Examples
    --------
    >>> from torquebench.compensation import features, make_model
    >>> reading = np.linspace(-2000.0, 2000.0, 41)
    >>> standard = reading + 2e-3 * reading + 1e-6 * reading * abs(reading)
    >>> model = make_model("polynomial", per_direction=True).fit(features(reading), standard)
    >>> table = compile_table(model)
    >>> table.bound_nm < 1e-6 * 2000.0
    True
    """
    if tolerance is not None and not 0.0 < tolerance < 1.0:
        raise InputError(
            Message("table tolerance {tolerance:g}", tolerance), "above 0 and below 1 (full scale)"
        )
    columns = int(model.n_features_in_)
    branch_aware = branches and columns > 1 and "branch" in model.used_features

    def rows(reading: FloatArray, branch: int) -> FloatArray:
        """Return columns of a model at readings of one branch; 0 in further columns."""
        X = np.zeros((reading.size, columns))
        X[:, 0] = reading
        if columns > FEATURES.index("branch"):
            X[:, FEATURES.index("branch")] = branch
        return X

    def torque(reading: FloatArray, branch: int) -> FloatArray:
        return model.predict(rows(reading, branch))

    def deviation(reading: FloatArray, branch: int) -> FloatArray:
        return model.curve_uncertainty(rows(reading, branch))

    def follow(
        curve: Curve, gain: float, name: str, within: float, largest: int = LARGEST
    ) -> PiecewisePolynomial:
        """Approximate a curve of the model over its range by a piecewise polynomial."""
        limits = (float(model.reading_low_nm_), float(model.reading_high_nm_))
        return approximate(
            curve,
            limits,
            float(model.full_scale_nm_),
            within,
            gain=gain,
            branch_aware=branch_aware,
            name=f"{name} of the {model.kind or type(model).__name__} model",
            largest=largest,
        )

    def follow_torque() -> PiecewisePolynomial:
        """Follow the torque as finely as stated; coarsely if the fine table would be too long."""
        if tolerance is not None:
            return follow(torque, 1.0, "torque", tolerance)
        try:
            return follow(torque, 1.0, "torque", _FINE, _FINE_INTERVALS)
        except InputError:
            return follow(torque, 1.0, "torque", _COARSE)

    return CompensationTable(
        follow_torque(),
        follow(
            deviation, 0.0, "standard uncertainty", max(tolerance or 0.0, _UNCERTAINTY_TOLERANCE)
        )
        if uncertainty
        else None,
        model.kind,
        float(model.full_scale_nm_),
    )


def _scalar_function(curve: PiecewisePolynomial) -> Callable[..., float]:
    """Return a plain Python function: a NumPy or Numba call costs more than the arithmetic."""
    down, unknown, up = ([tuple(row) for row in rows] for rows in curve.coefficients.tolist())
    # indexed by the branch: -1 is the last item
    tables = (unknown, up, down)
    low, high, near, scale = curve.low, curve.high, curve.near, curve.scale
    # locations half an interval up, so that their integer part is the interval's number
    central_scale, zero = curve.scale + curve.extra, curve.zero + 0.5
    below, above = zero - near * curve.extra, zero + near * curve.extra

    def refuse(reading_nm: float) -> InputError:
        return InputError(
            Message("reading {reading_nm:.6g} N·m outside the calibrated range", reading_nm),
            Message("{low_nm:.6g} to {high_nm:.6g} N·m, margin included", low, high),
            "calibrate over the whole range that is measured",
        )

    def linear(reading_nm: float, branch: int = 0) -> float:
        """Return the torque of one reading from the table's straight lines."""
        if not low <= reading_nm <= high:
            raise refuse(reading_nm)
        if reading_nm > near:
            location = reading_nm * scale + above
        elif reading_nm < -near:
            location = reading_nm * scale + below
        else:
            location = reading_nm * central_scale + zero
        index = int(location)
        constant, slope = tables[branch][index]
        return float(reading_nm + (constant + slope * (location - index - 0.5)))

    def cubic(reading_nm: float, branch: int = 0) -> float:
        """Find the interval, which is shorter near zero, and evaluate its polynomial there."""
        if not low <= reading_nm <= high:
            raise refuse(reading_nm)
        if reading_nm > near:
            location = reading_nm * scale + above
        elif reading_nm < -near:
            location = reading_nm * scale + below
        else:
            location = reading_nm * central_scale + zero
        index = int(location)
        constant, slope, square, cube = tables[branch][index]
        offset = location - index - 0.5
        return float(reading_nm + (constant + offset * (slope + offset * (square + offset * cube))))

    return linear if curve.degree == 1 else cubic


def _reading(reading_nm: ArrayLike) -> FloatArray:
    reading = np.ascontiguousarray(reading_nm, dtype=np.float64)
    if reading.ndim != 1:
        raise InputError(Message("readings of shape {shape}", reading.shape), "one row of readings")
    return reading


def _branch(branch: ArrayLike | None) -> NDArray[np.int8] | None:
    """Return branches as signs of one byte; None stays."""
    if branch is None:
        return None
    branches = np.asarray(branch)
    if branches.dtype == np.int8:
        signs = np.ascontiguousarray(branches)
    else:
        signs = np.sign(branches).astype(np.int8)
    if signs.size and (int(signs.min()) < -1 or int(signs.max()) > 1):
        raise InputError(
            Message("a branch of {astype}", int(np.max(np.abs(signs.astype(int))))), "-1, 0 or +1"
        )
    return signs


def _require_same_shape(
    reading: FloatArray, branch: NDArray[np.int8] | None, out: FloatArray
) -> None:
    """Refuse branches or an output array that don't fit the readings."""
    if branch is not None and branch.shape != reading.shape:
        raise InputError(
            Message("{size} branches for {reading_size} readings", branch.size, reading.size),
            "one branch for each reading",
        )
    if out.shape != reading.shape or out.dtype != np.float64 or not out.flags.c_contiguous:
        raise InputError(
            Message("an output array of shape {shape} and type {dtype}", out.shape, out.dtype),
            Message("a contiguous float64 array of shape {shape}", reading.shape),
        )
