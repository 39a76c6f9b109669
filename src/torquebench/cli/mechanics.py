"""`torquebench mechanics`: additional torque of a chain's design, and stiffness of supports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from dataclasses import field as data_field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from torquebench.cli.options import HELP_MARKUP
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations.result import HIDDEN, Result
from torquebench.reports.page import Page, Section

if TYPE_CHECKING:
    from torquebench.reports.page import Block

__all__ = ["app"]

DEFAULT_DESIGN = "output"

app = typer.Typer(
    name="mechanics",
    no_args_is_help=True,
    rich_markup_mode=HELP_MARKUP,
    help="Additional torque of a design by the papers' equations, and the twist of supports.",
)


@dataclass(frozen=True)
class NumberTable:
    """A table as it is printed: the headers name quantity and unit."""

    header: Sequence[str]
    rows: Sequence[Sequence[str | float]]


@dataclass(frozen=True, kw_only=True)
class Mechanics(Result):
    """Results, in words and as tables."""

    result: str
    tables: Sequence[NumberTable]
    facts: Mapping[str, str]
    described: Any = data_field(metadata=HIDDEN)

    def page(self) -> Page:
        """Return its description."""
        page: Page = self.described
        return page


@app.command("additional-torque")
def additional_torque(
    design: Annotated[
        str,
        typer.Argument(
            help="A chain (.toml: range_nm and the fields of mechanics.Chain), or the example "
            "`input` or `output`."
        ),
    ] = DEFAULT_DESIGN,
) -> Mechanics:
    """Compute the additional torque of a chain: parts, sensitivities, coaxiality limit.

    Bearing friction, parallel and angular misalignment over ± range, in the consistent form and as
    printed in the 2021 article; sensitivity to every parameter; effect of 0.03 mm of coaxiality
    error.
    """
    from torquebench.papers.mechanics import DESIGNS, additional_torque_blocks, load_design

    if design in DESIGNS:
        chosen = DESIGNS[design]
    else:
        if not Path(design).is_file():
            raise InputError(
                Message("no design {design!r}", design),
                Message("a .toml file, or one of {designs}", ", ".join(DESIGNS)),
            )
        chosen = load_design(Path(design))
    found, blocks = additional_torque_blocks(chosen)
    return _result(
        found.ours, "Additional torque", f"{chosen.name}, {chosen.range_nm:g} N·m", blocks
    )


@app.command("sections")
def sections() -> Mechanics:
    """Compare the twist of rectangles with that of a circle of the same area."""
    from torquebench.papers.mechanics import section_blocks

    found, blocks = section_blocks()
    return _result(found.ours, "Rectangle against circle", "twist per length at equal area", blocks)


@app.command("supports")
def supports(
    torque: Annotated[
        float, typer.Option(min=1e-3, max=1e7, help="About the vertical axis, N·m.")
    ] = 2000.0,
    height: Annotated[
        float, typer.Option(min=1e-3, max=100, help="Height of both supports, m.")
    ] = 0.5,
    column: Annotated[
        float, typer.Option(min=1e-3, max=100, help="Side of the column along the arm, m.")
    ] = 0.2,
    thickness: Annotated[
        float, typer.Option(min=1e-3, max=100, help="Side of column and arm across it, m.")
    ] = 0.15,
    arm: Annotated[float, typer.Option(min=1e-3, max=100, help="Length of the arm, m.")] = 0.35,
    arm_height: Annotated[
        float, typer.Option(min=1e-3, max=100, help="Height of the arm, m.")
    ] = 0.12,
    cylinder: Annotated[
        float, typer.Option(min=1e-3, max=100, help="Outer diameter of the cylinder, m.")
    ] = 0.45,
    modulus: Annotated[
        float, typer.Option(min=1e-3, max=1e4, help="Shear modulus of both, GPa.")
    ] = 79.0,
) -> Mechanics:
    """Twist a cantilever support and a hollow cylinder of the same mass in three dimensions."""
    if not arm_height < height:
        raise InputError(
            Message(
                "an arm {arm_height:g} m high on a support of {height:g} m", arm_height, height
            ),
            "an arm lower than its column",
        )
    from torquebench.mechanics import SupportDesign
    from torquebench.papers.mechanics import support_blocks

    design = SupportDesign(height, column, thickness, arm, arm_height, cylinder, 1e9 * modulus)
    size = 0.12 * max(height, column, arm, 0.5 * cylinder)
    found, blocks = support_blocks(torque, design, min(size, 0.5 * min(column, thickness)))
    return _result(found.ours, "Two supports", f"{torque:g} N·m about the vertical axis", blocks)


def _result(headline: str, title: str, subtitle: str, blocks: Sequence[Block]) -> Mechanics:
    from torquebench.reports.page import Facts, Table

    return Mechanics(
        headline=headline,
        result=headline,
        tables=[
            NumberTable(block.header, [[_value(cell) for cell in row] for row in block.rows])
            for block in blocks
            if isinstance(block, Table)
        ],
        facts=dict(item for block in blocks if isinstance(block, Facts) for item in block.items),
        described=Page(title, subtitle, [Section("", "", tuple(blocks))]),
    )


def _value(cell: str) -> str | float:
    """Convert a table's cell to a number if possible."""
    try:
        return float(cell.replace("−", "-"))
    except ValueError:
        return cell
