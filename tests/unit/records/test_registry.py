import sqlite3
import threading
from dataclasses import replace
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from sqlalchemy import make_url

from torquebench.calibration import CalibrationData, Contradiction, verify
from torquebench.errors import ModelMismatchError, RecordError
from torquebench.message import Message
from torquebench.records import (
    CalibrationEntry,
    Equipment,
    Registry,
    RunFolder,
    RunSummary,
    UnavailableError,
    check_records,
)
from torquebench.records.registry.database import database_failures, engine_of

START = datetime(2025, 1, 31, 12, 0, tzinfo=UTC)


def data(serial="T-1", counter="C-1"):
    return CalibrationData(
        reading_nm=[0.1, 5.2, 10.1],
        standard_nm=[0.0, 5.0, 10.0],
        series=[1, 1, 2],
        branch=[1, 1, 1],
        range_nm=10.0,
        transducer_serial=serial,
        counter_identity=counter,
    )


def summary(run_id="run-1", **changes):
    run = RunSummary(
        run_id=run_id,
        kind="calibrate-output",
        started=START,
        simulated=True,
        software_version="0.1.0",
        folder=Path("runs") / run_id,
    )
    return replace(run, **changes)


def add_model(registry, tmp_path, kind="polynomial", **chain):
    calibration = registry.add_calibration(
        CalibrationEntry.of_points(replace(data(**chain), simulated=True), performed=START)
    )
    file = tmp_path / f"{kind}-{calibration.calibration_id}.json"
    file.write_text(kind, encoding="utf-8")
    return registry.add_model(calibration, kind=kind, file=file, metrics={"rms": np.float64(1.0)})


def test_equipment_are_registered_once_and_kept_up_to_date(registry):
    registry.add_equipment(Equipment("transducer", "T-1", range_nm=50.0))
    registry.add_equipment(
        Equipment("transducer", "T-1", "HBK", "T40B", 50.0, {"class": 0.1, "zero_hz": 60000.0})
    )
    registry.add_equipment(Equipment("counter", "C-1"))
    (transducer,) = registry.equipment("transducer")
    assert transducer.model == "T40B"
    assert transducer.details == {"class": 0.1, "zero_hz": 60000.0}
    assert [instrument.serial for instrument in registry.equipment()] == ["C-1", "T-1"]


def test_a_run_is_entered_when_it_starts_and_when_it_is_sealed(registry, tmp_path):
    writer = RunFolder.create(tmp_path / "runs", {}, kind="calibrate-output", run_id="run-1")
    registry.add_run(summary(folder=writer.path, operator="Ana", profile_name="rapid-in-situ"))
    assert registry.run("run-1").status == "running"
    assert registry.run("run-1").finished is None
    registry.end_run(writer.seal("aborted", "operator"))
    run = registry.run("run-1")
    assert (run.status, run.reason, run.operator) == ("aborted", "operator", "Ana")
    assert run.started == START
    assert run.finished > START
    assert run.folder == (tmp_path / "runs" / "run-1").resolve()
    assert len(run.manifest_sha256) == 64


def test_runs_are_listed_with_the_newest_first(registry):
    for number in range(5):
        kind = "verify" if number % 2 else "zero"
        started = START + timedelta(minutes=number)
        registry.add_run(summary(f"run-{number}", started=started, kind=kind))
    assert [run.run_id for run in registry.runs(limit=2)] == ["run-4", "run-3"]
    assert [run.run_id for run in registry.runs(limit=2, offset=2)] == ["run-2", "run-1"]
    assert [run.run_id for run in registry.runs(kind="verify")] == ["run-3", "run-1"]


def test_moments_of_other_time_zones_are_kept_in_utc(registry):
    registry.add_run(summary(started=START.astimezone(timezone(timedelta(hours=8)))))
    assert registry.run("run-1").started == START


def test_taken_and_unknown_runs_are_named(registry, tmp_path):
    registry.add_run(summary())
    with pytest.raises(RecordError, match="run run-1 is registered"):
        registry.add_run(summary())
    with pytest.raises(RecordError, match="run run-2 isn't registered"):
        registry.run("run-2")
    folder = RunFolder.create(tmp_path / "runs", {}, kind="zero", run_id="run-2").seal()
    with pytest.raises(RecordError, match="run run-2 isn't registered"):
        registry.end_run(folder)


