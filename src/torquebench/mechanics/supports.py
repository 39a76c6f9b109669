"""The papers' supports of a module, cantilever and hollow cylinder, as elastic bodies in 3-D."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.units import TURN

if TYPE_CHECKING:
    from skfem import MeshTet

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

STEEL_POISSON_RATIO = 0.3
_FLANGE_SHARE = 0.4
"""Share of the arm's length, at its end, that carries the module."""
_LEAST_CHORDS = 24  # number of segments of the cylinder's circles


@dataclass(frozen=True)
class SupportDesign:
    """A column with an arm, and the cylinder that replaces it; lengths in metres.

    Attributes
    ----------
    height_m : float
        Height of column and cylinder.
    column_m, thickness_m : float
        Sides of the column, along and across the arm.
    arm_m, arm_height_m : float
        Length of the arm from the column, and its height; its thickness is that of the column.
    cylinder_m : float
        Outer diameter of the cylinder; its bore is such that its mass equals that of the column
        with its arm.
    shear_modulus_pa : float
        G of both.
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
            The cylinder would be solid.
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
class TwistedSolid:
    """A body under a torque about one of its axes.

    Attributes
    ----------
    points_m, displacement_m : float64[n, 3]
        Corners of its tetrahedra, and their displacements by the torque.
    surface : int64[k, 3]
        Triangles of its surface, as indices of their corners.
    volume_m3, torque_nm, rotation_rad : float
        Its volume, the torque, and the rotation of the loaded face.
    """

    points_m: FloatArray
    displacement_m: FloatArray
    surface: IntArray
    volume_m3: float
    torque_nm: float
    rotation_rad: float

    @property
    def stiffness_nm_rad(self) -> float:
        """Torque divided by rotation, N·m/rad."""
        return self.torque_nm / self.rotation_rad


@dataclass(frozen=True, eq=False)
class SupportComparison:
    """Comparison of both supports under the same torque.

    Attributes
    ----------
    cantilever, cylinder : TwistedSolid
        Twisted about the vertical axis.
    horizontal : TwistedSolid
        The cantilever of a horizontal bench: twisted about the horizontal axis of its shaft.
    """

    design: SupportDesign
    cantilever: TwistedSolid
    cylinder: TwistedSolid
    horizontal: TwistedSolid

    @property
    def ratio(self) -> float:
        """Stiffness of the cylinder divided by that of the cantilever."""
        return self.cylinder.stiffness_nm_rad / self.cantilever.stiffness_nm_rad

    @property
    def horizontal_ratio(self) -> float:
        """Stiffness of the cylinder over that of the cantilever about its horizontal shaft."""
        return self.cylinder.stiffness_nm_rad / self.horizontal.stiffness_nm_rad


def compare_supports(
    torque_nm: float, design: SupportDesign | None = None, *, size_m: float = 0.05
) -> SupportComparison:
    """Twist both supports about the vertical axis through the module that they carry.

    Linear elasticity with quadratic tetrahedra (scikit-fem). The feet are clamped; the cantilever
    carries the torque on the last 40 % of its arm, the cylinder on its whole top. A horizontal
    bench has its shaft along the arm: there the torque bends the column and twists the arm.

    Parameters
    ----------
    design : SupportDesign, optional
        Design; by default with the papers' proportions.
    size_m : float
        Length of the elements' sides.

    Examples
    --------
    >>> bool(compare_supports(2000.0, size_m=0.15).ratio > 10.0)
    True
    """
    design = design or SupportDesign()
    near = 1e-6 * design.height_m
    flange = design.column_m + (1.0 - _FLANGE_SHARE) * design.arm_m
    arm, tube = cantilever_mesh(design, size_m), tube_mesh(design, size_m)
    cases: tuple[tuple[str, MeshTet, float, Literal[0, 2]], ...] = (
        ("cantilever", arm, flange, 2),
        ("cylinder", tube, -np.inf, 2),
        ("horizontal", arm, flange, 0),
    )
    twisted = {
        name: twisted_solid(
            mesh,
            mesh.facets_satisfying(lambda x: x[2] < near, True),
            mesh.facets_satisfying(
                lambda x, first=loaded_from: (x[2] > design.height_m - near) & (x[0] > first),
                True,
            ),
            torque_nm,
            design.shear_modulus_pa,
            axis=axis,
        )
        for name, mesh, loaded_from, axis in cases
    }
    return SupportComparison(design, **twisted)


def cantilever_mesh(design: SupportDesign, size_m: float) -> MeshTet:
    """Return tetrahedra for the column with its arm; lengths along arm, thickness and height."""
    from skfem import MeshHex

    flange = design.column_m + (1.0 - _FLANGE_SHARE) * design.arm_m
    grid = MeshHex.init_tensor(
        _divided((0.0, design.column_m, flange, design.column_m + design.arm_m), size_m),
        _divided((0.0, design.thickness_m), size_m),
        _divided((0.0, design.height_m - design.arm_height_m, design.height_m), size_m),
    )
    under_arm = grid.elements_satisfying(
        lambda x: (x[0] > design.column_m) & (x[2] < design.height_m - design.arm_height_m)
    )
    return grid.remove_elements(under_arm).to_meshtet()


def tube_mesh(design: SupportDesign, size_m: float) -> MeshTet:
    """Return tetrahedra for the cylinder; its polygons have the areas of the circles."""
    from skfem import MeshHex

    radii = np.array([design.bore_m, design.cylinder_m]) / 2.0
    chords = max(_LEAST_CHORDS, round(TURN * radii[1] / size_m))
    step = TURN / chords
    grid = MeshHex.init_tensor(
        _divided(tuple(radii * np.sqrt(step / np.sin(step))), size_m),
        np.arange(chords + 1.0),
        _divided((0.0, design.height_m), size_m),
    )
    radius, chord, height = grid.p
    angle = step * (chord % chords)  # the last corners are the first ones
    points = np.array([radius * np.cos(angle), radius * np.sin(angle), height])
    return MeshHex(points, grid.t).remove_duplicate_nodes().to_meshtet()


def _divided(borders_m: tuple[float, ...], size_m: float) -> FloatArray:
    """Divide the intervals between borders into at least two steps of about a given size each."""
    parts = [
        np.linspace(first, last, max(2, round((last - first) / size_m)), endpoint=False)
        for first, last in itertools.pairwise(borders_m)
    ]
    return np.concatenate([*parts, borders_m[-1:]])


def twisted_solid(
    mesh: MeshTet,
    clamped: IntArray,
    loaded: IntArray,
    torque_nm: float,
    shear_modulus_pa: float,
    *,
    axis: Literal[0, 2] = 2,
) -> TwistedSolid:
    """Clamp some facets of a body and twist others about an axis through their centre.

    The loaded facets lie in a horizontal plane. About the third axis, the load is a tangential
    traction in proportion to the distance from the axis; about the first axis, it is a vertical
    traction in proportion to the distance from it. Both are pure torques. The rotation is that of a
    rigid flange on which the load does the same work.
    """
    from scipy.sparse.linalg import spsolve
    from skfem import Basis, ElementTetP2, ElementVector, FacetBasis, LinearForm
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    element = ElementVector(ElementTetP2())
    basis = Basis(mesh, element)
    face = FacetBasis(mesh, element, facets=loaded)
    width = np.asarray(face.dx)
    x, y = (np.asarray(face.global_coordinates())[k] for k in range(2))
    area = float(width.sum())
    centre = float((x * width).sum() / area), float((y * width).sum() / area)
    along_m, across_m = (x - centre[0]) * (axis == 2), y - centre[1]
    second_moment = float(((along_m**2 + across_m**2) * width).sum())

    @LinearForm
    def traction(v: Any, w: Any) -> Any:
        """Return the work of a torque's stress, as of a rigid plane, on a displacement."""
        along, across = w.x[0] - centre[0], w.x[1] - centre[1]
        moved = across * v[2] if axis == 0 else along * v[1] - across * v[0]
        return moved * torque_nm / second_moment

    young = 2.0 * shear_modulus_pa * (1.0 + STEEL_POISSON_RATIO)
    stiffness = linear_elasticity(*lame_parameters(young, STEEL_POISSON_RATIO)).assemble(basis)
    load = traction.assemble(face)
    free = np.setdiff1d(np.arange(basis.N), basis.get_dofs(clamped).all())
    moved = np.zeros(basis.N)
    moved[free] = spsolve(stiffness.tocsc()[free][:, free], load[free])
    corners = mesh.p[:, mesh.t]
    edges = corners[:, 1:] - corners[:, :1]
    return TwistedSolid(
        points_m=mesh.p.T,
        displacement_m=moved[basis.nodal_dofs].T,
        surface=np.asarray(mesh.facets[:, mesh.boundary_facets()].T, dtype=np.int64),
        volume_m3=float(np.abs(np.linalg.det(edges.transpose(2, 0, 1))).sum() / 6.0),
        torque_nm=torque_nm,
        rotation_rad=float(load @ moved) / torque_nm,
    )
