"""The sources' equations, in both forms, against numbers worked out by hand."""

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.errors import InputError
from torquebench.mechanics import (
    Chain,
    additional_torque,
    coefficients,
    sensitivities,
)

INPUT = Chain(0.03, 0.01, 0.2, 79e9, 0.015, 16e-6, 9e-5, 5.5e7, 3.6e5, 1.2e4)
OUTPUT = Chain(0.09, 0.03, 0.3, 79e9, 0.045, 16e-6, 1.8e-4, 5.5e8, 1.5e7, 2.4e5)
# Round numbers: G π (D⁴ − d⁴) = 32, so that the equations can be worked out by hand.
BY_HAND = Chain(
    outer_diameter_m=1.0,
    inner_diameter_m=0.0,
    length_m=3.0,
    shear_modulus_pa=32.0 / np.pi,
    shaft_radius_m=2.0,
    coaxiality_error_m=0.5,
    angular_misalignment_rad=np.pi / 6.0,
    strain_coefficient_n_per_m=4.0,
    elastic_coefficient_n_per_rad=2.0,
    radial_stiffness_n_per_m=10.0,
)
FORMS = ["consistent", "published"]

chains = st.builds(
    Chain,
    outer_diameter_m=st.floats(0.02, 0.1),
    inner_diameter_m=st.floats(0.0, 0.015),
    length_m=st.floats(0.05, 0.6),
    shear_modulus_pa=st.floats(2e10, 9e10),
    shaft_radius_m=st.floats(0.01, 0.06),
    coaxiality_error_m=st.floats(0.0, 1e-4),
    angular_misalignment_rad=st.floats(-1e-3, 1e-3),
    strain_coefficient_n_per_m=st.floats(1e6, 1e9),
    elastic_coefficient_n_per_rad=st.floats(0.0, 2e7),
    radial_stiffness_n_per_m=st.floats(0.0, 5e5),
)


def test_consistent_form_by_hand():
    parts = additional_torque(BY_HAND, 8.0)
    assert parts.bearing_friction_nm == pytest.approx(2 * 3 * (0.5 * 8 + 64 / 8))  # 72
    assert parts.parallel_misalignment_nm == pytest.approx(10 * 3 * (0.5 + 8 / 8))  # 45
    assert parts.angular_misalignment_nm == pytest.approx(8 * (3**0.5 / 2 - 1) + 8 * 0.5 * 1.5)
    assert parts.total_nm == pytest.approx(sum(float(part) for part in parts[:3]))


def test_published_form_keeps_each_defect():
    parts = additional_torque(BY_HAND, 8.0, form="published")
    cosine = 3**0.5 / 2
    assert parts.bearing_friction_nm == pytest.approx(3 * (2 * 0.5 * 8 + 64 / 8))  # eq. 7: no μ
    assert parts.parallel_misalignment_nm == pytest.approx(10 * 3 * (0.5 + 4 * 8 / 2))  # eq. 13: ε
    assert parts.angular_misalignment_nm == pytest.approx(8 * (cosine - 1) + 8 * cosine * 1.5)
    without_32_l = 64 / 8 / 32  # eq. 15
    expected = 3 * 2 * 0.5 * 8 + without_32_l + 495 + float(parts.angular_misalignment_nm)
    assert parts.total_nm == pytest.approx(expected)
    assert float(parts.total_nm) != pytest.approx(sum(float(part) for part in parts[:3]))


def test_published_eq_14_leaves_torque_at_zero_misalignment():
    aligned = replace(INPUT, angular_misalignment_rad=0.0)
    assert additional_torque(aligned, 50.0).angular_misalignment_nm == 0.0
    published = additional_torque(aligned, 50.0, form="published").angular_misalignment_nm
    assert published == pytest.approx(50.0 * 0.2 / 0.015)


def test_perfect_chain_adds_nothing_under_no_load():
    perfect = replace(INPUT, coaxiality_error_m=0.0, angular_misalignment_rad=0.0)
    assert additional_torque(perfect, 0.0).total_nm == 0.0


@given(chain=chains, torque=st.floats(0.0, 2000.0), form=st.sampled_from(FORMS))
def test_coefficients_give_the_total(chain, torque, form):
    constant, linear, quadratic = coefficients(chain, form=form)
    total = float(additional_torque(chain, torque, form=form).total_nm)
    size = abs(constant) + abs(linear * torque) + abs(quadratic) * torque**2
    assert constant + linear * torque + quadratic * torque**2 == pytest.approx(
        total, rel=1e-9, abs=1e-12 * max(size, torque, 1e-9)
    )


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(("chain", "torque"), [(INPUT, 37.0), (OUTPUT, 1400.0), (BY_HAND, 8.0)])
def test_sensitivities_are_the_derivatives(chain, torque, form):
    result = sensitivities(chain, torque, form=form)
    assert set(result) == {field.name for field in fields(Chain)} | {"torque_nm"}
    for name, sensitivity in result.items():
        value = torque if name == "torque_nm" else getattr(chain, name)
        step = 1e-5 * (abs(value) or 1e-3)

        def total(at, name=name):
            if name == "torque_nm":
                return float(additional_torque(chain, at, form=form).total_nm)
            changed = replace(chain, **{name: at})
            return float(additional_torque(changed, torque, form=form).total_nm)

        if name == "inner_diameter_m" and value == 0.0:
            assert sensitivity.derivative == 0.0
            continue
        numeric = (total(value + step) - total(value - step)) / (2.0 * step)
        noise = 1e-15 * abs(total(value)) / step
        assert float(sensitivity.derivative) == pytest.approx(numeric, rel=2e-6, abs=20 * noise)


def test_sensitivities_are_vectorised_and_carry_units():
    torque = np.linspace(0.0, 50.0, 7)
    result = sensitivities(INPUT, torque)
    assert all(entry.derivative.shape == torque.shape for entry in result.values())
    assert result["coaxiality_error_m"].unit == "N·m/m"
    assert result["radial_stiffness_n_per_m"].unit == "N·m/(N/m)"
    each = [sensitivities(INPUT, t)["length_m"].derivative for t in torque]
    np.testing.assert_array_equal(result["length_m"].derivative, np.array(each))


def test_linear_parameters_have_constant_sensitivity():
    doubled = replace(INPUT, radial_stiffness_n_per_m=2.0 * INPUT.radial_stiffness_n_per_m)
    rise = additional_torque(doubled, 50.0).total_nm - additional_torque(INPUT, 50.0).total_nm
    slope = sensitivities(INPUT, 50.0)["radial_stiffness_n_per_m"].derivative
    assert rise == pytest.approx(slope * INPUT.radial_stiffness_n_per_m, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"inner_diameter_m": 0.03}, "inner diameter < outer diameter"),
        ({"length_m": 0.0}, "above 0"),
        ({"shear_modulus_pa": -1.0}, "above 0"),
        ({"shaft_radius_m": 0.0}, "shaft_radius_m = 0.0"),
        ({"strain_coefficient_n_per_m": -5.0}, "strain_coefficient_n_per_m = -5.0"),
        ({"coaxiality_error_m": np.nan}, "coaxiality_error_m = nan"),
    ],
)
def test_impossible_chains_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        replace(INPUT, **change)


@pytest.mark.parametrize("function", [additional_torque, sensitivities])
def test_unknown_form_is_refused(function):
    with pytest.raises(InputError, match="'consistent' or 'published'"):
        function(INPUT, 1.0, form="improved")
    with pytest.raises(InputError, match="'consistent' or 'published'"):
        coefficients(INPUT, form="improved")
