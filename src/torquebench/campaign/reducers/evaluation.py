"""From what a reducer test recorded to its result: uncertainties of this bench, then evaluation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.devices import SynchronousRecording
from torquebench.bench.roles import SIDES, Side
from torquebench.campaign.reducers.uncertainty import (
    Bench,
    bench_remarks,
    nominal_nm,
    root_mean_square,
    torque_uncertainty,
    without_tare,
)
from torquebench.procedures.reducers.first_motion import Breakaway, BreakawayRecording
from torquebench.procedures.reducers.loop import LoopRecording
from torquebench.procedures.reducers.running_table import RunningRecording
from torquebench.procedures.reducers.turning import TransmissionRecording
from torquebench.reducers import (
    AngleUncertainty,
    FlangeInertia,
    LoopSettings,
    LoopUncertainty,
    ReducerDescription,
    ReducerResult,
    TorqueUncertainty,
    evaluate_breakaway,
    evaluate_efficiency,
    evaluate_hysteresis,
    evaluate_no_load,
    evaluate_transmission_error,
)
from torquebench.units import ARCMIN

__all__ = [
    "Evaluated",
    "evaluate_angles",
    "evaluate_grid",
    "evaluate_loops",
    "evaluate_ramps",
    "evaluate_running",
]

FloatArray = NDArray[np.float64]

PRESLIDING_RAD: dict[Side, float] = {"input": np.radians(0.5), "output": np.radians(0.05)}
"""What elastic contacts, backlash and wind-up may move before a side counts as turning."""
LARGE = 0.5
TAKEN_AWAY = 0.85
"""Share of the largest torque of a ramp below which its drive has let go."""


@dataclass(frozen=True)
class Evaluated:
    """A result, and what a reader has to know beside it."""

    result: ReducerResult
    remarks: tuple[str, ...]


# -- uncertainties of this bench ------------------------------------------------------------


def _loop_uncertainty(
    bench: Bench, ratio: float, loops: LoopRecording, recording: SynchronousRecording
) -> LoopUncertainty:
    """Split the torque's uncertainty into what grows with torque and what branches keep."""
    unsure = {side: each.standard_uncertainty_rad_per_nm for side, each in bench.twists.items()}
    twist = float(np.hypot(unsure.get("output", 0.0), unsure.get("input", 0.0) / ratio**2))
    known = LoopUncertainty(
        angle_rad=_resolution_rad(bench, "output") / np.sqrt(12.0),
        bench_compliance_rad_per_nm=twist,
    )
    if not loops.compensated["output"]:
        nominal = nominal_nm(bench, "output")
        relative = nominal / loops.torque_nm
        return replace(known, torque_relative=relative, torque_branch_nm=nominal)
    torque, whole = recording.output_torque_nm, recording.output_uncertainty_nm
    large = np.abs(torque) / loops.torque_nm > LARGE
    return replace(
        known,
        torque_relative=root_mean_square(whole[large] / np.abs(torque[large])),
        # A reducer's loop is an inner loop of the chain's own hysteresis: what the model leaves
        # of it stands between the branches at every torque, not only as little as near zero.
        torque_branch_nm=root_mean_square(recording.output_curve_nm),
    )


def _resolution_rad(bench: Bench, side: Side) -> float:
    return 2.0 * np.pi / bench.description.module(side).encoder.counts_per_revolution


def _encoder_rad(bench: Bench, side: Side, certified_rad: float | None) -> float:
    """Return the standard uncertainty of an encoder: resolution, and its error over a turn.

    An error that goes once around as a sine of the accuracy given has it divided by √2; where a
    certificate is taken off, its uncertainty stays.
    """
    if certified_rad is not None:
        return float(np.hypot(_resolution_rad(bench, side) / np.sqrt(12.0), certified_rad))
    accuracy = np.radians((bench.description.module(side).encoder.accuracy_arcsec or 0.0) / 3600.0)
    return float(np.hypot(_resolution_rad(bench, side) / np.sqrt(12.0), accuracy / np.sqrt(2.0)))


