"""Report sections of one module: its calibration, its models and their verification."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from torquebench.calibration import CalibrationData, ErrorSummary
from torquebench.campaign.results import CompensationResult, ModuleResult
from torquebench.compensation import CompensationModel, features
from torquebench.figures import (
    Curve,
    additional_torque_figure,
    error_figure,
    group_figure,
    staircase_figure,
)
from torquebench.reports.errors_table import errors_table, module_errors, number, reference_name
from torquebench.reports.page import Facts, Figure, Section, Table

SOURCES_LIMIT_FS = 0.001
"""0.1 % of full scale: the accuracy of the published instrument (doi 10.1177/00202940221103308)."""

_CURVE_POINTS = 401


def branch_curves(
    model: CompensationModel, title: str, reading_nm: NDArray[np.float64]
) -> list[Curve]:
    """Return the curve of a model's additional torque over the range of its readings.

    Parameters
    ----------
    model : CompensationModel
        A fitted model.
    title : str
        Its name in the legend.
    reading_nm : numpy.ndarray of shape (n,)
        Readings that span the range, in N·m.

    Returns
    -------
    list of Curve
        One curve for a model without branches, otherwise one for each branch.
    """
    grid = np.linspace(float(np.min(reading_nm)), float(np.max(reading_nm)), _CURVE_POINTS)
    columns = model.n_features_in_
    if columns < 2 or "branch" not in model.used_features:
        return [Curve(title, grid, model.additional_torque(features(grid)[:, :columns]))]
    curves = []
    for branch, word in ((1, "rising"), (-1, "falling")):
        X = features(grid, branch=np.full(grid.size, branch), series=np.zeros(grid.size))
        curves.append(Curve(f"{title}, {word}", grid, model.additional_torque(X[:, :columns])))
    return curves


def conclusion(module: ModuleResult) -> str:
    """Return a sentence about the benefit of a module's compensation."""
    before, after = (
        number(_reference_errors(result).worst_percent_fs)
        for result in (module.raw, module.recommended)
    )
    count = len(module.verification)
    return f"{module.side} module: {before} → {after} % FS, verified on {count} fresh points"


def module_sections(module: ModuleResult) -> list[Section]:
    """Return the sections of one module: its errors, and details of calibration and verification.

    Parameters
    ----------
    module : ModuleResult
        The module's results.

    Returns
    -------
    list of Section
        Sections of calibration and verification.
    """
    name = f"{module.side.capitalize()} module"
    picture, *figures = _figures(module)
    table, *tables = _tables(module)
    said = conclusion(module)
    return [
        Section(f"{said[0].upper()}{said[1:]}", _verification_text(module), (picture, table)),
        Section(f"{name}: all errors", "", (*tables, *figures), detail=True),
        Section(
            f"{name}: calibration",
            _calibration_text(module),
            _calibration_blocks(module),
            detail=True,
        ),
    ]


def _calibration_text(module: ModuleResult) -> str:
    data = module.calibration
    return (
        f"{len(data)} steps against the calibrator, each the steady mean of its settled part, "
        f"in {len(np.unique(data.series))} series. Additional torque is what the chain between "
        "transducer and reducer swallows: standard minus reading."
    )


def _calibration_blocks(module: ModuleResult) -> list[Facts | Figure]:
    data = module.calibration
    facts = Facts(
        (
            ("Transducer", module.transducer_serial),
            ("Counter", module.counter_identity),
            ("Range", f"±{module.range_nm:g} N·m"),
            ("Profile", f"{module.profile_name} (SHA-256 {module.profile_hash[:16]}…)"),
            ("Recommended model", module.recommended.title),
            ("Records", ", ".join(module.run_ids)),
        )
    )
    recommended = module.recommended
    curves: list[Curve] = []
    if recommended.model is not None:
        curves = branch_curves(recommended.model, recommended.title, data.reading_nm)
    blocks: list[Facts | Figure] = [facts, *staircase_figures(data, "calibrator")]
    blocks.append(
        Figure(
            additional_torque_figure(
                data.reading_nm, data.additional_torque_nm, data.branch, curves, module.range_nm
            ),
            f"Additional torque of each step, and the model {recommended.title!r} fitted to it.",
        )
    )
    return blocks


