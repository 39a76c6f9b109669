"""The chain's additional torque: the sources' equations inside, and what no polynomial follows."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.mechanics import additional_torque as additional_torque_of_equations
from torquebench.twin import TwinParameters
from torquebench.twin.chain import additional_torque, rotation_torque, transducer_torque

PARAMETERS = [
    getattr(TwinParameters.draw(preset, seed), side)
    for preset in ("nominal", "worn")
    for seed in (0, 1)
    for side in ("input", "output")
]

sides = st.sampled_from(PARAMETERS)


def plain(chain):
    """The chain without ripple, bumps and dependence on the angle."""
    return chain._replace(
        ripple_nm=(0.0, 0.0), bump_nm=(0.0, 0.0, 0.0, 0.0), engagement_by_angle=0.0
    )


@given(side=sides, relative=st.floats(0.05, 1.0), sign=st.sampled_from([-1.0, 1.0]))
def test_the_equations_of_the_sources_are_inside(side, relative, sign):
    torque = sign * relative * side.chain.range_nm
    clockwise, counterclockwise = side.geometry
    geometry = clockwise if sign > 0.0 else counterclockwise
    expected = sign * additional_torque_of_equations(geometry, abs(torque)).total_nm
    found = additional_torque(plain(side.chain), torque, 0.0)
    assert found == pytest.approx(float(expected), rel=1e-6)


@given(side=sides, relative=st.floats(-1.0, 1.0))
def test_step_at_reversal_is_smooth_and_about_one_per_cent_wide(side, relative):
    chain = plain(side.chain)
    assert additional_torque(chain, 0.0, 1.0) == 0.0
    near = additional_torque(chain, 1e-9 * chain.range_nm, 0.0)
    assert abs(near) < 1e-6 * chain.range_nm
    at_one_per_cent = additional_torque(chain, 0.01 * chain.range_nm, 0.0)
    smooth = 0.01 * chain.range_nm * chain.linear[0]
    assert 0.8 < (at_one_per_cent - smooth) / chain.constant_nm[0] < 1.01


@given(side=sides, relative=st.floats(-1.1, 1.1), angle=st.floats(0.0, 6.3))
def test_torque_at_the_transducer_is_the_inverse(side, relative, angle):
    true = relative * side.chain.range_nm
    torque = transducer_torque(side.chain, true, angle)
    back = torque + additional_torque(side.chain, torque, angle)
    assert back == pytest.approx(true, abs=1e-10 * side.chain.range_nm)


@pytest.mark.parametrize("side", PARAMETERS[:4])
def test_ripple_and_bumps_have_the_size_they_should(side):
    torque = np.linspace(0.02, 1.0, 400) * side.chain.range_nm
    rough = [
        additional_torque(side.chain, t, 0.0) - additional_torque(plain(side.chain), t, 0.0)
        for t in torque
    ]
    share = np.ptp(rough) / side.chain.range_nm
    assert 0.02e-2 < share < 0.12e-2


@given(side=sides, speed=st.floats(5.0, 125.0), angle=st.floats(0.0, 6.3))
def test_misalignment_ripple_grows_with_the_square_of_speed(side, speed, angle):
    chain = side.chain._replace(drag_nm=0.0, drag_viscous_nm_s=0.0)
    slow, fast = rotation_torque(chain, speed, angle), rotation_torque(chain, 2 * speed, angle)
    assert fast == pytest.approx(4.0 * slow, rel=1e-9, abs=1e-15)
    assert rotation_torque(chain, -speed, angle) == slow


@given(side=sides, speed=st.floats(0.5, 125.0))
def test_drag_brakes_both_directions(side, speed):
    chain = side.chain._replace(misalignment_nm_s2=(0.0, 0.0, 0.0))
    assert rotation_torque(chain, speed, 0.0) < 0.0
    assert rotation_torque(chain, -speed, 0.0) == -rotation_torque(chain, speed, 0.0)
    assert rotation_torque(chain, 0.0, 0.0) == 0.0


def test_misalignment_ripple_has_harmonics_of_the_rotation():
    chain = PARAMETERS[0].chain
    angle = np.linspace(0.0, 2 * np.pi, 64, endpoint=False)
    spectrum = np.abs(np.fft.rfft([rotation_torque(chain, 125.0, a) for a in angle]))
    assert np.all(spectrum[1:4] > 1e3 * spectrum[4:].max())
    assert spectrum[1] > spectrum[3]
