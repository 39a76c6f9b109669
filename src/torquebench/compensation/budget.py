"""Uncertainty of compensated readings: the budget of one, and the same for whole streams.

    T = P · (1 + reference + drift + timebase + α_s ΔT_c) + F · α_z ΔT_z
        + scatter + hysteresis + zero + zero drift + counter

P is the model's prediction, F full scale, α_s and α_z the temperature coefficients of span and
zero, ΔT_c and ΔT_z the temperature changes since calibration and since zeroing. All corrections are
zero with an uncertainty. The model's own uncertainty and the scatter of a reading rest on the same
residuals of one fit, so their degrees of freedom count once.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.compensation.columns import features
from torquebench.errors import InputError
from torquebench.uncertainty import (
    COVERAGE_PROBABILITY,
    Budget,
    Quantity,
    Validation,
    check_by_monte_carlo,
    coverage_factor,
    propagate,
    welch_satterthwaite,
)

if TYPE_CHECKING:
    from torquebench.compensation.base import CompensationModel
    from torquebench.compensation.table import CompensationTable

__all__ = [
    "T40B_50_NM",
    "T40B_2000_NM",
    "ChainSpecification",
    "ReadingBudget",
    "ReadingConditions",
    "StreamUncertainty",
]

FloatArray = NDArray[np.float64]

_SAME_FIT = (("model", "scatter"),)
_HOURS_PER_YEAR = 8766.0
_RECTANGULAR = 1.0 / sqrt(3.0)
_ARCSINE = 1.0 / sqrt(2.0)


@dataclass(frozen=True)
class ChainSpecification:
    """What is known about a measuring chain besides its calibration, as limits or certificates.

    Parameters
    ----------
    reference_percent : float
        Expanded uncertainty of the calibration's reference, in % of the torque.
    reference_coverage_factor : float
        k of that uncertainty.
    temperature_span_percent_per_10k, temperature_zero_percent_per_10k : float
        Limits of the change of span (% of the torque) and zero (% of full scale).
    temperature_deviation_k : float
        Limit of what the temperature probe and the gradient to the transducer get wrong.
    drift_percent_per_year : float
        Limit of the change of span since the calibration, in % of the torque a year.
    zero_drift_percent_per_h : float
        Limit of the change of zero since it was taken, in % of full scale an hour.
    counter_nm : float
        Standard uncertainty of a reading by counting, in N·m.
    timebase_relative : float
        Limit of the relative change of the counter's clock since the calibration; 0 where the same
        clock calibrates and measures and is itself compared.
    """

    reference_percent: float
    temperature_span_percent_per_10k: float = 0.0
    temperature_zero_percent_per_10k: float = 0.0
    drift_percent_per_year: float = 0.0
    zero_drift_percent_per_h: float = 0.0
    counter_nm: float = 0.0
    timebase_relative: float = 0.0
    temperature_deviation_k: float = 0.5
    reference_coverage_factor: float = 2.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0.0 <= value < inf:
                raise InputError(f"{name} = {value}", "a finite number, 0 or more")
        if self.reference_coverage_factor == 0.0:
            raise InputError("reference_coverage_factor = 0", "above 0")


T40B_50_NM = ChainSpecification(0.02, 0.1, 0.1)
"""Transducer of the 50 N·m class, accuracy 0.1, with a 0.02 % reference."""

T40B_2000_NM = ChainSpecification(0.02, 0.05, 0.05)
"""Transducer of the 2 kN·m class, accuracy 0.05, with a 0.02 % reference."""


@dataclass(frozen=True)
class ReadingConditions:
    """Circumstances of a reading.

    Parameters
    ----------
    calibration_age_h, zero_age_h : float
        Hours since the calibration and since the zero was taken.
    temperature_change_calibration_k, temperature_change_zero_k : float
        Temperature now less that at the calibration and that when the zero was taken.
    zero_nm : float
        Standard uncertainty of the zero that was taken, in N·m.
    zero_degrees_of_freedom : float
        Of that uncertainty.
    averaged : float
        Number of independent readings behind this one: their scatter averages out.
    """

    calibration_age_h: float = 0.0
    zero_age_h: float = 0.0
    temperature_change_calibration_k: float = 0.0
    temperature_change_zero_k: float = 0.0
    zero_nm: float = 0.0
    zero_degrees_of_freedom: float = inf
    averaged: float = 1.0

    def __post_init__(self) -> None:
        for name in ("calibration_age_h", "zero_age_h", "zero_nm"):
            if not 0.0 <= getattr(self, name) < inf:
                raise InputError(f"{name} = {getattr(self, name)}", "a finite number, 0 or more")
        for name in ("temperature_change_calibration_k", "temperature_change_zero_k"):
            if not abs(getattr(self, name)) < inf:
                raise InputError(f"{name} = {getattr(self, name)}", "a finite number")
        if not self.averaged >= 1.0:
            raise InputError(f"averaged = {self.averaged}", "1 or more")


@dataclass(frozen=True)
class StreamUncertainty:
    """Uncertainty of many compensated readings.

    Attributes
    ----------
    standard_uncertainty_nm : float64 array of shape (n,)
        Combined standard uncertainty.
    degrees_of_freedom : float64 array of shape (n,)
        Effective.
    expanded_uncertainty_nm : float64 array of shape (n,)
        U = k·u with k from the effective degrees of freedom.
    contributions_nm : dict of str to float64 array of shape (n,)
        Contributions by the budget's names.
    """

    standard_uncertainty_nm: FloatArray
    degrees_of_freedom: FloatArray
    expanded_uncertainty_nm: FloatArray
    contributions_nm: dict[str, FloatArray]


@dataclass(frozen=True)
class ReadingBudget:
    """Budgets of the readings that a compensation model compensates.

    Parameters
    ----------
    model : CompensationModel
        Fitted model.
    specification : ChainSpecification
        What else is known about the chain.
    table : CompensationTable, optional
        The model compiled with its uncertainty, for streams.

    Examples
    --------
    >>> from torquebench.compensation import make_model
    >>> generator = np.random.default_rng(2)
    >>> standard = np.linspace(-2000.0, 2000.0, 50)
    >>> reading = standard / 1.003 + 0.3 * generator.standard_normal(50)
    >>> model = make_model("polynomial").fit(features(reading), standard)
    >>> budgets = ReadingBudget(model, T40B_2000_NM)
    >>> budget = budgets.budget(1500.0, conditions=ReadingConditions(zero_nm=0.05))
    >>> budget.dominant().name, round(budget.expanded_uncertainty(), 1)
    ('scatter', 0.8)
    """

    model: CompensationModel
    specification: ChainSpecification
    table: CompensationTable | None = None

    def quantities(
        self,
        reading_nm: float,
        branch: int = 0,
        conditions: ReadingConditions | None = None,
        hysteresis_nm: float | None = None,
    ) -> list[Quantity]:
        """List the input quantities of one reading.

        Parameters
        ----------
        reading_nm : float
            Reading in N·m.
        branch : {-1, 0, 1}
            0 where it isn't known.
        conditions : ReadingConditions, optional
            Just zeroed and calibrated where not given.
        hysteresis_nm : float, optional
            Half-width of what the unknown part of the history allows, from a
            `HistoryCompensator`; half the loop where the branch is unknown and nothing is given.

        Returns
        -------
        quantities : list of Quantity
            In the order of `measurement`.
        """
        now, known = conditions or ReadingConditions(), self.specification
        torque, deviation, loop = self._predicted(np.array([reading_nm]), np.array([branch]))
        # after long runs a reading lies on one of the branches rather than between them
        hysteresis = (
            Quantity.arcsine("hysteresis", 0.0, float(loop[0]), unit="N·m")
            if hysteresis_nm is None
            else Quantity.rectangular("hysteresis", 0.0, hysteresis_nm, unit="N·m")
        )
        freedom = self.degrees_of_freedom
        scatter = self.model.scatter_nm / sqrt(now.averaged)
        years = now.calibration_age_h / _HOURS_PER_YEAR
        full_scale = float(self.model.full_scale_nm_)
        zero_drift = 1e-2 * known.zero_drift_percent_per_h * now.zero_age_h * full_scale
        rectangular, change = Quantity.rectangular, known.temperature_deviation_k
        return [
            Quantity("model", float(torque[0]), float(deviation[0]), freedom, unit="N·m"),
            Quantity.from_certificate(
                "reference", 0.0, 1e-2 * known.reference_percent, known.reference_coverage_factor
            ),
            Quantity("scatter", 0.0, scatter, freedom, unit="N·m"),
            hysteresis,
            Quantity("zero", 0.0, now.zero_nm, now.zero_degrees_of_freedom, unit="N·m"),
            rectangular("zero drift", 0.0, zero_drift, unit="N·m"),
            rectangular(
                "span temperature coefficient",
                0.0,
                1e-3 * known.temperature_span_percent_per_10k,
                unit="1/K",
            ),
            rectangular(
                "temperature since calibration",
                now.temperature_change_calibration_k,
                change,
                unit="K",
            ),
            rectangular(
                "zero temperature coefficient",
                0.0,
                1e-3 * known.temperature_zero_percent_per_10k,
                unit="1/K",
            ),
            rectangular(
                "temperature since zeroing", now.temperature_change_zero_k, change, unit="K"
            ),
            Quantity("counter", 0.0, known.counter_nm, unit="N·m"),
            rectangular("timebase", 0.0, known.timebase_relative),
            rectangular("drift", 0.0, 1e-2 * known.drift_percent_per_year * years),
        ]

    def measurement(self, *inputs: Any) -> Any:
        """Compensated torque as a function of `quantities` in their order, by the module's formula.

        Parameters
        ----------
        *inputs : 13 floats or arrays of one shape

        Returns
        -------
        torque_nm : float or array
        """
        model, reference, scatter, hysteresis, zero, zero_drift = inputs[:6]
        span_coefficient, calibration_change, zero_coefficient, zero_change = inputs[6:10]
        counter, timebase, drift = inputs[10:]
        relative = reference + drift + timebase + span_coefficient * calibration_change
        zero_shift = self.model.full_scale_nm_ * zero_coefficient * zero_change
        offset = scatter + hysteresis + zero + zero_drift + counter + zero_shift
        return model * (1.0 + relative) + offset

    def budget(
        self,
        reading_nm: float,
        branch: int = 0,
        conditions: ReadingConditions | None = None,
        hysteresis_nm: float | None = None,
    ) -> Budget:
        """Return the uncertainty budget of one compensated reading by GUM.

        Parameters
        ----------
        reading_nm, branch, conditions, hysteresis_nm
            As for `quantities`.

        Returns
        -------
        Budget
            In N·m.

        Raises
        ------
        InputError
            When the reading is outside the calibrated range.
        """
        inputs = self.quantities(reading_nm, branch, conditions, hysteresis_nm)
        return propagate(self.measurement, inputs, shared_freedom=_SAME_FIT, unit="N·m")

    def check(
        self,
        reading_nm: float,
        branch: int = 0,
        conditions: ReadingConditions | None = None,
        hysteresis_nm: float | None = None,
        *,
        generator: np.random.Generator,
        significant_digits: int = 1,
    ) -> Validation:
        """Compare the budget by GUM with Monte Carlo, by the criterion of JCGM 101:2008, clause 8.

        Parameters
        ----------
        reading_nm, branch, conditions, hysteresis_nm
            As for `quantities`.
        generator : numpy.random.Generator
            Source of the draws.
        significant_digits : int
            Digits of the standard uncertainty that have to agree.

        Returns
        -------
        Validation
            Whether they agree; `sentence()` says it in words.
        """
        return check_by_monte_carlo(
            self.measurement,
            self.quantities(reading_nm, branch, conditions, hysteresis_nm),
            generator=generator,
            shared_freedom=_SAME_FIT,
            significant_digits=significant_digits,
            unit="N·m",
        )

    def stream(
        self,
        reading_nm: ArrayLike,
        branch: ArrayLike | None = None,
        conditions: ReadingConditions | None = None,
        hysteresis_nm: ArrayLike | None = None,
        coverage_probability: float = COVERAGE_PROBABILITY,
    ) -> StreamUncertainty:
        """Return the uncertainty of many readings under the same conditions, as `budget` has it.

        Parameters
        ----------
        reading_nm : array_like of shape (n,)
            Readings in N·m.
        branch : array_like of shape (n,), optional
            -1, 0 or +1.
        conditions : ReadingConditions, optional
            As for `quantities`.
        hysteresis_nm : array_like of shape (n,), optional
            Half-widths from a `HistoryCompensator`.
        coverage_probability : float
            Of the expanded uncertainty.

        Returns
        -------
        StreamUncertainty
        """
        reading = np.atleast_1d(np.asarray(reading_nm, dtype=np.float64))
        sides = np.zeros(reading.size) if branch is None else np.asarray(branch, dtype=np.float64)
        now, known = conditions or ReadingConditions(), self.specification
        torque, deviation, loop = self._predicted(reading, sides)
        within_loop = (
            loop * _ARCSINE
            if hysteresis_nm is None
            else np.asarray(hysteresis_nm, dtype=np.float64) * _RECTANGULAR
        )
        size, full_scale = np.abs(torque), float(self.model.full_scale_nm_)
        every = np.ones_like(size)
        years = now.calibration_age_h / _HOURS_PER_YEAR
        span = 1e-3 * known.temperature_span_percent_per_10k * _RECTANGULAR
        zero = 1e-3 * known.temperature_zero_percent_per_10k * _RECTANGULAR * full_scale
        zero_drift = 1e-2 * known.zero_drift_percent_per_h * now.zero_age_h * full_scale
        reference = 1e-2 * known.reference_percent / known.reference_coverage_factor
        contributions = {
            "model": deviation,
            "reference": reference * size,
            "scatter": every * self.model.scatter_nm / sqrt(now.averaged),
            "hysteresis": within_loop,
            "zero": every * now.zero_nm,
            "zero drift": every * zero_drift * _RECTANGULAR,
            "span temperature coefficient": span * abs(now.temperature_change_calibration_k) * size,
            "zero temperature coefficient": every * zero * abs(now.temperature_change_zero_k),
            "counter": every * known.counter_nm,
            "timebase": known.timebase_relative * _RECTANGULAR * size,
            "drift": 1e-2 * known.drift_percent_per_year * years * _RECTANGULAR * size,
        }
        same_fit = np.hypot(contributions["model"], contributions["scatter"])
        rest = [part for name, part in contributions.items() if name not in _SAME_FIT[0]]
        freedom = [
            now.zero_degrees_of_freedom if name == "zero" else inf
            for name in contributions
            if name not in _SAME_FIT[0]
        ]
        parts = np.stack([same_fit, *rest], axis=-1)
        effective = welch_satterthwaite(parts, [self.degrees_of_freedom, *freedom])
        combined = np.sqrt(np.sum(np.square(parts), axis=-1))
        expanded = coverage_factor(effective, coverage_probability) * combined
        return StreamUncertainty(combined, effective, expanded, contributions)

    @property
    def degrees_of_freedom(self) -> float:
        """Degrees of freedom of the fit's scatter: points less effective parameters, at least 1."""
        return max(float(self.model.points_) - float(self.model.effective_parameters_), 1.0)

    def _predicted(
        self, reading: FloatArray, branch: NDArray[np.floating | np.integer]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Torque, the curve's standard uncertainty, and half the loop where the branch is unknown.

        With an unknown branch, a model's own uncertainty holds half the loop already: here it is
        taken on the branches, so that the loop counts once.
        """
        up, up_deviation = self._evaluate(reading, np.ones(reading.size))
        down, down_deviation = self._evaluate(reading, -np.ones(reading.size))
        unknown = branch == 0
        torque = np.where(unknown, 0.5 * (up + down), np.where(branch > 0, up, down))
        deviation = np.where(branch > 0, up_deviation, down_deviation)
        deviation = np.where(unknown, np.maximum(up_deviation, down_deviation), deviation)
        return torque, deviation, np.where(unknown, 0.5 * np.abs(up - down), 0.0)

    def _evaluate(self, reading: FloatArray, branch: FloatArray) -> tuple[FloatArray, FloatArray]:
        if self.table is not None:
            signs = branch.astype(np.int8)
            torque = self.table.torque(reading, signs)
            return torque, self.table.standard_uncertainty(reading, signs)
        X = np.zeros((reading.size, int(self.model.n_features_in_)))
        X[:, :2] = features(reading, branch)[:, : X.shape[1]]
        return self.model.predict(X, return_std=True)
