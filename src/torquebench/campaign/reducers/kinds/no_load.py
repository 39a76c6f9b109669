"""No-load running torque: the input driven in steps of speed, the output free."""

from __future__ import annotations

import numpy as np

from torquebench.bench.devices import BenchDevices
from torquebench.campaign.reducers.sampling import cold_friction
from torquebench.campaign.reducers.uncertainty import (
    Bench,
    bench_remarks,
    drift_remarks,
    finite_temperature,
    tare_remarks,
    torque_uncertainty,
)
from torquebench.campaign.reducers.work import Evaluated, ReducerTestWork
from torquebench.figures import Curve, friction_figure
from torquebench.procedures import Plan
from torquebench.procedures.reducers.friction import FrictionSettings
from torquebench.procedures.reducers.running import NoLoadSettings, no_load_running
from torquebench.procedures.reducers.running_table import RunningRecording
from torquebench.procedures.reducers.setup import ReducerLimits, WarmUp
from torquebench.reducers import FrictionResult, NoLoadResult, ReducerDescription, evaluate_no_load


def _plan(
    devices: BenchDevices, limits: ReducerLimits, settings: NoLoadSettings
) -> Plan[RunningRecording]:
    return no_load_running(devices, limits, settings.within(limits))


def _evaluate(bench: Bench, _reducer: ReducerDescription, running: RunningRecording) -> Evaluated:
    """Evaluate the no-load running torque."""
    result = evaluate_no_load(
        running.speed_rpm["input"],
        running.torque_nm["input"],
        nominal_rpm=running.nominal_rpm,
        repeat=running.repeat,
        branch=running.branch,
        series=running.series,
        temperature_c=finite_temperature(running.temperature_c),
        uncertainty=torque_uncertainty(bench, running, "input"),
        tare=bench.tares.get("input"),
        zeroed=True,
        steady=True,
    )
    remarks = bench_remarks(bench, running.compensated, ("input",))
    return Evaluated(result, (*remarks, *tare_remarks(bench, running), *drift_remarks(running)))


def fitted_friction(result: FrictionResult, highest_rpm: float) -> Curve | None:
    """Return the fitted friction of both directions as a curve up to a speed."""
    speeds, torques = [], []
    for sign, fit in ((-1.0, result.counter_clockwise), (1.0, result.clockwise)):
        if fit is not None:
            speed = sign * np.linspace(0.02 * highest_rpm, highest_rpm, 120)
            speeds.append(speed)
            torques.append(fit.torque(speed))
    if not speeds:
        return None
    return Curve("fitted friction", np.concatenate(speeds), np.concatenate(torques))


def _figure(result: NoLoadResult) -> str:
    """Draw the no-load running torque over speed, every repeat, and the fitted friction."""
    fitted = fitted_friction(result.friction, float(np.max(np.abs(result.speed_rpm))))
    return friction_figure(result.speed_rpm, result.torque_nm, result.repeat, fit=fitted)


def _figures(result: NoLoadResult) -> tuple[tuple[str, str], ...]:
    caption = "No-load running torque at the input, every repeat, and the fitted friction."
    return ((_figure(result), caption),)


_FEW_SPEEDS = FrictionSettings(speeds_rpm=(100.0, 200.0, 300.0, 500.0, 700.0, 1000.0), repeats=2)

WORK = ReducerTestWork(
    settings=NoLoadSettings(),
    short=NoLoadSettings(_FEW_SPEEDS, WarmUp(longest_s=0.0), target_percent=None),
    recording=RunningRecording,
    plan=_plan,
    evaluate=_evaluate,
    figures=_figures,
    unsampled=lambda settings: cold_friction(settings.warm_up.longest_s),
)
