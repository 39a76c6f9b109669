"""A panel's accounts in a data directory, made without a panel."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from torquebench.panel.service import Actor
from torquebench.panel.service.access.people import People
from torquebench.panel.service.store import PanelStore

__all__ = ["PASSWORD", "people_of"]

PASSWORD = "correct horse battery"


@contextmanager
def people_of(data: Path, *metrologists: str) -> Iterator[tuple[People, Actor]]:
    """Yield the people of a data directory, its administrator "Chief" and some metrologists."""
    data.mkdir(parents=True, exist_ok=True)
    store = PanelStore(data)
    try:
        people = People(store)
        code = people.setup_code
        assert code is not None
        chief = people.actor(people.set_up(code, "Chief", PASSWORD, "here"))
        for name in metrologists:
            people.add_user(chief, name, "metrologist", PASSWORD)
        yield people, chief
    finally:
        store.close()
