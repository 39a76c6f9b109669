"""A calibration of the records is gone on with as if it had just been made."""

import time
from pathlib import Path

import pytest

from torquebench.errors import RecordError
from torquebench.panel.pages.calibrate.workflow import Dismissed, find_workflow
from torquebench.panel.service import Actor, BenchService, JobView

CHIEF = Actor("Chief", "administrator", "chief")
BEN = Actor("ben", "operator", "client-1", "client")


def done(service: BenchService, kind: str, **request: object) -> JobView:
    view = service.jobs.start(BEN, kind, request)
    deadline = time.monotonic() + 300.0
    while view.open or service.jobs.busy:
        assert time.monotonic() < deadline
        time.sleep(0.02)
        view = service.jobs.get(view.job_id)
    assert view.state == "done", view.problem
    return view


def test_a_restarted_panel_takes_a_verified_calibration_up_again(tmp_path: Path) -> None:
    with BenchService.open(None, tmp_path, fast=True) as service:
        service.clients.add(CHIEF, BEN.name, BEN.role)
        measured = done(
            service, "calibrate", side="output", step_percent=25.0, models=["polynomial-2"]
        )
        assert service.interrupted() is None
        verified = done(service, "verify", calibration_id=1, groups=1, points=8)
    with BenchService.open(None, tmp_path, fast=True) as service:
        assert find_workflow(service.jobs.recent(), Dismissed()).reached == "prepare"
        service.recall(BEN, 1)
        workflow = find_workflow(service.jobs.recent(), Dismissed())
        assert workflow.reached == "sign"
        assert workflow.verified_best == "polynomial-2"
        assert workflow.calibrate is not None
        assert workflow.verify is not None
        for before, after in ((measured, workflow.calibrate), (verified, workflow.verify)):
            assert before.result is not None
            assert after.result is not None
            assert after.result.headline == before.result.headline
            assert after.result.verdict == before.result.verdict
            assert after.result.run_ids == before.result.run_ids
        with pytest.raises(RecordError):
            service.recall(BEN, 7)
        of_another_version = tmp_path / "of-another-version.json"
        of_another_version.write_text("{}")
        registry = service.station.registry
        model = registry.add_model(
            registry.calibration(1), kind="hybrid", file=of_another_version, side="output"
        )
        registry.activate(model.model_id)
    with BenchService.open(None, tmp_path, fast=True) as service:
        output = service.snapshot().sides["output"]
        assert output.compensation is None
        assert "of-another-version.json" in output.compensation_problem
