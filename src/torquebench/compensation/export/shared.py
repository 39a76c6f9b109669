"""Text that all exports share: the provenance of a compiled table, and names in code."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from torquebench.compensation.export.branches import partial_loop_deviation, turning_nm
from torquebench.compensation.model_file import Provenance, ReadingScale

if TYPE_CHECKING:
    from torquebench.compensation.table import CompensationTable


def identifier(path: Path) -> str:
    """Return the prefix of all names in an exported source file: the file's own name."""
    prefix = re.sub(r"\W", "_", path.stem, flags=re.ASCII)
    return f"table_{prefix}" if not prefix or prefix[0].isdigit() else prefix


def provenance_lines(table: CompensationTable, provenance: Provenance) -> list[str]:
    """Describe a table in lines of text: content, units, accuracy and origin.

    Returns
    -------
    lines : list of str
        Plain ASCII, so that any compiler and any reader accepts them.
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
    if table.curve.branch_aware:
        lines += [
            f"the branch turns where a reading has moved back by {turning_nm(table):.4g} N m from "
            "its last extreme; 0 until it has moved so far at all",
            "partial loops: after reversals in mid-range the branch alone deviates from the model "
            f"with its memory by at most {partial_loop_deviation(table):.2g} N m",
        ]
    if provenance.reading_scale:
        formula = ReadingScale.of_text(provenance.reading_scale).formula
        lines.insert(6, f"readings of the calibration, to be converted alike: {formula}")
    if uncertainty is not None:
        lines.append(
            "curve uncertainty: standard uncertainty (k = 1) of the model's curve alone, within "
            f"{uncertainty.bound:.3g} N m of the model's; scatter, standard, zero, temperature and "
            "all other parts of U are not in it"
        )
    if "noise_nm" in provenance.metrics:
        lines.append(
            f"scatter of a single reading: {provenance.metrics['noise_nm']:.3g} N m (k = 1)"
        )
    plain = str.maketrans({"·": " ", "×": "*", "µ": "u", "²": "2", "°": "deg "})
    return [line.translate(plain).encode("ascii", "replace").decode("ascii") for line in lines]
