"""A stream of events as a server meets it: listeners that leave, or take nothing."""

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
from starlette.types import Message

from torquebench.errors import TorquebenchError
from torquebench.panel.api import events
from torquebench.panel.api.events import EventStream
from torquebench.panel.service import Actor, BenchService


async def endless() -> AsyncIterator[str]:
    while True:
        yield "event: job\ndata: {}\n\n"
        await asyncio.sleep(0)


def test_a_listener_that_takes_nothing_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(events, "SLOWEST_S", 0.05)
    taken: list[Message] = []

    async def listened() -> None:
        async def send(message: Message) -> None:
            taken.append(message)
            if len(taken) > 3:
                await asyncio.Event().wait()

        await asyncio.wait_for(EventStream(endless())({}, asyncio.Event().wait, send), 30.0)

    asyncio.run(listened())
    assert [each["type"] for each in taken] == ["http.response.start"] + 3 * ["http.response.body"]


def test_nothing_is_said_to_who_has_left() -> None:
    taken: list[Message] = []

    async def listened() -> None:
        async def send(message: Message) -> None:
            taken.append(message)

        async def receive() -> Message:
            while len(taken) < 5:
                await asyncio.sleep(0)
            return {"type": "http.disconnect"}

        await asyncio.wait_for(EventStream(endless())({}, receive, send), 30.0)

    asyncio.run(listened())
    assert len(taken) >= 5


def test_an_alarm_that_came_and_went_between_two_looks_is_told(tmp_path: Path) -> None:
    operator = Actor("plant", "operator", "client-1", kind="client")

    def stopped(service: BenchService, reason: str) -> None:
        service.stop(operator, reason)
        deadline = time.monotonic() + 60.0
        while service.alarms(active=True):
            assert time.monotonic() < deadline
            with contextlib.suppress(TorquebenchError):
                service.acknowledge(operator)

    with BenchService.open(None, tmp_path, fast=True) as service:
        stopped(service, "before anybody listens")
        listener = events._Listener(service, None)
        assert listener.news() == ""
        stopped(service, "a noise")
        told = listener.news()
        assert told.count("event: alarm") == 1
        assert "a noise" in told
        assert '"acknowledged_by":"plant' in told
        assert listener.news() == ""
