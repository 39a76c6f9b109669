"""A bench's process is killed or stopped: the drive goes no further than stated."""

import os
import re
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from tests.system.command_line import started, wait_until
from tests.system.networked import simulating
from tests.system.panel_api import SLOW, administrator, serving

from torquebench.bench.description import BenchDescription, load_bench
from torquebench.bench.devices.drive import slice_s
from torquebench.bench.drivers.simulated.control import SimulationControl
from torquebench.operations.bench_checks import _losses

pytestmark = SLOW
RATE = 500.0
STOPPED_S = 10.0
TRIES = 5
LOADING = """
import sys
import bluesky.plan_stubs as bps
from pathlib import Path
from tests.system.test_station_runs import set_up
from torquebench.bench.devices import RampTo
from torquebench.station import Station

def loading(station):
    torque = station.devices.output.drive.torque
    yield from set_up(station.devices)
    yield from bps.mv(torque, 700.0)
    print("loaded", flush=True)
    yield from bps.mv(torque, RampTo(2000.0, float(sys.argv[3])))

with Station.open(Path(sys.argv[1]), Path(sys.argv[2])) as station:
    station.run(loading(station), kind="loaded")
"""


@contextmanager
def ramping(folder: Path, bench: Path, control: SimulationControl) -> Iterator[Any]:
    """Start a process that loads to 700 N·m and goes on to 2000; yield it beyond 900 N·m."""
    with started(LOADING, bench, folder / "data", RATE, cwd=folder, python=True) as process:
        assert process.stdout is not None
        assert any(line.strip() == "loaded" for line in process.stdout)
        wait_until(lambda: output(control)["torque_nm"] > 900.0, "the ramp")
        yield process


def output(control: SimulationControl) -> dict[str, Any]:
    drive: dict[str, Any] = control.ask("status")["drives"]["output"]
    return drive


def stated_nm(description: BenchDescription) -> float:
    """Return the torque that `doctor` states for a loss of computer or cable."""
    (found,) = (each.found for each in _losses(description) if each.what == "output loss")
    return float(re.findall(r"adds at most ([\d.]+) N·m", found)[0])


@pytest.mark.nightly
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_a_ramp_goes_no_further_than_stated(tmp_path: Path, how: signal.Signals) -> None:
    with (
        simulating(tmp_path, "--real-time") as (bench, control),
        ramping(tmp_path, bench, control) as process,
    ):
        description = load_bench(bench)
        looked = time.monotonic()
        torque_nm = output(control)["torque_nm"]
        process.send_signal(how)
        unsure_s = time.monotonic() - looked  # the ramp went on while it was read and signalled
        largest_nm, on = torque_nm, True
        while on:
            drive = output(control)
            largest_nm, on = max(largest_nm, drive["torque_nm"]), drive["enabled"]
            time.sleep(0.02)
        fault = control.ask("status")["drives"]["output"]["fault"]
    added_nm = largest_nm - torque_nm
    module = description.output
    block_nm = RATE * (unsure_s + 2.0 * description.counter.block_s)
    assert added_nm <= RATE * slice_s(module, "torque", RATE) + block_nm
    assert added_nm <= RATE * module.drive.watchdog_s + block_nm
    assert added_nm <= stated_nm(description) + block_nm
    assert largest_nm < 1900.0, "it went on to the end of the ramp"
    assert "watchdog" in fault, "the drive itself has ended it"


@pytest.mark.nightly
def test_a_panel_that_was_stopped_catches_up_and_turns_a_reducer(tmp_path: Path) -> None:
    with (
        simulating(tmp_path, "--real-time") as (bench, _),
        serving(tmp_path, "--bench", str(bench)) as server,
        administrator(server) as admin,
    ):

        def sample_s() -> float:
            return float(admin.get("/bench").json()["bench_time_s"])

        def late(active: bool) -> list[str]:
            alarms = admin.get("/alarms", params={"active": active}).json()
            return [each["found"] for each in alarms if "newest samples are" in each["found"]]

        wait_until(lambda: sample_s() > 1.0, "samples")
        before_s, began = sample_s(), time.monotonic()
        os.kill(server.process.pid, signal.SIGSTOP)
        time.sleep(STOPPED_S)
        os.kill(server.process.pid, signal.SIGCONT)
        wait_until(lambda: bool(late(False)), "the warning")
        wait_until(lambda: sample_s() - before_s > time.monotonic() - began - 1.0, "the present")
        wait_until(lambda: not late(True), "the end of the warning")
        seconds = max(float(re.findall(r"([\d.]+) s old", each)[0]) for each in late(False))
        assert seconds > 1.0
        asked = {"test": "transmission-error", "reducer": "standard", "serial": "S", "short": True}
        for _ in range(TRIES):  # a busy computer may stand again, which is another alarm
            started = admin.post("/operations/test", json=asked)
            assert started.status_code == 202, started.text
            number = started.json()["job_id"]

            def view(number: str = number) -> dict[str, Any]:
                answer: dict[str, Any] = admin.get(f"/jobs/{number}").json()
                return answer

            wait_until(lambda view=view: bool(view()["finished"]), "the test")
            if view()["state"] == "done":
                return
            assert "newest samples are" in str(view()["problem"]), view()["problem"]
            wait_until(lambda: not late(True), "the end of the warning")
            wait_until(
                lambda: admin.post("/alarms/acknowledge").status_code == 200, "acknowledgement"
            )
        raise AssertionError("the computer was too busy for a turning test")
