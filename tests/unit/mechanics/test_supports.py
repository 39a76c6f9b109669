"""Bodies in three dimensions against closed forms, and supports against each other."""

import numpy as np
import pytest
from skfem import MeshHex

from torquebench.errors import InputError
from torquebench.mechanics import (
    SupportDesign,
    compare_supports,
    polar_moment,
    rectangle_torsion_constant,
)
from torquebench.mechanics.supports import STEEL_POISSON_RATIO, tube_mesh, twisted_solid

G = 79e9


def twisted_about_its_top(mesh, torque_nm, **options):
    height = mesh.p[2].max()
    ends = [lambda x: x[2] < 1e-9, lambda x: x[2] > height - 1e-9]
    facets = (mesh.facets_satisfying(end, True) for end in ends)
    return twisted_solid(mesh, *facets, torque_nm, G, **options)


def test_a_hollow_cylinder_twists_by_the_closed_form() -> None:
    design = SupportDesign(cylinder_m=0.4)
    tube = twisted_about_its_top(tube_mesh(design, 0.12), 2000.0)
    closed_form = G * float(polar_moment(0.4, design.bore_m)) / design.height_m
    assert tube.stiffness_nm_rad == pytest.approx(closed_form, rel=5e-3)
    radius = np.hypot(*tube.points_m[:, :2].T)
    top = tube.points_m[:, 2] > design.height_m - 1e-9
    travel = np.hypot(*tube.displacement_m[top, :2].T)
    np.testing.assert_allclose(travel, tube.rotation_rad * radius[top], rtol=0.01)


def test_a_clamped_bar_is_stiffer_than_saint_venant_and_nears_it_with_its_length() -> None:
    constant = float(rectangle_torsion_constant(0.2, 0.1))
    shares = []
    for length in (0.2, 0.8):
        sides = np.linspace(0.0, 0.2, 5), np.linspace(0.0, 0.1, 3), np.linspace(0.0, length, 7)
        bar = twisted_about_its_top(MeshHex.init_tensor(*sides).to_meshtet(), 100.0)
        shares.append(bar.stiffness_nm_rad * length / (G * constant))
    assert shares[0] > shares[1] > 1.0
    assert shares[1] < 1.05


def test_a_column_under_a_torque_about_a_horizontal_axis_bends_by_the_closed_form() -> None:
    sides = np.linspace(0.0, 0.2, 5), np.linspace(0.0, 0.1, 3), np.linspace(0.0, 0.8, 13)
    bar = twisted_about_its_top(MeshHex.init_tensor(*sides).to_meshtet(), 100.0, axis=0)
    young = 2.0 * G * (1.0 + STEEL_POISSON_RATIO)
    assert bar.stiffness_nm_rad == pytest.approx(young * 0.2 * 0.1**3 / 12.0 / 0.8, rel=0.03)


@pytest.mark.nightly
def test_the_cylinder_has_the_cantilevers_mass_and_is_much_stiffer() -> None:
    comparison = compare_supports(2000.0, size_m=0.12)
    cantilever, cylinder = comparison.cantilever, comparison.cylinder
    assert cantilever.volume_m3 == pytest.approx(comparison.design.volume_m3)
    assert cylinder.volume_m3 == pytest.approx(cantilever.volume_m3)
    assert comparison.ratio > 10.0
    # About the shaft of a horizontal bench the column bends as well.
    assert comparison.horizontal.stiffness_nm_rad < cantilever.stiffness_nm_rad
    assert comparison.horizontal_ratio > comparison.ratio
    doubled = compare_supports(4000.0, size_m=0.12)
    assert doubled.cantilever.rotation_rad == pytest.approx(2.0 * cantilever.rotation_rad)


def test_a_cylinder_that_would_be_solid_is_refused() -> None:
    with pytest.raises(InputError, match="larger diameter"):
        compare_supports(2000.0, SupportDesign(cylinder_m=0.2))