def test_a_calibration_states_the_mean_temperature_of_its_points(registry):
    for measured, mean in (([21.0, 22.0, 23.0], 22.0), ([-0.5, 0.0, 0.5], 0.0)):
        points = replace(data(), temperature_c=np.array(measured), simulated=True)
        registry.add_calibration(CalibrationEntry.of_points(points, performed=START))
        assert registry.calibrations("T-1")[0].temperature_c == mean
    registry.add_calibration(
        CalibrationEntry.of_points(replace(data(), simulated=True), performed=START)
    )
    assert registry.calibrations("T-1")[0].temperature_c is None
    assert check_records(registry, folders=False).intact


def test_a_calibration_keeps_its_chain_and_its_run(registry):
    registry.add_run(summary())
    entry = registry.add_calibration(
        CalibrationEntry.of_points(
            data(),
            performed=START,
            run_id="run-1",
            standard_serial="TC-1",
            profile_name="rapid-in-situ",
            profile_sha256="ab" * 32,
            summary={"settled": np.True_},
        )
    )
    assert (entry.transducer_serial, entry.counter_identity) == ("T-1", "C-1")
    assert entry.run_id == "run-1"
    assert entry.data_sha256 == data().sha256()
    assert entry.summary["settled"] is True
    assert entry.summary["span_error_percent"]["clockwise"] == pytest.approx(1.6)
    assert registry.calibrations("T-1") == [entry]
    assert registry.calibrations("T-2") == []
    assert [each.serial for each in registry.equipment("calibrator")] == ["TC-1"]


def test_a_calibration_of_an_unnamed_chain_is_refused(registry):
    with pytest.raises(RecordError, match="calibration of transducer ''"):
        registry.add_calibration(CalibrationEntry.of_points(data(serial=""), performed=START))
    with pytest.raises(RecordError, match="run run-9 isn't registered"):
        registry.add_calibration(
            CalibrationEntry.of_points(data(), run_id="run-9", performed=START)
        )
    assert registry.calibrations() == []
    assert registry.equipment() == []


def test_models_are_active_for_the_chain_that_they_were_made_with(registry, tmp_path):
    first, second = (add_model(registry, tmp_path, kind) for kind in ("polynomial", "radial-basis"))
    assert registry.active_model("T-1", "C-1") is None
    registry.activate(first.model_id, operator="Ana")
    registry.activate(second.model_id, operator="Ben", reason="better")
    assert registry.active_model("T-1", "C-1") == second
    registry.activate(first.model_id)
    assert registry.active_model("T-1", "C-1").kind == "polynomial"
    registry.deactivate("T-1", "C-1", reason="transducer repaired")
    assert registry.active_model("T-1", "C-1") is None
    history = registry.activations("T-1")
    ids = [first.model_id, second.model_id, first.model_id, None]
    assert [activation.model_id for activation in history] == ids
    assert [activation.operator for activation in history] == ["Ana", "Ben", "", ""]
    assert registry.active_model("T-2", "C-1") is None


def test_a_model_made_with_another_counter_is_refused(registry, tmp_path):
    model = add_model(registry, tmp_path)
    registry.activate(model.model_id)
    with pytest.raises(ModelMismatchError, match=r"read by counter C-2; allowed: counter C-1"):
        registry.active_model("T-1", "C-2")


def test_a_model_file_that_was_changed_or_lost_is_refused(registry, tmp_path):
    model = add_model(registry, tmp_path)
    assert model.check_file() == model.file
    assert model.metrics == {"rms": 1.0}
    model.file.write_text("other", encoding="utf-8")
    with pytest.raises(RecordError, match="was changed after it was registered"):
        model.check_file()
    model.file.unlink()
    with pytest.raises(RecordError, match="is missing"):
        model.check_file()


