"""The page that compares specimens of one type, or one specimen before and after a change."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan

from torquebench.campaign.reducers.comparison import ReducerComparison, SpecimenResults
from torquebench.message import Message
from torquebench.reports.errors_table import number
from torquebench.reports.page import Drawings, Facts, Page, Section, Table
from torquebench.reports.reducers.comparison_figures import difference_figure, values_figure
from torquebench.uncertainty import Verdict, stated

FAMILIES = {
    "no_load_": "No-load running torque",
    "efficiency_": "Efficiency",
    "order_": "Orders of the transmission error",
}
"""Titles of quantities with many values, whose differences are drawn, by prefix of their keys."""
MOST_PANELS = 8
MOST_COLUMNS = 4


def comparison_page(found: ReducerComparison) -> Page:
    """Return the page of a comparison.

    Parameters
    ----------
    found : ReducerComparison

    Returns
    -------
    Page
        Ready for `torquebench.reports.page_pdf.write_report`.
    """
    first = found.specimens[0]
    what = f"{first.reducer}, {first.test}"
    if found.changes:
        specimen = f" of specimen {first.serial}" if first.serial else ""
        title = f"Before and after{specimen}: {what}"
    else:
        title = f"{len(found.specimens)} specimens: {what}"
    benches = ", ".join(sorted({each.bench for each in found.specimens}))
    return Page(
        title=title,
        subtitle=benches,
        sections=[
            Section("", "", (_facts(found), Drawings(lambda: _figures(found)))),
            *_tables(found),
        ],
        simulated=found.simulated,
    )


def _facts(found: ReducerComparison) -> Facts:
    rows: list[tuple[str, str]] = []
    names = ("Before", "After") if found.changes else [each.name for each in found.specimens]
    for name, each in zip(names, found.specimens, strict=True):
        words = Message("run {run_id}, short test" if each.short else "run {run_id}", each.run_id)
        rows.append((name, Message.joined((words, _judged(each)), "; ")))
    if found.changes:
        changed = [found.title(key) for key, each in found.changes.items() if each.significant]
        changes = Message.joined(changed, "; ") if changed else "nothing"
        rows.append(("Changed by more than U", changes))
    else:
        outliers = [
            Message("{serial} ({quantity})", serial, found.title(key))
            for key, each in found.values.items()
            for serial in each.outliers
        ]
        few = "at least four specimens are needed for a statement"
        none = "none" if len(found.specimens) >= 4 else few
        rows.append(("Standing out", Message.joined(outliers, "; ") if outliers else none))
    common = "one bench with the same models: errors common to all runs cancel in differences"
    rows.append(("Chain", common if found.same_chain else "different chains: nothing cancels"))
    if found.left_out:
        rows.append(
            ("Left out", Message("{count} values that aren't in every run", found.left_out))
        )
    return Facts(rows)


def _judged(specimen: SpecimenResults) -> str:
    """State how often each verdict against the data sheet occurred."""
    verdicts = [each.verdict for each in specimen.quantities.values() if each.verdict]
    if not verdicts:
        return "nothing was judged"
    counts = {each: verdicts.count(each) for each in dict.fromkeys(verdicts)}
    words = Message.joined(
        Message("{count} × {verdict}", count, Verdict(each).label) for each, count in counts.items()
    )
    return Message("against the data sheet: {verdicts}", words)


# -- figures --------------------------------------------------------------------------------


def _figures(found: ReducerComparison) -> list[tuple[str, str]]:
    single, families = _drawn(found)
    figures = []
    if single:
        caption = (
            "Values ± U; dashed: limit of the data sheet, where it is near."
            if found.changes
            else "Values ± U; grey: their mean ± its U; dashed: limit of the data sheet, where it "
            "is near."
        )
        figures.append((values_figure(found, single), caption))
    for title, keys in families.items():
        against = "after less before" if found.changes else "less the mean of all specimens"
        caption = Message("{quantity}: {against}, ± U of the difference.", title, against)
        figures.append((difference_figure(found, keys), caption))
    return figures


def _drawn(found: ReducerComparison) -> tuple[list[str], dict[str, list[str]]]:
    """Return the quantities with a separate diagram, and the families that share one.

    If means of both directions exist, single directions are left out; the runs' records have them.
    """
    single = [key for key in found.keys if not key.startswith(tuple(FAMILIES))][:MOST_PANELS]
    families = {}
    for start, title in FAMILIES.items():
        keys = [key for key in found.keys if key.startswith(start)]
        both = [key for key in keys if "+" not in key and "-" not in key]
        keys = both if len(both) > 1 else keys
        if len(keys) > 1:
            families[title] = keys
        else:
            single += keys
    return single, families


# -- tables ---------------------------------------------------------------------------------


def _tables(found: ReducerComparison) -> list[Section]:
    single, families = _drawn(found)
    keys = [*single, *(key for family in families.values() for key in family)]
    if found.changes:
        return [Section("Values", "", (_changes(found, keys),))]
    parts = [
        found.specimens[start : start + MOST_COLUMNS]
        for start in range(0, len(found.specimens), MOST_COLUMNS)
    ]
    return [
        Section("All specimens", "", (_statistics(found, keys),)),
        Section("Each specimen", "", tuple(_values(found, keys, part) for part in parts)),
    ]


def _changes(found: ReducerComparison, keys: Sequence[str]) -> Table:
    before, after = found.specimens
    rows = []
    for key in keys:
        each = found.changes[key]
        old, new = before.quantities[key], after.quantities[key]
        rows.append(
            (
                found.title(key),
                _with_expanded(old.estimate.value, old.estimate.expanded_uncertainty()),
                _with_expanded(new.estimate.value, new.estimate.expanded_uncertainty()),
                _with_expanded(each.change.value, each.change.expanded_uncertainty()),
                "–" if isnan(each.relative_percent) else f"{each.relative_percent:+.1f} %",
                each.change.unit,
                "changed" if each.significant else "",
                _verdicts(old.verdict, new.verdict),
            )
        )
    header = ("quantity", "before", "after", "change", "", "unit", "", "verdict")
    caption = Message(
        "Values ± U, changes ± U of the change, 95.45 % coverage; {cancelled}.",
        "common errors of both runs cancel"
        if found.same_chain
        else "no errors cancel: different chains",
    )
    return Table(header, rows, caption)


def _verdicts(before: str, after: str) -> str:
    words = [Verdict(each).label for each in (before, after) if each]
    return " → ".join(dict.fromkeys(words))


def _statistics(found: ReducerComparison, keys: Sequence[str]) -> Table:
    rows = []
    for key in keys:
        each = found.values[key]
        values = [one.value for one in each.specimens.values()]
        spread, expanded = each.spread, each.mean.expanded_uncertainty()
        rows.append(
            (
                found.title(key),
                *stated(each.mean.value, expanded),
                number(spread, 2),
                stated(min(values), spread or expanded)[0],
                stated(max(values), spread or expanded)[0],
                each.mean.unit,
                ", ".join(each.outliers),
            )
        )
    header = ("quantity", "mean", "U", "spread", "smallest", "largest", "unit", "stands out")
    caption = "U of the mean, 95.45 % coverage; spread: standard deviation between specimens."
    return Table(header, rows, caption)


def _values(
    found: ReducerComparison, keys: Sequence[str], part: Sequence[SpecimenResults]
) -> Table:
    rows = []
    for key in keys:
        cells = []
        for each in part:
            quantity = each.quantities[key]
            estimate = quantity.estimate
            text = _with_expanded(estimate.value, estimate.expanded_uncertainty())
            verdict = f" ({Verdict(quantity.verdict).label})" if quantity.verdict else ""
            cells.append(text + verdict)
        limit = found.specimens[0].quantities[key].limit
        rows.append((found.title(key), *cells, found.values[key].mean.unit, limit))
    header = ("quantity", *(each.name for each in part), "unit", "limit")
    return Table(
        header, rows, "Values ± U, 95.45 % coverage, with verdicts where there is a limit."
    )


def _with_expanded(value: float, expanded: float) -> str:
    return " ± ".join(stated(value, expanded))
