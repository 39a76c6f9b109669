"""Shafts, additional torque of the measuring chain, and the torsion of supports' sections.

Pure functions of arrays: what a design adds to the torque, and how much each parameter matters.
"""

from torquebench.mechanics.additional_torque import (
    AdditionalTorque,
    Chain,
    Coefficients,
    Form,
    Sensitivity,
    additional_torque,
    coefficients,
    reversing_additional_torque,
    sensitivities,
)
from torquebench.mechanics.shaft import polar_moment, shaft_stiffness, shaft_twist

__all__ = [
    "AdditionalTorque",
    "Chain",
    "Coefficients",
    "Form",
    "Sensitivity",
    "additional_torque",
    "coefficients",
    "polar_moment",
    "reversing_additional_torque",
    "sensitivities",
    "shaft_stiffness",
    "shaft_twist",
]
