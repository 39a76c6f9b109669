"""Limits on the time and length of a request's head."""

from __future__ import annotations

import asyncio
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
_Base: Any = AutoHTTPProtocol


class PatientProtocol(_Base):
    """uvicorn's protocol with a timeout for receiving a request's head, which uvicorn lacks."""

    _patience: asyncio.TimerHandle | None = None
    _head = 0

    def connection_made(self, transport: asyncio.Transport) -> None:
        """Accept a connection and wait for its first request."""
        super().connection_made(transport)
        self._wait()

    def data_received(self, data: bytes) -> None:
        """Receive data; the timeout of an incomplete request isn't extended by them."""
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
