"""Results at each step, before and after compensation, with their uncertainty budget."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

from torquebench.calibration import CalibrationData, tare
from torquebench.chain import (
    Component,
    Inertia,
    MeasuredRotation,
    MeasuredTemperature,
    MeasuringChain,
    Readings,
    Shared,
)
from torquebench.chain import Reference as ReferenceEffect
from torquebench.compensation import make_model
from torquebench.message import Message
from torquebench.reports.certificate.record import (
    BudgetRow,
    Conformity,
    Reference,
    ResultRow,
    TurningBudget,
)
from torquebench.uncertainty import (
    Budget,
    BudgetLine,
    Decision,
    Distribution,
    Tolerance,
    Verdict,
    decide,
)
from torquebench.units import RPM_PER_RAD_S

TEMPERATURE_PERCENT_PER_10K = 0.1
"""Temperature drift of zero and span during a calibration, by HBK T40B's data sheet, class 0.1."""


@dataclass(frozen=True)
class Results:
    """Results of a calibration for its certificate.

    Parameters
    ----------
    rows : tuple of ResultRow
        In rising order of torque, increasing before decreasing.
    budget : tuple of BudgetRow
        Budget of the step with the largest uncertainty (after compensation, if there is one).
    budget_step, budget_freedom
        Index of that step in `rows`, and its effective degrees of freedom.
    conformity : Conformity or None
    """

    rows: tuple[ResultRow, ...]
    budget: tuple[BudgetRow, ...]
    budget_step: int
    budget_freedom: float | None
    conformity: Conformity | None


def evaluate_results(
    data: CalibrationData,
    chain: MeasuringChain | None,
    reference: Reference,
    *,
    tolerance_percent_fs: float | None,
    resolution_nm: float = 0.0,
) -> Results:
    """Evaluate errors and uncertainties at each step, raw and compensated, and the verdict.

    The error is indication minus standard, averaged over the series in which the step was loaded.
    After compensation, U is the measuring chain's uncertainty of a mean over these loadings, as
    `apply` and every other interface state it. Before compensation, U contains the scatter between
    the series, or with one series the scatter about a smooth curve.

    Parameters
    ----------
    data : CalibrationData
        The points of the calibration.
    chain : MeasuringChain or None
        Chain fitted to the points; None evaluates the errors of the reading only.
    reference : Reference
        The reference standard by the certificate that was valid on the day of the calibration.
    tolerance_percent_fs : float or None
        Largest allowed |error| after compensation (without compensation, of the raw error), in % of
        full scale; None without a tolerance.
    resolution_nm : float, default 0
        Resolution of an indication that a person read off; 0 if the scatter contains it already.

    Raises
    ------
    InputError
        Where a reading is outside the model's range.
    """
    steps = _Steps.of(data)
    before = _Raw(tare(data).data, steps, resolution_nm)
    after = None if chain is None else _Compensated(data, steps, chain, reference, resolution_nm)
    certified_nm = reference.uncertainty(data.range_nm).at(steps.torque_nm)
    rows: list[ResultRow] = []
    decisions: list[Decision] = []
    budgets: list[Budget] = []
    for place in range(len(steps)):
        raw = before.budget(place, float(certified_nm[place]))
        compensated = None if after is None else after.budget(place)
        judged = compensated or raw
        decision = None
        if tolerance_percent_fs is not None:
            decision = decide(
                judged.value,
                judged.expanded_uncertainty(),
                Tolerance(-tolerance_percent_fs, tolerance_percent_fs, "full scale"),
                full_scale=data.range_nm,
                degrees_of_freedom=judged.degrees_of_freedom,
            )
            decisions.append(decision)
        rows.append(steps.row(place, data, raw, compensated, decision))
        budgets.append(judged)
    largest = int(np.argmax([budget.expanded_uncertainty() for budget in budgets]))
    conformity = None
    if tolerance_percent_fs is not None:
        error_nm, expanded_nm, _ = zip(*(row.judged for row in rows), strict=True)
        torque_nm = [row.torque_nm for row in rows]
        conformity = conformity_of(
            error_nm, expanded_nm, torque_nm, decisions, tolerance_percent_fs
        )
    return Results(
        rows=tuple(rows),
        budget=_budget_rows(budgets[largest]),
        budget_step=largest,
        budget_freedom=_freedom(budgets[largest].degrees_of_freedom),
        conformity=conformity,
    )


