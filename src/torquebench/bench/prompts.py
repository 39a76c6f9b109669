"""Requests to the person at the bench, which terminal and panel can both answer."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from torquebench.bench.roles import Mounting, Seating
from torquebench.errors import InterlockError
from torquebench.message import Message


@dataclass(frozen=True)
class Prompt:
    """One request to a person.

    Parameters
    ----------
    number : int
        Number of the request, which an answer must state. Numbers aren't reused after a restart.
    text : str
        The request.
    """

    number: int
    text: str


OnPrompt = Callable[[Prompt], None]


class PromptQueue:
    """Queue of requests that wait for an answer; the first answer counts.

    Examples
    --------
    >>> prompts = PromptQueue()
    >>> with prompts.watching(lambda prompt: prompts.answer(prompt.number, done=True, who="Ana")):
    ...     prompts.ask("Mount the calibrator.")
    'Ana'
    """

    def __init__(self) -> None:
        self._numbers = itertools.count(time.time_ns() // 1_000_000)
        self._changed = threading.Condition()
        self._watchers: list[OnPrompt] = []
        self._pending: Prompt | None = None
        self._answer: tuple[bool, str] | None = None

    @property
    def pending(self) -> Prompt | None:
        """The waiting request, or None."""
        return self._pending

    @contextmanager
    def watching(self, on_prompt: OnPrompt) -> Iterator[None]:
        """Register a function that is called with every request, on a separate thread.

        If a request is already waiting, the function is called with it at once.
        """
        with self._changed:
            self._watchers.append(on_prompt)
            waiting = self._pending
        if waiting is not None:
            _tell(on_prompt, waiting)
        try:
            yield
        finally:
            with self._changed:
                self._watchers.remove(on_prompt)

    def ask(self, text: str) -> str:
        """Make a request and wait for the answer; return the person who answered.

        Raises
        ------
        InterlockError
            A person declines, the request is cancelled, or another request is already waiting.
        """
        with self._changed:
            if self._pending is not None:
                raise InterlockError(
                    "a question to the operator while another one is open", "one after the other"
                )
            prompt = Prompt(next(self._numbers), text)
            self._pending, self._answer = prompt, None
            watchers = tuple(self._watchers)
        for watcher in watchers:
            _tell(watcher, prompt)
        with self._changed:
            self._changed.wait_for(lambda: self._answer is not None)
            assert self._answer is not None
            done, who = self._answer
            self._pending = self._answer = None
        if not done:
            raise InterlockError(
                Message("{who} declined: {text}", who or "the operator", text), "a confirmation"
            )
        return who

    def answer(self, number: int, *, done: bool, who: str = "") -> bool:
        """Answer a request; return whether this was the answer that counts."""
        with self._changed:
            pending = self._pending
            if pending is None or pending.number != number or self._answer is not None:
                return False
            self._answer = (done, who)
            self._changed.notify_all()
            return True

    def cancel(self, reason: str = "the run") -> None:
        """Decline the waiting request, if there is one."""
        if self._pending is not None:
            self.answer(self._pending.number, done=False, who=reason)


def _tell(watcher: OnPrompt, prompt: Prompt) -> None:
    threading.Thread(
        target=watcher, args=(prompt,), name=f"operator prompt {prompt.number}", daemon=True
    ).start()


class QueuedOperator:
    """The operator of a real bench, asked through a queue; see `drivers.base.OperatorPrompts`.

    Parameters
    ----------
    prompts : PromptQueue
        Queue of the requests.
    mounted : str
        Initial mounting between the flanges, as far as known.
    """

    def __init__(self, prompts: PromptQueue, mounted: Mounting = "nothing") -> None:
        self.prompts = prompts
        self._mounted: Mounting = mounted

    def mount(self, mounting: Mounting) -> None:
        """Request that a part is put between the flanges."""
        what = mounting.replace("_", " ")
        if mounting == "nothing":
            self.prompts.ask(
                Message("Take the {what} out of the bench.", self._mounted.replace("_", " "))
            )
        else:
            self.prompts.ask(Message("Mount the {what} between the flanges.", what))
        self._mounted = mounting

    def mounted(self) -> Mounting:
        """Return the mounting between the flanges, by the last confirmation."""
        return self._mounted

    def seat(self, seating: Seating) -> None:
        """Request that the mounted part is turned or seated again."""
        what = self._mounted.replace("_", " ")
        if seating.change == "rotation":
            self.prompts.ask(
                Message(
                    "Rotate the {what} to {position:g}° and seat it again.",
                    what,
                    seating.position_deg,
                )
            )
        else:
            self.prompts.ask(
                Message(
                    "Take the {what} out and seat it again at {position:g}°.",
                    what,
                    seating.position_deg,
                )
            )

    def cancel(self) -> None:
        """Stop waiting, because the run ends."""
        self.prompts.cancel()
