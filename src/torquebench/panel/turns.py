"""Limit the rate of requests without a valid session or token, fairly between addresses."""

from __future__ import annotations

import asyncio
import time
from collections import OrderedDict, deque

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Receive, Scope, Send

from torquebench.panel.api.access import caller_of
from torquebench.panel.api.problems import problem_response
from torquebench.panel.pages.visitor import session_of
from torquebench.panel.service import BenchService, NotSignedInError

__all__ = ["Turns"]

A_SECOND = 50.0
"""Sustained rate of requests without a session from all addresses together, 1/s."""
AT_ONCE = 150.0
"""Number of requests that pass without waiting after a quiet time."""
MOST_WAITING = 100
"""Largest number of waiting requests of one address; further ones are refused."""
MOST_WAITING_OF_ALL = 1000


class Turns:
    """ASGI middleware in which requests without a session wait, with a turn per address.

    Requests with a valid session or token pass at once. A stop bypasses this.

    Parameters
    ----------
    app : ASGIApp
    service : BenchService
        Service with the signed-in users.
    """

    def __init__(self, app: ASGIApp, service: BenchService) -> None:
        self._app, self._service = app, service
        self._free, self._looked = AT_ONCE, time.monotonic()
        self._waiting: OrderedDict[str, deque[asyncio.Future[None]]] = OrderedDict()
        self._giving: asyncio.Task[None] | None = None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on when it is its turn."""
        if scope["type"] == "http" and not self._knows(scope):
            client = scope.get("client")
            if not await self._turn(client[0] if client else ""):
                refusal = problem_response(
                    429,
                    "Too many requests",
                    f"more than {MOST_WAITING} unauthenticated requests are waiting",
                    remedy="wait a moment, or sign in",
                    headers={"Retry-After": "2", "Connection": "close"},
                )
                await refusal(scope, receive, send)
                return
        await self._app(scope, receive, send)

    def _knows(self, scope: Scope) -> bool:
        kind, _, token = Headers(scope=scope).get("authorization", "").partition(" ")
        try:
            if kind.lower() == "bearer":
                caller_of(self._service, token.strip(), touch=False)
            else:
                self._service.people.actor(session_of(scope), touch=False)
        except NotSignedInError:
            return False
        return True

    async def _turn(self, address: str) -> bool:
        """Wait for a turn; return False if too many requests are waiting."""
        if not self._waiting and self._take():
            return True
        turns = self._waiting.get(address, deque())
        if len(turns) >= MOST_WAITING or self._count() >= MOST_WAITING_OF_ALL:
            return False
        turns.append(turn := asyncio.get_running_loop().create_future())
        self._waiting[address] = turns
        if self._giving is None:
            self._giving = asyncio.create_task(self._give())
        await turn
        return True

    def _count(self) -> int:
        return sum(len(turns) for turns in self._waiting.values())

    def _take(self) -> bool:
        now = time.monotonic()
        self._free = min(AT_ONCE, self._free + (now - self._looked) * A_SECOND)
        self._looked = now
        if self._free < 1.0:
            return False
        self._free -= 1.0
        return True

    async def _give(self) -> None:
        """Give turns to waiting requests; an address that had a turn goes to the queue's end."""
        while self._waiting:
            if not self._take():
                await asyncio.sleep(1.0 / A_SECOND)
                continue
            address, turns = self._waiting.popitem(last=False)
            turn = turns.popleft()
            if turns:
                self._waiting[address] = turns
            if not turn.done():
                turn.set_result(None)
        self._giving = None
