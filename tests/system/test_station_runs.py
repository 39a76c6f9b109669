import contextlib
import json
import sqlite3
import time
from collections.abc import Callable, Generator, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import bluesky.plan_stubs as bps
import bluesky.preprocessors as bpp
import numpy as np
import pytest
from bluesky.utils import Msg
from tests.watching import Watching

from torquebench.bench import default_bench
from torquebench.bench.devices import BenchDevices, Point, SteadySettings
from torquebench.bench.interlocks import standard_serial
from torquebench.calibration import CalibrationData, load_profile
from torquebench.campaign.checking import check_module
from torquebench.chain import Readings, load_chain
from torquebench.compensation import Provenance, StoredModel, make_model, save_model
from torquebench.errors import (
    BenchError,
    InputError,
    InterlockError,
    ModelMismatchError,
    RecordError,
    SignalFault,
)
from torquebench.records import CalibrationEntry, RunFolder
from torquebench.station import Station, data_directory

Plan = Generator[Msg, Any, Any]


@pytest.fixture
def station(tmp_path: Path) -> Iterator[Station]:
    with Station.open(data_dir=tmp_path) as opened:
        yield opened


def set_up(devices: BenchDevices) -> Plan:
    yield from bps.mv(devices.mounting, "calibrator")
    yield from bps.mv(devices.clamp, True)
    yield from bps.mv(devices.input.mode, "locked")
    yield from bps.mv(devices.output.mode, "driven")
    yield from bps.mv(devices.output.drive.power, True)


def steps(devices: BenchDevices, torques: list[float], rows: list[dict[str, Any]]) -> Plan:
    """Take the steady torque at each step."""
    steady = devices.output.steady
    yield from bps.prepare(steady, SteadySettings(reference=True), wait=True)
    for number, torque in enumerate(torques):
        yield Msg("progress", None, number, len(torques), f"{torque:g} N·m")
        yield from bps.checkpoint()
        yield from bps.mv(devices.point, Point(step=number, nominal_nm=torque))
        yield from bps.mv(devices.output.drive.torque, torque)
        yield from bps.trigger(steady, wait=True)
        yield from bps.create(name="points")
        reading = yield from bps.read(steady)
        yield from bps.read(devices.point)
        yield from bps.save()
        prefix = steady.key("")
        rows.append({key.removeprefix(prefix): r["value"] for key, r in reading.items()})


def staircase(devices: BenchDevices, torques: list[float]) -> Plan:
    rows: list[dict[str, Any]] = []
    yield from set_up(devices)
    yield from bpp.run_wrapper(steps(devices, torques, rows), md={"plan_name": "staircase"})
    return rows


def torque_off(station: Station) -> bool:
    return all(drive.state().torque_nm == 0.0 for drive in station.drivers.drives.values())


def test_a_run_leaves_its_result_its_documents_its_samples_and_a_seal(station: Station) -> None:
    watching = Watching()
    record = station.run(
        staircase(station.devices, [0.0, 200.0, 400.0]),
        kind="calibrate-output",
        metadata={"operator": "A. Tester", "side": "output"},
        progress=watching,
    )
    assert record.exit_status == "success"
    assert [row["commanded_nm"] for row in record.result] == [0.0, 200.0, 400.0]
    assert watching.done == [0, 1, 2]
    assert record.bench_seconds == pytest.approx(1.8, abs=0.2)
    assert torque_off(station)

    folder = RunFolder.open(record.folder)
    folder.verify()
    assert folder.manifest["status"] == "completed"
    assert folder.metadata["operator"] == "A. Tester"
    assert folder.metadata["simulated"] is True
    assert folder.metadata["counter_identity"] == "SIM-COUNTER-1/oscillator-1"
    names = [name for name, _ in folder.documents()]
    assert names == ["start", "descriptor", "event", "event", "event", "stop"]
    (_, descriptor), *_ = folder.documents("descriptor")
    assert descriptor["data_keys"]["output-steady-standard_nm"]["units"] == "N·m"
    events = [document["data"] for _, document in folder.documents("event")]
    assert [event["point-nominal_nm"] for event in events] == [0.0, 200.0, 400.0]
    assert events[1]["output-steady-reading_nm"] == record.result[1]["reading_nm"]

    raw = folder.raw()
    assert raw.rows == pytest.approx(record.bench_seconds * 100, abs=25)
    assert np.all(np.diff(raw.columns["time_s"]) > 0)
    assert not raw.columns["output_torque_fault"].any()
    assert set(np.unique(raw.columns["input_reference_fault"])) <= {0, 255}
    last = raw.columns["output_reference_hz"][raw.columns["output_reference_fault"] == 0][-40:]
    assert last.mean() > 60_000 + 15 * 100

    (summary,) = station.registry.runs()
    assert (summary.run_id, summary.status) == (record.run_id, "completed")
    assert summary.operator == "A. Tester"
    kinds = {each.kind for each in station.registry.equipment()}
    assert kinds >= {"transducer", "counter", "calibrator", "verification-standard"}


