"""From what a reducer test recorded to its result: uncertainties of this bench, then evaluation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.description import BenchDescription
from torquebench.bench.devices import SynchronousRecording
from torquebench.bench.roles import SIDES, Side
from torquebench.procedures.reducer_breakaway import BreakawayRecording
from torquebench.procedures.reducer_loop import BenchTwistRecording, LoopRecording
from torquebench.procedures.reducer_running import RunningRecording
from torquebench.procedures.reducer_turning import TransmissionRecording
from torquebench.reducers import (
    AngleUncertainty,
    AnyResult,
    LoopSettings,
    LoopUncertainty,
    ReducerDescription,
    TorqueUncertainty,
    evaluate_breakaway,
    evaluate_efficiency,
    evaluate_hysteresis,
    evaluate_no_load,
    evaluate_transmission_error,
)

__all__ = ["EVALUATIONS", "UNCOMPENSATED_SHARE", "Evaluated", "TwistCompliance", "twist_compliance"]

FloatArray = NDArray[np.float64]

UNCOMPENSATED_SHARE = 0.005
"""Half width of what a chain without compensation may be off, as a share of full scale: the
0.5 % that such benches are reported with (Measurement and Control, 2022, introduction)."""
REPEATABILITY_SHARE = 2e-4
"""Standard deviation by which a chain gives another torque for the same one after its load has
changed, as a share of full scale: 0.01-0.03 % is what transducers of this class are sold with.
It stays as long as the torque does, so that no window averages it."""
TURNING_SHARE = 1e-4
"""Half width of what 1000 rpm move the zero by, as a share of full scale; the zero is taken, and
the chain calibrated, at standstill."""
PRESLIDING_RAD: dict[Side, float] = {"input": np.radians(0.5), "output": np.radians(0.05)}
"""What elastic contacts, backlash and wind-up may move before a side counts as turning."""
LARGE = 0.5


@dataclass(frozen=True)
class TwistCompliance:
    """How far the bench itself twists between the output encoder and the flange.

    Parameters
    ----------
    rad_per_nm : float
    standard_uncertainty_rad_per_nm : float
    source : str
        Where it comes from, for the record.
    """

    rad_per_nm: float = 0.0
    standard_uncertainty_rad_per_nm: float = 0.0
    source: str = ""


@dataclass(frozen=True)
class Evaluated:
    """A result, and what a reader has to know beside it."""

    result: AnyResult
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class Bench:
    """What an evaluation has to know of the bench."""

    description: BenchDescription
    twist: TwistCompliance


def twist_compliance(recording: BenchTwistRecording) -> TwistCompliance:
    """Return the output side's compliance from cycles against the held calibrator.

    The slope of angle over torque by least squares; rising and falling legs count alike, so that
    what the shaft holds back by its own hysteresis cancels. Its uncertainty is the scatter of
    the slopes of single legs.
    """
    output = recording.recordings["output"]
    torque, angle = output.output_torque_nm, output.output_angle_rad
    slope = float(np.polyfit(torque, angle, 1)[0])
    direction = np.sign(np.gradient(torque))
    singles = [
        float(np.polyfit(torque[direction == sign], angle[direction == sign], 1)[0])
        for sign in (1.0, -1.0)
        if np.count_nonzero(direction == sign) > 8
    ]
    spread = float(np.ptp(singles)) / np.sqrt(12.0) if len(singles) == 2 else 0.05 * abs(slope)
    return TwistCompliance(slope, spread, f"measured against {recording.standard_serial}")


# -- uncertainties of this bench ------------------------------------------------------------


def _standard_relative(bench: Bench) -> float:
    """Return the standard uncertainty that the calibrator passes on, as a share of the torque."""
    return bench.description.calibrator.expanded_uncertainty_percent / 200.0


def _nominal_nm(bench: Bench, side: Side) -> float:
    """Return the standard uncertainty of a torque without compensation, N·m."""
    range_nm = bench.description.module(side).range_nm
    return float(UNCOMPENSATED_SHARE * range_nm / np.sqrt(3.0))


def _remarks(bench: Bench, compensated: dict[Side, bool], sides: Sequence[Side]) -> list[str]:
    return [
        f"the {side} torque is not compensated: its uncertainty is the {UNCOMPENSATED_SHARE:.1%} "
        f"of {bench.description.module(side).range_nm:g} N·m that such chains are reported with"
        for side in sides
        if not compensated[side]
    ]


def _root_mean_square(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else 0.0


def _loop_uncertainty(bench: Bench, loops: LoopRecording) -> LoopUncertainty:
    """Split the active model's uncertainty into what grows with torque and what branches keep."""
    twist = bench.twist.standard_uncertainty_rad_per_nm
    angle = _resolution_rad(bench, "output") / np.sqrt(12.0)
    if not loops.compensated["output"]:
        nominal = _nominal_nm(bench, "output")
        relative = max(_standard_relative(bench), nominal / loops.torque_nm)
        return LoopUncertainty(
            torque_relative=relative,
            torque_branch_nm=nominal,
            angle_rad=angle,
            bench_compliance_rad_per_nm=twist,
        )
    torque = np.concatenate([loop.recording.output_torque_nm for loop in loops.loops])
    model = np.concatenate([loop.recording.output_uncertainty_nm for loop in loops.loops])
    share = np.abs(torque) / loops.torque_nm
    large = share > LARGE
    growing = _root_mean_square(model[large] / np.abs(torque[large]))
    return LoopUncertainty(
        torque_relative=float(np.hypot(growing, _standard_relative(bench))),
        # A reducer's loop is an inner loop of the chain's own hysteresis: what the model leaves
        # of it stands between the branches at every torque, not only as little as near zero.
        torque_branch_nm=_root_mean_square(model),
        angle_rad=angle,
        bench_compliance_rad_per_nm=twist,
    )


