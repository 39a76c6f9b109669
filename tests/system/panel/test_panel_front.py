"""The server's front: a stop passes whatever computes behind, connections that trickle are cut."""

import asyncio
import contextlib
import socket
import threading
import time
from collections.abc import Iterator

import httpx
import pytest
import uvicorn
from starlette.types import Message, Receive, Scope, Send
from websockets.sync.client import connect

from torquebench.panel import connections
from torquebench.panel.api import Guard, security
from torquebench.panel.connections import PatientProtocol
from torquebench.panel.event_loop_bridge import EventLoopBridge
from torquebench.panel.service import Actor, BenchService
from torquebench.panel.stopping import PAGE_STOP, StopFirst

CHIEF = Actor("Chief", "administrator", "chief")


class Behind:
    """An application behind: it blocks its loop, echoes, fails or notes that it was cancelled."""

    def __init__(self) -> None:
        self.blocked, self.release = threading.Event(), threading.Event()
        self.cancelled = threading.Event()
        self.threads: set[str] = set()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        self.threads.add(threading.current_thread().name)
        if scope["type"] == "lifespan":
            await self._lifespan(receive, send)
        elif scope["type"] == "websocket":
            await self._echo(receive, send)
        elif scope["path"] == "/block":
            self.blocked.set()
            self.release.wait(60.0)  # on the event loop: nothing else goes on behind
            await self._answer(send, b"late")
        elif scope["path"] == "/body":
            await self._body(receive, send)
        elif scope["path"] == "/fail":
            raise RuntimeError("behind")
        else:
            await self._answer(send, scope["path"].encode())

    @staticmethod
    async def _lifespan(receive: Receive, send: Send) -> None:
        for phase in ("startup", "shutdown"):
            assert (await receive())["type"] == f"lifespan.{phase}"
            await send({"type": f"lifespan.{phase}.complete"})

    @staticmethod
    async def _echo(receive: Receive, send: Send) -> None:
        await receive()
        await send({"type": "websocket.accept"})
        while (message := await receive())["type"] == "websocket.receive":
            await send({"type": "websocket.send", "text": message["text"]})

    async def _body(self, receive: Receive, send: Send) -> None:
        content = b""
        while True:
            message: Message = await receive()
            if message["type"] == "http.disconnect":
                self.cancelled.set()
                return
            content += message.get("body", b"")
            if not message.get("more_body"):
                break
        await self._answer(send, str(len(content)).encode())

    @staticmethod
    async def _answer(send: Send, content: bytes) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": content})


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[BenchService]:
    with BenchService.open(None, tmp_path_factory.mktemp("front"), fast=True) as opened:
        opened.stop_aside(CHIEF, "so that its threads run").result()
        acknowledged(opened)
        yield opened


@pytest.fixture
def behind() -> Behind:
    return Behind()


@pytest.fixture
def server(service: BenchService, behind: Behind) -> Iterator[uvicorn.Server]:
    with (
        socket.create_server(("127.0.0.1", 0)) as listening,
        EventLoopBridge(behind) as backstage,
    ):
        port = listening.getsockname()[1]
        guarded = Guard(StopFirst(backstage, service), ["127.0.0.1"])
        config = uvicorn.Config(
            guarded, port=port, http=PatientProtocol, log_level="critical", timeout_keep_alive=300
        )
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run, args=([listening],))
        thread.start()
        while not server.started:
            time.sleep(0.01)
        yield server
        behind.release.set()
        server.should_exit = True
        thread.join()


@pytest.fixture
def url(server: uvicorn.Server) -> str:
    return f"http://127.0.0.1:{server.config.port}"


def acknowledged(service: BenchService) -> None:
    deadline = time.monotonic() + 200.0
    while service.snapshot().stopped:
        assert time.monotonic() < deadline
        with contextlib.suppress(Exception):
            service.acknowledge(CHIEF)
        time.sleep(0.02)


@pytest.mark.parametrize("way", ["page", "program"])
def test_a_stop_passes_an_event_loop_that_hangs(
    service: BenchService, behind: Behind, url: str, way: str
) -> None:
    _, token = service.clients.add(CHIEF, f"plc-{way}", "operator")
    answers: list[bytes] = []
    held = threading.Thread(
        target=lambda: answers.append(httpx.get(f"{url}/block", timeout=200.0).content)
    )
    held.start()
    assert behind.blocked.wait(200.0)
    if way == "page":
        answer = httpx.post(url + PAGE_STOP, headers={"X-Torquebench": "panel"}, timeout=200.0)
    else:
        own = {"Authorization": f"Bearer {token}"}
        answer = httpx.post(f"{url}/api/v1/stop", json={"reason": "fire"}, headers=own, timeout=200)
    assert answer.status_code == 200
    assert service.snapshot().stopped
    assert answers == []
    behind.release.set()
    held.join()
    assert answers == [b"late"]
    acknowledged(service)


