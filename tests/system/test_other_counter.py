"""A model that was made with another counter: refused, or accepted by name with uncertainty."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from tests.system.command_line import run
from tests.system.test_station_runs import calibrated, staircase

from torquebench.bench.audit.entries import read_audit
from torquebench.calibration import load_profile
from torquebench.campaign.checking import check_module
from torquebench.chain import Timebase
from torquebench.cli.chain_words import compensated
from torquebench.cli.options import CounterOptions
from torquebench.errors import ModelMismatchError
from torquebench.records import RunFolder
from torquebench.station import Station

OTHER = "ANOTHER-COUNTER/clock-7"


@pytest.fixture
def station(tmp_path: Path) -> Iterator[Station]:
    with Station.open(data_dir=tmp_path / "data") as opened:
        calibrated(opened, serial="SIM-T2000", counter=OTHER)
        yield opened


def test_it_is_refused_and_accepted_only_by_its_own_name(station: Station) -> None:
    with pytest.raises(ModelMismatchError, match=OTHER):
        station.activate_compensation("output")
    with pytest.raises(ModelMismatchError, match="SOMEBODY"):
        station.activate_compensation("output", Timebase("named", "SOMEBODY/else"))
    assert station.acquisition.compensation("output") is None
    active = station.activate_compensation("output", Timebase("named", OTHER))
    assert active.accepted == Timebase("named", OTHER, 100.0, zero_nm=4000.0)


def test_what_it_adds_is_in_the_uncertainty_and_in_the_record(station: Station) -> None:
    accepted = Timebase("named", OTHER, tolerance_ppm=200.0)
    station.activate_compensation("output", accepted)
    record = station.run(staircase(station.devices, [400.0]), kind="measure")
    row = record.result[0]
    added = 2e-4 * (4000.0 + abs(row["torque_nm"])) / np.sqrt(3.0)
    assert row["torque_uncertainty_nm"] >= added
    (summary,) = station.registry.runs()
    kept = RunFolder.open(summary.folder).metadata
    assert kept["compensation"]["output"]["accepted_counter"] == {
        "kind": "time base",
        "record": "named",
        "identity": OTHER,
        "tolerance_ppm": 200.0,
        "zero_nm": 4000.0,
    }
    assert kept["timebase_hz"] == 100e6


def test_a_model_of_the_present_counter_comes_first(station: Station) -> None:
    counter = station.drivers.counter.clock_identity
    calibrated(station, serial="SIM-T2000", counter=counter)
    active = station.activate_compensation("output", Timebase("named", OTHER))
    assert active.accepted is None


def test_measure_takes_the_option(tmp_path: Path) -> None:
    with Station.open(data_dir=tmp_path / "data") as opened:
        calibrated(opened, serial="SIM-T2000", counter=OTHER)
    refused = run("measure", "--count", 1, "--data", "data", cwd=tmp_path)
    assert "output: not compensated" in refused.stderr
    options = ("--accept-counter", OTHER, "--clock-tolerance", 50)
    taken = run("measure", "--count", 1, "--data", "data", *options, cwd=tmp_path)
    assert taken.returncode == 0, taken.stderr
    said = " ".join(taken.stderr.split())
    assert f"made with {OTHER}: 50 ppm added" in said
    assert "output: not in U, because no record exists:" in said
    assert "reference standard" in said
    assert "input: not in U" not in said  # it has no U


def test_a_check_is_refused_before_anything_moves(station: Station) -> None:
    with pytest.raises(ModelMismatchError, match=OTHER):
        check_module(station, "output", load_profile("check"), 0.1)
    assert station.registry.number_of_runs() == 0
    assert not list(audited(station))


def audited(station: Station) -> list[str]:
    return [line["command"] for line in read_audit(station.audit.path) if "command" in line]


def test_a_recorded_stretch_carries_what_the_other_counter_adds(station: Station) -> None:
    accepted = Timebase("named", OTHER, tolerance_ppm=200.0)
    active = station.activate_compensation("output", accepted)
    station.run(staircase(station.devices, [400.0]), kind="measure")
    stop_s = station.clock.now()
    found = active.window(stop_s - 0.1, stop_s)
    assert found is not None
    _, torque = found
    added = 2e-4 * (4000.0 + np.abs(torque.value_nm)) / np.sqrt(3.0)
    assert torque.component("time base") == pytest.approx(added)
    assert np.all(torque.standard_uncertainty_nm > added)


def test_commands_that_measure_say_whose_model_they_use(station: Station) -> None:
    assert compensated(station, "output").startswith("not compensated")
    said = compensated(station, "output", CounterOptions(OTHER, 50.0).accepted())
    assert f"made with {OTHER}: 50 ppm added" in said
    assert CounterOptions(None, 50.0).accepted() is None
