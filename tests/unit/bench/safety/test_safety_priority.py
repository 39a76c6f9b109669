import gc
import os
import sys
import threading
from typing import Any

import pytest

from torquebench.bench.safety import priority
from torquebench.bench.safety.priority import (
    NICENESS,
    PRIORITY,
    SWITCH_INTERVAL_S,
    Priority,
    available_priority,
    collecting_later,
    lift_process,
    prefer_this_thread,
)
from torquebench.errors import InputError


@pytest.fixture(autouse=True)
def _best_priority(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(PRIORITY)  # the other tests ask for none


def niceness() -> int:
    return os.getpriority(os.PRIO_PROCESS, threading.get_native_id())


def on_a_thread(question: Any) -> Any:
    answers: list[Any] = []
    asking = threading.Thread(target=lambda: answers.append(question()))
    asking.start()
    asking.join()
    return answers[0]


def test_a_process_is_lifted_until_its_last_bench_is_closed() -> None:
    before = (niceness(), sys.getswitchinterval())
    granted = on_a_thread(lambda: priority._set_niceness(0, NICENESS))
    first, second = lift_process(), lift_process()
    first.close()
    assert sys.getswitchinterval() <= SWITCH_INTERVAL_S * 1.01
    assert niceness() == (min(NICENESS, before[0]) if granted else before[0])
    second.close()
    second.close()
    assert (niceness(), sys.getswitchinterval()) == before


def test_garbage_collection_leaves_out_what_was_there_before_the_bench() -> None:
    before = [[] for _ in range(3)]
    assert any(each is before for each in gc.get_objects())
    with lift_process():
        during = [[] for _ in range(3)]
        followed = gc.get_objects()
        assert not any(each is before for each in followed)
        assert any(each is during for each in followed)
    assert any(each is before for each in gc.get_objects())


def test_garbage_is_collected_after_a_block_and_not_in_it(request: pytest.FixtureRequest) -> None:
    collections: list[str] = []

    def note(phase: str, _: dict[str, int]) -> None:
        collections.append(phase)

    gc.callbacks.append(note)
    request.addfinalizer(lambda: gc.callbacks.remove(note))
    with collecting_later():
        kept = [[] for _ in range(2 * gc.get_threshold()[0])]
        assert collections == []
    kept += [[] for _ in range(2)]
    assert collections
    assert gc.isenabled()


def test_a_refusal_is_said_and_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_arguments: Any) -> None:
        raise PermissionError(1, "Operation not permitted")

    before = niceness()
    monkeypatch.setattr(os, "sched_setscheduler", refused)
    monkeypatch.setattr(os, "setpriority", refused)
    assert available_priority() is Priority.USUAL
    lift_process().close()
    assert niceness() == before


def test_what_a_preferred_thread_starts_is_usual_again() -> None:
    def question() -> tuple[Priority, int]:
        granted = prefer_this_thread()
        return granted, on_a_thread(lambda: os.sched_getscheduler(0))

    granted, inherited = on_a_thread(question)
    assert granted is available_priority()
    assert inherited == os.SCHED_OTHER


def test_usual_priority_asks_for_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(PRIORITY, "usual")
    before = niceness()
    with lift_process():
        assert niceness() == before
        assert on_a_thread(lambda: (prefer_this_thread(), os.sched_getscheduler(0))) == (
            Priority.USUAL,
            os.SCHED_OTHER,
        )
    assert available_priority() is Priority.USUAL


@pytest.mark.parametrize("asking", [lift_process, available_priority])
def test_an_unknown_priority_is_refused(monkeypatch: pytest.MonkeyPatch, asking: Any) -> None:
    monkeypatch.setenv(PRIORITY, "highest")
    with pytest.raises(InputError, match="TORQUEBENCH_PRIORITY=highest"):
        asking()
    assert sys.getswitchinterval() > SWITCH_INTERVAL_S
