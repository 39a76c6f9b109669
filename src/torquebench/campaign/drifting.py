"""Drift of one transducer over all its registered calibrations and checks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date, datetime, timedelta
from typing import Protocol

import numpy as np

from torquebench.calibration import (
    ControlChart,
    DriftPrediction,
    Trend,
    find_trend,
    individuals_chart,
    predict_drift,
    propose_due_date,
)
from torquebench.campaign.calibration_comparison import SAME_RANGE
from torquebench.chain import Inertia, MeasuredRotation, MeasuredTemperature, load_chain
from torquebench.message import Message
from torquebench.records import (
    CalibrationEntry,
    CheckEntry,
    Equipment,
    EquipmentKind,
    ModelEntry,
    Zeroing,
)

__all__ = ["DriftRecords", "DriftSeries", "drift_of", "next_due"]

LEAST_VALUES = 3
"""Smallest number of values for a control chart or a prediction."""

LEAST_SPAN = timedelta(days=1)
"""Shortest history for a prediction over months."""


@dataclass(frozen=True)
class DriftSeries:
    """One quantity of one transducer over time.

    Attributes
    ----------
    title, unit : str
        Name of the quantity, and its unit.
    moments, values : tuple
        Times and values, the oldest first.
    tolerance : float
        Tolerance in its unit, about the last calibration (which compensates the chain), or about
        the first zero or check.
    chart, trend, prediction : ControlChart, Trend, DriftPrediction or None
        None where there are too few values.
    calibrations : bool
        Whether the values come from calibrations, so that they set the due date.
    simulated : bool
        Whether any value was simulated.
    """

    title: str
    unit: str
    moments: tuple[datetime, ...]
    values: tuple[float, ...]
    tolerance: float
    chart: ControlChart | None
    trend: Trend | None
    prediction: DriftPrediction | None
    calibrations: bool
    simulated: bool

    def remark(self, row: int) -> str:
        """Return what the control chart shows about one value."""
        if self.chart is None:
            return ""
        remarks = []
        if row in self.chart.outside:
            remarks.append("outside the limits")
        if row in self.chart.jumps:
            remarks.append("a jump")
        if row in self.chart.runs:
            remarks.append("8 in a row on one side")
        return ", ".join(remarks)


class DriftRecords(Protocol):
    """Records of a transducer, from a bench's registry or from a plant's."""

    def calibrations(self, transducer_serial: str, /) -> list[CalibrationEntry]:
        """Return the transducer's calibrations."""

    def zeroings(self, transducer_serial: str, /) -> list[Zeroing]:
        """Return the transducer's zeros, the oldest first."""

    def checks(self, transducer_serial: str, /) -> list[CheckEntry]:
        """Return the transducer's quick checks, the oldest first."""

    def equipment(self, kind: EquipmentKind, /) -> list[Equipment]:
        """Return the known transducers."""


def drift_of(
    registry: DriftRecords,
    serial: str,
    *,
    tolerance_percent: float,
    base: int | None = None,
    models: Sequence[ModelEntry] = (),
) -> tuple[DriftSeries, ...]:
    """Return a transducer's drift: span, zero, checks, and effects of rotation.

    Parameters
    ----------
    registry : DriftRecords
        A `Registry`, or a plant's records of the transducer.
    serial : str
        The transducer.
    tolerance_percent : float
        Tolerance in % of the span, or of the range for zeros and checks.
    base : int, optional
        Number of first values that set the limits of the control charts; all by default.
    models : sequence of ModelEntry
        Models of the transducer; if two or more of them have empty runs, their effects over time
        are returned as well.
    """
    series: list[tuple[str, str, list[tuple[datetime, float, bool]], bool]] = []
    calibrations = sorted(registry.calibrations(serial), key=lambda entry: entry.performed)
    for limit, direction in ((1, "clockwise"), (0, "counter-clockwise")):
        spanned = [
            entry
            for entry in calibrations
            if direction in entry.summary.get("span_error_percent", {})
        ]
        groups = _of_one_range(spanned, limit)
        for reach_nm, entries in groups:
            values = [
                (
                    entry.performed,
                    float(entry.summary["span_error_percent"][direction]),
                    entry.simulated,
                )
                for entry in entries
            ]
            reach = Message(" up to {reach_nm:g} N·m", reach_nm) if len(groups) > 1 else ""
            series.append(
                (Message("Span error {direction}{reach}", direction, reach), "%", values, True)
            )
    ranges = {
        transducer.serial: transducer.range_nm for transducer in registry.equipment("transducer")
    }
    range_nm = ranges.get(serial)
    if range_nm:
        zeros = [
            (zero.performed, 100.0 * zero.zero_nm / range_nm, zero.simulated)
            for zero in _first_of_each_run(registry.zeroings(serial))
        ]
        series.append(("Zero", "% FS", zeros, False))
    checks = [
        (check.performed, float(check.summary["signed_worst_percent_fs"]), check.simulated)
        for check in registry.checks(serial)
        if "signed_worst_percent_fs" in check.summary
    ]
    series.append(("Largest error of the check standard's verification", "% FS", checks, False))
    performed = {entry.calibration_id: entry.performed for entry in calibrations}
    effects = _effects_over_time(models, performed)
    series += [(title, unit, values, False) for title, unit, values in effects]
    return tuple(
        _series(title, unit, values, tolerance_percent, base, calibrations=calibrated)
        for title, unit, values, calibrated in series
        if values
    )


