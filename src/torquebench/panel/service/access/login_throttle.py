"""Login throttle: too many wrong passwords cause growing pauses."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from sqlalchemy import delete, func, insert, select

from torquebench.message import Message
from torquebench.panel.service.problems import LockedOutError
from torquebench.panel.service.store import PanelStore, failures
from torquebench.units import MINUTE

WINDOW_S = 900.0
"""Time for which a wrong password counts, and the longest pause, s."""
FIRST_PAUSE_S = 30.0
"""First pause, s; each further wrong password doubles it."""
PER_PERSON_AND_ADDRESS = 5
PER_ADDRESS = 30
"""Limit of wrong passwords per address. There is no limit per account over all addresses, because
an attacker could use it to lock a person out.
"""


@dataclass(frozen=True)
class Attempt:
    """A counted attempt: its person, and the numbers of its failure records."""

    subject: str
    numbers: tuple[int, ...]


class LoginThrottle:
    """Counts failed attempts by address, and by person and address, across restarts.

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
        """Count an attempt as failed before the comparison, and refuse it if there are too many.

        If attempts were counted afterwards, many simultaneous attempts would pass.

        Raises
        ------
        LockedOutError
            Too many attempts failed; the error contains the waiting time.
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
        """Delete a successful attempt, and all failures of this person from this address."""
        with self._store.transaction() as connection:
            connection.execute(
                delete(failures).where(
                    (failures.c.subject == attempt.subject) | failures.c.id.in_(attempt.numbers)
                )
            )

    def release(self, name: str) -> None:
        """Delete all failures of a person and of that person's addresses.

        An administrator requests this.
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
