"""Temperatures of the hall, the transducers, the reducer and the calibrator."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from torquebench.kernels import inner
from torquebench.units import TURN

FloatArray = NDArray[np.float64]

PLACES = ("ambient", "input_transducer", "output_transducer", "reducer", "calibrator")
AMBIENT, INPUT_TRANSDUCER, OUTPUT_TRANSDUCER, REDUCER, CALIBRATOR = range(5)


CLIMATE = 7
"""Number of values of the hall's climate: mean, swing, its period, its start, drop, its interval
and duration.

In °C, K, s, s, K, s, s: a slow swing as over a day, and drops as when a gate is opened.
"""


class ThermalConstants(NamedTuple):
    """Constants of the temperatures.

    Attributes
    ----------
    ambient_c : float
        Mean of the hall's temperature.
    ambient_spread_k, ambient_time_s : float
        Slow change of the hall's temperature: standard deviation and correlation time.
    transducer_time_s : pair of float
        Time constants with which the transducers follow.
    transducer_heating_k_s : pair of float
        Final warming per speed (K per rad/s).
    calibrator_time_s : float
        Time constant of the calibrator.
    heat_capacity_j_k, cooling_w_k : float
        Heat capacity and cooling of the reducer with its housing.
    probe_error_k : tuple of 5 float
        Constant error of each probe, in the order of `PLACES`.
    """

    ambient_c: float
    ambient_spread_k: float
    ambient_time_s: float
    transducer_time_s: tuple[float, float]
    transducer_heating_k_s: tuple[float, float]
    calibrator_time_s: float
    heat_capacity_j_k: float
    cooling_w_k: float
    probe_error_k: tuple[float, float, float, float, float]


@inner
def hall_c(climate: FloatArray, time_s: float) -> float:
    """Return the temperature towards which the hall tends: mean, daily swing, and drops."""
    mean_c, swing_k, period_s, begun_s = climate[0], climate[1], climate[2], climate[3]
    drop_k, drop_every_s, drop_s = climate[4], climate[5], climate[6]
    since_s = time_s - begun_s
    target_c = mean_c
    if swing_k != 0.0:
        target_c += swing_k * math.sin(TURN * since_s / period_s)
    if drop_k != 0.0 and since_s % drop_every_s < drop_s:
        target_c -= drop_k
    return float(target_c)


@inner
def warm(
    thermal: ThermalConstants,
    temperature_c: FloatArray,
    ambient_target_c: float,
    speed_rad_s: FloatArray,
    loss_j: float,
    step_s: float,
    normal: float,
) -> None:
    """Advance ``temperature_c`` (as PLACES) in place by one step; ``normal`` draws the hall's."""
    rate = step_s / thermal.ambient_time_s
    spread = thermal.ambient_spread_k * math.sqrt(2.0 * rate) * normal
    temperature_c[AMBIENT] += rate * (ambient_target_c - temperature_c[AMBIENT]) + spread
    ambient = temperature_c[AMBIENT]
    for side in range(2):
        node = INPUT_TRANSDUCER + side
        target = ambient + thermal.transducer_heating_k_s[side] * abs(speed_rad_s[side])
        rate = step_s / thermal.transducer_time_s[side]
        temperature_c[node] += rate * (target - temperature_c[node])
    cooling = thermal.cooling_w_k * (temperature_c[REDUCER] - ambient)
    temperature_c[REDUCER] += (loss_j - cooling * step_s) / thermal.heat_capacity_j_k
    rate = step_s / thermal.calibrator_time_s
    temperature_c[CALIBRATOR] += rate * (ambient - temperature_c[CALIBRATOR])
