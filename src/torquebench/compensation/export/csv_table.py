"""CSV export: nodes of the compensated torque for linear interpolation, as in LabVIEW."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from torquebench.atomic_write import atomic_write
from torquebench.compensation.export.shared import provenance_lines
from torquebench.compensation.model_file import Provenance
from torquebench.errors import InputError

if TYPE_CHECKING:
    from torquebench.compensation.table import CompensationTable

FloatArray = NDArray[np.float64]

_BRANCHES = ((1, "up"), (-1, "down"), (0, "unknown"))
_LINEAR_SHARE = 5e-7
"""Largest error that linear interpolation adds to the table's own bound, as a share of full scale.
"""

_UNCERTAINTY_SHARE = 0.03
"""Largest relative change of the standard uncertainty from row to row."""

_BESIDE_ZERO = 1e-9
"""Distance of the two rows that represent a step at torque reversal, as a share of full scale."""


def export_csv(
    path: Path,
    table: CompensationTable,
    provenance: Provenance,
    *,
    decimal_comma: bool = False,
) -> Path:
    """Export nodes of torque (and standard uncertainty) over reading, one column a branch.

    Parameters
    ----------
    path : Path
        Where to.
    decimal_comma : bool, default False
        Whether numbers have a comma, as German LabVIEW and Excel read them; semicolons between.

    Notes
    -----
    The header lines start with ``#``; the first one states their number. Then one line of column
    names and the rows, readings strictly ascending. Numbers have full precision. Linear
    interpolation between the rows keeps the bound that the comments state.
    """
    nodes, added = table_nodes(table)
    columns: dict[str, FloatArray] = {"reading_nm": nodes}
    for branch, name in _BRANCHES:
        columns[f"torque_{name}_nm"] = _values(table, nodes, branch, uncertainty=False)
    if table.uncertainty_curve is not None:
        for branch, name in _BRANCHES:
            values = _values(table, nodes, branch, uncertainty=True)
            columns[f"curve_uncertainty_{name}_nm"] = values
    comments = [
        *provenance_lines(table, provenance),
        f"linear interpolation between the rows deviates from the model by at most "
        f"{table.bound_nm + added:.3g} N m",
        "refuse readings outside the rows; do not extrapolate",
    ]
    comments.insert(0, f"{len(comments) + 1} lines of comment, then column names, then numbers")
    rows = np.column_stack(list(columns.values())).tolist()
    lines = [f"# {comment}" for comment in comments]
    separator = ";" if decimal_comma else ","
    lines.append(separator.join(columns))
    numbers = (separator.join(map(repr, row)) for row in rows)
    lines.extend(row.replace(".", ",") if decimal_comma else row for row in numbers)
    atomic_write(path, ("\r\n".join(lines) + "\r\n").encode("ascii"))
    return path


def table_nodes(table: CompensationTable) -> tuple[FloatArray, float]:
    """Choose readings such that linear interpolation between them follows the table.

    Returns
    -------
    reading_nm : float64 array of shape (n,)
        Strictly ascending, from the lowest to the highest accepted reading.
    added_nm : float
        Error that linear interpolation adds to the table's bound.

    Raises
    ------
    InputError
        When a cubic table would need more than a million rows.
    """
    edges = table.curve.nodes()
    beside = _BESIDE_ZERO * table.full_scale_nm
    for parts in (1, 2, 4, 8, 16, 32, 64):
        steps = np.arange(parts) / parts
        nodes = (edges[:-1, None] + np.diff(edges)[:, None] * steps).ravel()
        nodes = np.append(nodes, edges[-1])
        if nodes.size > 1_000_000:
            break
        if edges[0] < 0.0 < edges[-1] and _jumps_at_zero(table):
            nodes = np.sort(np.append(nodes, -beside))
        nodes = nodes[np.append(True, np.diff(nodes) > 0.5 * beside)]
        added = max(_linear_deviation(table, nodes, branch) for branch, _ in _BRANCHES)
        if added <= _LINEAR_SHARE * table.full_scale_nm and _follow_uncertainty(table, nodes):
            return nodes, added
    raise InputError(
        "a table whose linear interpolation needs more than a million rows",
        "a smoother model",
        "export it as a C header or ONNX",
    )


def _linear_deviation(table: CompensationTable, nodes: FloatArray, branch: int) -> float:
    """Return the largest error of linear interpolation between the nodes on one branch."""
    values = _values(table, nodes, branch, uncertainty=False)
    worst = 0.0
    for share in (0.25, 0.5, 0.75):
        between = nodes[:-1] + share * np.diff(nodes)
        line = values[:-1] + share * np.diff(values)
        deviation = np.abs(line - _values(table, between, branch, uncertainty=False))
        worst = max(worst, float(np.max(deviation[np.diff(nodes) > 1e-8 * table.full_scale_nm])))
    # between the three points a cubic's deviation may be larger, by less than a tenth
    return 1.1 * worst


def _follow_uncertainty(table: CompensationTable, nodes: FloatArray) -> bool:
    """Return whether the rows are close enough for the standard uncertainty as well."""
    if table.uncertainty_curve is None:
        return True
    middle, negligible = 0.5 * (nodes[:-1] + nodes[1:]), 1e-6 * table.full_scale_nm
    for branch, _ in _BRANCHES:
        rows = _values(table, nodes, branch, uncertainty=True)
        stated = _values(table, middle, branch, uncertainty=True)
        off = np.abs(0.5 * (rows[:-1] + rows[1:]) - stated)
        if np.any(off > _UNCERTAINTY_SHARE * stated + negligible):
            return False
    return True


def _jumps_at_zero(table: CompensationTable) -> bool:
    """Return whether a branch of the curve jumps at zero."""
    return any(
        abs(table.at(0.0, branch) - table.at(-1e-12 * table.full_scale_nm, branch))
        > 0.1 * _LINEAR_SHARE * table.full_scale_nm
        for branch, _ in _BRANCHES
    )


def _values(
    table: CompensationTable, reading: FloatArray, branch: int, *, uncertainty: bool
) -> FloatArray:
    """Return a branch's torques, or their standard uncertainties, at readings."""
    branches = np.full(reading.size, branch, dtype=np.int8)
    if uncertainty:
        return table.standard_uncertainty(reading, branches)
    return table.torque(reading, branches)