def test_no_other_site_and_no_stranger_stops(service: BenchService, url: str) -> None:
    for headers in ({}, {"X-Torquebench": "panel", "Origin": "http://evil.example"}):
        assert httpx.post(url + PAGE_STOP, headers=headers, timeout=200.0).status_code == 403
    assert httpx.post(f"{url}/api/v1/stop", json={}, timeout=200.0).status_code == 401
    own = {"Authorization": "Bearer tb_unknown"}
    refused = httpx.post(f"{url}/api/v1/stop", json={}, headers=own, timeout=200.0)
    assert refused.json()["type"] == "torquebench:NotSignedInError"
    assert not service.snapshot().stopped


def test_messages_pass_both_ways_and_everything_behind_runs_there(url: str, behind: Behind) -> None:
    assert httpx.get(f"{url}/hello", timeout=200.0).content == b"/hello"
    assert httpx.post(f"{url}/body", content=b"x" * 300_000, timeout=200.0).content == b"300000"
    with connect(url.replace("http", "ws") + "/echo", open_timeout=200.0) as echo:
        for number in range(20):
            echo.send(str(number))
            assert echo.recv() == str(number)
    assert httpx.get(f"{url}/fail", timeout=200.0).status_code == 500
    assert behind.threads == {"torquebench-pages"}


def test_what_is_cancelled_in_front_is_cancelled_behind() -> None:
    ended = threading.Event()

    async def app(_scope: Scope, _receive: Receive, _send: Send) -> None:
        try:
            await asyncio.sleep(60.0)
        finally:
            ended.set()

    async def receive() -> Message:
        return {}

    async def send(_message: Message) -> None:
        return

    async def cancel() -> None:
        task = asyncio.ensure_future(backstage({}, receive, send))
        await asyncio.sleep(0.05)
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task

    with EventLoopBridge(app) as backstage:
        asyncio.run(cancel())
        assert ended.wait(200.0)


@pytest.mark.parametrize("sent", [b"", b"GET / HTTP/1.1\r\nHost: 127"])
def test_a_head_that_does_not_come_is_not_waited_for(
    url: str, monkeypatch: pytest.MonkeyPatch, sent: bytes
) -> None:
    monkeypatch.setattr(connections, "HEAD_S", 0.3)
    with socket.create_connection(("127.0.0.1", httpx.URL(url).port)) as trickling:
        trickling.settimeout(200.0)
        trickling.sendall(sent)
        assert trickling.recv(1000) == b""


def answered(asking: socket.socket) -> bytes:
    """Return a whole answer in chunks; what came of it where the connection was closed."""
    found = b""
    while not found.endswith(b"0\r\n\r\n") and (part := asking.recv(1000)):
        found += part
    return found


@pytest.mark.parametrize("used", [False, True])
def test_a_request_that_came_in_time_is_answered_after_a_pause(
    server: uvicorn.Server, url: str, used: bool
) -> None:
    ask = b"GET /hello HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
    paused, asked = threading.Event(), threading.Event()
    with socket.create_connection(("127.0.0.1", httpx.URL(url).port)) as waiting:
        waiting.settimeout(200.0)
        if used:
            waiting.sendall(ask)
            assert answered(waiting).startswith(b"HTTP/1.1 200")
        while not server.server_state.connections:
            time.sleep(0.01)
        (protocol,) = server.server_state.connections

        def pause() -> None:
            """Have no time until somebody has asked; then the limits have passed."""
            paused.set()
            asked.wait(200.0)
            protocol.timeout_keep_alive_handler() if used else protocol._give_up()

        protocol.loop.call_soon_threadsafe(pause)
        assert paused.wait(200.0)
        waiting.sendall(ask)
        asked.set()
        assert answered(waiting).startswith(b"HTTP/1.1 200")


def test_a_head_without_end_is_cut(url: str) -> None:
    with socket.create_connection(("127.0.0.1", httpx.URL(url).port)) as endless:
        endless.settimeout(200.0)
        head = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: " + b"a" * 100_000_000
        with pytest.raises(ConnectionError):
            endless.sendall(head)


def test_a_body_that_trickles_is_cut(
    url: str, behind: Behind, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(security, "BODY_S", 0.3)
    with socket.create_connection(("127.0.0.1", httpx.URL(url).port)) as trickling:
        trickling.sendall(b"POST /body HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 9\r\n\r\nx")
        assert behind.cancelled.wait(200.0)


def test_a_stop_gets_in_beside_a_hundred_idle_connections(service: BenchService, url: str) -> None:
    port = httpx.URL(url).port
    with contextlib.ExitStack() as held:
        for _ in range(100):
            held.enter_context(socket.create_connection(("127.0.0.1", port)))
        answer = httpx.post(url + PAGE_STOP, headers={"X-Torquebench": "panel"}, timeout=200.0)
        assert answer.status_code == 200
    acknowledged(service)