def turning_range(chain: MeasuringChain) -> str:
    """Name the speeds, temperatures and accelerations at which effects were measured; else ""."""
    said = []
    for each in chain.stored:
        if isinstance(each, MeasuredRotation):
            said.append(
                Message("speeds of {low:.4g} to {high:.4g} rpm", each.low_rpm, each.high_rpm)
            )
        elif isinstance(each, MeasuredTemperature):
            said.append(
                Message("temperatures of {low:.3g} to {high:.3g} °C", each.low_c, each.high_c)
            )
        elif isinstance(each, Inertia):
            rate = each.largest_rad_s2 * RPM_PER_RAD_S
            said.append(Message("changes of speed up to {rate:.3g} rpm/s", rate))
    return Message.joined(said)


def turning_budget(
    data: CalibrationData, chain: MeasuringChain, reference: Reference
) -> TurningBudget | None:
    """Return a rotating chain's budget at the largest torque, speed and temperature difference.

    Parameters
    ----------
    data : CalibrationData
        Points of the calibration.
    chain : MeasuringChain
    reference : Reference
    """
    rotation = chain.find(MeasuredRotation)
    if rotation is None:
        return None
    farthest = max((rotation.low_c, rotation.high_c), key=lambda c: abs(c - rotation.calibrated_c))
    fastest = max((rotation.low_rpm, rotation.high_rpm), key=abs)
    largest = float(data.reading_nm[np.argmax(np.abs(data.standard_nm))])
    torque = chain_against(reference, data.range_nm, chain).torque(
        Readings(
            np.array([largest]),
            branch=np.ones(1),
            speed_rpm=fastest,
            temperature_c=farthest,
            acceleration_rad_s2=0.0,
            zero_age_h=0.0,
            zero_temperature_c=rotation.calibrated_c,
            time_s=np.zeros(1),
        )
    )
    budget = torque.budget()
    return TurningBudget(
        float(torque.value_nm[0]),
        fastest,
        farthest,
        _budget_rows(budget),
        budget.expanded_uncertainty(),
        budget.coverage_factor(),
    )


