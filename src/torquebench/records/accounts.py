"""Read the panel's accounts, so that nobody enters another person's name in a record.

A name typed on a computer proves nothing. The name of an account is therefore accepted only from
its owner, who can sign in on the panel.
"""

import sqlite3
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from pathlib import Path
from typing import Self

from sqlalchemy import (
    Boolean,
    Column,
    Integer,
    MetaData,
    NullPool,
    Table,
    Text,
    create_engine,
    inspect,
    select,
)
from sqlalchemy.exc import SQLAlchemyError

from torquebench.errors import InputError, RecordError
from torquebench.message import Message
from torquebench.records.read_only import sqlite_reader
from torquebench.records.signatures import Signature

PANEL_FILE = "panel.sqlite"
"""The panel's own database in a data directory."""
NAMED_DAYS = 30
"""For how many days a certificate mentions that somebody else has set an account's password."""

metadata = MetaData()
users = Table(
    "users",
    metadata,
    Column("id", Integer, primary_key=True),
    *(Column(name, Text, nullable=False) for name in ("name", "role", "password_hash", "created")),
    Column("key", Text, nullable=False, unique=True),
    Column("active", Boolean, nullable=False),
)
system_users = Table(
    "system_users",
    metadata,
    Column("system_user", Text, primary_key=True),
    Column("key", Text, nullable=False),
)
"""Users of the operating system, as ``user`` or ``user@host``, and the keys of their accounts."""
password_settings = Table(
    "password_settings",
    metadata,
    Column("id", Integer, primary_key=True),
    *(Column(name, Text, nullable=False) for name in ("key", "at", "by")),
)
"""Passwords that were set by somebody other than the account's owner."""


def name_key(name: str) -> str:
    """Return a name in the form used for comparison: Unicode's compatibility form, without case.

    Examples
    --------
    >>> name_key(" Ana  LI ") == name_key("ana li"), name_key("Ana") == name_key("Anna")
    (True, False)
    """
    folded = unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", name).casefold())
    return " ".join(folded.split())[:128]


@dataclass(frozen=True)
class Accounts:
    """The accounts of a data directory.

    Parameters
    ----------
    names : mapping of str to str
        Name of every account by its key, including deactivated accounts.
    links : mapping of str to str
        Key of the account of a user of the operating system (``user`` or ``user@host``).
    settings : tuple of (key, moment, by)
        Passwords that were set by somebody other than the owner: account, time, and who set it.
    """

    names: Mapping[str, str] = field(default_factory=dict)
    links: Mapping[str, str] = field(default_factory=dict)
    settings: tuple[tuple[str, datetime, str], ...] = ()

    @classmethod
    def of(cls, data: Path) -> Self:
        """Read the accounts of a data directory; there are none if it never had a panel.

        Raises
        ------
        RecordError
            The panel's database is damaged.
        """
        file = data / PANEL_FILE
        if not file.is_file() or not file.stat().st_size:
            return cls()
        with sqlite_reader(file) as address:
            engine = create_engine(
                "sqlite://", creator=lambda: sqlite3.connect(address, uri=True), poolclass=NullPool
            )
            try:
                with engine.connect() as connection:
                    present = inspect(connection).get_table_names()
                    rows = {
                        table.name: connection.execute(select(table)).all()
                        if table.name in present
                        else []
                        for table in metadata.sorted_tables
                        if table in (users, system_users, password_settings)
                    }
                return cls(
                    {row.key: row.name for row in rows["users"]},
                    {row.system_user: row.key for row in rows["system_users"]},
                    tuple(
                        (row.key, datetime.fromisoformat(row.at), row.by)
                        for row in rows["password_settings"]
                    ),
                )
            except (SQLAlchemyError, ValueError) as error:
                raise RecordError(
                    Message("{path} can't be read: {problem}", file, error),
                    "a sound database",
                    "`torquebench records restore BACKUP`",
                ) from error
            finally:
                engine.dispose()

    def __bool__(self) -> bool:
        """Whether there are any accounts."""
        return bool(self.names)

    def named(self, name: str) -> str:
        """Return the account with this name; empty if there is none."""
        return self.names.get(name_key(name), "")

    def of_system_user(self, user: str, host: str) -> str:
        """Return the account linked to a user of the operating system; empty if none is linked."""
        key = self.links.get(f"{user}@{host}") or self.links.get(user) or ""
        return self.names.get(key, "")

    def refuse_typed(self, name: str, signature: Signature) -> None:
        """Raise an error if a name belongs to an account whose owner hasn't entered it.

        Raises
        ------
        InputError
            The name was typed by somebody whose account it isn't.
        """
        account = self.named(name)
        if not account or name_key(signature.account) == name_key(account):
            return
        typed = signature.kind in ("typed", "automatic")
        if typed and self.of_system_user(signature.who, signature.host) == account:
            return
        raise InputError(
            Message(
                "the name {name} belongs to an account on the panel and was entered by "
                "somebody else",
                account,
            ),
            "a name entered by its owner",
            Message(
                "sign in on the panel as {name}, or have an administrator link the account to "
                "the user {user}@{host}",
                account,
                signature.who,
                signature.host or "computer",
            ),
        )

    def same_person(self, first: Signature | None, second: Signature | None) -> bool | None:
        """Return whether the same person signed twice; None where that is unknown."""
        if first is None or second is None:
            return None
        accounts = [
            each.account or self.of_system_user(each.who, each.host) for each in (first, second)
        ]
        if all(accounts):
            return name_key(accounts[0]) == name_key(accounts[1])
        return None

    def set_by_others(self, account: str, moment: datetime) -> list[tuple[datetime, str]]:
        """Return when and by whom else a password was set in the `NAMED_DAYS` before a moment."""
        earliest = moment - timedelta(days=NAMED_DAYS)
        return [
            (at, by)
            for key, at, by in self.settings
            if key == name_key(account) and earliest <= at <= moment
        ]
