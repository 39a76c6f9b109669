"""Recordings on demand: by hand, by a level, with what came before, and until they are finished."""

import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.errors import InputError
from torquebench.operations.recording import crossing
from torquebench.panel.service import Actor, BenchService, BusyError, JobView
from torquebench.records import RunFolder
from torquebench.reports.export import export_run

CHIEF = Actor("Chief", "administrator", "chief")
BEN = Actor("ben", "operator", "client-1", "client")
ANN = Actor("ann", "operator", "client-2", "client")


@pytest.fixture
def service(tmp_path: Path) -> Iterator[BenchService]:
    with BenchService.open(None, tmp_path, fast=True) as found:
        found.clients.add(CHIEF, BEN.name, BEN.role)
        found.clients.add(CHIEF, ANN.name, ANN.role)
        yield found


def until(service: BenchService, view: JobView, stage: str | None = None) -> JobView:
    """Wait for a stage of a job, or for its end."""
    deadline = time.monotonic() + 200.0
    while view.open and view.stage != stage:
        assert time.monotonic() < deadline
        time.sleep(0.02)
        view = service.jobs.get(view.job_id)
    return view


def samples(service: BenchService, view: JobView) -> np.ndarray:
    assert view.state == "done", view.problem
    assert view.result is not None
    rows = service.records.run_trend(view.result.run_ids[0], ["output_torque_nm"], 5000)
    return rows.time_s


def test_a_recording_has_its_name_and_every_sample(service: BenchService) -> None:
    request = {"name": "idle bench", "note": "before the mounting", "duration_s": 2.0}
    view = until(service, service.jobs.start(BEN, "record", request))
    times = samples(service, view)
    assert times[-1] - times[0] == pytest.approx(2.0, abs=0.2)
    np.testing.assert_allclose(np.diff(times), 0.01, atol=1e-6)
    assert view.result is not None
    assert view.result.headline == "Recorded 2.0 s: idle bench"
    metadata = service.records.run(view.result.run_ids[0]).metadata
    assert (metadata["title"], metadata["note"]) == ("idle bench", "before the mounting")


def test_a_recording_goes_on_until_it_is_finished(service: BenchService) -> None:
    view = until(service, service.jobs.start(BEN, "record", {"name": "open end"}), "Recording")
    assert view.can_finish
    service.jobs.finish(BEN, view.job_id)
    assert until(service, view).state == "done"
    zero = service.jobs.start(BEN, "zero", {})
    with pytest.raises(BusyError, match="can't be finished"):
        service.jobs.finish(BEN, zero.job_id)
    assert until(service, zero).state == "done"


def test_recordings_and_jobs_of_the_bench_run_beside_each_other(
    service: BenchService, tmp_path: Path
) -> None:
    """A waiting trigger blocked every test, and a test every recording."""
    trigger = {"signal": "output_raw_nm", "level": 2300.0}
    waiting = service.jobs.start(BEN, "record", {"name": "overload", "trigger": trigger})
    calibration = {"side": "output", "step_percent": 10.0, "models": ["polynomial-2"]}
    job = service.jobs.start(BEN, "calibrate", calibration)
    during = service.jobs.start(ANN, "record", {"name": "during it"})  # and without the command
    until(service, during, "Recording")
    assert [view.title for view in service.jobs.beside] == [
        "Recording overload",
        "Recording during it",
    ]
    while not service.jobs.points(job.job_id):
        assert service.jobs.get(job.job_id).open
        time.sleep(0.005)
    service.mark(ANN, "fan switched on")
    job = until(service, job)
    assert job.state == "done"
    service.mark(ANN, "fan switched off")
    service.jobs.finish(BEN, during.job_id)
    during = until(service, during)
    assert during.result is not None
    assert job.result is not None
    for view, notes in (
        (during, ["fan switched on", "fan switched off"]),
        (job, ["fan switched on"]),
    ):
        kept = service.records.run(view.result.run_ids[0]).annotations
        assert [(each.note, each.who) for each in kept] == [(note, ANN.label) for note in notes]
        registry, number = service.station.registry, view.result.run_ids[0]
        exported = export_run(registry, registry.run(number), tmp_path / number)
        listed = (exported.folder / "annotations.csv").read_text().splitlines()
        assert listed[0] == "time_s,note,who"
        assert [line.split(",")[1] for line in listed[1:]] == notes
    raw = RunFolder.open(service.data_dir / "runs" / during.result.run_ids[0]).raw()
    np.testing.assert_allclose(np.diff(raw.columns["time_s"]), 0.01, atol=1e-6)  # nothing missed
    assert np.nanmax(np.abs(raw.columns["output_torque_nm"])) > 40.0  # the calibration's load
    assert until(service, waiting, "Waiting for the trigger").open
    with pytest.raises(BusyError, match="Recording overload is under way"), service.jobs.idle():
        pass
    service.jobs.abort(BEN, waiting.job_id)
    waiting = until(service, waiting)
    assert waiting.state == "aborted"
    assert waiting.problem is not None
    assert "aborted by ben" in waiting.problem.found
    assert service.jobs.beside == []


