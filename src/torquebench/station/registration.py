"""What the records keep of a bench: its instruments, and what is known before a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any

import torquebench
from torquebench.bench.description import BenchDescription
from torquebench.bench.devices.context import BenchContext
from torquebench.bench.roles import SIDES
from torquebench.records import Equipment, Registry, RunSummary, RunWriter

__all__ = ["register_instruments", "run_metadata", "run_summary"]


def register_instruments(registry: Registry, description: BenchDescription) -> None:
    """Enter the bench's transducers, counter and standards, or bring them up to date."""
    for side in SIDES:
        module = description.module(side)
        transducer = module.transducer
        details = {
            "side": side,
            "bench": description.name,
            "nominal_torque_nm": transducer.nominal_torque_nm,
            "option_khz": transducer.option_khz,
        }
        registry.add_equipment(
            Equipment(
                "transducer",
                transducer.serial,
                transducer.manufacturer,
                transducer.model,
                module.range_nm,
                details,
            )
        )
    counter = description.counter
    registry.add_equipment(
        Equipment("counter", counter.identity, details={"timebase_hz": counter.timebase_hz})
    )
    for kind, standard in (
        ("calibrator", description.calibrator),
        ("verification-standard", description.verification_standard),
    ):
        certificate = {
            "certificate_number": standard.certificate_number,
            "certificate_date": standard.certificate_date,
            "expanded_uncertainty_percent": standard.expanded_uncertainty_percent,
        }
        registry.add_equipment(
            Equipment(kind, standard.serial, model=standard.model, details=certificate)  # type: ignore[arg-type] # both are kinds
        )


def run_metadata(context: BenchContext) -> dict[str, Any]:
    """Return what is known of the bench before a run."""
    description, acquisition = context.description, context.acquisition
    active = {side: acquisition.compensation(side) for side in SIDES}
    return {
        "bench": description.model_dump(mode="json"),
        "bench_name": description.name,
        "simulated": description.simulated,
        "counter_identity": context.drivers.counter.clock_identity,
        "identities": [asdict(identity) for identity in context.drivers.identities()],
        "compensation": {
            side: {"model_id": model.model_id, "kind": model.kind}
            for side, model in active.items()
            if model is not None
        },
        "real_time": not context.clock.fast,
        "bench_time_s": context.clock.now(),
    }


def run_summary(writer: RunWriter, kind: str, known: Mapping[str, Any]) -> RunSummary:
    """Return the line of the list of runs for a run that starts."""
    return RunSummary(
        run_id=writer.run_id,
        kind=kind,
        started=datetime.now(UTC),
        simulated=bool(known["simulated"]),
        software_version=torquebench.__version__,
        folder=writer.path,
        side=str(known.get("side", "")),
        operator=str(known.get("operator", "")),
        bench=str(known["bench_name"]),
        profile_name=str(known.get("profile_name", "")),
        profile_sha256=str(known.get("profile_sha256", "")),
    )
