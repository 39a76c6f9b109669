"""Figures as SVG text, and their common style.

Every function takes arrays in SI units and returns the text of an ``<svg>`` element. The text
is reproducible: the same arrays give the same bytes.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from html import escape, unescape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.compensation import Comparison

if TYPE_CHECKING:  # imported late: Matplotlib takes most of a second
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "COLOURS",
    "RAW_COLOUR",
    "STYLE",
    "Curve",
    "additional_torque_figure",
    "blank_figure",
    "draw_additional_torque",
    "draw_comparison",
    "error_figure",
    "friction_figure",
    "group_figure",
    "legend_above",
    "new_figure",
    "palette",
    "percent_axis",
    "staircase_figure",
    "styled",
    "svg_text",
    "translated_labels",
]

# Okabe and Ito's palette: distinguishable for colour-blind readers and in grey print.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
RAW_COLOUR = "#8A8A8A"
SIDE_COLOURS = {"input": COLOURS[0], "output": COLOURS[1]}
"""Colour of what is measured at a side, everywhere; that of the standard is `COLOURS[2]`."""
STYLE: Any = {  # Matplotlib types its keys one by one
    "font.size": 9.0,
    "font.family": "DejaVu Sans",
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#E3E6EA",
    "grid.linewidth": 0.7,
    "legend.frameon": False,
    "svg.hashsalt": "torquebench",
    "svg.fonttype": "path",
}
_UP, _DOWN = "^", "v"
_LEGEND_CHARACTERS = 100
FEW_POINTS = 100
"""Number of points up to which each of them is drawn larger."""


def palette(side: str = "") -> tuple[str, ...]:
    """Return the colours of curves in order; those of a module begin with its side's colour.

    Examples
    --------
    >>> palette("output")[0] == COLOURS[1], palette()[:2] == COLOURS[:2]
    (True, True)
    """
    return (SIDE_COLOURS[side], *COLOURS[3:]) if side in SIDE_COLOURS else COLOURS


@dataclass(frozen=True)
class Curve:
    """One named line or cloud of points of a figure.

    Attributes
    ----------
    label : str
        Name in the legend.
    x, y : numpy.ndarray of shape (n,)
        Abscissa and ordinate, in the units of the figure.
    raw : bool
        Whether this is the uncompensated reading (drawn grey, behind the rest).
    band : numpy.ndarray of shape (n,), optional
        Half width of a band about a line, in the unit of the ordinate.
    style : str
        Line style or marker of Matplotlib; by default that of the figure.
    """

    label: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    raw: bool = False
    band: NDArray[np.float64] | None = None
    style: str = ""


_TRANSLATE: ContextVar[Callable[[str], str] | None] = ContextVar("translate", default=None)


@contextmanager
def translated_labels(translate: Callable[[str], str]) -> Iterator[None]:
    """Draw with labels in another language, as text in the reader's fonts instead of outlines."""
    token = _TRANSLATE.set(translate)
    try:
        yield
    finally:
        _TRANSLATE.reset(token)


def styled() -> AbstractContextManager[None]:
    """Return a context with the common style, in which figures are created and drawn."""
    import matplotlib as mpl

    return mpl.rc_context(STYLE)


def blank_figure(height: float) -> Figure:
    """Return a figure of the page's width and a height in inches, without axes."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.6, height), layout="constrained")
    FigureCanvasSVG(figure)
    return figure


def new_figure(height: float = 3.3, panels: int = 1) -> tuple[Figure, list[Axes]]:
    """Return a figure of the page's width, a height in inches, and its axes below each other."""
    figure = blank_figure(height)
    axes = figure.subplots(panels, 1, squeeze=False)[:, 0]
    return figure, list(axes)


