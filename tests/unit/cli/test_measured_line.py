"""The live line of `measure`."""

from pathlib import Path

from torquebench.cli.measure import measured_interval
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


def test_a_lost_signal_is_named_and_no_number(tmp_path: Path) -> None:
    with Station.open(None, tmp_path) as station:
        station.drivers.counter.twin.inject_fault("output_torque", "silent", duration_s=10.0)
        station.clock.wait(0.2)
        line = measured_interval(station, blocks_of(station, 3)).line()
    assert len(line) <= 80
    assert "out" in line
    assert "pulses" in line
    assert line.count("raw") == 1
