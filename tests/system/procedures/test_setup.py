"""What procedures leave and find when they change the bench's state."""

import bluesky.plan_stubs as bps
import pytest

from torquebench.bench.interlocks import check_unloaded
from torquebench.errors import InterlockError
from torquebench.procedures.messages import move
from torquebench.procedures.setup import Plan, Setup, power_on, set_mode, set_up
from torquebench.station import Station


def test_a_mode_is_changed_once_a_shaft_without_power_has_run_down(station: Station) -> None:
    devices = station.devices
    drive = devices.input.drive

    def plan() -> Plan[None]:
        yield from set_up(devices, Setup("reducer_test", "input", "reducer", "free"))
        yield from power_on(devices, "input")
        yield from move(drive.torque, 0.5)
        yield from bps.sleep(0.5)
        yield from move(drive.torque, 0.0)
        yield from bps.mv(drive.power, False)
        with pytest.raises(InterlockError, match="turns"):
            check_unloaded(devices.context.state, "input", "change the mode")
        yield from set_mode(devices, "input", "free")

    station.run(plan(), kind="test")
    assert station.drivers.modes.mode("input") == "free"
