from dataclasses import replace
from datetime import UTC, date, datetime

import numpy as np
import pytest

from torquebench.calibration import (
    CalibrationData,
    CalibrationRecord,
    Profile,
    ReferenceStandard,
    assign_nominal,
    find_deviations,
    load_profile,
    refuse_deviations,
)
from torquebench.errors import InputError, RecordError

START = datetime(2025, 6, 15, 12, 0, tzinfo=UTC)
RANGE_NM = 100.0


def measured(profile):
    """A calibration that follows a profile to the letter, with ideal readings."""
    steps = [step for step in profile.staircase(RANGE_NM) if step.recorded]
    torque = np.array([step.nominal_nm for step in steps])
    return CalibrationData(
        reading_nm=torque * 1.001,
        standard_nm=torque,
        series=[step.series for step in steps],
        branch=[step.branch for step in steps],
        range_nm=RANGE_NM,
        nominal_nm=torque,
        position_deg=[step.position_deg for step in steps],
        temperature_c=np.full(torque.size, 23.0),
        tared=True,
    )


def record(data, **changes):
    reference = ReferenceStandard("TC-1", "C-77", date(2025, 12, 31))
    return replace(CalibrationRecord(data, START, reference), **changes)


def kinds(data, profile, **changes):
    return [each.kind for each in find_deviations(record(data, **changes), profile)]


@pytest.mark.parametrize("name", ["rapid-in-situ", "staircase", "reversing", "check"])
def test_a_calibration_that_follows_its_profile_has_no_deviation(name):
    profile = load_profile(name)
    assert find_deviations(record(measured(profile)), profile) == ()


def test_a_torque_below_the_first_step_is_no_zero_that_returned_badly():
    torque = [0.06, 4.0, 9.9, 4.0, 0.08]
    data = CalibrationData([*torque[:4], 0.26], torque, [1] * 5, [1, 1, 1, -1, -1], RANGE_NM)
    staircase = load_profile("staircase")
    assert assign_nominal(data, staircase).nominal_nm.tolist() == [0.0, 4.0, 10.0, 4.0, 0.0]
    found = find_deviations(record(assign_nominal(data, staircase)), staircase)
    returned = [each.found for each in found if each.kind == "zero_return"]
    assert returned == ["the zero after series 1 returned to 0.2 N·m, 0.2 % of full scale"]


def test_repeats_are_series_of_their_own():
    profile = load_profile("rapid-in-situ").with_options(repeats=3, step_percent=20.0)
    data = measured(profile)
    assert kinds(data, profile) == []
    assert kinds(data.subset(data.series != 2), profile) == ["missing_series"]


@pytest.mark.parametrize("series", range(1, 9))
def test_every_missing_series_is_named_with_its_clause(series):
    profile = load_profile("staircase")
    data = measured(profile)
    member = data.series == series
    position, sign = data.position_deg[member][0], data.direction[member][0]
    (found,) = find_deviations(record(data.subset(~member)), profile)
    assert (found.kind, found.consequence) == ("missing_series", "refuse")
    place = {0.0: 0, 120.0: 1, 240.0: 2}[float(position)]
    assert found.clause.startswith(f"positions[{place}].series[")
    assert ("counter-clockwise" in found.found) == (sign < 0)
    with pytest.raises(RecordError, match=r"no series .*\(clause positions"):
        refuse_deviations((found,))


def test_a_series_without_its_decreasing_half_is_named():
    profile = load_profile("staircase")
    data = measured(profile)
    lacking = data.subset((data.series != 8) | (data.branch > 0) | (data.nominal_nm == 0.0))
    (found,) = find_deviations(record(lacking), profile)
    assert found.clause == "positions[2].series[0]"
    assert "series 8" in found.found
    assert "no decreasing torque" in found.found


def test_missing_steps_are_counted_up():
    profile = load_profile("staircase")
    data = measured(profile)
    lacking = data.subset((data.series != 1) | (np.abs(data.nominal_nm) > 50.0))
    found = {each.kind: each for each in find_deviations(record(lacking), profile)}
    step = found["missing_step"]
    assert step.clause == "loading.steps_percent"
    assert "10 N·m ↑, 20 N·m ↑, 30 N·m ↑, 40 N·m ↑ and 1 more" in step.found
    assert found["zero_return"].clause == "loading.zero_return"


@pytest.mark.parametrize(("off", "expected"), [(0.49, []), (0.51, ["step_off"])])
def test_a_step_more_than_half_a_percent_off_is_named(off, expected):
    profile = load_profile("staircase")
    data = measured(profile)
    standard = data.standard_nm.copy()
    row = int(np.flatnonzero(data.nominal_nm == -40.0)[0])
    standard[row] *= 1.0 + off / 100.0
    data = replace(data, standard_nm=standard)
    found = find_deviations(record(data), profile)
    assert [each.kind for each in found] == expected
    if found:
        assert found[0].clause == "loading.step_tolerance_percent"
        assert "the step -40 N·m of series 3 was loaded with -40.204 N·m" in found[0].found
        assert found[0].allowed == "a deviation of at most 0.5 %"


