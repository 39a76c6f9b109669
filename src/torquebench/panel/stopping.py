"""Handling of a stop with priority, on the server's front loop and separate threads."""

from __future__ import annotations

import asyncio
import time

from fastapi import FastAPI, Request
from fastapi.responses import JSONResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

from torquebench.panel.api import API_PATH
from torquebench.panel.api.access import address_of
from torquebench.panel.api.bench_routes import stop
from torquebench.panel.api.problems import add_handlers
from torquebench.panel.pages.visitor import SESSION_COOKIE
from torquebench.panel.service import Actor, BenchService, NotSignedInError

PAGE_STOP = "/panel/stop"
API_STOP = f"{API_PATH}/stop"


class StopFirst:
    """ASGI middleware that handles stops and passes other requests to the application.

    Parameters
    ----------
    app : ASGIApp
        Application for other requests.
    service : BenchService
    """

    def __init__(self, app: ASGIApp, service: BenchService) -> None:
        self._app = app
        self._stop = FastAPI(openapi_url=None, docs_url=None, redoc_url=None)
        self._stop.state.service = service
        self._stop.add_api_route(API_STOP, stop, methods=["POST"])
        self._stop.add_route(PAGE_STOP, _stop_of_a_page, methods=["POST"])
        add_handlers(self._stop)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle a stop, or pass the request on."""
        stops = scope["type"] == "http" and scope["method"] == "POST"
        found = stops and scope["path"] in (PAGE_STOP, API_STOP)
        await (self._stop if found else self._app)(scope, receive, send)


async def _stop_of_a_page(request: Request) -> Response:
    """Stop the bench for anyone who sees the page, without permission.

    The required header prevents requests from other sites, for which a browser asks permission
    first.
    """
    if request.headers.get("x-torquebench") != "panel":
        return JSONResponse({"stopped": False}, status_code=403)
    service: BenchService = request.app.state.service
    try:
        actor = service.people.actor(request.cookies.get(SESSION_COOKIE, ""))
    except NotSignedInError:
        actor = Actor("somebody not signed in", "operator", address_of(request))
    await asyncio.wrap_future(service.stop_aside(actor, "stop button on the panel"))
    return JSONResponse({"stopped": True, "at": time.time()})
