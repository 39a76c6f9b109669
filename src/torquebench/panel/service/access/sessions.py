"""Sessions of signed-in people by secret tokens, which are stored as hashes and expire."""

from __future__ import annotations

import contextlib
import hashlib
import secrets
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from sqlalchemy import delete, insert, select, update

from torquebench.errors import RecordError
from torquebench.panel.service.access.actors import Actor
from torquebench.panel.service.problems import NotSignedInError
from torquebench.panel.service.store import PanelStore, sessions
from torquebench.records.accounts import users
from torquebench.units import HOUR

Later: TypeAlias = Callable[[Callable[[], None]], object]

IDLE_S = 3600.0
"""Idle time after which a session ends, s."""
LONGEST_S = 12 * HOUR
"""Longest duration of a session, one shift, s."""
TOUCH_S = 60.0
"""Interval at which the time of the last action is stored, s."""


def at_once(action: Callable[[], None]) -> None:
    """Run a task at once, in the calling thread."""
    action()


def token_sha256(token: str) -> str:
    """Return the stored hash of a token, which is random enough for a plain hash."""
    return hashlib.sha256(token.encode()).hexdigest()


@dataclass
class _Open:
    actor: Actor
    user_id: int
    created: float
    seen: float
    written: float


class Sessions:
    """Open sessions, in memory for speed and in the store so that they survive a restart.

    Parameters
    ----------
    store : PanelStore
    now : callable
        Seconds since 1970.
    later : callable
        Schedules a write, so that looking up a session doesn't wait for the disk.
    """

    def __init__(
        self,
        store: PanelStore,
        now: Callable[[], float] = time.time,
        later: Later = at_once,
    ) -> None:
        self._store = store
        self._now = now
        self._later = later
        self._writing = threading.Lock()
        self._lock = threading.Lock()  # not held during writing
        self._open: dict[str, _Open] = {}
        with store.transaction(reading=True) as connection:
            query = select(sessions, users.c.name, users.c.role).join(
                users, users.c.id == sessions.c.user_id
            )
            for row in connection.execute(query.where(users.c.active)):
                self._remember(
                    row.token_sha256, row.user_id, row.name, row.role, row.created, row.seen
                )

    def _remember(
        self, key: str, user_id: int, name: str, role: str, created: float, seen: float
    ) -> None:
        actor = Actor(name, role, key[:16])  # type: ignore[arg-type]
        self._open[key] = _Open(actor, user_id, created, seen, seen)

    def open(self, user_id: int, address: str) -> str:
        """Open a session and return its token."""
        token = secrets.token_urlsafe(32)
        key, now = token_sha256(token), self._now()
        with self._writing:
            with self._store.transaction() as connection:
                connection.execute(delete(sessions).where(sessions.c.created < now - LONGEST_S))
                user = connection.execute(
                    select(users).where(users.c.id == user_id, users.c.active)
                ).one_or_none()
                if user is None:  # the account was closed after the password check
                    raise NotSignedInError("an account that was closed", "an active account")
                connection.execute(
                    insert(sessions).values(
                        token_sha256=key, user_id=user_id, address=address, created=now, seen=now
                    )
                )
            with self._lock:
                expired = [
                    each for each, found in self._open.items() if not self._alive(found, now)
                ]
                for each in expired:
                    del self._open[each]
                self._remember(key, user_id, user.name, user.role, now, now)
        return token

    def find(self, token: str, *, touch: bool) -> Actor | None:
        """Return the owner of a token; None if it is unknown or has expired."""
        key, now = token_sha256(token), self._now()
        with self._lock:
            found = self._open.get(key)
            if found is None or not self._alive(found, now):
                return None
            if touch:
                found.seen = now
            due = found.seen - found.written > TOUCH_S
            if due:
                found.written = found.seen
        if due:
            self._later(lambda: self._write_seen(key, found.seen))
        return found.actor

    def _write_seen(self, key: str, seen: float) -> None:
        with contextlib.suppress(RecordError), self._store.transaction() as connection:
            connection.execute(
                update(sessions).where(sessions.c.token_sha256 == key).values(seen=seen)
            )

    def lives(self, session_id: str) -> bool:
        """Whether a session with this identifier is open."""
        now = self._now()
        with self._lock:
            return any(
                each.actor.session_id == session_id and self._alive(each, now)
                for each in self._open.values()
            )

    def close(self, token: str) -> None:
        """End one session."""
        self._close([token_sha256(token)])

    def close_all(self, user_id: int, keep: str | None = None) -> None:
        """End every session of a person, except the one with this identifier."""
        with self._lock:
            ended = [
                key
                for key, each in self._open.items()
                if each.user_id == user_id and each.actor.session_id != keep
            ]
        self._close(ended)

    def _close(self, keys: Sequence[str]) -> None:
        """End sessions at once, even if that can't be stored."""
        with self._writing:
            with self._lock:
                for key in keys:
                    self._open.pop(key, None)
            with self._store.transaction() as connection:
                connection.execute(delete(sessions).where(sessions.c.token_sha256.in_(keys)))

    def oldest(self) -> float:
        """Time before which unused sessions have expired."""
        return self._now() - IDLE_S

    @staticmethod
    def _alive(session: _Open, now: float) -> bool:
        return now - session.seen <= IDLE_S and now - session.created <= LONGEST_S
