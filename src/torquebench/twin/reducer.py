"""The reducer under test: ratio, friction, torsional spring with hysteresis, transmission error."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from torquebench.kernels import inner, kernel

FloatArray = NDArray[np.float64]

# Indices of the reducer's state array.
BRISTLE = 0  # deflection of the friction bristles, rad at the input
STOPS = 1  # two stop operators of the spring's hysteresis, rad at the output
TWIST = 3  # twist in the previous step, rad at the output
GEAR_OFFSET = 4  # angle between both sides when mounted, rad at the output
LOSS_J = 5  # friction loss since the last reading, J
REDUCER_STATES = 6


class ReducerConstants(NamedTuple):
    """Constants of one reducer, whose output turns in the input's direction.

    Attributes
    ----------
    ratio : float
        Input turns for one output turn.
    rated_torque_nm : float
        T_N at the output.
    coulomb_nm, static_nm, stribeck_rad_s, viscous_nm_s : float
        No-load friction at the input at 23 °C.
    load_share : float
        Friction per transmitted torque (both referred to the input): 1/η − 1 without no-load part.
    coulomb_per_k, viscous_per_k : float
        Relative decrease of Coulomb friction and logarithmic decrease of viscosity per kelvin.
    bristle_rad : float
        Presliding deflection at break-away, at the input.
    output_drag_nm, output_viscous_nm_s : float
        Friction of the output's bearing and seal.
    stiffness_nm_rad : tuple of 3 float
        K1, K2, K3 at the output.
    corner_nm : pair of float
        T1, T2 at which the stiffness changes.
    backlash_rad : float
        Gap at the output.
    stop_width_rad, stop_stiffness_nm_rad : pair of float
        Hysteresis of the spring: half widths and stiffnesses of stop operators.
    damping_nm_s : float
        Damping of the twist at the output.
    error_order, error_rad, error_phase_rad : tuple of 6 float
        Transmission error: orders per output turn, amplitudes at the output, phases.
    input_inertia_kgm2, output_inertia_kgm2 : float
        Inertia of both sides.
    """

    ratio: float
    rated_torque_nm: float
    coulomb_nm: float
    static_nm: float
    stribeck_rad_s: float
    viscous_nm_s: float
    load_share: float
    coulomb_per_k: float
    viscous_per_k: float
    bristle_rad: float
    output_drag_nm: float
    output_viscous_nm_s: float
    stiffness_nm_rad: tuple[float, float, float]
    corner_nm: tuple[float, float]
    backlash_rad: float
    stop_width_rad: tuple[float, float]
    stop_stiffness_nm_rad: tuple[float, float]
    damping_nm_s: float
    error_order: tuple[float, float, float, float, float, float]
    error_rad: tuple[float, float, float, float, float, float]
    error_phase_rad: tuple[float, float, float, float, float, float]
    input_inertia_kgm2: float
    output_inertia_kgm2: float


@kernel
def transmission_error(reducer: ReducerConstants, output_angle_rad: float) -> tuple[float, float]:
    """Return the transmission error θ_o − θ_i/R without load, rad, and its slope over θ_o."""
    error, slope = 0.0, 0.0
    for k in range(6):
        order = reducer.error_order[k]
        angle = order * output_angle_rad + reducer.error_phase_rad[k]
        error += reducer.error_rad[k] * math.sin(angle)
        slope += reducer.error_rad[k] * order * math.cos(angle)
    return error, slope


@inner
def spring_torque(reducer: ReducerConstants, twist_rad: float) -> float:
    """Return the elastic torque at the output: backlash, then three stiffness regions."""
    deflection = abs(twist_rad) - 0.5 * reducer.backlash_rad
    if deflection <= 0.0:
        return 0.0
    first = reducer.corner_nm[0] / reducer.stiffness_nm_rad[0]
    second = first + (reducer.corner_nm[1] - reducer.corner_nm[0]) / reducer.stiffness_nm_rad[1]
    if deflection <= first:
        torque = reducer.stiffness_nm_rad[0] * deflection
    elif deflection <= second:
        torque = reducer.corner_nm[0] + reducer.stiffness_nm_rad[1] * (deflection - first)
    else:
        torque = reducer.corner_nm[1] + reducer.stiffness_nm_rad[2] * (deflection - second)
    return math.copysign(torque, twist_rad)


@kernel
def reducer_torque(
    reducer: ReducerConstants, state: FloatArray, twist_rad: float, twist_speed_rad_s: float
) -> float:
    """Return the reducer's torque on its output flange: spring, hysteresis, damping."""
    torque = spring_torque(reducer, twist_rad)
    change = twist_rad - state[TWIST]
    state[TWIST] = twist_rad
    for k in range(2):
        width = reducer.stop_width_rad[k]
        value = min(width, max(-width, state[STOPS + k] + change))
        state[STOPS + k] = value
        torque += reducer.stop_stiffness_nm_rad[k] * value
    contact = 1.0 if torque != 0.0 else 0.1
    return float(torque + contact * reducer.damping_nm_s * twist_speed_rad_s)


@kernel
def temperature_factors(reducer: ReducerConstants, temperature_c: float) -> tuple[float, float]:
    """Return the factors of Coulomb and of viscous friction at a temperature; 1 at 23 °C."""
    warmth = temperature_c - 23.0
    coulomb = max(0.3, 1.0 - reducer.coulomb_per_k * warmth)
    return coulomb, math.exp(-reducer.viscous_per_k * warmth)


@kernel
def friction_level(
    reducer: ReducerConstants,
    speed_rad_s: float,
    transmitted_nm: float,
    coulomb_factor: float,
) -> float:
    """Return the sliding friction at the input: Stribeck curve plus share of the load."""
    ratio = speed_rad_s / reducer.stribeck_rad_s
    rise = (reducer.static_nm - reducer.coulomb_nm) * math.exp(-ratio * ratio)
    load = reducer.load_share * abs(transmitted_nm) / reducer.ratio
    return coulomb_factor * (reducer.coulomb_nm + rise) + load


@inner
def reducer_friction(
    reducer: ReducerConstants,
    state: FloatArray,
    speed_rad_s: float,
    transmitted_nm: float,
    coulomb_factor: float,
    viscous_factor: float,
    step_s: float,
) -> float:
    """Return the friction torque at the input by the LuGre model, which sticks at standstill.

    The bristle's deflection is integrated implicitly, which is stable at any speed (Canudas de Wit
    et al., A new model for control of systems with friction, IEEE TAC 40 (1995) 419-425).
    """
    level = friction_level(reducer, speed_rad_s, transmitted_nm, coulomb_factor)
    stiffness = reducer.static_nm / reducer.bristle_rad
    before = state[BRISTLE]
    after = before + step_s * speed_rad_s
    after /= 1.0 + step_s * stiffness * abs(speed_rad_s) / level
    state[BRISTLE] = after
    damping = 0.6 * math.sqrt(stiffness * reducer.input_inertia_kgm2)
    torque = stiffness * after + damping * (after - before) / step_s
    return float(torque + reducer.viscous_nm_s * viscous_factor * speed_rad_s)
