"""The standard of a calibration: its certificate over the torque, its temperature and drift."""

import json
from datetime import date

import numpy as np
import pytest

from torquebench.bench import default_bench
from torquebench.bench.chain_effects import PROBE_K, chain_effects, standard_effect
from torquebench.bench.description import CertifiedPoints
from torquebench.chain import Readings, Reference, effect_from
from torquebench.uncertainty import CertifiedUncertainty

TORQUE_NM = np.array([10.0, 40.0, 1020.0, -2000.0])


def shares(effect):
    parts = effect.components(Readings(TORQUE_NM), TORQUE_NM)
    return {each.name: 2.0 * each.uncertainty_nm for each in parts}


def test_u_follows_the_certificates_table_and_survives_the_file():
    effect = Reference("certificate 7", CertifiedUncertainty((40.0, 2000.0), (0.02, 0.2)), 1e-4)
    again = effect_from(json.loads(json.dumps(effect.specification())))
    assert again == effect
    found = shares(again)
    assert found["reference standard"] == pytest.approx([0.005, 0.02, 0.11, -0.2])
    limit = 2e-4 * TORQUE_NM / np.sqrt(3.0)
    assert found["temperature of standard"] == pytest.approx(limit)
    assert "drift of standard" not in found


def described(**changes):
    bench = default_bench()
    return bench.model_copy(update={"calibrator": bench.calibrator.model_copy(update=changes)})


def test_a_description_states_it_flat_relative_or_as_a_table():
    flat = shares(standard_effect(described(), "output"))["reference standard"]
    assert flat == pytest.approx([0.1, 0.4, 0.4, -0.4])
    relative = described(expanded_uncertainty_of="torque")
    found = shares(standard_effect(relative, "output"))["reference standard"]
    assert found == pytest.approx(2e-4 * TORQUE_NM)
    points = CertifiedPoints(torque_nm=[40.0, 2000.0], expanded_uncertainty_nm=[0.02, 0.2])
    table = described(certified={"output": points})
    (effect, *_) = chain_effects(table, "output", 23.0)
    assert shares(effect)["reference standard"] == pytest.approx([0.005, 0.02, 0.11, -0.2])
    assert shares(standard_effect(table, "input"))["reference standard"][0] == pytest.approx(0.01)


def test_a_standard_that_was_as_warm_as_at_its_own_calibration_is_better_known():
    bench = described()
    per_k = 1e-3 * bench.calibrator.output.temperature_span_percent_per_10k
    unknown = standard_effect(bench, "output").temperature_of_torque
    assert unknown == pytest.approx(5.0 * per_k)  # 18 to 28 °C, certified at 23
    known = standard_effect(bench, "output", standard_c=(22.4, 23.1)).temperature_of_torque
    assert known == pytest.approx((0.6 + PROBE_K) * per_k)
    warm = standard_effect(bench, "output", standard_c=(35.0,)).temperature_of_torque
    assert warm > unknown


@pytest.mark.parametrize("torques", [(40.0, 900.0, 2000.0), (-2000.0, -50.0, 30.0, 1500.0)])
def test_its_u_is_the_certificates_at_every_torque(torques):
    certified = CertifiedUncertainty(torques, tuple(0.02 + 1e-4 * abs(each) for each in torques))
    torque = np.array([-3000.0, -2000.0, -51.0, -0.0, 0.0, 7.0, 40.0, 899.0, 2000.0, np.nan])
    found, *_ = Reference("certificate 7", certified).components(Readings(torque), torque)
    np.testing.assert_array_equal(
        found.uncertainty_nm, np.copysign(0.5 * certified.at(torque), torque)
    )


def test_its_drift_counts_from_its_own_calibration():
    bench = described(
        certificate_date="2025-01-15",
        output=default_bench().calibrator.output.model_copy(
            update={"drift_percent_per_year": 0.01}
        ),
    )
    found = standard_effect(bench, "output", date(2026, 7, 15)).drift_of_torque
    assert found == pytest.approx(1.5e-4, rel=0.01)


def test_a_drift_that_nobody_states_is_named() -> None:
    stated = default_bench().calibrator.output
    bench = described(output=stated.model_copy(update={"drift_percent_per_year": None}))
    effect = standard_effect(bench, "output")
    assert effect.gaps() == ("drift of standard",)
    assert effect_from(json.loads(json.dumps(effect.specification()))) == effect
    assert not standard_effect(default_bench(), "output").gaps()  # it states that it has none
