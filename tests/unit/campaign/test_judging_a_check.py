from dataclasses import replace
from datetime import date

import numpy as np
import pytest

from torquebench.bench import default_bench
from torquebench.calibration import CalibrationData
from torquebench.campaign.bench_chains import check_standard
from torquebench.campaign.checking import judge_check
from torquebench.chain import MeasuringChain, Reference
from torquebench.compensation import make_model
from torquebench.uncertainty import CertifiedUncertainty, Verdict

CHECK = Reference("certificate 2", CertifiedUncertainty.of_range(2e-4, 100.0), 0.0, 0.0)


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
    judged = judge_check(points(error), None, standard=CHECK, tolerance_percent_fs=0.1)
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
    judged = judge_check(data, chain, standard=CHECK, tolerance_percent_fs=0.1)
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
    assert set(chain.missing()) == set(judged.missing)


def test_what_a_check_s_u_does_not_contain_is_stated():
    known = {"tolerance_percent_fs": 0.1}
    data = points(0.0)
    unknown = judge_check(data, None, standard=None, **known)
    assert not unknown.torque.expanded_uncertainty_nm.any()
    assert "check standard" in unknown.missing
    assert "check standard" not in judge_check(data, None, standard=CHECK, **known).missing
    undated = replace(CHECK, drift_of_torque=None)
    assert "drift of check standard" in judge_check(data, None, standard=undated, **known).missing


def test_temperature_and_drift_of_the_check_standard_count_beside_the_calibrators():
    bench = default_bench()
    year_old = bench.verification_standard.model_copy(
        update={
            "certificate_date": "2025-03-01",
            "output": bench.verification_standard.output.model_copy(
                update={"drift_percent_per_year": 0.01}
            ),
        }
    )
    run = {"bench": bench.model_copy(update={"verification_standard": year_old})}
    data = replace(points(0.0), side="output", measured_on=date(2026, 3, 1))
    cold, warm = (
        judge_check(
            data,
            None,
            standard=check_standard(
                run, replace(data, standard_temperature_c=np.full(3, temperature))
            ),
            tolerance_percent_fs=0.1,
        ).torque
        for temperature in (23.0, 33.0)
    )
    assert warm.component("drift of check standard") == pytest.approx(
        1e-4 * data.standard_nm / np.sqrt(3.0), rel=0.01
    )
    assert warm.component("temperature of check standard") == pytest.approx(
        21.0 * cold.component("temperature of check standard")
    )
    assert warm.component("check standard") == pytest.approx(
        0.5 * year_old.uncertainty("output").at(data.standard_nm)
    )
