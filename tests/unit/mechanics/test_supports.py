"""Bodies in three dimensions against closed forms, and supports against each other."""

import numpy as np
import pytest

from torquebench.errors import InputError
from torquebench.mechanics import (
    SupportDesign,
    annulus,
    compare_supports,
    extruded,
    rectangle,
    section_torsion,
    shaft_stiffness,
)

G = 79e9


def test_a_hollow_cylinder_twists_by_the_closed_form() -> None:
    tube = extruded(annulus(0.4, 0.3), 0.5, layers=2, size_m=0.12)
    found = tube.twisted(lambda x: x[2] < 1e-9, lambda x: x[2] > 0.5 - 1e-9, 2000.0, G)
    assert found.stiffness_nm_rad == pytest.approx(float(shaft_stiffness(0.5, G, 0.4, 0.3)), 5e-3)
    radius = np.hypot(*tube.points_m[:, :2].T)
    top = tube.points_m[:, 2] > 0.5 - 1e-9
    travel = np.hypot(*found.displacement_m[top, :2].T)
    np.testing.assert_allclose(travel, found.rotation_rad * radius[top], rtol=0.01)


def test_a_clamped_bar_is_stiffer_than_saint_venant_and_nears_it_with_its_length() -> None:
    constant = section_torsion(rectangle(0.2, 0.1)).torsion_constant_m4
    shares = []
    for length in (0.2, 0.8):
        bar = extruded(rectangle(0.2, 0.1), length, layers=6, size_m=0.05)
        found = bar.twisted(
            lambda x: x[2] < 1e-9, lambda x, top=length: x[2] > top - 1e-9, 100.0, G
        )
        shares.append(found.stiffness_nm_rad * length / (G * constant))
    assert shares[0] > shares[1] > 1.0
    assert shares[1] < 1.05


def test_the_cylinder_has_the_cantilevers_mass_and_is_much_stiffer() -> None:
    found = compare_supports(2000.0, size_m=0.12)
    volumes = [body.solid.volume_m3 for body in (found.cantilever, found.cylinder)]
    assert volumes[0] == pytest.approx(found.design.volume_m3)
    assert volumes[1] == pytest.approx(volumes[0])
    assert found.ratio > 10.0
    doubled = compare_supports(4000.0, size_m=0.12)
    assert doubled.cantilever.rotation_rad == pytest.approx(2.0 * found.cantilever.rotation_rad)


def test_a_cylinder_that_would_be_solid_is_refused() -> None:
    with pytest.raises(InputError, match="larger diameter"):
        compare_supports(2000.0, SupportDesign(cylinder_m=0.2))


def test_a_face_without_facets_is_refused() -> None:
    bar = extruded(rectangle(0.1, 0.1), 0.2, layers=1, size_m=0.1)
    with pytest.raises(InputError, match="loaded face"):
        bar.twisted(lambda x: x[2] < 1e-9, lambda x: x[2] > 1.0, 1.0, G)