def svg_text(figure: Figure) -> str:
    """Return the ``<svg>`` element of a figure."""
    import matplotlib as mpl
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    buffer, canvas, translate = io.StringIO(), figure.canvas, _TRANSLATE.get()
    assert isinstance(canvas, FigureCanvasSVG)  # see `blank_figure`
    # `savefig` draws twice, to lay out first; drawing once does both.
    # Matplotlib states no types for it.
    with mpl.rc_context({"svg.fonttype": "none"} if translate else {}):
        canvas.print_svg(buffer, metadata={"Date": None, "Creator": None})  # type: ignore[no-untyped-call]
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    if translate is None:
        return text
    return re.sub(
        "(?<=>)[^<>]+(?=</text>)", lambda found: escape(translate(unescape(found[0]))), text
    )


def percent_axis(axes: Axes, range_nm: float) -> None:
    """Add a right-hand axis in % of full scale for an ordinate in N·m."""

    def to_percent(torque_nm: ArrayLike) -> NDArray[np.float64]:
        return np.asarray(torque_nm, float) * (100.0 / range_nm)

    def to_torque(percent: ArrayLike) -> NDArray[np.float64]:
        return np.asarray(percent, float) * (range_nm / 100.0)

    right = axes.secondary_yaxis("right", functions=(to_percent, to_torque))
    right.set_ylabel("% FS")
    right.spines["right"].set_visible(True)
    right.spines["right"].set_color("#B9BEC5")


