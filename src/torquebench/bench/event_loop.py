"""An event loop that reports when it is busy, so that simulated time waits for it."""

from __future__ import annotations

import asyncio
import selectors
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from _typeshed import FileDescriptorLike


class LoopActivity:
    """State of a loop: busy while it runs callbacks, or was woken and hasn't run them yet."""

    def __init__(self) -> None:
        self._waiting = False
        self._sent = 0
        self._received = 0
        self._ended = False
        self.on_idle: Callable[[], None] = lambda: None

    @property
    def busy(self) -> bool:
        """Whether the loop has something to do other than waiting."""
        return not self._ended and (not self._waiting or self._sent != self._received)

    def sent(self) -> None:
        """Record that the loop is about to be woken (called before it is woken)."""
        self._sent += 1

    def received(self) -> None:
        """Record that the callback that woke the loop has run (called on the loop)."""
        self._received += 1

    def waits(self, waiting: bool) -> None:
        """Record that the loop begins or stops waiting for an external event."""
        self._waiting = waiting
        if waiting:
            self.on_idle()

    def ends(self) -> None:
        """Record that the loop is closed."""
        self._ended = True
        self.on_idle()


class _WatchedSelector(selectors.BaseSelector):
    """The platform's selector; a loop that waits in it is idle."""

    def __init__(self, activity: LoopActivity) -> None:
        self._selector = selectors.DefaultSelector()
        self._activity = activity

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Wait for events, and mark the loop as waiting meanwhile."""
        if timeout is not None and timeout <= 0.0:
            return self._selector.select(timeout)
        self._activity.waits(True)
        try:
            return self._selector.select(timeout)
        finally:
            self._activity.waits(False)

    def register(
        self, fileobj: FileDescriptorLike, events: int, data: object = None
    ) -> selectors.SelectorKey:
        return self._selector.register(fileobj, events, data)

    def unregister(self, fileobj: FileDescriptorLike) -> selectors.SelectorKey:
        return self._selector.unregister(fileobj)

    def modify(
        self, fileobj: FileDescriptorLike, events: int, data: object = None
    ) -> selectors.SelectorKey:
        return self._selector.modify(fileobj, events, data)

    def get_map(self) -> Mapping[FileDescriptorLike, selectors.SelectorKey]:
        return self._selector.get_map()

    def close(self) -> None:
        self._selector.close()
        self._activity.ends()


def new_watched_loop() -> tuple[asyncio.AbstractEventLoop, LoopActivity]:
    """Create an event loop, and the object that reports whether it is busy."""
    activity = LoopActivity()
    return asyncio.SelectorEventLoop(_WatchedSelector(activity)), activity
