"""Additional torque of a chain's design by the papers' equations, and the twist of supports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from dataclasses import field as data_field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations.operation import Number, Request, field, on_files
from torquebench.operations.place import Place
from torquebench.operations.result import HIDDEN, Result
from torquebench.progress import Progress
from torquebench.reports.page import Facts, Page, Section, Table

if TYPE_CHECKING:
    from torquebench.reports.page import Block


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


class AdditionalTorqueRequest(Request):
    """Compute the additional torque of a chain: parts, sensitivities, coaxiality limit.

    Bearing friction, parallel and angular misalignment over ± range, in the consistent form and as
    printed in the 2021 article; sensitivity to every parameter; effect of 0.03 mm of coaxiality
    error.
    """

    design: Annotated[
        str,
        field(
            "A chain (.toml: range_nm and the fields of mechanics.Chain), or the example `input` "
            "or `output`.",
            argument=True,
            file=True,
            max_length=300,
        ),
    ] = "output"


def run_additional_torque(
    _place: Place, request: AdditionalTorqueRequest, _progress: Progress
) -> Mechanics:
    """Compute the parts of the additional torque."""
    from torquebench.papers.mechanics import DESIGNS, additional_torque_blocks, load_design

    chosen = DESIGNS.get(request.design)
    if chosen is None:
        if not Path(request.design).is_file():
            raise InputError(
                Message("no design {design!r}", request.design),
                Message("a .toml file, or one of {designs}", ", ".join(DESIGNS)),
            )
        chosen = load_design(Path(request.design))
    found, blocks = additional_torque_blocks(chosen)
    subtitle = Message("{name}, {range_nm:g} N·m", chosen.name, chosen.range_nm)
    return _result(found.ours, "Additional torque", subtitle, blocks)


class SectionsRequest(Request):
    """Compare the twist of rectangles with that of a circle of the same area."""


def run_sections(_place: Place, _request: SectionsRequest, _progress: Progress) -> Mechanics:
    """Compare the sections."""
    from torquebench.papers.mechanics import section_blocks

    found, blocks = section_blocks()
    return _result(found.ours, "Rectangle against circle", "twist per length at equal area", blocks)


def _length(help: str) -> Any:  # noqa: A002 - as in `field`
    return field(help, unit="m", ge=1e-3, le=100)


class SupportsRequest(Request):
    """Twist a cantilever support and a hollow cylinder of the same mass in three dimensions."""

    basic = ("torque_nm", "height", "column", "thickness", "arm", "cylinder")

    torque_nm: Annotated[Number, field("About the vertical axis.", ge=1e-3, le=1e7)] = 2000.0
    height: Annotated[Number, _length("Height of both supports.")] = 0.5
    column: Annotated[Number, _length("Side of the column along the arm.")] = 0.2
    thickness: Annotated[Number, _length("Side of column and arm across it.")] = 0.15
    arm: Annotated[Number, _length("Length of the arm.")] = 0.35
    arm_height: Annotated[Number, _length("Height of the arm.")] = 0.12
    cylinder: Annotated[Number, _length("Outer diameter of the cylinder.")] = 0.45
    modulus: Annotated[Number, field("Shear modulus of both.", unit="GPa", ge=1e-3, le=1e4)] = 79.0


def run_supports(_place: Place, request: SupportsRequest, _progress: Progress) -> Mechanics:
    """Compute the twist of both supports."""
    height, column, thickness = request.height, request.column, request.thickness
    if not request.arm_height < height:
        raise InputError(
            Message(
                "an arm {arm_height:g} m high on a support of {height:g} m",
                request.arm_height,
                height,
            ),
            "an arm lower than its column",
        )
    from torquebench.mechanics import SupportDesign
    from torquebench.papers.mechanics import support_blocks

    design = SupportDesign(
        height,
        column,
        thickness,
        request.arm,
        request.arm_height,
        request.cylinder,
        1e9 * request.modulus,
    )
    size = 0.12 * max(height, column, request.arm, 0.5 * request.cylinder)
    torque_nm = request.torque_nm
    found, blocks = support_blocks(torque_nm, design, min(size, 0.5 * min(column, thickness)))
    subtitle = Message("{torque:g} N·m about the vertical axis", torque_nm)
    return _result(found.ours, "Two supports", subtitle, blocks)


def _result(headline: str, title: str, subtitle: str, blocks: Sequence[Block]) -> Mechanics:
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


ADDITIONAL_TORQUE = on_files(
    "mechanics additional-torque",
    AdditionalTorqueRequest,
    run_additional_torque,
    lambda request: Message("Additional torque of {name}", request.design),
)
SECTIONS = on_files(
    "mechanics sections", SectionsRequest, run_sections, lambda _request: "Rectangle against circle"
)
SUPPORTS = on_files(
    "mechanics supports", SupportsRequest, run_supports, lambda _request: "Two supports"
)