def test_no_more_recordings_than_the_disk_takes(service: BenchService) -> None:
    views = [service.jobs.start(BEN, "record", {"name": f"{number}"}) for number in range(4)]
    with pytest.raises(BusyError, match="4 recordings"):
        service.jobs.start(BEN, "record", {"name": "5"})
    for view in views:
        service.jobs.abort(BEN, view.job_id, "enough")
    ended = [until(service, view) for view in views]
    assert {view.state for view in ended} == {"aborted"}
    assert all("enough" in view.problem.found for view in ended if view.problem)


def test_what_came_before_the_trigger_is_recorded_without_a_gap(service: BenchService) -> None:
    while service.live.bench_time_s < 4.0:
        time.sleep(0.02)
    latest = service.live.latest()["output_raw_nm"].value
    assert latest is not None
    request = {
        "name": "noise",
        "duration_s": 1.0,
        "before_s": 2.0,
        "trigger": {"signal": "output_raw_nm", "level": latest, "direction": "falling"},
    }
    times = samples(service, until(service, service.jobs.start(BEN, "record", request)))
    assert times[-1] - times[0] >= 3.0 - 0.11
    np.testing.assert_allclose(np.diff(times), 0.01, atol=1e-6)


def test_a_trigger_that_never_comes_leaves_nothing_behind(service: BenchService) -> None:
    request = {"name": "never", "trigger": {"signal": "output_raw_nm", "level": 1900.0}}
    view = service.jobs.start(BEN, "record", request)
    view = until(service, view, "Waiting for the trigger")
    service.jobs.finish(BEN, view.job_id)
    view = until(service, view)
    assert view.state == "aborted"
    assert view.problem is not None
    assert "before the recording began" in view.problem.found
    assert service.records.runs().total == 0


def test_a_recording_begins_at_its_moment(service: BenchService) -> None:
    at = datetime.now(UTC) + timedelta(seconds=0.5)
    request = {"name": "later", "duration_s": 0.5, "at": at.isoformat()}
    view = until(service, service.jobs.start(BEN, "record", request))
    assert view.result is not None
    assert service.records.run(view.result.run_ids[0]).run.started >= at


@pytest.mark.parametrize(
    "request_",
    [
        {"name": ""},
        {"name": "x", "before_s": 61.0},
        {"name": "x", "duration_s": 0.0},
        {"name": "x", "trigger": {"signal": "torque", "level": 1.0}},
        {"name": "x", "at": "tomorrow"},
    ],
)
def test_a_wrong_recording_is_refused_at_the_request(
    service: BenchService, request_: dict[str, object]
) -> None:
    with pytest.raises(InputError):
        service.jobs.start(BEN, "record", request_)
    assert not service.jobs.busy


@given(
    values=st.lists(st.one_of(st.floats(-10, 10), st.just(float("nan"))), max_size=30),
    cut=st.integers(0, 30),
    level=st.floats(-5, 5),
    rising=st.booleans(),
)
def test_a_level_is_found_the_same_in_one_block_and_in_two(
    values: list[float], cut: int, level: float, rising: bool
) -> None:
    time_s, value = np.arange(len(values), dtype=float), np.array(values, dtype=float)
    whole = crossing(time_s, value, level, rising=rising, armed=False)
    first, armed = crossing(time_s[:cut], value[:cut], level, rising=rising, armed=False)
    if first is None:
        assert crossing(time_s[cut:], value[cut:], level, rising=rising, armed=armed) == whole
    else:
        assert first == whole[0]
    if whole[0] is not None:
        beyond = value[int(whole[0])]
        assert beyond >= level if rising else beyond <= level
