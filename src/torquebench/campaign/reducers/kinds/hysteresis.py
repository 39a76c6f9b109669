"""Torque-angle loops: stiffness, backlash, lost motion and loop energy with a locked input."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.devices import BenchDevices, SynchronousRecording
from torquebench.bench.roles import SIDES, Side
from torquebench.campaign.reducers.sampling import few_positions
from torquebench.campaign.reducers.uncertainty import (
    LARGE,
    Bench,
    bench_remarks,
    resolution_rad,
    root_mean_square,
    torque_of_loading,
    uncompensated_uncertainty_nm,
)
from torquebench.campaign.reducers.work import Evaluated, ReducerTestWork
from torquebench.figures import COLOURS, legend_above, new_figure, styled, svg_text
from torquebench.message import Message
from torquebench.procedures import Plan
from torquebench.procedures.reducers.loop import (
    HysteresisSettings,
    LoopRecording,
    hysteresis_loops,
)
from torquebench.procedures.reducers.setup import ReducerLimits
from torquebench.reducers import (
    FlangeInertia,
    HysteresisResult,
    LoopSettings,
    LoopUncertainty,
    ReducerDescription,
    evaluate_hysteresis,
)
from torquebench.units import ARCMIN

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = NDArray[np.float64]


def _plan(
    devices: BenchDevices, limits: ReducerLimits, settings: HysteresisSettings
) -> Plan[LoopRecording]:
    limits.check_modules(devices)
    return hysteresis_loops(devices, limits, settings)


def _loop_uncertainty(
    bench: Bench, ratio: float, loops: LoopRecording, recording: SynchronousRecording
) -> LoopUncertainty:
    """Split the torque's uncertainty by the influence of its errors on a loop."""
    unsure = {side: each.standard_uncertainty_rad_per_nm for side, each in bench.twists.items()}
    twist = float(np.hypot(unsure.get("output", 0.0), unsure.get("input", 0.0) / ratio**2))
    uncertainty = LoopUncertainty(
        angle_rad=resolution_rad(bench, "output") / np.sqrt(12.0),
        bench_compliance_rad_per_nm=twist,
    )
    if not loops.compensated["output"]:
        nominal = uncompensated_uncertainty_nm(bench, "output")
        relative = nominal / loops.torque_nm
        return replace(uncertainty, torque_relative=relative, torque_branch_nm=nominal)
    parts, size = recording.output_parts, np.abs(recording.output_torque_nm)
    large = torque_of_loading(parts, recording.output_torque_nm)
    loading = root_mean_square(parts.loading_nm)
    if max(loop.number for loop in loops.loops) == 1:  # no repeats show the scatter of loadings
        loading = float(np.hypot(loading, large.repeatability_nm))
    return replace(
        uncertainty,
        torque_relative=large.relative,
        torque_mounting=large.mounting_nm / root_mean_square(size[size > LARGE * np.max(size)]),
        torque_zero_nm=large.zero_nm,
        # A reducer's loop is an inner loop of the chain's own hysteresis: the model's residual
        # hysteresis separates the branches at every torque, near zero as much as elsewhere.
        torque_branch_nm=root_mean_square(parts.curve_nm),
        torque_loading_nm=loading,
    )


def _evaluate(bench: Bench, reducer: ReducerDescription, loops: LoopRecording) -> Evaluated:
    """Evaluate torque-angle loops of the output's angle against the input's."""
    flange = loops.flange or _described_flange(bench)
    parts = [loop.recording for loop in loops.loops]
    recording = SynchronousRecording.joined(parts)
    sizes = [part.time_s.size for part in parts]
    turned = {side: _flange_angle_rad(bench, recording, side) for side in SIDES}
    angle = turned["output"] - turned["input"] / reducer.signed_ratio
    settings = LoopSettings(
        rated_torque_nm=reducer.rated_torque_nm,
        rule=reducer.lost_motion_rule,
        stiffness_interval=reducer.stiffness_interval,
        region_torques_nm=reducer.region_torques_nm,
    )
    torque = recording.output_torque_nm
    if flange is not None:
        # The chain knows the acceleration of a block of samples, the angles give that of a shorter
        # window: inertia is corrected once, with the finer one.
        torque = torque - recording.output_inertia_nm
    result = evaluate_hysteresis(
        torque,
        angle,
        settings,
        position=np.repeat([loop.position_deg for loop in loops.loops], sizes),
        loop=np.repeat([loop.number for loop in loops.loops], sizes),
        resolution_rad=resolution_rad(bench, "output"),
        time_s=recording.time_s,
        flange=flange,
        uncertainty=_loop_uncertainty(bench, reducer.ratio, loops, recording),
    )
    remarks = bench_remarks(bench, loops.compensated, ("output",))
    remarks += _twist_remarks(bench)
    if any(finding.name == "torque ripple" for finding in result.findings):
        remarks.append(_flange_remark(flange))
    return Evaluated(result, tuple(remarks))


