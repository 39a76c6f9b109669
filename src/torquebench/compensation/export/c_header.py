"""C header export: the table and its interpolation for controllers, without any library."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from torquebench.atomic_write import atomic_write
from torquebench.compensation.export.branches import turning_nm
from torquebench.compensation.export.shared import identifier, provenance_lines
from torquebench.compensation.model_file import Provenance

if TYPE_CHECKING:
    from torquebench.compensation.piecewise import PiecewisePolynomial
    from torquebench.compensation.table import CompensationTable

_PER_LINE = 4


def export_header(path: Path, table: CompensationTable, provenance: Provenance) -> Path:
    """Export a table as a C99 header; names start with the file's own name.

    Parameters
    ----------
    path : Path
        File to be written; ``output_module.h`` gives ``output_module_torque``.
    """
    atomic_write(path, header_text(table, provenance, identifier(path)).encode("ascii"))
    return path


def header_text(table: CompensationTable, provenance: Provenance, prefix: str) -> str:
    """Return the header's text.

    Parameters
    ----------
    prefix : str
        A C identifier that all names start with.

    Returns
    -------
    text : str
        Plain ASCII, C99, no includes.
    """
    guard = f"{prefix.upper()}_TABLE_H"
    comments = "\n".join(f" * {line}" for line in provenance_lines(table, provenance))
    parts = [
        f"/*\n{comments}\n *\n"
        f" * int {prefix}_torque(double reading_nm, int branch, double *torque_nm)\n"
        " *   returns 0, or 1 where the reading is outside the accepted range or not a number;\n"
        " *   the torque then carries the additional torque of the nearest limit.\n"
        f" * int {prefix}_branch(double reading_nm, {prefix}_history *history)\n"
        " *   returns the branch by the readings so far: call it with each of them. Begin with\n"
        f" *   {prefix}_history history = {{0, 0, 0.0}};\n */",
        f"#ifndef {guard}\n#define {guard}",
        _function(table.curve, prefix, "torque"),
    ]
    if table.uncertainty_curve is not None:
        parts.append(_function(table.uncertainty_curve, prefix, "curve_uncertainty"))
    parts.append(_branch_function(prefix, turning_nm(table)))
    parts.append(f"#endif /* {guard} */\n")
    return "\n\n".join(parts)


def _branch_function(prefix: str, turning: float) -> str:
    """Return the C function that determines the branch from the readings so far."""
    return f"""typedef struct {{
    int started, direction;
    double extreme_nm;
}} {prefix}_history;

static inline int {prefix}_branch(double reading_nm, {prefix}_history *history)
{{
    double moved;
    if (!history->started) {{
        history->started = reading_nm - reading_nm == 0.0;
        history->extreme_nm = reading_nm;
    }}
    moved = reading_nm - history->extreme_nm;
    if (moved * history->direction > 0.0 || moved > {turning!r} || moved < -{turning!r}) {{
        history->direction = moved > 0.0 ? 1 : -1;
        history->extreme_nm = reading_nm;
    }}
    return reading_nm >= 0.0 ? history->direction : -history->direction;
}}"""


def _function(curve: PiecewisePolynomial, prefix: str, what: str) -> str:
    """Return the C function of a curve with its table of coefficients."""
    name = f"{prefix}_{what}"
    order = curve.degree + 1
    branches = 3 if curve.branch_aware else 1
    rows = curve.coefficients if curve.branch_aware else curve.coefficients[1:2]
    numbers = [repr(value) for value in rows.ravel().tolist()]
    lines = [
        "    " + ", ".join(numbers[start : start + _PER_LINE])
        for start in range(0, len(numbers), _PER_LINE)
    ]
    side = "(branch > 0) - (branch < 0) + 1" if curve.branch_aware else "0"
    # Horner's scheme from the highest power down
    polynomial = f"c[{order - 1}]"
    for power in range(order - 2, -1, -1):
        polynomial = f"({polynomial} * place + c[{power}])"
    total = f"{polynomial} + reading_nm" if curve.gain else polynomial
    unused = "" if curve.branch_aware else "\n    (void)branch;"
    count = curve.intervals
    table = ",\n".join(lines)
    return f"""/* Coefficients [branch][interval][power] of the place in an interval, -0.5 to 0.5 */
static const double {name}_coefficients[{branches * count * order}] = {{
{table}
}};

static inline int {name}(double reading_nm, int branch, double *{what}_nm)
{{
    const double low = {curve.low!r}, high = {curve.high!r}, near = {curve.near!r};
    const int outside = !(reading_nm >= low && reading_nm <= high);
    double clamped = reading_nm > low ? reading_nm : low;
    double central, location, place;
    const double *c;
    int interval;{unused}
    if (clamped > high) {{
        clamped = high;
    }}
    central = clamped > -near ? clamped : -near;
    if (central > near) {{
        central = near;
    }}
    location = clamped * {curve.scale!r} + central * {curve.extra!r} + {curve.zero!r};
    interval = (int)(location + 0.5);
    place = location - interval;
    c = {name}_coefficients + {order} * (interval + {count} * ({side}));
    *{what}_nm = {total};
    return outside;
}}"""
