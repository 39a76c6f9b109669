"""Tables of errors within 80 columns: N·m, % of full scale and % of reading side by side."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from torquebench.calibration import ErrorSummary
    from torquebench.campaign.results import CompensationResult, FrictionSweep, ModuleResult

__all__ = ["error_blocks", "friction_blocks", "module_blocks", "significant"]

NAME_COLUMNS = 29
NUMBER_COLUMNS = 8


def significant(value: float | None, digits: int = 3) -> str:
    """Return a value with so many significant digits and no exponent.

    Examples
    --------
    >>> significant(0.045678), significant(12.3456), significant(0.0), significant(None)
    ('0.0457', '12.3', '0', '-')
    """
    if value is None:
        return "-"
    if value == 0.0:
        return "0"
    text = f"{value:.{digits}g}"
    if "e" not in text:
        # Keep trailing zeros: 0.0450 says more than 0.045.
        return f"{value:#.{digits}g}".rstrip(".")
    return f"{float(text):f}".rstrip("0").rstrip(".")


def _grid() -> Table:
    table = Table.grid(padding=0)
    table.add_column(width=NAME_COLUMNS, no_wrap=True)
    for _ in range(6):
        table.add_column(width=NUMBER_COLUMNS, justify="right", no_wrap=True)
    return table


def _numbers(summary: ErrorSummary) -> list[str]:
    return [
        significant(summary.worst_nm),
        significant(summary.rms_nm),
        significant(summary.worst_percent_fs),
        significant(summary.rms_percent_fs),
        significant(summary.worst_percent_reading),
        significant(summary.rms_percent_reading),
    ]


def error_blocks(
    blocks: Iterable[tuple[str, Sequence[tuple[str, ErrorSummary]]]],
) -> Iterable[RenderableType]:
    """Yield blocks of errors under one heading.

    Parameters
    ----------
    blocks : iterable of (title, rows)
        Each row is a name and its errors; a name that begins with an asterisk is emphasised.
    """
    head = _grid()
    head.add_row("", *(Text(text, style="bold") for text in ("worst", "RMS") * 3))
    units = ("N·m", "N·m", "% FS", "% FS", "% rdg", "% rdg")
    head.add_row("", *(Text(text, style="dim") for text in units))
    yield head
    for title, rows in blocks:
        if not rows:
            continue
        yield Text(title, style="italic")
        body = _grid()
        for name, summary in rows:
            chosen = name.startswith("*")
            style = "bold green" if chosen else ""
            label = f"{'*' if chosen else ' '} {name.removeprefix('*')}"
            body.add_row(label, *_numbers(summary), style=style)
        yield body


def _label(result: CompensationResult) -> str:
    return ("*" if result.recommended else "") + result.title


def module_blocks(module: ModuleResult) -> Iterable[RenderableType]:
    """Yield the closing table of one module: every model, against every reference."""
    simulated = " - simulated" if module.calibration.simulated else ""
    title = (
        f"{module.side.capitalize()} module, {module.range_nm:g} N·m, "
        f"transducer {module.transducer_serial}{simulated}"
    )
    yield Text(title, style="bold")
    results = (module.raw, *module.models)
    groups = len(module.raw.verification.groups)
    count = f"{len(module.verification)} readings in {groups} groups"
    standard = [(_label(r), r.verification.against_standard) for r in results]
    truth = [
        (_label(r), r.verification.against_truth)
        for r in results
        if r.verification.against_truth is not None
    ]
    averaged = [
        (_label(r), r.verification.averaged) for r in results if r.verification.averaged is not None
    ]
    dense = [(_label(r), r.dense) for r in results if r.dense is not None]
    yield from error_blocks(
        [
            (f"{count}, against the standard", standard),
            (f"{count}, against the true torque", truth),
            (f"averaged over the groups, against the {_reference(module)}", averaged),
            ("dense noise-free sweep, against the true torque", dense),
        ]
    )
    yield from _repeatability(module)


def _reference(module: ModuleResult) -> str:
    return "true torque" if module.verification.simulated else "standard"


def _repeatability(module: ModuleResult) -> Iterable[RenderableType]:
    rows = []
    for result in (module.raw, *module.models):
        found = result.verification.repeatability
        if found is not None:
            rows.append((_label(result), found))
    if rows:
        yield Text("repeatability over the groups (worst place, pooled)", style="italic")
        body = _grid()
        for name, found in rows:
            chosen = name.startswith("*")
            body.add_row(
                f"{'*' if chosen else ' '} {name.removeprefix('*')}",
                significant(found.worst_nm),
                significant(found.pooled_nm),
                significant(found.worst_percent_fs),
                significant(found.pooled_percent_fs),
                style="bold green" if chosen else "",
            )
        yield body


def friction_blocks(sweep: FrictionSweep, *, simulated: bool) -> Iterable[RenderableType]:
    """Yield the no-load friction of a sweep: mean over repeats and branches at each speed."""
    import numpy as np

    from torquebench.cli.console import narrow_table

    words = "compensated" if sweep.compensated else "not compensated"
    marked = " - simulated" if simulated else ""
    repeats = np.unique(sweep.repeat).size
    yield Text(f"No-load friction at the input, {repeats} repeats, {words}{marked}", style="bold")
    table = narrow_table()
    for heading in ("rpm", "clockwise mN·m", "spread", "counter-cw. mN·m", "spread"):
        table.add_column(heading, justify="right")
    nominal = np.abs(sweep.nominal_rpm)
    for speed in np.unique(nominal):
        cells = [f"{speed:g}"]
        for sign in (1, -1):
            torque = sweep.torque_nm[(nominal == speed) & (np.sign(sweep.nominal_rpm) == sign)]
            cells += _mean_and_spread(1e3 * torque) if torque.size else ["-", "-"]
        table.add_row(*cells)
    yield table


def _mean_and_spread(values: NDArray[np.float64]) -> list[str]:
    """Return the mean and half the range over repeats and branches."""
    half_range = 0.5 * float(values.max() - values.min())
    return [f"{float(values.mean()):.1f}", f"±{half_range:.1f}"]
