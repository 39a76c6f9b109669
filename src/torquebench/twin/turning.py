"""Effects of rotation and temperature on a side: nonlinear drift, bearing drag, lubricant.

All are zero at 23 °C and standstill.
"""

import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.kernels import inner
from torquebench.message import Message
from torquebench.units import RAD_S_PER_RPM

FloatArray = NDArray[np.float64]

LubricantName = Literal["grease", "thin-grease", "oil"]

LUBRICANTS: dict[LubricantName, tuple[float, float]] = {
    "grease": (1.0, 1000.0),
    "thin-grease": (0.55, 880.0),
    "oil": (0.3, 760.0),
}
"""Viscosity at 23 °C as a share of the grease's, and Vogel's coefficient B, K."""

SEASONED_H = 1000.0
"""Hours after which a bearing counts as run in."""

# Indices of a side's row in the lubrication array.
VISCOSITY = 0  # at 23 °C, share of the grease's
VOGEL = 1  # K
AMOUNT = 2  # amount of lubricant; 1: as specified
HOURS = 3  # hours of turning since it was filled
LUBRICATION_STATES = 4

_REFERENCE_C = 23.0
_VOGEL_C = 95.0
_EXPONENT = 0.6  # exponent of the viscosity in the torque of a bearing
_RUNNING_IN = 0.4
_RUNNING_IN_H = 8.0
_AGEING_PER_H = 2e-5


class TurningConstants(NamedTuple):
    """Constants of one side; relative quantities are shares of the nominal torque.

    Attributes
    ----------
    zero_curvature_per_k2, span_curvature_per_k2 : float
        Drift beyond the linear one.
    zero_gradient_per_k : float
        Zero by the difference between the shaft's temperature and the transducer's.
    gradient_time_s : float
        Time constant with which the shaft follows.
    zero_square_s2, zero_odd_s : float
        Zero by the square of the speed, and by its direction.
    stribeck_nm, stribeck_rad_s : float
        Drag that decreases with speed, and the speed at which most of it has disappeared.
    power_nm, power_exponent, largest_speed_rad_s : float
        Drag by a power of the share of the largest speed.
    load : float
        Drag per torque.
    """

    zero_curvature_per_k2: float
    span_curvature_per_k2: float
    zero_gradient_per_k: float
    gradient_time_s: float
    zero_square_s2: float
    zero_odd_s: float
    stribeck_nm: float
    stribeck_rad_s: float
    power_nm: float
    power_exponent: float
    largest_speed_rad_s: float
    load: float


def draw_turning(
    generator: np.random.Generator,
    *,
    range_nm: float,
    largest_speed_rad_s: float,
    temperature_effect_per_k: float,
    wear: float,
) -> TurningConstants:
    """Draw a side's constants.

    Parameters
    ----------
    generator : numpy.random.Generator
        Generator of these constants only, so that all other constants stay the same.
    range_nm, largest_speed_rad_s, temperature_effect_per_k : float
        The side's design.
    wear : float
        Factor on the effects for a worn bench.
    """

    def signed(low: float, high: float) -> float:
        return float(generator.uniform(low, high) * generator.choice([-1.0, 1.0]))

    effect, scale = temperature_effect_per_k * wear, range_nm * wear
    by_speed = 1e-4 * wear / (1000.0 * RAD_S_PER_RPM)  # 0.01 % per 1000 rpm
    return TurningConstants(
        zero_curvature_per_k2=signed(0.0010, 0.0035) * effect,
        span_curvature_per_k2=signed(0.0010, 0.0035) * effect,
        zero_gradient_per_k=signed(0.05, 0.15) * effect,
        gradient_time_s=generator.uniform(200.0, 400.0),
        zero_square_s2=signed(0.1, 0.3) * by_speed / largest_speed_rad_s,
        zero_odd_s=signed(0.05, 0.15) * by_speed,
        stribeck_nm=generator.uniform(0.5e-5, 1.5e-5) * scale,
        stribeck_rad_s=generator.uniform(0.02, 0.06) * largest_speed_rad_s,
        power_nm=generator.uniform(0.8e-5, 2.0e-5) * scale,
        power_exponent=generator.uniform(0.5, 0.8),
        largest_speed_rad_s=largest_speed_rad_s,
        load=generator.uniform(1e-5, 3e-5) * wear,
    )


def fresh_lubrication(
    lubricant: LubricantName = "grease", amount: float = 1.0, hours: float = SEASONED_H
) -> FloatArray:
    """Return the state of a side's bearings with this lubricant.

    Parameters
    ----------
    lubricant : {"grease", "thin-grease", "oil"}
    amount : float
        Share of the specified amount, 0.1 to 3.
    hours : float
        Hours of turning since it was filled; fresh lubricant runs in over about ten hours.

    Raises
    ------
    InputError
        An unknown lubricant, or an amount or hours out of range.
    """
    if lubricant not in LUBRICANTS:
        raise InputError(
            Message("lubricant {lubricant!r}", lubricant),
            Message("one of {list}", ", ".join(LUBRICANTS)),
        )
    if not 0.1 <= amount <= 3.0:
        raise InputError(
            Message("{amount:g} of the lubricant", amount), "0.1 to 3 of what is specified"
        )
    if not 0.0 <= hours <= 1e6:
        raise InputError(
            Message("{hours:g} h since the lubricant was filled", hours), "0 to 1000000 h"
        )
    return np.array([*LUBRICANTS[lubricant], amount, hours])


@inner
def thickness(lubrication: FloatArray, temperature_c: float) -> float:
    """Return the lubricant's factor on the drag; 1 for run-in grease at 23 °C."""
    turn = 1.0 / (temperature_c + _VOGEL_C) - 1.0 / (_REFERENCE_C + _VOGEL_C)
    viscosity = lubrication[VISCOSITY] * math.exp(lubrication[VOGEL] * turn)
    filled = 0.6 + 0.4 * lubrication[AMOUNT]
    running_in = 1.0 + _RUNNING_IN * math.exp(-lubrication[HOURS] / _RUNNING_IN_H)
    ageing = 1.0 + _AGEING_PER_H * max(lubrication[HOURS] - SEASONED_H, 0.0)
    return float(viscosity**_EXPONENT * filled * running_in * ageing)


@inner
def drag(
    turning: TurningConstants, speed_rad_s: float, torque_nm: float, thickness: float
) -> float:
    """Return the bearings' drag beyond the Coulomb and viscous parts, against the motion."""
    direction = math.tanh(speed_rad_s / 0.05)
    size = abs(speed_rad_s)
    slower = size / turning.stribeck_rad_s
    result = turning.stribeck_nm * math.exp(-slower * slower)
    share = size / turning.largest_speed_rad_s
    result += thickness * turning.power_nm * share**turning.power_exponent
    return float(direction * (result + turning.load * abs(torque_nm)))


@inner
def signal_shift(
    turning: TurningConstants,
    relative: float,
    temperature_c: float,
    shaft_c: float,
    speed_rad_s: float,
) -> float:
    """Return the change of the transducer's signal as a share of its nominal torque."""
    warmth = temperature_c - _REFERENCE_C
    curve = turning.zero_curvature_per_k2 + turning.span_curvature_per_k2 * relative
    result = curve * warmth * warmth
    result += turning.zero_gradient_per_k * (shaft_c - temperature_c)
    result += turning.zero_square_s2 * speed_rad_s * speed_rad_s
    return float(result + turning.zero_odd_s * speed_rad_s)