def staircase_figures(data: CalibrationData, who: str) -> list[Figure]:
    """Draw the steps of the calibration over time; empty without times."""
    if data.time_s is None:
        return []
    return [
        Figure(
            staircase_figure(
                data.time_s - data.time_s[0],
                data.standard_nm,
                data.additional_torque_nm,
                data.range_nm,
            ),
            f"The staircase as the {who} read it, and the additional torque of each step.",
        )
    ]


def _verification_text(module: ModuleResult) -> str:
    groups = len(module.raw.verification.groups)
    worst = _reference_errors(module.recommended)
    return (
        f"{len(module.verification)} fresh readings in {groups} groups, none of them on a step of "
        f"the calibration. After the recommended model the worst error of a single reading against "
        f"the {reference_name(module)} is {number(worst.worst_nm)} N·m. Averages over the groups "
        "show what a model is worth once the noise of single readings is gone."
    )


def _reference_errors(result: CompensationResult) -> ErrorSummary:
    found = result.verification
    return found.against_standard if found.against_truth is None else found.against_truth


def _tables(module: ModuleResult) -> list[Table]:
    """Return errors by their reference; those that the conclusion states first."""
    parts = module_errors(module)
    parts.sort(key=lambda part: "against the " + reference_name(module) not in part[0])
    return [
        errors_table(
            [(result.title, errors) for result, errors in rows],
            f"{words[0].upper()}{words[1:]}.",
            next(place for place, (result, _) in enumerate(rows) if result.recommended),
        )
        for words, rows in parts
    ]


def _figures(module: ModuleResult) -> list[Figure]:
    data = module.verification
    reference = data.standard_nm if data.true_torque_nm is None else data.true_torque_nm
    results = (module.raw, *module.models)
    points = [
        Curve(r.title, reference, r.torque_nm - reference, raw=r is module.raw) for r in results
    ]
    figures = [
        Figure(
            error_figure(points, module.range_nm, limit_fs=SOURCES_LIMIT_FS, side=module.side),
            f"Error of every verification reading against the {reference_name(module)}: "
            "uncompensated above, compensated below. Dashed: 0.1 % FS.",
        ),
    ]
    dense = module.dense
    if dense is not None:
        curves = [
            Curve(
                r.title,
                dense.true_torque_nm,
                r.dense_torque_nm - dense.true_torque_nm,
                raw=r is module.raw,
            )
            for r in results
            if r.dense_torque_nm is not None
        ]
        figures.append(
            Figure(
                error_figure(
                    curves,
                    module.range_nm,
                    limit_fs=SOURCES_LIMIT_FS,
                    markers=False,
                    side=module.side,
                ),
                "Error of each model alone in a dense sweep without noise, increasing "
                "and decreasing in both directions. Dashed: 0.1 % FS.",
            )
        )
    worst = {
        r.title: np.array([group.worst_nm for group in r.verification.groups])
        for r in module.models
    }
    figures.append(
        Figure(
            group_figure(worst, module.range_nm, limit_fs=SOURCES_LIMIT_FS),
            f"Worst single reading of each group. {_repeatability(module)}",
        )
    )
    return figures


def _repeatability(module: ModuleResult) -> str:
    found = module.recommended.verification.repeatability
    if found is None:
        return ""
    return (
        f"Repeatability over the groups after the recommended model: "
        f"{number(found.pooled_nm)} N·m ({number(found.pooled_percent_fs)} % FS), at the worst "
        f"place {number(found.worst_nm)} N·m ({number(found.worst_percent_fs)} % FS); "
        f"{found.rule}."
    )
