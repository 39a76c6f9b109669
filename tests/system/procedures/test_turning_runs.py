"""Empty runs and turning calibrations by profiles, on the simulated bench."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tests.watching import Watching

from torquebench.calibration import available_profiles
from torquebench.campaign.bench_chains import bench_effects
from torquebench.campaign.measuring import RunAbortedError
from torquebench.campaign.turning_runs import measure_turning, read_begun, rehearse_turning
from torquebench.chain import Reference
from torquebench.errors import BenchError, InputError, LimitError
from torquebench.procedures.turning.empty import EmptyTable
from torquebench.procedures.turning.profile import (
    TurningProfile,
    load_turning_profile,
)
from torquebench.station import Station
from torquebench.tables import read_calibration, read_empty_run

SHORT = {
    "name": "short",
    "speed_shares": [1.0],
    "largest_rpm": {"input": 1200, "output": 15},
    "hold_s": 0.2,
    "settle_s": 0.2,
    "ramps": {"gentle_s": 4.0, "steep_s": 1.5},
}


def profile(**changes: object) -> TurningProfile:
    return TurningProfile.model_validate({**SHORT, **changes})


def paused_at(station: Station, wanted: Callable[[int, str], bool]) -> Watching:
    """Pause the run once, at the first step with such a description."""
    pauses: list[str] = []

    def pause(done: int, detail: str) -> None:
        if wanted(done, detail) and not pauses:
            pauses.append(detail)
            station.pause()

    return Watching(pause)


def columns(path: Path) -> np.ndarray:
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    assert lines[0] == "time_s,reading_nm,speed_rpm,temperature_c,angle_deg"
    return np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]]).T


def test_every_profile_that_comes_with_the_package_can_be_rehearsed(station: Station) -> None:
    names = available_profiles("torquebench.procedures.turning")
    assert "empty-run" in names
    for name in names:
        chosen = load_turning_profile(name)
        found = rehearse_turning(station, "input", chosen)
        assert found.duration_s > 60.0
        if chosen.kind == "empty":
            assert found.points >= chosen.series() * len(chosen.legs("input"))
        if chosen.kind != "dynamics":
            assert chosen.top_rpm("output") == 15.0
    assert not station.drivers.drives["input"].state().enabled


def test_holds_last_whole_revolutions() -> None:
    chosen = load_turning_profile("empty-run")
    for speed in (1.5, 15.0, 120.0, -1200.0):
        turns = chosen.turning_s(speed) * abs(speed) / 60.0
        assert turns == pytest.approx(round(turns), abs=1e-6)
        assert chosen.turning_s(speed) >= chosen.hold_s - 1e-9


def test_an_empty_run_ends_in_the_table_that_a_fit_takes(station: Station, tmp_path: Path) -> None:
    file = tmp_path / "empty.csv"
    done = measure_turning(station, "input", profile(), file)
    time_s, reading, speed, temperature, angle = columns(file)
    assert done.rows == time_s.size
    assert np.allclose(np.diff(time_s), 0.01, atol=1e-5)
    assert speed.max() == pytest.approx(1200.0, rel=0.05)
    assert speed.min() == pytest.approx(-1200.0, rel=0.05)
    assert np.all(np.abs(temperature - 23.0) < 3.0)
    acceleration = np.gradient(np.convolve(speed, np.full(9, 1 / 9), "same"), time_s)
    assert np.percentile(acceleration, 95) > 1.8 * 1200.0 / 4.0  # steep and gentle ones
    steps = np.abs(np.diff(speed))
    assert steps.max() < 15.0  # also where one stretch of the recorder follows another
    turned = np.diff(np.unwrap(angle, period=360.0)) / np.diff(time_s) / 6.0
    assert np.allclose(turned, 0.5 * (speed[1:] + speed[:-1]), atol=3.0)
    fast, back = speed > 1150.0, speed < -1150.0
    assert reading[fast].mean() > reading[back].mean()  # drag turns round with the speed
    assert "# simulated = true" in file.read_text()
    assert read_empty_run(file).zero_nm is not None
    assert not station.drivers.drives["input"].state().enabled


def test_a_series_waits_for_its_temperature_or_is_told(station: Station, tmp_path: Path) -> None:
    wanted = {"wanted_c": [35.0], "within_k": 1.0, "longest_h": 0.005, "check_interval_s": 9.0}
    chosen = profile(temperatures=wanted)
    with pytest.raises(ValueError, match="not both"):
        profile(temperatures=wanted, warm_up={"minutes": 1.0})
    with pytest.raises(Exception, match=r"35 °C ± 1 K.*--no-wait"):
        measure_turning(station, "input", chosen, tmp_path / "empty.csv")
    assert not (tmp_path / "empty.csv").exists()
    measure_turning(station, "input", chosen, tmp_path / "empty.csv", wait=False)
    assert columns(tmp_path / "empty.csv")[3].max() < 30.0


def test_an_aborted_run_keeps_its_series_and_goes_on_with_the_others(
    station: Station, tmp_path: Path
) -> None:
    file, chosen = tmp_path / "empty.csv", profile(repeats=2)
    legs = len(chosen.legs("input"))

    def stop(done: int, _detail: str) -> None:
        if done >= legs + 2:  # in the second series
            station.abort("enough")

    with pytest.raises(RunAbortedError):
        measure_turning(station, "input", chosen, file, progress=Watching(stop))
    first = columns(file)
    serial = station.description.input.transducer.serial
    assert "# series_done = 1 of 2" in file.read_text()
    with pytest.raises(InputError, match="profile_hash"):
        read_begun(file, "input", profile(), serial)
    begun = read_begun(file, "input", chosen, serial)
    watching = paused_at(station, lambda _, detail: detail.startswith("steep ramp to rest"))
    measure_turning(
        station, "input", chosen, file, begun=begun, progress=watching, on_pause=lambda _: "resume"
    )
    whole = columns(file)
    assert whole[2].max() == pytest.approx(first[2].max(), rel=0.01)
    np.testing.assert_allclose(whole[:, : first.shape[1]], first)
    assert np.all(np.diff(whole[0]) > 0.0)
    assert whole.shape[1] == pytest.approx(2 * first.shape[1], rel=0.02)
    with pytest.raises(InputError, match="complete"):
        read_begun(file, "input", chosen, serial)


def test_a_turning_module_is_calibrated_over_whole_revolutions(
    station: Station, tmp_path: Path
) -> None:
    chosen = profile(kind="calibration", torque_shares=[0.5, 1.0])
    file, points = tmp_path / "points.csv", chosen.points("input", 50.0)
    assert points[-2].branch < 0
    watching = paused_at(station, lambda done, _: done == len(points) - 2)
    measure_turning(station, "input", chosen, file, progress=watching, on_pause=lambda _: "resume")
    data = read_calibration(file)
    assert len(data) == len(points)
    assert data.speed_rpm is not None
    assert data.nominal_nm is not None
    assert set(np.round(data.speed_rpm)) == {1200.0, -1200.0}
    assert sorted(set(data.nominal_nm.tolist())) == [-50.0, -25.0, 0.0, 25.0, 50.0]
    assert np.max(np.abs(data.reading_nm - data.standard_nm)) < 0.02 * 50.0
    at_zero = data.nominal_nm == 0.0
    assert np.max(np.abs(data.standard_nm[at_zero])) < 0.01 * 50.0
    assert data.standard_temperature_c is not None
    (effect, *_) = bench_effects(station.description, data)
    assert isinstance(effect, Reference)
    assert data.reference is not None
    assert data.reference.certified == effect.certified
    assert data.reference.temperature_of_torque == pytest.approx(effect.temperature_of_torque)
    assert 0.0 < effect.temperature_of_torque < 1e-4  # of the measured temperature


def test_an_aborted_turning_calibration_goes_on_with_the_other_speeds(
    station: Station, tmp_path: Path
) -> None:
    chosen, file = profile(kind="calibration", torque_shares=[1.0]), tmp_path / "points.csv"
    of_a_speed = len(chosen.points("input", 50.0)) // 2

    def stop(done: int, _detail: str) -> None:
        if done >= of_a_speed + 2:  # at the second speed
            station.abort("enough")

    with pytest.raises(RunAbortedError):
        measure_turning(station, "input", chosen, file, progress=Watching(stop))
    first = read_calibration(file)
    assert len(first) == of_a_speed
    begun = read_begun(file, "input", chosen, station.description.input.transducer.serial)
    done = measure_turning(station, "input", chosen, file, begun=begun)
    whole = read_calibration(file)
    assert done.rows == len(whole) == 2 * of_a_speed
    np.testing.assert_array_equal(whole.reading_nm[:of_a_speed], first.reading_nm)
    assert whole.series.tolist() == [1] * of_a_speed + [2] * of_a_speed
    assert whole.time_s is not None
    assert np.all(np.diff(whole.time_s) > 0.0)
    assert whole.zero_temperature_c is not None
    assert whole.zero_nm is not None
    zeros = whole.zero_nm.reshape(2, -1)  # one zero for each series
    assert np.max(np.ptp(zeros, axis=1)) < 1e-6 < abs(zeros[0, 0] - zeros[1, 0])
    with pytest.raises(InputError, match="complete"):
        read_begun(file, "input", chosen, station.description.input.transducer.serial)


def test_a_verification_draws_speeds_and_torques_that_a_seed_repeats(
    station: Station, tmp_path: Path
) -> None:
    drawn = {"speeds": 2, "torques": 3}
    changes = {"kind": "verification", "torque_shares": [0.8], "random": drawn, "repeats": 2}
    chosen = profile(**{**changes, "speed_shares": [0.3, 1.0]})
    points = chosen.points("input", 50.0)
    assert points == chosen.with_seed(1).points("input", 50.0)
    assert points != chosen.with_seed(2).points("input", 50.0)
    assert chosen.sha256 != chosen.with_seed(2).sha256
    assert [point.series for point in points] == 8 * [1] + 8 * [2]
    speeds = {abs(point.speed_rpm) for point in points}
    assert len(speeds) == 4
    assert 360.0 <= min(speeds) <= max(speeds) <= 1200.0
    assert 20.0 < max(abs(point.torque_nm) for point in points) <= 40.0
    assert points[3].torque_nm == points[7].torque_nm == 0.0
    file = tmp_path / "fresh.csv"
    measure_turning(station, "input", chosen, file)
    data = read_calibration(file)
    assert data.nominal_nm is not None
    assert data.speed_rpm is not None
    np.testing.assert_allclose(data.nominal_nm, [point.torque_nm for point in points], atol=1e-5)
    np.testing.assert_allclose(data.speed_rpm, [point.speed_rpm for point in points], rtol=0.01)
    np.testing.assert_array_equal(data.series, [point.series for point in points])
    assert np.max(np.abs(data.reading_nm - data.standard_nm)) < 0.02 * 50.0


@pytest.mark.nightly
def test_a_verification_waits_for_the_temperature_of_each_series(
    station: Station, tmp_path: Path
) -> None:
    changes = {"kind": "verification", "torque_shares": [0.8], "random": {"speeds": 1}}
    waits = profile(**changes, temperatures={"wanted_c": [60.0], "longest_h": 0.02})
    with pytest.raises(BenchError, match="60 °C"):
        measure_turning(station, "input", waits, tmp_path / "never.csv")
    measure_turning(station, "input", waits, tmp_path / "now.csv", wait=False)


def test_profiles_that_make_no_run_are_refused(station: Station, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="empty-run, empty-run-temperatures"):
        load_turning_profile("nothing")
    (tmp_path / "own.toml").write_text("speed_shares = [1.0, 0.5]\n[largest_rpm]\ninput = 100\n")
    with pytest.raises(InputError, match="rising"):
        load_turning_profile(tmp_path / "own.toml")
    with pytest.raises(InputError, match="largest_rpm"):
        profile(largest_rpm={"input": 100}).legs("output")
    with pytest.raises(ValueError, match="calibration"):
        profile(torque_shares=[1.0])
    with pytest.raises(ValueError, match="random belongs"):
        profile(kind="verification", torque_shares=[1.0])
    with pytest.raises(InputError, match="a seed for profile"):
        profile().with_seed(3)
    with pytest.raises(LimitError):
        rehearse_turning(station, "input", profile(largest_rpm={"input": 5000}))
    assert EmptyTable("input").summary().rows == 0