@dataclass(frozen=True, eq=False)
class _Steps:
    """Groups points into steps of equal nominal torque and branch."""

    label: NDArray[np.intp]
    torque_nm: NDArray[np.float64]
    branch: NDArray[np.int8]
    count: NDArray[np.intp]

    @classmethod
    def of(cls, data: CalibrationData) -> "_Steps":
        nominal = data.standard_nm if data.nominal_nm is None else data.nominal_nm
        direction = data.loading_direction().astype(np.float64)
        rounded = np.round(nominal / data.range_nm, 9) * data.range_nm
        # The zeros of the clockwise and the counter-clockwise loop are separate steps.
        rounded = np.where(rounded == 0.0, np.copysign(0.0, direction), rounded)
        keys = np.stack([rounded, direction, -data.branch.astype(np.float64)], axis=1)
        _, first, label = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        label = label.reshape(-1)
        return cls(label, rounded[first], data.branch[first], np.bincount(label))

    def __len__(self) -> int:
        return int(self.count.size)

    def mean(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.bincount(self.label, weights=values) / self.count

    def row(
        self,
        place: int,
        data: CalibrationData,
        raw: Budget,
        compensated: Budget | None,
        judged: Decision | None,
    ) -> ResultRow:
        after = (None, None, None) if compensated is None else _stated(compensated)
        return ResultRow(
            torque_nm=float(self.torque_nm[place]),
            branch=int(self.branch[place]),
            standard_nm=float(self.mean(data.standard_nm)[place]),
            readings=int(self.count[place]),
            error_before_nm=raw.value,
            expanded_before_nm=raw.expanded_uncertainty(),
            factor_before=raw.coverage_factor(),
            error_after_nm=after[0],
            expanded_after_nm=after[1],
            factor_after=after[2],
            verdict=None if judged is None else judged.verdict,
        )


def _stated(budget: Budget) -> tuple[float, float, float]:
    return budget.value, budget.expanded_uncertainty(), budget.coverage_factor()


class _Compensated:
    """Errors after compensation, and their uncertainty."""

    def __init__(
        self,
        data: CalibrationData,
        steps: _Steps,
        chain: MeasuringChain,
        reference: Reference,
        resolution_nm: float,
    ) -> None:
        self.torque = chain_against(reference, data.range_nm, chain).torque(data.readings())
        if resolution_nm > 0.0:  # of the indication and of the zero, together
            half_width = resolution_nm / sqrt(2.0)
            self.torque = self.torque.and_also(
                Component(
                    "resolution of indication and zero",
                    Shared.CALIBRATION,
                    half_width / sqrt(3.0),
                    distribution=Distribution.RECTANGULAR,
                )
            )
        self.steps, self.series = steps, data.series
        self.standard_nm = steps.mean(data.standard_nm)

    def budget(self, place: int) -> Budget:
        """Return the budget of the error at one step: mean torque minus standard."""
        here = np.flatnonzero(self.steps.label == place)
        mean = self.torque.at(here).combined(
            np.full(here.size, 1.0 / here.size), zeroing=self.series[here]
        )
        return replace(mean, value_nm=mean.value_nm - self.standard_nm[place]).budget()


def chain_against(reference: Reference, range_nm: float, chain: MeasuringChain) -> MeasuringChain:
    """Return the chain with the reference standard that a certificate names."""
    record = f"certificate {reference.certificate_number} of {reference.serial}"
    certified = reference.uncertainty(range_nm)
    known = chain.find(ReferenceEffect)
    if known is None:
        known = ReferenceEffect(record, certified)
    return chain.with_effects([replace(known, record=record, certified=certified)])


class _Raw:
    """The errors of the reading, and their uncertainty."""

    def __init__(self, data: CalibrationData, steps: _Steps, resolution_nm: float) -> None:
        error_nm = data.reading_nm - data.standard_nm
        self.range_nm, self.resolution_nm = data.range_nm, resolution_nm
        self.error_nm = steps.mean(error_nm)
        self.count = steps.count
        repeated = int(np.sum(steps.count - 1))
        if repeated:
            left = error_nm - self.error_nm[steps.label]
            self.scatter_nm = sqrt(float(np.sum(left**2)) / repeated)
            self.freedom = float(repeated)
        else:  # the scatter about a smooth curve
            smooth = make_model("polynomial", degree=3, range_nm=data.range_nm)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # the fit only estimates the scatter
                smooth.fit(data.features(2), data.standard_nm)
            self.scatter_nm = smooth.scatter_nm
            self.freedom = float(smooth.degrees_of_freedom_)
        returned = data.unloaded & (data.branch < 0)
        self.zero_nm = float(np.max(np.abs(error_nm[returned]))) if np.any(returned) else None
        temperature = data.temperature_c
        self.drift_k = None if temperature is None else float(np.ptp(temperature))

    def budget(self, place: int, reference_nm: float) -> Budget:
        """Return the budget of the error at one step, a sum with all sensitivities 1."""
        error_nm, count = float(self.error_nm[place]), float(self.count[place])
        lines = [
            BudgetLine(
                "repeatability and noise",
                self.scatter_nm / sqrt(count),
                self.freedom,
                value=error_nm,
            ),
            BudgetLine("reference standard", reference_nm / 2.0),
        ]
        if self.zero_nm is not None:
            lines.append(BudgetLine.rectangular("zero return", self.zero_nm / 2.0))
        if self.resolution_nm > 0.0:  # of the indication and of the zero, together
            half_width = self.resolution_nm / sqrt(2.0)
            lines.append(BudgetLine.rectangular("resolution of indication and zero", half_width))
        if self.drift_k is not None:
            share = TEMPERATURE_PERCENT_PER_10K / 100.0 * self.drift_k / 10.0
            half_width = share * self.range_nm / 2.0
            name = "temperature drift during the calibration"
            lines.append(BudgetLine.rectangular(name, half_width))
        return Budget.of(error_nm, "N·m", lines)


def _budget_rows(budget: Budget) -> tuple[BudgetRow, ...]:
    return tuple(
        BudgetRow(
            name=line.name,
            distribution=Distribution(line.distribution).value,
            standard_uncertainty_nm=line.standard_uncertainty,
            degrees_of_freedom=_freedom(line.degrees_of_freedom),
            share=line.share,
        )
        for line in budget.lines
        if line.standard_uncertainty > 0.0
    )


def _freedom(value: float) -> float | None:
    return None if value == inf or value > 1e6 else float(value)


def conformity_of(
    error_nm: Sequence[float],
    expanded_nm: Sequence[float],
    torque_nm: Sequence[float],
    decisions: Sequence[Decision],
    tolerance_percent_fs: float,
    *,
    fresh: bool = False,
) -> Conformity:
    """Return the statement of conformity, decided by the worst step or verification point."""
    found = [decision.verdict for decision in decisions]
    deciding = max(
        range(len(found)),
        key=lambda place: (found[place].severity, abs(error_nm[place]) + expanded_nm[place]),
    )
    return Conformity(
        tolerance_percent_fs=tolerance_percent_fs,
        verdict=found[deciding],
        worst_error_nm=float(error_nm[deciding]),
        expanded_nm=float(expanded_nm[deciding]),
        at_nm=float(torque_nm[deciding]),
        counts={verdict.value: found.count(verdict) for verdict in Verdict if verdict},
        fresh=fresh,
    )
