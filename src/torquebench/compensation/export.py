"""Exports of a compiled table, by the ending of the file's name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from torquebench.compensation.export_csv import export_csv
from torquebench.compensation.export_header import export_header
from torquebench.compensation.export_onnx import export_onnx
from torquebench.compensation.model_file import Provenance
from torquebench.compensation.table import CompensationTable
from torquebench.errors import InputError

__all__ = ["EXPORTS", "export_table"]

EXPORTS: dict[str, Callable[[Path, CompensationTable, Provenance], Path]] = {
    ".csv": export_csv,
    ".h": export_header,
    ".onnx": export_onnx,
}
"""Exporters by the ending of the file's name."""


def export_table(path: str | Path, table: CompensationTable, provenance: Provenance) -> Path:
    """Export a compiled table in the format that the file's ending names.

    Parameters
    ----------
    path : str or Path
        ``.csv`` (nodes for linear interpolation, LabVIEW and others), ``.h`` (C header) or
        ``.onnx`` (needs the extra ``onnx``). An existing file is replaced when the new one is
        complete.
    table : CompensationTable
        Compiled model.
    provenance : Provenance
        Where the model came from; written into the file.

    Returns
    -------
    path : Path

    Raises
    ------
    InputError
        With another ending, or where the extra isn't installed.
    RecordError
        When the file can't be written.
    """
    target = Path(path)
    exporter = EXPORTS.get(target.suffix.lower())
    if exporter is None:
        raise InputError(
            f"export to {target.name}", ", ".join(sorted(EXPORTS)), "choose one of these endings"
        )
    return exporter(target, table, provenance)
