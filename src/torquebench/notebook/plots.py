"""Draw calibrations, compensations and comparisons in notebooks and scripts."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from torquebench.atomic_write import atomic_write
from torquebench.calibration import CalibrationData
from torquebench.campaign.fitting import model_title
from torquebench.compensation import Comparison
from torquebench.errors import InputError
from torquebench.figures import Curve, draw_additional_torque, draw_comparison, styled
from torquebench.message import Message
from torquebench.notebook.models import Compensation

_POINTS = 400
_ENDINGS = (".svg", ".png", ".pdf")


class Drawing:
    """A figure that notebooks display automatically.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    """

    def __init__(self, figure: Any) -> None:
        self.figure = figure

    def save(self, path: str | Path) -> Path:
        """Write the figure as SVG, PNG or PDF by the file's suffix."""
        target = Path(path)
        if target.suffix.lower() not in _ENDINGS:
            raise InputError(Message("a figure {name}", target.name), "a file .svg, .png or .pdf")
        atomic_write(target, self._bytes(target.suffix[1:].lower()))
        return target

    def _bytes(self, kind: str) -> bytes:
        buffer = io.BytesIO()
        with styled():
            self.figure.savefig(buffer, format=kind, dpi=150)
        return buffer.getvalue()

    def _repr_svg_(self) -> str:
        return self._bytes("svg").decode()

    def __repr__(self) -> str:
        width, height = self.figure.get_size_inches()
        return f"Drawing({width:g} × {height:g} in)"


def plot(thing: CalibrationData | Compensation | Comparison, *, ax: Any = None) -> Drawing:
    """Draw a calibration, a compensation or a comparison.

    Parameters
    ----------
    thing : CalibrationData, Compensation or Comparison
        A calibration's points; a compensation's fitted curve of each branch with U (k = 2) and the
        points; or the errors of compared models at steps left out.
    ax : matplotlib.axes.Axes, optional
        Axes to draw into; a new figure by default.

    Raises
    ------
    InputError
        The object is of another type.
    """
    with styled():
        figure = ax.figure if ax is not None else Figure(figsize=(7.6, 3.8), layout="constrained")
        if ax is None:
            FigureCanvasAgg(figure)
            ax = figure.subplots()
        if isinstance(thing, Comparison):
            draw_comparison(ax, thing)
        elif isinstance(thing, CalibrationData):
            _draw_points(ax, thing, [])
        elif isinstance(thing, Compensation):
            _draw_compensation(ax, thing)
        else:
            raise InputError(
                Message("a plot of a {name}", type(thing).__name__),
                "a calibration, a compensation or a comparison",
            )
    return Drawing(figure)


def _draw_points(ax: Any, data: CalibrationData, curves: list[Curve]) -> None:
    draw_additional_torque(
        ax, data.reading_nm, data.additional_torque_nm, data.branch, curves, data.range_nm
    )


def _draw_compensation(ax: Any, compensation: Compensation) -> None:
    model, chain = compensation.model, compensation.chain
    reach = compensation.stored.provenance.range_nm
    low, high = max(model.reading_low_nm_, -reach), min(model.reading_high_nm_, reach)
    grid = np.linspace(low, high, _POINTS)
    title = model_title(model.kind, model.kind_parameters)
    curves = []
    sides = (("up", "rising"), ("down", "falling")) if chain.curve.branch_aware else ((None, ""),)
    for branch, word in sides:
        torque = compensation.torque(grid, branch=branch)
        label = f"{title}, {word}" if word else title
        added = torque.value_nm - grid
        curves.append(Curve(label, grid, added, band=torque.expanded_uncertainty_nm))
    if compensation.calibration is not None:
        _draw_points(ax, compensation.calibration, curves)
    else:
        draw_additional_torque(ax, [], [], [], curves, reach)
