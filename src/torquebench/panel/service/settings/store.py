"""The settings, whose changes are validated, previewed and logged, and can be undone.

Packaged documents and the bench's file are never changed: the panel stores its changes in its own
database and applies them on top.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, Row, insert, select

from torquebench.bench.description import BenchDescription
from torquebench.calibration import Profile, available_profiles, load_profile
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations import plain_text
from torquebench.panel.service.access.actors import Actor, require
from torquebench.panel.service.problems import BusyError, NotFoundError
from torquebench.panel.service.settings.differences import (
    Difference,
    depth,
    differences,
    flat,
    merged,
    nested,
)
from torquebench.panel.service.settings.documents import (
    BENCH,
    SettingsChange,
    SettingsItem,
    builtin_names,
    find_section,
    load_builtin,
)
from torquebench.panel.service.store import PanelStore, changes, note, utc_text
from torquebench.procedures.turning.profile import TurningProfile, load_turning_profile
from torquebench.records import json_text
from torquebench.reducers import ReducerDescription, available_reducers, load_reducer
from torquebench.validation import allowed_at, choices_at, faults_of, validated

DEEPEST = 12
"""Largest nesting depth of a document; packaged ones have less than half."""
NAME = re.compile(r"[a-z0-9][a-z0-9.-]{0,62}[a-z0-9]")

_CHANGEABLE = re.compile(
    r"(input|output|counter|safety|recording|conditions|calibrator|verification_standard)\..+"
    r"|bench\.(name|reducer_ratio)|temperatures"
)
_FILES = re.compile(r".*\.certificate")
"""Keys of file names, which can be changed only in the bench's file, not over the network."""


