"""Print a result's page in the terminal within 80 columns: facts and tables, no figures."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.cells import cell_len
from rich.table import Table as Grid
from rich.text import Text

from torquebench.cli.terminal.console import narrow_table, out
from torquebench.reports.page import Facts, Page, Section, Table

if TYPE_CHECKING:
    from torquebench.operations import Result

NAME_WIDTH = 30
"""Width of the first column in a table of numbers."""
WORDS_WIDTH = 16
"""Smallest width of a column of sentences."""


def print_page(page: Page) -> None:
    """Print title, facts and tables of a page, without details and figures."""
    suffix = " - simulated" if page.simulated else ""
    out().print(Text(f"{page.title}{suffix}", style="bold"))
    if page.subtitle:
        out().print(Text(page.subtitle))
    for section in page.sections:
        shown = any(isinstance(block, Facts | Table) for block in section.blocks)
        if not section.detail and (shown or section.text):
            _print_section(section)


def _print_section(section: Section) -> None:
    if section.heading:
        out().print(Text(section.heading, style="italic"))
    if section.text:
        out().print(Text(section.text))
    for block in section.blocks:
        if isinstance(block, Facts):
            _print_facts(block)
        elif isinstance(block, Table):
            _print_table(block)


def _print_facts(facts: Facts) -> None:
    grid = Grid.grid(padding=(0, 2, 0, 0))
    grid.add_column(style="dim", max_width=NAME_WIDTH)
    grid.add_column(overflow="fold")
    for name, value in facts.items:
        grid.add_row(Text(name), Text(value))
    out().print(grid)


def _print_table(table: Table) -> None:
    """Print a table; headings may be wrapped, but not numbers."""
    sentences, grid, console = table.sentences, narrow_table(), out()
    words = [number == 0 or table.words or sentences[number] for number in range(len(sentences))]
    widths = [
        max(map(cell_len, [*(row[number] for row in table.rows), *heading.split()]), default=1)
        for number, heading in enumerate(table.header)
    ]
    others = sum(
        min(width, WORDS_WIDTH) if left else width
        for width, left in zip(widths[1:], words[1:], strict=True)
    )
    room = max(WORDS_WIDTH, console.width - others - len(widths))
    for number, heading in enumerate(table.header):
        grid.add_column(
            Text(heading),
            justify="left" if words[number] else "right",
            overflow="fold",
            width=min(widths[0], room) if not number else None if words[number] else widths[number],
        )
    for place, row in enumerate(table.rows):
        style = "bold green" if place == table.emphasised else ""
        grid.add_row(*(Text(cell) for cell in row), style=style)
    console.print(grid)
    if table.caption:
        out().print(Text(table.caption, style="dim"))


def print_verdict(result: Result) -> None:
    """Print the headline of a result in the colour of its verdict."""
    from torquebench.uncertainty import Verdict

    label = Verdict(result.verdict).label if result.verdict else ""
    colour = "red" if result.failed else "green" if label else ""
    text = Text(f"{label}: " if label else "", style=colour)
    text.append(result.headline, style="" if label else "bold")
    out().print(text)
