"""The command lease: one session commands the bench, the others watch.

A command renews the holder's lease. A program gives it up by idling for `PROGRAM_IDLE_S` while
nothing runs, because it may have died; its next command takes the free lease again. Anybody may
take it over after its holder has signed out, or has been idle for `IDLE_S` while nothing runs. The
same person may take it over from another browser at any time, and a metrologist or administrator
whose role isn't below the holder's may do so by force. A program can take it over from a person
only while nothing runs. Every change is logged. A stop needs no lease.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from torquebench.message import Message
from torquebench.operations import allows
from torquebench.panel.service.access.actors import Actor
from torquebench.panel.service.problems import LeaseError
from torquebench.units import MINUTE

IDLE_S = 120.0
"""Idle time after which another user may take over the lease, s."""

PROGRAM_IDLE_S = 30.0
"""Idle time after which a program has given up the lease, s."""


@dataclass(frozen=True)
class LeaseState:
    """The holder of the command lease.

    Parameters
    ----------
    holder : str or None
        Name of the holder; None without one.
    session_id : str or None
        Session of the holder, to compare with an actor's own session.
    since_s, idle_s : float
        How long ago the lease was taken, and how long ago it was last used, s of wall time.
    """

    holder: str | None
    session_id: str | None
    since_s: float = 0.0
    idle_s: float = 0.0


class CommandLease:
    """The command lease; safe to use from any thread.

    Parameters
    ----------
    note : callable
        Called with an actor and the action, to log it.
    lives : callable
        Returns whether an actor's session is still open.
    working : callable
        Returns whether a job is running; the lease doesn't become free by idling then.
    now : callable
        Returns the time of a monotonic clock, s.

    Examples
    --------
    >>> lease = CommandLease()
    >>> ana, ben = Actor("ana", "operator", "1"), Actor("ben", "metrologist", "2")
    >>> lease.take(ana)
    >>> lease.state().holder
    'ana'
    >>> lease.may_take(ben)
    (False, 'ana is in command of the bench')
    >>> lease.take(ben, force=True)
    >>> lease.require(ana)
    Traceback (most recent call last):
    ...
    torquebench.panel.service.problems.LeaseError: ben is in command of the bench; allowed: ...
    """

    def __init__(
        self,
        note: Callable[[Actor, str], None] = lambda _actor, _what: None,
        lives: Callable[[Actor], bool] = lambda _actor: True,
        working: Callable[[], bool] = lambda: False,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self._note = note
        self._lives = lives
        self._working = working
        self._now = now
        self._lock = threading.RLock()
        self._holder: Actor | None = None
        self._since = self._used = 0.0

    def state(self) -> LeaseState:
        """Return the state of the lease."""
        with self._lock:
            holder = self._current()
            if holder is None:
                return LeaseState(None, None)
            now = self._now()
            return LeaseState(holder.label, holder.session_id, now - self._since, now - self._used)

    def _current(self) -> Actor | None:
        """Return the holder, to be called with the lock; end the lease of one who has gone."""
        holder = self._holder
        if holder is None:
            return None
        if not self._lives(holder):
            self._holder = None
        elif holder.kind == "client" and self._working():
            self._used = self._now()
        elif holder.kind == "client" and self._now() - self._used > PROGRAM_IDLE_S:
            self._holder = None
            self._note(holder, "gave up command")
        return self._holder

    def holds(self, actor: Actor) -> bool:
        """Whether this actor's session holds the lease."""
        with self._lock:
            holder = self._current()
        return holder is not None and holder.session_id == actor.session_id

    def may_take(self, actor: Actor) -> tuple[bool, str]:
        """Return whether this session may take the lease without force, and the reason if not."""
        with self._lock:
            holder = self._current()
            if holder is None or holder.session_id == actor.session_id:
                return True, ""
            same_person = holder.kind == actor.kind == "person" and holder.name == actor.name
            idle = self._now() - self._used > IDLE_S and not self._working()
            if same_person or idle:
                return True, ""
            return False, Message("{who} is in command of the bench", holder.label)

    def take(self, actor: Actor, *, force: bool = False) -> None:
        """Take the lease.

        Raises
        ------
        LeaseError
            Another session holds the lease, and the module's rules don't allow taking it over.
        """
        with self._lock:
            holder = self._current()
            allowed, reason = self.may_take(actor)
            if not allowed:
                assert holder is not None
                strong = allows(actor.role, "metrologist") and allows(actor.role, holder.role)
                if actor.kind == "client" and holder.kind == "person" and self._working():
                    strong = False  # a program can't take a running bench from a person
                if not (force and strong):
                    raise LeaseError(
                        reason,
                        "one session at a time",
                        Message(
                            "wait until command is given up{idle_s}",
                            ", or take it over"
                            if strong
                            else Message(" or {idle_s:g} min idle", IDLE_S / MINUTE),
                        ),
                    )
            now = self._now()
            changed = holder is None or holder.session_id != actor.session_id
            self._holder, self._used = actor, now
            if changed:
                self._since = now
        if changed:
            taken = (
                "took the command"
                if holder is None
                else Message("took command from {label}", holder.label)
            )
            self._note(actor, taken)

    def give_back(self, actor: Actor) -> None:
        """Give the lease back; no effect for a session without it."""
        with self._lock:
            if not self.holds(actor):
                return
            self._holder = None
        self._note(actor, "gave up command")

    def require(self, actor: Actor) -> None:
        """Raise an error if the session doesn't hold the lease; otherwise renew the lease.

        Raises
        ------
        LeaseError
            Another session has the lease, or none has it.
        """
        with self._lock:
            holder = self._current()
            if holder is None:
                raise LeaseError(
                    "nobody is in command of the bench",
                    "the session in command",
                    "take the command",
                )
            if holder.session_id != actor.session_id:
                raise LeaseError(
                    Message("{who} is in command of the bench", holder.label),
                    "the session in command",
                    "watch, or take command",
                )
            self._used = self._now()
