import asyncio
import contextlib
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Any

import bluesky.plan_stubs as bps
import bluesky.preprocessors as bpp
import pytest
from bluesky.utils import Msg
from tests.watching import Watching

from torquebench.bench.description import default_bench
from torquebench.bench.safety import AlarmKind
from torquebench.errors import BenchError, RecordError, TorquebenchError
from torquebench.records import Registry, RunFolder, RunWriter
from torquebench.station import Station

Plan = Generator[Msg, Any, Any]


@pytest.fixture
def station(tmp_path: Path) -> Iterator[Station]:
    with Station.open(data_dir=tmp_path) as opened:
        yield opened


def loaded_points(
    station: Station, at_point: Callable[[int], None], points: int = 6, cleaned: Any = None
) -> Plan:
    """Load the output, then take points; `at_point` is called with each before its checkpoint."""
    devices = station.devices

    def in_run() -> Plan:
        for number in range(points):
            at_point(number)
            yield from bps.checkpoint()
            yield from bps.mv(devices.output.drive.torque, 100.0 * (number + 1))
            yield from bps.trigger(devices.output.steady, wait=True)
            yield from bps.create(name="points")
            yield from bps.read(devices.output.steady)
            yield from bps.save()

    def clean_up() -> Plan:
        if cleaned is not None:
            cleaned.append(station.clock.now())
        yield from bps.null()

    yield from bps.mv(devices.mounting, "calibrator")
    yield from bps.mv(devices.clamp, True)
    yield from bps.mv(devices.input.mode, "locked")
    yield from bps.mv(devices.output.mode, "driven")
    yield from bps.mv(devices.output.drive.power, True)
    yield from bpp.finalize_wrapper(bpp.run_wrapper(in_run()), clean_up)
    return "complete"


def setpoint(station: Station) -> float | None:
    return station.drivers.drives["output"].state().torque_nm


def events(station: Station, run_id: str) -> int:
    folder = RunFolder.open(station.data_dir / "runs" / run_id)
    folder.verify()
    return len(list(folder.documents("event")))


def test_a_pause_is_held_at_a_point_without_torque_until_somebody_resumes(
    station: Station,
) -> None:
    seen: list[tuple[bool, float | None, int]] = []

    def resume_later() -> None:
        while not station.paused:
            time.sleep(0.01)
        seen.append((station.paused, setpoint(station), station.engine.pauses))
        station.resume()

    other = threading.Thread(target=resume_later)
    other.start()
    record = station.run(
        loaded_points(station, lambda number: station.pause() if number == 3 else None),
        kind="paused",
    )
    other.join()
    assert seen == [(True, 0.0, 1)]
    assert (record.exit_status, record.result, record.interruptions) == ("success", "complete", 1)
    assert events(station, record.run_id) == 6
    assert not station.paused


def test_whoever_runs_is_asked_how_to_go_on(station: Station) -> None:
    asked: list[str] = []

    def on_pause(paused: Station) -> Any:
        assert paused is station
        asked.append(threading.current_thread().name)
        return "resume" if len(asked) == 1 else "abort"

    record = station.run(
        loaded_points(station, lambda number: station.pause() if number in (1, 3) else None),
        kind="paused",
        on_pause=on_pause,
    )
    assert asked == [threading.current_thread().name] * 2
    assert record.exit_status == "abort"
    assert record.reason == "ended during a pause"
    assert record.result is None
    assert record.interruptions == 2
    assert events(station, record.run_id) == 3
    assert setpoint(station) == 0.0


def test_an_abort_from_another_thread_cleans_up_and_takes_the_torque_off(
    station: Station,
) -> None:
    cleaned: list[float] = []
    aborting: list[threading.Thread] = []

    def abort_at(number: int) -> None:
        if number == 2:
            aborting.append(threading.Thread(target=station.abort, args=("enough",)))
            aborting[0].start()

    record = station.run(
        loaded_points(station, abort_at, points=10**6, cleaned=cleaned), kind="aborted"
    )
    aborting[0].join()
    assert (record.exit_status, record.reason) == ("abort", "enough")
    assert len(cleaned) == 1
    assert setpoint(station) == 0.0
    assert not station.drivers.drives["output"].state().enabled
    assert station.registry.runs()[0].status == "aborted"
    assert events(station, record.run_id) >= 1
    again = station.run(loaded_points(station, lambda _: None, points=1), kind="again")
    assert again.exit_status == "success"


