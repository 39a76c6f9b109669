"""A cantilever support and a hollow cylinder of the same mass, twisted in three dimensions."""

from dataclasses import dataclass

import numpy as np

from torquebench.errors import InputError
from torquebench.mechanics.outline import annulus, rectangles
from torquebench.mechanics.solid import TwistedSolid, extruded
from torquebench.message import Message

__all__ = ["SupportComparison", "SupportDesign", "compare_supports"]

_FLANGE_SHARE = 0.4
"""Share of the arm's length, from its end, that carries the module."""


@dataclass(frozen=True)
class SupportDesign:
    """A column with an arm, and the cylinder that replaces it; lengths in metres.

    Attributes
    ----------
    height_m : float
        Of both supports.
    column_m, thickness_m : float
        Sides of the column's section: along the arm and across it.
    arm_m, arm_height_m : float
        Length of the arm from the column on, and its height.
    cylinder_m : float
        Outer diameter of the cylinder; its bore follows from the same mass.
    shear_modulus_pa : float
        Of both.
    """

    height_m: float = 0.50
    column_m: float = 0.20
    thickness_m: float = 0.15
    arm_m: float = 0.35
    arm_height_m: float = 0.12
    cylinder_m: float = 0.45
    shear_modulus_pa: float = 79e9

    @property
    def volume_m3(self) -> float:
        """Volume of the column with its arm, m³."""
        column = self.column_m * self.height_m
        return self.thickness_m * (column + self.arm_m * self.arm_height_m)

    @property
    def bore_m(self) -> float:
        """Inner diameter of the cylinder with the same volume, m.

        Raises
        ------
        InputError
            Where a solid cylinder of this diameter has less.
        """
        squared = self.cylinder_m**2 - 4.0 * self.volume_m3 / (np.pi * self.height_m)
        if not squared > 0.0:
            raise InputError(
                Message(
                    "a cylinder of {cylinder_m:g} m for {volume_m3:.4g} m³",
                    self.cylinder_m,
                    self.volume_m3,
                ),
                "a cylinder that the same mass makes hollow",
                "choose a larger diameter",
            )
        return float(np.sqrt(squared))


@dataclass(frozen=True, eq=False)
class SupportComparison:
    """Both supports under the same torque.

    Attributes
    ----------
    design : SupportDesign
    cantilever, cylinder : TwistedSolid
    """

    design: SupportDesign
    cantilever: TwistedSolid
    cylinder: TwistedSolid

    @property
    def ratio(self) -> float:
        """Stiffness of the cylinder by that of the cantilever."""
        return self.cylinder.stiffness_nm_rad / self.cantilever.stiffness_nm_rad


def compare_supports(
    torque_nm: float, design: SupportDesign | None = None, *, size_m: float = 0.05
) -> SupportComparison:
    """Twist both supports about the vertical axis through the module that they carry.

    The foot of each is clamped. The cylinder is twisted at its upper face, the cantilever at the
    end of its arm. Linear elasticity, finite elements.

    Parameters
    ----------
    torque_nm : float
        About the vertical axis, N·m.
    design : SupportDesign, optional
    size_m : float
        Length of the elements' sides.

    Raises
    ------
    InputError
        By `SupportDesign.bore_m`.

    Examples
    --------
    >>> compare_supports(2000.0, size_m=0.1).ratio > 10.0
    True
    """
    design = design or SupportDesign()
    height, arm_end = design.height_m, design.column_m + design.arm_m
    under_arm = height - design.arm_height_m
    section = rectangles(
        [(0.0, 0.0, design.column_m, height), (design.column_m, under_arm, arm_end, height)]
    )
    layers = max(2, round(design.thickness_m / size_m))
    body = extruded(section, design.thickness_m, layers=layers, size_m=size_m).turned((0, 2, 1))
    near = 1e-6 * height
    flange = arm_end - _FLANGE_SHARE * design.arm_m
    cantilever = body.twisted(
        lambda x: x[2] < near,
        lambda x: (x[2] > height - near) & (x[0] > flange),
        torque_nm,
        design.shear_modulus_pa,
    )
    ring = annulus(design.cylinder_m, design.bore_m)
    tube = extruded(ring, height, layers=max(2, round(0.6 * height / size_m)), size_m=size_m)
    cylinder = tube.twisted(
        lambda x: x[2] < near,
        lambda x: x[2] > height - near,
        torque_nm,
        design.shear_modulus_pa,
    )
    return SupportComparison(design, cantilever, cylinder)
