"""Efficiency over torque and speed: the input driven, the output braking."""

from __future__ import annotations

import numpy as np

from torquebench.bench.devices import BenchDevices
from torquebench.bench.roles import SIDES
from torquebench.campaign.reducers.sampling import cold_efficiency
from torquebench.campaign.reducers.uncertainty import (
    Bench,
    bench_remarks,
    drift_remarks,
    finite_temperature,
    tare_remarks,
    torque_uncertainty,
    without_tare,
)
from torquebench.campaign.reducers.work import Evaluated, ReducerTestWork
from torquebench.figures import new_figure, styled, svg_text
from torquebench.procedures import Plan
from torquebench.procedures.reducers.running import EfficiencySettings, efficiency_map
from torquebench.procedures.reducers.running_table import RunningRecording
from torquebench.procedures.reducers.setup import ReducerLimits, WarmUp
from torquebench.reducers import EfficiencyMap, ReducerDescription, evaluate_efficiency

LEAST_MAP = 2
"""Smallest number of torques and of speeds for iso-lines."""


def _plan(
    devices: BenchDevices, limits: ReducerLimits, settings: EfficiencySettings
) -> Plan[RunningRecording]:
    limits.check_modules(devices)
    return efficiency_map(devices, limits, settings.within(limits))


def _evaluate(bench: Bench, reducer: ReducerDescription, running: RunningRecording) -> Evaluated:
    """Evaluate the efficiency map; the output is braked, so its torque changes sign."""
    speed = running.speed_rpm["input"]
    driving, u_driving = without_tare(
        bench,
        running.torque_nm["input"],
        speed,
        "input",
        torque_uncertainty(bench, running, "input"),
    )
    braking, u_braking = without_tare(
        bench,
        running.torque_nm["output"],
        speed / reducer.signed_ratio,
        "output",
        torque_uncertainty(bench, running, "output"),
    )
    result = evaluate_efficiency(
        driving,
        -braking,
        speed,
        reducer.signed_ratio,
        temperature_c=finite_temperature(running.temperature_c),
        nominal_torque_nm=-running.nominal_nm,
        nominal_speed_rpm=running.nominal_rpm,
        input_uncertainty=u_driving,
        output_uncertainty=u_braking,
        steady=True,
    )
    remarks = bench_remarks(bench, running.compensated, SIDES)
    return Evaluated(result, (*remarks, *tare_remarks(bench, running), *drift_remarks(running)))


def _figure(result: EfficiencyMap) -> str:
    """Draw the efficiency over speed and torque with iso-lines and the measured points.

    Where only one torque or one speed was measured there are no iso-lines.
    """
    points = [point for point in result.points if point.driving == "input"] or list(result.points)
    direction = 1 if any(point.speed_rpm > 0 for point in points) else -1
    points = [point for point in points if point.speed_rpm * direction > 0]
    speed = np.array([point.speed_rpm for point in points])
    torque = np.array([point.torque_nm for point in points])
    value = np.array([point.efficiency.value for point in points])
    with styled():
        figure, (axes,) = new_figure(3.9)
        axes.grid(visible=False)
        if _count_levels(speed) >= LEAST_MAP and _count_levels(torque) >= LEAST_MAP:
            speeds, torques, efficiency = result.grid(points[0].driving, direction, 241)
            measured = np.ma.masked_invalid(efficiency)
            filled = axes.contourf(speeds, torques, measured, 14, cmap="viridis")
            figure.colorbar(filled, ax=axes, label="efficiency in %", pad=0.02)
            lines = axes.contour(speeds, torques, measured, 7, colors="white", linewidths=0.8)
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
        axes.use_sticky_edges = False  # the measured points are on the map's edges
        axes.margins(0.06)
        axes.autoscale_view()
        axes.set_xlabel("input speed in rpm")
        axes.set_ylabel("output torque in N·m")
        return svg_text(figure)


def _count_levels(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> int:
    """Return the number of levels of a set point: they differ by more than 2 % of the largest."""
    ordered = np.sort(np.abs(values))
    return 1 + int(np.count_nonzero(np.diff(ordered) > 0.02 * ordered[-1]))


def _figures(result: EfficiencyMap) -> tuple[tuple[str, str], ...]:
    caption = (
        "Efficiency over input speed and output torque: measured points, and iso-lines by "
        "interpolation of the input torque."
    )
    return ((_figure(result), caption),)


WORK = ReducerTestWork(
    settings=EfficiencySettings(),
    short=EfficiencySettings(
        torque_shares=(0.25, 0.5, 1.0),
        speeds_rpm=(300.0, 900.0),
        counter_clockwise=False,
        repeats=1,
        target_points=None,
        warm_up=WarmUp(longest_s=0.0),
    ),
    recording=RunningRecording,
    plan=_plan,
    evaluate=_evaluate,
    figures=_figures,
    unsampled=lambda settings: cold_efficiency(settings.warm_up.longest_s),
)
