import json
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from torquebench.records import RunFolder

# The largest file that the child may write stands for the room that a disk has left: like a full
# disk it takes a part of what is written and then refuses, and it needs no rights.
SCRIPT = """
    import json, resource, sys
    from pathlib import Path
    import bluesky.plan_stubs as bps
    import bluesky.preprocessors as bpp
    from torquebench.bench.description import BenchDescription, default_bench
    from torquebench.errors import RecordError
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
        except RecordError as error:
            message = str(error)
        safe = station.supervisor.wait_safe(10.0)
        state = station.drivers.drives["output"].state()
        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)
        alarm = station.supervisor.alarm.kind.value
        folder = max(Path(sys.argv[1], "runs").iterdir())
        print(json.dumps([message, safe, state.enabled, state.torque_nm, alarm, str(folder)]))
"""


@pytest.mark.parametrize("pace", ["fast", "real"])
def test_a_full_disk_is_an_alarm_and_a_safe_stop_without_a_gap(tmp_path: Path, pace: str) -> None:
    child = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(SCRIPT), str(tmp_path), pace],
        capture_output=True,
        text=True,
        check=False,
        timeout=200,
    )
    assert child.returncode == 0, child.stderr
    message, safe, enabled, torque_nm, alarm, folder = json.loads(child.stdout.splitlines()[-1])
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