def _effects_over_time(
    models: Sequence[ModelEntry], performed: Mapping[int, datetime]
) -> list[tuple[str, str, list[tuple[datetime, float, bool]]]]:
    """Return effects of temperature, rotation and inertia over time, from models with empty runs.

    `performed` maps the numbers of calibrations to their days. Speeds and accelerations are the
    largest ones that all models cover.
    """
    chains = [
        (entry, load_chain(entry.file))
        for entry in sorted(models, key=lambda each: performed[each.calibration_id])
        if _has_empty_runs(entry)
    ]
    rotations = [chain.find(MeasuredRotation) for _, chain in chains]
    inertias = [chain.find(Inertia) for _, chain in chains]
    rpm = min((max(each.speeds_rpm) for each in rotations if each is not None), default=0.0)
    rad_s2 = min((each.largest_rad_s2 for each in inertias if each is not None), default=0.0)
    series: dict[tuple[str, str], list[tuple[datetime, float, bool]]] = {}
    for (entry, chain), rotation, inertia in zip(chains, rotations, inertias, strict=True):
        percent = 100.0 / entry.range_nm
        values: dict[tuple[str, str], float] = {}
        warmth = chain.find(MeasuredTemperature)
        if warmth is not None and warmth.high_c > warmth.low_c:
            per_10k = 10.0 / (warmth.high_c - warmth.low_c)
            ends = [warmth.low_c, warmth.high_c]
            zero = float(np.diff(np.interp(ends, warmth.at_c, warmth.zero_nm))[0])
            values["Zero over temperature", "% FS per 10 K"] = percent * per_10k * zero
            if warmth.span:
                span = float(np.diff(np.interp(ends, warmth.at_c, warmth.span))[0])
                values["Span over temperature", "% per 10 K"] = 100.0 * per_10k * span
        if rotation is not None:
            for title, table, factor in (
                (Message("Zero at {rpm:g} 1/min", rpm), rotation.even_nm, 1.0),
                (
                    Message("Bearing drag at {rpm:g} 1/min", rpm),
                    rotation.odd_nm,
                    rotation.lubrication,
                ),
            ):
                columns = zip(*table, strict=True)
                at_speed = [np.interp(rpm, rotation.speeds_rpm, column) for column in columns]
                now = float(np.interp(rotation.calibrated_c, rotation.at_c, at_speed))
                values[title, "% FS"] = percent * factor * now
        if inertia is not None:
            torque = inertia.moment_nm_s2 * rad_s2
            values[Message("Inertia's torque at {acceleration:.3g} rad/s²", rad_s2), "% FS"] = (
                percent * torque
            )
        for name, size in values.items():
            moment = performed[entry.calibration_id]
            series.setdefault(name, []).append((moment, size, entry.simulated))
    return [(title, unit, known) for (title, unit), known in series.items() if len(known) > 1]


def _has_empty_runs(entry: ModelEntry) -> bool:
    """Return whether a model's file exists and states a measured effect, without loading it."""
    try:
        return '"measured ' in entry.file.read_text(encoding="utf-8")
    except OSError:
        return False


def _of_one_range(
    calibrations: list[CalibrationEntry], limit: int
) -> list[tuple[float, list[CalibrationEntry]]]:
    """Group calibrations by their largest torque, because spans over different ranges differ.

    `limit` selects the lower (0) or upper (1) end of each range. A chain's curve is nonlinear, so
    that its span over a part of the range is another one.
    """
    groups: list[tuple[float, list[CalibrationEntry]]] = []
    for entry in calibrations:
        reach_nm = abs(entry.valid_nm[limit])
        for known_nm, members in groups:
            if abs(reach_nm - known_nm) <= SAME_RANGE * max(reach_nm, known_nm):
                members.append(entry)
                break
        else:
            groups.append((float(f"{reach_nm:.3g}"), [entry]))
    return sorted(groups, key=lambda group: -group[0])


def _first_of_each_run(zeroings: list[Zeroing]) -> list[Zeroing]:
    """Return the first zero of each run: later zeros of a run show warming up, not drift."""
    seen: set[str] = set()
    first = []
    for zeroing in zeroings:
        if zeroing.run_id is None or zeroing.run_id not in seen:
            first.append(zeroing)
            seen.add(zeroing.run_id or "")
    return first


def _series(
    title: str,
    unit: str,
    known: list[tuple[datetime, float, bool]],
    tolerance: float,
    base: int | None,
    *,
    calibrations: bool,
) -> DriftSeries:
    """Return a quantity over time with the chart, trend and prediction that its values allow."""
    moments = [moment for moment, _, _ in known]
    values = [value for _, value, _ in known]
    enough = len(values) >= LEAST_VALUES
    chart = individuals_chart(values, min(base, len(values)) if base else None) if enough else None
    lasting = enough and max(moments) - min(moments) >= LEAST_SPAN
    return DriftSeries(
        title=title,
        unit=unit,
        moments=tuple(moments),
        values=tuple(values),
        tolerance=tolerance,
        chart=chart,
        trend=find_trend(moments, values) if lasting else None,
        prediction=predict_drift(
            moments, values, tolerance, centre=values[-1 if calibrations else 0]
        )
        if lasting and len(set(moments)) >= LEAST_VALUES
        else None,
        calibrations=calibrations,
        simulated=any(simulated for _, _, simulated in known),
    )


def next_due(found: tuple[DriftSeries, ...], *, longest_days: int) -> date | None:
    """Return the day of the next calibration: the earliest one that a span proposes.

    None if the transducer was never calibrated.
    """
    proposals = [
        propose_due_date(series.moments[-1], series.prediction, longest_days=longest_days)
        for series in found
        if series.calibrations
    ]
    return min(proposals, default=None)
