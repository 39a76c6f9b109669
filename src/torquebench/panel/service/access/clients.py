"""Clients: programs with an access token for the HTTP API."""

from __future__ import annotations

import re
import secrets
import threading
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Row, insert, select, update

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations import Role
from torquebench.panel.service.access.actors import Actor, check_role, require
from torquebench.panel.service.access.sessions import token_sha256
from torquebench.panel.service.problems import (
    NameTakenError,
    NotFoundError,
    NotSignedInError,
    PermissionDeniedError,
)
from torquebench.panel.service.store import PanelStore, clients, note, utc_text

PREFIX = "tb_"
"""Prefix of tokens, by which secret scanners recognise a leaked token."""
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")


@dataclass(frozen=True)
class Client:
    """A program with a token."""

    client_id: int
    name: str
    role: Role
    created: str
    created_by: str
    revoked: str | None


class Clients:
    """Tokens of programs, stored as hashes; looking one up needs no disk access.

    Parameters
    ----------
    store : PanelStore
    """

    def __init__(self, store: PanelStore) -> None:
        self._store = store
        self._lock = threading.Lock()
        with store.transaction(reading=True) as connection:
            rows = connection.execute(select(clients).where(clients.c.revoked.is_(None))).all()
        self._in_use = {row.token_sha256: _actor(row) for row in rows}

    def add(self, actor: Actor, name: str, role: Role) -> tuple[Client, str]:
        """Create a token for a program; it is returned only once.

        Raises
        ------
        PermissionDeniedError
            The actor isn't an administrator.
        InputError
            A client in use has the name already, or name or role is invalid.
        """
        require(actor, "administrator")
        if not NAME.fullmatch(name):
            raise InputError(Message("client {name!r}", name[:80]), "1 to 64 of A-Z a-z 0-9 . _ -")
        check_role(role)
        token = PREFIX + secrets.token_urlsafe(32)
        with self._store.transaction() as connection:
            taken = select(clients.c.id).where(clients.c.name == name, clients.c.revoked.is_(None))
            if connection.scalar(taken):
                raise NameTakenError(
                    Message("a client {name} exists", name), "a new name", "revoke the old one"
                )
            made = connection.execute(
                insert(clients)
                .values(
                    name=name,
                    role=role,
                    token_sha256=token_sha256(token),
                    created=utc_text(),
                    created_by=actor.name,
                )
                .returning(*clients.c)
            ).one()
            note(connection, actor.label, "added a client", name=name, role=role)
        with self._lock:
            self._in_use[made.token_sha256] = _actor(made)
        return _client(made), token

    def list(self, actor: Actor) -> list[Client]:
        """Return all clients, including revoked ones; for administrators."""
        require(actor, "administrator")
        with self._store.transaction(reading=True) as connection:
            rows = connection.execute(select(clients).order_by(clients.c.id)).all()
        return [_client(row) for row in rows]

    def revoke(self, actor: Actor, client_id: int) -> Client:
        """Revoke a token.

        Raises
        ------
        PermissionDeniedError
            The actor isn't an administrator, or is the client itself.
        NotFoundError
            There is no client with this number.
        """
        require(actor, "administrator")
        if actor.session_id == f"client-{client_id}":
            raise PermissionDeniedError(
                Message("{name} revokes its own token", actor.name), "another administrator's token"
            )
        with self._store.transaction() as connection:
            row = connection.execute(
                update(clients)
                .where(clients.c.id == client_id, clients.c.revoked.is_(None))
                .values(revoked=utc_text())
                .returning(*clients.c)
            ).one_or_none()
            if row is not None:
                note(connection, actor.label, "revoked a client", name=row.name)
        if row is None:
            raise NotFoundError(
                Message("no client {number} in use", client_id), "a number from the list"
            )
        with self._lock:
            self._in_use.pop(row.token_sha256, None)
        return _client(row)

    def actor(self, token: str) -> Actor:
        """Return the client of a token.

        Raises
        ------
        NotSignedInError
            The token is unknown or revoked.
        """
        with self._lock:
            found = self._in_use.get(token_sha256(token))
        if found is None:
            raise NotSignedInError("an unknown or revoked token", "a client's token")
        return found

    def find(self, secret: str) -> Actor | None:
        """Return the client of a secret; None if the secret isn't a client's token.

        Raises
        ------
        NotSignedInError
            The token is unknown or revoked.
        """
        return self.actor(secret) if secret.startswith(PREFIX) else None

    def lives(self, session_id: str) -> bool:
        """Whether a client with this session identifier is in use."""
        with self._lock:
            return any(each.session_id == session_id for each in self._in_use.values())


def _actor(row: Row[Any]) -> Actor:
    return Actor(row.name, row.role, f"client-{row.id}", "client")


def _client(row: Row[Any]) -> Client:
    return Client(row.id, row.name, row.role, row.created, row.created_by, row.revoked)
