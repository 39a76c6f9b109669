"""Limits on the duration and number of connections."""

from __future__ import annotations

import asyncio
import itertools
from typing import Any

from uvicorn.protocols.http.auto import AutoHTTPProtocol

HEAD_S = 30.0
"""Longest time to receive a request's head, s. Browsers use a connection that they opened in
advance within ten seconds, and don't retry if it was closed meanwhile.
"""
LAST_POLL_S = 0.1
"""Time for reading data that arrived while the process was busy, before a connection is closed,
s."""
LARGEST_HEAD = 64 * 1024
"""Longest head of a request, bytes; the parser itself has no limit."""
MOST_CONNECTIONS = 300
"""Largest number of connections, because the bench's files also need descriptors. Another one
replaces the longest idle one, so that a stop always gets through.
"""
FOR_STOPS = 50
"""Additional connections if none is idle; they may only stop the bench."""
STOPS = (b"POST /panel/stop ", b"POST /api/v1/stop ")

_TURNS = itertools.count(1)
"""Numbers the order in which connections became idle; the loop's clock is too coarse for this.
"""
_Base: Any = AutoHTTPProtocol


class PatientProtocol(_Base):
    """uvicorn's protocol with a timeout for receiving a request's head, which uvicorn lacks."""

    _patience: asyncio.TimerHandle | None = None
    _head = 0
    _idle_since = 0
    _begin: bytes | None = None
    """Data of a connection that may only stop the bench; None for any other."""

    def connection_made(self, transport: asyncio.Transport) -> None:
        """Accept a connection; if there are too many, close an idle one or allow only a stop."""
        super().connection_made(transport)
        self._idle_since = next(_TURNS)
        if len(self.connections) > MOST_CONNECTIONS:
            gone = self._dispensed()
            if gone is None and len(self.connections) > MOST_CONNECTIONS + FOR_STOPS:
                transport.abort()
                return
            if gone is None or gone._begin is not None:
                self._begin = b""
        self._wait()

    def _dispensed(self) -> PatientProtocol | None:
        """Close the longest idle connection, if there is one."""
        others = (each for each in self.connections if isinstance(each, PatientProtocol))
        idle = [each for each in others if each is not self and each._dispensable]
        gone = min(idle, key=lambda each: each._idle_since, default=None)
        if gone is not None:
            gone.transport.abort()
        return gone

    @property
    def _dispensable(self) -> bool:
        return (
            not self._answering
            and not self.transport.is_closing()
            and self.transport.get_protocol() is self
        )

    def data_received(self, data: bytes) -> None:
        """Receive data; the timeout of an incomplete request isn't extended by them."""
        if self._begin is not None:
            self._begin = (self._begin + data)[: len(STOPS[1])]
            if not any(self._begin.startswith(s[: len(self._begin)]) for s in STOPS):
                self.transport.abort()
                return
        super().data_received(data)
        if self.transport.is_closing() or self.transport.get_protocol() is not self:
            return
        if self._answering:
            self._served()
            return
        if self.cycle is None or not self.cycle.more_body:  # else a body to ignore
            self._head += len(data)
        if self._head > LARGEST_HEAD:
            self.transport.abort()
        elif self._patience is None:
            self._wait()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop the timeout of a lost connection."""
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
        """Mark the connection as idle."""
        self._idle_since = next(_TURNS)
        if self._begin is not None:
            self._begin = b""
        super().on_response_complete()

    def timeout_keep_alive_handler(self) -> None:
        """Close an idle connection after a last chance to read a waiting request."""
        close = super().timeout_keep_alive_handler
        self.timeout_keep_alive_task = self.loop.call_later(LAST_POLL_S, close)

    def _give_up(self) -> None:
        # The loop runs timers before it reads, so after a busy time a head may be unread.
        self._patience = self.loop.call_later(LAST_POLL_S, self._close)

    def _close(self) -> None:
        self._patience = None
        if self.transport.get_protocol() is self and not self._answering:
            self.transport.close()

    @property
    def _answering(self) -> bool:
        return self.cycle is not None and not self.cycle.response_complete
