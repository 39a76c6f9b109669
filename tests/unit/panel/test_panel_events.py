"""A stream of events as a server meets it: listeners that leave, or take nothing."""

import asyncio
from collections.abc import AsyncIterator

import pytest
from starlette.types import Message

from torquebench.panel.api import events
from torquebench.panel.api.events import EventStream


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
