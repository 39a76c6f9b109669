"""Torque that turns a reducer of the twin, without noise."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.twin import reducer as red
from torquebench.twin.reducer import ReducerConstants
from torquebench.units import RAD_S_PER_RPM

FloatArray = NDArray[np.float64]


def _output_drag(
    reducer: ReducerConstants, output_rad_s: FloatArray, viscosity_factor: float
) -> FloatArray:
    """Return the drag of the output's bearing and seal, N·m; it fades below 0.005 rad/s."""
    drag = reducer.output_drag_nm * np.tanh(output_rad_s / 0.005)
    return np.asarray(drag + reducer.output_viscous_nm_s * viscosity_factor * output_rad_s)


def input_torque_nm(
    reducer: ReducerConstants, speed_rpm: ArrayLike, load_nm: ArrayLike, temperature_c: float
) -> FloatArray:
    """Return the input torque that turns the reducer at a speed against an output load, N·m."""
    speed, load = np.broadcast_arrays(np.asarray(speed_rpm, float) * RAD_S_PER_RPM, load_nm)
    coulomb, viscous = red.temperature_factors(reducer, temperature_c)
    gear = _output_drag(reducer, np.abs(speed) / reducer.ratio, viscous) + load
    level = [
        float(red.friction_level(reducer, abs(float(s)), float(g), coulomb))
        for s, g in zip(speed.ravel(), gear.ravel(), strict=True)
    ]
    friction = np.reshape(level, speed.shape) + reducer.viscous_nm_s * viscous * np.abs(speed)
    return np.asarray(friction + gear / reducer.ratio)


def true_no_load_nm(
    reducer: ReducerConstants, speed_rpm: ArrayLike, temperature_c: float
) -> FloatArray:
    """Return the torque that keeps the input turning at a speed, output free, N·m; above 0."""
    return input_torque_nm(reducer, speed_rpm, 0.0, temperature_c)
