import numpy as np
import pytest

from torquebench.calibration import CalibrationData
from torquebench.campaign.checking import judge_check
from torquebench.chain import MeasuringChain
from torquebench.compensation import make_model
from torquebench.uncertainty import CertifiedUncertainty, Verdict


def points(error):
    standard = np.array([20.0, 60.0, 100.0])
    return CalibrationData(standard + error, standard, [1] * 3, [1] * 3, 100.0)


@pytest.mark.parametrize(
    ("error", "verdict"),
    [
        (0.07, Verdict.PASS),
        (0.09, Verdict.CONDITIONAL_PASS),
        (-0.11, Verdict.CONDITIONAL_FAIL),
        (-0.13, Verdict.FAIL),
    ],
)
def test_the_guard_band_is_the_uncertainty_of_the_standard(error, verdict):
    judged = judge_check(
        points(error),
        None,
        standard=CertifiedUncertainty.of_range(2e-4, 100.0),
        tolerance_percent_fs=0.1,
    )
    assert np.array_equal(judged.torque.value_nm, points(error).reading_nm)
    assert judged.torque.expanded_uncertainty_nm == pytest.approx([0.02] * 3)
    assert [each.verdict for each in judged.decisions] == [verdict] * 3
    assert judged.verdict is verdict
    assert "uncertainty of the uncompensated reading" in judged.missing


def test_a_model_in_use_compensates_and_adds_its_uncertainty():
    rng = np.random.default_rng(1)
    standard = np.tile(np.linspace(-100.0, 100.0, 21), 3)
    reading = 0.99 * standard + 0.01 * rng.normal(size=standard.size)
    model = make_model("polynomial", degree=1, range_nm=100.0)
    model.fit(reading[:, None], standard)
    data = CalibrationData([19.8, 59.4, 99.0], [20.0, 60.0, 100.0], [1] * 3, [1] * 3, 100.0)
    chain = MeasuringChain(model)
    judged = judge_check(
        data,
        chain,
        standard=CertifiedUncertainty.of_range(2e-4, 100.0),
        tolerance_percent_fs=0.1,
    )
    assert judged.torque.value_nm == pytest.approx([20.0, 60.0, 100.0], abs=0.02)
    assert np.all(judged.torque.expanded_uncertainty_nm > 0.02)
    assert {each.verdict for each in judged.decisions} == {Verdict.PASS}
    # U is that of the chain's torque with one more component
    own = chain.torque(data.readings())
    names = [each.name for each in own.components]
    assert [each.name for each in judged.torque.components] == [*names, "check standard"]
    assert judged.torque.component("check standard") == pytest.approx([0.01] * 3)
    expanded = np.hypot(own.expanded_uncertainty_nm, 0.02)
    assert judged.torque.expanded_uncertainty_nm == pytest.approx(expanded, rel=1e-12)
    assert set(chain.missing()) < set(judged.missing)


def test_what_a_check_s_u_does_not_contain_is_stated():
    known = {"tolerance_percent_fs": 0.1}
    data = points(0.0)
    unknown = judge_check(data, None, standard=None, **known)
    assert not unknown.torque.expanded_uncertainty_nm.any()
    assert "check standard" in unknown.missing
    certified = judge_check(data, None, standard=CertifiedUncertainty.of_range(1e-4, 1.0), **known)
    assert "check standard" not in certified.missing
    assert "temperature and drift of the check standard" in certified.missing
