"""Parts of a torque's uncertainty by what shares its errors, and by their signs."""

from typing import Any

import numpy as np
import pytest

from torquebench.chain import Component, Shared, Torque, TorqueParts
from torquebench.uncertainty import Distribution

TORQUE_NM = np.array([-80.0, -5.0, 5.0, 80.0])
SIGN = np.sign(TORQUE_NM)
PLACE = np.zeros((4, 1))


def component(shared: Shared, u_nm: Any, **known: Any) -> Component:
    return Component("an effect that nobody knows", shared, np.asarray(u_nm), **known)


@pytest.mark.parametrize(
    ("part", "error"),
    [
        ("scale_nm", component(Shared.CALIBRATION, 1e-3 * TORQUE_NM)),
        ("scale_nm", component(Shared.CALIBRATION, -1e-3 * TORQUE_NM, place=PLACE)),
        ("scale_nm", component(Shared.CALIBRATION, 0.1 * SIGN)),
        ("shift_nm", component(Shared.CALIBRATION, 0.1)),
        ("shift_nm", component(Shared.CALIBRATION, np.abs(TORQUE_NM))),
        ("curve_nm", component(Shared.CALIBRATION, np.full(4, 0.1), place=PLACE)),
        ("curve_nm", component(Shared.CALIBRATION, [0.1, -0.1, 0.2, 0.1])),
        ("mounting_nm", component(Shared.MOUNTING, 1e-3 * TORQUE_NM)),
        ("mounting_nm", component(Shared.MOUNTING, 0.1)),
        ("zero_nm", component(Shared.ZEROING, 0.1)),
        ("loading_nm", component(Shared.LOADING, 0.1, distribution=Distribution.ARCSINE)),
        ("scatter_nm", component(Shared.LOADING, 0.1)),
        ("noise_nm", component(Shared.NOTHING, 0.1)),
    ],
)
def test_what_shares_an_error_and_its_signs_say_where_it_belongs(
    part: str, error: Component
) -> None:
    found = TorqueParts.of(Torque(TORQUE_NM, (error,)))
    size = np.broadcast_to(np.abs(error.uncertainty_nm), 4)
    assert getattr(found, part) == pytest.approx(size)
    assert found.standard_uncertainty_nm == pytest.approx(size)  # and nothing anywhere else


def test_errors_whose_sign_differs_only_near_zero_still_belong_to_the_scale() -> None:
    """Effects see the torque before later corrections: near 0 its sign may differ."""
    torque = np.linspace(-80.0, 80.0, 5000)
    before = torque + 0.05
    found = TorqueParts.of(Torque(torque, (component(Shared.CALIBRATION, 1e-3 * before),)))
    assert np.any(before * torque < 0.0)
    assert found.scale_nm == pytest.approx(1e-3 * np.abs(before))


def test_records_of_both_directions_are_joined_and_cut() -> None:
    torque = Torque(TORQUE_NM, (component(Shared.CALIBRATION, TORQUE_NM),))
    parts = [TorqueParts.of(torque.at(rows)) for rows in ([0, 1], [2, 3])]
    joined = TorqueParts.joined(parts)
    assert joined.at(slice(1, 3)).scale_nm.tolist() == [5.0, 5.0]
    assert TorqueParts.joined([]).noise_nm.size == 0