def test_the_same_seed_gives_the_same_readings(tmp_path: Path) -> None:
    def readings(name: str) -> Any:
        with Station.open(data_dir=tmp_path / name) as station:
            result = station.run(staircase(station.devices, [0.0, 300.0, -50.0]), kind="x").result
        return [(row["reading_nm"], row["standard_nm"], row["true_torque_nm"]) for row in result]

    assert readings("first") == readings("again")


def test_a_plan_sleeps_in_bench_time(station: Station) -> None:
    def plan() -> Plan:
        yield from bps.sleep(60.0)
        return "slept"

    record = station.run(plan(), kind="wait")
    assert record.result == "slept"
    assert record.bench_seconds == pytest.approx(60.0, abs=0.06)


def test_runs_follow_each_other_on_one_station(station: Station) -> None:
    first = station.run(staircase(station.devices, [100.0]), kind="first")
    second = station.run(staircase(station.devices, [100.0]), kind="second")
    assert first.run_id != second.run_id
    assert [run.kind for run in station.registry.runs()] == ["second", "first"]


def test_a_refused_command_fails_the_run_with_the_bench_at_rest(station: Station) -> None:
    def plan() -> Plan:
        yield from set_up(station.devices)
        yield from bps.mv(station.devices.output.drive.torque, 500.0)
        yield from bps.mv(station.devices.output.mode, "free")

    with pytest.raises(InterlockError, match="500 N·m"):
        station.run(plan(), kind="refused")
    assert torque_off(station)
    (summary,) = station.registry.runs()
    assert summary.status == "failed"
    assert "500 N·m" in summary.reason
    RunFolder.open(summary.folder).verify()
    assert station.supervisor.alarm is None


def test_an_error_of_a_plan_comes_through_as_it_is(station: Station) -> None:
    def plan() -> Plan:
        yield from bps.null()
        raise InputError("too few points")

    with pytest.raises(InputError, match="too few points"):
        station.run(plan(), kind="wrong")


def test_a_result_that_cannot_be_kept_fails_the_run(station: Station) -> None:
    def plan() -> Plan:
        yield from bps.null()
        return object()

    with pytest.raises(RecordError, match="object"):
        station.run(plan(), kind="unkept")
    (summary,) = station.registry.runs()
    assert summary.status == "failed"
    RunFolder.open(summary.folder).verify()


def test_a_plan_stub_of_bluesky_runs_as_it_is(station: Station) -> None:
    assert station.run(bps.sleep(5.0), kind="stub").bench_seconds == pytest.approx(5.0, abs=0.06)


def test_a_kind_that_is_no_folder_name_is_refused_before_anything_moves(station: Station) -> None:
    with pytest.raises(InputError, match="kind of run"):
        station.run(staircase(station.devices, [0.0]), kind="a/b")
    assert station.registry.runs() == []
    station.run(staircase(station.devices, [0.0]), kind="ok")


def test_one_run_at_a_time(station: Station) -> None:
    refused: list[BenchError] = []

    def plan() -> Plan:
        yield from bps.null()
        try:
            station.run(staircase(station.devices, [0.0]), kind="inner")
        except BenchError as error:
            refused.append(error)

    station.run(plan(), kind="outer")
    assert "another run is in progress" in str(refused[0])


def test_a_station_without_description_is_the_simulated_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TORQUEBENCH_DATA", str(tmp_path / "from-environment"))
    assert data_directory() == tmp_path / "from-environment"
    assert data_directory(tmp_path) == tmp_path
    with Station.open() as station:
        opened = station.description.model_dump(exclude={"calibrator": {"certified"}})
        assert opened == default_bench().model_dump(exclude={"calibrator": {"certified"}})
        certified = station.description.calibrator.certified
        assert sorted(certified) == ["input", "output"], "the simulated standard brings its own"
        assert (tmp_path / "from-environment" / "registry.sqlite").exists()
    station.close()


