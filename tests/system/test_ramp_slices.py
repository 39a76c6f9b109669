"""Where time is real, a drive is never commanded further ahead than a slice of its ramp."""

import threading
from collections.abc import Generator
from pathlib import Path
from typing import Any

import bluesky.plan_stubs as bps
import pytest
from bluesky.utils import Msg

from torquebench.bench import default_bench
from torquebench.bench.acquisition import COOLING_S
from torquebench.bench.blocks import Block
from torquebench.bench.devices import RampTo
from torquebench.bench.devices.drive import SHORTEST_SLICE_S, slice_s
from torquebench.bench.drivers.simulated.driver import DriveEvent, SimulatedDrive
from torquebench.station import Station

Plan = Generator[Msg, Any, Any]
RATE = 500.0
PATIENT = {"stall_s": 60.0}


def set_up(station: Station) -> Plan:
    devices = station.devices
    yield from bps.mv(devices.mounting, "calibrator")
    yield from bps.mv(devices.clamp, True)
    yield from bps.mv(devices.input.mode, "locked")
    yield from bps.mv(devices.output.mode, "driven")
    yield from bps.mv(devices.output.drive.power, True)


def opened(folder: Path) -> Station:
    description = default_bench()
    safety = description.safety.model_copy(update=PATIENT)
    drive = description.output.drive.model_copy(update={"watchdog_s": 10.0})
    output = description.output.model_copy(update={"drive": drive})
    described = description.model_copy(update={"safety": safety, "output": output})
    return Station.open(described, folder, real_time=True)


def events_of(station: Station) -> list[DriveEvent]:
    drive: Any = station.drivers.drives["output"]
    while not isinstance(drive, SimulatedDrive):
        drive = drive.drive
    return list(drive.log)


def test_a_lost_computer_adds_at_most_a_slice(tmp_path: Path) -> None:
    def loading() -> Plan:
        yield from set_up(station)
        yield from bps.mv(station.devices.output.drive.torque, RampTo(900.0, RATE))
        yield from bps.mv(station.devices.output.drive.torque, RampTo(-300.0, RATE))
        yield from bps.mv(station.devices.output.drive.power, False)

    with opened(tmp_path) as station:
        module = station.description.output
        block_s = 1.02 * station.description.counter.block_s
        ahead_nm = RATE * slice_s(module, "torque", RATE)
        assert ahead_nm <= 0.1 * module.range_nm + 1e-9
        station.run(loading(), kind="loaded")
        assert station.supervisor.history == ()
        told = [each for each in events_of(station) if each.event.startswith("torque to")]
    targets = [float(each.event.removeprefix("torque to ")) for each in told]
    assert 900.0 in targets
    assert -300.0 in targets
    for event, target in zip(told, targets, strict=True):
        # the simulated drive is up to a block of samples behind the wall's time
        assert abs(target - event.torque_nm) <= ahead_nm + RATE * block_s


def test_a_stop_within_a_ramp_is_the_last_command(tmp_path: Path) -> None:
    def loading() -> Plan:
        yield from set_up(station)
        torque = station.devices.output.drive.torque
        yield from bps.abs_set(torque, RampTo(900.0, 100.0), group="ramp")
        yield from bps.sleep(2.0)
        unload = threading.Thread(target=station.supervisor.unload, args=(("output",),))
        unload.start()
        unload.join()
        yield from bps.sleep(3.0)
        loaded.append(station.acquisition.reading_nm("output_torque"))

    loaded: list[float] = []
    with opened(tmp_path) as station:
        station.run(loading(), kind="loaded")
        events = [each.event for each in events_of(station)]
        limit_nm = station.description.unloaded_nm("output")
    zero = next(k for k, event in enumerate(events) if event.startswith("to zero"))
    assert not any(event.startswith("torque to") for event in events[zero:]), events
    assert abs(loaded[0]) <= limit_nm


def test_signals_are_checked_often_before_a_drive_has_power_and_until_it_is_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lengths: list[float] = []
    marks: dict[str, int] = {}

    def using(station: Station) -> Plan:
        power = station.devices.output.drive.power
        yield from bps.sleep(0.3)
        marks["rest"] = len(lengths)
        yield from set_up(station)
        yield from bps.sleep(0.2)
        yield from bps.mv(power, False)
        marks["off"] = len(lengths)
        yield from bps.sleep(COOLING_S + 0.3)

    with opened(tmp_path) as station:
        counter, drive = station.drivers.counter, station.drivers.drives["output"]
        read_block, enable = counter.read_block, drive.enable

        def reading(duration_s: float) -> Block:
            lengths.append(round(duration_s, 6))
            return read_block(duration_s)

        def enabling() -> None:
            marks["power"] = len(lengths)
            enable()

        monkeypatch.setattr(counter, "read_block", reading)
        monkeypatch.setattr(drive, "enable", enabling)
        station.run(using(station), kind="loaded")
        block_s = station.description.counter.block_s
        check_s = station.description.safety.fast_check_s
    assert set(lengths[: marks["rest"]]) == {block_s}
    assert set(lengths[marks["power"] - 1 : marks["off"]]) == {check_s}
    assert lengths[-1] == block_s


@pytest.mark.parametrize("rate", [1.0, 1e3, 1e6])
def test_a_slice_is_within_the_watchdog(rate: float) -> None:
    module = default_bench().output
    for quantity in ("torque", "speed"):
        assert SHORTEST_SLICE_S <= slice_s(module, quantity, rate) <= module.drive.watchdog_s
