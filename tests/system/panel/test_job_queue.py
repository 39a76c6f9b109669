"""The queue of a panel: order, start, stop at failures, pause, history, and after a restart."""

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from torquebench.errors import InputError
from torquebench.panel.service import (
    Actor,
    BenchService,
    LeaseError,
    NotFoundError,
    PermissionDeniedError,
    QueueView,
)
from torquebench.panel.text import Text
from torquebench.testing.operations import texts_of

CHIEF = Actor("Chief", "administrator", "chief")
ANA = Actor("ana", "metrologist", "client-1", "client")
OLGA = Actor("olga", "operator", "client-2", "client")
ZERO: tuple[str, dict[str, Any]] = ("zero", {"sides": ["input"]})
FAILS: tuple[str, dict[str, Any]] = ("check", {"side": "input", "tolerance_percent_fs": 1e-6})


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> Iterator[BenchService]:
    with BenchService.open(None, tmp_path_factory.mktemp("queue"), fast=True) as service:
        for actor in (ANA, OLGA):
            service.clients.add(CHIEF, actor.name, actor.role)
        yield service


@pytest.fixture
def service(opened: BenchService) -> Iterator[BenchService]:
    yield opened
    for item in opened.queue.view().items:
        opened.queue.remove(ANA, item.number)
    opened.lease.give_back(ANA)


def until(queue: Callable[[], QueueView], met: Callable[[QueueView], bool]) -> QueueView:
    deadline = time.monotonic() + 60.0
    while not met(view := queue()):
        assert time.monotonic() < deadline, view
        time.sleep(0.02)
    return view


def test_operations_are_ordered_moved_and_removed(service: BenchService) -> None:
    queue = service.queue
    first, second, third = (queue.add(OLGA, *ZERO).number for _ in range(3))
    queue.move(OLGA, third, 0)
    queue.move(OLGA, first, 99)
    assert [item.number for item in queue.view().items] == [third, second, first]
    queue.remove(OLGA, second)
    view = queue.view()
    assert [item.number for item in view.items] == [third, first]
    assert (view.history[0].number, view.history[0].state) == (second, "removed")
    for number in (second, 10_000):
        with pytest.raises(NotFoundError):
            queue.move(OLGA, number, 0)


@pytest.mark.parametrize("keep_going", [False, True])
def test_it_ends_at_a_failed_check_unless_it_is_to_go_on(
    service: BenchService, keep_going: bool
) -> None:
    queue = service.queue
    for each in (ZERO, FAILS, ZERO):
        queue.add(ANA, *each)
    queue.start(ANA, keep_going=keep_going)
    view = until(queue.view, lambda view: not view.running)
    done = [item.kind for item in view.history if item.state == "done"][: 2 + keep_going]
    assert done == (["zero"] * keep_going + ["check", "zero"])
    assert len(view.items) == (0 if keep_going else 1)
    assert ("a check failed" in view.reason) != keep_going
    assert view.history[0].job_id
    assert view.history[0].headline


def test_what_cannot_be_done_ends_it_and_the_rest_waits(service: BenchService) -> None:
    queue = service.queue
    queue.add(ANA, "records use", {"model": 99})
    queue.add(ANA, *ZERO)
    queue.start(ANA)
    view = until(queue.view, lambda view: not view.running)
    assert (view.history[0].state, len(view.items)) == ("failed", 1)
    assert "99" in view.reason


def test_a_pause_lets_the_job_end_and_no_other_begin(service: BenchService) -> None:
    queue = service.queue
    for _ in range(2):
        queue.add(ANA, *ZERO)
    queue.start(ANA)
    until(queue.view, lambda view: view.items[0].state == "running")
    assert not queue.pause(ANA).running
    view = until(queue.view, lambda view: len(view.items) == 1 and not service.jobs.busy)
    assert (view.items[0].state, view.reason) == ("waiting", "")
    assert view.history[0].state == "done"


def test_who_does_not_command_starts_nothing(service: BenchService) -> None:
    with pytest.raises(InputError, match="an empty queue"):
        service.queue.start(ANA)
    service.queue.add(ANA, *ZERO)
    service.lease.take(ANA)
    with pytest.raises(LeaseError):
        service.queue.start(OLGA)
    assert not service.queue.view().running


@pytest.mark.parametrize(
    ("name", "request_", "error"),
    [
        ("certificate", {"calibration": 1}, InputError),
        ("run", {"queue": "q.toml"}, InputError),
        ("nothing", {}, InputError),
        ("check", {"side": "middle"}, InputError),
        ("turn", {"side": "input", "out": "x.csv"}, InputError),
        ("records use", {"model": 1}, PermissionDeniedError),
    ],
)
def test_what_a_queue_cannot_take_is_refused(
    service: BenchService, name: str, request_: dict[str, Any], error: type[Exception]
) -> None:
    with pytest.raises(error):
        service.queue.add(OLGA, name, request_)
    assert service.queue.view().items == ()


def test_a_queue_waits_after_a_restart(tmp_path: Path) -> None:
    with BenchService.open(None, tmp_path, fast=True) as service:
        number = service.queue.add(ANA, *ZERO).number
    with BenchService.open(None, tmp_path, fast=True) as service:
        view = service.queue.view()
        assert [item.number for item in view.items] == [number]
        assert not view.running


def test_results_have_an_address_that_outlives_the_server(tmp_path: Path) -> None:
    with BenchService.open(None, tmp_path, fast=True) as first:
        first.clients.add(CHIEF, ANA.name, ANA.role)
        for each in (FAILS, ("records list", {})):
            first.queue.add(ANA, *each)
        first.queue.start(ANA, keep_going=True)
        history = until(first.queue.view, lambda view: not view.running).history
        numbers = [item.job_id for item in history]
        check = first.jobs.get(numbers[1])
        begun: dict[str, Any] = {"state": "running", "finished": None, "result": None}
        for name in ("cut", "undrawn"):
            first.jobs.log.began(ANA, replace(check, job_id=name, **begun))
        first.jobs.log.ended(replace(check, job_id="undrawn"))
        assert "undrawn" not in [each.job_id for each in first.jobs.log.newest(5)]
    with BenchService.open(None, tmp_path, fast=True) as service:
        assert {each.job_id for each in service.jobs.last()} == {"cut", *numbers}
        cut = service.jobs.get("cut")
        assert (cut.state, cut.open, cut.request) == ("interrupted", False, check.request)
        assert service.jobs.log.newest(1)[0].state == "interrupted"
        listed, again = map(service.jobs.get, numbers)
        assert listed.kind == "records-list"
        assert again.result is not None
        assert check.result is not None
        assert again.result.plain() == check.result.plain()
        assert (again.finished, again.stages) == (check.finished, check.stages)
        assert Text("zh")(again.result.headline) == Text("zh")(check.result.headline)
        assert texts_of(again.result.page()) == texts_of(check.result.page())
        with pytest.raises(NotFoundError):
            service.jobs.get("0" * 12)
