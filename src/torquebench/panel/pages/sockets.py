"""Protection of the pages' WebSockets: each is bound to a page and the session that opened it."""

from __future__ import annotations

import json
import re
from collections.abc import MutableMapping
from typing import Any
from urllib.parse import parse_qs

from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from torquebench.panel.pages.visitor import session_of
from torquebench.panel.service import NotSignedInError
from torquebench.panel.service.access.people import People

SOCKET_PATH = "/_nicegui_ws/"
REFUSED = 1008
TO_SIGN_IN = '42["open"'
"""Beginning of the message that redirects a page to sign-in after its session has ended."""
_PACKET = re.compile(r"4[0-9]+-?(?:/[^,]*,)?[0-9]*")


class PageSockets:
    """ASGI middleware that gives only a page's session access to the page's socket.

    The socket of a signed-in user's page needs the session's cookie, gets no data after the
    session's end, and can act only for this page. Polling is disabled, because its requests can't
    be assigned to a page.

    Parameters
    ----------
    app : ASGIApp
    people : People
    pages : mapping of str to str
        Token of the session that opened each page, by the page's identifier; empty without a
        session.
    """

    def __init__(self, app: ASGIApp, people: People, pages: MutableMapping[str, str]) -> None:
        self._app, self._people, self._pages = app, people, pages

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse a socket, or pass its messages to the application."""
        if scope["type"] not in ("http", "websocket") or SOCKET_PATH not in scope["path"]:
            await self._app(scope, receive, send)
            return
        if scope["type"] == "http":
            await PlainTextResponse("a WebSocket only", 400)(scope, receive, send)
            return
        query = parse_qs(scope["query_string"].decode("latin-1"))
        page = query.get("client_id", [""])[0]
        token = self._pages.get(page)
        if token is not None and (session_of(scope) != token or not self._lives(token)):
            await receive()
            await send({"type": "websocket.close", "code": REFUSED})
            return

        async def receiving() -> Message:
            while True:
                message = await receive()
                if message["type"] != "websocket.receive":
                    return message
                content = _content(message.get("text") or "")
                if content is None or not _concerns(page, content):
                    return {"type": "websocket.disconnect", "code": REFUSED}
                if content[:1] != ["log"]:  # so that outsiders can't write into the server's log
                    return message

        async def sending(message: Message) -> None:
            said = message.get("text") or ""
            if token is None or _is_harmless(message["type"], said) or self._lives(token):
                await send(message)

        await self._app(scope, receiving, sending)

    def _lives(self, token: str) -> bool:
        try:
            self._people.actor(token, touch=False)
        except NotSignedInError:
            return False
        return True


def _is_harmless(kind: str, said: str) -> bool:
    """Return whether a page of an ended session may get a message: engine.io's, or the redirect."""
    return kind != "websocket.send" or len(said) == 1 or said.startswith(TO_SIGN_IN)


def _content(text: str) -> list[Any] | None:
    """Return a packet's content; empty for engine.io's own packets, None if it isn't JSON."""
    begin = _PACKET.match(text)
    if begin is None or begin.end() == len(text):
        return []
    try:
        content = json.loads(text[begin.end() :])
    except (ValueError, RecursionError):
        return None
    return content if isinstance(content, list) else [content]


def _concerns(page: str, content: list[Any]) -> bool:
    """Return whether a packet's content names no other page than this one."""
    return all(part.get("client_id", page) == page for part in content if isinstance(part, dict))
