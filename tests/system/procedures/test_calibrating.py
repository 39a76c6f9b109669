"""Calibration and verification run on the simulated bench."""

import threading

import numpy as np
import pytest
from tests.watching import Watching

import torquebench
from torquebench.calibration import load_profile
from torquebench.procedures import calibrate, verify
from torquebench.records import RunFolder
from torquebench.station import Station

PROFILE = load_profile("rapid-in-situ").with_options(step_percent=25.0)


def start_document(folder: RunFolder) -> dict:
    return next(document for _, document in folder.documents("start"))


def test_a_calibration_gives_its_table_and_names_what_it_rests_on(station: Station) -> None:
    record = station.run(calibrate(station.devices, "output", PROFILE), kind="calibrate-output")
    data = record.result.data
    assert len(data) == 16
    assert data.range_nm == 2000.0
    assert data.transducer_serial == "SIM-T2000"
    assert data.counter_identity == station.drivers.counter.clock_identity
    assert data.nominal_nm[:4].tolist() == [500.0, 1000.0, 1500.0, 2000.0]
    assert data.branch.tolist() == [1, 1, 1, 1, -1, -1, -1, -1] * 2
    assert np.abs(data.standard_nm - data.true_torque_nm).max() < 0.02e-2 * 2000.0
    raw = np.abs(data.reading_nm - data.true_torque_nm).max()
    assert 0.001 * 2000.0 < raw < 0.02 * 2000.0
    assert np.all(data.standard_error_nm > 0.0)
    assert np.all(np.diff(data.time_s) > 0.0)
    assert record.result.standard_serial == "SIM-CAL-1"

    start = start_document(RunFolder.open(record.folder))
    assert start["profile"]["sha256"] == PROFILE.sha256
    assert start["profile"]["verified"] is False
    assert start["transducer_serial"] == "SIM-T2000"
    assert start["standard_serial"] == "SIM-CAL-1"
    assert start["counter_identity"] == data.counter_identity
    assert start["software_version"] == torquebench.__version__
    assert start["simulated"] is True


def test_the_bench_is_left_without_torque_and_drives_off(station: Station) -> None:
    station.run(calibrate(station.devices, "input", PROFILE), kind="calibrate-input")
    for drive in station.drivers.drives.values():
        assert not drive.state().enabled
        assert not drive.state().torque_nm
    station.clock.wait(0.5)
    now = station.clock.now()
    assert abs(station.drivers.truth.true_torque("input", now - 0.1, now)) < 0.05


def test_the_zero_is_measured_and_used(station: Station) -> None:
    nominal = station.description.input.transducer.scale().zero
    station.run(calibrate(station.devices, "input", PROFILE), kind="calibrate-input")
    measured = station.acquisition.zero("input_torque")
    assert measured != nominal
    assert measured == pytest.approx(nominal, rel=0.01)


def test_points_state_the_zero_that_they_count_from(station: Station) -> None:
    scale = station.description.input.transducer.scale()
    record = station.run(calibrate(station.devices, "input", PROFILE), kind="calibrate-input")
    measured = scale.torque(station.acquisition.zero("input_torque"))
    np.testing.assert_allclose(record.result.data.zero_nm, measured, rtol=0.0, atol=1e-6)


def test_events_of_points_and_zeros_are_kept_in_streams_of_their_own(station: Station) -> None:
    record = station.run(calibrate(station.devices, "input", PROFILE), kind="calibrate-input")
    folder = RunFolder.open(record.folder)
    folder.verify()
    streams = {doc["uid"]: doc["name"] for _, doc in folder.documents("descriptor")}
    names = [streams[doc["descriptor"]] for _, doc in folder.documents("event")]
    assert names.count("points") == 16
    assert names.count("zero_input") == 1


def test_a_verification_takes_the_verification_standard(station: Station) -> None:
    profile = load_profile("verification").with_options(groups=2, points=8)
    steps = profile.staircase(50.0, np.random.default_rng(3))
    record = station.run(verify(station.devices, "input", profile, steps), kind="verify-input")
    data = record.result.data
    assert record.result.standard_serial == "SIM-VER-1"
    assert sorted(set(data.series.tolist())) == [1, 2]
    grid = data.nominal_nm / 1.0  # a step of the calibration is 2 % of 50 N·m
    assert np.abs(grid - np.rint(grid)).min() > 0.2
    assert np.abs(data.standard_nm - data.true_torque_nm).max() < 0.02e-2 * 50.0


