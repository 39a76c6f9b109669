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
from torquebench.mechanics.outline import (
    Outline,
    annulus,
    circle,
    closed_curve,
    polygon,
    rectangle,
    rectangles,
    spline_shaft,
)
from torquebench.mechanics.saint_venant import SectionTorsion, section_torsion
from torquebench.mechanics.sections import (
    circle_twist_per_length,
    equal_area_twist_ratio,
    hollow_circle_gain,
    rectangle_torsion_constant,
    rectangle_torsion_factor,
    rectangle_twist_per_length,
)
from torquebench.mechanics.shaft import polar_moment, shaft_stiffness, shaft_twist

__all__ = [
    "AdditionalTorque",
    "Chain",
    "Coefficients",
    "Form",
    "Outline",
    "SectionTorsion",
    "Sensitivity",
    "additional_torque",
    "annulus",
    "circle",
    "circle_twist_per_length",
    "closed_curve",
    "coefficients",
    "equal_area_twist_ratio",
    "hollow_circle_gain",
    "polar_moment",
    "polygon",
    "rectangle",
    "rectangle_torsion_constant",
    "rectangle_torsion_factor",
    "rectangle_twist_per_length",
    "rectangles",
    "reversing_additional_torque",
    "section_torsion",
    "sensitivities",
    "shaft_stiffness",
    "shaft_twist",
    "spline_shaft",
]
