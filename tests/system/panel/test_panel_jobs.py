import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from datetime import date
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from tests.system.panel.process_work import doubled, endless, in_stages, refusing
from tests.watching import Watching

from torquebench.bench.description import BenchDescription, default_bench
from torquebench.bench.prompts import QueuedOperator
from torquebench.chain import Temperature, load_chain
from torquebench.compensation import load_model
from torquebench.errors import BenchError, InputError, RecordError
from torquebench.operations import OPERATIONS, EndedError, find_operation, parameters
from torquebench.operations.checking import ZeroRequest
from torquebench.panel.run_in_process import run_in_process
from torquebench.panel.service import (
    Actor,
    BenchService,
    BusyError,
    JobView,
    LeaseError,
    NameTakenError,
    NotFoundError,
    PendingPrompt,
    PermissionDeniedError,
)
from torquebench.panel.service.jobs.job import Job
from torquebench.records import Report
from torquebench.station import Station

CHIEF = Actor("Chief", "administrator", "chief")
ANA = Actor("ana", "metrologist", "client-1", "client")
BEN = Actor("ben", "operator", "client-2", "client")


@contextmanager
def opened(folder: Path) -> Iterator[BenchService]:
    with BenchService.open(None, folder, fast=True) as service:
        for each in (ANA, BEN):
            with suppress(NameTakenError):  # of a folder that was opened before
                service.clients.add(CHIEF, each.name, each.role)
        yield service


@pytest.fixture
def service(tmp_path: Path) -> Iterator[BenchService]:
    with opened(tmp_path) as found:
        yield found


def ended(service: BenchService, view: JobView) -> JobView:
    deadline = time.monotonic() + 200.0
    while view.open or service.jobs.busy:
        assert time.monotonic() < deadline
        time.sleep(0.02)
        view = service.jobs.get(view.job_id)
    return view


def test_zero_check_and_stop_in_one_sitting(service: BenchService) -> None:
    view = ended(service, service.jobs.start(BEN, "zero", {}))
    assert view.state == "done", view.problem
    assert view.result is not None
    assert view.result.input.signal > 0.0 < view.result.output.signal
    assert service.records.run(view.result.run_ids[0]).run.operator == "ben (client)"
    view = service.jobs.start(BEN, "check", {"side": "input"})
    with pytest.raises(BusyError):
        service.jobs.start(BEN, "zero", {})
    with pytest.raises(LeaseError):
        service.jobs.abort(ANA, view.job_id)
    service.stop(ANA, "smoke")
    view = ended(service, view)
    assert view.state == "failed"
    with pytest.raises(BenchError, match="smoke"):
        service.jobs.start(BEN, "zero", {})
    (alarm,) = service.alarms(active=True)
    assert alarm.level == "critical"
    deadline = time.monotonic() + 200.0
    while service.alarms(active=True):
        assert time.monotonic() < deadline
        try:
            service.acknowledge(BEN)
        except Exception:
            time.sleep(0.05)
    said = [each.what for each in service.log()]
    assert {"acknowledged an alarm", "stopped the bench", "started a job"} <= set(said)


def test_the_bench_is_opened_again_for_changed_settings_only(service: BenchService) -> None:
    assert not service.reopen_needed
    limit = {"output": {"limits": {"torque_nm": 2100.0}}}
    change = service.settings.change(CHIEF, "bench", "bench", limit)
    assert service.reopen_needed
    service.settings.undo(CHIEF, change.number)
    assert not service.reopen_needed


