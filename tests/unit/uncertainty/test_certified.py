import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.errors import InputError
from torquebench.uncertainty import CertifiedUncertainty

sizes = st.lists(st.floats(0.1, 100.0), min_size=1, max_size=12, unique=True).map(sorted)


@given(sizes, st.randoms())
def test_a_table_gives_its_own_values_and_straight_lines_between(torque, random):
    expanded = [random.uniform(0.0, 1.0) for _ in torque]
    certified = CertifiedUncertainty.of_table(torque, expanded)
    for at in (torque, [-each for each in torque]):  # stated for one direction: holds for both
        assert certified.at(at) == pytest.approx(expanded, abs=1e-7)
    between = np.linspace(torque[0], torque[-1], 37)
    assert certified.at(between) == pytest.approx(np.interp(between, torque, expanded), abs=1e-7)


@given(st.floats(1e-3, 1.0), st.floats(1.0, 4.0))
def test_beyond_the_certified_torques_it_is_a_share_of_the_torque(below, above):
    certified = CertifiedUncertainty((-20.0, 2.0, 50.0), (0.5, 0.1, 0.3))
    assert certified.at([2.0 * below, 50.0 * above]) == pytest.approx([0.1 * below, 0.3 * above])
    assert certified.at(-20.0 * above) == pytest.approx(0.5 * above)
    assert certified.at(0.0) == 0.0


def test_a_line_at_zero_does_not_count_and_a_flat_table_needs_its_ends_only():
    torque = np.linspace(-50.0, 50.0, 101)
    certified = CertifiedUncertainty.of_table(torque, np.full(101, 0.002))
    assert certified.torque_nm == (-50.0, -1.0, 1.0, 50.0)
    assert certified.at([0.5, 1.0, -30.0]) == pytest.approx([0.001, 0.002, 0.002])
    assert certified.largest_nm(50.0) == 0.002


def test_a_relative_one_is_the_same_share_everywhere():
    certified = CertifiedUncertainty.of_torque(5e-4)
    assert certified.at([1e-3, 7.0, -3000.0]) == pytest.approx([5e-7, 3.5e-3, 1.5])
    assert certified.largest_nm(2000.0) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("torque", "expanded"),
    [
        ([], []),
        ([0.0], [0.1]),
        ([1.0, 2.0], [0.1]),
        ([2.0, 1.0], [0.1, 0.1]),
        ([1.0, 1.0], [0.1, 0.1]),
        ([1.0, np.nan], [0.1, 0.1]),
        ([1.0, 2.0], [0.1, -0.1]),
    ],
)
def test_a_table_that_states_nothing_is_refused(torque, expanded):
    with pytest.raises(InputError):
        CertifiedUncertainty.of_table(torque, expanded)
