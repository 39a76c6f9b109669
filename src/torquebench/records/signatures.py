"""Signatures: how a person was authenticated for a review, an authorisation or another decision.

A review, an authorisation and an activation name a person, but anybody can type a name. Each of
them therefore stores who was authenticated, how, and the hashes of the records concerned.
"""

import getpass
import hashlib
import json
import os
import socket
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, Self, get_args

from torquebench.message import Message

SignatureKind = Literal["signed", "signed-in", "client", "typed", "automatic"]
"""By password for this decision; within a session; by a program's token; typed; automatic."""


@dataclass(frozen=True)
class Signature:
    """Who was authenticated for a decision, how, and which records the decision concerns.

    Parameters
    ----------
    kind : str
        See `SignatureKind`.
    who : str
        Account of the panel, client, or user of the operating system.
    host : str
        Computer on which the name was typed; empty on the panel.
    covers : mapping of str to str
        SHA-256 of the records concerned, such as ``calibration``, ``verification`` and ``model``.
    """

    kind: SignatureKind
    who: str
    host: str = ""
    covers: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def typed(cls, covers: Mapping[str, str] | None = None, *, automatic: bool = False) -> Self:
        """Return a signature of the user who is logged in to this computer."""
        return cls("automatic" if automatic else "typed", *system_user(), covers or {})

    @classmethod
    def restored(cls, plain: Mapping[str, Any]) -> Self:
        """Read a stored signature; a kind that this version doesn't know counts as typed."""
        return cls(
            next((each for each in get_args(SignatureKind) if each == plain.get("kind")), "typed"),
            str(plain.get("who", "")),
            str(plain.get("host", "")),
            dict(plain.get("covers") or {}),
        )

    def about(self, covers: Mapping[str, str]) -> Self:
        """Return the signature with the hashes of other records."""
        return replace(self, covers=covers)

    @property
    def signed(self) -> bool:
        """Whether the person gave their password for this decision."""
        return self.kind == "signed"

    @property
    def account(self) -> str:
        """The panel account of an authenticated person; otherwise empty."""
        return self.who if self.kind in ("signed", "signed-in") else ""

    @property
    def sha256(self) -> str:
        """One hash over all records that the signature covers."""
        text = json.dumps(dict(self.covers), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()

    @property
    def words(self) -> str:
        """How the person was authenticated, in words."""
        match self.kind:
            case "signed":
                return Message("signed with the password of the account {who}", self.who)
            case "signed-in":
                return Message("signed in as {who}, without the password again", self.who)
            case "client":
                return Message("by the program {who} with its token, not signed", self.who)
            case "automatic":
                return Message("by a command of {who} on {host}, not signed", self.who, self.host)
        return Message("typed by {who} on {host}, not signed", self.who, self.host)


def how(signature: Signature | None) -> str:
    """Describe how a person was authenticated; entries before 0.3.0 don't contain this."""
    return "not recorded how" if signature is None else signature.words


def system_user() -> tuple[str, str]:
    """Return the user of the operating system and this computer's name.

    The user is the process's user, not the one in the environment.
    """
    try:
        import pwd

        user = pwd.getpwuid(os.getuid()).pw_name
    except (ImportError, KeyError):  # Windows, or a user without a name
        try:
            user = getpass.getuser()
        except (KeyError, OSError):
            user = ""
    return user, socket.gethostname()


def operator_name() -> str:
    """Return the operator's name: `$TORQUEBENCH_OPERATOR`, or the user of the operating system."""
    if named := os.environ.get("TORQUEBENCH_OPERATOR"):
        return named
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # an account without a name
        return ""
