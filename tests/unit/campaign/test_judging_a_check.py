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
    torque, expanded, decisions = judge_check(
        points(error),
        None,
        standard=CertifiedUncertainty.of_range(2e-4, 100.0),
        tolerance_percent_fs=0.1,
    )
    assert np.array_equal(torque, points(error).reading_nm)
    assert expanded == pytest.approx([0.02] * 3)
    assert [each.verdict for each in decisions] == [verdict] * 3


def test_a_model_in_use_compensates_and_adds_its_uncertainty():
    rng = np.random.default_rng(1)
    standard = np.tile(np.linspace(-100.0, 100.0, 21), 3)
    reading = 0.99 * standard + 0.01 * rng.normal(size=standard.size)
    model = make_model("polynomial", degree=1, range_nm=100.0)
    model.fit(reading[:, None], standard)
    data = CalibrationData([19.8, 59.4, 99.0], [20.0, 60.0, 100.0], [1] * 3, [1] * 3, 100.0)
    torque, expanded, decisions = judge_check(
        data,
        MeasuringChain(model),
        standard=CertifiedUncertainty.of_range(2e-4, 100.0),
        tolerance_percent_fs=0.1,
    )
    assert torque == pytest.approx([20.0, 60.0, 100.0], abs=0.02)
    assert np.all(expanded > 0.02)
    assert {each.verdict for each in decisions} == {Verdict.PASS}
