"""Supports as elastic bodies in three dimensions: an extruded outline, clamped and twisted."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import spsolve
from skfem import Basis, ElementTetP2, ElementVector, FacetBasis, LinearForm, MeshTet
from skfem.models.elasticity import lame_parameters, linear_elasticity

from torquebench.errors import InputError
from torquebench.mechanics.mesh import triangulate
from torquebench.mechanics.outline import Outline
from torquebench.message import Message

__all__ = ["Solid", "TwistedSolid", "extruded"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Where = Callable[[FloatArray], NDArray[np.bool_]]

STEEL_POISSON_RATIO = 0.3


@dataclass(frozen=True, eq=False)
class Solid:
    """A body of tetrahedra.

    Attributes
    ----------
    points_m : float64[n, 3]
        Corners.
    tetrahedra : int64[m, 4]
        Their numbers.
    """

    points_m: FloatArray
    tetrahedra: IntArray

    @property
    def volume_m3(self) -> float:
        """Volume of the meshed body, m³."""
        first, *others = (self.points_m[self.tetrahedra[:, k]] for k in range(4))
        edges = np.stack([other - first for other in others], axis=1)
        return float(np.abs(np.linalg.det(edges)).sum() / 6.0)

    def turned(self, axes: tuple[int, int, int]) -> "Solid":
        """Return the body with its coordinates in another order."""
        return Solid(self.points_m[:, list(axes)], self.tetrahedra)

    def twisted(
        self,
        clamped: Where,
        loaded: Where,
        torque_nm: float,
        shear_modulus_pa: float,
        poisson_ratio: float = STEEL_POISSON_RATIO,
    ) -> "TwistedSolid":
        """Clamp one face and twist another one about the vertical axis through its centre.

        Linear elasticity with quadratic tetrahedra. The load is a tangential traction that grows
        with the distance from the axis, a pure torque; the rotation is its work's: that of a rigid
        flange which does the same work under the same torque.

        Parameters
        ----------
        clamped, loaded : callable
            Return whether facets with these centres (3, n) belong to the face.
        torque_nm, shear_modulus_pa, poisson_ratio : float
            Torque about the third axis, N·m; G in Pa; Poisson's ratio.

        Raises
        ------
        InputError
            No facet belongs to one of the faces.

        Examples
        --------
        >>> from torquebench.mechanics import extruded, rectangle
        >>> bar = extruded(rectangle(0.1, 0.1), 0.5, layers=5, size_m=0.05)
        >>> twist = bar.twisted(lambda x: x[2] < 1e-9, lambda x: x[2] > 0.5 - 1e-9, 100.0, 79e9)
        >>> 0.9 < twist.rotation_rad / (100.0 * 0.5 / (0.1406 * 0.1**4 * 79e9)) < 1.0
        True
        """
        mesh = MeshTet(
            np.ascontiguousarray(self.points_m.T), np.ascontiguousarray(self.tetrahedra.T)
        )
        held, driven = mesh.facets_satisfying(clamped, True), mesh.facets_satisfying(loaded, True)
        if not (held.size and driven.size):
            raise InputError("a body without a clamped or a loaded face", "facets on both")
        element = ElementVector(ElementTetP2())
        basis = Basis(mesh, element)
        face = FacetBasis(mesh, element, facets=driven)
        width = np.asarray(face.dx)
        x, y = (np.asarray(face.global_coordinates())[k] for k in range(2))
        area = float(width.sum())
        centre = float((x * width).sum() / area), float((y * width).sum() / area)
        polar = float((((x - centre[0]) ** 2 + (y - centre[1]) ** 2) * width).sum())

        @LinearForm
        def traction(v: Any, w: Any) -> Any:
            along, across = w.x[0] - centre[0], w.x[1] - centre[1]
            return (along * v[1] - across * v[0]) * torque_nm / polar

        young = 2.0 * shear_modulus_pa * (1.0 + poisson_ratio)
        stiffness = linear_elasticity(*lame_parameters(young, poisson_ratio)).assemble(basis)
        load = traction.assemble(face)
        free = np.setdiff1d(np.arange(basis.N), basis.get_dofs(held).all())
        moved = np.zeros(basis.N)
        moved[free] = spsolve(stiffness.tocsc()[free][:, free], load[free])
        displacement = moved[basis.nodal_dofs].T
        rotation = float(load @ moved) / torque_nm
        return TwistedSolid(self, displacement, torque_nm, rotation)


@dataclass(frozen=True, eq=False)
class TwistedSolid:
    """A body under a torque.

    Attributes
    ----------
    solid : Solid
    displacement_m : float64[n, 3]
        Of its corners.
    torque_nm, rotation_rad : float
        The torque, and the rotation of the loaded face.
    """

    solid: Solid
    displacement_m: FloatArray
    torque_nm: float
    rotation_rad: float

    @property
    def stiffness_nm_rad(self) -> float:
        """Torque by rotation, N·m/rad."""
        return self.torque_nm / self.rotation_rad

    def surface(self) -> IntArray:
        """Triangles of the surface, int64[k, 3]."""
        corners = self.solid.tetrahedra
        faces = np.vstack([corners[:, list(each)] for each in ((0, 1, 2), (0, 1, 3), (0, 2, 3))])
        faces = np.sort(np.vstack([faces, corners[:, [1, 2, 3]]]), axis=1)
        found, count = np.unique(faces, axis=0, return_counts=True)
        return np.asarray(found[count == 1], dtype=np.int64)


def extruded(outline: Outline, length_m: float, *, layers: int, size_m: float) -> Solid:
    """Extrude a section along the third axis.

    Parameters
    ----------
    outline : Outline
        Section in the first two coordinates.
    length_m : float
        Length along the third one, above 0.
    layers : int
        Layers of prisms, each cut into three tetrahedra.
    size_m : float
        Length of a triangle's side in the section.

    Raises
    ------
    InputError
        No length or no layer, or by `triangulate`.

    Examples
    --------
    >>> from torquebench.mechanics import rectangle
    >>> round(extruded(rectangle(0.2, 0.1), 0.5, layers=2, size_m=0.1).volume_m3, 9)
    0.01
    """
    if not (length_m > 0.0 and layers >= 1):
        raise InputError(
            Message("{layers} layers over {length_m:g} m", layers, length_m),
            "at least one layer, above 0 m",
        )
    flat, triangles = triangulate(outline, size_m)
    heights = np.linspace(0.0, length_m, layers + 1)
    points = np.vstack([np.column_stack((flat, np.full(len(flat), z))) for z in heights])
    # Corners in rising order: neighbouring prisms then divide their common side alike.
    low = np.sort(triangles, axis=1)
    high = low + len(flat)
    prism = np.vstack(
        [
            np.column_stack((low, high[:, 2])),
            np.column_stack((low[:, :2], high[:, 1:])),
            np.column_stack((low[:, :1], high)),
        ]
    )
    tetrahedra = np.vstack([prism + layer * len(flat) for layer in range(layers)])
    return Solid(points, tetrahedra.astype(np.int64))
