from .chain import (
    AdditionalTorque as AdditionalTorque,
    Chain as Chain,
    Coefficients as Coefficients,
    Form as Form,
    Sensitivity as Sensitivity,
    additional_torque as additional_torque,
    coefficients as coefficients,
    reversing_additional_torque as reversing_additional_torque,
    sensitivities as sensitivities,
)
from .outline import (
    Outline as Outline,
    annulus as annulus,
    circle as circle,
    closed_curve as closed_curve,
    polygon as polygon,
    rectangle as rectangle,
    rectangles as rectangles,
    spline_shaft as spline_shaft,
)
from .saint_venant import (
    SectionTorsion as SectionTorsion,
    section_torsion as section_torsion,
)
from .sections import (
    equal_area_twist_ratio as equal_area_twist_ratio,
    hollow_circle_gain as hollow_circle_gain,
    rectangle_torsion_constant as rectangle_torsion_constant,
    rectangle_torsion_factor as rectangle_torsion_factor,
)
from .shaft import (
    polar_moment as polar_moment,
    shaft_stiffness as shaft_stiffness,
    shaft_twist as shaft_twist,
)
from .solid import (
    Solid as Solid,
    TwistedSolid as TwistedSolid,
    extruded as extruded,
)
from .supports import (
    SupportComparison as SupportComparison,
    SupportDesign as SupportDesign,
    compare_supports as compare_supports,
)
