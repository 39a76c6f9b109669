"""What every effect makes of a reading: contribution, uncertainty, whether it holds, its switch."""

import re
from dataclasses import replace

import numpy as np
import pytest

from torquebench.bench.chain_effects import chain_effects
from torquebench.bench.description import default_bench
from torquebench.chain import (
    EffectState,
    Inertia,
    MeasuredRotation,
    MeasuredTemperature,
    MeasuringChain,
    Readings,
    Reference,
    effect_states,
    not_in_u,
)
from torquebench.chain.states import RECORDS, record_message
from torquebench.compensation import features, make_model
from torquebench.errors import InputError
from torquebench.translations import templates, translated
from torquebench.uncertainty import CertifiedUncertainty

ROTATION = MeasuredRotation(
    "empty runs", 23.0, -1200.0, 1200.0, 10.0, 40.0, (0.0, 1200.0), (10.0, 40.0),
    ((0.0, 0.0), (0.02, 0.02)), ((0.0, 0.0), (0.001, 0.001)),
    ((0.0, 0.0), (0.05, 0.05)), ((0.0, 0.0), (0.002, 0.002)),
)  # fmt: skip
TURNING = Readings(
    np.array([10.0]),
    branch=np.ones(1),
    speed_rpm=1200.0,
    temperature_c=23.0,
    acceleration_rad_s2=30.0,
    zero_age_h=0.1,
    calibration_age_h=1.0,
)


@pytest.fixture(scope="module")
def chain() -> MeasuringChain:
    share = np.concatenate([np.linspace(0.0, 1.0, 20), np.linspace(1.0, 0.0, 20)])
    branch = np.repeat([1, -1], 20)
    torque = np.concatenate([50.0 * share, -50.0 * share])
    both = np.tile(branch, 2)
    reading = torque + 0.05 * np.sign(torque) * both * (1.0 - np.tile(share, 2))
    model = make_model("hybrid", range_nm=50.0).fit(features(reading, both), torque)
    stored = (
        ROTATION,
        Inertia("ramps", 0.002, 1e-5, 300.0),
        Reference("certificate", CertifiedUncertainty.flat(0.01, 1.0, 50.0)),
    )
    return MeasuringChain(model, stored)


def states(chain: MeasuringChain, readings: Readings) -> dict[str, EffectState]:
    found = effect_states(chain, readings, chain.compensated(readings))
    return {each.name: each for each in found}


def test_contributions_and_uncertainties_add_up_to_the_torque_and_its_u(
    chain: MeasuringChain,
) -> None:
    torque, found = chain.torque(TURNING), states(chain, TURNING)
    assert found["inertia"].contribution_nm == pytest.approx(-0.06)
    assert found["bearing drag"].contribution_nm == pytest.approx(-0.05)
    added = sum(each.contribution_nm or 0.0 for each in found.values())
    assert 10.0 + added == pytest.approx(float(torque.value_nm[0]), abs=1e-9)
    u = np.sqrt(sum((each.uncertainty_nm or 0.0) ** 2 for each in found.values()))
    assert 2.0 * u == pytest.approx(float(torque.expanded_uncertainty_nm[0]))
    assert {each.state for each in found.values()} == {"holds", "missing"}
    assert found["reference standard"].contribution_nm is None
    assert found["reference standard"].switch == ""
    assert (found["inertia"].switch, found["hysteresis"].switch) == ("inertia", "hysteresis")


def test_influences_without_a_record_are_shown_as_not_in_u(chain: MeasuringChain) -> None:
    """Only `apply`, `budget` and the notebook named them."""
    found = states(chain, TURNING)
    missing = [each for each in found.values() if each.state == "missing"]
    assert [each.name for each in missing] == list(chain.missing())
    assert {"creep under load", "drift since calibration"} <= {each.name for each in missing}
    assert {(each.contribution_nm, each.uncertainty_nm) for each in missing} == {(None, None)}
    span = MeasuredTemperature("runs", 23.0, 10.0, 40.0, (10.0, 40.0), (0.0, 0.0), (0.1, 0.1))
    unidentified = states(chain.with_effects([span]), TURNING)["temperature of span"]
    assert (unidentified.state, unidentified.uncertainty_nm) == ("missing", None)
    assert not_in_u([]) is None


def test_what_is_outside_or_not_measured_is_named(chain: MeasuringChain) -> None:
    fast = states(chain, replace(TURNING, speed_rpm=1500.0))
    assert fast["bearing drag"].state == "outside"
    assert fast["bearing drag"].detail == "speed 1500 1/min, allowed -1320 to 1320 1/min"
    assert fast["bearing drag"].contribution_nm is None
    blind = states(chain, replace(TURNING, acceleration_rad_s2=np.nan))
    assert (blind["inertia"].state, blind["inertia"].detail) == ("unmeasured", "acceleration")
    beyond = states(chain, replace(TURNING, reading_nm=np.array([80.0])))
    assert beyond["static curve"].state == "outside"


def test_a_switched_off_correction_leaves_its_size_in_u(chain: MeasuringChain) -> None:
    whole = states(chain, TURNING)
    less = chain.switched("a test", ["rotation"])
    found = states(less, TURNING)
    assert less.switches == ("rotation",)
    assert (found["bearing drag"].state, found["inertia"].state) == ("off", "holds")
    assert found["bearing drag"].contribution_nm is None
    assert found["bearing drag"].uncertainty_nm > abs(whole["bearing drag"].contribution_nm or 0.0)
    assert less.switched("a test", []).switches == ()
    assert states(less.switched("a test", []), TURNING) == whole
    with pytest.raises(InputError, match="wobble"):
        chain.switched("a test", ["wobble"])


def test_every_record_is_said_in_chinese() -> None:
    stated = {effect.record for effect in chain_effects(default_bench(), "output")}
    stored = {"certificate 7 of SIM-CAL-1; certificate 8 of C 9, PTB", "tables; 5 zeros of a.csv"}
    words = [translated(record_message(record), "zh") for record in stated | stored]
    assert len(stated) > 2
    assert [text for text in words if not re.search("[\u4e00-\u9fff]", text)] == []
    assert [template for template in RECORDS if template not in templates("zh")] == []