# -- one evaluation a test ------------------------------------------------------------------


def evaluate_loops(bench: Bench, reducer: ReducerDescription, loops: LoopRecording) -> Evaluated:
    """Evaluate torque-angle loops of the output's angle against the input's."""
    flange = _flange(bench)
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
    result = evaluate_hysteresis(
        recording.output_torque_nm,
        angle,
        settings,
        position=np.repeat([loop.position_deg for loop in loops.loops], sizes),
        loop=np.repeat([loop.number for loop in loops.loops], sizes),
        resolution_rad=_resolution_rad(bench, "output"),
        time_s=recording.time_s,
        flange=flange,
        uncertainty=_loop_uncertainty(bench, reducer.ratio, loops, recording),
    )
    remarks = bench_remarks(bench, loops.compensated, ("output",))
    remarks += _twist_remarks(bench)
    if any(finding.name == "torque ripple" for finding in result.findings):
        remarks.append(_flange_remark(flange))
    return Evaluated(result, tuple(remarks))


def _flange(bench: Bench) -> FlangeInertia | None:
    """Return what turns between the output's transducer and the reducer, where it is described."""
    module = bench.description.output
    if module.flange_inertia_kgm2 is None:
        return None
    return FlangeInertia(module.flange_inertia_kgm2, module.flange_inertia_uncertainty_percent)


def _flange_remark(flange: FlangeInertia | None) -> str:
    if flange is None:
        return (
            "the inertia of the output's flange isn't described: where the torque's ripple turns "
            "round, what the flange takes to move counts as the reducer's"
        )
    return f"what the output's flange takes to move, {flange}, is taken off"


def _flange_angle_rad(bench: Bench, recording: SynchronousRecording, side: Side) -> FloatArray:
    """Return the angle of a flange: its encoder's, less what the bench twists between them.

    The locked input counts too. Its shaft winds up under the torque that reaches it, T/R, and
    that angle comes to the output divided by the ratio once more.
    """
    twist = bench.twists.get(side)
    angle = recording.angle_rad(side)
    return angle if twist is None else angle - twist.at(recording.torque_nm(side))


def _twist_remarks(bench: Bench) -> list[str]:
    if not bench.twists:
        return ["the bench's own twist isn't known: it counts as the reducer's"]
    return [
        f"the bench's own twist at the {side}, {each.rad_per_nm / ARCMIN:.3g} arcmin per "
        f"N·m ({each.source}), is taken off"
        for side, each in bench.twists.items()
    ]


def evaluate_ramps(
    bench: Bench, _reducer: ReducerDescription, ramps: BreakawayRecording
) -> Evaluated:
    """Evaluate starting or back-driving torque from ramps."""
    side = ramps.side
    parts = [_rising(each, side) for each in ramps.ramps]
    sizes = [part[0].size for part in parts]
    time_s, angle, torque, whole = (np.concatenate(column) for column in zip(*parts, strict=True))
    # What a chain adds turns its sign with the torque: the mean of both directions keeps it.
    peak = max(float(np.max(np.abs(part[2]))) for part in parts)
    whole_nm = root_mean_square(whole) if ramps.compensated else nominal_nm(bench, side)
    relative = whole_nm / peak
    result = evaluate_breakaway(
        time_s,
        angle,
        torque,
        kind="starting" if side == "input" else "back-driving",
        run=np.repeat(np.arange(len(sizes)), sizes),
        position=np.repeat([each.position_deg for each in ramps.ramps], sizes),
        uncertainty=TorqueUncertainty(relative, 0.0),
        resolution_rad=_resolution_rad(bench, side),
        presliding_rad=PRESLIDING_RAD[side],
    )
    compensated: dict[Side, bool] = dict.fromkeys(SIDES, ramps.compensated)
    remarks = bench_remarks(bench, compensated, (side,))
    return Evaluated(result, (*remarks, *_temperature(ramps.temperature_c)))


