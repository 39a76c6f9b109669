"""Saint-Venant torsion of any section by finite elements, bounded from both sides."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import spsolve
from skfem import Basis, BilinearForm, ElementTriP2, Functional, LinearForm, MeshTri
from skfem.helpers import dot, grad

from torquebench.errors import InputError
from torquebench.mechanics.mesh import triangulate
from torquebench.mechanics.outline import Outline
from torquebench.message import Message

__all__ = ["SectionTorsion", "section_torsion"]

FloatArray = NDArray[np.float64]


class SectionTorsion(NamedTuple):
    """Torsion of a section: twist per length = torque / (G · torsion_constant_m4).

    Attributes
    ----------
    torsion_constant_m4 : float
        Middle between the bounds.
    lower_m4, upper_m4 : float
        Bounds of the meshed polygon's torsion constant: the stress function's energy can't exceed
        it, the warping function's can't fall below it.
    area_m2 : float
        Area of the material.
    polar_moment_m4 : float
        Polar second moment of area about the centroid; the torsion constant of a circle, and more
        than that of any other section.
    """

    torsion_constant_m4: float
    lower_m4: float
    upper_m4: float
    area_m2: float
    polar_moment_m4: float


def section_torsion(outline: Outline, *, triangles: int = 1200) -> SectionTorsion:
    """Torsion constant of any section, solid or with holes, in one part or several.

    Two problems are solved with quadratic triangles. The stress function: ∇²φ = −2, φ = 0 on the
    outside, constant on each hole with ∮ ∂φ/∂n ds = 2 × the hole's area (outward normal of the
    material), so that the warping closes around the hole; leaving φ = 0 there would treat the tube
    as slit. The warping function: natural boundary conditions, also at holes. The true constant of
    the meshed polygon lies between both results.

    Parameters
    ----------
    outline : Outline
        The section.
    triangles : int
        Roughly how many triangles; thin sections get more.

    Returns
    -------
    SectionTorsion
        Constant with its bounds.

    Raises
    ------
    InputError
        If the loops cross, or ``triangles`` is below 20.

    References
    ----------
    S. Timoshenko, J. N. Goodier, Theory of Elasticity, chapter on torsion: stress function,
    hollow shafts.

    Examples
    --------
    >>> from torquebench.mechanics import rectangle
    >>> torsion = section_torsion(rectangle(0.02, 0.01))
    >>> round(torsion.torsion_constant_m4 / (0.02 * 0.01**3), 4)
    0.2287
    >>> torsion.lower_m4 < torsion.torsion_constant_m4 < torsion.upper_m4
    True
    """
    if triangles < 20:
        raise InputError(Message("{triangles} triangles", triangles), "at least 20")
    area = outline.area_m2
    thickness = 2.0 * area / outline.perimeter_m
    size = min(float(np.sqrt(4.0 * area / (np.sqrt(3.0) * triangles))), 0.5 * thickness)
    points, corners = triangulate(outline, size)
    scale = float(np.sqrt(area))  # unit area makes the matrices independent of the unit of length
    centre = _centroid(points, corners)
    mesh = MeshTri(np.ascontiguousarray((points - centre).T / scale), corners.T.copy())
    basis = Basis(mesh, ElementTriP2())
    polar = float(_polar.assemble(basis))
    stiffness = _laplace.assemble(basis).tocsc()
    lower = _by_stress_function(mesh, basis, stiffness)
    upper = polar - _warping_energy(mesh, basis, stiffness)
    unit = scale**4
    return SectionTorsion(
        0.5 * (lower + upper) * unit, lower * unit, upper * unit, area, polar * unit
    )


@BilinearForm
def _laplace(u: Any, v: Any, _: Any) -> Any:
    return dot(grad(u), grad(v))


@LinearForm
def _twice(v: Any, _: Any) -> Any:
    return 2.0 * v


@LinearForm
def _rotation(v: Any, w: Any) -> Any:
    return w.x[1] * grad(v)[0] - w.x[0] * grad(v)[1]


@Functional
def _polar(w: Any) -> Any:
    return w.x[0] ** 2 + w.x[1] ** 2


def _centroid(points: FloatArray, triangles: NDArray[np.int64]) -> FloatArray:
    first, second, third = (points[triangles[:, k]] for k in range(3))
    along, across = second - first, third - first
    weight = along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0]
    return np.asarray(np.average((first + second + third) / 3.0, axis=0, weights=weight))


def _by_stress_function(mesh: Any, basis: Any, stiffness: Any) -> float:
    """Torsion constant by Prandtl's stress function: 2 ∫ φ + 2 Σ φ_hole · area of the hole."""
    load = _twice.assemble(basis)
    facets = mesh.boundary_facets()
    labels = _loops(mesh, facets)
    number = np.arange(basis.N)  # column of each unknown; −1 for φ = 0
    taken = np.zeros(basis.N, dtype=np.bool_)
    groups, hole_areas = [], []
    for label in range(labels.max() + 1):
        loop = facets[labels == label]
        dofs = basis.get_dofs(loop).all()
        taken[dofs] = True
        enclosed = _enclosed(mesh, loop)
        if enclosed < 0.0:  # the material's outward normals point into the hole
            groups.append(dofs)
            hole_areas.append(-enclosed)
        else:
            number[dofs] = -1
    free = np.flatnonzero(~taken)
    number[free] = np.arange(free.size)
    for k, dofs in enumerate(groups):
        number[dofs] = free.size + k
    rows = np.flatnonzero(number >= 0)
    columns = free.size + len(groups)
    tie = coo_array((np.ones(rows.size), (rows, number[rows])), shape=(basis.N, columns)).tocsc()
    reduced = np.asarray(tie.T @ load)
    reduced[free.size :] += 2.0 * np.array(hole_areas)
    solution = spsolve((tie.T @ stiffness @ tie).tocsc(), reduced)
    return float(reduced @ solution)


def _warping_energy(mesh: Any, basis: Any, stiffness: Any) -> float:
    """Return the energy saved by warping; one value of each part is fixed."""
    load = _rotation.assemble(basis)
    pairs = mesh.facets
    size = mesh.p.shape[1]
    graph = coo_array((np.ones(pairs.shape[1]), (pairs[0], pairs[1])), shape=(size, size))
    _, parts = connected_components(graph, directed=False)
    _, fixed = np.unique(parts, return_index=True)
    free = np.setdiff1d(np.arange(basis.N), basis.nodal_dofs[0, fixed])
    solution = spsolve(stiffness[free][:, free].tocsc(), load[free])
    return float(load[free] @ solution)


def _loops(mesh: Any, facets: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the closed loop of each boundary facet."""
    ends = mesh.facets[:, facets]
    size = mesh.p.shape[1]
    graph = coo_array((np.ones(ends.shape[1]), (ends[0], ends[1])), shape=(size, size))
    _, parts = connected_components(graph, directed=False)
    return np.asarray(np.unique(parts[ends[0]], return_inverse=True)[1])


def _enclosed(mesh: Any, loop: NDArray[np.int64]) -> float:
    """Return the area within a loop of facets; negative if the material lies outside."""
    start, end = (mesh.p[:, mesh.facets[k, loop]] for k in range(2))
    inside = mesh.p[:, mesh.t[:, mesh.f2t[0, loop]]].mean(axis=1)
    along = end - start
    cross = start[0] * end[1] - start[1] * end[0]
    to_inside = inside - start
    left = along[0] * to_inside[1] - along[1] * to_inside[0]
    return 0.5 * float(np.sum(np.where(left > 0.0, cross, -cross)))
