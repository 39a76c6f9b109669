"""People and clients: who may sign in, who is signed in, and with which role."""

from __future__ import annotations

import re
import secrets
import threading
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, Row, delete, func, insert, select, update

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations import Role
from torquebench.panel.service.access.actors import Actor, check_role, require
from torquebench.panel.service.access.login_throttle import LoginThrottle
from torquebench.panel.service.access.passwords import check_password_rules, hash_password, matches
from torquebench.panel.service.access.sessions import Later, Sessions, at_once
from torquebench.panel.service.problems import (
    NameTakenError,
    NotFoundError,
    NotSignedInError,
    PermissionDeniedError,
    SignInError,
)
from torquebench.panel.service.store import PanelStore, note, sessions, utc_text
from torquebench.records.accounts import name_key, password_settings, system_users, users

SYSTEM_USER = re.compile(r"[^\s@]{1,64}(@[^\s@]{1,253})?")
NAME = re.compile(r"[^\W_][\w .'-]{0,62}[\w.]")
SETUP = "set-up"
RESERVED = frozenset({"set-up", "station", "panel", "system", "bench", "nobody", "torquebench"})
"""Names that logs use for actors other than people."""


@dataclass(frozen=True)
class User:
    """An account of a person.

    `system_users` are the same person's users of the operating system, as ``user`` or
    ``user@host``; `password_set` says when and by whom else the password was last set.
    """

    name: str
    role: Role
    active: bool
    created: str
    system_users: tuple[str, ...] = ()
    password_set: str = ""


