"""What is uncertain of the torques of one loading: samples share all errors but noise."""

import numpy as np
import pytest

from torquebench.campaign.reducers.uncertainty import torque_of_loading
from torquebench.chain import Component, Shared, Torque, TorqueParts
from torquebench.uncertainty import Distribution

TORQUE_NM = np.linspace(0.0, 10.0, 2001)


@pytest.mark.parametrize(
    ("component", "part", "expected"),
    [
        (Component("a", Shared.CALIBRATION, 2e-3 * TORQUE_NM), "relative", 2e-3),
        (Component("b", Shared.MOUNTING, 0.3), "mounting_nm", 0.3),
        (Component("c", Shared.ZEROING, 0.3), "zero_nm", 0.3),
        (
            Component("d", Shared.LOADING, 0.3, distribution=Distribution.RECTANGULAR),
            "loading_nm",
            0.3,
        ),
        (Component("e", Shared.LOADING, 0.3), "repeatability_nm", 0.3),
        (
            Component("f", Shared.CALIBRATION, 0.3 * (-1.0) ** np.arange(2001)),
            "model_nm",
            0.3,
        ),
    ],
)
def test_common_errors_are_not_averaged(component: Component, part: str, expected: float) -> None:
    noise = Component("noise", Shared.NOTHING, 5.0)
    parts = TorqueParts.of(Torque(TORQUE_NM, (component, noise)))
    found = vars(torque_of_loading(parts, TORQUE_NM))
    assert found[part] == pytest.approx(expected)
    assert sum(found.values()) == pytest.approx(expected)