def test_wrong_requests_start_nothing(service: BenchService) -> None:
    for kind, request in (
        ("calibrate", {}),
        ("calibrate", {"side": "top"}),
        ("calibrate", {"side": "output", "step_percent": float("nan")}),
        ("calibrate", {"side": "output", "surprise": 1}),
        ("check", {"side": "output", "profile": "../x"}),
    ):
        with pytest.raises(InputError):
            service.jobs.start(ANA, kind, request)
    with pytest.raises(NotFoundError):
        service.jobs.start(ANA, "dance", {})
    with pytest.raises(PermissionDeniedError):
        service.jobs.start(BEN, "records fit-model", {"calibration": 1, "model": "hybrid"})
    with pytest.raises(InputError, match="steps"):
        service.jobs.preview("calibrate", {"side": "input", "step_percent": 0.1, "repeats": 50})
    for kind, request, refusal in (
        ("calibrate", {"side": "output", "models": ["guess"]}, InputError),
        ("calibrate", {"side": "output", "profile": "nobodys"}, InputError),
        ("calibrate", {"side": "output", "profile": "verification"}, InputError),
        ("records-fit-model", {"calibration": 9, "model": "radial-basis"}, RecordError),
        ("records-compare-models", {"calibration": 9}, RecordError),
        ("verification", {"side": "output", "calibration": 9}, RecordError),
        ("verification", {"side": "output"}, InputError),
        ("check", {"side": "output", "profile": "nobodys"}, InputError),
        ("resume", {"run_id": "none"}, InputError),
        ("records-finish", {"run_id": "none"}, InputError),
        ("test", {"test": "hysteresis", "reducer": "nobodys"}, InputError),
    ):
        with pytest.raises(refusal):  # at the request, not in the job
            service.jobs.start(ANA, kind, request)
    assert service.jobs.recent() == []


def test_an_aborted_calibration_goes_on(service: BenchService) -> None:
    request = {"side": "output", "step_percent": 10.0, "repeats": 2, "models": ["polynomial-2"]}
    view = service.jobs.start(BEN, "calibrate", request)
    while len(service.jobs.points(view.job_id)) < 50:  # within the second series
        time.sleep(0.01)
    service.jobs.abort(BEN, view.job_id)
    assert ended(service, view).state == "aborted"
    (run,) = service.records.runs(status="aborted").runs
    request = {"run_id": run.run_id, "models": ["polynomial-2"]}
    view = ended(service, service.jobs.start(BEN, "resume", request))
    assert view.state == "done", view.problem
    assert view.result is not None
    (module,) = view.result.modules
    assert (module.calibration_id, len(module.points.reading_nm)) == (1, 80)


@pytest.mark.nightly
def test_the_network_is_fitted_with_its_parameters_and_shows_its_training(
    service: BenchService, tmp_path: Path
) -> None:
    for wrong, message in (
        ({"model": "published-network", "parameters": {"hidden": 0}}, "hidden"),
        ({"model": "published-network", "parameters": {"start": "at random"}}, "start"),
        ({"model": "polynomial-2", "parameters": {"epochs": 5}}, "epochs"),
    ):
        with pytest.raises(InputError, match=message):
            start(service, "records fit-model", {"calibration": 1, **wrong})
    parameters = {"epochs": 300, "start": "small-uniform", "target_error_nm": 0.001}
    request = {"side": "output", "step_percent": 20.0, "repeats": 1, "parameters": parameters}
    with pytest.raises(InputError, match="several models"):
        start(service, "calibrate", request)
    view = start(service, "calibrate", {**request, "models": ["published-network"]})
    (module,) = view.result.modules
    (first,) = module.models
    assert first.parameters == parameters
    assert first.training_curve.epoch[-1] == 300
    request = {
        "calibration": module.calibration_id,
        "model": "published-network",
        "parameters": {"epochs": 200, "hidden": 10},
        "rising_only": True,
    }
    (again,) = start(service, "records fit-model", request).result.modules[0].models
    assert again.rising_only
    assert again.training_curve.epoch[-1] == 200
    (newest,) = (tmp_path / "models").glob("*-published-network-*.json")
    trained = load_model(newest).model
    assert trained.hidden == 10
    rising = int((module.points.branch == 1).sum())
    assert trained.points_ == rising < module.points.branch.size

    stored = service.records.module(module.calibration_id)
    assert [model.parameters for model in stored.models] == [
        parameters,
        {"epochs": 200, "hidden": 10},
    ]
    assert len({model.model_id for model in stored.models}) == 2