def test_contradictions_of_a_model_keep_their_messages(registry, tmp_path):
    calibration = registry.add_calibration(CalibrationEntry.of_points(data(), performed=START))
    file = tmp_path / "model.json"
    file.write_text("{}", encoding="utf-8")
    said = Message("{percent:.1f} % off", 2.0)
    found = Contradiction("span", "plausibility.span_percent", said, "1 %", "A load.")
    model = registry.add_model(calibration, kind="hybrid", file=file, contradictions=[found])
    (kept,) = registry.model(model.model_id).contradictions
    assert kept == found
    assert (kept.found.template, kept.found.values) == ("{percent} % off", {"percent": "2.0"})


def test_unknown_models_are_named(registry, tmp_path):
    calibration = registry.add_calibration(CalibrationEntry.of_points(data(), performed=START))
    with pytest.raises(RecordError, match=r"none\.json is missing"):
        registry.add_model(calibration, kind="radial-basis", file=tmp_path / "none.json")
    for action in (registry.activate, registry.model):
        with pytest.raises(RecordError, match="model 7 isn't registered"):
            action(7)
    with pytest.raises(RecordError, match="model 7 isn't registered"):
        registry.add_verification(7, verify(data(), {}))


def test_models_of_one_transducer_are_listed(registry, tmp_path):
    one = add_model(registry, tmp_path)
    two = add_model(registry, tmp_path, serial="T-2")
    assert registry.models("T-1") == [one]
    assert registry.models() == [two, one]


def test_verifications_keep_their_numbers(registry, tmp_path):
    model = add_model(registry, tmp_path)
    result = verify(data(), {})
    registry.add_run(summary())
    registry.add_verification(model.model_id, result, run_id="run-1", performed=START)
    (entry,) = registry.verifications(model.model_id)
    assert (entry.run_id, entry.performed) == ("run-1", START)
    raw = entry.summary["models"][0]
    assert raw["against_standard"]["worst_nm"] == result.of("raw").against_standard.worst_nm


def test_everything_is_there_after_closing_and_moving(tmp_path):
    with Registry.open(tmp_path / "here") as registry:
        (tmp_path / "here" / "models").mkdir()
        model = add_model(registry, tmp_path / "here" / "models")
        registry.activate(model.model_id)
    (tmp_path / "here").rename(tmp_path / "there")
    with Registry.open(tmp_path / "there") as registry:
        moved = registry.active_model("T-1", "C-1")
        assert moved.check_file().is_relative_to((tmp_path / "there").resolve())


def test_a_model_of_no_calibration_is_refused(registry, tmp_path):
    entry = CalibrationEntry.of_points(data(), performed=START)
    entry.calibration_id = 99
    file = tmp_path / "model.json"
    file.write_text("{}", encoding="utf-8")
    with pytest.raises(RecordError, match=r"(?i)foreign key"):
        registry.add_model(entry, kind="radial-basis", file=file)


def test_a_file_database_is_in_wal_mode(tmp_path):
    with Registry.open(tmp_path):
        connection = sqlite3.connect(tmp_path / "registry.sqlite")
        assert connection.execute("PRAGMA journal_mode").fetchone() == ("wal",)
        connection.close()


def test_a_file_that_is_no_database_is_named(tmp_path):
    (tmp_path / "registry.sqlite").write_text("this is no database" * 100, encoding="utf-8")
    with pytest.raises(RecordError, match="can't be opened"):
        Registry.open(tmp_path)
    with pytest.raises(RecordError, match="can't create the data directory"):
        Registry.open(tmp_path / "registry.sqlite")


def test_runs_are_entered_from_several_threads(registry):
    def enter(first):
        for number in range(first, first + 5):
            registry.add_run(summary(f"run-{number}"))

    threads = [threading.Thread(target=enter, args=(5 * k,)) for k in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(registry.runs()) == 15


GONE = ConnectionResetError(104, "reset"), BrokenPipeError(32, "broken")


@pytest.mark.parametrize("gone", GONE)
def test_a_server_that_goes_between_question_and_answer_is_tried_again(gone):
    # PostgreSQL's driver lets the socket's own error through there.
    with pytest.raises(UnavailableError, match=gone.strerror), database_failures("the registry"):
        raise gone
    engine = engine_of(make_url("postgresql+pg8000://nobody@/none"))
    context = SimpleNamespace(original_exception=gone, is_disconnect=False)
    for noted in engine.dialect.dispatch.handle_error:
        noted(context)
    assert context.is_disconnect, "the connection isn't used again"
