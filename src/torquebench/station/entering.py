"""Enter the data of a run's folder into the registry: begin, end and zeros.

The folder is complete without the registry, so a registry that doesn't answer costs no run: its
entries are made later from the folder.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

from torquebench.bench.description import BenchDescription
from torquebench.bench.roles import SIDES
from torquebench.errors import RecordError
from torquebench.message import Message
from torquebench.records import Equipment, Registry, RunFolder, RunSummary, Zeroing

__all__ = ["SPECIMEN", "enter_run"]

SPECIMEN = "specimen"
"""Key of a run's metadata: the tested reducer, as in the equipment."""


def enter_run(registry: Registry, folder: RunFolder) -> None:
    """Enter the missing entries of a run into the registry, in one transaction.

    Parameters
    ----------
    registry : Registry
    folder : RunFolder
        Running or sealed.

    Raises
    ------
    RecordError
        The registry can't take it, the folder can't be read, or it is a copy of another one.
    """
    require_original(folder)
    with registry.writing():
        entered = registry.entered_runs([folder.run_id])
        if folder.run_id not in entered:
            registry.add_run(_summary(folder))
            specimen = folder.metadata.get(SPECIMEN)
            if specimen:
                registry.add_equipment(Equipment("reducer", **specimen))
        if folder.sealed and not entered.get(folder.run_id):
            registry.finish_run(folder, _measured_elsewhere(folder))
            for zeroing in _zeroings(folder):
                registry.add_zeroing(zeroing)


def require_original(folder: RunFolder) -> None:
    """Refuse a folder that was copied or renamed: a run is entered from its own folder only."""
    if folder.copy_of:
        raise RecordError(
            Message("folder {name} holds run {run_id}", folder.path.name, folder.copy_of),
            "a run's own folder",
            "remove a copy, or give a renamed folder its name again",
        )


def _summary(folder: RunFolder) -> RunSummary:
    """Return a run's line in the list of runs, from its begin."""
    known = folder.metadata
    return RunSummary(
        run_id=folder.run_id,
        kind=str(known["kind"]),
        started=_measured_elsewhere(folder) or datetime.fromisoformat(known["created"]),
        simulated=bool(known.get("simulated")),
        software_version=str(known["software_version"]),
        folder=folder.path,
        side=str(known.get("side", "")),
        operator=str(known.get("operator", "")),
        bench=str(known.get("bench_name", "")),
        profile_name=str(known.get("profile_name", "")),
        profile_sha256=str(known.get("profile_sha256", "")),
    )


def _measured_elsewhere(folder: RunFolder) -> datetime | None:
    """Return when an external table was measured; None for a run of a bench."""
    if "table" not in folder.metadata:
        return None
    start = next(document for _, document in folder.documents("start"))
    return datetime.fromtimestamp(float(start["time"]), UTC)


def _zeroings(folder: RunFolder) -> Iterator[Zeroing]:
    """Yield the zeros measured by a sealed run, for the control charts of its transducers.

    The last value of a failed run is left out: the cause may have begun before it.
    """
    names = {f"zero_{side}": side for side in SIDES}
    streams: dict[str, Any] = {}
    events: list[dict[str, Any]] = []
    for name, document in folder.documents():
        if name == "descriptor" and document["name"] in names:
            streams[document["uid"]] = names[document["name"]]
        elif name == "event":
            events.append(document)
    if not streams:
        return
    if folder.manifest["status"] == "failed":
        del events[-1:]
    description = BenchDescription.model_validate(folder.metadata["bench"])
    for event in events:
        side = streams.get(event["descriptor"])
        if side is None:
            continue
        transducer = description.module(side).transducer
        scale = transducer.scale()
        zero = float(event["data"][f"{side}-steady-{scale.column}"])
        temperature = event["data"].get(f"{side}-steady-temperature_c")
        yield Zeroing(
            transducer_serial=transducer.serial,
            performed=datetime.fromtimestamp(event["time"], UTC),
            zero_hz=zero,
            zero_nm=(zero - scale.nominal_zero) / transducer.nominal_sensitivity,
            temperature_c=None if temperature is None else float(temperature),
            run_id=folder.run_id,
            simulated=description.simulated,
        )
