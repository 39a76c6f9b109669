"""Connections that wait for what never comes: how long, and how many."""

from __future__ import annotations

import asyncio
from typing import Any

from uvicorn.protocols.http.auto import AutoHTTPProtocol

__all__ = ["MOST_CONNECTIONS", "PatientProtocol"]

HEAD_S = 30.0
"""How long a request's head may take to come whole, s. Browsers use a connection that they have
opened in advance for ten seconds, and don't try again where it is closed meanwhile."""
LAST_LOOK_S = 0.1
"""What has come while this process had no time is read before a connection is closed, s."""
LARGEST_HEAD = 64 * 1024
"""How long it may be, bytes: the parser has no limit of its own."""
MOST_CONNECTIONS = 300
"""At one time, of everybody: the bench's own files need descriptors too. One more takes the place
of the longest idle one of the address that has the most, so that a stop always gets in."""

_Base: Any = AutoHTTPProtocol


class PatientProtocol(_Base):
    """uvicorn's protocol, with a limit to its patience: it has none for a head that trickles."""

    _patience: asyncio.TimerHandle | None = None
    _head = 0
    _idle_since = 0.0

    def connection_made(self, transport: asyncio.Transport) -> None:
        """Take a connection; where there are too many, an idle one has to go for it."""
        super().connection_made(transport)
        self._idle_since = self.loop.time()
        if len(self.connections) > MOST_CONNECTIONS and not self._make_room():
            transport.abort()
            return
        self._wait()

    def _make_room(self) -> bool:
        """Close the longest idle connection of the address that has the most of them."""
        idle: dict[str, list[PatientProtocol]] = {}
        for each in self.connections:
            if isinstance(each, PatientProtocol) and each is not self and each._dispensable:
                idle.setdefault(each.client[0] if each.client else "", []).append(each)
        if not idle:
            return False
        crowd = max(idle.values(), key=len)
        min(crowd, key=lambda each: each._idle_since).transport.abort()
        return True

    @property
    def _dispensable(self) -> bool:
        return (
            not self._answering
            and not self.transport.is_closing()
            and self.transport.get_protocol() is self
        )

    def data_received(self, data: bytes) -> None:
        """Take bytes; a request that isn't whole yet doesn't get new time by each of them."""
        super().data_received(data)
        if self.transport.is_closing() or self.transport.get_protocol() is not self:
            return
        if self._answering:
            self._served()
            return
        if self.cycle is None or not self.cycle.more_body:  # else a body that nobody wants
            self._head += len(data)
        if self._head > LARGEST_HEAD:
            self.transport.abort()
        elif self._patience is None:
            self._wait()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._served()
        super().connection_lost(exc)

    def _wait(self) -> None:
        self._patience = self.loop.call_later(HEAD_S, self._give_up)

    def _served(self) -> None:
        self._head = 0
        if self._patience is not None:
            self._patience.cancel()
            self._patience = None

    def on_response_complete(self) -> None:
        """Be idle from now on."""
        self._idle_since = self.loop.time()
        super().on_response_complete()

    def timeout_keep_alive_handler(self) -> None:
        """Close a connection that rests; a request that waits to be read comes first."""
        close = super().timeout_keep_alive_handler
        self.timeout_keep_alive_task = self.loop.call_later(LAST_LOOK_S, close)

    def _give_up(self) -> None:
        # The loop looks at its clock before it reads: after a pause, a head may be there unread.
        self._patience = self.loop.call_later(LAST_LOOK_S, self._close)

    def _close(self) -> None:
        self._patience = None
        if self.transport.get_protocol() is self and not self._answering:
            self.transport.close()

    @property
    def _answering(self) -> bool:
        return self.cycle is not None and not self.cycle.response_complete
