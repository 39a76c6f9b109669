from .chain import (
    AdditionalTorque as AdditionalTorque,
    Chain as Chain,
    Coefficients as Coefficients,
    Form as Form,
    Sensitivity as Sensitivity,
    additional_torque as additional_torque,
    coefficients as coefficients,
    sensitivities as sensitivities,
)
from .supports import (
    SupportComparison as SupportComparison,
    SupportDesign as SupportDesign,
    TwistedSolid as TwistedSolid,
    compare_supports as compare_supports,
)
from .torsion import (
    equal_area_twist_ratio as equal_area_twist_ratio,
    hollow_circle_gain as hollow_circle_gain,
    polar_moment as polar_moment,
    rectangle_torsion_constant as rectangle_torsion_constant,
    rectangle_torsion_factor as rectangle_torsion_factor,
)
