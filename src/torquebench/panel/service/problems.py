"""Errors of the panel, with found, allowed and remedy."""

from __future__ import annotations

from torquebench.errors import InputError, TorquebenchError


class NotSignedInError(TorquebenchError):
    """Nobody is signed in, or the session has expired."""


class SignInError(TorquebenchError):
    """Name and password, or a client's name and token, don't match."""


class LockedOutError(SignInError):
    """There were too many wrong passwords; further attempts are refused for a while.

    Attributes
    ----------
    wait_s : float
        Time to wait, s.
    """

    def __init__(self, found: str, allowed: str = "", remedy: str = "", wait_s: float = 0.0):
        super().__init__(found, allowed, remedy)
        self.wait_s = wait_s


class PermissionDeniedError(TorquebenchError):
    """The actor's role doesn't allow the action."""


class LeaseError(TorquebenchError):
    """Another session commands the bench."""


class BusyError(TorquebenchError):
    """The bench is busy, because it performs one task at a time."""


class NameTakenError(InputError):
    """The name exists already."""


class NotFoundError(TorquebenchError):
    """Nothing has this number or name."""
