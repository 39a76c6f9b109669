"""Refusals of the panel as errors with found, allowed and remedy."""

from __future__ import annotations

from torquebench.errors import InputError, TorquebenchError

__all__ = [
    "BusyError",
    "LeaseError",
    "LockedOutError",
    "NameTakenError",
    "NotFoundError",
    "NotSignedInError",
    "PermissionDeniedError",
    "SignInError",
]


class NotSignedInError(TorquebenchError):
    """Nobody is signed in, or the session has expired."""


class SignInError(TorquebenchError):
    """Name and password (or a client's token) don't belong together."""


class LockedOutError(SignInError):
    """Too many wrong passwords: no further attempt counts for a while.

    Attributes
    ----------
    wait_s : float
        How long, s.
    """

    def __init__(self, found: str, allowed: str = "", remedy: str = "", wait_s: float = 0.0):
        super().__init__(found, allowed, remedy)
        self.wait_s = wait_s


class PermissionDeniedError(TorquebenchError):
    """The actor's role doesn't allow it."""


class LeaseError(TorquebenchError):
    """Another session commands the bench."""


class BusyError(TorquebenchError):
    """The bench does one thing at a time, and is at it."""


class NameTakenError(InputError):
    """There is something of this name already."""


class NotFoundError(TorquebenchError):
    """There is nothing with this number or name."""
