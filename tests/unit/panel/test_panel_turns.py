"""Strangers wait for their turn, address by address; who is signed in and who stops doesn't."""

import asyncio
from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import cast

import pytest
from starlette.types import Message, Receive, Scope, Send

from torquebench.panel import turns
from torquebench.panel.pages.visitor import SESSION_COOKIE
from torquebench.panel.service import Actor, BenchService
from torquebench.panel.service.access.clients import Clients
from torquebench.panel.service.access.people import People
from torquebench.panel.service.store import PanelStore
from torquebench.panel.stopping import PAGE_STOP, StopFirst
from torquebench.panel.turns import Turns

PASSWORD = "a correct horse 2026"


@pytest.fixture
def service(tmp_path: Path) -> Iterator[BenchService]:
    """Accounts and clients, and a stop that is carried out at once."""
    store = PanelStore(tmp_path)

    class Stopped:
        people, clients = People(store), Clients(store)

        def stop_aside(self, _actor: Actor, _reason: str) -> Future[None]:
            told: Future[None] = Future()
            told.set_result(None)
            return told

    yield cast("BenchService", Stopped())
    store.close()


@pytest.fixture(autouse=True)
def few_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(turns, "AT_ONCE", 2.0)
    monkeypatch.setattr(turns, "A_SECOND", 200.0)
    monkeypatch.setattr(turns, "MOST_WAITING", 20)


class Served:
    """An application that notes who has come through, behind turns."""

    def __init__(self, service: BenchService) -> None:
        self.came: list[str] = []
        self.statuses: list[int] = []
        self.app = StopFirst(Turns(self._answer, service), service)

    async def _answer(self, scope: Scope, _receive: Receive, send: Send) -> None:
        self.came.append(scope["client"][0])
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b""})

    async def ask(
        self, address: str, path: str = "/sign-in", method: str = "GET", **headers: str
    ) -> None:
        async def receive() -> Message:
            return {"type": "http.request", "body": b"", "more_body": False}

        async def send(message: Message) -> None:
            if message["type"] == "http.response.start":
                self.statuses.append(message["status"])
                if path == PAGE_STOP:
                    self.came.append("stop")

        said = [(k.replace("_", "-").encode(), v.encode()) for k, v in headers.items()]
        scope = {
            "type": "http",
            "method": method,
            "path": path,
            "query_string": b"",
            "headers": said,
            "client": (address, 1),
        }
        await self.app(scope, receive, send)


def test_one_address_holds_no_other_up(service: BenchService) -> None:
    served = Served(service)

    async def crowd() -> None:
        flood = [asyncio.ensure_future(served.ask("flood")) for _ in range(20)]
        await asyncio.sleep(0)
        await served.ask("other")
        await asyncio.gather(*flood)

    asyncio.run(crowd())
    assert len(served.came) == 21
    assert served.came.index("other") <= 4  # two at once, one of the flood, then his


def test_a_flood_comes_through_no_faster_than_there_are_turns(service: BenchService) -> None:
    served = Served(service)

    async def crowd() -> float:
        began = asyncio.get_running_loop().time()
        await asyncio.gather(*(served.ask("flood") for _ in range(22)))
        return asyncio.get_running_loop().time() - began

    assert asyncio.run(crowd()) >= 0.09  # twenty turns of 5 ms
    assert served.statuses == [200] * 22


def test_who_is_signed_in_and_who_stops_does_not_wait(
    service: BenchService, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(turns, "A_SECOND", 20.0)
    served = Served(service)
    assert service.people.setup_code is not None
    session = service.people.set_up(service.people.setup_code, "Ana", PASSWORD, "here")
    _, token = service.clients.add(Actor("Ana", "administrator", "Ana"), "plc", "operator")

    async def crowd() -> None:
        flood = [asyncio.ensure_future(served.ask("flood")) for _ in range(20)]
        await asyncio.sleep(0)
        await served.ask("flood", PAGE_STOP, "POST", x_torquebench="panel")
        await served.ask("Ana", "/records", cookie=f"{SESSION_COOKIE}={session}")
        await served.ask("plc", "/api/v1/bench", authorization=f"Bearer {token}")
        await asyncio.gather(*flood)

    asyncio.run(crowd())
    last = max(served.came.index(each) for each in ("stop", "Ana", "plc"))
    assert last < 12, served.came  # most of the flood still waits


def test_what_waits_beyond_reason_is_refused(service: BenchService) -> None:
    served = Served(service)

    async def crowd() -> None:
        flood = [asyncio.ensure_future(served.ask("flood")) for _ in range(40)]
        flood.append(asyncio.ensure_future(served.ask("other")))
        await asyncio.gather(*flood)

    asyncio.run(crowd())
    assert served.statuses.count(429) == 18
    assert "other" in served.came


def test_who_went_away_leaves_no_turn_unused(service: BenchService) -> None:
    served = Served(service)

    async def crowd() -> None:
        waits = [asyncio.ensure_future(served.ask("flood")) for _ in range(6)]
        await asyncio.sleep(0)
        for each in waits[2:5]:
            each.cancel()
        await asyncio.gather(*waits, return_exceptions=True)
        await served.ask("other")

    asyncio.run(crowd())
    assert served.came == ["flood"] * 3 + ["other"]