def _rising(ramp: Breakaway, side: Side) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Cut a ramp where the torque is taken away again.

    Once it turns, the torque hardly rises any more: its largest sample is anywhere there.
    """
    recording = ramp.recording
    torque = recording.torque_nm(side) - ramp.standing_nm
    pressed = torque * ramp.direction
    stop = int(np.flatnonzero(pressed >= TAKEN_AWAY * np.max(pressed))[-1]) + 1
    return (
        recording.time_s[:stop],
        recording.angle_rad(side)[:stop],
        torque[:stop],
        recording.uncertainty_nm(side)[:stop],
    )


def _temperature(temperature_c: float) -> list[str]:
    return [f"reducer at {temperature_c:.1f} °C"] if np.isfinite(temperature_c) else []


def evaluate_running(
    bench: Bench, _reducer: ReducerDescription, running: RunningRecording
) -> Evaluated:
    """Evaluate the no-load running torque."""
    result = evaluate_no_load(
        running.speed_rpm["input"],
        running.torque_nm["input"],
        nominal_rpm=running.nominal_rpm,
        repeat=running.repeat,
        branch=running.branch,
        series=running.series,
        temperature_c=_known(running.temperature_c),
        uncertainty=torque_uncertainty(bench, running, "input"),
        tare=bench.tares.get("input"),
    )
    remarks = bench_remarks(bench, running.compensated, ("input",))
    return Evaluated(result, (*remarks, *_tare_remarks(bench), *_still(running)))


def _tare_remarks(bench: Bench) -> list[str]:
    if bench.tares:
        return ["what the shafts read in an empty run is taken off"]
    return [
        "no empty run: what speed does to the zero, and the drag of the bench's bearings, stand "
        "in the torque and in its uncertainty"
    ]


def evaluate_grid(
    bench: Bench, reducer: ReducerDescription, running: RunningRecording
) -> Evaluated:
    """Evaluate the efficiency map; the output's load is what brakes it, so its sign turns."""
    given, taken = running.torque_nm["input"], running.torque_nm["output"]
    speed = running.speed_rpm["input"]
    known = torque_uncertainty(bench, running, "input")
    given, known = without_tare(bench, given, speed, "input", known)
    other = torque_uncertainty(bench, running, "output")
    taken, other = without_tare(bench, taken, speed / reducer.signed_ratio, "output", other)
    result = evaluate_efficiency(
        given,
        -taken,
        speed,
        reducer.signed_ratio,
        temperature_c=_known(running.temperature_c),
        nominal_torque_nm=-running.nominal_nm,
        nominal_speed_rpm=running.nominal_rpm,
        input_uncertainty=known,
        output_uncertainty=other,
    )
    remarks = bench_remarks(bench, running.compensated, SIDES)
    return Evaluated(result, (*remarks, *_tare_remarks(bench), *_still(running)))


def _known(temperature_c: FloatArray) -> FloatArray | None:
    return temperature_c if np.isfinite(temperature_c).all() else None


def _still(running: RunningRecording) -> list[str]:
    if not running.unsettled:
        return []
    return [f"{running.unsettled} of {running.repeat.size} points still drifted"]


def evaluate_angles(
    bench: Bench, reducer: ReducerDescription, turning: TransmissionRecording
) -> Evaluated:
    """Evaluate the transmission error of both directions."""
    certified = turning.certified_rad
    known = AngleUncertainty(
        *(_encoder_rad(bench, side, certified.get(side)) for side in ("output", "input"))
    )
    result = evaluate_transmission_error(
        np.concatenate([each.input_angle_rad for each in turning.directions]),
        np.concatenate([each.output_angle_rad for each in turning.directions]),
        reducer.signed_ratio,
        time_s=np.concatenate([each.time_s for each in turning.directions]),
        highest_order=reducer.highest_error_order,
        uncertainty=known,
    )
    remarks = [
        f"of the {side} encoder only the resolution counts: its accuracy isn't described"
        for side in SIDES
        if bench.description.module(side).encoder.accuracy_arcsec is None and side not in certified
    ]
    remarks += [f"the {side} encoder is corrected by its certificate" for side in certified]
    return Evaluated(result, (*remarks, *_temperature(turning.temperature_c)))
