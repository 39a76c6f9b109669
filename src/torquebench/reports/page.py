"""One self-contained HTML page of headings, facts, tables and figures, without scripts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from torquebench import __version__
from torquebench.atomic_write import atomic_write

if TYPE_CHECKING:
    from jinja2 import Template

    from torquebench.reports.curve_figures import Panel

__all__ = [
    "Block",
    "Diagram",
    "Drawings",
    "Facts",
    "Figure",
    "Page",
    "Section",
    "Table",
    "drawn",
    "render_page",
    "write_page",
]


WORDY = 24
"""Longer cells are treated as sentences, not as numbers."""


@dataclass(frozen=True)
class Facts:
    """Names and values shown as a two-column list.

    Attributes
    ----------
    items : sequence of (str, str)
        Name and value with its unit.
    """

    items: Sequence[tuple[str, str]]
    kind: str = field(default="facts", init=False)


@dataclass(frozen=True)
class Table:
    """A table whose first column names the row.

    Attributes
    ----------
    header : sequence of str
        Column titles with units.
    rows : sequence of sequence of str
        Cells, already formatted.
    caption : str
        Caption of the table.
    emphasised : int or None
        Index of the row to mark, such as the recommended model.
    words : bool
        Whether the cells contain sentences, which are aligned left and wrapped.
    """

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    emphasised: int | None = None
    words: bool = False
    kind: str = field(default="table", init=False)

    @property
    def sentences(self) -> tuple[bool, ...]:
        """Whether each column contains sentences, which are aligned left and wrapped."""
        cells = [[row[column] for row in self.rows] for column in range(len(self.header))]
        return tuple(any(len(cell) > WORDY for cell in column) for column in cells)


@dataclass(frozen=True)
class Figure:
    """An SVG figure with its caption.

    Attributes
    ----------
    svg : str
        Text of an ``<svg>`` element, as the functions of `figures` return it.
    caption : str
        Caption of the figure, with its data.
    """

    svg: str
    caption: str
    kind: str = field(default="figure", init=False)


@dataclass(frozen=True)
class Diagram:
    """Curves with a caption; terminal, screen and paper each draw them in their own way.

    Attributes
    ----------
    panels : sequence of Panel
        Diagrams below each other.
    caption : str
    height : float
        Height of one diagram on paper in inches, at a width of 7.6.
    columns : int
        How many stand beside each other on paper.
    """

    panels: Sequence[Panel]
    caption: str
    height: float = 2.6
    columns: int = 1
    kind: str = field(default="figure", init=False)

    @property
    def svg(self) -> str:
        """Text of an ``<svg>`` element."""
        from torquebench.reports.curve_figures import panels_figure

        return panels_figure(self.panels, columns=self.columns, height=self.height)


@dataclass(frozen=True)
class Drawings:
    """Figures that are drawn only when they are displayed, which the terminal never does.

    Attributes
    ----------
    draw : callable
        Returns the SVG text and the caption of each figure.
    """

    draw: Callable[[], Iterable[tuple[str, str]]]
    kind: str = field(default="drawings", init=False)


Block: TypeAlias = Facts | Table | Figure | Diagram | Drawings


def drawn(blocks: Iterable[Block]) -> Iterator[Facts | Table | Figure | Diagram]:
    """Yield blocks, with `Drawings` replaced by drawn figures."""
    for block in blocks:
        if isinstance(block, Drawings):
            yield from (Figure(*each) for each in block.draw())
        else:
            yield block


@dataclass(frozen=True)
class Section:
    """A heading, an introduction, and the content below it.

    Attributes
    ----------
    heading, text : str
        Heading and introduction.
    blocks : sequence of Block
        Content in reading order.
    detail : bool
        Whether the section is left out in the terminal and collapsed on screens.
    """

    heading: str
    text: str = ""
    blocks: Sequence[Block] = ()
    detail: bool = False


@dataclass(frozen=True)
class Page:
    """A whole report.

    Attributes
    ----------
    title, subtitle : str
        Title and the line below it.
    sections : sequence of Section
        Content in reading order.
    simulated : bool
        Whether the results come from the simulated bench; stated at the top and on every page.
    """

    title: str
    subtitle: str
    sections: Sequence[Section]
    simulated: bool = False


@cache
def _template() -> Template:
    from jinja2 import Environment, PackageLoader, StrictUndefined  # not needed without a page
    from markupsafe import Markup

    environment = Environment(
        loader=PackageLoader("torquebench.reports"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"svg": Markup, "drawn": drawn}
    return environment.get_template("page.html.j2")


def render_page(page: Page) -> str:
    """Return a report as the text of one HTML file.

    Parameters
    ----------
    page : Page
        The report.

    Returns
    -------
    str
        HTML that needs no other file.
    """
    return _template().render(page=page, version=__version__)


def write_page(page: Page, path: Path) -> Path:
    """Write a report as HTML, completely or not at all.

    Parameters
    ----------
    page : Page
        The report.
    path : pathlib.Path
        File to write; its folder is created if it is missing.

    Returns
    -------
    pathlib.Path
        The file written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    atomic_write(path, render_page(page))
    return path
