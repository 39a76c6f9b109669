"""Actors: the caller of an operation, and the permissions of its role."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations import ROLES, Role, allows
from torquebench.panel.service.problems import PermissionDeniedError
from torquebench.records.signatures import Signature

__all__ = ["ROLES", "Actor", "Role", "allows", "check_role", "require"]


@dataclass(frozen=True)
class Actor:
    """The caller of an operation.

    Parameters
    ----------
    name : str
        A person's sign-in name, or a client's name.
    role : {"operator", "metrologist", "administrator"}
    session_id : str
        One sign-in of a person, or one token of a client. It is no secret.
    kind : {"person", "client"}
    """

    name: str
    role: Role
    session_id: str
    kind: Literal["person", "client"] = "person"

    @property
    def signature(self) -> Signature:
        """How the actor's acts come about: in a session, or by a program's token."""
        return Signature("signed-in" if self.kind == "person" else "client", self.name)

    @property
    def signed(self) -> Signature:
        """The same for an act that the person has given the password for."""
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
    """Refuse a role that there isn't.

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
    """Refuse an actor without the role.

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
