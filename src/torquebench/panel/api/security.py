"""Checks of every request before any page or operation: origin, host, size, headers."""

from __future__ import annotations

import asyncio
import ipaddress
import re
import time
from collections.abc import Iterable
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.types import Message as ServerMessage

from torquebench.message import Message
from torquebench.panel.address import ANY_ADDRESS
from torquebench.panel.api.problems import problem_response

LARGEST_BODY = 1024 * 1024
BODY_S = 30.0
"""Longest time to receive a request's body, s."""
API_POLICY = "default-src 'none'; frame-ancestors 'none'"
OWN_POLICY = (
    "default-src 'self'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self'; "
    "worker-src 'self' blob:; object-src 'none'; base-uri 'self'; form-action 'self'; "
    "frame-ancestors 'none'"
)
COMPILED_POLICY = OWN_POLICY.replace(
    "script-src 'self'", "script-src 'self' 'unsafe-inline' 'unsafe-eval'"
)
"""Policy for NiceGUI's pages, which use inline scripts and evaluate messages of the server."""
SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})


class Guard:
    """ASGI middleware that refuses foreign hosts and origins and large bodies, and adds headers.

    Parameters
    ----------
    app : ASGIApp
    hosts : iterable of str
        Host names of this server; `ANY_ADDRESS` means every numeric address; empty accepts every
        name.
    secure : bool
        Whether connections are encrypted; responses then have HSTS.
    compiled : iterable of str
        Paths of NiceGUI's pages, with parts in braces; they don't work without inline scripts and
        `eval`.
    """

    def __init__(
        self,
        app: ASGIApp,
        hosts: Iterable[str] = (),
        *,
        secure: bool = False,
        compiled: Iterable[str] = (),
    ) -> None:
        self._app = app
        self._hosts = frozenset(hosts)
        self._secure = secure
        paths = (re.sub(r"\{\w+\}", "[^/]+", path) for path in compiled)
        self._compiled = re.compile("|".join(paths))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse a request, or pass it to the application."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        # invalid path: some routers would continue after a line break
        if not scope["path"].isprintable():
            await _refuse(scope, receive, send, 404, "Not found", "a path with control characters")
            return
        headers = Headers(scope=scope)
        found = self._foreign(scope, headers)
        if found:
            await _refuse(scope, receive, send, 403, "Not allowed", found)
            return
        if scope["type"] == "websocket":
            await self._app(scope, receive, send)
            return
        declared = headers.get("content-length", "0")
        if not declared.isdigit() or int(declared) > LARGEST_BODY:
            found = Message(
                "a body of {declared} bytes, at most {largest_body} are accepted",
                declared[:20],
                LARGEST_BODY,
            )
            await _refuse(scope, receive, send, 413, "Too large", found)
            return
        await self._app(scope, _limited(receive), self._with_headers(scope, send))

    def _foreign(self, scope: Scope, headers: Headers) -> str:
        """Return why a request's host or origin isn't trusted; empty for a trusted one."""
        host = headers.get("host", "")
        if self._hosts and ("@" in host or not self._is_own(_name(f"//{host}"))):
            return Message("the host name {host!r} isn't this server's", host[:80])
        origin = headers.get("origin")
        if origin is None or (scope["type"] == "http" and scope["method"] in SAFE_METHODS):
            return ""
        if urlsplit(origin).netloc != host:
            return Message("a request from the pages of {origin!r}", origin[:80])
        return ""

    def _is_own(self, name: str) -> bool:
        if name in self._hosts:
            return True
        if ANY_ADDRESS not in self._hosts:
            return False
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return False
        return True

    def _with_headers(self, scope: Scope, send: Send) -> Send:
        api = scope["path"].startswith("/api/")
        policy = COMPILED_POLICY if self._compiled.fullmatch(scope["path"]) else OWN_POLICY

        async def sending(message: ServerMessage) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers["X-Content-Type-Options"] = "nosniff"
                headers["X-Frame-Options"] = "DENY"
                # otherwise forms have the origin "null"
                headers["Referrer-Policy"] = "same-origin"
                headers["Cross-Origin-Opener-Policy"] = "same-origin"
                headers["Cross-Origin-Resource-Policy"] = "same-origin"
                headers["Permissions-Policy"] = "camera=(), microphone=(), geolocation=()"
                headers["Content-Security-Policy"] = API_POLICY if api else policy
                if api:
                    headers["Cache-Control"] = "no-store"
                if self._secure:
                    headers["Strict-Transport-Security"] = "max-age=31536000"
            await send(message)

        return sending


def _name(url: str) -> str:
    try:
        return urlsplit(url).hostname or ""
    except ValueError:
        return ""


def _limited(receive: Receive) -> Receive:
    """Disconnect a sender whose body is too long or too slow."""
    taken, whole = 0, False
    until = time.monotonic() + BODY_S

    async def receiving() -> ServerMessage:
        nonlocal taken, whole
        if whole:  # the next message can only be a disconnect
            return await receive()
        try:
            message = await asyncio.wait_for(receive(), max(0.0, until - time.monotonic()))
        except TimeoutError:
            return {"type": "http.disconnect"}
        if message["type"] == "http.request":
            taken += len(message.get("body", b""))
            whole = not message.get("more_body", False)
            if taken > LARGEST_BODY:
                return {"type": "http.disconnect"}
        return message

    return receiving


async def _refuse(
    scope: Scope, receive: Receive, send: Send, status: int, title: str, found: str
) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 1008, "reason": title})
        return
    await problem_response(status, title, found)(scope, receive, send)
