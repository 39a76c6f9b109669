"""IEC 61131-3 Structured Text export: table, interpolation and branch for PLCs."""

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


def export_structured_text(path: Path, table: CompensationTable, provenance: Provenance) -> Path:
    """Export a table as functions and a function block; names start with the file's own name.

    Parameters
    ----------
    path : Path
        Where to; ``output_module.st`` gives ``output_module_compensation``.
    """
    prefix = identifier(path)
    comments = "\n".join(line.replace("*)", "* )") for line in provenance_lines(table, provenance))
    parts = [f"(*\n{comments}\n*)", _function(table.curve, f"{prefix}_torque")]
    uncertainty = ""
    if table.uncertainty_curve is not None:
        parts.append(_function(table.uncertainty_curve, f"{prefix}_curve_uncertainty"))
        uncertainty = f"curve_uncertainty_nm := {prefix}_curve_uncertainty(reading_nm, branch);"
    low, high, turning = map(_real, (table.curve.low, table.curve.high, turning_nm(table)))
    parts.append(
        f"""(* Call it with every reading in the order of time. *)
FUNCTION_BLOCK {prefix}_compensation
VAR_INPUT
    reading_nm : LREAL;
END_VAR
VAR_OUTPUT
    torque_nm : LREAL;
    curve_uncertainty_nm : LREAL;
    branch : INT; (* 1 the size of the torque grew, -1 it fell, 0 unknown *)
    outside : BOOL; (* torque_nm carries the additional torque of the nearest limit *)
END_VAR
VAR
    started : BOOL := FALSE;
    direction : INT := 0;
    extreme_nm : LREAL := 0.0;
    moved_nm : LREAL := 0.0;
END_VAR
outside := NOT (reading_nm >= {low} AND reading_nm <= {high});
IF reading_nm = reading_nm THEN
    IF NOT started THEN
        started := TRUE;
        extreme_nm := reading_nm;
    END_IF;
    moved_nm := reading_nm - extreme_nm;
    IF (direction = 1 AND moved_nm > 0.0) OR (direction = -1 AND moved_nm < 0.0)
        OR ABS(moved_nm) > {turning} THEN
        IF moved_nm > 0.0 THEN
            direction := 1;
        ELSE
            direction := -1;
        END_IF;
        extreme_nm := reading_nm;
    END_IF;
    IF reading_nm >= 0.0 THEN
        branch := direction;
    ELSE
        branch := -direction;
    END_IF;
END_IF;
torque_nm := {prefix}_torque(reading_nm, branch);
{uncertainty}
END_FUNCTION_BLOCK
"""
    )
    atomic_write(path, "\n\n".join(parts).encode("ascii"))
    return path


def _real(value: float) -> str:
    """Write a real literal, which needs a decimal point."""
    mantissa, e, exponent = repr(float(value)).partition("e")
    return f"{mantissa}{'' if '.' in mantissa else '.0'}{'E' if e else ''}{exponent}"


def _function(curve: PiecewisePolynomial, name: str) -> str:
    """Return the function block of a curve in structured text, with its coefficients."""
    order, count = curve.degree + 1, curve.intervals
    rows = curve.coefficients if curve.branch_aware else curve.coefficients[1:2]
    numbers = [_real(value) for value in rows.ravel().tolist()]
    lines = ",\n".join(
        "        " + ", ".join(numbers[start : start + _PER_LINE])
        for start in range(0, len(numbers), _PER_LINE)
    )
    near = _real(curve.near)
    polynomial = f"c[first + {order - 1}]"  # Horner's scheme from the highest power down
    for power in range(order - 2, -1, -1):
        polynomial = f"({polynomial} * place + c[first + {power}])"
    side = ""
    if curve.branch_aware:
        side = f"""IF branch > 0 THEN
    first := first + {2 * count * order};
ELSIF branch = 0 THEN
    first := first + {count * order};
END_IF;
"""
    return f"""FUNCTION {name} : LREAL
VAR_INPUT
    reading_nm : LREAL;
    branch : INT;
END_VAR
VAR
    clamped : LREAL;
    location : LREAL;
    place : LREAL;
    interval : DINT;
    first : DINT;
END_VAR
VAR CONSTANT
    (* of the place in an interval, -0.5 to 0.5: [branch][interval][power] *)
    c : ARRAY[0..{len(numbers) - 1}] OF LREAL := [
{lines}
    ];
END_VAR
clamped := LIMIT({_real(curve.low)}, reading_nm, {_real(curve.high)});
location := clamped * {_real(curve.scale)} + LIMIT(-{near}, clamped, {near}) * {_real(curve.extra)}
    + {_real(curve.zero)};
interval := TRUNC(location + 0.5);
place := location - DINT_TO_LREAL(interval);
first := interval * {order};
{side}{name} := {polynomial}{" + reading_nm" if curve.gain else ""};
END_FUNCTION"""
