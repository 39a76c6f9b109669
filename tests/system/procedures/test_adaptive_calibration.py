"""An adaptive calibration runs on the simulated bench: one run, one record."""

import threading
import warnings

import numpy as np
import pytest
from tests.watching import Watching

from torquebench.calibration import CalibrationData, load_profile
from torquebench.compensation import make_model
from torquebench.procedures import calibrate, rehearse
from torquebench.records import RunFolder
from torquebench.station import Station

PROFILE = load_profile("adaptive").with_options(points=44)


def test_a_rehearsal_goes_up_to_the_budget_without_computing(station: Station) -> None:
    rehearsal = rehearse(station.devices, calibrate(station.devices, "output", PROFILE))
    assert rehearsal.points == 44
    assert rehearsal.result.placement is None
    torques = [abs(move.value) for move in rehearsal.moves if move.device == "output torque"]
    assert max(torques) == 2000.0


def test_points_are_placed_between_series_of_one_run(station: Station) -> None:
    seen = Watching()
    record = station.run(
        calibrate(station.devices, "output", PROFILE),
        kind="calibrate-output",
        progress=seen,
    )
    data, placement = record.result.data, record.result.placement
    assert len(data) == 44
    assert [each.points for each in placement.rounds] == [24, 44]
    assert [each.proposed for each in placement.rounds] == [20, 0]
    assert placement.reason == "budget"
    assert placement.rounds[1].expanded_percent < placement.rounds[0].expanded_percent

    assert len(set(data.series.tolist())) >= 3
    for number in set(data.series[24:].tolist()):  # up, then down, one direction each
        here = data.series == number
        assert np.all(np.diff(data.branch[here].astype(int)) <= 0)
        assert len(set(np.sign(data.nominal_nm[here]).tolist()) - {0.0}) <= 1
    assert np.all(np.diff(data.time_s) > 0.0)

    assert seen.done == sorted(seen.done)
    assert any("placing" in detail for _, detail in seen.reached)

    folder = RunFolder.open(record.folder)
    start = next(document for _, document in folder.documents("start"))
    assert start["profile"]["settings"]["adaptive"]["points"] == 44
    assert folder.results["placement"]["rounds"][0]["points"] == 24
    events = [document for _, document in folder.documents("event")]
    assert len(events) >= 44
    folder.verify()


def test_a_run_ends_with_the_target(station: Station) -> None:
    profile = PROFILE.with_options(target_percent=5.0)
    record = station.run(calibrate(station.devices, "input", profile), kind="calibrate-input")
    assert record.result.placement.reason == "target"
    assert len(record.result.data) == 24


def worst_percent(station: Station, data: CalibrationData) -> float:
    """Largest error of the recommended model against the twin's truth, % of full scale."""
    rising = np.linspace(0.0, 2000.0, 301)
    loop = np.concatenate([rising, rising[-2::-1]])
    path = np.concatenate([loop, -loop[1:]])
    reading, branch = station.drivers.truth.dense_sweep("output", path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = make_model("hybrid", range_nm=2000.0).fit(data.features(3), data.standard_nm)
    X = np.column_stack([reading, branch, np.zeros(reading.size)])
    return float(np.max(np.abs(model.predict(X) - path))) / 20.0


@pytest.mark.nightly
def test_placed_points_do_what_many_more_even_ones_do(station: Station) -> None:
    placed = station.run(calibrate(station.devices, "output", PROFILE), kind="placed").result.data
    even = load_profile("rapid-in-situ").with_options(step_percent=5.0)
    evenly = station.run(calibrate(station.devices, "output", even), kind="even").result.data
    assert len(placed) == 44
    assert len(evenly) == 80
    assert worst_percent(station, placed) < 1.25 * worst_percent(station, evenly)


def test_a_run_can_be_aborted_while_points_are_placed(station: Station) -> None:
    person = threading.Thread(target=station.abort, args=("enough",))

    def watch(_done: int, detail: str) -> None:
        if "placing" in detail:
            person.start()

    record = station.run(
        calibrate(station.devices, "output", PROFILE),
        kind="calibrate-output",
        progress=Watching(watch),
    )
    person.join()
    assert record.exit_status == "abort"
    assert not station.drivers.drives["output"].state().enabled
    assert not station.drivers.drives["output"].state().torque_nm
