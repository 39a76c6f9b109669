"""The panel's web server: pages and HTTP API for one open bench, on one port."""

from __future__ import annotations

import contextlib
import secrets
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import uvicorn
from fastapi import FastAPI
from nicegui import ui, ui_run_with
from starlette.responses import HTMLResponse
from starlette.types import ASGIApp

from torquebench.atomic_write import atomic_write, require_private
from torquebench.errors import InputError
from torquebench.kernels import release_compiler
from torquebench.message import Message
from torquebench.panel.address import Address
from torquebench.panel.api import API_PATH, LARGEST_BODY, Guard, create_api, reference_page
from torquebench.panel.connections import PatientProtocol
from torquebench.panel.event_loop_bridge import EventLoopBridge
from torquebench.panel.pages import PAGES, register_pages
from torquebench.panel.pages.sockets import PageSockets
from torquebench.panel.service import BenchService
from torquebench.panel.stopping import StopFirst
from torquebench.processes import open_all_files

__all__ = ["create_app", "listen", "serve", "serve_application", "storage_secret"]

SECRET_FILE = "panel-secret"
GRACE_S = 3
MISSED_S = 10.0
"""Time without an answer after which a connection counts as lost, s; a busy computer answers
late."""
COMPILED_S = 60.0
"""Time after which the first start after an installation has compiled its kernels, s."""
RESTING_S = 30
"""For how long an idle connection is kept, s; longer than clients keep it."""


class _NothingToSearch:
    """Replaces `gc` in NiceGUI, which at its start searches all objects for its server.

    The search isn't needed here, but it would touch tuples that other threads are just building,
    which makes CPython 3.11 raise a SystemError in those threads, such as acquisition and
    supervisor.
    """

    @staticmethod
    def get_objects() -> list[object]:
        """Return no objects."""
        return []


def storage_secret(data_dir: Path) -> str:
    """Return the data directory's secret for signing cookies; create it on first use (mode 0600).

    Raises
    ------
    InputError
        The file is readable by other users, or too short.
    """
    path = data_dir / SECRET_FILE
    if not path.exists():
        atomic_write(path, secrets.token_urlsafe(48), private=True)
    require_private(path)
    found = path.read_text(encoding="ascii").strip()
    if len(found) < 32:
        raise InputError(
            Message("{path} is damaged", path), "a secret", "delete it; everybody signs in again"
        )
    return found


def create_app(service: BenchService, address: Address) -> ASGIApp:
    """Return the application with pages and API around a service."""
    app = FastAPI(title="torquebench", docs_url=None, redoc_url=None, openapi_url=None)
    api = create_api(service)
    app.mount(API_PATH, api)

    @app.get("/docs")
    def reference() -> HTMLResponse:
        return HTMLResponse(reference_page(api.openapi()))

    opened = register_pages(service)
    ui_run_with.gc = _NothingToSearch
    ui.run_with(
        app,
        title="torquebench",
        dark=None,
        tailwind=False,  # the panel has its own style sheet
        show_welcome_message=False,
        reconnect_timeout=MISSED_S,
        storage_secret=storage_secret(service.station.data_dir),
        session_middleware_kwargs={"same_site": "strict", "https_only": address.secure},
    )
    return PageSockets(app, service.people, opened)


def serve(
    service: BenchService, address: Address, on_ready: Callable[[str], None] = lambda _url: None
) -> None:
    """Serve the panel until Ctrl-C or a request to terminate.

    Parameters
    ----------
    service : BenchService
        Service, which stays open.
    address : Address
    on_ready : callable
        Called with the URL once connections are accepted.
    """
    address.check()
    open_all_files()
    release_compiler()
    compiled = threading.Timer(COMPILED_S, release_compiler)
    compiled.daemon = True
    compiled.start()
    listening = listen(address)
    port = int(listening.getsockname()[1])
    loops = uvicorn.Config(app="").get_loop_factory()
    with listening, EventLoopBridge(create_app(service, address), loops) as behind:
        guarded = Guard(
            StopFirst(behind, service),
            address.hosts,
            secure=address.secure,
            compiled={page.path for page in PAGES.values()},
        )
        config = uvicorn_config(
            guarded,
            address,
            http=PatientProtocol,
            ws_max_size=LARGEST_BODY,
            ws_per_message_deflate=False,  # too expensive for the front loop
            timeout_keep_alive=RESTING_S,
            timeout_graceful_shutdown=GRACE_S,
        )
        server = _Server(config, service.unload_aside)
        on_ready(address.url(port))
        server.run(sockets=[listening])


def serve_application(
    app: ASGIApp, address: Address, on_ready: Callable[[str], None] = lambda _url: None
) -> None:
    """Serve an application without a bench, with the panel's checks of requests, until Ctrl-C.

    Raises
    ------
    InputError
        The port is taken, or the address isn't one of this machine.
    """
    with listen(address) as listening:
        guarded = Guard(app, address.hosts, secure=address.secure)
        on_ready(address.url(int(listening.getsockname()[1])))
        uvicorn.Server(uvicorn_config(guarded, address)).run(sockets=[listening])


class _Server(uvicorn.Server):
    """A server that unloads the bench first when it shuts down, and then closes connections."""

    def __init__(self, config: uvicorn.Config, on_exit: Callable[[], None]) -> None:
        super().__init__(config)
        self._on_exit = on_exit

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Begin the shutdown with the bench; open connections get a few seconds."""
        self._on_exit()
        super().handle_exit(sig, frame)

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Shut down at Ctrl-C, at a request to terminate and when the terminal is closed."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        wanted = [signal.SIGINT, signal.SIGTERM]
        wanted += [signal.SIGHUP] if hasattr(signal, "SIGHUP") else []
        for number in wanted:
            signal.signal(number, self.handle_exit)
        yield  # the handlers stay, or a second signal would interrupt the unloading


def uvicorn_config(app: ASGIApp, address: Address, **options: Any) -> uvicorn.Config:
    """Return the settings of a server at an address."""
    return uvicorn.Config(
        app,
        log_level="warning",
        access_log=False,
        proxy_headers=bool(address.proxy),  # only the proxy may state a client's address
        forwarded_allow_ips=address.proxy or "",
        server_header=False,
        ssl_certfile=None if address.tls_cert is None else str(address.tls_cert),
        ssl_keyfile=None if address.tls_key is None else str(address.tls_key),
        **options,
    )


def listen(address: Address) -> socket.socket:
    """Return the listening socket of an address.

    Raises
    ------
    InputError
        The port is taken, or the address isn't one of this machine.
    """
    family = socket.AF_INET6 if ":" in address.host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((address.host, address.port))
        listening.listen(128)
    except OSError as error:
        listening.close()
        raise InputError(
            Message(
                "{host}:{port}: {strerror}", address.host, address.port, error.strerror or error
            ),
            "a free port of this machine",
            "give another --port, or --port 0 for any",
        ) from error
    return listening
