"""Figures: the torque-angle loop with its dimensions, errors before and after compensation."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes

from torquebench.figures import COLOURS, STYLE, legend_above, new_figure, percent_axis, svg_text

RISING, FALLING, DIMENSION = COLOURS[0], COLOURS[1], "#111111"
RATED_NM, P = 412.0, 0.03


def make(images: Path, scratch: Path) -> Iterator[Path]:
    """Draw all figures."""
    path = images / "torque-angle-loop.svg"
    path.write_text(loop(), encoding="utf-8")
    yield path
    path = images / "errors-output-module.svg"
    path.write_text(errors(scratch), encoding="utf-8")
    yield path


def branches(torque: Any) -> tuple[Any, Any]:
    """Return angles in arcmin of a model loop while the torque rises and while it falls."""
    elastic = torque / 108.0 + 0.18 * np.tanh(torque / 9.0)
    half_width = 0.16 * (1.0 - (torque / RATED_NM) ** 2)
    return elastic - half_width, elastic + half_width


def loop() -> str:
    """Draw the loop with branches, backlash, lost motion and stiffness interval."""
    with mpl.rc_context(STYLE):
        figure, (whole, middle) = new_figure(6.4, 2)
        torque = np.linspace(-RATED_NM, RATED_NM, 801)
        for axes, share in ((whole, 1.0), (middle, 0.055)):
            shown = torque if share == 1.0 else np.linspace(-share, share, 401) * RATED_NM
            up, down = branches(shown)
            axes.plot(shown, up, color=RISING, label="torque rises (↑)")
            axes.plot(shown, down, color=FALLING, label="torque falls (↓)")
            axes.axhline(0.0, color="#9AA0A6", linewidth=0.6)
            axes.axvline(0.0, color="#9AA0A6", linewidth=0.6)
            axes.set_ylabel("angle of the output in arcmin")
        _directions(whole)
        _stiffness(whole)
        _dimensions(middle)
        legend_above(whole)
        whole.set_title("")
        middle.set_xlabel("torque at the output in N·m")
        return svg_text(figure)


def _directions(axes: Axes) -> None:
    for start, branch, colour in ((-260.0, 0, RISING), (-60.0, 0, RISING), (260.0, 1, FALLING),
                                  (60.0, 1, FALLING)):  # fmt: skip
        end = start + (40.0 if branch == 0 else -40.0)
        axes.annotate(
            "",
            (end, branches(end)[branch]),
            (start, branches(start)[branch]),
            arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 1.2},
        )


def _stiffness(axes: Axes) -> None:
    low, high = 0.5 * RATED_NM, RATED_NM
    axes.axvspan(low, high, color="#EEF2F7", zorder=0)
    axes.text(0.75 * RATED_NM, -3.6, "stiffness: slope from\n50 to 100 % of $T_N$", ha="center")
    for torque in (low, high):
        axes.axvline(torque, color="#9AA0A6", linewidth=0.6, linestyle=":")


def _dimensions(axes: Axes) -> None:
    up, down = (float(each) for each in branches(0.0))
    _arrow(axes, 0.0, up, down)
    axes.annotate("backlash", (0.0, 0.5 * (up + down) + 0.1), (1.2, 0.02), va="bottom")
    p = P * RATED_NM
    middles = []
    for sign in (1.0, -1.0):
        at = sign * p
        ends = [float(each) for each in branches(at)]
        middles.append(0.5 * sum(ends))
        axes.axvline(at, color="#9AA0A6", linewidth=0.6, linestyle=":")
        for value, mark, colour in zip(ends, "↑↓", (RISING, FALLING), strict=True):
            axes.plot(at, value, "o", color=colour, markersize=5, zorder=4)
            side = "−" if sign < 0 else "+"
            shift = (8, -12) if mark == "↑" else (-8, 6)
            axes.annotate(
                f"θ{mark}({side}p)",
                (at, value),
                shift,
                textcoords="offset points",
                ha="left" if mark == "↑" else "right",
            )
        axes.plot(at, middles[-1], "s", color=DIMENSION, markersize=5, zorder=4)
    place = 1.45 * p
    for middle, at in zip(middles, (p, -p), strict=True):
        axes.plot([at, place], [middle, middle], color=DIMENSION, linewidth=0.6, linestyle="--")
    _arrow(axes, place, middles[1], middles[0])
    axes.text(place + 0.4, 0.0, "lost motion", va="center", backgroundcolor="white")
    axes.set_xlim(-1.7 * p, 2.2 * p)
    axes.text(p, axes.get_ylim()[0], " +p = 3 % of $T_N$", va="bottom")
    axes.text(-p, axes.get_ylim()[0], " −p", va="bottom")


def _arrow(axes: Axes, at: float, low: float, high: float) -> None:
    axes.annotate(
        "",
        (at, high),
        (at, low),
        arrowprops={
            "arrowstyle": "<|-|>",
            "color": DIMENSION,
            "linewidth": 1.2,
            "shrinkA": 0,
            "shrinkB": 0,
        },
    )


def errors(scratch: Path) -> str:
    """Run the demo, and draw the output module's errors along the dense sweep."""
    from torquebench.bench import default_bench
    from torquebench.calibration import load_profile
    from torquebench.campaign.demo import DemoSettings, run_demo
    from torquebench.station import Station

    with Station.open(default_bench(), scratch) as station:
        verification = load_profile("verification").with_options(groups=2, points=8)
        result = run_demo(
            station, DemoSettings(verification=verification, friction=None, models=(), seed=1)
        )
    module = next(each for each in result.modules if each.side == "output")
    sweep, best = module.dense, module.recommended
    assert sweep is not None
    assert best.dense_torque_nm is not None
    torque = sweep.true_torque_nm
    with mpl.rc_context(STYLE):
        figure, panels = new_figure(4.8, 2)
        for axes, error, title in (
            (panels[0], sweep.reading_nm - torque, "raw reading"),
            (panels[1], best.dense_torque_nm - torque, best.title),
        ):
            for sign, colour, label in (
                (1, RISING, "torque grows (rising branch)"),
                (-1, FALLING, "torque shrinks (falling branch)"),
            ):
                shown = np.where(sweep.branch == sign, error, np.nan)
                axes.plot(torque, shown, color=colour, linewidth=1.2, label=label)
            axes.set_ylabel("error in N·m")
            percent_axis(axes, module.range_nm)
            axes.text(
                0.99, 0.97, title, transform=axes.transAxes, va="top", ha="right", weight="bold"
            )
        limit = 0.001 * module.range_nm
        for sign, place in ((1, "bottom"), (-1, "top")):
            panels[1].axhline(sign * limit, color="#9A3412", linestyle="--", linewidth=0.9)
            panels[1].text(
                0.99 * torque.max(),
                sign * limit,
                f"{'+' if sign > 0 else '−'}0.1 % FS",
                color="#9A3412",
                ha="right",
                va=place,
            )
        panels[1].set_ylim(-1.6 * limit, 1.6 * limit)
        legend_above(panels[0])
        panels[1].set_xlabel("true torque in N·m")
        return svg_text(figure)
