"""The registry's equipment: identity, components, adjustments, certificates, zeros."""

from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import Row, Table, func, select
from sqlalchemy.orm import Session

from torquebench.errors import RecordError
from torquebench.message import Message
from torquebench.records.files import sha256_of_file
from torquebench.records.registry.database import insert
from torquebench.records.registry.entries import (
    Adjustment,
    Component,
    Equipment,
    EquipmentKind,
    Report,
    Zeroing,
)
from torquebench.records.registry.entry_rows import EntryRecords, entry_of, equipment_key, number_of
from torquebench.records.registry.schema import components, descriptions, equipment, reports

__all__ = ["EquipmentRecords"]


class EquipmentRecords(EntryRecords):
    """Equipment, components, adjustments, certificates of standards, zeroings."""

    def add_equipment(self, equipment: Equipment) -> None:
        """Register equipment, or its changed data."""
        self._add_changed(equipment, descriptions)

    def equipment(
        self, kind: EquipmentKind | None = None, serial: str | None = None
    ) -> list[Equipment]:
        """Return the registered equipment, all or of a kind or a serial, by both."""
        latest = select(func.max(descriptions.c.id)).group_by(descriptions.c.equipment_key)
        of_equipment = descriptions.c.equipment_key == equipment.c.id
        query = (
            select(equipment, *(descriptions.c[name] for name in _DESCRIBED))
            .outerjoin(descriptions, of_equipment & descriptions.c.id.in_(latest))
            .order_by(equipment.c.kind, equipment.c.serial)
        )
        for column, wanted in ((equipment.c.kind, kind), (equipment.c.serial, serial)):
            if wanted is not None:
                query = query.where(column == wanted)
        with self.session() as session:
            return [entry_of(Equipment, row._mapping) for row in session.execute(query)]

    def _add_changed(
        self, entry: Equipment | Report, table: Table, unimportant: tuple[str, ...] = ()
    ) -> None:
        """Append an entry unless the latest row of its equipment says the same."""
        with self.writing() as session:
            values = self._columns(session, entry, table)
            query = select(table).where(table.c.equipment_key == values["equipment_key"])
            latest = session.execute(query.order_by(table.c.id.desc()).limit(1)).one_or_none()
            compared = values.keys() - {"recorded", *unimportant}
            if latest is None or any(latest._mapping[name] != values[name] for name in compared):
                insert(session, table, **values)

    # Components

    def fit_component(
        self,
        whole: tuple[EquipmentKind, str],
        part: tuple[EquipmentKind, str],
        role: str,
        *,
        performed_by: str = "",
        reason: str = "",
    ) -> None:
        """Enter that a part is fitted into a whole, replacing the earlier part.

        Nothing is entered where the part is there already.
        """
        with self.writing() as session:
            common: dict[str, Any] = {
                "whole_key": equipment_key(session, *whole),
                "role": role,
                "performed": datetime.now(UTC),
                "performed_by": performed_by,
                "reason": reason,
            }
            part_key = equipment_key(session, *part)
            present = _fitted(session, common["whole_key"]).get(role)
            if present is not None and present.part_key == part_key:
                return
            if present is not None:
                insert(session, components, part_key=present.part_key, change="removed", **common)
            insert(session, components, part_key=part_key, change="fitted", **common)

    def components(self, whole: tuple[EquipmentKind, str]) -> list[Component]:
        """Return the parts fitted into a whole at present, by role."""
        with self.session() as session:
            key = number_of(session, equipment, kind=whole[0], serial=whole[1])
            return [
                Component(whole, (row.kind, row.serial), role, row.performed, row.performed_by)
                for role, row in sorted(_fitted(session, key).items())
            ]

    # Adjustments

    def add_adjustment(self, adjustment: Adjustment) -> None:
        """Register work on a piece of equipment that may change its indication."""
        self._add(adjustment)

    def adjustments(self, serial: str) -> list[Adjustment]:
        """Return the work on a piece of equipment, the oldest first."""
        return self.entries(Adjustment, serial=serial)

    # Certificates of standards

    def add_report(self, report: Report) -> None:
        """Register the certificate of a standard, unless exactly this one is registered.

        Raises
        ------
        RecordError
            Where its file is missing.
        """
        if report.file is not None and not report.file.is_file():
            raise RecordError(
                Message("certificate {file} is missing", report.file), "a file that can be read"
            )
        digest = "" if report.file is None else sha256_of_file(report.file)
        # The same certificate may lie elsewhere.
        self._add_changed(replace(report, file_sha256=digest), reports, ("file",))

    def reports(self, serial: str) -> list[Report]:
        """Return the certificates of a standard, the newest first."""
        return self.entries(Report, newest_first=True, serial=serial)

    # Zeroings

    def add_zeroing(self, zeroing: Zeroing) -> None:
        """Register the zero of a transducer.

        Raises
        ------
        RecordError
            Where its run isn't registered.
        """
        self._add(zeroing)

    def zeroings(self, transducer_serial: str) -> list[Zeroing]:
        """Return the zeros of a transducer, the oldest first."""
        return self.entries(Zeroing, order=("performed", "id"), transducer_serial=transducer_serial)


_DESCRIBED = ("manufacturer", "model", "range_nm", "details")


def _fitted(session: Session, whole_key: int | None) -> dict[str, Row[Any]]:
    """Return the latest row of each role that a part is fitted in."""
    query = (
        select(components, equipment.c.kind, equipment.c.serial)
        .join(equipment, equipment.c.id == components.c.part_key)
        .where(components.c.whole_key == whole_key)
        .order_by(components.c.id)
    )
    latest = {row.role: row for row in session.execute(query)}
    return {role: row for role, row in latest.items() if row.change == "fitted"}
