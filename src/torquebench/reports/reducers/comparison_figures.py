"""Figures of comparisons as SVG text: values of specimens, and differences of quantities."""

from __future__ import annotations

import re
from collections.abc import Sequence
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from torquebench.campaign.reducers.comparison import ReducerComparison
from torquebench.figures import (
    COLOURS,
    RAW_COLOUR,
    blank_figure,
    legend_above,
    new_figure,
    styled,
    svg_text,
)
from torquebench.reducers import change_between

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLUMNS = 4
NEAR = 2.0
"""A limit is drawn if its distance from the values is at most this many times their span."""


def values_figure(found: ReducerComparison, keys: Sequence[str]) -> str:
    """Draw a diagram per quantity: every specimen with U, their mean, and the data sheet's limit.

    Parameters
    ----------
    found : ReducerComparison
    keys : sequence of str

    Returns
    -------
    str
        An ``<svg>`` element.
    """
    columns = min(COLUMNS, len(keys))
    rows = -(-len(keys) // columns)
    with styled():
        figure = blank_figure(1.95 * rows)
        panels = list(figure.subplots(rows, columns, squeeze=False).ravel())
        for axes, key in zip(panels, keys, strict=False):
            _panel(axes, found, key)
        for axes in panels[len(keys) :]:
            axes.set_axis_off()
        return svg_text(figure)


def _panel(axes: Axes, found: ReducerComparison, key: str) -> None:
    quantities = [each.quantities[key] for each in found.specimens]
    names = ["before", "after"] if found.changes else [each.name for each in found.specimens]
    value = np.array([each.estimate.value for each in quantities])
    expanded = np.array([each.estimate.expanded_uncertainty() for each in quantities])
    if not found.changes:
        mean = found.values[key].mean
        half = mean.expanded_uncertainty()
        axes.axhspan(mean.value - half, mean.value + half, color="#E3E6EA", zorder=0)
        axes.axhline(mean.value, color=RAW_COLOUR, lw=0.8, zorder=1)
    for place in range(value.size):
        colour = COLOURS[place % len(COLOURS)]
        axes.errorbar(
            place, value[place], expanded[place], fmt="o", color=colour, markersize=4, capsize=3
        )
    low, high = axes.get_ylim()
    number = re.search(r"\d+(\.\d+)?", quantities[0].limit)
    if number and low - NEAR * (high - low) <= float(number[0]) <= high + NEAR * (high - low):
        axes.axhline(float(number[0]), color="black", lw=1.0, ls="--")
    axes.set_xlim(-0.6, value.size - 0.4)
    axes.set_xticks(range(value.size), names, fontsize=7.5, rotation=0 if value.size < 4 else 45)
    axes.grid(visible=False, axis="x")
    axes.set_title(fill(quantities[0].title, 24), fontsize=8.5)
    axes.set_ylabel(quantities[0].estimate.unit, fontsize=8)
    axes.tick_params(axis="y", labelsize=7.5)


def difference_figure(found: ReducerComparison, keys: Sequence[str]) -> str:
    """Draw the differences ± U of many quantities of one unit, one row each.

    For before and after, the difference is after minus before. For specimens it is a specimen minus
    the mean of all; U is that of a difference between two specimens, in which common contributions
    cancel.

    Parameters
    ----------
    found : ReducerComparison
    keys : sequence of str
    """
    with styled():
        figure, (axes,) = new_figure(0.9 + 0.24 * len(keys))
        places = -np.arange(len(keys), dtype=np.float64)
        axes.axvline(0.0, color=RAW_COLOUR, lw=0.9)
        if found.changes:
            changes = [found.changes[key] for key in keys]
            for place, each in zip(places, changes, strict=True):
                axes.errorbar(
                    each.change.value,
                    place,
                    xerr=each.change.expanded_uncertainty(),
                    fmt="o",
                    color=COLOURS[1] if each.significant else COLOURS[0],
                    markersize=4,
                    capsize=2.5,
                )
            unit = changes[0].change.unit
        else:
            _specimens(axes, found, keys, places)
            unit = found.values[keys[0]].mean.unit
            legend_above(axes)
        titles = [found.title(key).removesuffix(", mean of both directions") for key in keys]
        axes.set_yticks(places, titles, fontsize=7.5)
        axes.set_ylim(places[-1] - 0.6, 0.6)
        axes.set_xlabel(f"difference in {unit}")
        return svg_text(figure)


def _specimens(
    axes: Axes,
    found: ReducerComparison,
    keys: Sequence[str],
    places: np.ndarray[tuple[int], np.dtype[np.float64]],
) -> None:
    count = len(found.specimens)
    for number, each in enumerate(found.specimens):
        shift = 0.5 * ((count - 1) / 2.0 - number) / count
        other = found.specimens[number - 1]
        value, expanded = [], []
        for key in keys:
            own = each.quantities[key].estimate
            value.append(own.value - found.values[key].mean.value)
            difference = change_between(
                key, other.quantities[key].estimate, own, same_calibration=found.same_chain
            )
            expanded.append(difference.change.expanded_uncertainty() / np.sqrt(2.0))
        axes.errorbar(
            value,
            places + shift,
            xerr=expanded,
            fmt="o",
            color=COLOURS[number % len(COLOURS)],
            label=each.name,
            markersize=3.5,
            capsize=2.0,
            lw=0.9,
        )
