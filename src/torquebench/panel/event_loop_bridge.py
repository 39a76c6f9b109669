"""Two event loops: the front loop forwards messages and stops the bench, the other does the rest.

The front loop accepts connections however long a page or an operation computes on the back loop, so
that a stop never waits.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Awaitable, Callable
from concurrent.futures import Future
from typing import Any, Self

from starlette.types import ASGIApp, Message, Receive, Scope, Send


class EventLoopBridge:
    """ASGI application that runs another application on a separate event loop.

    Parameters
    ----------
    app : ASGIApp
        The application, which is called on a separate thread within the context manager's block.
    loop_factory : callable, optional
        Creates the loop of that thread.
    """

    def __init__(
        self, app: ASGIApp, loop_factory: Callable[[], asyncio.AbstractEventLoop] | None = None
    ) -> None:
        self._app = app
        self._factory = loop_factory
        self._loop: asyncio.AbstractEventLoop | None = None
        self._ended: asyncio.Event | None = None
        self._began = threading.Event()
        self._thread = threading.Thread(target=self._run, name="torquebench-pages", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        self._began.wait()
        return self

    def __exit__(self, *_: object) -> None:
        assert self._loop is not None
        assert self._ended is not None
        self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join()

    def _run(self) -> None:
        with asyncio.Runner(loop_factory=self._factory) as runner:
            runner.run(self._until_ended())

    async def _until_ended(self) -> None:
        self._loop, self._ended = asyncio.get_running_loop(), asyncio.Event()
        self._began.set()
        await self._ended.wait()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Run the application on the back loop, and forward its messages."""
        assert self._loop is not None
        front = asyncio.get_running_loop()

        async def receiving() -> Message:
            """Return the client's next message, awaited on the front loop."""
            message: Message = await _on(front, receive())
            return message

        async def sending(message: Message) -> None:
            """Send a message to the client on the front loop."""
            await _on(front, send(message))

        await _on(self._loop, self._app(scope, receiving, sending))


async def _on(loop: asyncio.AbstractEventLoop, work: Awaitable[Any]) -> Any:
    """Await work on another loop; a cancellation is passed on."""

    async def awaited() -> Any:
        return await work

    found: Future[Any] = asyncio.run_coroutine_threadsafe(awaited(), loop)
    return await asyncio.wrap_future(found)