def _resolution_rad(bench: Bench, side: Side) -> float:
    return 2.0 * np.pi / bench.description.module(side).encoder.counts_per_revolution


def _encoder_rad(bench: Bench, side: Side) -> float:
    """Return the standard uncertainty of an encoder: resolution, and its error over a turn.

    An error that goes once around as a sine of the accuracy given has it divided by √2.
    """
    accuracy = np.radians((bench.description.module(side).encoder.accuracy_arcsec or 0.0) / 3600.0)
    return float(np.hypot(_resolution_rad(bench, side) / np.sqrt(12.0), accuracy / np.sqrt(2.0)))


def _torque_uncertainty(bench: Bench, recording: RunningRecording, side: Side) -> TorqueUncertainty:
    range_nm = bench.description.module(side).range_nm
    fastest = float(np.max(np.abs(recording.speed_rpm[side]), initial=0.0)) / 1000.0
    turning = TURNING_SHARE * fastest / np.sqrt(3.0)
    standing = recording.zero_uncertainty_nm[side]
    zero = float(np.hypot(standing, range_nm * np.hypot(REPEATABILITY_SHARE, turning)))
    if not recording.compensated[side]:
        zero = float(np.hypot(zero, _nominal_nm(bench, side)))
        return TorqueUncertainty(_standard_relative(bench), zero)
    model, torque = recording.model_uncertainty_nm[side], np.abs(recording.torque_nm[side])
    growing = float(np.min(model / np.maximum(torque, 1e-9)))
    rest = np.sqrt(np.maximum(model**2 - (growing * torque) ** 2, 0.0))
    return TorqueUncertainty(
        float(np.hypot(growing, _standard_relative(bench))),
        float(np.hypot(zero, _root_mean_square(rest))),
    )


# -- one evaluation a test ------------------------------------------------------------------