class People:
    """Accounts of a data directory and their sessions.

    Parameters
    ----------
    store : PanelStore
    now : callable
        Seconds since 1970.
    later : callable
        Schedules a write without waiting for it.
    """

    def __init__(
        self,
        store: PanelStore,
        now: Callable[[], float] = time.time,
        later: Later = at_once,
    ) -> None:
        self._store = store
        self._guard = LoginThrottle(store, now)
        self._sessions = Sessions(store, now, later)
        self._lock = threading.Lock()
        self._setup_code = None if self._has_administrator() else _setup_code()

    # -- first start ------------------------------------------------------------------------

    @property
    def setup_code(self) -> str | None:
        """The code for creating the first administrator; None if there is one.

        It is printed on the server's console only.
        """
        return self._setup_code

    def set_up(self, code: str, name: str, password: str, address: str) -> str:
        """Create the first administrator with the code on the console; return a session token.

        Raises
        ------
        SignInError
            The code is wrong, or there is an administrator already.
        InputError
            Name or password break the rules.
        """
        attempt = self._guard.attempt(SETUP, address)
        with self._lock:
            expected = self._setup_code
            if expected is None:
                self._guard.succeeded(attempt)
                raise SignInError("this panel has an administrator", "", "sign in")
            if not secrets.compare_digest(_bare(code), _bare(expected)):
                raise SignInError("a wrong set-up code", "the code on the server's console")
            self._guard.succeeded(attempt)
            self._insert(name, "administrator", password, by="set-up")
            self._setup_code = None
        return self.sign_in(name, password, address)

    def _has_administrator(self) -> bool:
        with self._store.transaction(reading=True) as connection:
            query = (
                select(func.count())
                .select_from(users)
                .where(users.c.role == "administrator", users.c.active)
            )
            return bool(connection.scalar(query))

    # -- sessions ---------------------------------------------------------------------------

    def sign_in(self, name: str, password: str, address: str) -> str:
        """Open a session; return its token, which only the person's browser may know.

        Raises
        ------
        SignInError
            Name or password is wrong; the message doesn't say which.
        LockedOutError
            Too many wrong attempts.
        """
        row = self._checked(name, password, address)
        with self._store.transaction() as connection:
            note(connection, row.name, "signed in", address=address)
        return self._sessions.open(row.id, address)

    def _checked(self, name: str, password: str, address: str) -> Row[Any]:
        key = name_key(name)
        attempt = self._guard.attempt(key, address)
        row = self._row(key)
        stored = None if row is None or not row.active else row.password_hash
        if not matches(stored, password) or row is None:  # takes equally long for unknown names
            self._store.note(key[:64], "failed to sign in", address=address)
            raise SignInError(
                "name and password don't belong together", "", "check both and try again"
            )
        self._guard.succeeded(attempt)
        return row

    def actor(self, token: str | None, *, touch: bool = True) -> Actor:
        """Return the owner of a session.

        Parameters
        ----------
        token : str or None
        touch : bool
            Whether this is an action of the person, which keeps the session alive; repainting a
            page isn't.

        Raises
        ------
        NotSignedInError
            The session doesn't exist, or has expired.
        """
        found = self._sessions.find(token or "", touch=touch)
        if found is None:
            raise NotSignedInError("nobody is signed in", "a session", "sign in")
        return found

    def signed_in(self, session_id: str) -> bool:
        """Whether a session is still open."""
        return self._sessions.lives(session_id)

    def sign_out(self, token: str) -> None:
        """End a session, if it exists."""
        actor = self._sessions.find(token, touch=False)
        if actor is not None:
            self._sessions.close(token)
            self._store.note(actor.name, "signed out")

    def confirm_password(self, actor: Actor, password: str, address: str = "signing") -> None:
        """Check the password of the signed-in person before signing.

        Raises
        ------
        PermissionDeniedError
            The actor is a client, which can't sign.
        SignInError, LockedOutError
            As in `sign_in`.
        """
        if actor.kind != "person":
            raise PermissionDeniedError(
                Message("{name} signs", actor.label), "a person's signature"
            )
        self._checked(actor.name, password, address)

    def identify(self, name: str, password: str, address: str) -> Actor:
        """Return the person with a name and password, for a connection without a session.

        `signed_in` doesn't know this connection: check `user` before later actions of the person.

        Raises
        ------
        SignInError, LockedOutError
            As in `sign_in`.
        """
        row = self._checked(name, password, address)
        self._store.note(row.name, "signed in", address=address)
        return Actor(row.name, row.role, f"{address}-{row.id}")

    # -- accounts ---------------------------------------------------------------------------

    def users(self, actor: Actor) -> list[User]:
        """Return all accounts, by name; for administrators."""
        require(actor, "administrator")
        with self._store.transaction(reading=True) as connection:
            rows = connection.execute(select(users).order_by(users.c.key)).all()
            return [_user(connection, row) for row in rows]

    def add_user(self, actor: Actor, name: str, role: Role, password: str) -> User:
        """Add an account.

        Raises
        ------
        PermissionDeniedError
            The actor isn't an administrator.
        InputError
            The name exists already, or name, role or password is invalid.
        """
        require(actor, "administrator")
        self._insert(name, role, password, by=actor.label)
        return self.user(name)

    def user(self, name: str) -> User:
        """Return one account.

        Raises
        ------
        NotFoundError
            There is no account of this name.
        """
        row = self._known(name)
        with self._store.transaction(reading=True) as connection:
            return _user(connection, row)

    def names(self) -> tuple[str, ...]:
        """Return the names of all people with an active account."""
        with self._store.transaction(reading=True) as connection:
            query = select(users.c.name).where(users.c.active).order_by(users.c.name)
            return tuple(connection.scalars(query))

    def change_user(
        self,
        actor: Actor,
        name: str,
        *,
        role: Role | None = None,
        active: bool | None = None,
        password: str | None = None,
        unlock: bool = False,
        linked: Collection[str] | None = None,
    ) -> User:
        """Change an account and end its sessions; a new password also ends its lock.

        `unlock` alone ends the pause after wrong passwords, and no session. `linked` are all users
        of the operating system that are this person, as ``user`` or ``user@host``. If somebody else
        sets a password, this is recorded, and certificates mention it for 30 days.

        Raises
        ------
        PermissionDeniedError
            The actor isn't an administrator.
        NotFoundError
            The account doesn't exist.
        InputError
            A value is invalid, or no administrator would remain.
        """
        require(actor, "administrator")
        row = self._known(name)
        if unlock:
            self._guard.release(row.key)
            self._store.note(actor.label, "let an account try again", name=row.name)
        values: dict[str, Any] = {}
        if role is not None:
            check_role(role)
            values["role"] = role
        if active is not None:
            values["active"] = active
        if password is not None:
            check_password_rules(row.name, password)
            values["password_hash"] = hash_password(password)
        if linked is not None:
            self._link(actor, row, linked)
        self._update(actor, row, values)
        return self.user(name)

    def _link(self, actor: Actor, row: Row[Any], linked: Collection[str]) -> None:
        """Link users of the operating system to a person's account."""
        wanted = {each.strip() for each in linked if each.strip()}
        for each in wanted:
            if not SYSTEM_USER.fullmatch(each):
                raise InputError(
                    Message("user {name!r} of the operating system", each[:80]),
                    "a user, or user@host",
                )
        with self._store.transaction() as connection:
            query = select(system_users).where(system_users.c.system_user.in_(wanted))
            for other in connection.execute(query):
                if other.key != row.key:
                    raise InputError(
                        Message(
                            "{user} is linked to the account {name}", other.system_user, other.key
                        ),
                        "a user of nobody else",
                        "end the other link first",
                    )
            connection.execute(delete(system_users).where(system_users.c.key == row.key))
            for each in sorted(wanted):
                connection.execute(insert(system_users).values(system_user=each, key=row.key))
            note(connection, actor.label, "linked an account", name=row.name, users=sorted(wanted))

    def change_password(self, actor: Actor, old: str, new: str, address: str = "change") -> None:
        """Change the actor's password; the person's other sessions end."""
        self.confirm_password(actor, old, address)
        row = self._known(actor.name)
        check_password_rules(row.name, new)
        self._update(actor, row, {"password_hash": hash_password(new)}, keep=actor.session_id)

    def _update(
        self, actor: Actor, row: Row[Any], values: dict[str, Any], keep: str | None = None
    ) -> None:
        if not values:
            return
        loses = values.get("role", row.role) != "administrator" or not values.get(
            "active", row.active
        )
        with self._lock, self._store.transaction() as connection:
            if loses and row.role == "administrator" and row.active:
                others = select(func.count()).where(
                    users.c.role == "administrator", users.c.active, users.c.id != row.id
                )
                if not connection.scalar(others):
                    raise InputError(
                        Message("{name} is the only administrator", row.name),
                        "one active administrator at least",
                        "make somebody else administrator first",
                    )
            connection.execute(update(users).where(users.c.id == row.id).values(**values))
            shown = {key: value for key, value in values.items() if key != "password_hash"}
            if "password_hash" in values:
                shown["password"] = "changed"
                if name_key(actor.name) != row.key:
                    _set_by(connection, row.key, actor.label)
            note(connection, actor.label, "changed an account", name=row.name, **shown)
        self._sessions.close_all(row.id, keep=keep)
        if "password_hash" in values:
            self._guard.release(row.key)

    def _insert(self, name: str, role: Role, password: str, *, by: str) -> None:
        name = name.strip()
        if not NAME.fullmatch(name):
            raise InputError(
                Message("name {name!r}", name[:80]),
                "2 to 64 letters, digits, spaces, dots and hyphens, beginning with a letter or "
                "digit",
            )
        check_role(role)
        check_password_rules(name, password)
        hashed = hash_password(password)
        if name_key(name) in RESERVED:
            raise InputError(
                Message("name {name!r}", name), "a person's name", "the panel itself uses this name"
            )
        with self._store.transaction() as connection:
            taken = connection.scalar(select(users.c.name).where(users.c.key == name_key(name)))
            if taken is not None:
                raise NameTakenError(
                    Message("an account {name} exists", taken),
                    "a new name",
                    "a clearly different name",
                )
            connection.execute(
                insert(users).values(
                    key=name_key(name),
                    name=name,
                    role=role,
                    password_hash=hashed,
                    active=True,
                    created=utc_text(),
                )
            )
            if by != SETUP:
                _set_by(connection, name_key(name), by)
            note(connection, by, "added an account", name=name, role=role)

    def _row(self, key: str) -> Row[Any] | None:
        with self._store.transaction(reading=True) as connection:
            return connection.execute(select(users).where(users.c.key == key)).one_or_none()

    def _known(self, name: str) -> Row[Any]:
        row = self._row(name_key(name))
        if row is None:
            raise NotFoundError(
                Message("no account {name!r}", name[:80]), "a name from the list of users"
            )
        return row

    def close(self) -> None:
        """Delete expired sessions from the database."""
        with self._store.transaction() as connection:
            connection.execute(delete(sessions).where(sessions.c.seen < self._sessions.oldest()))


def _set_by(connection: Connection, key: str, by: str) -> None:
    """Record that somebody else has set the password of an account."""
    connection.execute(insert(password_settings).values(key=key, at=utc_text(), by=by))


def _user(connection: Connection, row: Row[Any]) -> User:
    linked = select(system_users.c.system_user).where(system_users.c.key == row.key)
    settings = select(password_settings).where(password_settings.c.key == row.key)
    latest = connection.execute(settings.order_by(password_settings.c.id.desc()).limit(1)).first()
    return User(
        row.name,
        row.role,
        row.active,
        row.created,
        tuple(sorted(connection.scalars(linked))),
        "" if latest is None else f"{latest.at[:10]} {latest.by}",
    )


def _bare(code: str) -> bytes:
    """Return a code in upper case without separators."""
    return "".join(each for each in code if each.isalnum()).upper().encode()


def _setup_code() -> str:
    """Return a code of 60 bits that is easy to copy from a screen: XXXX-XXXX-XXXX."""
    letters = "ABCDEFGHJKLMNPQRSTUVWXYZ23456789"
    parts = ("".join(secrets.choice(letters) for _ in range(4)) for _ in range(3))
    return "-".join(parts)
