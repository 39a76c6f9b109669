"""The torque transducer: linearity, hysteresis with memory, creep, repeatability, drift, speed.

The running twin (1 ms steps with noise) and the noise-free quasi-static sweep (no elapsed time) use
the same step function.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from torquebench.kernels import inner

FloatArray = NDArray[np.float64]

REFERENCE_TEMPERATURE_C = 23.0

# Indices of the state array.
STOPS = 0  # three stop operators (complements of play operators), relative torque
CREEP = 3  # two creep terms, relative torque
SEATING = 5  # offset by the seating of the parts, units of the repeatability
SEATING_TORQUE = 6  # torque after a play operator that ignores ripple
LOADING_OFFSET = 7  # offset of the present loading, units of the repeatability
LOADING_SPAN = 8  # change of span of the present loading, units of the repeatability
LOADED = 9  # 1 once the torque has exceeded 5 % of the range
WANDER = 10  # slow drift, in its standard deviations
PREVIOUS = 11  # relative torque of the previous step
TRANSDUCER_STATES = 12

NOISES = 5  # standard normal numbers used in one step

_SEATING_PLAY = 0.003  # ripple below this share of the range doesn't change the seating
_SEATING_LENGTH = 0.006  # change of relative torque after which the seating is random again


class TransducerConstants(NamedTuple):
    """Constants of one transducer; relative quantities are shares of the nominal torque.

    Pairs hold the value for positive (clockwise) torque first, for negative torque second.

    Attributes
    ----------
    nominal_torque_nm : float
        Full scale.
    zero_hz : float
        Actual frequency at zero torque, before drift.
    sensitivity_hz_per_nm : pair of float
        Actual sensitivities.
    linearity : pair of float
        Deviation at half of full scale.
    linearity_cubic : float
        Odd cubic deviation, zero at full scale.
    stop_width : tuple of 3 float
        Half widths of the play operators, relative torque.
    stop_weight : tuple of 3 float
        Weights of the play operators; the loop's half width is Σ weight·width.
    creep, creep_time_s : tuple of 2 float
        Creep after infinite time per torque, and its time constants.
    zero_drift_per_k, span_drift_per_k : float
        Drift with temperature.
    zero_by_speed_s : float
        Relative zero change per rad/s.
    repeatability : float
        Standard deviation of a steady reading, relative.
    wander, wander_time_s : float
        Slow drift of the zero: standard deviation and correlation time.
    white : float
        Standard deviation of the noise of one 1 ms value, relative.
    lag_s, delay_s : float
        First-order lag of the bandwidth, and the rest of the group delay.
    """

    nominal_torque_nm: float
    zero_hz: float
    sensitivity_hz_per_nm: tuple[float, float]
    linearity: tuple[float, float]
    linearity_cubic: float
    stop_width: tuple[float, float, float]
    stop_weight: tuple[float, float, float]
    creep: tuple[float, float]
    creep_time_s: tuple[float, float]
    zero_drift_per_k: float
    span_drift_per_k: float
    zero_by_speed_s: float
    repeatability: float
    wander: float
    wander_time_s: float
    white: float
    lag_s: float
    delay_s: float


def fresh_transducer_state() -> FloatArray:
    """Return the state of a transducer that was never loaded."""
    return np.zeros(TRANSDUCER_STATES)


@inner
def _update_stops(constants: TransducerConstants, state: FloatArray, relative: float) -> float:
    """Move the stop operators to the new torque, and return the hysteresis, relative.

    A stop operator is the complement of a play operator: s = x − play(x), within ± width. Their
    weighted sum makes the reading lag behind the torque, closes loops, and has no memory of closed
    inner loops (wiping-out).
    """
    change = relative - state[PREVIOUS]
    lag = 0.0
    for k in range(3):
        width = constants.stop_width[k]
        value = min(width, max(-width, state[STOPS + k] + change))
        state[STOPS + k] = value
        lag += constants.stop_weight[k] * value
    return -lag


@inner
def _update_repeatability(
    constants: TransducerConstants, state: FloatArray, relative: float, normal: FloatArray
) -> float:
    """Re-seat the parts as the torque changes, at random for each loading; return the deviation."""
    before = state[SEATING_TORQUE]
    after = min(relative + _SEATING_PLAY, max(relative - _SEATING_PLAY, before))
    state[SEATING_TORQUE] = after
    if after != before:
        decay = math.exp(-abs(after - before) / _SEATING_LENGTH)
        state[SEATING] = decay * state[SEATING] + math.sqrt(1.0 - decay * decay) * normal[0]
    if abs(relative) > 0.05:
        state[LOADED] = 1.0
    elif state[LOADED] > 0.0 and abs(relative) < 0.005:
        state[LOADED] = 0.0
        state[LOADING_OFFSET] = normal[1]
        state[LOADING_SPAN] = normal[2]
    magnitude = min(1.0, abs(relative))
    pressed = 0.2 + 0.8 * min(
        1.0, magnitude / 0.02
    )  # with little load there is little seating error
    spread = 0.8 * pressed * state[SEATING] + 0.2 * state[LOADING_OFFSET]
    spread += 0.55 * magnitude * state[LOADING_SPAN]
    return float(constants.repeatability * spread)


@inner
def transducer_signal(
    constants: TransducerConstants,
    state: FloatArray,
    torque_nm: float,
    temperature_c: float,
    speed_rad_s: float,
    elapsed_s: float,
    normal: FloatArray,
) -> float:
    """Return the transducer's signal after one step, in N·m of actual sensitivity.

    Parameters
    ----------
    constants : TransducerConstants
        The transducer.
    state : float64[TRANSDUCER_STATES]
        State, changed in place.
    torque_nm, temperature_c, speed_rad_s : float
        Torque at the transducer, its temperature, the shaft's speed.
    elapsed_s : float
        Time since the previous step; 0 keeps creep and slow drift unchanged.
    normal : float64[NOISES]
        Standard normal numbers; zeros give the noise-free signal.

    Returns
    -------
    float
        Signal in N·m, zero drift included.
    """
    relative = torque_nm / constants.nominal_torque_nm
    direction = 0 if relative >= 0.0 else 1
    magnitude = abs(relative)
    deviation = 4.0 * constants.linearity[direction] * relative * (1.0 - magnitude)
    deviation += constants.linearity_cubic * relative * (1.0 - relative * relative)
    deviation += _update_stops(constants, state, relative)
    deviation += _update_repeatability(constants, state, relative, normal)
    for k in range(2):
        rate = elapsed_s / constants.creep_time_s[k]
        state[CREEP + k] += rate * (constants.creep[k] * relative - state[CREEP + k])
        deviation += state[CREEP + k]
    if elapsed_s > 0.0:
        rate = elapsed_s / constants.wander_time_s
        state[WANDER] += -rate * state[WANDER] + math.sqrt(2.0 * rate) * normal[3]
    deviation += constants.wander * state[WANDER] + constants.white * normal[4]
    warmth = temperature_c - REFERENCE_TEMPERATURE_C
    deviation += constants.zero_drift_per_k * warmth
    deviation += constants.span_drift_per_k * warmth * relative
    deviation += constants.zero_by_speed_s * abs(speed_rad_s)
    state[PREVIOUS] = relative
    return float(torque_nm + deviation * constants.nominal_torque_nm)


@inner
def transducer_frequency(constants: TransducerConstants, signal_nm: float) -> float:
    """Return the output frequency of the transducer in Hz."""
    direction = 0 if signal_nm >= 0.0 else 1
    return constants.zero_hz + constants.sensitivity_hz_per_nm[direction] * signal_nm
