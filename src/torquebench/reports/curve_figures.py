"""General figures as SVG text: diagrams of curves, and twisted bodies in three dimensions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from torquebench.figures import (
    RAW_COLOUR,
    Curve,
    blank_figure,
    legend_above,
    palette,
    percent_axis,
    styled,
    svg_text,
)

if TYPE_CHECKING:
    from torquebench.mechanics import TwistedSolid

_LINES = ("-", "--", ":")
_LIMIT = {"color": "#9A3412", "linestyle": "--", "linewidth": 0.9}


@dataclass(frozen=True)
class Panel:
    """One diagram of a figure.

    Attributes
    ----------
    curves : sequence of Curve
    abscissa, ordinate : str
        Labels of the axes.
    markers : bool
        Whether to draw points instead of lines.
    limits : tuple of float
        Ordinates to mark by dashed lines.
    range_nm : float, optional
        Full scale of an ordinate in N·m: adds an axis in % FS.
    logarithmic : str
        Logarithmic axes: "", "x", "y" or "xy".
    title : str
    side : {"", "input", "output"}
        Module whose curves they are: the first one that isn't raw has its side's colour.
    """

    curves: Sequence[Curve]
    abscissa: str
    ordinate: str
    markers: bool = False
    limits: tuple[float, ...] = ()
    range_nm: float | None = None
    logarithmic: str = ""
    title: str = ""
    side: str = ""


def panels_figure(panels: Sequence[Panel], *, columns: int = 1, height: float = 2.6) -> str:
    """Draw diagrams below each other, or in columns.

    Parameters
    ----------
    panels : sequence of Panel
    columns : int
    height : float
        Height of one diagram in inches, at a width of 7.6.

    Returns
    -------
    str
        An ``<svg>`` element.
    """
    rows = -(-len(panels) // columns)
    with styled():
        figure = blank_figure(height * rows + 0.3)
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        for place in axes[len(panels) :]:
            place.set_visible(False)
        for place, panel in zip(axes, panels, strict=False):
            _draw(place, panel, legend=max(1, columns))
        return svg_text(figure)


def _draw(axes: Any, panel: Panel, legend: int) -> None:
    colours = iter(palette(panel.side) * 3)
    for curve in panel.curves:
        colour = RAW_COLOUR if curve.raw else next(colours)
        label = curve.label or None
        style = curve.style or ("o" if panel.markers else "-")
        drawn: Any = {"linestyle": style}
        if style not in _LINES:
            size = 3.6 if curve.style else 2.2
            drawn = {"linestyle": "none", "marker": style, "markersize": size}
        axes.plot(curve.x, curve.y, **drawn, color=colour, linewidth=1.2, label=label)
        if curve.band is not None:
            low, high = curve.y - curve.band, curve.y + curve.band
            axes.fill_between(curve.x, low, high, color=colour, alpha=0.2, linewidth=0)
    for limit in panel.limits:
        axes.axhline(limit, **_LIMIT)
    if "x" in panel.logarithmic:
        axes.set_xscale("log")
    if "y" in panel.logarithmic:
        axes.set_yscale("log")
    axes.set_xlabel(panel.abscissa)
    axes.set_ylabel(panel.ordinate)
    if panel.range_nm is not None:
        percent_axis(axes, panel.range_nm)
    if panel.title:
        axes.set_title(panel.title, fontsize=9, loc="left")
    if any(curve.label for curve in panel.curves):
        if legend > 1 or panel.title:
            axes.legend(fontsize=7.5)
        else:
            legend_above(axes)


def bodies_figure(bodies: Sequence[tuple[str, TwistedSolid]], *, share: float = 0.08) -> str:
    """Draw twisted bodies side by side, with magnified displacements.

    All bodies have the same colour scale of displacement in µm and the same magnification.

    Parameters
    ----------
    bodies : sequence of (str, TwistedSolid)
        Letter, which the caption explains in every language, and body.
    share : float
        Largest displacement in the drawing, as a share of the largest body's size.

    Returns
    -------
    str
        An ``<svg>`` element.
    """
    import matplotlib as mpl
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    largest = max(float(np.linalg.norm(body.displacement_m, axis=1).max()) for _, body in bodies)
    size = max(float(np.ptp(body.points_m, axis=0).max()) for _, body in bodies)
    enlarged = share * size / largest
    norm = mpl.colors.Normalize(0.0, 1e6 * largest)
    palette = mpl.colormaps["viridis"]
    with styled():
        figure = blank_figure(3.7)
        axes = []
        for number, (title, body) in enumerate(bodies, start=1):
            place: Any = figure.add_subplot(1, len(bodies), number, projection="3d")
            axes.append(place)
            faces = body.surface
            moved = body.points_m + enlarged * body.displacement_m
            travel = 1e6 * np.linalg.norm(body.displacement_m, axis=1)
            place.add_collection3d(
                Poly3DCollection(
                    moved[faces],
                    facecolors=palette(norm(travel[faces].mean(axis=1))),
                    edgecolors="#00000030",
                    linewidths=0.2,
                )
            )
            low, high = moved.min(axis=0), moved.max(axis=0)
            middle, half = 0.5 * (low + high), 0.5 * size
            for axis, centre in zip("xyz", middle, strict=True):
                getattr(place, f"set_{axis}lim")(centre - half, centre + half)
            place.set_box_aspect((1, 1, 1))
            place.view_init(elev=22, azim=-58)
            place.set_axis_off()
            place.set_title(title, fontsize=9)
        shown = mpl.cm.ScalarMappable(norm, palette)
        bar = figure.colorbar(shown, ax=axes, shrink=0.7, pad=0.02)
        bar.set_label("µm")
        return svg_text(figure)
