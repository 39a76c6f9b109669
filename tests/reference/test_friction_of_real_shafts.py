"""Friction torque against speed, measured with rotary torque transducers.

Source: Bachant and Wosnik, figshare 10.6084/m9.figshare.1286960 and 10.6084/m9.figshare.1373899
(CC BY 4.0); 25 mean torques each, one at each speed.
"""

import numpy as np
import pytest

from torquebench.errors import InputError
from torquebench.reducers import evaluate_friction

RAD_S_PER_RPM = 2 * np.pi / 60


def load(path):
    table = np.genfromtxt(path, delimiter=",", names=True)
    return table["rpm"], table["tare_torque"]


def test_rvat_shaft_has_coulomb_and_viscous_friction(reference_data):
    speed, torque = load(reference_data("unh-tare-torque/rvat_re_dep_tare_torque.csv"))
    fit = evaluate_friction(speed, torque, tolerance_rpm=0.01).clockwise
    assert fit.form == "coulomb-viscous"
    slope, intercept = np.polyfit(speed, torque, 1)
    assert fit.coulomb_nm.value == pytest.approx(intercept, rel=1e-9)
    assert fit.viscous_nm_s_per_rad.value * RAD_S_PER_RPM == pytest.approx(slope, rel=1e-9)
    assert fit.coulomb_nm.value == pytest.approx(0.8768, abs=5e-5)
    assert fit.viscous_nm_s_per_rad.value * RAD_S_PER_RPM == pytest.approx(0.000475, abs=5e-7)


def test_rm2_shaft_falls_with_speed_as_boundary_friction_does(reference_data):
    speed, torque = load(reference_data("unh-tare-torque/rm2_tare_torque.csv"))
    fit = evaluate_friction(speed, -torque, tolerance_rpm=0.01).clockwise
    assert fit.form == "coulomb-stribeck"
    assert fit.viscous_nm_s_per_rad.value == 0.0
    # From creeping to fast the measured torque falls from 0.868 to 0.763 N·m.
    assert fit.torque(3.5) == pytest.approx(0.868, abs=0.025)
    assert fit.torque(95.0) == pytest.approx(0.763, abs=0.01)
    assert fit.residual_nm < 0.011
    line_alone = evaluate_friction(speed, -torque, form="coulomb", tolerance_rpm=0.01)
    assert fit.residual_nm < 0.35 * line_alone.clockwise.residual_nm


def test_rm2_torque_with_its_own_sign_would_help_the_motion(reference_data):
    speed, torque = load(reference_data("unh-tare-torque/rm2_tare_torque.csv"))
    with pytest.raises(InputError, match="help the motion"):
        evaluate_friction(speed, torque)
