"""The report of a calibration on the bench: its points, its model, and its loading."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from torquebench.bench.mounting_record import MountingRecord, mounting_facts
from torquebench.calibration import CalibrationData, summarise_errors
from torquebench.campaign.calibrating import FinishedCalibration
from torquebench.campaign.fitting import feature_columns
from torquebench.campaign.results import FitResult
from torquebench.figures import Curve
from torquebench.reports.curve_figures import Panel, panels_figure
from torquebench.reports.errors_table import number
from torquebench.reports.fit_report import fit_page
from torquebench.reports.module_report import staircase_figures
from torquebench.reports.page import Facts, Figure, Page, Section

__all__ = ["calibration_page", "error_curves", "loading_figures"]

LOADING_LIMIT_PERCENT = 0.1
"""Loading accuracy of the source papers, % of range."""


def calibration_page(finished: FinishedCalibration) -> Page:
    """Return the report of a calibration and of the model fitted to it."""
    measured, fitted = finished.measured, finished.fitted[0]
    data = measured.result.data
    torque = fitted.model.predict(data.features(feature_columns(fitted.model)))
    result = FitResult(
        source=f"{data.side} module, run {measured.record.run_id}",
        data=data,
        comparison=None,
        noise=data.noise_floor(),
        name=fitted.name,
        title=fitted.title,
        model=fitted.model,
        raw=summarise_errors(data.reading_nm, data.standard_nm, data.range_nm),
        fitted=summarise_errors(torque, data.standard_nm, data.range_nm),
        remarks=fitted.remarks,
        contradictions=fitted.contradictions,
    )
    page = fit_page(result)
    return replace(
        page,
        title=f"Calibration of the {data.side} module",
        sections=[*page.sections, _curves(finished), _loading(finished)],
    )


def _curves(finished: FinishedCalibration) -> Section:
    data = finished.measured.result.data
    figure = Figure(
        panels_figure([error_curves(data)]),
        "Reading minus standard at every step, without compensation.",
    )
    return Section("Error curves", "", (figure,))


def error_curves(data: CalibrationData, title: str = "") -> Panel:
    """Return curves of reading minus standard over |torque|, one per direction and branch."""
    curves = []
    for sign, direction in ((1, "clockwise"), (-1, "counter-clockwise")):
        for branch, word in ((1, "rising"), (-1, "falling")):
            rows = np.flatnonzero((np.sign(data.standard_nm) == sign) & (data.branch == branch))
            if rows.size:
                part = data.subset(rows[np.argsort(np.abs(data.standard_nm[rows]), kind="stable")])
                error = part.reading_nm - part.standard_nm
                curves.append(Curve(f"{direction}, {word}", np.abs(part.standard_nm), error))
    return Panel(curves, "|torque| in N·m", "error in N·m", range_nm=data.range_nm, title=title)


def _loading(finished: FinishedCalibration) -> Section:
    result = finished.measured.result
    data, profile = result.data, finished.profile
    accuracy = data.loading_accuracy_percent
    facts = [
        ("Profile", f"{profile.name} (SHA-256 {profile.sha256[:16]}…)"),
        ("Standard", result.standard_serial),
        ("Points that were still drifting", str(result.unsettled)),
    ]
    if accuracy is not None:
        facts.append(
            (
                "Loading accuracy",
                f"{number(accuracy)} % of range: largest difference of the standard from the "
                "torque that was asked for",
            )
        )
    facts += mounting_facts(MountingRecord.of_run(finished.measured.record.metadata))
    blocks: list[Facts | Figure] = [
        Facts(tuple(facts)),
        *loading_figures(data),
        *staircase_figures(data, "standard"),
    ]
    return Section("Loading", "", tuple(blocks))


def loading_figures(data: CalibrationData) -> list[Figure]:
    """Return the deviation of each step from its nominal torque; empty without nominal torques."""
    error = data.loading_error_percent
    if error is None:
        return []
    panel = Panel(
        [Curve("", np.arange(1.0, error.size + 1.0), error)],
        "step",
        "loading error in % of range",
        markers=True,
        limits=(-LOADING_LIMIT_PERCENT, LOADING_LIMIT_PERCENT),
    )
    side = f" of the {data.side} module" if data.side else ""
    return [
        Figure(
            panels_figure([panel], height=2.0),
            f"Loading{side}: standard minus the requested torque, at every step. "
            f"Dashed: ±{LOADING_LIMIT_PERCENT:g} % of range.",
        )
    ]
