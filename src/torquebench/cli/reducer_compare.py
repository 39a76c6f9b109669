"""`torquebench test compare`: specimens of one type, or one specimen before and after."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from torquebench.cli.console import narrow_table, out, say
from torquebench.cli.export import find_run
from torquebench.cli.options import DEFAULT_DATA, DataOption, data_directory
from torquebench.cli.reducer_tables import stated
from torquebench.errors import InputError

if TYPE_CHECKING:
    from torquebench.records import Registry
    from torquebench.uncertainty import Budget

__all__ = ["compare"]


@dataclass(frozen=True)
class _Tested:
    """What a run of a reducer test found."""

    run_id: str
    test: str
    reducer: str
    serial: str
    bench: str
    chain: Any
    simulated: bool
    titles: dict[str, str]
    budgets: dict[str, Budget]


def compare(
    runs: Annotated[
        list[str], typer.Argument(help="Runs of one test: ids or their beginnings, or `latest`.")
    ],
    change: Annotated[
        bool, typer.Option("--change", help="Two runs of one specimen: before and after.")
    ] = False,
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Compare specimens of one type, or one specimen before and after.

    What both runs have in common on one bench with the same models cancels in a change.
    """
    from torquebench.records import Registry

    with Registry.open(data_directory(data)) as registry:
        found = [_tested(registry, name) for name in runs]
    _check(found, change)
    first = found[0]
    said = " - simulated" if any(each.simulated for each in found) else ""
    say(f"[bold]{escape(first.reducer)}, {first.test}{said}[/bold]")
    keys = [key for key in first.budgets if all(key in each.budgets for each in found)]
    if not keys:
        raise InputError("runs that hold no value in common", "runs with the same settings")
    if change:
        _print_change(found, keys)
    else:
        _print_specimens(found, keys)
    every = {key for each in found for key in each.budgets}
    if left := len(every) - len(keys):
        say(f"[dim]{left} values that aren't in every run are left out[/dim]")


def _tested(registry: Registry, name: str) -> _Tested:
    from torquebench.campaign.reducer_results import budget_from_plain
    from torquebench.records import RunFolder

    run = find_run(registry, name)
    folder = RunFolder.open(run.folder)
    results = folder.results
    if not (isinstance(results, dict) and run.kind.startswith("test-") and "quantities" in results):
        raise InputError(
            f"run {run.run_id} ({run.kind}, {run.status})",
            "a completed reducer test",
            "look for runs of the kind test-… in `torquebench records list`",
        )
    rows = results["quantities"]
    return _Tested(
        run_id=run.run_id,
        test=str(results["test"]),
        reducer=str(results["reducer"]["name"]),
        serial=str(results["serial"]),
        bench=run.bench,
        chain=folder.metadata.get("compensation"),
        simulated=run.simulated,
        titles={row["key"]: row["title"] for row in rows},
        budgets={row["key"]: budget_from_plain(row["budget"]) for row in rows},
    )


def _check(found: Sequence[_Tested], change: bool) -> None:
    if len({each.run_id for each in found}) < max(2, len(found)):
        raise InputError(
            f"{len(found)} runs, {len({each.run_id for each in found})} of them different",
            "two runs or more",
        )
    for what in ("test", "reducer"):
        names = sorted({getattr(each, what) for each in found})
        if len(names) > 1:
            raise InputError(f"runs of {' and '.join(names)}", f"one {what}")
    serials = [each.serial for each in found]
    if change and (len(found) != 2 or len(set(serials)) > 1):
        raise InputError(
            f"{len(found)} runs of {', '.join(each or 'no serial' for each in serials)}",
            "two runs of one specimen for --change",
            "name the run before and the run after, or leave --change out",
        )
    if not change and len(set(serials)) < len(serials):
        raise InputError(
            f"several runs of one specimen: {', '.join(each or 'no serial' for each in serials)}",
            "one run a specimen",
            "give --serial when testing, or --change for before and after",
        )


def _print_change(found: Sequence[_Tested], keys: Sequence[str]) -> None:
    from torquebench.reducers import change_between

    before, after = found
    same = before.bench == after.bench and before.chain == after.chain
    common = "what both runs have in common cancels" if same else "nothing cancels: other chains"
    table = narrow_table(
        f"specimen {escape(before.serial or '–')}: after less before",
        caption=f"U of the change, 95.45 % coverage; {common}",
    )
    table.add_column("", overflow="fold")
    for heading in ("before", "after", "change", "U"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    table.add_column("", no_wrap=True)
    for key in keys:
        first, second = before.budgets[key], after.budgets[key]
        result = change_between(key, first, second, same_bench=same)
        value, expanded = stated(result.change.value, result.change.expanded_uncertainty())
        table.add_row(
            escape(before.titles[key]),
            f"{first.value:.5g}",
            f"{second.value:.5g}",
            value,
            expanded,
            first.unit,
            "[yellow]changed[/yellow]" if result.significant else "",
        )
    out().print(table)


def _print_specimens(found: Sequence[_Tested], keys: Sequence[str]) -> None:
    from torquebench.reducers import compare_specimens

    table = narrow_table(
        f"{len(found)} specimens: {escape(', '.join(each.serial or '–' for each in found))}",
        caption="U of the mean, 95.45 % coverage; spread: standard deviation between specimens",
    )
    table.add_column("", overflow="fold")
    for heading in ("mean", "U", "spread", "smallest", "largest"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    outliers = []
    for key in keys:
        specimens = {each.serial or each.run_id: each.budgets[key] for each in found}
        result = compare_specimens(key, specimens)
        values = [each.value for each in specimens.values()]
        table.add_row(
            escape(found[0].titles[key]),
            *stated(result.mean.value, result.mean.expanded_uncertainty()),
            f"{result.spread:.3g}",
            f"{min(values):.5g}",
            f"{max(values):.5g}",
            result.mean.unit,
        )
        outliers += [f"{each}: {found[0].titles[key]}" for each in result.outliers]
    out().print(table)
    for each in outliers:
        say(f"[yellow]stands out[/yellow]  {escape(each)}")
