"""The interface of all compensation models: columns, checks, range."""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from numbers import Real
from typing import Any, ClassVar, Literal, Self, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import ThreadpoolController

from torquebench.compensation.checks import (
    WHOLE_SHARE,
    CalibrationPoints,
    check_points,
    point_weights,
    reduce_points,
)
from torquebench.compensation.columns import (
    FEATURES,
    FloatArray,
    by_names,
    explain_rejection,
    feature_column,
)
from torquebench.compensation.curve_uncertainty import student_widening
from torquebench.compensation.estimator import Between, Estimator, OneOf, Truth, parameter
from torquebench.compensation.state import decode_value, encode_value
from torquebench.elementwise import Values
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.progress import NO_PROGRESS, Progress


@functools.cache
def _thread_pools() -> ThreadpoolController:
    return ThreadpoolController()


def single_blas_thread() -> AbstractContextManager[object]:
    """Run linear algebra on one thread, because small matrices gain nothing from more.

    With matrices of a few hundred rows, further threads only wait: on two busy cores a fit to 600
    points took 2.0 s with BLAS's default and 0.09 s with one. One thread also makes results
    independent of the number of cores.
    """
    limit: AbstractContextManager[object] = _thread_pools().limit(limits=1, user_api="blas")
    return limit


FEWEST_POINTS = 5
"""Fewest points from which a curve's discrepancy is estimated."""
_Result = TypeVar("_Result")
_ROWS_AT_ONCE = 2048  # bounds a prediction's memory to the cache
_NOT_STORED = ("feature_names_in_", "tables_")  # follow from the stored state