def test_an_abort_from_a_progress_callback_ends_the_run_that_reports(station: Station) -> None:
    cleaned: list[str] = []

    def reporting() -> Plan:
        yield from loaded_points(station, lambda _: None, points=1)
        for number in range(10):
            yield Msg("progress", None, number, 10, "points")
            yield from bps.sleep(0.1)

    def clean_up() -> Plan:
        cleaned.append("cleaned")
        yield from bps.null()

    def stop(done: int, _detail: str) -> None:
        if done == 2:
            station.abort("seen enough")
            with pytest.raises(BenchError, match="tried to close its bench"):
                station.close()

    record = station.run(
        bpp.finalize_wrapper(reporting(), clean_up), kind="reported", progress=Watching(stop)
    )
    assert (record.exit_status, record.reason) == ("abort", "seen enough")
    assert cleaned == ["cleaned"]
    assert setpoint(station) == 0.0
    assert not station.drivers.drives["output"].state().enabled
    again = station.run(loaded_points(station, lambda _: None, points=1), kind="again")
    assert again.exit_status == "success"


def test_an_abort_counts_where_what_is_awaited_swallows_its_cancellation(
    station: Station,
) -> None:
    waits = threading.Event()

    async def swallow(_message: Msg) -> None:
        """Do what `asyncio.wait_for` does when its answer comes in the moment of an abort."""
        waits.set()
        with contextlib.suppress(asyncio.CancelledError):
            await asyncio.sleep(30.0)

    station.engine.run_engine.register_command("swallow", swallow)
    cleaned: list[float] = []
    points: list[int] = []

    def plan() -> Plan:
        yield from bps.null()
        yield Msg("swallow")
        return (yield from loaded_points(station, points.append, cleaned=cleaned))

    def abort() -> None:
        waits.wait()
        station.abort("enough")

    thread = threading.Thread(target=abort)
    thread.start()
    record = station.run(plan(), kind="test")
    thread.join()
    assert record.exit_status == "abort"
    assert points == cleaned == []
    record = station.run(loaded_points(station, points.append, 1, cleaned), kind="test")
    assert (record.exit_status, points, len(cleaned)) == ("success", [0], 1)


def test_nothing_is_left_of_an_abort_without_a_run(station: Station) -> None:
    station.abort("nothing to abort")
    station.resume()
    record = station.run(loaded_points(station, lambda _: None, points=1), kind="after")
    assert record.exit_status == "success"


def test_blueskys_own_pause_ends_the_run_with_a_reason(station: Station) -> None:
    def plan() -> Plan:
        yield from bps.checkpoint()
        yield from bps.pause()

    record = station.run(plan(), kind="bluesky-pause")
    assert record.exit_status == "abort"
    assert "Station.pause" in record.reason


def test_a_stop_from_any_thread_latches_and_fails_the_run(station: Station) -> None:
    stops: list[threading.Thread] = []

    def stop_at(number: int) -> None:
        if number == 2:
            stops.append(threading.Thread(target=station.emergency_stop, args=("smoke",)))
            stops[0].start()
            stops[0].join()

    with pytest.raises(BenchError, match="smoke"):
        station.run(loaded_points(station, stop_at), kind="stopped")
    assert station.supervisor.wait_safe(60.0)
    assert setpoint(station) == 0.0
    assert station.registry.runs()[0].status == "failed"
    alarm = station.acknowledge_alarm("A. Tester")
    assert alarm is not None
    assert alarm.kind is AlarmKind.STOP


