"""The live line of `measure`."""

from pathlib import Path

import numpy as np

from torquebench.bench.active_chain import ActiveChain
from torquebench.chain import MeasuredTemperature, MeasuringChain
from torquebench.cli.measure import MeasuredSide, measured_interval
from torquebench.compensation import make_model
from torquebench.station import Station


def blocks_of(station: Station, count: int) -> list:
    viewer = station.acquisition.add_viewer()
    station.clock.wait(count * station.description.counter.block_s)
    return [viewer.get() for _ in range(count)]


def test_an_uncompensated_line_says_so(tmp_path: Path) -> None:
    with Station.open(None, tmp_path) as station:
        line = measured_interval(station, blocks_of(station, 3)).line()
    assert len(line) <= 80
    assert line.count("raw") == 2
    assert "±" not in line
    assert "rpm" in line
    assert "°C" in line


def test_an_unloaded_chain_reads_no_negative_zero() -> None:
    assert MeasuredSide(-0.0004, None, "raw").text(7, 3).strip() == "0.000 raw"
    assert MeasuredSide(-0.0004, 0.01, "compensated").text(7, 2).split() == ["0.00", "±", "0.01"]


def test_a_lost_signal_is_named_and_no_number(tmp_path: Path) -> None:
    with Station.open(None, tmp_path) as station:
        station.drivers.counter.twin.inject_fault("output_torque", "silent", duration_s=10.0)
        station.clock.wait(0.2)
        line = measured_interval(station, blocks_of(station, 3)).line()
    assert len(line) <= 80
    assert "out" in line
    assert "pulses" in line
    assert line.count("raw") == 1


def test_a_refused_torque_names_the_effect_and_its_range(tmp_path: Path) -> None:
    standard = np.linspace(-2000.0, 2000.0, 21)
    model = make_model("polynomial-1", range_nm=2000.0).fit(standard[:, None], standard)
    warm = MeasuredTemperature("runs", 45.0, 40.0, 50.0, (40.0, 50.0), (0.0, 0.0), (0.1, 0.1))
    with Station.open(None, tmp_path) as station:
        active = ActiveChain(MeasuringChain(model, (warm,)), "1", "polynomial-1")
        station.acquisition.set_compensation("output", active)
        measured = measured_interval(station, blocks_of(station, 3))
    assert len(measured.line()) <= 80
    assert (measured.output.state, measured.input.detail) == ("beyond range", "")
    assert measured.output.detail.startswith("output module: temperature of zero and span, ")
    assert measured.output.detail.endswith("allowed 40 to 50 °C")
