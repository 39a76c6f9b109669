"""Connections that wait for what never comes: how long, and how many."""

from __future__ import annotations

import asyncio
from typing import Any

from uvicorn.protocols.http.auto import AutoHTTPProtocol

__all__ = ["MOST_CONNECTIONS", "PatientProtocol"]

HEAD_S = 10.0
"""How long a request's head may take to come whole, s."""
MOST_CONNECTIONS = 300
"""At one time, of everybody: the bench's own files need descriptors too."""

_Base: Any = AutoHTTPProtocol


class PatientProtocol(_Base):
    """uvicorn's protocol, with a limit to its patience: it has none for a head that trickles."""

    _patience: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:
        """Take a connection, unless there are too many."""
        super().connection_made(transport)
        if len(self.connections) > MOST_CONNECTIONS:
            transport.abort()
            return
        self._wait()

    def data_received(self, data: bytes) -> None:
        """Take bytes; a request that isn't whole yet doesn't get new time by each of them."""
        super().data_received(data)
        if self.cycle is not None and not self.cycle.response_complete:
            self._served()
        elif self._patience is None and not self.transport.is_closing():
            self._wait()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._served()
        super().connection_lost(exc)

    def _wait(self) -> None:
        self._patience = self.loop.call_later(HEAD_S, self._give_up)

    def _served(self) -> None:
        if self._patience is not None:
            self._patience.cancel()
            self._patience = None

    def _give_up(self) -> None:
        self._patience = None
        upgraded = self.transport.get_protocol() is not self
        answering = self.cycle is not None and not self.cycle.response_complete
        if not (upgraded or answering):
            self.transport.close()