def test_a_wrong_description_opens_nothing(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_text("[bench]\nname = 3\n")
    with pytest.raises(InputError, match=r"bench\.toml"):
        Station.open(path, tmp_path / "data")
    assert not (tmp_path / "data").exists()


def test_a_bench_that_fails_while_it_opens_leaves_nothing_open(tmp_path: Path) -> None:
    text = (Path(__file__).parents[2] / "examples" / "bench.toml").read_text(encoding="utf-8")
    path = tmp_path / "bench.toml"
    path.write_text(
        text.replace("counts_per_revolution = 360000\n", "counts_per_revolution = 9e3\n")
    )
    path.write_text(path.read_text().replace("9e3", "9000"))
    with pytest.raises(InputError, match="360000 counts per revolution"):
        Station.open(path, tmp_path / "data")


class Person:
    """An operator who does what is asked, or refuses."""

    def __init__(self, willing: Callable[[str], bool]) -> None:
        self._willing = willing
        self._mounted: Any = "nothing"

    def mount(self, mounting: Any) -> None:
        if not self._willing(mounting):
            raise InterlockError(f"{mounting} was not mounted", "the operator's confirmation")
        self._mounted = mounting

    def mounted(self) -> Any:
        return self._mounted

    def seat(self, seating: Any) -> None: ...

    def cancel(self) -> None: ...


def test_an_operator_may_decline(tmp_path: Path) -> None:
    person = Person(lambda mounting: mounting == "reducer")
    with Station.open(data_dir=tmp_path, operator=person) as station:
        with pytest.raises(InterlockError, match="calibrator was not mounted"):
            station.run(set_up(station.devices), kind="calibrate")
        assert standard_serial(station.state) == ""


def calibrated(station: Station, *, serial: str, counter: str, slope: float = 1.01) -> Any:
    """Register and activate a model of the output module."""
    reading = np.linspace(-2000.0, 2000.0, 41)
    data = CalibrationData(
        reading_nm=reading,
        standard_nm=slope * reading,
        series=np.ones(41, dtype=np.int64),
        branch=np.ones(41, dtype=np.int8),
        range_nm=2000.0,
        side="output",
        transducer_serial=serial,
        counter_identity=counter,
    )
    model = make_model("polynomial", degree=1, range_nm=2000.0).fit(
        data.features(), data.standard_nm
    )
    path = station.data_dir / "model.json"
    save_model(path, StoredModel(model, Provenance(2000.0, "output", serial, counter)))
    entry = station.registry.add_model(
        station.registry.add_calibration(
            CalibrationEntry.of_points(data, performed=datetime.now(UTC))
        ),
        kind="polynomial",
        file=path,
        side="output",
    )
    station.registry.activate(entry.model_id)
    return path


def test_the_registrys_active_model_compensates(station: Station) -> None:
    counter = station.drivers.counter.clock_identity
    with pytest.raises(ModelMismatchError, match="no active model"):
        station.activate_compensation("output")
    calibrated(station, serial="SIM-T2000", counter=counter)
    assert station.activate_compensation("output").kind == "polynomial"
    row = station.run(staircase(station.devices, [400.0]), kind="measure").result[0]
    assert row["torque_nm"] == pytest.approx(1.01 * row["reading_nm"], abs=1e-3)
    model = station.acquisition.compensation("output").chain.model
    assert station.activate_compensation("output").chain.model is not model
    assert station.activate_compensation("output", fitted=model).chain.model is model
    (summary,) = station.registry.runs()
    kept = RunFolder.open(summary.folder).metadata["compensation"]
    assert kept["output"]["kind"] == "polynomial"
    station.acquisition.set_compensation("output", None)
    row = station.run(staircase(station.devices, [400.0]), kind="measure").result[0]
    assert "torque_nm" not in row


def test_the_limits_of_the_bench_count_for_a_model_that_was_not_fitted_on_it(
    station: Station,
) -> None:
    """Live U contained what the model's file stores: nothing, if the file is of a table."""
    path = calibrated(station, serial="SIM-T2000", counter=station.drivers.counter.clock_identity)
    bare = load_chain(path)
    active = station.activate_compensation("output")
    left = {"reference standard", "reproducibility of mounting", "dynamics of shaft and transducer"}
    assert left <= set(active.chain.missing()) < set(bare.missing())
    row = station.run(staircase(station.devices, [400.0]), kind="measure").result[0]
    alone = bare.torque(Readings(np.array([row["reading_nm"]])))
    assert row["torque_uncertainty_nm"] > alone.standard_uncertainty_nm[0] + 0.05
    stated = {each.name for each in active.states() if each.uncertainty_nm}
    assert {
        "temperature of zero",
        "temperature of span",
        "zero drift",
        "noise of the reading",
    } <= stated


def test_a_check_counts_the_same_limits_as_the_live_torque(station: Station) -> None:
    calibrated(station, serial="SIM-T2000", counter=station.drivers.counter.clock_identity)
    live = station.activate_compensation("output").chain
    judged = check_module(station, "output", load_profile("check"), 5.0).judged
    assert set(live.missing()) <= set(judged.missing)
    assert "temperature of zero and span" not in judged.missing
    assert (judged.torque.component("temperature of zero") > 0.0).all()


def test_a_model_of_another_transducer_or_counter_never_compensates(station: Station) -> None:
    counter = station.drivers.counter.clock_identity
    calibrated(station, serial="SOMEBODY-ELSES", counter=counter)
    with pytest.raises(ModelMismatchError, match="SIM-T2000"):
        station.activate_compensation("output")
    calibrated(station, serial="SIM-T2000", counter="another/clock")
    with pytest.raises(ModelMismatchError, match="another/clock"):
        station.activate_compensation("output")


def test_a_model_file_that_was_changed_never_compensates(station: Station) -> None:
    counter = station.drivers.counter.clock_identity
    path = calibrated(station, serial="SIM-T2000", counter=counter)
    content = json.loads(path.read_text(encoding="utf-8"))
    content["provenance"] = {}
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(RecordError, match="changed"):
        station.activate_compensation("output")
    assert station.acquisition.compensation("output") is None


def test_a_registry_that_fails_costs_no_run_and_catches_up_visibly(station: Station) -> None:
    with contextlib.closing(sqlite3.connect(station.data_dir / "registry.sqlite")) as database:
        database.execute(
            "CREATE TRIGGER full BEFORE INSERT ON runs "
            "BEGIN SELECT RAISE(ABORT, 'database or disk is full'); END"
        )
        record = station.run(set_up(station.devices), kind="set-up")
        assert record.exit_status == "success"
        RunFolder.open(record.folder).verify()
        (warning,) = station.alarms
        assert warning.alarm.name == "registry behind: registry"
        assert "database or disk is full; 1 run waits in the data dir" in warning.alarm.found
        assert station.supervisor.alarm is None, "it stops nothing"
        station.run(set_up(station.devices), kind="set-up")
        assert station.queue.waiting == 2
        assert station.registry.runs() == []
        database.execute("DROP TRIGGER full")
    deadline = time.monotonic() + 120.0
    while station.alarms and time.monotonic() < deadline:
        time.sleep(0.02)
    assert station.alarms == ()
    assert [run.status for run in station.registry.runs()] == ["completed"] * 2
    assert [run.folder for run in station.registry.runs()][1] == record.folder


def test_closing_a_loaded_bench_takes_the_torque_off(tmp_path: Path) -> None:
    with Station.open(data_dir=tmp_path) as station:
        station.run(set_up(station.devices), kind="set-up")
        drive = station.drivers.drives["output"]
        commands, now_s = station.devices.context.commands.output, station.clock.now()
        asked = commands.ask("torque", 500.0, 1e5, now_s)
        drive.command_torque(500.0, 1e5)
        commands.told("torque", asked, now_s)
        station.clock.wait(0.3)
        assert drive.state().torque_nm == 500.0
    assert drive.state().torque_nm == 0.0
    assert not drive.state().enabled
    with pytest.raises(BenchError, match="closed"):
        station.clock.wait(1.0)


def test_a_signal_that_fails_meanwhile_ends_the_run_as_failed(station: Station) -> None:
    def plan() -> Plan:
        yield from set_up(station.devices)
        yield from bps.mv(station.devices.output.drive.torque, 500.0)
        station.drivers.counter.twin.inject_fault("output_torque", "silent", duration_s=1.0)
        yield from bps.sleep(60.0)

    with pytest.raises(SignalFault, match="output_torque"):
        station.run(plan(), kind="measure")
    assert station.supervisor.wait_safe(60.0)
    assert torque_off(station)
    (summary,) = station.registry.runs()
    assert summary.status == "failed"
    with pytest.raises(SignalFault, match="signal lost"):
        station.run(staircase(station.devices, [0.0]), kind="again")
    station.acknowledge_alarm("A. Tester")
    station.clock.wait(1.0)
    assert station.run(staircase(station.devices, [0.0]), kind="again").exit_status == "success"
