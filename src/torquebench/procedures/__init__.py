"""Procedures: what the bench does, as Bluesky plans that can be rehearsed before anything moves.

Every plan takes the bench's devices and settings, checks limits first, stops at a checkpoint of
its own before each point, and leaves the bench without torque however it ends.
"""

from torquebench.procedures.calibrating import StaircaseResult, calibrate, verify
from torquebench.procedures.friction import (
    FrictionPoint,
    FrictionSettings,
    FrictionSweep,
    friction_sweep,
)
from torquebench.procedures.rehearsal import Move, Rehearsal, rehearse
from torquebench.procedures.setup import Plan
from torquebench.procedures.zeroing import ZeroResult, preload, zero, zero_modules

__all__ = [
    "FrictionPoint",
    "FrictionSettings",
    "FrictionSweep",
    "Move",
    "Plan",
    "Rehearsal",
    "StaircaseResult",
    "ZeroResult",
    "calibrate",
    "friction_sweep",
    "preload",
    "rehearse",
    "verify",
    "zero",
    "zero_modules",
]
