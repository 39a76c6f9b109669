"""Where a calibration stands is read from the jobs that the server keeps."""

from datetime import UTC, datetime
from typing import Any

from torquebench.panel.pages.calibrate.workflow import CalibrationWorkflow, Dismissed, find_workflow
from torquebench.panel.service import JobResult, JobView

MOMENT = datetime(2026, 1, 1, tzinfo=UTC)


def job(kind: str, number: int | None = None, *, done: bool = True, **details: Any) -> JobView:
    result = JobResult("said", calibration_id=number, model_ids={"a": 7}, details=details)
    return JobView(
        job_id=kind,
        kind=kind,
        title=kind,
        request={} if kind == "calibrate" else {"calibration_id": number},
        started_by="Ana",
        state="done" if done else "running",
        can_pause=True,
        can_finish=False,
        stage="",
        done=0,
        total=None,
        detail="",
        stages=(),
        points=0,
        started=MOMENT,
        finished=MOMENT if done else None,
        result=result if done else None,
    )


CALIBRATED = job("calibrate", 3, models={"a": {"title": "A"}})


def test_without_a_calibration_there_is_one_to_prepare() -> None:
    assert find_workflow([], Dismissed()).reached == "prepare"


def test_the_course_goes_on_as_jobs_end() -> None:
    assert find_workflow([job("calibrate", done=False)], Dismissed()).reached == "measure"
    assert find_workflow([CALIBRATED], Dismissed()).reached == "models"
    assert (
        find_workflow([job("verify", 3, done=False), CALIBRATED], Dismissed()).reached == "verify"
    )
    verified = [job("verify", 3), CALIBRATED]
    assert find_workflow(verified, Dismissed()).reached == "sign"
    assert find_workflow([job("certificate", 3), *verified], Dismissed()).reached == "certificate"


def test_a_step_that_was_passed_over_is_not_done() -> None:
    fitted, verified = ([CALIBRATED], [job("verify", 3), CALIBRATED])
    found = [find_workflow(jobs, Dismissed()) for jobs in (fitted, verified)]
    assert [each.done("verify", signed=False) for each in found] == [False, True]
    assert [found[1].done("sign", signed=signed) for signed in (False, True)] == [False, True]
    assert all(each.done("models", signed=False) for each in found)


def test_jobs_of_another_calibration_dont_count() -> None:
    assert find_workflow([job("verify", 2), CALIBRATED], Dismissed()).reached == "models"


def test_a_calibration_that_was_put_aside_makes_room_for_another_one() -> None:
    assert find_workflow([CALIBRATED], Dismissed({"calibrate"})) == CalibrationWorkflow()


def test_models_know_their_number_and_the_best_compared_one_its_name() -> None:
    workflow = find_workflow([job("compare-models", 3, best="a"), CALIBRATED], Dismissed())
    assert workflow.models == {"a": {"title": "A", "model_id": 7}}
    assert workflow.best_compared == "a"
