"""Additional torque of the chain: the difference between the transducer's torque and the true one.

The quadratic parts of each direction are the sources' equations (`torquebench.mechanics`). The
other parts are no polynomials: the step at torque reversal, the spline's engagement and local
bumps.
"""

import math
from typing import NamedTuple

from torquebench.kernels import inner, kernel
from torquebench.units import TURN


class ChainConstants(NamedTuple):
    """Constants of one module's chain; torque in N·m, relative quantities by ``range_nm``.

    Pairs hold the value for positive (clockwise) torque first, for negative torque second.

    Attributes
    ----------
    range_nm : float
        Full scale.
    constant_nm, linear, quadratic_per_nm : pair of float
        c₀, c₁, c₂ of the sources' equations.
    reversal_width : float
        Width of the smoothed step at torque reversal, relative to the range.
    ripple_nm, ripple_period, ripple_phase_rad : pair of float
        Spline engagement: amplitude, period in relative torque, phase.
    bump_nm, bump_centre, bump_width : tuple of 4 float
        Local bumps: height, signed relative centre, relative standard width.
    engagement_by_angle, engagement_phase_rad : float
        Once-per-turn change of the span with the shaft's angle.
    misalignment_nm_s2 : tuple of 3 float
        Torque ripple per squared speed at one, two and three times the rotation frequency.
    misalignment_phase_rad : tuple of 3 float
        Their phases.
    drag_nm, drag_viscous_nm_s : float
        Drag of the bearings between transducer and flange while the shaft turns.
    """

    range_nm: float
    constant_nm: tuple[float, float]
    linear: tuple[float, float]
    quadratic_per_nm: tuple[float, float]
    reversal_width: float
    ripple_nm: tuple[float, float]
    ripple_period: tuple[float, float]
    ripple_phase_rad: tuple[float, float]
    bump_nm: tuple[float, float, float, float]
    bump_centre: tuple[float, float, float, float]
    bump_width: tuple[float, float, float, float]
    engagement_by_angle: float
    engagement_phase_rad: float
    misalignment_nm_s2: tuple[float, float, float]
    misalignment_phase_rad: tuple[float, float, float]
    drag_nm: float
    drag_viscous_nm_s: float


def without_chain(chain: ChainConstants) -> ChainConstants:
    """Return the constants of a transducer by itself, without a chain up to the flange."""
    return chain._replace(
        constant_nm=(0.0, 0.0),
        linear=(0.0, 0.0),
        quadratic_per_nm=(0.0, 0.0),
        ripple_nm=(0.0, 0.0),
        bump_nm=(0.0, 0.0, 0.0, 0.0),
        engagement_by_angle=0.0,
        misalignment_nm_s2=(0.0, 0.0, 0.0),
        drag_nm=0.0,
        drag_viscous_nm_s=0.0,
    )


@inner
def additional_torque(chain: ChainConstants, torque_nm: float, angle_rad: float) -> float:
    """Return T′ at the transducer's torque, without rotation; true torque = torque + T′."""
    direction = 0 if torque_nm >= 0.0 else 1
    relative = torque_nm / chain.range_nm
    magnitude = abs(relative)
    result = chain.constant_nm[direction] * math.tanh(relative / chain.reversal_width)
    result += chain.linear[direction] * torque_nm
    result += chain.quadratic_per_nm[direction] * abs(torque_nm) * torque_nm
    sign = 1.0 - 2.0 * direction
    phase = chain.ripple_phase_rad[direction]
    wave = math.sin(TURN * magnitude / chain.ripple_period[direction] + phase)
    engaged = magnitude / (magnitude + 0.03)  # without load the spline has no engagement
    result += sign * engaged * chain.ripple_nm[direction] * wave
    for k in range(4):
        distance = (relative - chain.bump_centre[k]) / chain.bump_width[k]
        if abs(distance) < 6.0:
            result += engaged * chain.bump_nm[k] * math.exp(-0.5 * distance * distance)
    turn = math.sin(angle_rad + chain.engagement_phase_rad)
    return result + chain.engagement_by_angle * torque_nm * turn


@inner
def rotation_torque(
    chain: ChainConstants, speed_rad_s: float, angle_rad: float, thickness: float = 1.0
) -> float:
    """Return the torque that rotation adds: misalignment ripple minus bearing drag.

    The viscous part of the drag grows with the thickness of the lubricant.
    """
    viscous = thickness * chain.drag_viscous_nm_s
    result = -chain.drag_nm * math.tanh(speed_rad_s / 0.05) - viscous * speed_rad_s
    square = speed_rad_s * speed_rad_s
    if square > 1e-6:
        for k in range(3):
            wave = math.sin((k + 1) * angle_rad + chain.misalignment_phase_rad[k])
            result += chain.misalignment_nm_s2[k] * square * wave
    return result


@inner
def transducer_torque(chain: ChainConstants, true_torque_nm: float, angle_rad: float) -> float:
    """Return the torque at the transducer for a true torque: the inverse of torque + T′.

    It is found by fixed-point iteration; T′ has a slope of at most about 0.2, so that 30 iterations
    reach rounding accuracy.
    """
    torque = true_torque_nm
    for _ in range(30):
        following = true_torque_nm - additional_torque(chain, torque, angle_rad)
        if abs(following - torque) <= 1e-15 * chain.range_nm:
            return float(following)
        torque = following
    return torque


@kernel
def steepest_slope(chain: ChainConstants) -> float:
    """Return the largest |slope| of T′ over ±120 % of the range; below 1, T′ can be inverted."""
    points = 4800
    step = 2.4 * chain.range_nm / points
    before = additional_torque(chain, -1.2 * chain.range_nm, 0.0)
    steepest = 0.0
    for k in range(1, points + 1):
        added = additional_torque(chain, -1.2 * chain.range_nm + k * step, 0.0)
        steepest = max(steepest, abs(added - before) / step)
        before = added
    return float(steepest)