@pytest.mark.parametrize(("zero", "expected"), [(0.099, []), (-0.101, ["zero_return"])])
def test_a_zero_return_beyond_its_limit_is_named(zero, expected):
    profile = load_profile("staircase")
    data = measured(profile)
    reading = data.reading_nm.copy()
    reading[np.flatnonzero(data.nominal_nm == 0.0)[2]] = zero
    found = find_deviations(record(replace(data, reading_nm=reading)), profile)
    assert [each.kind for each in found] == expected
    if found:
        assert found[0].clause == "zero.return_limit_percent"
        assert "after series 3" in found[0].found


@pytest.mark.parametrize(
    ("due", "expected"),
    [
        (date(2025, 6, 15), []),
        (date(2025, 6, 14), ["expired_reference"]),
        (None, ["expired_reference"]),
    ],
)
def test_an_expired_reference_is_named(due, expected):
    profile = load_profile("staircase")
    reference = ReferenceStandard("TC-1", "C-77", due)
    found = find_deviations(record(measured(profile), reference=reference), profile)
    assert [each.kind for each in found] == expected
    assert all(each.clause == "reference.in_date" for each in found)
    lenient = profile.model_copy(
        update={"reference": profile.reference.model_copy(update={"in_date": False})}
    )
    assert kinds(measured(profile), lenient, reference=reference) == []


def test_a_simulated_standard_needs_no_due_date():
    profile = load_profile("staircase")
    data = replace(measured(profile), simulated=True)
    assert kinds(data, profile, reference=ReferenceStandard("SIM-CAL-1")) == []


@pytest.mark.parametrize(("last", "expected"), [(24.0, []), (24.01, ["temperature_drift"])])
def test_a_temperature_drift_over_one_kelvin_is_stated(last, expected):
    profile = load_profile("staircase")
    data = measured(profile)
    temperature = data.temperature_c.copy()
    temperature[-1] = last
    found = find_deviations(record(replace(data, temperature_c=temperature)), profile)
    assert [each.kind for each in found] == expected
    refuse_deviations(found)  # the profile states it


def test_a_changed_record_is_always_refused():
    profile = load_profile("rapid-in-situ")
    found = find_deviations(record(measured(profile), changes=("events.jsonl changed",)), profile)
    with pytest.raises(RecordError, match=r"events.jsonl changed \(clause deviations"):
        refuse_deviations(found)
    text = profile.model_dump_json()
    with pytest.raises(ValueError, match="changed_record"):
        Profile.model_validate_json(
            text.replace('"changed_record":"refuse"', '"changed_record":"state"')
        )


def test_unsettled_points_are_stated():
    profile = load_profile("rapid-in-situ")
    (found,) = find_deviations(record(measured(profile), unsettled=3), profile)
    assert (found.kind, found.consequence) == ("unsettled", "state")
    assert "3 of 200 points" in str(found)


@pytest.mark.parametrize("consequence", ["refuse", "state"])
def test_the_profile_decides_what_a_certificate_does(consequence):
    settings = load_profile("staircase").model_dump()
    settings["deviations"]["temperature_drift"] = consequence
    profile = Profile.model_validate(settings)
    data = measured(profile)
    data = replace(data, temperature_c=np.linspace(20.0, 22.0, len(data)))
    found = find_deviations(record(data), profile)
    assert [each.consequence for each in found] == [consequence]
    assert profile.sha256 != load_profile("reversing").sha256


def test_nominal_torques_are_found_from_the_profile():
    profile = load_profile("staircase")
    data = measured(profile)
    rough = replace(data, nominal_nm=None, standard_nm=data.standard_nm * 1.003)
    assert np.allclose(assign_nominal(rough, profile).nominal_nm, data.nominal_nm)
    assert assign_nominal(data, profile) is data
    with pytest.raises(
        InputError, match=r"has no steps.*adaptive, check, rapid-in-.*verify MODEL TABLE"
    ):
        assign_nominal(rough, load_profile("verification"))


def test_what_follows_no_steps_has_none_missing():
    profile = load_profile("verification")
    rng = np.random.default_rng(1)
    steps = [step for step in profile.staircase(RANGE_NM, rng) if step.recorded][:40]
    torque = np.array([step.nominal_nm for step in steps])
    data = CalibrationData(torque, torque, [1] * 40, [step.branch for step in steps], RANGE_NM)
    assert kinds(data, profile) == []