@pytest.mark.parametrize("method", ["samples", "document"])
def test_a_record_that_cannot_be_kept_brings_the_bench_to_its_safe_state(
    station: Station, monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    original = getattr(RunWriter, method)
    full = threading.Event()

    def write(writer: RunWriter, *args: Any) -> Any:
        if full.is_set():
            raise OSError(28, "No space left on device")
        return original(writer, *args)

    monkeypatch.setattr(RunWriter, method, write)
    with pytest.raises((RecordError, OSError), match="No space left"):
        station.run(
            loaded_points(station, lambda number: full.set() if number == 2 else None),
            kind="full-disk",
        )
    assert station.supervisor.wait_safe(60.0)
    assert setpoint(station) == 0.0
    assert station.supervisor.alarm is not None
    assert station.supervisor.alarm.kind is AlarmKind.JOURNAL
    assert station.registry.runs()[0].status == "failed"


def test_the_torque_goes_off_while_the_event_loop_hangs(tmp_path: Path) -> None:
    bench = default_bench()
    safety = bench.safety.model_copy(update={"stall_s": 60.0})  # not what is looked for here
    with Station.open(
        bench.model_copy(update={"safety": safety}), tmp_path, real_time=True
    ) as station:
        meanwhile: list[tuple[AlarmKind, float | None]] = []

        def hang(number: int) -> None:
            if number == 1:
                deadline = time.monotonic() + 120.0
                while station.supervisor.alarm is None and time.monotonic() < deadline:
                    time.sleep(0.05)
                station.supervisor.wait_safe(60.0)
                alarm = station.supervisor.alarm
                assert alarm is not None
                meanwhile.append((alarm.kind, setpoint(station)))

        with pytest.raises(TorquebenchError, match="no heartbeat of the run engine"):
            station.run(loaded_points(station, hang), kind="hanging")
        assert meanwhile == [(AlarmKind.HEARTBEAT, 0.0)]


SCRIPT = """
import sys, threading
import bluesky.plan_stubs as bps
from bluesky.utils import Msg
from torquebench.station import Station

with Station.open(None, sys.argv[1]) as station:
    station.interrupt_action = sys.argv[2]
    devices = station.devices

    def plan():
        yield from bps.mv(devices.mounting, "calibrator")
        yield from bps.mv(devices.clamp, True)
        yield from bps.mv(devices.input.mode, "locked")
        yield from bps.mv(devices.output.mode, "driven")
        yield from bps.mv(devices.output.drive.power, True)
        while True:
            yield from bps.checkpoint()
            yield from bps.mv(devices.output.drive.torque, 300.0)
            yield from bps.sleep(0.5)
            print("loaded", flush=True)

    def asked(station):
        print("paused", station.drivers.drives["output"].state().torque_nm, flush=True)
        return "abort"

    record = station.run(plan(), kind="interrupted", on_pause=asked)
    state = station.drivers.drives["output"].state()
    print("end", record.exit_status, record.reason, state.torque_nm, state.enabled, flush=True)
"""


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("action", "expected"),
    [
        ("abort", ["end abort interrupted from the keyboard 0.0 False"]),
        ("pause", ["paused 0.0", "end abort ended during a pause 0.0 False"]),
    ],
)
def test_ctrl_c_ends_or_pauses_with_the_bench_at_rest(
    tmp_path: Path, action: str, expected: list[str]
) -> None:
    process = subprocess.Popen(
        [sys.executable, "-W", "error", "-c", textwrap.dedent(SCRIPT), str(tmp_path), action],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": ""},
    )
    assert process.stdout is not None
    for line in process.stdout:
        if line.startswith("loaded"):
            break
    process.send_signal(signal.SIGINT)
    rest, problems = process.communicate(timeout=240)
    said = [line for line in rest.splitlines() if line.startswith(("paused", "end"))]
    assert said == expected, problems
    assert process.returncode == 0
    assert "Traceback" not in problems
    with Registry.open(tmp_path) as registry:
        assert registry.runs()[0].status == "aborted"