def legend_above(axes: Axes) -> None:
    """Place the legend above the axes, in as many columns as its longest label allows."""
    _, labels = axes.get_legend_handles_labels()
    columns = max(1, min(5, _LEGEND_CHARACTERS // (max(map(len, labels)) + 7)))
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, borderaxespad=0.3)


def additional_torque_figure(
    reading_nm: ArrayLike,
    additional_nm: ArrayLike,
    branch: ArrayLike,
    curves: Sequence[Curve],
    range_nm: float,
) -> str:
    """Draw the measured additional torque and that of each model.

    Parameters
    ----------
    reading_nm, additional_nm : array_like of shape (n,)
        Readings and standard minus reading, in N·m.
    branch : array_like of shape (n,)
        +1 rising, -1 falling, 0 unknown.
    curves : sequence of Curve
        Model curves over the reading, in N·m.
    range_nm : float
        Full scale, in N·m.

    Returns
    -------
    str
        An ``<svg>`` element.
    """
    with styled():
        figure, (axes,) = new_figure()
        draw_additional_torque(axes, reading_nm, additional_nm, branch, curves, range_nm)
        return svg_text(figure)


def draw_additional_torque(
    axes: Axes,
    reading_nm: ArrayLike,
    additional_nm: ArrayLike,
    branch: ArrayLike,
    curves: Sequence[Curve],
    range_nm: float,
) -> None:
    """Draw the content of `additional_torque_figure` into axes; the band of a curve is its U."""
    reading, additional, sides = (np.asarray(a, float) for a in (reading_nm, additional_nm, branch))
    for value, marker, label in (
        (1, _UP, "measured, rising"),
        (-1, _DOWN, "measured, falling"),
        (0, "o", "measured"),
    ):
        chosen = np.sign(sides) == value
        if chosen.any():
            axes.plot(
                reading[chosen],
                additional[chosen],
                marker,
                color="#5F666E",
                markersize=3.2,
                fillstyle="none" if value < 0 else "full",
                markeredgewidth=0.7,
                label=label,
            )
    for colour, curve in zip(COLOURS, curves, strict=False):
        if curve.band is not None:
            axes.fill_between(
                curve.x, curve.y - curve.band, curve.y + curve.band, color=colour, alpha=0.15, lw=0
            )
        axes.plot(curve.x, curve.y, "-", color=colour, linewidth=1.3, label=curve.label)
    axes.set_xlabel("reading in N·m")
    axes.set_ylabel("additional torque in N·m")
    percent_axis(axes, range_nm)
    legend_above(axes)


def draw_comparison(axes: Axes, comparison: Comparison) -> None:
    """Draw RMS and worst errors of models at held-out points, with those of the raw reading."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    percent = 100.0 / comparison.full_scale_nm
    names = [score.name for score in comparison.scores] + ["raw reading"]
    raw = comparison.raw
    rms = [score.rms_percent_fs for score in comparison.scores] + [percent * raw.rms_nm]
    worst = [score.worst_percent_fs for score in comparison.scores] + [percent * raw.worst_nm]
    place = np.arange(len(names))
    colours = [COLOURS[0]] * (len(names) - 1) + [RAW_COLOUR]
    colours[names.index(comparison.best)] = COLOURS[2]
    axes.hlines(place, rms, worst, color=colours, linewidth=1.5)
    axes.scatter(rms, place, color=colours, s=28, zorder=3, label="RMS")
    axes.scatter(worst, place, facecolor="white", edgecolor=colours, s=28, zorder=3, label="worst")
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_yticks(place, names)
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("error at steps left out, % FS")
    legend_above(axes)


def error_figure(
    curves: Sequence[Curve],
    range_nm: float,
    *,
    limit_fs: float | None = None,
    markers: bool = True,
    abscissa: str = "torque in N·m",
    ordinate: str = "error in N·m",
    side: str = "",
) -> str:
    """Draw the error over torque: raw in the upper panel, compensated below with its own scale.

    Parameters
    ----------
    curves : sequence of Curve
        Error curves in N·m over torque in N·m; those with ``raw`` go to the upper panel, and
        the first of each panel lies on top.
    range_nm : float
        Full scale, in N·m.
    limit_fs : float, optional
        Limit to mark, as a share of full scale (0.001 for 0.1 % FS).
    markers : bool
        Whether to draw points instead of lines.
    abscissa, ordinate : str
        Labels of the axes.
    side : {"", "input", "output"}
        Module whose errors they are: its compensated torque has its side's colour.

    Returns
    -------
    str
        An ``<svg>`` element.
    """
    raw = [curve for curve in curves if curve.raw]
    compensated = [curve for curve in curves if not curve.raw]
    style: dict[str, Any] = (
        {"linestyle": "none", "marker": "o"} if markers else {"linestyle": "-", "marker": ""}
    )
    groups = [group for group in (raw, compensated) if group]
    with styled():
        figure, panels = new_figure(2.0 * len(groups) + 0.9, len(groups))
        for axes, group in zip(panels, groups, strict=True):
            for order, (colour, curve) in enumerate(zip(palette(side), group, strict=False)):
                axes.plot(
                    curve.x,
                    curve.y,
                    **style,
                    zorder=3.0 - 0.1 * order,
                    color=RAW_COLOUR if curve.raw else colour,
                    markersize=2.0 if curve.x.size > FEW_POINTS else 4.0,
                    linewidth=1.2,
                    alpha=0.75 if markers else 1.0,
                    label=curve.label,
                )
            if limit_fs is not None and not group[0].raw:
                for sign in (-1.0, 1.0):
                    axes.axhline(
                        sign * limit_fs * range_nm, color="#9A3412", linestyle="--", linewidth=0.9
                    )
            axes.set_ylabel(ordinate)
            percent_axis(axes, range_nm)
            legend_above(axes)
        panels[-1].set_xlabel(abscissa)
        return svg_text(figure)


def group_figure(
    group_errors_nm: Mapping[str, NDArray[np.float64]],
    range_nm: float,
    *,
    limit_fs: float | None = None,
) -> str:
    """Draw the worst absolute error of each verification group.

    Parameters
    ----------
    group_errors_nm : mapping of str to numpy.ndarray of shape (groups,)
        Worst absolute error of each group in N·m, by model.
    range_nm : float
        Full scale, in N·m.
    limit_fs : float, optional
        Limit to mark, as a share of full scale.

    Returns
    -------
    str
        An ``<svg>`` element.
    """
    with styled():
        figure, (axes,) = new_figure(2.7)
        for colour, (label, worst) in zip(COLOURS, group_errors_nm.items(), strict=False):
            number = np.arange(1, len(worst) + 1)
            axes.plot(number, worst, "o-", color=colour, markersize=4, linewidth=1.0, label=label)
            axes.set_xticks(number)
        if limit_fs is not None:
            axes.axhline(limit_fs * range_nm, color="#9A3412", linestyle="--", linewidth=0.9)
        axes.set_ylim(bottom=0.0)
        axes.set_xlabel("verification group")
        axes.set_ylabel("worst error in N·m")
        percent_axis(axes, range_nm)
        legend_above(axes)
        return svg_text(figure)


def staircase_figure(
    time_s: ArrayLike, standard_nm: ArrayLike, additional_nm: ArrayLike, range_nm: float
) -> str:
    """Draw the steps of a calibration over time, with the additional torque below.

    Parameters
    ----------
    time_s : array_like of shape (n,)
        Bench time of each steady value, in s.
    standard_nm, additional_nm : array_like of shape (n,)
        Standard torque and standard minus reading, in N·m.
    range_nm : float
        Full scale, in N·m.

    Returns
    -------
    str
        An ``<svg>`` element.
    """
    time = np.asarray(time_s, float)
    with styled():
        figure, (upper, lower) = new_figure(3.8, 2)
        upper.plot(time, standard_nm, ".-", color=COLOURS[0], markersize=3, linewidth=0.8)
        upper.set_ylabel("standard in N·m")
        upper.tick_params(labelbottom=False)
        lower.plot(time, additional_nm, ".", color=COLOURS[1], markersize=3)
        lower.set_ylabel("additional torque in N·m")
        lower.set_xlabel("bench time in s")
        percent_axis(lower, range_nm)
        return svg_text(figure)


def friction_figure(
    speed_rpm: ArrayLike,
    torque_nm: ArrayLike,
    repeat: ArrayLike,
    *,
    fit: Curve | None = None,
    truth: Curve | None = None,
) -> str:
    """Draw no-load running torque over speed, with one marker for each repeat.

    Parameters
    ----------
    speed_rpm : array_like of shape (n,)
        Input speed in rpm, positive clockwise.
    torque_nm : array_like of shape (n,)
        Torque at the input in N·m.
    repeat : array_like of shape (n,)
        Number of the repeat, from 1.
    fit, truth : Curve, optional
        Fitted friction law, and the true one of a simulated bench.

    Returns
    -------
    str
        An ``<svg>`` element.
    """
    speed, torque, number = (np.asarray(a, float) for a in (speed_rpm, torque_nm, repeat))
    with styled():
        figure, (axes,) = new_figure(3.1)
        several = np.unique(number).size > 1
        for colour, marker, value in zip(COLOURS, "osD^vP", np.unique(number), strict=False):
            chosen = number == value
            axes.plot(
                speed[chosen],
                torque[chosen],
                marker,
                color=colour,
                markersize=3.5,
                fillstyle="none",
                label=f"repeat {value:g}" if several else "measured",
            )
        if fit is not None:
            _line_by_direction(axes, fit, "-", "#3C4148")
        if truth is not None:
            _line_by_direction(axes, truth, ":", COLOURS[1])
        axes.set_xlabel("input speed in rpm")
        axes.set_ylabel("no-load torque in N·m")
        legend_above(axes)
        return svg_text(figure)


def _line_by_direction(axes: Axes, curve: Curve, line: str, colour: str) -> None:
    """Draw a curve in two pieces, so that no line crosses the step at zero torque."""
    label: str | None = curve.label
    for sign in (1.0, -1.0):
        chosen = np.sign(curve.x) == sign
        if chosen.any():
            axes.plot(curve.x[chosen], curve.y[chosen], line, color=colour, lw=1.2, label=label)
            label = None
