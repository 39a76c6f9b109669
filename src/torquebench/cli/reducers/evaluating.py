"""Tables of reducer tests within 80 columns: planned steps and results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich.markup import escape

from torquebench.cli.terminal.console import narrow_table, out

if TYPE_CHECKING:
    from torquebench.campaign.reducers.quantities import ReducerTestQuantity


def print_by_speed(
    title: str, result: Any, stated_of: Mapping[str, tuple[float, float]]
) -> set[str]:
    """Print an efficiency map or no-load torques as tables by speed, and return their keys.

    `stated_of` has value and U of each point; of other results nothing is printed.
    """
    from torquebench.reducers import EfficiencyMap, NoLoadResult
    from torquebench.reports.reducers.report import (
        NO_LOAD_POINT,
        efficiency_tables,
        no_load_table,
    )

    if isinstance(result, EfficiencyMap):
        tables, shown = efficiency_tables(result, stated_of), set(stated_of)
    elif isinstance(result, NoLoadResult):
        tables = [no_load_table(result, stated_of)]
        shown = {key for key in stated_of if key.startswith(NO_LOAD_POINT)}
    else:
        return set()
    for header, rows, caption in tables:
        table = narrow_table(title, caption=caption)
        for name in header:
            heading = name.replace(" rpm", "\nrpm").replace(", N·m", "\nN·m")
            heading = heading.replace(" of ", " of\n").replace("-clock", "-\nclock")
            table.add_column(heading, justify="right")
        for row in rows:
            table.add_row(*row)
        out().print(table)
    return shown


def print_quantities(
    title: str,
    result: Any,
    quantities: Sequence[ReducerTestQuantity],
    factors: Mapping[str, float] | None = None,
) -> None:
    """Print the quantities of a result: by speed where they are, the others as a list.

    Parameters
    ----------
    title : str
    result : ReducerResult
    quantities : sequence of ReducerTestQuantity
    factors : mapping of str to float, optional
        Coverage factor of each, by its key.
    """
    from torquebench.uncertainty import stated

    title = escape(title)
    stated_of = {each.key: (each.value, each.expanded_uncertainty) for each in quantities}
    shown = print_by_speed(title, result, stated_of)
    quantities = [each for each in quantities if each.verdict or each.key not in shown]
    if not quantities:
        return
    columns = ["", ">|value", ">|U", *([">|k"] if factors else []), "|unit"]
    judged = any(each.verdict for each in quantities)
    columns += ["|limit", "|verdict"] * judged
    caption = "U: expanded uncertainty, 95.45 % coverage" + "; guard band w = U" * judged
    table = narrow_table(title, columns=columns, caption=caption)
    for each in quantities:
        if each.key.startswith("order_") and each.value < each.expanded_uncertainty:
            continue  # an order within its uncertainty says nothing
        cells = [*stated(each.value, each.expanded_uncertainty)]
        if factors:
            cells.append(f"{factors[each.key]:.2f}")
        cells.append(each.unit)
        if judged and each.verdict:
            style = "red" if each.verdict.failed else "green"
            words = f"[{style}]{each.verdict.label}[/{style}]"
            cells += [each.limit.removesuffix(f" {each.unit}"), words]
        table.add_row(escape(each.title), *cells)
        if each.rule:
            table.add_row(f"[dim]  {escape(each.rule)}[/dim]")
    out().print(table)
