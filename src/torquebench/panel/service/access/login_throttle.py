"""Against guessing: wrong passwords are counted, and too many of them lock for a while."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from sqlalchemy import delete, func, insert, select

from torquebench.panel.service.problems import LockedOutError
from torquebench.panel.service.store import PanelStore, failures

__all__ = ["Attempt", "LoginThrottle"]

WINDOW_S = 900.0
"""How long a wrong password counts, and how long a lock therefore lasts at most, s."""
PER_PERSON_AND_ADDRESS = 5
PER_PERSON = 30
"""From all addresses together: more, so that nobody far away can shut a person out easily."""
PER_ADDRESS = 30


@dataclass(frozen=True)
class Attempt:
    """One attempt that was counted: whose, and as which failures."""

    subject: str
    numbers: tuple[int, ...]


class LoginThrottle:
    """Counts attempts by person, by address and by both, across restarts, until they are right.

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
                query = select(func.count(), func.min(failures.c.at)).where(
                    failures.c.subject == subject
                )
                count, oldest = connection.execute(query).one()
                if count >= limit:
                    wait_s = max(1.0, float(oldest) + WINDOW_S - now)
                    raise LockedOutError(
                        "too many wrong passwords",
                        f"{limit} within {WINDOW_S / 60:g} minutes",
                        f"wait {wait_s / 60:.0f} minutes, or ask an administrator",
                        wait_s=wait_s,
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
        """Forget every failure of a person: an administrator has said so."""
        with self._store.transaction() as connection:
            connection.execute(
                delete(failures).where(
                    (failures.c.subject == f"person {name}")
                    | failures.c.subject.startswith(f"both {name} ", autoescape=True)
                )
            )


def _subjects(name: str, address: str) -> list[tuple[str, int]]:
    return [
        (f"both {name} {address}", PER_PERSON_AND_ADDRESS),
        (f"person {name}", PER_PERSON),
        (f"address {address}", PER_ADDRESS),
    ]
