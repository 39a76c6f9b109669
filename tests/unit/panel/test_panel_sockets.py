"""A page's socket belongs to the session that opened the page."""

import asyncio
import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from starlette.types import Message, Receive, Scope, Send

from torquebench.panel.pages.sockets import PageSockets
from torquebench.panel.service.access.people import People
from torquebench.panel.service.store import PanelStore

PASSWORD = "a correct horse 2026"


@pytest.fixture
def people(tmp_path: Path) -> Iterator[People]:
    store = PanelStore(tmp_path)
    yield People(store)
    store.close()


@pytest.fixture
def token(people: People) -> str:
    assert people.setup_code is not None
    return people.set_up(people.setup_code, "Ana", PASSWORD, "here")


def talk(
    people: People,
    pages: dict[str, str],
    cookie: str,
    page: str,
    *said: str,
    kind: str = "websocket",
) -> tuple[list[Message], list[str]]:
    """Return what a browser gets that says something, and what reaches the page."""
    heard: list[Message] = []
    reached: list[str] = []
    coming: list[Message] = [{"type": "websocket.connect"}]
    coming += [{"type": "websocket.receive", "text": each} for each in said]

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await receive()
        await send({"type": "websocket.accept"})
        while (message := await receive())["type"] == "websocket.receive":
            if message["text"] == "out":
                people.sign_out(cookie)
            reached.append(message["text"])
            await send({"type": "websocket.send", "text": f'42["update",{len(reached)}]'})
        await send({"type": "websocket.send", "text": '42["open",{"path":"/sign-in"}]'})

    async def receive() -> Message:
        return coming.pop(0) if coming else {"type": "websocket.disconnect"}

    async def send(message: Message) -> None:
        heard.append(message)

    scope = {
        "type": kind,
        "method": "POST",
        "path": "/_nicegui_ws/socket.io/",
        "query_string": f"client_id={page}".encode(),
        "headers": [(b"cookie", f"torquebench_session={cookie}; other=1".encode())],
    }
    asyncio.run(PageSockets(app, people, pages)(scope, receive, send))
    return heard, reached


def event(page: str) -> str:
    return "42" + json.dumps(["event", {"id": 4, "client_id": page, "args": []}])


def test_a_page_answers_its_own_session(people: People, token: str) -> None:
    heard, reached = talk(people, {"p1": token}, token, "p1", "2", event("p1"))
    assert reached == ["2", event("p1")]
    assert heard[0]["type"] == "websocket.accept"
    assert len(heard) == 4


@pytest.mark.parametrize("cookie", ["", "guessed", "another"])
def test_the_number_of_a_page_alone_opens_nothing(people: People, token: str, cookie: str) -> None:
    if cookie == "another":
        cookie = people.sign_in("Ana", PASSWORD, "elsewhere")
    heard, reached = talk(people, {"p1": token}, cookie, "p1", event("p1"))
    assert [each["type"] for each in heard] == ["websocket.close"]
    assert reached == []


def test_a_session_that_has_ended_hears_where_to_sign_in_and_no_more(
    people: People, token: str
) -> None:
    heard, _ = talk(people, {"p1": token}, token, "p1", "2", "out", "2", "2")
    assert [each["text"] for each in heard if "text" in each] == [
        '42["update",1]',
        '42["open",{"path":"/sign-in"}]',
    ]
    heard, reached = talk(people, {"p1": token}, token, "p1", "2")
    assert [each["type"] for each in heard] == ["websocket.close"]
    assert reached == []


@pytest.mark.parametrize("namespace", ["", "/x,", "/x,7"])
def test_nobody_speaks_for_another_page(people: People, token: str, namespace: str) -> None:
    pages = {"p1": token}
    foreign = event("p1").replace("42", f"42{namespace}", 1)
    for page in ("sign-in", ""):  # pages that nobody is signed in on
        _, reached = talk(people, pages, "", page, "2", foreign, "2")
        assert reached == ["2"]
    _, reached = talk(people, pages, token, "p1", "42{no json")
    assert reached == []


def test_there_is_no_polling(people: People, token: str) -> None:
    heard, _ = talk(people, {"p1": token}, token, "p1", kind="http")
    assert heard[0]["status"] == 400


def test_nobody_writes_into_the_servers_log(people: People, token: str) -> None:
    forged = '42["log",{"client_id":"p1","level":"error","message":"x\\nAna signed in"}]'
    _, reached = talk(people, {"p1": token}, token, "p1", forged, event("p1"))
    assert reached == [event("p1")]
