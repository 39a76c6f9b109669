"""What all exports of a compiled table share: provenance in words, and complete files or none."""

from __future__ import annotations

import os
import uuid
from pathlib import Path

from torquebench.compensation.model_file import Provenance
from torquebench.compensation.table import CompensationTable
from torquebench.errors import RecordError

__all__ = ["provenance_lines", "write_whole"]


def provenance_lines(table: CompensationTable, provenance: Provenance) -> list[str]:
    """Say in plain lines what a table is, in which units, how exact, and where it came from.

    Parameters
    ----------
    table : CompensationTable
    provenance : Provenance

    Returns
    -------
    lines : list of str
        Plain ASCII, so that any compiler and any reader takes them.
    """
    uncertainty = table.uncertainty_curve
    lines = [
        "Torque compensation table, made by torquebench " + (provenance.software_version or "-"),
        f"model kind: {table.kind}",
        f"side: {provenance.side or '-'}; transducer: {provenance.transducer_serial or '-'}; "
        f"counter: {provenance.counter_identity or '-'}",
        f"training data SHA-256: {provenance.training_data_sha256 or '-'}",
        f"created: {provenance.created or '-'}",
        "unit of readings and torques: N m, clockwise positive",
        f"full scale: {table.full_scale_nm!r} N m; accepted readings: "
        f"{table.reading_low_nm!r} to {table.reading_high_nm!r} N m",
        "branch: +1 the size of the torque grew, -1 it fell, 0 unknown",
        f"deviation from the model: at most {table.bound_nm:.3g} N m",
    ]
    if uncertainty is not None:
        lines.append(
            "standard uncertainty: of the model's curve (k = 1), within "
            f"{uncertainty.bound:.3g} N m of the model's; a single reading's scatter is not in it"
        )
    return [line.encode("ascii", "replace").decode("ascii") for line in lines]


def write_whole(path: Path, content: bytes) -> Path:
    """Write a file so that its old content stays until the new one is complete.

    Raises
    ------
    RecordError
        When the file can't be written.
    """
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex}")
    try:
        with temporary.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as problem:
        temporary.unlink(missing_ok=True)
        raise RecordError(
            f"{path} can't be written ({problem.strerror})",
            remedy="choose a folder that exists and can be written to",
        ) from problem
    return path
