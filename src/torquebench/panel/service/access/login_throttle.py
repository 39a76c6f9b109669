"""Login throttle: wrong passwords are counted, and too many of them cause growing pauses."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from sqlalchemy import delete, func, insert, select

from torquebench.message import Message
from torquebench.panel.service.problems import LockedOutError
from torquebench.panel.service.store import PanelStore, failures
from torquebench.units import MINUTE

__all__ = ["Attempt", "LoginThrottle"]

WINDOW_S = 900.0
"""How long a wrong password counts, and the longest pause, s."""
FIRST_PAUSE_S = 30.0
"""First pause, s; each further wrong password doubles it."""
PER_PERSON_AND_ADDRESS = 5
PER_ADDRESS = 30
"""A person's account has no limit over all addresses: an attacker elsewhere could use it to lock
that person out.
"""


@dataclass(frozen=True)
class Attempt:
    """One attempt that was counted: whose, and as which failures."""

    subject: str
    numbers: tuple[int, ...]


class LoginThrottle:
    """Counts attempts by address and by person there, across restarts, until they are right.

    Parameters
    ----------
    store : PanelStore
    now : callable
        Seconds since 1970.
    """

    def __init__(self, store: PanelStore, now: Callable[[], float] = time.time) -> None:
        self._store = store
        self._now = now

    def attempt(self, name: str, address: str) -> Attempt:
        """Count an attempt as failed before anything is compared, and refuse one too many.

        Counted afterwards, a crowd of attempts at one time would all find the door open.

        Raises
        ------
        LockedOutError
            With how long to wait.
        """
        now = self._now()
        subjects = _subjects(name, address)
        with self._store.transaction() as connection:
            connection.execute(delete(failures).where(failures.c.at < now - WINDOW_S))
            for subject, limit in subjects:
                query = select(func.count(), func.max(failures.c.at)).where(
                    failures.c.subject == subject
                )
                count, newest = connection.execute(query).one()
                if count < limit:
                    continue
                pause_s = min(FIRST_PAUSE_S * 2.0 ** (count - limit), WINDOW_S)
                wait_s = float(newest) + pause_s - now
                if wait_s > 0.0:
                    raise LockedOutError(
                        "too many wrong passwords",
                        Message(
                            "{limit} within {minutes:g} minutes, then with increasing delays",
                            limit,
                            WINDOW_S / MINUTE,
                        ),
                        Message("wait {seconds:.0f} s, or ask an administrator", max(1.0, wait_s)),
                        wait_s=max(1.0, wait_s),
                    )
            numbers = [
                connection.execute(
                    insert(failures).values(subject=subject, at=now).returning(failures.c.id)
                ).scalar_one()
                for subject, _ in subjects
            ]
        return Attempt(subjects[0][0], tuple(numbers))

    def succeeded(self, attempt: Attempt) -> None:
        """Forget an attempt that was right, and all failures of this person from this address."""
        with self._store.transaction() as connection:
            connection.execute(
                delete(failures).where(
                    (failures.c.subject == attempt.subject) | failures.c.id.in_(attempt.numbers)
                )
            )

    def release(self, name: str) -> None:
        """Clear all failures of a person, and of the addresses.

        By order of an administrator.
        """
        begin = f"both {name} "
        with self._store.transaction() as connection:
            of_person = failures.c.subject.startswith(begin, autoescape=True)
            query = select(failures.c.subject).where(of_person).distinct()
            addresses = [
                f"address {subject.removeprefix(begin)}" for subject in connection.scalars(query)
            ]
            connection.execute(
                delete(failures).where(of_person | failures.c.subject.in_(addresses))
            )


def _subjects(name: str, address: str) -> list[tuple[str, int]]:
    return [
        (f"both {name} {address}", PER_PERSON_AND_ADDRESS),
        (f"address {address}", PER_ADDRESS),
    ]