def test_another_fit_of_an_old_calibration_uses_the_bench_as_it_was_then(tmp_path: Path) -> None:
    request = {"side": "output", "step_percent": 50.0, "models": ["polynomial-1"]}
    with opened(tmp_path) as service:
        number = start(service, "calibrate", request).result.modules[0].calibration_id
    today = default_bench().model_dump(mode="json")
    today["output"]["transducer"]["temperature_zero_percent_per_10k"] *= 50.0
    with BenchService.open(BenchDescription.model_validate(today), tmp_path, fast=True) as service:
        request = {"calibration": number, "model": "polynomial-2"}
        start(service, "records fit-model", request)
    chains = [load_chain(file) for file in (tmp_path / "models").glob("*.json")]
    (before, after) = [
        [effect for effect in chain.stored if isinstance(effect, Temperature)] for chain in chains
    ]
    assert before == after


def start(service: BenchService, kind: str, request: dict[str, Any]) -> JobView:
    view = ended(service, service.jobs.start(ANA, kind, request))
    if view.problem is not None:
        raise InputError(view.problem.found, view.problem.allowed)
    return view


def test_a_standard_reducer_checks_the_bench(service: BenchService) -> None:
    shown = service.jobs.preview("standard-reducer", {"repeats": 2})
    assert shown.largest_speed_rpm["input"] == 1200.0
    with pytest.raises(InputError, match="no certified_friction"):
        service.jobs.preview("standard-reducer", {"reducer": "rv-40e"})
    reducer = service.settings.get("reducers", "rv-40e").document
    points = [
        {"speed_rpm": speed, "torque_nm": 0.9, "expanded_uncertainty_nm": 0.01}
        for speed in (100.0, 200.0)
    ]
    service.settings.change(
        CHIEF,
        "reducers",
        "certified",
        {**reducer, "name": "certified", "ratio": 80.0, "certified_friction": points},
        reason="its certificate",
    )
    found = {"coaxiality_mm": 0.02, "lubricant": "oil"}
    request = {"reducer": "certified", "repeats": 2, "mounting": found}
    view = start(service, "standard-reducer", request)
    assert view.result.verdict == "fail"
    assert service.records.run(view.result.run_ids[0]).metadata["mounting_record"] == found
    check = view.result.check
    assert [point.speed_rpm for point in check.points] == [100.0, 200.0]
    assert check.error_percent > 0.1 > check.repeatability_percent
    run = service.records.run(view.result.run_ids[0])
    assert run.metadata["standard_reducer"]["certified_friction"] == points


def test_a_part_of_the_range_is_calibrated(service: BenchService) -> None:
    request = {"side": "output", "profile": "small-torques", "up_to_nm": 60.0}
    shown = service.jobs.preview("calibrate", request)
    assert shown.largest_torque_nm["output"] == pytest.approx(60.0)
    for wrong in ({"up_to_nm": 601.0}, {"up_to_nm": 0.0}, {"step_percent": 5.0}):
        with pytest.raises(InputError):
            service.jobs.preview("calibrate", {**request, **wrong})
    measured = {**request, "repeats": 1, "models": ["polynomial-2"]}
    view = ended(service, service.jobs.start(BEN, "calibrate", measured))
    assert view.state == "done", view.problem
    number = view.result.modules[0].calibration_id
    fresh = {"side": "output", "calibration": number, "groups": 1, "points": 8}
    shown = service.jobs.preview("verification", fresh)
    assert shown.largest_torque_nm["output"] == pytest.approx(60.0, rel=0.1)
    view = ended(service, service.jobs.start(BEN, "verification", fresh))
    assert view.state == "done", view.problem
    lacking = view.result.best.not_in_u
    assert "reproducibility of mounting" in lacking
    assert "creep under load" not in lacking


