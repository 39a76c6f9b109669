import json
import textwrap
from pathlib import Path

import pytest
from tests.support.draws import nightly
from tests.system.command_line import run_python

from torquebench.records import RunFolder

# The largest file that the child may write stands for the room that a disk has left: like a full
# disk it takes a part of what is written and then refuses, and it needs no rights.
SCRIPT = """
    import json, resource, sys
    from pathlib import Path
    import bluesky.plan_stubs as bps
    import bluesky.preprocessors as bpp
    from torquebench.bench.description import BenchDescription, default_bench
    from torquebench.errors import TorquebenchError
    from torquebench.station import Station

    changed = default_bench().model_dump() | {"recording": {"edges": True}}
    description = BenchDescription.model_validate(changed)

    def plan(devices):
        yield from bps.mv(devices.mounting, "calibrator")
        yield from bps.mv(devices.clamp, True)
        yield from bps.mv(devices.input.mode, "locked")
        yield from bps.mv(devices.output.mode, "driven")
        yield from bps.mv(devices.output.drive.power, True)
        yield from bps.mv(devices.output.drive.torque, 500.0)
        recorded = next(Path(sys.argv[1], "runs").iterdir()) / "edges.arrow"
        while not (recorded.exists() and recorded.stat().st_size > 1000):
            yield from bps.sleep(0.5)
        registry = Path(sys.argv[1], "registry.sqlite")
        room = max(recorded.stat().st_size, registry.stat().st_size) + 100_000
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, resource.RLIM_INFINITY))
        yield from bps.sleep(600.0)

    with Station.open(description, sys.argv[1], real_time=sys.argv[2] == "real") as station:
        try:
            station.run(bpp.run_wrapper(plan(station.devices)), kind="full-disk")
        except TorquebenchError as error:
            message = str(error)
        safe = station.supervisor.wait_safe(100.0)
        state = station.drivers.drives["output"].state()
        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)
        alarm = station.supervisor.alarm.kind.value
        folder = max(Path(sys.argv[1], "runs").iterdir())
        print(json.dumps([message, safe, state.enabled, state.torque_nm, alarm, str(folder)]))
"""


TRIES = 4
STARVED = ("acquisition stalled", "heartbeat missing", "drive fault")
"""Alarms that a computer gives in real time which is taken away for longer than they allow."""


def filled(data: Path, pace: str) -> tuple[str, bool, bool, float, str, str]:
    child = run_python(textwrap.dedent(SCRIPT), data, pace, cwd=data.parent)
    assert child.returncode == 0, child.stderr
    found: tuple[str, bool, bool, float, str, str] = tuple(
        json.loads(child.stdout.splitlines()[-1])
    )
    return found


@pytest.mark.timeout(2400)
@pytest.mark.parametrize("pace", ["fast", nightly("real")])
def test_a_full_disk_is_an_alarm_and_a_safe_stop_without_a_gap(tmp_path: Path, pace: str) -> None:
    for attempt in range(TRIES if pace == "real" else 1):
        message, safe, enabled, torque_nm, alarm, folder = filled(tmp_path / str(attempt), pace)
        assert (safe, enabled, torque_nm) == (True, False, 0.0)
        if alarm not in STARVED:  # else a busy computer has stopped it before its disk was full
            break
    assert "can't be written" in message
    assert "make room on the disk" in message
    assert (safe, enabled, torque_nm, alarm) == (True, False, 0.0, "journal failed")
    run = RunFolder.open(Path(folder))
    if not run.sealed:  # nor was there room for the sealed files
        run.recover()
    run.verify()
    assert run.manifest["status"] in ("failed", "interrupted")
    borders: dict[str, int] = {}
    for each in run.edges():
        if each.channel in ("input_torque", "output_torque"):
            assert each.block.start_tick == borders.get(each.channel, each.block.start_tick)
            borders[each.channel] = each.block.stop_tick
    assert len(borders) == 2
    times = run.raw().columns["time_s"]
    assert (times[1:] - times[:-1]).max() == pytest.approx(0.01)
