"""A torque-angle loop under a drive's ripple, its torque taken beyond a flange that swings."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

__all__ = ["INTERVAL_S", "LAG_NM", "RATED_NM", "STIFFNESS_NM_RAD", "TRUE_BACKLASH", "swinging_loop"]

RATED_NM = 40.0
STIFFNESS_NM_RAD = 2.5e4
LAG_NM = 0.05 * RATED_NM
INTERVAL_S = 0.002
TRUE_BACKLASH = 2.0 * LAG_NM / STIFFNESS_NM_RAD * 10800.0 / np.pi
"""Of the loop without ripple, arcmin."""

Floats = NDArray[np.float64]


def swinging_loop(inertia_kgm2: float, ripple_nm: float) -> tuple[Floats, Floats, Floats]:
    """Return time, torque and angle of a spring beside an elastic element that slips."""
    corners = (-1.1 * RATED_NM, 1.1 * RATED_NM, -1.1 * RATED_NM)
    ramp = np.concatenate([np.linspace(*each, 10_000) for each in pairwise(corners)])
    time = INTERVAL_S * np.arange(ramp.size)
    swing = 2.0 * np.pi * 25.0
    ripple = ripple_nm * np.sin(swing * time)
    angle = (ramp + ripple) / STIFFNESS_NM_RAD
    # Each ripple takes the slipping element back, which narrows the mean loop.
    slipping, held = np.empty(angle.size), -LAG_NM
    for row, change in enumerate(np.diff(angle, prepend=angle[0])):
        held = slipping[row] = float(np.clip(held + STIFFNESS_NM_RAD * change, -LAG_NM, LAG_NM))
    moving = -inertia_kgm2 * swing**2 * ripple / STIFFNESS_NM_RAD
    return time, STIFFNESS_NM_RAD * angle + slipping + moving, angle
