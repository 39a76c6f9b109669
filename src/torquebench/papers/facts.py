"""Facts of a bench for the page: its components and its mounting."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from pathlib import Path

from torquebench.atomic_write import atomic_write
from torquebench.bench.description import (
    GuideRailDescription,
    ModuleDescription,
    PowerSupplyDescription,
)
from torquebench.bench.mounting_record import MountingRecord, mounting_facts
from torquebench.bench.roles import SIDES
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.station import Station

FACTS = "bench.csv"
MOUNTING = "mounting: "
"""Prefix of the keys of facts from the mounting's record."""
FAILED = "failed: "
"""Prefix of the keys of facts about failed parts of the reducer test."""


def bench_facts(station: Station, mounted: MountingRecord | None) -> dict[str, str]:
    """Describe the bench's sub-systems, hardware and mounting.

    Parameters
    ----------
    station : Station
    mounted : MountingRecord or None
        The entered record; by default that of a simulated bench.
    """
    description, drivers = station.description, station.drivers
    if mounted is None and drivers.truth is not None:
        mounted = MountingRecord.model_validate(drivers.truth.mounting())
    found = {
        "power supply": _supply(description.power_supply, watched=drivers.supply is not None),
        "guide rail": _rail(description.guide_rail, moved=drivers.rail is not None),
        "input module": _module(description.input),
        "tested assembly": Message(
            "hydraulic clamp; calibrator, standard or reducer, i = {ratio:g}",
            description.bench.reducer_ratio,
        ),
        "output module": _module(description.output),
        "work bench": Message(
            "{bench}; probes {probes}", description.name, ", ".join(description.temperatures)
        ),
    }
    for side in SIDES:
        module = description.module(side)
        transducer = module.transducer
        found[f"transducer, {side}"] = Message(
            "{model}, serial {serial}, used to ±{range_nm:g} N·m",
            transducer.model,
            transducer.serial,
            module.range_nm,
        )
        model = module.drive.model
        serial = Message("serial {serial}", module.drive.serial)
        found[f"drive, {side}"] = (
            serial if model == "unknown" else Message("{model}, {serial}", model, serial)
        )
    counter = description.counter
    found["acquisition"] = Message(
        "{method} counting of edges, {timebase:g} MHz, {window:g} s windows",
        counter.method,
        counter.timebase_hz / 1e6,
        counter.window_s,
    )
    found["standard"] = (
        f"{description.verification_standard.serial}, U = "
        f"{description.verification_standard.expanded_uncertainty_percent:g} %"
    )
    found |= {f"{MOUNTING}{name}": value for name, value in mounting_facts(mounted)}
    return {name: value for name, value in found.items() if value}


def _supply(described: PowerSupplyDescription | None, *, watched: bool) -> str:
    if described is None:
        return ""
    parts: list[str] = [Message("{model}", described.model)]
    if described.voltage_v is not None:
        parts.append(f"{described.voltage_v:g} V")
    if described.power_kw is not None:
        parts.append(f"{described.power_kw:g} kW")
    parts.append("no drive is enabled without it" if watched else "not watched")
    return Message.joined(parts)


def _rail(described: GuideRailDescription | None, *, moved: bool) -> str:
    if described is None:
        return ""
    parts: list[str] = [Message("{model}", described.model)]
    if described.travel_mm is not None:
        parts.append(f"{described.travel_mm:g} mm")
    parts.append(
        "moves only unloaded and unclamped, clamped only at its end" if moved else "moved by hand"
    )
    return Message.joined(parts)


def _module(described: ModuleDescription) -> str:
    encoder = described.encoder
    turns = "no encoder"
    if encoder:
        turns = Message("encoder of {count} counts", encoder.counts_per_revolution)
    return Message(
        "transducer ±{range_nm:g} N·m, drive, {encoder}, free / driven / locked",
        described.range_nm,
        turns,
    )


def write_rows(path: Path, rows: Iterable[Iterable[object]]) -> Path:
    """Write rows as a CSV file."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    atomic_write(path, text.getvalue())
    return path


def read_rows(path: Path | None, columns: int) -> list[list[str]]:
    """Read the rows of a CSV file below its header; a missing file has none.

    Raises
    ------
    InputError
        A row has another number of cells.
    """
    if path is None:
        return []
    try:
        rows = [row for row in csv.reader(io.StringIO(path.read_text("utf-8-sig"))) if row]
    except UnicodeDecodeError as error:
        raise InputError(Message("{path}: {error}", path, error), "a CSV file in UTF-8") from error
    for number, row in enumerate(rows, 1):
        if len(row) != columns:
            raise InputError(
                Message("{path}, row {number}: {count} cells", path, number, len(row)),
                Message("{columns} cells", columns),
            )
    return rows[1:]
