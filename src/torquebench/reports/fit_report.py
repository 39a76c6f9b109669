"""The report of a fit: errors before and after compensation, and a comparison of models, if any."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from torquebench.campaign.results import FitResult
from torquebench.compensation import Comparison, NetworkModel
from torquebench.figures import Curve, additional_torque_figure, error_figure
from torquebench.message import Message
from torquebench.reports.curve_figures import Panel
from torquebench.reports.errors_table import errors_table, number
from torquebench.reports.module_report import SOURCES_LIMIT_FS, branch_curves
from torquebench.reports.page import Diagram, Drawings, Facts, Page, Section, Table


def fit_page(result: FitResult) -> Page:
    """Return the report of a model that was fitted to one table.

    Parameters
    ----------
    result : FitResult
        The fit, with the comparison if requested.

    Returns
    -------
    Page
        Ready for `torquebench.reports.page.write_page`.
    """
    return Page(
        title="Compensation of a torque measuring chain",
        subtitle=Message(
            "{source} · {count} points · {range:g} N·m",
            result.source,
            len(result.data),
            result.data.range_nm,
        ),
        sections=[
            _data(result),
            *([] if result.comparison is None else [_comparison(result, result.comparison)]),
            *_training(result),
            _before_and_after(result),
        ],
        simulated=result.data.simulated,
    )


def _data(result: FitResult) -> Section:
    data = result.data
    noise = result.noise
    scatter = (
        "no step was repeated"
        if noise is None
        else Message(
            "{scatter} N·m (degrees of freedom: {freedom})",
            number(noise.standard_deviation_nm),
            noise.degrees_of_freedom,
        )
    )
    facts = Facts(
        (
            (
                "Points",
                Message("{count} in {series} series", len(data), len(np.unique(data.series))),
            ),
            ("Range", f"{data.range_nm:g} N·m"),
            ("Readings", "in N·m" if data.scale is None else data.scale.formula),
            ("Transducer", data.transducer_serial or "not stated"),
            ("Counter", data.counter_identity or "not stated"),
            ("Scatter of repeated points", scatter),
            ("Data SHA-256", data.sha256()),
        )
    )

    def draw() -> Iterator[tuple[str, str]]:
        curves = branch_curves(result.model, result.title, data.reading_nm)
        yield (
            additional_torque_figure(
                data.reading_nm, data.additional_torque_nm, data.branch, curves, data.range_nm
            ),
            Message(
                "Additional torque (standard minus reading) of each point, and the model "
                "{title!r} fitted to it.",
                result.title,
            ),
        )

    return Section("Calibration", "", (facts, Drawings(draw)))


def _training(result: FitResult) -> list[Section]:
    """Return the section with a network's training curve, if the model has one."""
    model = result.model
    if not isinstance(model, NetworkModel) or not model.training_curve_.size:
        return []
    curve = model.training_curve_
    parameters = [(name, f"{value}") for name, value in model.kind_parameters.items()]
    panel = Panel(
        [Curve("", curve[:, 0], curve[:, 1])],
        "epoch",
        "RMS of residuals in N·m",
        logarithmic="xy",
    )
    text = Message(
        "{epochs} epochs; the residuals of the points have an RMS of {rms} N·m.",
        int(curve[-1, 0]),
        number(float(curve[-1, 1])),
    )
    drawing = Diagram([panel], "Training of the network.")
    return [Section("Training", text, (Facts(tuple(parameters)), drawing))]


def _comparison(result: FitResult, comparison: Comparison) -> Section:
    rows = [
        (
            score.name,
            number(score.worst_nm),
            number(score.rms_nm),
            number(score.worst_percent_fs),
            number(score.rms_percent_fs),
            number(score.worst_averaged_nm),
            f"{score.effective_parameters:.3g}",
            score.reason,
        )
        for score in comparison.scores
    ]
    taken = next(
        index for index, score in enumerate(comparison.scores) if score.name == result.name
    )
    header = (
        "model",
        "worst, N·m",
        "RMS, N·m",
        "worst, % FS",
        "RMS, % FS",
        "worst step mean, N·m",
        "parameters",
        "verdict",
    )
    caption = Message(
        "Errors at steps that the models weren't fitted to: {folds} folds, {points} points in "
        "{steps} steps. The outermost steps always stay in, since a model never has to "
        "extrapolate.",
        comparison.folds,
        comparison.points,
        comparison.steps,
    )
    text = Message("Taken: {title}. The least error of many is partly luck.", result.title)
    refused = [(name, reason) for name, reason in comparison.refused.items()]
    blocks: list[Table | Facts] = [Table(header, rows, caption, taken)]
    if refused:
        blocks.append(Facts(refused))
    return Section("Comparison of models", text, blocks)


def _before_and_after(result: FitResult) -> Section:
    data = result.data
    residual_nm = (
        result.model.predict(data.features(result.model.n_features_in_)) - data.standard_nm
    )
    table = errors_table(
        [("raw reading", result.raw), (result.title, result.fitted)],
        "Errors against the standard, at the points to which the model was fitted.",
        1,
    )
    curves = [
        Curve("raw reading", data.standard_nm, -data.additional_torque_nm, raw=True),
        Curve(result.title, data.standard_nm, residual_nm),
    ]
    caption = (
        "Error before compensation (above) and residual after it (below), at the points "
        "of the fit. Dashed: 0.1 % FS."
    )
    drawing = Drawings(
        lambda: [(error_figure(curves, data.range_nm, limit_fs=SOURCES_LIMIT_FS), caption)]
    )
    text = "The model was fitted to these points: only fresh points can verify it."
    return Section("Before and after", text, (table, drawing))
