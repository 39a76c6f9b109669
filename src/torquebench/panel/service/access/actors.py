"""Actors: the caller of an operation, and the permissions of its role."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations import ROLES, Role, allows
from torquebench.panel.service.problems import PermissionDeniedError
from torquebench.records.signatures import Signature


@dataclass(frozen=True)
class Actor:
    """The caller of an operation.

    Parameters
    ----------
    name : str
        A person's sign-in name, or a client's name.
    role : {"operator", "metrologist", "administrator"}
    session_id : str
        Identifier of a person's sign-in or of a client's token; it isn't secret.
    kind : {"person", "client"}
    """

    name: str
    role: Role
    session_id: str
    kind: Literal["person", "client"] = "person"

    @property
    def signature(self) -> Signature:
        """Signature of the actor's decisions, authenticated by a session or a program's token."""
        return Signature("signed-in" if self.kind == "person" else "client", self.name)

    @property
    def signed(self) -> Signature:
        """Signature of a decision for which the person has entered the password."""
        return Signature("signed", self.name)

    @property
    def label(self) -> str:
        """Name for logs and records.

        Examples
        --------
        >>> Actor("plant", "operator", "c1", "client").label
        'plant (client)'
        """
        return self.name if self.kind == "person" else f"{self.name} ({self.kind})"


def check_role(role: str) -> None:
    """Raise an error for an unknown role.

    Raises
    ------
    InputError
        `role` is none of `ROLES`.
    """
    if role not in ROLES:
        raise InputError(
            Message("role {role!r}", role[:40]), Message("one of {list}", ", ".join(ROLES))
        )


def require(actor: Actor, role: Role) -> None:
    """Raise an error for an actor without the role.

    Raises
    ------
    PermissionDeniedError
        The role of `actor` doesn't include `role`.
    """
    if not allows(actor.role, role):
        raise PermissionDeniedError(
            Message("{name} is signed in as {role}", actor.name, actor.role),
            Message("a {role}", role) if role != "administrator" else "an administrator",
            "sign in with an account that has this role",
        )