def evaluate_loops(bench: Bench, reducer: ReducerDescription, loops: LoopRecording) -> Evaluated:
    """Evaluate torque-angle loops of the output's angle against the input's."""
    parts = [loop.recording for loop in loops.loops]
    recording = SynchronousRecording.joined(parts)
    sizes = [part.time_s.size for part in parts]
    angle = recording.output_angle_rad - recording.input_angle_rad / reducer.signed_ratio
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
        bench_compliance_rad_per_nm=bench.twist.rad_per_nm,
        uncertainty=_loop_uncertainty(bench, loops),
    )
    remarks = _remarks(bench, loops.compensated, ("output",))
    if bench.twist.source:
        remarks.append(
            f"the bench's own twist, {bench.twist.rad_per_nm * 180 * 60 / np.pi:.3g} arcmin per "
            f"N·m ({bench.twist.source}), is taken off"
        )
    else:
        remarks.append("the bench's own twist isn't known: it counts as the reducer's")
    return Evaluated(result, tuple(remarks))


def evaluate_ramps(
    bench: Bench, _reducer: ReducerDescription, ramps: BreakawayRecording
) -> Evaluated:
    """Evaluate starting or back-driving torque from ramps."""
    side = ramps.side
    parts = [_rising(each.recording, side, each.direction) for each in ramps.ramps]
    sizes = [part[0].size for part in parts]
    time_s, angle, torque, model = (np.concatenate(column) for column in zip(*parts, strict=True))
    nominal = _nominal_nm(bench, side)
    zero = _root_mean_square(model) if ramps.compensated else nominal
    # What a chain adds turns its sign with the torque: the mean of both directions keeps it.
    peak = max(float(np.max(np.abs(part[2]))) for part in parts)
    relative = float(np.hypot(_standard_relative(bench), zero / peak))
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
    remarks = _remarks(bench, compensated, (side,))
    return Evaluated(result, (*remarks, *_temperature(ramps.temperature_c)))


def _rising(
    recording: SynchronousRecording, side: Side, direction: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Cut a ramp where the torque begins to be taken away again."""
    torque = recording.torque_nm(side)
    stop = int(np.argmax(torque * direction)) + 1
    model = recording.input_uncertainty_nm if side == "input" else recording.output_uncertainty_nm
    return (
        recording.time_s[:stop],
        recording.angle_rad(side)[:stop],
        torque[:stop],
        model[:stop],
    )


def _temperature(temperature_c: float) -> list[str]:
    return [f"reducer at {temperature_c:.1f} °C"] if np.isfinite(temperature_c) else []


def evaluate_running(
    bench: Bench, _reducer: ReducerDescription, running: RunningRecording
) -> Evaluated:
    """Evaluate the no-load running torque."""
    result = evaluate_no_load(
        running.nominal_rpm,
        running.torque_nm["input"],
        repeat=running.repeat,
        branch=running.branch,
        temperature_c=_known(running.temperature_c),
        uncertainty=_torque_uncertainty(bench, running, "input"),
    )
    return Evaluated(result, (*_remarks(bench, running.compensated, ("input",)), *_still(running)))


def evaluate_grid(
    bench: Bench, reducer: ReducerDescription, running: RunningRecording
) -> Evaluated:
    """Evaluate the efficiency map; the output's load is what brakes it, so its sign turns."""
    load = -running.torque_nm["output"]
    result = evaluate_efficiency(
        running.torque_nm["input"],
        load,
        running.speed_rpm["input"],
        reducer.signed_ratio,
        temperature_c=_known(running.temperature_c),
        nominal_torque_nm=-running.nominal_nm,
        nominal_speed_rpm=running.nominal_rpm,
        input_uncertainty=_torque_uncertainty(bench, running, "input"),
        output_uncertainty=_torque_uncertainty(bench, running, "output"),
    )
    return Evaluated(result, (*_remarks(bench, running.compensated, SIDES), *_still(running)))


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
    known = AngleUncertainty(_encoder_rad(bench, "output"), _encoder_rad(bench, "input"))
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
        if bench.description.module(side).encoder.accuracy_arcsec is None
    ]
    return Evaluated(result, (*remarks, *_temperature(turning.temperature_c)))


EVALUATIONS: dict[str, Callable[[Bench, ReducerDescription, Any], Evaluated]] = {
    "no-load": evaluate_running,
    "starting": evaluate_ramps,
    "back-driving": evaluate_ramps,
    "hysteresis": evaluate_loops,
    "transmission-error": evaluate_angles,
    "efficiency": evaluate_grid,
}
"""Evaluation by the name of the test."""