def test_both_modules_one_after_the_other(station: Station) -> None:
    for side in ("input", "output"):
        record = station.run(calibrate(station.devices, side, PROFILE), kind=f"calibrate-{side}")
        assert record.result.data.side == side


def test_a_pause_takes_the_load_off_and_the_branch_is_approached_again(station: Station) -> None:
    undisturbed = station.run(calibrate(station.devices, "output", PROFILE), kind="first")
    torques, seen = [], []

    def pause_on_the_falling_branch(done: int, detail: str) -> None:
        if detail.startswith("series 1, point 7") and not seen:
            seen.append(done)
            station.pause()

    def look(paused: Station) -> str:
        now = paused.clock.now()
        torques.append(paused.drivers.truth.true_torque("output", now - 0.01, now))
        return "resume"

    record = station.run(
        calibrate(station.devices, "output", PROFILE),
        kind="second",
        progress=Watching(pause_on_the_falling_branch),
        on_pause=look,
    )
    assert record.exit_status == "success"
    assert record.interruptions == 1
    assert len(torques) == 1
    assert abs(torques[0]) < 0.05 * 2000.0  # the ramp to zero has just ended
    first, second = undisturbed.result.data, record.result.data
    assert len(second) == len(first)
    # Same branch, so the same additional torque within twice the hysteresis' tolerance.
    difference = second.additional_torque_nm - first.additional_torque_nm
    assert np.abs(difference).max() < 0.1e-2 * 2000.0
    turned = [
        doc["data"]["point-nominal_nm"]
        for _, doc in RunFolder.open(record.folder).documents("event")
        if "point-nominal_nm" in doc["data"]
    ]
    assert len(turned) == 17


def test_the_turning_point_of_a_falling_branch_is_found() -> None:
    from torquebench.procedures.setup import Setup
    from torquebench.procedures.staircase import _Loader

    steps = PROFILE.staircase(2000.0)
    loader = _Loader(None, Setup("calibration", "output", "calibrator", "locked"), steps)
    falling = [number for number, step in enumerate(steps) if step.recorded and step.branch < 0]
    assert [loader.turning_point(number) for number in falling] == [2000.0] * 4 + [-2000.0] * 4


def test_an_abort_leaves_no_torque_and_a_readable_record(station: Station) -> None:
    def abort_at_the_third_point(_done: int, detail: str) -> None:
        if detail.startswith("series 1, point 3"):
            # From a thread of its own: the callback runs on the engine's.
            aborting.append(threading.Thread(target=station.abort, args=("the test",)))
            aborting[0].start()

    aborting: list[threading.Thread] = []

    record = station.run(
        calibrate(station.devices, "output", PROFILE),
        kind="calibrate-output",
        progress=Watching(abort_at_the_third_point),
    )
    aborting[0].join()
    assert record.exit_status == "abort"
    assert record.reason == "the test"
    assert record.result is None
    folder = RunFolder.open(record.folder)
    folder.verify()
    assert folder.manifest["status"] == "aborted"
    station.clock.wait(0.5)
    now = station.clock.now()
    assert abs(station.drivers.truth.true_torque("output", now - 0.1, now)) < 2.0
    assert not station.drivers.drives["output"].state().enabled


def test_a_profile_with_a_reseat_mounts_the_standard_again(station: Station) -> None:
    text = """
name = "two-positions"
title = "Two positions"
source = "a test"
[loading]
pattern = "ladder"
steps_percent = [50.0, 100.0]
duration_s = 0.5
settle_limit_s = 0.5
directions = ["clockwise"]
[zero]
duration_s = 0.5
[[positions]]
series = ["up"]
[[positions]]
position_deg = 120.0
change = "rotation"
series = ["up-down"]
"""
    from torquebench.calibration import Profile

    profile = Profile.from_toml(text, "two-positions.toml")
    mounted = []
    original = station.drivers.operator.mount

    def mount(what: str) -> None:
        mounted.append(what)
        original(what)

    station.drivers.operator.mount = mount
    record = station.run(calibrate(station.devices, "input", profile), kind="calibrate-input")
    assert mounted == ["calibrator", "nothing", "calibrator"]
    assert record.result.data.position_deg.tolist() == [0.0, 0.0, 120.0, 120.0, 120.0, 120.0]
