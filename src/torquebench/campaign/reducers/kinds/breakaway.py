"""Starting and back-driving torque: ramps of torque until the reducer turns."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.devices import BenchDevices
from torquebench.bench.roles import SIDES, Side
from torquebench.campaign.reducers.sampling import few_positions
from torquebench.campaign.reducers.uncertainty import (
    Bench,
    bench_remarks,
    resolution_rad,
    temperature_remarks,
    torque_of_loading,
    uncompensated_uncertainty_nm,
)
from torquebench.campaign.reducers.work import Evaluated, ReducerTestWork
from torquebench.chain import TorqueParts
from torquebench.figures import COLOURS, legend_above, new_figure, styled, svg_text
from torquebench.procedures import Plan
from torquebench.procedures.reducers.first_motion import (
    Breakaway,
    BreakawayRecording,
    BreakawaySettings,
    breakaway,
)
from torquebench.procedures.reducers.setup import ReducerLimits
from torquebench.reducers import (
    BreakawayResult,
    ReducerDescription,
    TorqueUncertainty,
    evaluate_breakaway,
)
from torquebench.units import DEGREE

FloatArray = NDArray[np.float64]

PRESLIDING_RAD: dict[Side, float] = {"input": 0.5 * DEGREE, "output": 0.05 * DEGREE}
"""Largest movement by elastic contacts, backlash and wind-up while a side still counts as at
rest."""
TAKEN_AWAY = 0.85
"""Share of a ramp's largest torque below which the torque counts as released."""


def _plan(
    side: Side, devices: BenchDevices, limits: ReducerLimits, settings: BreakawaySettings
) -> Plan[BreakawayRecording]:
    return breakaway(devices, limits, side, settings)


def _evaluate(bench: Bench, _reducer: ReducerDescription, ramps: BreakawayRecording) -> Evaluated:
    """Evaluate starting or back-driving torque from ramps."""
    side = ramps.side
    parts = [_rising(ramp, side) for ramp in ramps.ramps]
    sizes = [part[0].size for part in parts]
    time_s, angle, torque = (
        np.concatenate(column) for column in zip(*(part[:3] for part in parts), strict=True)
    )
    uncertainty = TorqueUncertainty(model_nm=uncompensated_uncertainty_nm(bench, side))
    if ramps.compensated:
        uncertainty = torque_of_loading(TorqueParts.joined([part[3] for part in parts]), torque)
        # every ramp has its own zero, so that zero errors don't cancel in the mean of both
        # directions
        loading = float(np.hypot(uncertainty.loading_nm, uncertainty.zero_nm))
        uncertainty = replace(uncertainty, loading_nm=loading, zero_nm=0.0)
    result = evaluate_breakaway(
        time_s,
        angle,
        torque,
        kind="starting" if side == "input" else "back-driving",
        run=np.repeat(np.arange(len(sizes)), sizes),
        position=np.repeat([ramp.position_deg for ramp in ramps.ramps], sizes),
        uncertainty=uncertainty,
        resolution_rad=resolution_rad(bench, side),
        presliding_rad=PRESLIDING_RAD[side],
    )
    compensated: dict[Side, bool] = dict.fromkeys(SIDES, ramps.compensated)
    remarks = bench_remarks(bench, compensated, (side,))
    return Evaluated(result, (*remarks, *temperature_remarks(ramps.temperature_c)))


def _rising(ramp: Breakaway, side: Side) -> tuple[FloatArray, FloatArray, FloatArray, TorqueParts]:
    """Return the part of a ramp before the torque is removed.

    Once the reducer turns, the torque hardly rises, so that its maximum may be at any later time.
    """
    recording = ramp.recording
    torque = recording.torque_nm(side) - ramp.standing_nm
    pressed = torque * ramp.direction
    stop = int(np.flatnonzero(pressed >= TAKEN_AWAY * np.max(pressed))[-1]) + 1
    return (
        recording.time_s[:stop],
        recording.angle_rad(side)[:stop],
        torque[:stop],
        recording.parts(side).at(slice(stop)),
    )


def _figure(result: BreakawayResult) -> str:
    """Draw the torque at first motion of every ramp over the position."""
    position = np.array([run.position for run in result.runs])
    placed = bool(np.all(np.isfinite(position)))
    if not placed:
        position = np.array([run.label for run in result.runs])
    torque = np.array([run.torque_nm for run in result.runs])
    error = 2.0 * np.array([run.standard_uncertainty_nm for run in result.runs])
    with styled():
        figure, (axes,) = new_figure(2.9)
        for colour, sign, marker, name, middle in (
            (COLOURS[0], 1.0, "^", "clockwise", result.clockwise),
            (COLOURS[1], -1.0, "v", "counter-clockwise", result.counter_clockwise),
        ):
            same_direction = np.sign(torque) == sign
            if not same_direction.any() or middle is None:
                continue
            axes.errorbar(
                position[same_direction],
                np.abs(torque[same_direction]),
                error[same_direction],
                fmt=marker,
                color=colour,
                markersize=5,
                capsize=2.5,
                elinewidth=0.9,
                label=name,
            )
            axes.axhline(middle.value, color=colour, ls="--", lw=0.9, label=f"median, {name}")
        axes.set_xlabel("position in degrees" if placed else "ramp")
        axes.set_ylabel("torque at first motion in N·m")
        axes.margins(x=0.1, y=0.25)
        legend_above(axes)
        return svg_text(figure)


def _figures(result: BreakawayResult) -> tuple[tuple[str, str], ...]:
    caption = (
        "Torque at the first motion of every ramp; bars: U of the detected moment of motion only."
    )
    return ((_figure(result), caption),)


def _work(side: Side) -> ReducerTestWork:
    """Return the test of break-away torque for the side that is driven."""
    return ReducerTestWork(
        settings=BreakawaySettings(),
        short=BreakawaySettings(positions=2),
        recording=BreakawayRecording,
        plan=partial(_plan, side),
        evaluate=_evaluate,
        figures=_figures,
        unsampled=lambda settings: few_positions(settings.positions),
    )


STARTING, BACK_DRIVING = _work("input"), _work("output")
