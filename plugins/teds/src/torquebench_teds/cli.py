"""`torquebench teds`: the electronic data sheet in a transducer's connector (IEEE 1451.4)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from torquebench.cli.extension import (
    HELP_MARKUP,
    Told,
    check_output,
    narrow_table,
    out,
    say,
    say_file,
    warn,
)
from torquebench.errors import InputError
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench_teds import CurveFit, Sheet
    from torquebench_teds.templates import Array, Field

__all__ = ["app"]

app = typer.Typer(
    name="teds",
    help="Read and write a transducer's electronic data sheet (TEDS, IEEE 1451.4).",
    no_args_is_help=True,
    rich_markup_mode=HELP_MARKUP,
)


@dataclass(frozen=True)
class Curve:
    """A compensation as calibration curve, and how far it deviates from the compensation."""

    segments: int
    power: int
    residual_nm: float
    residual_percent_fs: float
    branch_residual_nm: float
    branch_residual_percent_fs: float


@dataclass(frozen=True, kw_only=True)
class ShownSheet(Told):
    """Content of a memory; `sheet` as `teds read` writes it."""

    sheet: Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class WrittenSheet(ShownSheet):
    """Written content of a memory; `bytes` without checksums, `curve` of a model."""

    bytes: int
    curve: Curve | None


MemoryArgument = Annotated[
    Path,
    typer.Argument(help=("File with the memory's content: binary, or hexadecimal digits as text.")),
]
ChecksumsOption = Annotated[
    bool,
    typer.Option(
        "--checksums/--no-checksums",
        help="Whether each page of 32 bytes begins with its checksum, as a memory's do.",
    ),
]


class Memory(StrEnum):
    """Common types of memory."""

    ds2430a = "DS2430A"
    ds2431 = "DS2431"
    ds2433 = "DS2433"
    ds28ec20 = "DS28EC20"


@app.command("show")
def show(
    memory: Annotated[
        Path, typer.Argument(help=("File with the memory's content, or a sheet (.json)."))
    ],
    checksums: ChecksumsOption = True,
) -> ShownSheet:
    """Show the values in a data sheet."""
    from torquebench_teds import sheet_to_json
    from torquebench_teds.templates import BASIC, TEMPLATES

    sheet = _sheet(memory, checksums)
    _print_values("basic sheet", BASIC, sheet.basic)
    for section in sheet.sections:
        template = TEMPLATES[section.template]
        _print_values(
            f"template {template.number}: {template.title}", template.fields, section.values
        )
    if sheet.text:
        say(f"text: {escape(sheet.text)}")
    _tell_unread(sheet)
    return ShownSheet(headline="Data sheet.", sheet=sheet_to_json(sheet))


@app.command("read")
def read(
    memory: MemoryArgument,
    result: Annotated[Path, typer.Option("--out", help="The sheet to write: NAME.json.")],
    checksums: ChecksumsOption = True,
) -> ShownSheet:
    """Read a memory into a data sheet in JSON that can be edited.

    Content that this version doesn't know is kept bit by bit, and `write` writes it again.
    """
    from torquebench.atomic_write import atomic_write
    from torquebench.records import json_text
    from torquebench_teds import sheet_to_json

    check_output(result, memory)
    sheet = _sheet(memory, checksums)
    atomic_write(result, json_text(sheet_to_json(sheet), indent=2) + "\n")
    _tell_unread(sheet)
    say_file("Sheet", result)
    return ShownSheet(headline="Data sheet.", sheet=sheet_to_json(sheet))


@app.command("write")
def write(
    sheet: Annotated[Path, typer.Argument(help="A sheet as JSON, as `read` writes it.")],
    result: Annotated[
        Path,
        typer.Option("--out", help="The file to write: NAME.hex as digits, others binary."),
    ],
    memory: Annotated[Memory, typer.Option(help="The memory that it is for.")] = Memory.ds2433,
    model: Annotated[
        Path | None,
        typer.Option(
            help="A model file that `fit` wrote: becomes the calibration curve (template 41) in "
            "place of the one in the sheet."
        ),
    ] = None,
    segments: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=255,
            help=(
                "Number of segments of the calibration curve; by default as many as fit into "
                "the memory and reduce the deviation."
            ),
        ),
    ] = None,
    power: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=9,
            help=("Highest power of the curve; by default the highest that reduces the deviation."),
        ),
    ] = None,
    checksums: ChecksumsOption = True,
) -> WrittenSheet:
    """Write a sheet as the content of a memory, with a compensation as its calibration curve.

    The curve's deviation from the compensation is stated in N·m and in % of full scale.
    """
    from torquebench.atomic_write import atomic_write
    from torquebench_teds import SIZES, encode, sheet_from_json, sheet_to_json, write_memory

    check_output(result, sheet, *([] if model is None else [model]))
    wanted = sheet_from_json(_json(sheet))
    encode(wanted)  # refuse a wrong sheet before a model is compiled
    fit = None
    if model is not None:
        room = _room(memory, checksums)
        wanted, fit = _with_curve(wanted, model, segments, power, room)
    data = encode(wanted)
    content = write_memory(data, SIZES[memory.value], checksums=checksums)
    if result.suffix.lower() == ".hex":
        digits = content.hex().upper()
        lines = [digits[start : start + 64] for start in range(0, len(digits), 64)]
        content = ("\n".join(lines) + "\n").encode("ascii")
    atomic_write(result, content)
    say_file("Memory", result)
    say(f"{len(data)} bytes of data sheet")
    if fit is not None:
        _tell_fit(fit)
    curve = None
    if fit is not None:
        curve = Curve(
            fit.segments,
            fit.power,
            fit.residual_nm,
            fit.residual_percent_fs,
            fit.branch_residual_nm,
            fit.branch_residual_percent_fs,
        )
    return WrittenSheet(
        headline="Data sheet.", sheet=sheet_to_json(wanted), bytes=len(data), curve=curve
    )


def _sheet(memory: Path, checksums: bool) -> Sheet:
    from torquebench_teds import decode, encode, read_file, sheet_from_json

    if memory.suffix.lower() == ".json":
        return decode(encode(sheet_from_json(_json(memory))))
    return decode(read_file(memory, checksums=checksums))


def _json(path: Path) -> Any:
    import json

    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as problem:
        raise InputError(
            Message("{path} can't be read: {problem}", path, problem),
            "a sheet as JSON in UTF-8",
            "write one with `torquebench teds read`, or copy the example of the documentation",
        ) from problem


def _with_curve(
    sheet: Sheet, model: Path, segments: int | None, power: int | None, room: int
) -> tuple[Sheet, CurveFit]:
    """Return a sheet with a calibration curve that fits into a memory of `room` bytes."""
    import dataclasses

    from torquebench.compensation import load_model
    from torquebench_teds import BRIDGE, CALIBRATION_CURVE, Section, encode, fit_curve, torque_span

    bridge = sheet.section(BRIDGE)
    if bridge is None:
        raise InputError(
            "a sheet without template 33 (bridge sensor)",
            "a sheet that states the spans of torque and of the electrical value",
            "add the template to the sheet",
        )
    span = torque_span(bridge)
    stored = load_model(model)

    from torquebench.chain import MeasuringChain
    from torquebench.compensation import compile_table

    if MeasuringChain.of(stored).turns:
        warn("the curve is static: temperature, rotation and inertia aren't in it")
    serial = stored.provenance.transducer_serial
    if serial and str(sheet.basic["serial"]) not in serial:
        warn(
            f"the model was made with transducer {serial}, the sheet is of {sheet.basic['serial']}"
        )
    old = sheet.section(CALIBRATION_CURVE)
    others = tuple(each for each in sheet.sections if each is not old)
    dated = {
        "calibration_date": stored.provenance.calibrated_on or None,
        "calibration_initials": "" if old is None else old.values["calibration_initials"],
        "calibration_period_days": 0 if old is None else old.values["calibration_period_days"],
    }

    def with_curve(values: Mapping[str, Any]) -> Sheet:
        curve = Section(CALIBRATION_CURVE, {**values, **dated})
        return dataclasses.replace(sheet, sections=(*others, curve))

    without = encode(with_curve({"domain": "electrical", "segments": []}))
    fit = fit_curve(
        compile_table(stored.model, uncertainty=False),
        span,
        segments=segments,
        power=power,
        most_bits=8 * (room - len(without)),
    )
    return with_curve(fit.values), fit


def _room(memory: Memory, checksums: bool) -> int:
    """Return how many bytes of a data sheet fit into a memory."""
    from torquebench_teds import SIZES
    from torquebench_teds.memory import PAGE_BYTES

    size = SIZES[memory.value]
    return size - size // PAGE_BYTES if checksums else size


def _tell_fit(fit: CurveFit) -> None:
    many = "1 segment" if fit.segments == 1 else f"{fit.segments} segments"
    say(f"calibration curve: {many}, powers to {fit.power}")
    say(
        f"deviates from the compensation by at most {fit.residual_nm:.2g} N·m "
        f"({fit.residual_percent_fs:.2g} % FS)"
    )
    if fit.branch_residual_nm > 1.05 * fit.residual_nm:
        say(
            f"on a known branch by at most {fit.branch_residual_nm:.2g} N·m "
            f"({fit.branch_residual_percent_fs:.2g} % FS): one curve holds no hysteresis"
        )


def _tell_unread(sheet: Sheet) -> None:
    if sheet.unread is not None:
        warn(
            f"{sheet.unread.why} isn't known: {len(sheet.unread.bits)} bits from there on are "
            "kept as they are"
        )


def _print_values(title: str, fields: tuple[Field | Array, ...], values: Any) -> None:
    from torquebench_teds.templates import Array

    table = narrow_table(columns=(title, "|"))
    for each in fields:
        if not isinstance(each, Array):
            table.add_row(each.label, _shown(values[each.name]))
            continue
        table.add_row(each.label, str(len(values[each.name])))
        for item in values[each.name]:
            table.add_row("", _item(each, item))
    out().print(table)


def _item(array: Array, item: Any) -> str:
    from torquebench_teds.templates import Array

    parts = []
    for each in array.fields:
        if isinstance(each, Array):
            parts += [f"\n{_item(each, below)}" for below in item[each.name]]
        else:
            parts.append(f"{each.label} {_shown(item[each.name])}")
    return ", ".join(parts).replace(", \n", "\n")


def _shown(value: Any) -> str:
    if value is None:
        return "not known"
    return f"{value:.7g}" if isinstance(value, float) else escape(str(value))
