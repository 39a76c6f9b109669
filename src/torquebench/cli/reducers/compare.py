"""`torquebench test compare`: specimens of one type, or one specimen before and after."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from torquebench.cli.answers import COMPARED_QUANTITY
from torquebench.cli.export import find_run
from torquebench.cli.options import DEFAULT_DATA, DataOption, data_directory
from torquebench.cli.reports import check_reports, report_option, write_reports
from torquebench.cli.terminal.console import answer, narrow_table, out, say

if TYPE_CHECKING:
    from torquebench.campaign.reducers.comparison import ReducerComparison
    from torquebench.uncertainty import Budget


def compare(
    runs: Annotated[
        list[str], typer.Argument(help="Runs of one test: ids or their beginnings, or `latest`.")
    ],
    change: Annotated[
        bool, typer.Option("--change", help="Two runs of one specimen: before and after.")
    ] = False,
    report: Annotated[list[Path] | None, report_option("a page with figures")] = None,
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Compare specimens of one type, or one specimen before and after.

    Common errors of two runs on one bench with the same models cancel in a change.
    """
    from torquebench.campaign.reducers.comparison import compared, tested_specimen
    from torquebench.records import Registry

    check_reports(report)
    with Registry.open(data_directory(data)) as registry:
        found = compared(
            [tested_specimen(find_run(registry, name)) for name in runs], change=change
        )
    first = found.specimens[0]
    said = " - simulated" if found.simulated else ""
    say(f"[bold]{escape(first.reducer)}, {first.test}{said}[/bold]")
    if change:
        _print_change(found)
    else:
        _print_specimens(found)
    answer(
        reducer=first.reducer,
        test=first.test,
        simulated=found.simulated,
        serials=[each.serial for each in found.specimens],
        runs=[each.run_id for each in found.specimens],
        quantities=_quantities(found, change=change),
    )
    if found.left_out:
        say(f"[dim]{found.left_out} values that aren't in every run are left out[/dim]")
    if report:
        from torquebench.reports.reducers.comparison import comparison_page

        page = comparison_page(found)
        write_reports(page, report)


def _quantities(found: ReducerComparison, *, change: bool) -> list[dict[str, Any]]:
    def compared(key: str, estimate: Budget, **facts: Any) -> dict[str, Any]:
        values = [each.quantities[key].estimate.value for each in found.specimens]
        title = found.title(key)
        return COMPARED_QUANTITY.of(estimate, key=key, title=title, specimens=values, **facts)

    if change:
        return [
            compared(key, each.change, significant=each.significant)
            for key, each in found.changes.items()
        ]
    return [
        compared(key, each.mean, spread=each.spread, outliers=each.outliers)
        for key, each in found.values.items()
    ]


def _print_change(found: ReducerComparison) -> None:
    from torquebench.uncertainty import stated

    before, after = found.specimens
    common = "common errors of both runs cancel"
    table = narrow_table(
        f"specimen {escape(before.serial or '–')}: after minus before",
        columns=("", ">|before", ">|after", ">|change", ">|U", "|unit", "|"),
        caption="U of the change, 95.45 % coverage; "
        + (common if found.same_chain else "no errors cancel: different chains"),
    )
    for key, result in found.changes.items():
        value, expanded = stated(result.change.value, result.change.expanded_uncertainty())
        table.add_row(
            escape(found.title(key)),
            f"{before.quantities[key].estimate.value:.5g}",
            f"{after.quantities[key].estimate.value:.5g}",
            value,
            expanded,
            result.change.unit,
            "[yellow]changed[/yellow]" if result.significant else "",
        )
    out().print(table)


def _print_specimens(found: ReducerComparison) -> None:
    from torquebench.uncertainty import stated

    names = ", ".join(each.serial or "–" for each in found.specimens)
    table = narrow_table(
        f"{len(found.specimens)} specimens: {escape(names)}",
        columns=("", ">|mean", ">|U", ">|spread", ">|smallest", ">|largest", "|unit"),
        caption="U of the mean, 95.45 % coverage; spread: standard deviation between specimens",
    )
    outliers = []
    for key, result in found.values.items():
        values = [each.value for each in result.specimens.values()]
        table.add_row(
            escape(found.title(key)),
            *stated(result.mean.value, result.mean.expanded_uncertainty()),
            f"{result.spread:.3g}",
            f"{min(values):.5g}",
            f"{max(values):.5g}",
            result.mean.unit,
        )
        outliers += [f"{each}: {found.title(key)}" for each in result.outliers]
    out().print(table)
    for each in outliers:
        say(f"[yellow]stands out[/yellow]  {escape(each)}")
