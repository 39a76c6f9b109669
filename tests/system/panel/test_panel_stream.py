"""The live stream: increments without gaps, for slow watchers too, and an end when one must be."""

import asyncio
import itertools
import json
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from starlette.types import Message

from torquebench.panel.api import create_api, stream
from torquebench.panel.service import Actor, BenchService

CHIEF = Actor("Chief", "administrator", "chief")
SIGNALS = ["output_raw_nm"]


class Watcher:
    """The far end of a WebSocket, which takes what it is sent as slowly as it likes."""

    def __init__(self, request: dict[str, Any], slow: Callable[[int], float]) -> None:
        self._asked = [
            {"type": "websocket.connect"},
            {"type": "websocket.receive", "text": json.dumps(request)},
        ]
        self._slow = slow
        self.rows: list[dict[str, Any]] = []
        self.code = 0
        self.leaving = asyncio.Event()

    async def receive(self) -> Message:
        if self._asked:
            return self._asked.pop(0)
        await self.leaving.wait()
        return {"type": "websocket.disconnect", "code": 1000}

    async def send(self, message: Message) -> None:
        if message["type"] == "websocket.close":
            self.code = message["code"]
        elif message["type"] == "websocket.send":
            self.rows.append(json.loads(message["text"]))
            await asyncio.sleep(self._slow(len(self.rows)))


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[BenchService]:
    with BenchService.open(None, tmp_path_factory.mktemp("stream"), fast=True) as opened:
        deadline = time.monotonic() + 200.0
        while opened.live.sequence < 3:
            assert time.monotonic() < deadline
            time.sleep(0.02)
        yield opened


def watch(
    service: BenchService,
    until: Callable[[Watcher], bool],
    slow: Callable[[int], float] = lambda _number: 0.0,
    **request: Any,
) -> Watcher:
    """Watch until something is seen, or the stream ends by itself."""
    api = create_api(service)
    scope = {
        "type": "websocket",
        "path": "/stream",
        "headers": [],
        "query_string": b"",
        "subprotocols": [],
    }

    async def watched() -> Watcher:
        watcher = Watcher({"signals": SIGNALS, "rate": 50.0, **request}, slow)
        streaming = asyncio.ensure_future(api(scope, watcher.receive, watcher.send))
        deadline = time.monotonic() + 200.0
        while not (streaming.done() or until(watcher)):
            assert time.monotonic() < deadline
            await asyncio.sleep(0.01)
        watcher.leaving.set()
        await asyncio.wait_for(streaming, 60.0)
        return watcher

    return asyncio.run(watched())


def token_of(service: BenchService, name: str) -> tuple[int, str]:
    client, token = service.clients.add(CHIEF, name, "operator")
    return client.client_id, token


def without_gap(rows: list[dict[str, Any]]) -> bool:
    return all(
        after["missed"] == 0 and after["sequence"] - len(after["time_s"]) == before["sequence"]
        for before, after in itertools.pairwise(rows)
    )


def test_a_slow_watcher_gets_more_at_a_time_and_keeps_nothing_waiting(
    service: BenchService,
) -> None:
    _, token = token_of(service, "slow")
    watcher = watch(service, lambda each: len(each.rows) == 4, lambda _: 0.5, token=token)
    assert without_gap(watcher.rows)
    assert all(len(each["time_s"]) > 1 for each in watcher.rows[1:])


def test_a_watcher_that_takes_nothing_is_left(
    service: BenchService, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stream, "SLOWEST_S", 0.2)
    _, token = token_of(service, "deaf")
    watcher = watch(service, lambda _: False, lambda _: 3600.0, token=token)
    assert (len(watcher.rows), watcher.code) == (1, 1008)


def test_a_stream_goes_on_where_it_was_lost_and_after_a_restart(service: BenchService) -> None:
    _, token = token_of(service, "again")
    first = watch(service, lambda each: len(each.rows) >= 2, token=token)
    lost = first.rows[-1]["sequence"]
    second = watch(service, lambda each: len(each.rows) >= 2, token=token, since=lost)
    assert without_gap([first.rows[-1], *second.rows])
    ahead = watch(service, lambda each: len(each.rows) >= 2, token=token, since=10**9)
    assert ahead.rows[0]["sequence"] < 10**9
    assert ahead.rows[0]["time_s"] == []
    assert without_gap(ahead.rows)


def test_a_stream_ends_with_its_token(service: BenchService) -> None:
    number, token = token_of(service, "revoked")

    def revoke(watcher: Watcher) -> bool:
        if len(watcher.rows) == 2:
            service.clients.revoke(CHIEF, number)
            watcher.rows.append({})
        return False

    watcher = watch(service, revoke, token=token)
    assert watcher.code == 1008
    assert len(watcher.rows) <= 4
