"""Where torque-angle loops are driven: an error of the input's orders cancels in the mean."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.procedures.reducers.loop import HysteresisSettings, _near, even_positions


def slope_left(order: int, ratio: float, positions: tuple[float, ...]) -> float:
    """Share of an error's slope that the mean over positions keeps, at its worst phase."""
    turned = [
        np.radians(_near(position, ratio, index / len(positions))) * ratio
        for index, position in enumerate(positions)
    ]
    return float(np.abs(np.mean(np.exp(1j * order * np.array(turned)))))


@given(ratio=st.floats(20.0, 300.0), order=st.integers(1, 24))
def test_orders_cancel_but_for_multiples_of_the_number_of_positions(ratio, order):
    positions = HysteresisSettings().positions_deg
    left = slope_left(order, ratio, positions)
    assert left == pytest.approx(1.0 if order % len(positions) == 0 else 0.0, abs=1e-6)


@pytest.mark.parametrize("order", [2, 4, 6, 8])
def test_nothing_is_left_of_what_a_wave_generator_of_two_lobes_does(order):
    assert slope_left(order, 100.0, HysteresisSettings().positions_deg) < 1e-6
    assert slope_left(4, 100.0, even_positions(4)) == pytest.approx(1.0)


@given(ratio=st.floats(20.0, 300.0), count=st.integers(1, 12))
def test_positions_stay_where_they_were_meant_within_half_a_turn_of_the_input(ratio, count):
    for index, position in enumerate(even_positions(count)):
        assert abs(_near(position, ratio, index / count) - position) <= 180.0 / ratio + 1e-9