def test_an_expired_standard_and_a_wrong_clock_are_named_before_anything_begins(
    service: BenchService,
) -> None:
    request = {"side": "output", "profile": "rapid-in-situ"}
    assert service.jobs.preview("calibrate", request).doubts == ()
    station = service.station
    serial = station.description.calibrator.serial
    station.registry.add_report(
        Report("calibrator", serial, "PTB-1", "PTB", date(2020, 1, 15), date(2021, 1, 15))
    )
    station.clock_behind = "this computer's clock says 2001-01-01, 9131 days before"
    clock, expired = service.jobs.preview("calibrate", request).doubts
    assert "set the clock" in clock
    assert f"the certificate of the calibrator {serial} expired on 2021-01-15" in expired
    serial = station.description.verification_standard.serial
    station.registry.add_report(
        Report("verification-standard", serial, "PTB-2", "PTB", date(2020, 1, 15), date(2021, 2, 1))
    )
    _, expired = service.jobs.preview("check", {"side": "output"}).doubts
    assert f"the certificate of the verification standard {serial} expired on 2021-02-01" in expired


def test_a_reducer_is_tested_and_judged(service: BenchService) -> None:
    request = {"test": "starting", "reducer": "standard", "serial": "S-1", "short": True}
    shown = service.jobs.preview("test", request)
    assert 0 < shown.largest_torque_nm["input"] <= shown.limit_torque_nm["input"]
    view = ended(service, service.jobs.start(BEN, "test", request))
    assert view.state == "done", view.problem
    assert view.result is not None
    (part,) = view.result.parts
    assert part.name == "starting"
    assert part.quantities[0].unit == "N·m"
    assert service.records.run(view.result.run_ids[0]).run.status == "completed"


@pytest.mark.nightly
def test_a_simulated_bench_mounts_the_type_that_is_tested(service: BenchService) -> None:
    """A small reducer turns at 40 mN·m; the large one that the bench came with doesn't."""
    document = dict(service.settings.get("reducers", "harmonic-20").document)
    document |= {"name": "Own strain wave, 50 : 1", "ratio": 50.0, "source": "own"}
    service.settings.change(ANA, "reducers", "own-50", document)
    request = {"test": "starting", "reducer": "own-50", "serial": "H-7", "short": True}
    view = ended(service, service.jobs.start(BEN, "test", request))
    assert view.state == "done", view.problem
    assert view.result is not None
    (part,) = view.result.parts
    assert 0.005 < part.quantities[0].value < 0.1
    assert (view.result.serial, view.result.short) == ("H-7", True)
    report = service.records.report_file(view.result.run_ids[0])
    assert report.startswith(b"%PDF")
    assert not service.alarms(active=True)
    with pytest.raises(NotFoundError, match="no report"):
        service.records.report_file("../laboratory")
    request = {"repeats": 2, "tolerance_percent_fs": 1.0}
    view = ended(service, service.jobs.start(BEN, "standard-reducer", request))
    assert view.result is not None, view.problem
    assert view.result.verdict == "pass"  # the bench's own reducer is mounted again


def test_leaving_the_service_ends_a_job_without_torque(tmp_path: Path) -> None:
    with opened(tmp_path) as service:
        view = service.jobs.start(BEN, "calibrate", {"side": "output"})
        while not service.jobs.points(view.job_id):
            time.sleep(0.02)
    assert service.jobs.get(view.job_id).state == "aborted"
    assert not service.station._commands.any_enabled


def test_an_abort_before_the_first_run_begins_counts(service: BenchService) -> None:
    for _ in range(3):
        view = service.jobs.start(BEN, "calibrate", {"side": "output", "step_percent": 50.0})
        service.jobs.abort(BEN, view.job_id, "at once")
        view = ended(service, view)
        assert view.state == "aborted", view.problem
        assert not service.station._commands.any_enabled


def test_a_pause_before_the_first_run_begins_counts(service: BenchService) -> None:
    view = service.jobs.start(BEN, "calibrate", {"side": "output", "step_percent": 50.0})
    service.jobs.pause(BEN, view.job_id)
    deadline = time.monotonic() + 200.0
    while service.jobs.get(view.job_id).state != "paused":
        assert time.monotonic() < deadline
        time.sleep(0.02)
    assert service.jobs.points(view.job_id) == []
    service.jobs.abort(BEN, view.job_id)
    assert ended(service, view).state == "aborted"
    with pytest.raises(BusyError):
        service.jobs.pause(BEN, view.job_id)
    assert service.jobs.get(view.job_id).state == "aborted"


