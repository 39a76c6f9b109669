"""Stretches of torque and angle: readings that no calibration covers are refused by name."""

import numpy as np
import pytest

from torquebench.bench.devices.recorder import refuse_outside
from torquebench.chain.effects.static_curve import StaticCurve
from torquebench.compensation import make_model
from torquebench.errors import InputError


def test_readings_outside_the_calibrated_range_are_named() -> None:
    """A test beyond its calibration ended with "SVD did not converge"."""
    standard = np.linspace(-1.0, 1.0, 21)
    model = make_model("polynomial-1", range_nm=1.0).fit(standard[:, None] * 0.99, standard)
    curve = StaticCurve("calibration in place", model)
    refuse_outside("input", curve, np.array([-0.9, 0.0, 0.9]))
    with pytest.raises(InputError, match=r"input module: a reading of -3\.4 N·m outside") as found:
        refuse_outside("input", curve, np.array([-3.4, 0.0, 3.3]))
    assert "calibrate the input" in found.value.remedy
