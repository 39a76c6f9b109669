"""The start of motion is found before the threshold that tells it from elastic yielding."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from torquebench.reducers.motion import first_motion


@settings(max_examples=25, deadline=None)
@given(start=st.floats(0.5, 3.0), jerk=st.floats(0.01, 1.0), sign=st.sampled_from((1.0, -1.0)))
def test_an_inertia_under_a_rising_torque_started_before_it_passed_the_threshold(
    start: float, jerk: float, sign: float
) -> None:
    time = np.arange(0.0, 6.0, 0.002)
    angle = sign * jerk * np.maximum(time - start, 0.0) ** 3
    threshold = 1e-3
    late = start + np.cbrt(threshold / jerk)
    found = first_motion(time, angle, threshold_rad=threshold)
    assert found.direction == sign
    assert start - 0.01 <= found.time_s < late
    assert abs(found.time_s - start) <= 2.0 * found.standard_uncertainty_s