def test_whoever_sees_the_end_of_a_job_may_start_the_next(service: BenchService) -> None:
    for _ in range(2):
        view = service.jobs.start(BEN, "zero", {"sides": ["input"]})
        while view.open:
            view = service.jobs.get(view.job_id)
        assert view.state == "done", view.problem


def test_a_rehearsal_keeps_nobody_from_a_job(service: BenchService) -> None:
    looked = threading.Event()
    request = {"side": "output", "step_percent": 1.0, "repeats": 10}

    def look() -> None:
        with contextlib.suppress(BusyError):
            service.jobs.preview("calibrate", request)
        looked.set()

    thread = threading.Thread(target=look)
    thread.start()
    view = service.jobs.start(BEN, "zero", {})
    service.jobs.recent()
    began = not looked.is_set()
    thread.join()
    assert began, "the rehearsal was over too soon to prove anything"
    ended(service, view)


def test_a_log_that_cannot_be_written_hinders_no_abort_and_no_stop(
    service: BenchService, monkeypatch: pytest.MonkeyPatch
) -> None:
    view = service.jobs.start(BEN, "calibrate", {"side": "output"})
    while not service.jobs.points(view.job_id):
        time.sleep(0.02)

    def fails(*_: object, **__: object) -> None:
        raise RecordError("panel.sqlite failed: disk full", "room", "make room")

    monkeypatch.setattr(service._store, "note", fails)
    service.jobs.abort(BEN, view.job_id)
    assert ended(service, view).state == "aborted"
    (warning,) = service.alarms(active=True)
    assert (warning.level, warning.source) == ("warning", "panel log")
    assert service.stop(ANA, "smoke").alarm_number > warning.number


def test_a_stop_goes_past_whatever_holds_the_panel(service: BenchService) -> None:
    with service.jobs._lock, service._store.transaction():  # somebody works, somebody writes
        report = service.stop_aside(ANA, "past them").result(timeout=100.0)
    assert report.alarm_number
    assert service.snapshot().stopped


class Attended(BenchService):
    """A simulated bench whose operator is a person, as at a real one."""

    def _open_station(self) -> Station:
        prompts = QueuedOperator(self._prompts)
        return Station.open(
            self.settings.bench(), self._data_dir, real_time=False, operator=prompts
        )


def asked(service: BenchService, start: Callable[[], JobView]) -> tuple[JobView, PendingPrompt]:
    view = start()
    deadline = time.monotonic() + 200.0
    while (prompt := service.jobs.prompt) is None:
        assert time.monotonic() < deadline
        assert service.jobs.get(view.job_id).open
        time.sleep(0.02)
    return view, prompt


def test_an_abort_and_the_end_of_the_panel_take_a_question_back(tmp_path: Path) -> None:
    with Attended.open(None, tmp_path, fast=True) as service:
        for each in (ANA, BEN):
            service.clients.add(CHIEF, each.name, each.role)

        def start() -> JobView:
            request = {"side": "output", "step_percent": 50.0}
            return service.jobs.start(BEN, "calibrate", request, bench_clear=True)

        view, prompt = asked(service, start)
        assert "calibrator" in prompt.text
        with pytest.raises(LeaseError):
            service.jobs.answer(ANA, prompt.number, done=True)
        service.jobs.abort(BEN, view.job_id)
        assert ended(service, view).state == "aborted"
        assert service.jobs.prompt is None
        with pytest.raises(NotFoundError):
            service.jobs.answer(BEN, prompt.number, done=True)
        view, declined = asked(service, start)
        service.jobs.answer(BEN, declined.number, done=False)
        view = ended(service, view)
        assert view.state == "failed"
        assert view.problem is not None
        assert "declined" in view.problem.found
        view, _ = asked(service, start)
    assert service.jobs.get(view.job_id).state == "aborted"


