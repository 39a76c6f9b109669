"""Enter a run into the registry from its folder: start, end and zeros.

The folder alone contains everything, so no run is lost if the registry doesn't answer: the run is
entered later.
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

SPECIMEN = "specimen"
"""Key of a run's metadata with the tested reducer's equipment data."""


def enter_run(registry: Registry, folder: RunFolder) -> None:
    """Add the missing entries of a run to the registry, in one transaction.

    Parameters
    ----------
    folder : RunFolder
        Folder of a running or sealed run.

    Raises
    ------
    RecordError
        The registry fails, the folder can't be read, or it is a copy.
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
            registry.end_run(folder, _measured_elsewhere(folder))
            for zeroing in _zeroings(folder):
                registry.add_zeroing(zeroing)


def require_original(folder: RunFolder) -> None:
    """Raise an error if a folder was copied or renamed; only an original folder is entered."""
    if folder.copy_of:
        raise RecordError(
            Message("folder {name} holds run {run_id}", folder.path.name, folder.copy_of),
            "the original folder of a run",
            "remove the copy, or give the renamed folder its original name",
        )


def _summary(folder: RunFolder) -> RunSummary:
    """Return the entry of a run's start."""
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
    """Return when the points of an external calibration were measured; None for a bench's run."""
    if "table" not in folder.metadata:
        return None
    start = next(document for _, document in folder.documents("start"))
    return datetime.fromtimestamp(float(start["time"]), UTC)


def _zeroings(folder: RunFolder) -> Iterator[Zeroing]:
    """Yield the zeros that a sealed run measured, for the transducers' control charts.

    The last zero of a failed run is left out, because the fault may have affected it.
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