class CompensationModel(Estimator, ABC):
    """Base of all compensation models: scikit-learn regressors from reading to true torque.

    ``fit(X, y)`` takes readings (and further columns) and the standard's torque, ``predict(X)``
    gives the compensated torque and, on demand, its standard uncertainty.

    A subclass declares further parameters by `parameter`, may override the minimum numbers of
    points and implements `_fit` and `_predict`. Both get checked float64 arrays in N·m, sorted by
    reading (so that a fit doesn't depend on the order of the rows), and do their own scaling.
    `_fit` sets `effective_parameters_` and `noise_nm_`. All attributes that end in one underscore
    and don't start with one are the model's state: floats, integers, strings, booleans, arrays,
    lists, tuples, dicts with string keys and dataclasses that are registered with `state.storable`.

    Parameters
    ----------
    range_nm : float, optional
        Range of the chain in N·m, the full scale (FS); by default the largest reading of the data.
        Readings outside the calibrated range are refused in any case.
    range_margin : float, default 0.02
        Share of the calibrated range by which a reading may lie outside it.
    outliers : {"downweight", "refuse", "keep"}, default "downweight"
        Treatment of outliers: warn (`OutlierWarning`) and raise their standard deviation to their
        deviation, raise `InputError`, or don't search for them.
    zeroed : bool, default False
        Whether readings count from the chain's zero, taken without load before each series: then
        the torque is 0 where a chain that was just zeroed reads 0. The hybrid uses it.

    Attributes
    ----------
    full_scale_nm_ : float
        `range_nm`, or the largest size of a reading in the data.
    reading_low_nm_, reading_high_nm_ : float
        Limits of the readings that `predict` accepts, margin included.
    points_ : int
        Number of calibration points that `fit` was given.
    outliers_ : list of Outlier
        Outliers among the points.
    noise_nm_ : float
        Standard deviation of a single calibration point about the model, in N·m.
    effective_parameters_ : float
        Number of parameters that the data determine.
    degrees_of_freedom_ : float
        Degrees of freedom of `noise_nm_`: points (after averaging) minus effective parameters.
    uncertainty_ : CurveUncertainty or None
        The curve's discrepancy from the truth and the scatter of readings; None for fewer than five
        points, where the covariance of the coefficients is used.

    Notes
    -----
    ``predict(X, return_std=True)`` gives the standard uncertainty of the model's curve, which
    `_fit` states as `uncertainty_`; a `FormModel` compares its curve with the hybrid's posterior.
    It doesn't contain the scatter of a single reading, which `scatter_at` states.
    """

    range_nm: float | None = parameter(None, Between(Real, 0, open_low=True), default=None)
    range_margin: float = parameter(Between(Real, 0, 1, open_high=True), default=0.02)
    outliers: str = parameter(
        OneOf(frozenset({"downweight", "refuse", "keep"})), default="downweight"
    )
    zeroed: bool = parameter(Truth(), default=False)

    kind: ClassVar[str] = ""
    """Name in `MODELS`; set by `register`."""
    complexity: ClassVar[int] = 50
    """Rank in the comparison: of equally good models, the one with the lower rank comes first."""
    used_features: ClassVar[tuple[str, ...]] = ("reading_nm",)
    """Columns that the model uses; others are ignored."""

    # ---- to be written by a subclass ------------------------------------------------------

    def _minimum_points(self) -> int:
        """Return the smallest number of points for a fit."""
        return 3

    def _minimum_distinct(self) -> int:
        """Return the smallest number of distinct readings for a fit."""
        return 3

    @abstractmethod
    def _fit(self, X: FloatArray, y: FloatArray, weights: FloatArray, progress: Progress) -> None:
        """Fit to checked points; a point's noise variance is noise² / weight."""

    @abstractmethod
    def _predict(self, X: FloatArray) -> FloatArray:
        """Return compensated torque."""

    def _coefficient_std(self, X: FloatArray) -> FloatArray:  # noqa: ARG002 # for kinds that know it
        """Return the curve's standard uncertainty by the covariance of its coefficients."""
        raise InputError(
            Message("a {name} curve without its uncertainty", self.name),
            "a model that was fitted with it",
            "fit it by `fit`",
        )

    def _noise_freedom(self, count: int) -> float:
        """Return the degrees of freedom of `noise_nm_`, from the number of averaged points."""
        return max(count - self.effective_parameters_, 1.0)

    # ---- the estimator's interface --------------------------------------------------------

    def fit(self, X: ArrayLike, y: ArrayLike, progress: Progress = NO_PROGRESS) -> Self:
        """Fit the model to calibration points.

        Parameters
        ----------
        X : array of shape (n, k), or data frame
            Columns of `FEATURES`; see `features`. A data frame is read by its columns' names.
        y : array of shape (n,)
            Torque of the standard in N·m.
        progress : Progress, optional
            Receiver of the share of the fit that is done, in steps of `SHARES`; only long fits
            report it.

        Raises
        ------
        InputError
            NaN, too few points, a constant reading, contradictory duplicates, torques beyond
            `range_nm`, an outlier (with ``outliers="refuse"``), a parameter out of its limits.
        """
        return self.fit_curve(X, y, progress)

    def fit_curve(self, X: ArrayLike, y: ArrayLike, progress: Progress = NO_PROGRESS) -> Self:
        """Fit the curve like `fit`, but without its discrepancy, for cross-validation."""
        self.check_parameters()
        self.uncertainty_, self.tables_ = None, {}
        X_checked, y_checked = self._validated(by_names(X), y)
        self.points_ = int(y_checked.size)
        points = CalibrationPoints(X_checked, y_checked, np.arange(y_checked.size)).sorted()
        check_points(
            points,
            self._minimum_points(),
            self._minimum_distinct(),
            model=self.kind or type(self).__name__,
        )
        self._set_range(points.reading, points.y)
        weights, self.outliers_ = point_weights(points, self.outliers)
        points, weights = reduce_points(points, weights, self.maximum_points, self.used_features)
        try:
            with single_blas_thread():
                self._fit(points.X, points.y, weights, progress)
        except np.linalg.LinAlgError as problem:
            raise InputError(
                Message(
                    "equations of {name} without a solution for these points", type(self).__name__
                ),
                "readings and standard values of the same order, in N·m",
                "check units and columns, or take a simpler model",
            ) from problem
        self.degrees_of_freedom_ = self._noise_freedom(points.y.size)
        return self

    @overload
    def predict(self, X: ArrayLike, return_std: Literal[False] = False) -> FloatArray: ...

    @overload
    def predict(self, X: ArrayLike, return_std: Literal[True]) -> tuple[FloatArray, FloatArray]: ...

    def predict(
        self, X: ArrayLike, return_std: bool = False
    ) -> FloatArray | tuple[FloatArray, FloatArray]:
        """Compensate readings.

        Parameters
        ----------
        X : array of shape (n, k)
            As many columns as `fit` was given, or reading and branch alone.
        return_std : bool, default False
            Whether to return the standard uncertainty of the model's curve as well.

        Returns
        -------
        torque_nm : float64 array of shape (n,)
            Compensated torque in N·m.
        standard_uncertainty_nm : float64 array of shape (n,)
            Only with `return_std`.

        Raises
        ------
        InputError
            NaN, another number of columns, a reading outside the calibrated range.
        """
        torque = np.concatenate(self._in_blocks(X, self._predict))
        return (torque, self.curve_uncertainty(X)) if return_std else torque

    def curve_uncertainty(self, X: ArrayLike) -> FloatArray:
        """Return the standard uncertainty of the model's curve alone, as `predict` returns it.

        Parameters
        ----------
        X : array of shape (n, k)
            As for `predict`.

        Returns
        -------
        float64 array of shape (n,), in N·m

        Raises
        ------
        InputError
            As `predict`.
        """
        return np.concatenate(self._in_blocks(X, self._curve_uncertainty))

    def _completed(self, X: ArrayLike) -> ArrayLike:
        """Return X with zeros for columns that only a fit uses, if it ends with the branch."""
        used = {*self.used_features} - {"series"}  # only a fit uses the series
        needed = 1 + max(map(FEATURES.index, used))
        alone = FEATURES.index("branch") + 1
        if needed <= alone < self.n_features_in_:
            complete = by_names(X)
            if isinstance(complete, np.ndarray) and complete.shape[1:] == (alone,):
                return np.pad(complete, ((0, 0), (0, self.n_features_in_ - alone)))
        return by_names(X, self.n_features_in_)

    def _in_blocks(self, X: ArrayLike, evaluate: Callable[[FloatArray], _Result]) -> list[_Result]:
        """Evaluate checked rows in blocks, and return the joined results."""
        self._require_fit()
        rows = self._validated_rows(self._completed(X))
        self._refuse_outside_range(rows[:, 0])
        with single_blas_thread():
            return [
                evaluate(rows[start : start + _ROWS_AT_ONCE])
                for start in range(0, len(rows), _ROWS_AT_ONCE)
            ]

    def _curve_uncertainty(self, X: FloatArray) -> FloatArray:
        """Return the standard uncertainty of `_predict`."""
        if self.uncertainty_ is None:
            return student_widening(self.degrees_of_freedom_) * self._coefficient_std(X)
        u, branch = X[:, 0] / self._unit_nm, feature_column(X, "branch")
        return np.asarray(self._unit_nm * self.uncertainty_.at(u, branch))

    @property
    def lacks_uncertainty(self) -> bool:
        """Whether the fitted curve has no uncertainty yet, and enough points to compute one."""
        return self.uncertainty_ is None and self.points_ >= FEWEST_POINTS

    @property
    def _unit_nm(self) -> float:
        """Unit of `uncertainty_` in N·m."""
        return self.full_scale_nm_

    def additional_torque(self, X: ArrayLike) -> FloatArray:
        """Return the additional torque, compensated torque - reading, in N·m.

        Parameters
        ----------
        X : array of shape (n, k)
            As for `predict`.

        Returns
        -------
        additional_torque_nm : float64 array of shape (n,)
        """
        torque = self.predict(X)
        return np.asarray(torque - np.asarray(by_names(X), dtype=np.float64)[:, 0])

    def score(self, X: ArrayLike, y: ArrayLike, sample_weight: ArrayLike | None = None) -> float:
        """Return the coefficient of determination R², for scikit-learn's validation.

        Folds without the ends of the range contain readings that `predict` refuses. Beyond the
        range, this method (and no other) uses the additional torque at its end.

        Parameters
        ----------
        X, y
            As for `fit`.
        sample_weight : array of shape (n,), optional
        """
        self._require_fit()
        rows = self._validated_rows(by_names(X, self.n_features_in_))
        within = rows.copy()
        within[:, 0] = np.clip(rows[:, 0], self.reading_low_nm_, self.reading_high_nm_)
        torque = self.predict(within) + (rows[:, 0] - within[:, 0])
        truth = np.asarray(y, dtype=np.float64).ravel()
        weights = np.ones(truth.size) if sample_weight is None else np.asarray(sample_weight)
        residual = float(np.sum(weights * (truth - torque) ** 2))
        variation = float(np.sum(weights * (truth - np.average(truth, weights=weights)) ** 2))
        return 1.0 - residual / variation if variation > 0.0 else float(residual == 0.0)

    def scatter_at(self, torque_nm: Values) -> Values:
        """Return the standard deviation of single readings at torques in N·m, shape (n,) or float.

        The scatter is the noise about the true torque. Points scatter more about a curve that can't
        follow the chain, but that deviation is part of the curve's uncertainty.
        """
        if self.uncertainty_ is None:
            return np.full(np.shape(torque_nm), self.noise_nm_)
        return self._unit_nm * self.uncertainty_.scatter_at(torque_nm / self._unit_nm)

    @property
    def scatter_nm(self) -> float:
        """Standard deviation of a single reading in N·m, root mean square over the range."""
        if self.uncertainty_ is None:
            return float(self.noise_nm_)
        return float(self._unit_nm * np.sqrt(np.mean(np.square(self.uncertainty_.scatter))))

    @property
    def scatter_freedom(self) -> float:
        """Degrees of freedom of `scatter_at`."""
        if self.uncertainty_ is None:
            return float(self.degrees_of_freedom_)
        if np.isnan(self.uncertainty_.freedom):  # version 0.2.0 stored none and used at least 4
            return max(self.degrees_of_freedom_, 4.0)
        return self.uncertainty_.freedom

    @property
    def doubtful(self) -> bool:
        """Whether the model may be worse than the raw reading, so that a fit has to check this."""
        return False

    @property
    def name(self) -> str:
        """The kind and what distinguishes its variants, as `make_model` takes it."""
        return self.kind

    def shortcoming(self, left_out_rms_nm: float) -> str:  # noqa: ARG002 # for kinds that know it
        """Explain large errors at held-out points; empty for kinds that can't explain them."""
        return ""

    @property
    def kind_parameters(self) -> dict[str, Any]:
        """Parameters of this kind of model, by name."""
        return self.get_params()

    def with_range(self, range_nm: float) -> Self:
        """Return an unfitted copy for a range in N·m, unless this one states its own."""
        return replace(self, range_nm=range_nm if self.range_nm is None else self.range_nm)

    # ---- state for the model file ---------------------------------------------------------

    def get_state(self) -> dict[str, Any]:
        """Return everything that makes up the fitted model as JSON-ready values.

        Returns
        -------
        state : dict
            Keys `kind`, `parameters`, `fitted`; `model_from_state` rebuilds the model bit for bit.
        """
        self._require_fit()
        fitted = {
            name: encode_value(value)
            for name, value in sorted(vars(self).items())
            if name.endswith("_") and not name.startswith("_") and name not in _NOT_STORED
        }
        parameters = {name: encode_value(value) for name, value in self.get_params().items()}
        return {"kind": self.kind, "parameters": parameters, "fitted": fitted}

    @classmethod
    def restored(cls, state: dict[str, Any]) -> Self:
        """Rebuild a fitted model of this class from `get_state`.

        Raises
        ------
        KeyError, TypeError, AttributeError, InputError
            When the state isn't complete.
        """
        model = cls(**{name: decode_value(value) for name, value in state["parameters"].items()})
        for name, value in state["fitted"].items():
            setattr(model, name, decode_value(value))
        model.tables_ = {}
        return model

    # ---- checks ---------------------------------------------------------------------------

    def _validated(self, X: ArrayLike, y: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return checked points; an error names the point that is wrong."""
        try:
            return self._checked_points(X, y)
        except ValueError as problem:
            raise explain_rejection(problem, X, y) from problem

    def _validated_rows(self, X: ArrayLike) -> FloatArray:
        """Return checked rows; an error names the row that is wrong."""
        try:
            return self._checked_rows(X)
        except ValueError as problem:
            raise explain_rejection(problem, X) from problem

    def _set_range(self, reading: FloatArray, torque: FloatArray) -> None:
        """Set full scale and the limits of the readings, margin included."""
        largest = float(np.max(np.abs(reading)))
        self.full_scale_nm_ = largest if self.range_nm is None else float(self.range_nm)
        beyond = float(np.max(np.abs(torque)))
        if self.range_nm is not None and beyond > (1.0 + self.range_margin) * self.full_scale_nm_:
            raise InputError(
                Message("calibration torque of {largest:.6g} N·m", beyond),
                Message(
                    "up to {full_scale_nm:.6g} N·m and {range_margin:.3g} % beyond",
                    self.full_scale_nm_,
                    100 * self.range_margin,
                ),
                "give the range that was calibrated, or leave the point out",
            )
        low, high = float(np.min(reading)), float(np.max(reading))
        margin = self.range_margin * self._reached(largest)
        if self.range_nm is not None:
            # Torques outside the calibrated readings are refused, whatever range is declared: a
            # direction that wasn't loaded, or torques above those of the calibration.
            low = -self._reached(-low) if low < -margin else 0.0
            high = self._reached(high) if high > margin else 0.0
        self.reading_low_nm_ = low - margin
        self.reading_high_nm_ = high + margin

    @property
    def calibrated_nm(self) -> float:
        """Largest torque in either direction that the model was calibrated to, N·m."""
        return max(-self.reading_low_nm_, self.reading_high_nm_) / (1.0 + self.range_margin)

    def _reached(self, largest_nm: float) -> float:
        """Return a direction's largest reading, N·m; full scale if the reading is close to it."""
        within = WHOLE_SHARE <= largest_nm / self.full_scale_nm_ <= 1.0 + self.range_margin
        return self.full_scale_nm_ if within else largest_nm

    def _refuse_outside_range(self, reading: FloatArray) -> None:
        """Refuse readings outside the calibrated range."""
        outside = (reading < self.reading_low_nm_) | (reading > self.reading_high_nm_)
        if np.any(outside):
            index = int(np.argmax(outside))
            raise InputError(
                Message(
                    "reading {reading:.6g} N·m (row {index}) outside the calibrated range",
                    reading[index],
                    index,
                ),
                Message(
                    "{low_nm:.6g} to {high_nm:.6g} N·m, margin included",
                    self.reading_low_nm_,
                    self.reading_high_nm_,
                ),
                "calibrate over the whole range that is measured",
            )
