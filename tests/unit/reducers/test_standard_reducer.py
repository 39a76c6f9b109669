"""Known against measured friction: errors, repeatability, verdicts and what is refused."""

import numpy as np
import pytest

from torquebench.errors import InputError
from torquebench.reducers import CertifiedFriction, check_friction, load_reducer

CERTIFIED = tuple(
    CertifiedFriction(speed_rpm=speed, torque_nm=0.3 + 1e-3 * speed, expanded_uncertainty_nm=0.01)
    for speed in (100.0, 300.0)
)
SPEED = np.tile([100.0, 200.0, 300.0], 2)
REPEAT = np.repeat([1, 2], 3)


def test_errors_and_repeatability_in_percent_of_full_scale() -> None:
    torque = 0.3 + 1e-3 * SPEED + np.where(REPEAT == 1, 0.03, 0.01)
    found = check_friction(SPEED, torque, REPEAT, CERTIFIED, 50.0)
    assert [point.known_nm for point in found.points] == pytest.approx([0.4, 0.5, 0.6])
    assert found.error_percent == pytest.approx(0.04)
    assert found.repeatability_percent == pytest.approx(0.04)
    assert found.kept
    strict = check_friction(SPEED, torque, REPEAT, CERTIFIED, 50.0, tolerance_percent=0.03)
    assert [strict.error_kept, strict.repeatability_kept, strict.kept] == [False] * 3


def test_a_wrong_sign_is_an_error_and_not_friction() -> None:
    found = check_friction([100.0, -100.0], [0.4, 0.4], [1, 1], CERTIFIED, 50.0)
    assert found.points[0].error_nm == pytest.approx(-0.4)


def test_what_no_certificate_says_is_refused() -> None:
    with pytest.raises(InputError, match="100 to 300 rpm"):
        check_friction([400.0], [0.7], [1], CERTIFIED, 50.0)
    with pytest.raises(InputError, match="without certified friction"):
        check_friction([100.0], [0.4], [1], (), 50.0)


def test_speeds_of_a_certificate_have_to_rise(tmp_path) -> None:
    table = "[[certified_friction]]\nspeed_rpm = {}\ntorque_nm = 0.3\n"
    table += "expanded_uncertainty_nm = 0.01\n"
    text = (
        'name = "s"\nkind = "rv"\nratio = 80\nrated_torque_nm = 2000\n'
        "acceleration_torque_nm = 4000\nmomentary_peak_torque_nm = 8000\n"
        "max_input_speed_rpm = 1200\n"
    )
    path = tmp_path / "s.toml"
    path.write_text(text + table.format(100) + table.format(200))
    assert [each.speed_rpm for each in load_reducer(path).certified_friction] == [100, 200]
    path.write_text(text + table.format(200) + table.format(100))
    with pytest.raises(InputError, match="have to rise"):
        load_reducer(path)
