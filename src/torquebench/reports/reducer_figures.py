"""Figures of reducer tests, as SVG text: loops, friction, break-away, errors, efficiency.

Every function takes what `torquebench.reducers` evaluated and returns an ``<svg>`` element; the
same result gives the same bytes.
"""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from torquebench.reducers import (
    BreakawayResult,
    EfficiencyMap,
    HysteresisResult,
    NoLoadResult,
    TransmissionErrorResult,
)
from torquebench.reports.figures import (
    _COLOURS,
    _STYLE,
    Curve,
    _legend_above,
    _new,
    _svg,
    friction_figure,
)
from torquebench.units import ARCMIN

__all__ = [
    "breakaway_figure",
    "efficiency_figure",
    "loop_figure",
    "no_load_figure",
    "polar_error_figure",
    "transmission_error_figure",
]

LEAST_MAP = 2
"""Torques and speeds that iso-lines need at least."""


def loop_figure(result: HysteresisResult) -> str:
    """Draw all torque-angle loops, and the first one's key points around zero.

    Parameters
    ----------
    result : HysteresisResult

    Returns
    -------
    str
        An ``<svg>`` element.
    """
    with mpl.rc_context(_STYLE):
        figure, (whole, near) = _new(6.4, 2)
        positions = sorted({loop.position for loop in result.loops})
        for axes in (whole, near):
            labelled: set[float] = set()
            for loop in result.loops:
                curve = loop.curve
                middle = 0.5 * (np.interp(0.0, curve.torque_nm, curve.rising_rad + 0.0))
                middle += 0.5 * (np.interp(0.0, curve.torque_nm, curve.falling_rad))
                colour = _COLOURS[positions.index(loop.position) % len(_COLOURS)]
                for branch in (curve.rising_rad, curve.falling_rad):
                    label = None if loop.position in labelled else f"{loop.position:g}°"
                    labelled.add(loop.position)
                    shown = (branch - middle) / ARCMIN
                    axes.plot(curve.torque_nm, shown, color=colour, lw=0.9, label=label)
            axes.set_ylabel("output angle in arcmin")
        whole.set_xlabel("output torque in N·m")
        near.set_xlabel("output torque in N·m, around zero")
        _legend_above(whole)
        _mark_key_points(whole, near, result)
        return _svg(figure)


def _mark_key_points(whole: Axes, near: Axes, result: HysteresisResult) -> None:
    curve = result.loops[0].curve
    middle = 0.5 * float(
        np.interp(0.0, curve.torque_nm, curve.rising_rad)
        + np.interp(0.0, curve.torque_nm, curve.falling_rad)
    )
    share = result.rule.share * result.settings.rated_torque_nm
    reach = 2.0 * share
    inside = np.abs(curve.torque_nm) <= reach
    both = np.concatenate([curve.rising_rad[inside], curve.falling_rad[inside]]) - middle
    near.set_xlim(-reach, reach)
    span = float(np.ptp(both)) / ARCMIN
    near.set_ylim(float(both.min()) / ARCMIN - 0.12 * span, float(both.max()) / ARCMIN + 0.2 * span)
    whole.margins(y=0.12)
    for point in result.key_points:
        place = (point.torque_nm, (point.angle_rad - middle) / ARCMIN)
        axes = near if abs(point.torque_nm) <= reach else whole
        axes.plot(*place, "o", color="black", markersize=4.5, zorder=4)
        left = "↓" in point.label or ("↑" not in point.label and point.torque_nm > 0.0)
        axes.annotate(
            point.label,
            place,
            xytext=(-7, 4) if left else (7, -4),
            textcoords="offset points",
            ha="right" if left else "left",
            va="bottom" if left else "top",
            fontsize=8,
        )


