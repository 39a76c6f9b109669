"""Metrics are read from the bench, also while it is stopped or opened again."""

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from torquebench.panel.service import Actor, BenchService
from torquebench_sparkplug.metrics import NODE, read_bench

CHIEF = Actor("Ada", "administrator", "a1")


@pytest.fixture
def service(tmp_path: Path) -> Iterator[BenchService]:
    with BenchService.open(None, tmp_path / "data", fast=True) as service:
        yield service


def test_a_stopped_bench_says_so_with_its_alarm(service: BenchService) -> None:
    service.wait_for_live()
    service.stop(CHIEF, "by a test")
    found = read_bench(service)
    assert found is not None
    node = {name: reading.value for name, reading in found.values[NODE].items()}
    (alarm,) = service.alarms(active=True)
    assert alarm.message == f"{alarm.found}; {alarm.remedy}"
    assert node["Alarm/Text"] == f"{alarm.kind} ({alarm.source}): {alarm.message}"
    assert node["Bench/State"] == "stopped"
    assert service.snapshot().state == "stopped"


def test_it_can_be_read_while_it_is_opened_again(service: BenchService) -> None:
    token = service.people.set_up(str(service.people.setup_code), "Ada", "correct horse", "test")
    actor = service.people.actor(token)
    service.lease.take(actor)
    ended = threading.Event()
    read: list[bool] = []

    def keep_reading() -> None:
        while not ended.is_set():
            read.append(read_bench(service) is not None)

    reader = threading.Thread(target=keep_reading)
    reader.start()
    for _ in range(2):
        service.reopen(actor)
    ended.set()
    reader.join()
    assert read
    assert all(read)
