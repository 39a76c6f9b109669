"""Register a bench's equipment, and collect its metadata for runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from datetime import date
from pathlib import Path
from typing import Any

from torquebench.bench.active_chain import ActiveChain
from torquebench.bench.description import BenchDescription, StandardDescription
from torquebench.bench.devices.context import BenchContext
from torquebench.bench.roles import SIDES
from torquebench.records import Equipment, EquipmentKind, Registry, Report


def register_equipment(registry: Registry, description: BenchDescription) -> None:
    """Register the bench, its parts and its standards' certificates unless they are registered."""
    bench: tuple[EquipmentKind, str] = ("bench", description.name)
    # One transaction, so that a bench is registered completely or not at all.
    with registry.writing():
        registry.add_equipment(Equipment(*bench))
        for role, part in _parts(description).items():
            registry.add_equipment(part)
            registry.fit_component(bench, (part.kind, part.serial), role)
        for report in _reports(description):
            registry.add_report(report)


def _parts(description: BenchDescription) -> dict[str, Equipment]:
    """Return the parts of the bench by role."""
    parts: dict[str, Equipment] = {}
    for side in SIDES:
        module = description.module(side)
        transducer, drive, encoder = module.transducer, module.drive, module.encoder
        parts[f"{side}.transducer"] = Equipment(
            "transducer",
            transducer.serial,
            transducer.manufacturer,
            transducer.model,
            module.range_nm,
            {
                "side": side,
                "bench": description.name,
                "nominal_torque_nm": transducer.nominal_torque_nm,
                "signal": transducer.signal,
                **(
                    {"option_khz": transducer.option_khz}
                    if transducer.signal == "frequency"
                    else {}
                ),
            },
        )
        parts[f"{side}.drive"] = Equipment("drive", drive.serial, model=drive.model)
        if encoder is not None:
            counts = {"counts_per_revolution": encoder.counts_per_revolution}
            parts[f"{side}.encoder"] = Equipment("encoder", encoder.serial, details=counts)
    counter = description.counter
    timebase = {"timebase_hz": counter.timebase_hz}
    parts["counter"] = Equipment("counter", counter.identity, details=timebase)
    for kind, standard in _standards(description):
        certificate = {
            "certificate_number": standard.certificate_number,
            "certificate_date": standard.certificate_date,
            "expanded_uncertainty_percent": standard.expanded_uncertainty_percent,
        }
        parts[kind] = Equipment(kind, standard.serial, model=standard.model, details=certificate)
    return parts


def _standards(
    description: BenchDescription,
) -> tuple[tuple[EquipmentKind, StandardDescription], ...]:
    return (
        ("calibrator", description.calibrator),
        ("verification-standard", description.verification_standard),
    )


def _reports(description: BenchDescription) -> Iterator[Report]:
    for kind, standard in _standards(description):
        try:
            performed = date.fromisoformat(standard.certificate_date)
        except ValueError:  # "unknown", or a date in another form
            performed = None
        yield Report(
            kind,
            standard.serial,
            standard.certificate_number,
            laboratory=standard.laboratory,
            performed=performed,
            due=standard.certificate_due,
            expanded_uncertainty_percent=standard.expanded_uncertainty_percent,
            file=None if standard.certificate is None else Path(standard.certificate),
        )


def run_metadata(context: BenchContext) -> dict[str, Any]:
    """Return the metadata of the bench for a run."""
    description, acquisition = context.description, context.acquisition
    active = {side: acquisition.compensation(side) for side in SIDES}
    return {
        "bench": description.model_dump(mode="json"),
        "bench_name": description.name,
        "simulated": description.simulated,
        "counter_identity": context.drivers.counter.clock_identity,
        "timebase_hz": context.drivers.counter.timebase_hz,
        "identities": [asdict(identity) for identity in context.drivers.identities()],
        "compensation": {
            side: {"model_id": model.model_id, "kind": model.kind, **_departures(model)}
            for side, model in active.items()
            if model is not None
        },
        "real_time": not context.clock.fast,
        "bench_time_s": context.clock.now(),
    }


def _departures(active: ActiveChain) -> dict[str, Any]:
    """Return departures from normal compensation: an accepted counter, corrections switched off."""
    found: dict[str, Any] = {}
    if active.accepted is not None:
        found["accepted_counter"] = active.accepted.specification()
    if active.chain.switches:
        found["switched_off"] = list(active.chain.switches)
    return found