def no_load_figure(result: NoLoadResult) -> str:
    """Draw the no-load running torque over speed, every repeat, and the fitted friction.

    Parameters
    ----------
    result : NoLoadResult
    """
    speeds, torques = [], []
    highest = float(np.max(np.abs(result.speed_rpm)))
    for sign, fit in (
        (-1.0, result.friction.counter_clockwise),
        (1.0, result.friction.clockwise),
    ):
        if fit is not None:
            speed = sign * np.linspace(0.02 * highest, highest, 120)
            speeds.append(speed)
            torques.append(fit.torque(speed))
    fitted = None
    if speeds:
        fitted = Curve("fitted friction", np.concatenate(speeds), np.concatenate(torques))
    return friction_figure(result.speed_rpm, result.torque_nm, result.repeat, fit=fitted)


def breakaway_figure(result: BreakawayResult) -> str:
    """Draw the torque at first motion of every ramp over the position.

    Parameters
    ----------
    result : BreakawayResult
    """
    place = np.array([each.position for each in result.runs])
    known = bool(np.all(np.isfinite(place)))
    if not known:
        place = np.array([each.label for each in result.runs])
    torque = np.array([each.torque_nm for each in result.runs])
    error = 2.0 * np.array([each.standard_uncertainty_nm for each in result.runs])
    with mpl.rc_context(_STYLE):
        figure, (axes,) = _new(2.9)
        for colour, sign, marker, name, middle in (
            (_COLOURS[0], 1.0, "^", "clockwise", result.clockwise),
            (_COLOURS[1], -1.0, "v", "counter-clockwise", result.counter_clockwise),
        ):
            mine = np.sign(torque) == sign
            if not mine.any() or middle is None:
                continue
            axes.errorbar(
                place[mine],
                np.abs(torque[mine]),
                error[mine],
                fmt=marker,
                color=colour,
                markersize=5,
                capsize=2.5,
                elinewidth=0.9,
                label=name,
            )
            axes.axhline(middle.value, color=colour, ls="--", lw=0.9, label=f"median, {name}")
        axes.set_xlabel("position in degrees" if known else "ramp")
        axes.set_ylabel(f"{result.kind} torque in N·m")
        axes.margins(x=0.1, y=0.25)
        _legend_above(axes)
        return _svg(figure)


def transmission_error_figure(result: TransmissionErrorResult) -> str:
    """Draw the error over one output revolution in both directions, and its orders below.

    Parameters
    ----------
    result : TransmissionErrorResult
    """
    with mpl.rc_context(_STYLE):
        panels = len(result.directions) + 1
        figure, axes = _new(1.75 * panels + 0.6, panels)
        lower = axes[-1]
        shift = 0.004 * result.highest_order
        for number, (upper, each) in enumerate(zip(axes, result.directions, strict=False)):
            colour = _COLOURS[number]
            label = f"{each.direction}, {each.peak_to_peak.value:.1f} arcsec peak to peak"
            upper.plot(np.degrees(each.angle_rad), each.error_arcsec, color=colour, lw=0.7)
            upper.set_title(label, loc="left", fontsize=9, color=colour)
            upper.set_xlim(0.0, 360.0)
            upper.set_xticks(np.arange(0.0, 361.0, 45.0))
            upper.set_ylabel("error in arcsec")
            lower.vlines(
                each.order + number * shift,
                0.0,
                each.amplitude_arcsec,
                color=colour,
                lw=1.3,
                label=each.direction,
            )
        axes[-2].set_xlabel("output angle in degrees")
        taken: list[float] = []
        for order in result.directions[0].orders:
            if any(abs(order.order - other) < 0.02 * result.highest_order for other in taken):
                continue
            if order.amplitude.value > 2.0 * order.amplitude.expanded_uncertainty():
                taken.append(order.order)
                lower.annotate(
                    f"{order.order:g}",
                    (order.order, order.amplitude.value),
                    xytext=(4, 1),
                    textcoords="offset points",
                    fontsize=8,
                )
        lower.set_xlim(-0.01 * result.highest_order, 1.05 * result.highest_order)
        highest = max(float(np.max(each.amplitude_arcsec)) for each in result.directions)
        lower.set_ylim(0.0, 1.15 * highest)
        turn = abs(result.ratio)
        lower.set_xlabel(f"order per output revolution ({turn:g}: once a turn of the input)")
        lower.set_ylabel("amplitude in arcsec")
        return _svg(figure)