class SettingsStore:
    """The settings of a data directory.

    Parameters
    ----------
    store : PanelStore
    base : BenchDescription
        Description in the bench's own file.
    """

    def __init__(self, store: PanelStore, base: BenchDescription) -> None:
        self._store = store
        self._base = base
        self._base_document = base.model_dump(mode="json")

    # -- looking ----------------------------------------------------------------------------

    def items(self, section: str) -> list[SettingsItem]:
        """Return all documents of a section, the packaged ones first."""
        found = find_section(section)
        if section == BENCH:
            return [self.get(section, BENCH)]
        names = [*builtin_names(found.name), *self._own_names(section)]
        return [self.get(section, name) for name in names]

    def names(self, kind: str) -> tuple[str, ...]:
        """Return the names that a field of a request may have.

        Parameters
        ----------
        kind : str
            Kind of names as in `operations.field`: "profiles:steps", "profiles:random", "reducers",
            "reducers:certified".
        """
        section, _, part = kind.partition(":")
        return tuple(item.name for item in self.items(section) if _is_of(item.document, part))

    def get(self, section: str, name: str) -> SettingsItem:
        """Return one document.

        Raises
        ------
        NotFoundError
            No document has this name.
        """
        found = find_section(section)
        with self._store.transaction(reading=True) as connection:
            last = _last(connection, section, name)
        version = 0 if last is None else last.id
        if section == BENCH:
            if name != BENCH:
                raise _unknown(section, name)
            leaves = {} if last is None else json.loads(last.after)
            return SettingsItem(section, name, False, self._overlaid(leaves), version)
        if name in builtin_names(found.name):
            model = load_builtin(found.name, name)
            return SettingsItem(section, name, True, model.model_dump(mode="json"))
        document = None if last is None else json.loads(last.after)
        if document is None:
            raise _unknown(section, name)
        return SettingsItem(section, name, False, document, version)

    def _own_names(self, section: str) -> list[str]:
        query = select(changes).where(changes.c.section == section).order_by(changes.c.id)
        with self._store.transaction(reading=True) as connection:
            latest = {row.name: row.after for row in connection.execute(query)}
        return sorted(name for name, after in latest.items() if json.loads(after) is not None)

    def turning(self, name: str) -> TurningProfile:
        """Return a packaged turning profile by name; a path isn't accepted."""
        return load_turning_profile(name.removesuffix(".toml"))

    def profile(self, name: str) -> Profile:
        """Return a calibration profile by name; a path isn't accepted."""
        if name in available_profiles():
            return load_profile(name)
        return validated(Profile, self._named("profiles", name), f"profile {name}")

    def reducer(self, name: str) -> ReducerDescription:
        """Return a reducer's description by name; a path isn't accepted."""
        if name in available_reducers():
            return load_reducer(name)
        return validated(ReducerDescription, self._named("reducers", name), f"reducer {name}")

    def _named(self, section: str, name: str) -> Mapping[str, Any]:
        """Return a document named in a request; a missing one is an input error."""
        try:
            return self.get(section, name).document
        except NotFoundError as error:
            raise InputError(error.found, error.allowed, error.remedy) from None

    def bench(self) -> BenchDescription:
        """Return the bench's description with the panel's changes.

        Raises
        ------
        InputError
            The bench's own file was changed and now contradicts the panel's changes.
        """
        document = self.get(BENCH, BENCH).document
        if document == self._base_document:
            return self._base
        return validated(BenchDescription, document, "the bench with the panel's changes")

    def _overlaid(self, leaves: Mapping[str, Any]) -> dict[str, Any]:
        return merged(self._base_document, nested(leaves))

    # -- changing ---------------------------------------------------------------------------

    def preview(
        self, section: str, name: str, document: Mapping[str, Any] | None
    ) -> SettingsChange:
        """Validate a document and return the changes that it would make.

        Parameters
        ----------
        section, name : str
        document : mapping or None
            The whole document; None deletes a user's profile or reducer.

        Raises
        ------
        InputError
            A value is invalid, which the message describes; or the document can't be changed here.
        """
        before, after, _ = self._checked(section, name, document)
        return SettingsChange(
            0, None, "", section, name, "", differences(before, after), reopens=section == BENCH
        )

    def faults(self, section: str, name: str, document: Mapping[str, Any]) -> dict[str, InputError]:
        """Return the errors of a document's values by their dotted keys."""
        found = find_section(section)
        return faults_of(found.model, document, f"{section} {name}")

    def allowed(self, section: str, key: str, unit: str = "") -> str:
        """Return the allowed range as text; `unit` is for a key whose name has no unit."""
        return allowed_at(find_section(section).model, key, unit)

    def choices(self, section: str, key: str) -> tuple[Any, ...]:
        """Return the allowed choices of a value; empty for a free value."""
        return choices_at(find_section(section).model, key)

    def fixed(self, section: str, key: str) -> bool:
        """Whether a value can be changed only in the bench's own file."""
        return section == BENCH and _fixed(key)

    def change(
        self,
        actor: Actor,
        section: str,
        name: str,
        document: Mapping[str, Any] | None,
        *,
        reason: str = "",
        version: int | None = None,
    ) -> SettingsChange:
        """Change, add or delete a document.

        Parameters
        ----------
        version : int, optional
            Version of the edited document; if it has changed since, the change is refused. Without
            it, only a change between check and writing is noticed.

        Raises
        ------
        PermissionDeniedError
            The actor's role doesn't allow it.
        InputError
            As in `preview`, or nothing changes.
        BusyError
            The document was changed meanwhile.
        """
        require(actor, find_section(section).role)
        before, after, seen = self._checked(section, name, document)
        version = seen if version is None else version
        return self._enter(actor, section, name, (before, after), reason, version)

    def _checked(
        self, section: str, name: str, document: Mapping[str, Any] | None
    ) -> tuple[dict[str, Any], dict[str, Any], int]:
        """Return a document before and after the change, and the checked version."""
        found = find_section(section)
        if depth(document) > DEEPEST:
            raise InputError("tables nested too deeply", Message("{limit} levels at most", DEEPEST))
        if section != BENCH and name in builtin_names(found.name):
            raise InputError(
                Message("{name} is part of the software", name),
                "another name",
                "copy it under a new name",
            )
        if section != BENCH and not NAME.fullmatch(name):
            raise InputError(Message("name {name!r}", name[:80]), "2 to 64 of a-z 0-9 . -")
        version = self._version(section, name)  # read first, so that any later change is noticed
        try:
            before = dict(self.get(section, name).document)
        except NotFoundError:
            if section == BENCH or document is None:
                raise
            before = {}
        if document is None:
            if section == BENCH:
                raise InputError("the bench can't be deleted", "a changed description")
            return before, {}, version
        if section == BENCH:
            document = merged(before, document)
            _refuse_fixed(differences(before, document))
        model = validated(found.model, document, f"{section} {name}")
        if isinstance(model, Profile) and model.name != name:
            raise InputError(Message("name {name!r} in the document", model.name), repr(name))
        return before, model.model_dump(mode="json"), version

    def _version(self, section: str, name: str) -> int:
        with self._store.transaction(reading=True) as connection:
            last = _last(connection, section, name)
        return 0 if last is None else int(last.id)

    def _enter(
        self,
        actor: Actor,
        section: str,
        name: str,
        documents: tuple[dict[str, Any], dict[str, Any]],
        reason: str,
        version: int,
        undoes: int | None = None,
    ) -> SettingsChange:
        before, after = documents
        found = differences(before, after)
        if not found:
            raise InputError("nothing differs", "a change")
        kept = self._kept(section, after)
        with self._store.transaction() as connection:
            last = _last(connection, section, name)
            if version != (0 if last is None else last.id):
                raise BusyError(
                    Message(
                        "{name} was changed by {who} since then",
                        name,
                        "somebody" if last is None else last.who,
                    ),
                    Message("version {number}", 0 if last is None else last.id),
                    "look at it again and repeat the change",
                )
            row = connection.execute(
                insert(changes)
                .values(
                    at=utc_text(),
                    who=actor.label,
                    section=section,
                    name=name,
                    reason=plain_text(reason, 500),
                    before=json_text(before or None),
                    after=json_text(kept),
                    undoes=undoes,
                )
                .returning(*changes.c)
            ).one()
            note(
                connection,
                actor.label,
                "changed settings" if undoes is None else "undid a change of settings",
                section=section,
                name=name,
                number=row.id,
                keys=[each.key for each in found][:50],
            )
        return self._view(row, found, None)

    def _kept(self, section: str, after: dict[str, Any]) -> dict[str, Any] | None:
        """Return the part to store; for the bench only the differences from its file."""
        if section != BENCH:
            return after or None
        base = flat(self._base_document)
        return {key: value for key, value in flat(after).items() if base.get(key) != value}

    # -- history ----------------------------------------------------------------------------

    def history(self, section: str | None = None, limit: int = 100) -> list[SettingsChange]:
        """Return changes, the newest first."""
        query = select(changes).order_by(changes.c.id.desc()).limit(min(max(limit, 1), 1000))
        if section is not None:
            query = query.where(changes.c.section == find_section(section).name)
        with self._store.transaction(reading=True) as connection:
            rows = connection.execute(query).all()
            undone = dict(
                connection.execute(
                    select(changes.c.undoes, changes.c.id).where(changes.c.undoes.is_not(None))
                ).all()
            )
        return [
            self._view(row, differences(*self._documents(row)), undone.get(row.id)) for row in rows
        ]

    def undo(self, actor: Actor, number: int, reason: str = "") -> SettingsChange:
        """Undo a change, which makes another change.

        Only the keys of that change are restored; if one of them was changed again since, it is
        refused.

        Raises
        ------
        PermissionDeniedError
            The actor's role doesn't allow it.
        NotFoundError
            No change has this number.
        BusyError
            One of the keys was changed again since.
        """
        require(actor, "metrologist")
        with self._store.transaction(reading=True) as connection:
            row = connection.execute(select(changes).where(changes.c.id == number)).one_or_none()
        if row is None:
            raise NotFoundError(Message("no change {number}", number), "a number of the history")
        require(actor, find_section(row.section).role)
        old, new = self._documents(row)
        made, old_leaves = differences(old, new), flat(old)
        version = self._version(row.section, row.name)
        try:
            current = dict(self.get(row.section, row.name).document)
        except NotFoundError:
            current = {}
        leaves = flat(current)
        later = [each.key for each in made if leaves.get(each.key) != each.after]
        if later:
            raise BusyError(
                Message("{key} was changed again since", later[0]),
                "a change that still counts",
                "change it by hand, or undo the later change first",
            )
        for each in made:
            leaves.pop(each.key, None)
        leaves |= {each.key: old_leaves[each.key] for each in made if each.key in old_leaves}
        document = nested(leaves) if leaves else None
        before, after, _ = self._checked(row.section, row.name, document)
        said = reason or f"undo {number}"
        return self._enter(actor, row.section, row.name, (before, after), said, version, number)

    def _documents(self, row: Row[Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        before = json.loads(row.before) or {}
        after = json.loads(row.after) or {}
        return before, self._overlaid(after) if row.section == BENCH else after

    @staticmethod
    def _view(
        row: Row[Any], found: tuple[Difference, ...], undone_by: int | None
    ) -> SettingsChange:
        return SettingsChange(
            row.id,
            datetime.fromisoformat(row.at),
            row.who,
            row.section,
            row.name,
            row.reason,
            found,
            row.undoes,
            undone_by,
            row.section == BENCH,
        )


def _unknown(section: str, name: str) -> NotFoundError:
    return NotFoundError(
        Message("no {name!r} among {section}", name[:80], section), "a name of the list"
    )


def _last(connection: Connection, section: str, name: str) -> Row[Any] | None:
    query = (
        select(changes)
        .where(changes.c.section == section, changes.c.name == name)
        .order_by(changes.c.id.desc())
        .limit(1)
    )
    return connection.execute(query).one_or_none()


def _fixed(key: str) -> bool:
    return not _CHANGEABLE.fullmatch(key) or _FILES.fullmatch(key) is not None


def _refuse_fixed(found: tuple[Difference, ...]) -> None:
    for each in found:
        if _fixed(each.key):
            raise InputError(
                Message("{key} can't be changed in the panel", each.key),
                "channels, limits, safety, counter, recording, conditions",
                "change it in the bench's own file",
            )


def _is_of(document: Mapping[str, Any], part: str) -> bool:
    """Return whether a document belongs to a part of its section."""
    if part in ("steps", "random"):
        pattern = (document.get("loading") or {}).get("pattern")
        return (pattern == "random") == (part == "random")
    return part != "certified" or bool(document.get("certified_friction"))
