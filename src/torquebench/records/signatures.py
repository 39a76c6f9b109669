"""How an act of a person came about: with a password on the panel, or typed on a computer.

A review, an authorisation and an activation name a person. Whether that person was there is
another question: the name may have been typed by anybody. So each of them stores who was
authenticated, by what, and the hashes of what the act was about.
"""

import getpass
import hashlib
import json
import os
import socket
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from typing import Any, Literal, Self, get_args

from torquebench.message import Message

__all__ = [
    "Signature",
    "SignatureKind",
    "authenticated",
    "how",
    "operator_name",
    "present_signature",
    "system_user",
]

SignatureKind = Literal["signed", "signed-in", "client", "typed", "automatic"]
"""With the account's password for this act; in a session that a password had opened; by the token
of a program; typed by somebody who is logged in to a computer; by a command's own decision."""


@dataclass(frozen=True)
class Signature:
    """Who was authenticated for an act, by what, and what the act was about.

    Parameters
    ----------
    kind : str
        See `SignatureKind`.
    who : str
        Account of the panel, client, or user of the operating system.
    host : str
        Computer where it was typed; empty on the panel.
    covers : mapping of str to str
        SHA-256 of what it was about, such as ``calibration``, ``verification`` and ``model``.
    """

    kind: SignatureKind
    who: str
    host: str = ""
    covers: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def typed(cls, covers: Mapping[str, str] | None = None, *, automatic: bool = False) -> Self:
        """Return the signature of an act of the user who is logged in to this computer."""
        return cls("automatic" if automatic else "typed", *system_user(), covers or {})

    @classmethod
    def restored(cls, plain: Mapping[str, Any]) -> Self:
        """Return a stored signature; a kind of a later version counts as typed."""
        return cls(
            next((each for each in get_args(SignatureKind) if each == plain.get("kind")), "typed"),
            str(plain.get("who", "")),
            str(plain.get("host", "")),
            dict(plain.get("covers") or {}),
        )

    def about(self, covers: Mapping[str, str]) -> Self:
        """Return the same for an act about other things."""
        return replace(self, covers=covers)

    @property
    def signed(self) -> bool:
        """Whether the person gave their password for this act."""
        return self.kind == "signed"

    @property
    def account(self) -> str:
        """Account of a person who was authenticated by the panel; empty otherwise."""
        return self.who if self.kind in ("signed", "signed-in") else ""

    @property
    def sha256(self) -> str:
        """One hash of everything that it is about."""
        text = json.dumps(dict(self.covers), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()

    @property
    def words(self) -> str:
        """How it came about, in words."""
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
    """Return how an act came about; entries before 0.3.0 don't tell."""
    return "not recorded how" if signature is None else signature.words


def system_user() -> tuple[str, str]:
    """Return the user of the operating system and this computer's name.

    The user is that of the process, not what the environment says.
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


_present: ContextVar[Signature | None] = ContextVar("torquebench_signature", default=None)


@contextmanager
def authenticated(signature: Signature) -> Iterator[None]:
    """Let everything that this thread does until the block ends be the act of a person."""
    before = _present.set(signature)
    try:
        yield
    finally:
        _present.reset(before)


def present_signature(*, automatic: bool = False) -> Signature:
    """Return who acts now: the person of `authenticated`, otherwise the user of this computer.

    Parameters
    ----------
    automatic : bool
        Whether a command decides by itself.
    """
    found = _present.get()
    return Signature.typed(automatic=automatic) if found is None else found


def operator_name() -> str:
    """Return the person at this computer: by `$TORQUEBENCH_OPERATOR`, or the account."""
    if named := os.environ.get("TORQUEBENCH_OPERATOR"):
        return named
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # an account without a name
        return ""
