"""Passwords: rules for new ones, and argon2id hashes."""

from __future__ import annotations

import threading

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError

from torquebench.errors import InputError
from torquebench.message import Message

SHORTEST, LONGEST = 10, 128
DISTINCT = 5

_hasher = PasswordHasher(time_cost=3, memory_cost=32 * 1024, parallelism=1)
"""Parameters of argon2id, above OWASP's 19 MiB with two passes."""
_nobody = "$argon2id$v=19$m={},t={},p=1${}${}".format(
    _hasher.memory_cost, _hasher.time_cost, "A" * 22, "A" * 43
)
"""Hash without a password, so that signing in takes as long for an unknown user as for a known
one."""
_at_once = threading.BoundedSemaphore(2)
"""Limits parallel sign-ins, which need memory that the bench needs, too."""


def check_password_rules(name: str, password: str) -> None:
    """Raise an error for a password that is easily guessed.

    Raises
    ------
    InputError
        The password is too short, too long, too uniform, or contains the name.

    Examples
    --------
    >>> check_password_rules("ana", "aaaaaaaaaaaa")
    Traceback (most recent call last):
    ...
    torquebench.errors.InputError: a password of 1 different characters; allowed: at least 5
    """
    if not SHORTEST <= len(password) <= LONGEST:
        raise InputError(
            Message("a password of {count} characters", len(password)),
            Message("{low} to {high}", SHORTEST, LONGEST),
            "three words?",
        )
    distinct = len(set(password))
    if distinct < DISTINCT:
        raise InputError(
            Message("a password of {count} different characters", distinct),
            Message("at least {limit}", DISTINCT),
        )
    if len(name) > 3 and name.casefold() in password.casefold():
        raise InputError("a password with the name in it", "one without")


def hash_password(password: str) -> str:
    """Return the hash of a password with its salt and parameters."""
    with _at_once:
        return _hasher.hash(password)


def matches(stored: str | None, password: str) -> bool:
    """Return whether a password matches a hash; without a hash, take as long and return False."""
    known = stored is not None and len(password) <= LONGEST
    with _at_once:
        try:
            _hasher.verify(stored if known and stored else _nobody, password[:LONGEST])
        except (VerificationError, InvalidHashError):
            return False
    return known
