"""What drives were told and what the audit log says agree, whatever is between them."""

from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any

import bluesky.plan_stubs as bps
import bluesky.preprocessors as bpp
import pytest
from bluesky.utils import Msg
from tests.system.networked import canopen, described, modbus

from torquebench.bench.audit.entries import AUDIT_FOLDER, read_audit
from torquebench.bench.description import BenchDescription, default_bench
from torquebench.bench.drivers.simulated.driver import SimulatedDrive
from torquebench.bench.roles import SIDES
from torquebench.errors import BenchError
from torquebench.simulators import Simulators
from torquebench.station import Station

Event = tuple[str, str, float]
"""Side, what it was told, and how much; every way to stop is a stop."""
MOVES = {"command_torque": "torque", "command_speed": "speed"}
STOPS = ("disable", "ramp_to_zero")


class Received:
    """What the motors' own drives were told, behind every protocol."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.events: list[Event] = []
        for name in ("enable", *MOVES, *STOPS):
            monkeypatch.setattr(SimulatedDrive, name, self._noting(name))

    def _noting(self, name: str) -> Any:
        original = getattr(SimulatedDrive, name)

        def told(drive: SimulatedDrive, *values: float) -> None:
            self.events.append(event(drive._side, name, values[0] if name in MOVES else 0.0))
            original(drive, *values)

        return told


def event(side: str, name: str, value: float) -> Event:
    if name in STOPS or (name in MOVES and value == 0.0):
        return side, "stop", 0.0
    return side, MOVES.get(name, name), value


def of(side: str, events: list[Event]) -> list[Event]:
    """Return a side's events; stops that follow each other, or come first, say nothing new."""
    kept: list[Event] = [(side, "stop", 0.0)]
    for each in events:
        if each[0] == side and not (each[1] == kept[-1][1] == "stop"):
            kept.append(each)
    return kept


def audited_events(data: Path) -> list[Event]:
    return [
        event(line["side"], line["command"], line.get("torque_nm", line.get("speed_rad_s", 0.0)))
        for line in read_audit(data / AUDIT_FOLDER)
        if line.get("instrument") == "drive" and line["event"] == "command"
    ]


@pytest.fixture(params=["simulated", "modbus and canopen"])
def station(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[tuple[Station, Received]]:
    if request.param == "simulated":
        received = Received(monkeypatch)
        with Station.open(default_bench(), tmp_path) as opened:
            yield opened, received
        return
    with Simulators(patient()) as simulators:
        received = Received(monkeypatch)
        with Station.open(simulators.description, tmp_path) as opened:
            yield opened, received


def patient() -> BenchDescription:
    """Describe the bench on its wires with time for a busy computer: nothing fails here."""
    answering = {"timeout_s": 3.0}
    description = described(input_drive=modbus(**answering), output_drive=canopen() | answering)
    modules = {
        side: description.module(side).model_copy(
            update={"drive": description.module(side).drive.model_copy(update={"watchdog_s": 20.0})}
        )
        for side in SIDES
    }
    return description.model_copy(update=modules)


def driving(station: Station, end: Any) -> Generator[Msg, Any, None]:
    """Load one side after the other, turn, then end in one way or another."""
    devices = station.devices
    yield from bps.mv(devices.mounting, "calibrator")
    yield from bps.mv(devices.clamp, True)
    for driven, locked, torques in (
        (devices.output, devices.input, (300.0, -150.0)),
        (devices.input, devices.output, (12.0, 20.0)),
    ):
        yield from bps.mv(locked.mode, "locked")
        yield from bps.mv(driven.mode, "driven")
        yield from bps.mv(driven.drive.power, True)
        for torque_nm in torques:
            yield from bps.mv(driven.drive.torque, torque_nm)
        if driven is devices.input:
            end()
            yield from bps.sleep(1.0)
        yield from bps.mv(driven.drive.torque, 0.0)
        yield from bps.sleep(0.5)
        yield from bps.mv(driven.drive.power, False)


def test_every_command_to_a_drive_is_in_the_log(station: tuple[Station, Received]) -> None:
    bench, received = station

    def run(end: Any) -> None:
        bench.run(bpp.run_wrapper(driving(bench, end)), kind="audited")

    run(lambda: None)
    with pytest.raises(BenchError, match="smoke"):
        run(lambda: bench.emergency_stop("smoke"))
    assert bench.supervisor.wait_safe(60.0)
    bench.acknowledge_alarm("A. Tester")
    run(lambda: bench.abort("enough"))
    logged = audited_events(bench.data_dir)
    for side in SIDES:
        told = of(side, received.events)
        said = of(side, logged)
        assert [each[:2] for each in told] == [each[:2] for each in said]
        assert [each[2] for each in told] == pytest.approx(
            [each[2] for each in said], rel=1e-3, abs=0.1
        )
        assert len([each for each in told if each[1] == "torque"]) >= 6
    assert received.events[-1][1] == "stop"