def test_of_many_starts_at_once_one_job_begins(service: BenchService) -> None:
    service.lease.take(BEN)

    def start(_: int) -> str:
        try:
            return service.jobs.start(BEN, "zero", {}).job_id
        except BusyError:
            return ""

    with ThreadPoolExecutor(8) as crowd:
        begun = [each for each in crowd.map(start, range(8)) if each]
    ended(service, service.jobs.get(begun[0]))
    assert [each.job_id for each in service.jobs.recent()] == begun[::-1]
    runs = service.records.runs(kind="zero").runs
    spans = sorted((each.started, each.finished) for each in runs if each.finished)
    assert len(spans) == len(begun)
    assert all(before[1] <= after[0] for before, after in pairwise(spans))


def test_of_many_sessions_at_once_one_commands(service: BenchService) -> None:
    programs = [
        service.clients.actor(service.clients.add(CHIEF, f"plc-{n}", "operator")[1])
        for n in range(8)
    ]

    def take(actor: Actor) -> bool:
        try:
            service.lease.take(actor)
        except LeaseError:
            return False
        return True

    with ThreadPoolExecutor(8) as crowd:
        taken = list(crowd.map(take, programs))
    assert sum(taken) == 1
    assert service.lease.state().session_id == programs[taken.index(True)].session_id


def test_a_revoked_program_commands_no_longer(service: BenchService) -> None:
    service.lease.take(BEN)
    with pytest.raises(LeaseError):
        service.jobs.command(ANA)
    service.clients.revoke(CHIEF, 2)
    assert service.lease.state().holder is None
    service.jobs.command(ANA)


def test_a_computation_aside_returns_reports_refuses_and_ends() -> None:
    watching = Watching()
    assert run_in_process(doubled, 21.0, progress=watching) == 42.0
    ((done, detail),) = watching.reached
    assert (done, detail, detail.template) == (50, "50 %", "{share} %")
    with pytest.raises(InputError, match="remedy") as refused:
        run_in_process(refusing)
    assert refused.value.found.template == "{what} found"
    with pytest.raises(EndedError):
        run_in_process(endless, cancelled=lambda: "aborted by Ann")


def test_a_job_shows_the_stages_of_its_process_which_may_start_others(tmp_path: Path) -> None:
    watching = Watching()
    assert run_in_process(in_stages, progress=watching, folder=tmp_path, job=True) == 3.0
    assert watching.stages == [("2 parts", 2)]
    assert (watching.done, watching.finished) == ([2], 1)


def test_the_remaining_time_of_a_stage_follows_from_its_steps() -> None:
    job = Job(find_operation("zero"), ZeroRequest(), CHIEF)
    job.start("Zeroing", total=8)
    time.sleep(0.02)
    job.reach(1)
    assert job.view().remaining_s is None
    job.reach(2)
    assert job.view().remaining_s >= 3 * 0.02
    job.reach(8)
    assert job.view().remaining_s == 0.0


def test_a_form_shows_six_fields_at_most_and_folds_the_rest() -> None:
    for operation in filter(lambda each: each.served, OPERATIONS.values()):
        asked = parameters(operation.request)
        shown = [each.name for each in asked if not (each.expert or each.local)]
        assert len(shown) <= 6, (operation.name, shown)
        folded = [each.name for each in asked if each.expert and each.required]
        assert not folded, (operation.name, folded)


def test_the_server_of_forks_ends_when_it_is_idle_and_begins_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It held 200 MB from the first computation on."""
    from multiprocessing.forkserver import _forkserver

    monkeypatch.setattr("torquebench.panel.run_in_process.IDLE_S", 0.05)
    for value in (2.0, 3.0):
        assert run_in_process(doubled, value) == 2.0 * value
        deadline = time.monotonic() + 200.0
        while _forkserver._forkserver_pid is not None:
            assert time.monotonic() < deadline
            time.sleep(0.05)
