"""The registry's equipment: identity, components, adjustments, certificates, zeros."""

from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from torquebench.errors import RecordError
from torquebench.message import Message
from torquebench.records.files import sha256_of_file
from torquebench.records.registry.database import (
    Database,
    as_json,
    entry_of,
    equipment_row,
    row_of,
    run_row,
)
from torquebench.records.registry.entries import (
    Adjustment,
    Component,
    Equipment,
    EquipmentKind,
    Report,
    Zeroing,
)
from torquebench.records.registry.schema import (
    AdjustmentRow,
    ComponentRow,
    DescriptionRow,
    EquipmentRow,
    ReportRow,
    ZeroingRow,
)

__all__ = ["EquipmentRecords"]


class EquipmentRecords(Database):
    """Equipment, components, adjustments, certificates of standards, zeroings."""

    def add_equipment(self, equipment: Equipment) -> None:
        """Register equipment, or its changed data."""
        with self.writing() as session:
            row = equipment_row(session, equipment.kind, equipment.serial)
            known = _latest_description(session, row)
            fields = {
                "manufacturer": equipment.manufacturer,
                "model": equipment.model,
                "range_nm": equipment.range_nm,
                "details": as_json(equipment.details),
            }
            if known is not None and all(
                getattr(known, name) == value for name, value in fields.items()
            ):
                return
            session.add(DescriptionRow(equipment=row, recorded=datetime.now(UTC), **fields))

    def equipment(self, kind: EquipmentKind | None = None) -> list[Equipment]:
        """Return the registered equipment, all or of one kind, by kind and serial."""
        query = select(EquipmentRow).order_by(EquipmentRow.kind, EquipmentRow.serial)
        if kind is not None:
            query = query.where(EquipmentRow.kind == kind)
        with self.session() as session:
            known: dict[int, DescriptionRow] = {
                row.equipment_key: row
                for row in session.scalars(select(DescriptionRow).order_by(DescriptionRow.id))
            }
            return [_equipment(row, known.get(row.id)) for row in session.scalars(query)]

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
            whole_row, part_row = (equipment_row(session, *each) for each in (whole, part))
            present = _fitted(session, whole_row).get(role)
            if present is not None and present.part_key == part_row.id:
                return
            common: dict[str, Any] = {
                "whole": whole_row,
                "role": role,
                "performed": datetime.now(UTC),
                "performed_by": performed_by,
                "reason": reason,
            }
            if present is not None:
                session.add(ComponentRow(part=present.part, change="removed", **common))
                session.flush()
            session.add(ComponentRow(part=part_row, change="fitted", **common))

    def components(self, whole: tuple[EquipmentKind, str]) -> list[Component]:
        """Return the parts fitted into a whole at present, by role."""
        with self.session() as session:
            kind, serial = whole
            row = session.scalar(
                select(EquipmentRow).where(EquipmentRow.kind == kind, EquipmentRow.serial == serial)
            )
            if row is None:
                return []
            return [
                Component(
                    whole=(row.kind, row.serial),
                    part=(fitted.part.kind, fitted.part.serial),
                    role=role,
                    fitted=fitted.performed,
                    fitted_by=fitted.performed_by,
                )
                for role, fitted in sorted(_fitted(session, row).items())
            ]

    # Adjustments

    def add_adjustment(self, adjustment: Adjustment) -> None:
        """Register work on a piece of equipment that may change its indication."""
        with self.writing() as session:
            fields = asdict(adjustment)
            kind, serial = fields.pop("kind"), fields.pop("serial")
            fields["before"], fields["after"] = as_json(fields["before"]), as_json(fields["after"])
            session.add(AdjustmentRow(equipment=equipment_row(session, kind, serial), **fields))

    def adjustments(self, serial: str) -> list[Adjustment]:
        """Return the work on a piece of equipment, the oldest first."""
        query = (
            select(AdjustmentRow)
            .join(AdjustmentRow.equipment)
            .where(EquipmentRow.serial == serial)
            .order_by(AdjustmentRow.id)
        )
        with self.session() as session:
            return [
                entry_of(Adjustment, row, kind=row.equipment.kind, serial=row.equipment.serial)
                for row in session.scalars(query)
            ]

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
        with self.writing() as session:
            low, high = report.valid_nm or (None, None)
            row = row_of(
                ReportRow,
                report,
                equipment_key=equipment_row(session, report.kind, report.serial).id,
                valid_low_nm=low,
                valid_high_nm=high,
                file="" if report.file is None else self.stored(report.file),
                file_sha256="" if report.file is None else sha256_of_file(report.file),
                recorded=datetime.now(UTC),
            )
            latest = session.scalar(
                select(ReportRow)
                .where(ReportRow.equipment_key == row.equipment_key)
                .order_by(ReportRow.id.desc())
                .limit(1)
            )
            if latest is None or any(
                getattr(latest, name) != getattr(row, name) for name in _REPORT_FIELDS
            ):
                session.add(row)

    def reports(self, serial: str) -> list[Report]:
        """Return the certificates of a standard, the newest first."""
        query = (
            select(ReportRow)
            .join(ReportRow.equipment)
            .where(EquipmentRow.serial == serial)
            .order_by(ReportRow.id.desc())
        )
        with self.session() as session:
            return [self._report(row) for row in session.scalars(query)]

    def _report(self, row: ReportRow) -> Report:
        low, high = row.valid_low_nm, row.valid_high_nm
        return entry_of(
            Report,
            row,
            kind=row.equipment.kind,
            serial=row.equipment.serial,
            valid_nm=None if low is None or high is None else (low, high),
            file=self.root / row.file if row.file else None,
        )

    # Zeroings

    def add_zeroing(self, zeroing: Zeroing) -> None:
        """Register the zero of a transducer.

        Raises
        ------
        RecordError
            Where its run isn't registered.
        """
        with self.writing() as session:
            row = row_of(
                ZeroingRow,
                zeroing,
                transducer=equipment_row(session, "transducer", zeroing.transducer_serial),
                run=None if zeroing.run_id is None else run_row(session, zeroing.run_id),
            )
            session.add(row)

    def zeroings(self, transducer_serial: str) -> list[Zeroing]:
        """Return the zeros of a transducer, the oldest first."""
        query = (
            select(ZeroingRow)
            .join(ZeroingRow.transducer)
            .where(EquipmentRow.serial == transducer_serial)
            .order_by(ZeroingRow.performed, ZeroingRow.id)
        )
        with self.session() as session:
            return [
                entry_of(
                    Zeroing,
                    row,
                    transducer_serial=transducer_serial,
                    run_id=row.run.run_id if row.run else None,
                )
                for row in session.scalars(query)
            ]


_REPORT_FIELDS = set(ReportRow.__table__.columns.keys()) - {
    *("id", "equipment_key", "file", "recorded")  # the same certificate may lie elsewhere
}


def _latest_description(session: Session, row: EquipmentRow) -> DescriptionRow | None:
    return session.scalar(
        select(DescriptionRow)
        .where(DescriptionRow.equipment_key == row.id)
        .order_by(DescriptionRow.id.desc())
        .limit(1)
    )


def _equipment(row: EquipmentRow, known: DescriptionRow | None) -> Equipment:
    kind: Any = row.kind
    if known is None:
        return Equipment(kind, row.serial)
    return Equipment(
        kind, row.serial, known.manufacturer, known.model, known.range_nm, known.details
    )


def _fitted(session: Session, whole: EquipmentRow) -> dict[str, ComponentRow]:
    """Return the latest row of each role that a part is fitted in."""
    query = select(ComponentRow).where(ComponentRow.whole_key == whole.id).order_by(ComponentRow.id)
    latest = {row.role: row for row in session.scalars(query)}
    return {role: row for role, row in latest.items() if row.change == "fitted"}