def _described_flange(bench: Bench) -> FlangeInertia | None:
    """Return the inertia between the output's transducer and the reducer, if described."""
    module = bench.description.output
    if module.flange_inertia_kgm2 is None:
        return None
    return FlangeInertia(module.flange_inertia_kgm2, module.flange_inertia_uncertainty_percent)


def _flange_remark(flange: FlangeInertia | None) -> str:
    """Say whether the torque that accelerates the output flange is subtracted."""
    if flange is None:
        return (
            "the inertia of the output flange isn't described: at reversals of the torque ripple, "
            "its torque is attributed to the reducer"
        )
    return Message("the torque that accelerates the output flange, {flange}, is subtracted", flange)


def _flange_angle_rad(bench: Bench, recording: SynchronousRecording, side: Side) -> FloatArray:
    """Return a flange's angle: the encoder's angle less the bench's twist between them.

    The locked input also twists. Its shaft carries the torque T/R, and its twist divided by the
    ratio appears at the output.
    """
    twist = bench.twists.get(side)
    angle = recording.angle_rad(side)
    return angle if twist is None else angle - twist.at(recording.torque_nm(side))


def _twist_remarks(bench: Bench) -> list[str]:
    """Say for each side whether the bench's own twist is subtracted."""
    if not bench.twists:
        return ["the bench's own twist isn't known: it is attributed to the reducer"]
    return [
        f"the bench's own twist at the {side}, {each.rad_per_nm / ARCMIN:.3g} arcmin per "
        f"N·m ({each.source}), is subtracted"
        for side, each in bench.twists.items()
    ]


def _figure(result: HysteresisResult) -> str:
    """Draw all torque-angle loops, and the key points of the first loop around zero."""
    with styled():
        figure, (loops, near) = new_figure(6.4, 2)
        positions = sorted({loop.position for loop in result.loops})
        for axes in (loops, near):
            labelled: set[float] = set()
            for loop in result.loops:
                curve = loop.curve
                middle = 0.5 * (np.interp(0.0, curve.torque_nm, curve.rising_rad + 0.0))
                middle += 0.5 * (np.interp(0.0, curve.torque_nm, curve.falling_rad))
                colour = COLOURS[positions.index(loop.position) % len(COLOURS)]
                for branch in (curve.rising_rad, curve.falling_rad):
                    label = None if loop.position in labelled else f"{loop.position:g}°"
                    labelled.add(loop.position)
                    angle_arcmin = (branch - middle) / ARCMIN
                    axes.plot(curve.torque_nm, angle_arcmin, color=colour, lw=0.9, label=label)
            axes.set_ylabel("output angle in arcmin")
        loops.set_xlabel("output torque in N·m")
        near.set_xlabel("output torque in N·m, around zero")
        legend_above(loops)
        _mark_key_points(loops, near, result)
        return svg_text(figure)


def _mark_key_points(whole: Axes, near: Axes, result: HysteresisResult) -> None:
    """Mark and label the key points of the first loop in both charts."""
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
        position = (point.torque_nm, (point.angle_rad - middle) / ARCMIN)
        axes = near if abs(point.torque_nm) <= reach else whole
        axes.plot(*position, "o", color="black", markersize=4.5, zorder=4)
        left = "↓" in point.label or ("↑" not in point.label and point.torque_nm > 0.0)
        axes.annotate(
            point.label,
            position,
            xytext=(-7, 4) if left else (7, -4),
            textcoords="offset points",
            ha="right" if left else "left",
            va="bottom" if left else "top",
            fontsize=8,
        )


def _figures(result: HysteresisResult) -> tuple[tuple[str, str], ...]:
    """Return the diagram of the loops with its caption."""
    caption = Message(
        "Output angle relative to the locked input over output torque, corrected for the bench's "
        "own twist if it is known; each loop is centred at zero. Below: the first loop's key "
        "points; lost motion: {rule}.",
        result.rule.words(),
    )
    return ((_figure(result), caption),)


WORK = ReducerTestWork(
    settings=HysteresisSettings(),
    short=HysteresisSettings(loops=2, positions_deg=(0.0,), loop_s=20.0),
    recording=LoopRecording,
    plan=_plan,
    evaluate=_evaluate,
    figures=_figures,
    unsampled=lambda settings: few_positions(len(settings.positions_deg)),
)
