"""Exports of a compiled table; the file name's ending gives the format."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from torquebench.atomic_write import is_standard_output
from torquebench.compensation.export.c_header import export_header
from torquebench.compensation.export.csv_table import export_csv
from torquebench.compensation.export.onnx_graph import export_onnx
from torquebench.compensation.export.structured_text import export_structured_text
from torquebench.compensation.model_file import Provenance
from torquebench.errors import InputError
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.compensation.table import CompensationTable

EXPORTS: dict[str, Callable[[Path, CompensationTable, Provenance], Path]] = {
    ".csv": export_csv,
    ".h": export_header,
    ".onnx": export_onnx,
    ".st": export_structured_text,
}
"""Exporters by file name ending."""


def check_export(path: Path, *, decimal_comma: bool = False) -> None:
    """Refuse a file whose ending names no format, before any work is done for it.

    Raises
    ------
    InputError
        With another ending than those of `EXPORTS`, or a decimal comma elsewhere than in CSV.
    """
    ending = _ending(path)
    if ending not in EXPORTS:
        raise InputError(
            Message("export to {name}", path.name),
            ", ".join(sorted(EXPORTS)),
            "choose one of these endings",
        )
    if decimal_comma and ending != ".csv":
        raise InputError(
            Message("a decimal comma in {name}", path.name),
            "a decimal comma in .csv",
            "export without it",
        )


def export_table(
    path: str | Path,
    table: CompensationTable,
    provenance: Provenance,
    *,
    decimal_comma: bool = False,
) -> Path:
    """Export a compiled table in the format that the file's ending names.

    Parameters
    ----------
    path : str or Path
        ``.csv`` (nodes for linear interpolation, LabVIEW and others), ``.h`` (C header), ``.st``
        (IEC 61131-3 Structured Text for PLCs) or ``.onnx`` (needs the extra ``onnx``). An existing
        file is replaced when the new one is complete.
    table : CompensationTable
        Compiled model.
    provenance : Provenance
        Origin of the model, written into the file.
    decimal_comma : bool, default False
        Whether numbers of a CSV have a comma, and semicolons between them.

    Raises
    ------
    InputError
        With another ending, where the extra isn't installed, or the file can't be written.
    """
    target = Path(path)
    check_export(target, decimal_comma=decimal_comma)
    if decimal_comma:
        return export_csv(target, table, provenance, decimal_comma=True)
    return EXPORTS[_ending(target)](target, table, provenance)


def _ending(path: Path) -> str:
    """Return the format of a file name; standard output gets CSV."""
    return ".csv" if is_standard_output(path) else path.suffix.lower()
