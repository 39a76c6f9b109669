import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.unit.panel.aside_work import doubled, endless, refusing

from torquebench.errors import BenchError, InputError
from torquebench.panel.aside import AsideEndedError, run_aside
from torquebench.panel.service import (
    Actor,
    BenchService,
    BusyError,
    JobView,
    LeaseError,
    NotFoundError,
    PermissionDeniedError,
)

ANA = Actor("Ana", "metrologist", "client-1", "client")
BEN = Actor("Ben", "operator", "client-2", "client")


@pytest.fixture
def service(tmp_path: Path) -> Iterator[BenchService]:
    with BenchService.open(None, tmp_path, fast=True) as opened:
        yield opened


def ended(service: BenchService, view: JobView) -> JobView:
    deadline = time.monotonic() + 120.0
    while view.open or service.jobs.busy:
        assert time.monotonic() < deadline
        time.sleep(0.02)
        view = service.jobs.get(view.job_id)
    return view


def test_zero_check_and_stop_in_one_sitting(service: BenchService) -> None:
    view = ended(service, service.jobs.start(BEN, "zero", {}))
    assert view.state == "done", view.problem
    assert view.result is not None
    assert set(view.result.details) == {"input", "output"}
    assert service.records.run(view.result.run_ids[0]).run.operator == "Ben (client)"
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
    (alarm,) = service.alarms(standing=True)
    assert alarm.level == "critical"
    deadline = time.monotonic() + 30.0
    while service.alarms(standing=True):
        assert time.monotonic() < deadline
        try:
            service.acknowledge(BEN)
        except Exception:
            time.sleep(0.05)
    said = [each.what for each in service.log()]
    assert {"acknowledged an alarm", "stopped the bench", "started a job"} <= set(said)


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
        service.jobs.start(BEN, "fit", {"calibration_id": 1, "model": "hybrid"})
    with pytest.raises(InputError, match="steps"):
        service.jobs.preview("calibrate", {"side": "input", "step_percent": 0.1, "repeats": 50})
    assert service.jobs.recent() == []
    failed = ended(
        service, service.jobs.start(ANA, "fit", {"calibration_id": 9, "model": "spline"})
    )
    assert failed.problem is not None
    assert failed.problem.kind == "RecordError"


def test_an_aborted_calibration_goes_on(service: BenchService) -> None:
    asked = {"side": "output", "step_percent": 10.0, "repeats": 2, "models": ["polynomial-2"]}
    view = service.jobs.start(BEN, "calibrate", asked)
    while len(service.jobs.points(view.job_id)) < 50:  # within the second series
        time.sleep(0.01)
    service.jobs.abort(BEN, view.job_id)
    assert ended(service, view).state == "aborted"
    (run,) = service.records.runs(status="aborted").runs
    asked = {"run_id": run.run_id, "models": ["polynomial-2"]}
    view = ended(service, service.jobs.start(BEN, "resume-calibration", asked))
    assert view.state == "done", view.problem
    assert view.result is not None
    assert view.result.calibration_id == 1
    assert len(view.result.details["points"]["reading_nm"]) == 80


def test_a_reducer_is_tested_and_judged(service: BenchService) -> None:
    asked = {"test": "starting", "reducer": "standard", "serial": "S-1", "quick": True}
    shown = service.jobs.preview("reducer-test", asked)
    assert 0 < shown.largest_torque_nm["input"] <= shown.limit_torque_nm["input"]
    view = ended(service, service.jobs.start(BEN, "reducer-test", asked))
    assert view.state == "done", view.problem
    assert view.result is not None
    (outcome,) = view.result.details["outcomes"]
    assert outcome["name"] == "starting"
    assert outcome["quantities"][0]["unit"] == "N·m"
    assert service.records.run(view.result.run_ids[0]).run.status == "completed"


def test_leaving_the_service_ends_a_job_without_torque(tmp_path: Path) -> None:
    with BenchService.open(None, tmp_path, fast=True) as service:
        view = service.jobs.start(BEN, "calibrate", {"side": "output"})
        while not service.jobs.points(view.job_id):
            time.sleep(0.02)
    assert service.jobs.get(view.job_id).state == "aborted"
    assert not service.station._commands.any_enabled


def test_a_computation_aside_returns_reports_refuses_and_ends() -> None:
    said: list[tuple[float, str]] = []
    found = run_aside(doubled, 21.0, on_progress=lambda *each: said.append(each))
    assert (found, said) == (42.0, [(0.5, "half")])
    with pytest.raises(InputError, match="remedy"):
        run_aside(refusing)
    with pytest.raises(AsideEndedError):
        run_aside(endless, cancelled=lambda: True)