def polar_error_figure(result: TransmissionErrorResult) -> str:
    """Draw the error over one output revolution as a polar plot; the circle in the middle is 0.

    Parameters
    ----------
    result : TransmissionErrorResult
    """
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(7.6, 4.4), layout="constrained")
        FigureCanvasSVG(figure)
        axes = figure.subplots(1, 1, subplot_kw={"projection": "polar"})
        worst = max(float(np.max(np.abs(each.error_arcsec))) for each in result.directions)
        for number, each in enumerate(result.directions):
            closed = np.append(each.error_arcsec, each.error_arcsec[:1])
            angle = np.append(each.angle_rad, 2.0 * np.pi)
            axes.plot(angle, closed, color=_COLOURS[number], lw=0.7, label=each.direction)
        axes.plot(np.linspace(0, 2 * np.pi, 361), np.zeros(361), color="#3C4148", lw=0.8)
        axes.set_ylim(-2.2 * worst, 1.15 * worst)
        axes.set_rlabel_position(22.5)  # type: ignore[attr-defined]  # polar axes only
        step = float(f"{worst / 2.0:.0e}") or 1.0
        axes.set_yticks(
            [-2 * step, 0.0, 2 * step], labels=[f"{v:g}″" for v in (-2 * step, 0, 2 * step)]
        )
        axes.legend(loc="center left", bbox_to_anchor=(1.08, 0.5), frameon=False)
        return _svg(figure)


def efficiency_figure(result: EfficiencyMap) -> str:
    """Draw the efficiency over speed and torque with iso-lines and the measured points.

    Where only one torque or one speed was measured there are no iso-lines.

    Parameters
    ----------
    result : EfficiencyMap
    """
    mine = [each for each in result.points if each.driving == "input"] or list(result.points)
    direction = 1 if any(each.speed_rpm > 0 for each in mine) else -1
    mine = [each for each in mine if each.speed_rpm * direction > 0]
    speed = np.array([each.speed_rpm for each in mine])
    torque = np.array([each.torque_nm for each in mine])
    value = np.array([each.efficiency.value for each in mine])
    with mpl.rc_context(_STYLE):
        figure, (axes,) = _new(3.9)
        axes.grid(visible=False)
        if _different(speed) >= LEAST_MAP and _different(torque) >= LEAST_MAP:
            speeds, torques, found = result.grid(mine[0].driving, direction, 241)
            shown = np.ma.masked_invalid(found)
            filled = axes.contourf(speeds, torques, shown, 14, cmap="viridis")
            figure.colorbar(filled, ax=axes, label="efficiency in %", pad=0.02)
            lines = axes.contour(speeds, torques, shown, 7, colors="white", linewidths=0.8)
            axes.clabel(lines, fmt="%.3g %%", fontsize=7.5)
        axes.plot(speed, torque, "o", color="black", markersize=4, fillstyle="none")
        right = 0.5 * (float(speed.min()) + float(speed.max()))
        top = 0.5 * (float(torque.min()) + float(torque.max()))
        for x, y, percent in zip(speed, torque, value, strict=True):
            axes.annotate(
                f"{percent:.1f}",
                (x, y),
                xytext=(-6 if x > right else 6, -5 if y > top else 5),
                textcoords="offset points",
                ha="right" if x > right else "left",
                va="top" if y > top else "bottom",
                fontsize=7.5,
                bbox={"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 1.0},
            )
        axes.use_sticky_edges = False  # the measured points lie on the map's edges
        axes.margins(0.06)
        axes.autoscale_view()
        axes.set_xlabel("input speed in rpm")
        axes.set_ylabel("output torque in N·m")
        return _svg(figure)


def _different(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> int:
    """Return how many values differ by more than 2 % of the largest."""
    ordered = np.sort(np.abs(values))
    return 1 + int(np.count_nonzero(np.diff(ordered) > 0.02 * ordered[-1]))
