"""Convert a data sheet between values and bits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench_teds.bits import BitReader, BitWriter
from torquebench_teds.templates import BASIC, TEMPLATES, Array, Field

__all__ = ["Section", "Sheet", "Unread", "decode", "encode", "sheet_from_json", "sheet_to_json"]

_STANDARD, _OWN, _OTHER, _END = range(4)
"""The two bits before a section: template of the standard, of this manufacturer, or of another."""
_TEXT, _FREE = range(2)
"""The bit after the end: whether 7-bit ASCII text follows, or free data."""


@dataclass(frozen=True)
class Section:
    """One template with its values.

    Attributes
    ----------
    template : int
        Number of the template, one of `TEMPLATES`.
    values : mapping
        Value of each field by its name; of an array a list of such mappings.
    """

    template: int
    values: Mapping[str, Any]


@dataclass(frozen=True)
class Unread:
    """The rest of a sheet from a section that this version doesn't know.

    Attributes
    ----------
    why : str
        Unknown part.
    bits : str
        All bits from the section's selector on, the first bit first.
    """

    why: str
    bits: str


@dataclass(frozen=True)
class Sheet:
    """A transducer electronic data sheet.

    Attributes
    ----------
    basic : mapping
        Manufacturer, model, version and serial number; see `BASIC`.
    sections : tuple of Section
    text : str
        User's text, ASCII.
    free : str
        Free bits of the user in place of a text, the first bit first.
    unread : Unread or None
        Content after the last known section.
    """

    basic: Mapping[str, Any]
    sections: tuple[Section, ...] = ()
    text: str = ""
    free: str = ""
    unread: Unread | None = field(default=None)

    def section(self, template: int) -> Section | None:
        """Return the first section of a template, None if there is none."""
        return next((each for each in self.sections if each.template == template), None)


def decode(data: bytes) -> Sheet:
    """Read a data sheet.

    Parameters
    ----------
    data : bytes
        Bits without the checksums of the pages; see `memory.read_memory`.

    Returns
    -------
    sheet : Sheet
        A section of an unknown template ends it; its bits are kept.

    Raises
    ------
    InputError
        When the memory is blank, ends within a field, or has a value that isn't allowed.

    Examples
    --------
    >>> sheet = Sheet({"manufacturer": 31, "model": 393, "version_letter": "A", "version": 0,
    ...                "serial": 12345}, text="spare part")
    >>> decode(encode(sheet)) == sheet
    True
    """
    if not data.strip(b"\0") or not data.strip(b"\xff"):
        raise InputError(
            Message("a blank memory of {count} bytes", len(data)),
            "a data sheet",
            "check the connection, or write",
        )
    reader = BitReader(data)
    basic = _read_fields(reader, BASIC)
    sections: list[Section] = []
    while reader.left >= 2:
        start = reader.position
        selector = reader.take(2, "selector")
        if selector == _END:
            return _read_end(reader, basic, tuple(sections))
        why = _unknown(reader, selector)
        if not why:
            section, why = _read_section(reader)
            if section is not None:
                sections.append(section)
                continue
        reader.position = start
        return Sheet(basic, tuple(sections), unread=Unread(why, _rest(reader)))
    return Sheet(basic, tuple(sections))


def _unknown(reader: BitReader, selector: int) -> str:
    if selector == _STANDARD:
        return ""
    own = selector == _OWN
    maker = "this manufacturer" if own else f"manufacturer {reader.take(14, 'manufacturer')}"
    return f"template {reader.take(8, 'template')} of {maker}"


def _read_section(reader: BitReader) -> tuple[Section | None, str]:
    number = reader.take(8, "template")
    template = TEMPLATES.get(number)
    if template is None:
        return None, f"template {number} of the standard"
    try:
        return Section(number, _read_fields(reader, template.fields)), ""
    except _UnknownLayoutError as unknown:
        return None, f"template {number} with {unknown}"


class _UnknownLayoutError(Exception):
    """A field refers to an unknown layout."""


def _read_fields(reader: BitReader, fields: Sequence[Field | Array]) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for each in fields:
        if isinstance(each, Array):
            count = reader.take(each.width, each.label)
            values[each.name] = [_read_fields(reader, each.fields) for _ in range(count)]
            continue
        code = reader.take(each.kind.width, each.label)
        if each.name == "electrical_precision" and code != 2:
            raise _UnknownLayoutError(f"electrical values of precision {code}")
        values[each.name] = each.kind.decode(code)
    return values


def _read_end(reader: BitReader, basic: dict[str, Any], sections: tuple[Section, ...]) -> Sheet:
    kind = reader.take(1, "kind of user data") if reader.left else _FREE
    if kind == _FREE:
        return Sheet(basic, sections, free=_rest(reader))
    letters = []
    while reader.left >= 7:
        code = reader.take(7, "text")
        if code in (0, 127):
            break
        letters.append(chr(code))
    return Sheet(basic, sections, text="".join(letters))


def _rest(reader: BitReader) -> str:
    """Return the remaining bits, without the zeros at the end."""
    bits = "".join(str(reader.take(1, "rest")) for _ in range(reader.left))
    return bits.rstrip("0")


def encode(sheet: Sheet) -> bytes:
    """Write a data sheet as bits.

    Parameters
    ----------
    sheet : Sheet

    Returns
    -------
    data : bytes
        Without the checksums of the pages; see `memory.write_memory`.

    Raises
    ------
    InputError
        When a value is missing, unknown or out of its range.
    """
    writer = BitWriter()
    _write_fields(writer, BASIC, sheet.basic, "basic sheet")
    for section in sheet.sections:
        template = TEMPLATES.get(section.template)
        if template is None:
            raise InputError(
                Message("template {template}", section.template),
                ", ".join(map(str, TEMPLATES)),
                "correct the sheet",
            )
        writer.put(_STANDARD, 2)
        writer.put(template.number, 8)
        _write_fields(writer, template.fields, section.values, template.title)
    if sheet.unread is not None:
        _write_bits(writer, sheet.unread.bits)
        return writer.data()
    writer.put(_END, 2)
    writer.put(_TEXT if sheet.text else _FREE, 1)
    if sheet.text and sheet.free:
        raise InputError("text and free bits", "one of both", "leave one of them out")
    if any(not 0 < ord(letter) < 127 for letter in sheet.text):
        raise InputError(
            Message("text {text!r}", sheet.text), "ASCII characters", "write N.m for N·m"
        )
    for letter in sheet.text:
        writer.put(ord(letter), 7)
    if sheet.text:
        writer.put(0, 7)
    _write_bits(writer, sheet.free)
    return writer.data()


def _write_bits(writer: BitWriter, bits: str) -> None:
    if bits.strip("01"):
        raise InputError(Message("bits {bits!r}", bits[:20]), "zeros and ones", "correct the sheet")
    for bit in bits:
        writer.put(int(bit), 1)


def _write_fields(
    writer: BitWriter, fields: Sequence[Field | Array], values: Any, where: str
) -> None:
    if not isinstance(values, Mapping):
        raise InputError(
            Message("{where}: {values!r}", where, values), "names with values", "correct the sheet"
        )
    names = [each.name for each in fields]
    missing = [name for name in names if name not in values]
    strange = [str(name) for name in values if name not in names]
    if missing or strange:
        found = (
            Message("without {missing}", ", ".join(missing))
            if missing
            else Message("with {strange}", ", ".join(strange))
        )
        raise InputError(
            Message("{where} {found}", where, found), ", ".join(names), "correct the sheet"
        )
    for each in fields:
        value, name = values[each.name], f"{where}, {each.name}"
        if isinstance(each, Field):
            writer.put(each.kind.encode(value, name), each.kind.width)
            continue
        most = (1 << each.width) - 1
        if not isinstance(value, Sequence) or isinstance(value, str) or len(value) > most:
            raise InputError(name, Message("a list of at most {most}", most), "correct the sheet")
        writer.put(len(value), each.width)
        for number, item in enumerate(value, 1):
            _write_fields(writer, each.fields, item, f"{name} {number}")


def sheet_to_json(sheet: Sheet) -> dict[str, Any]:
    """Return a sheet as an editable JSON object."""
    content: dict[str, Any] = {"basic": dict(sheet.basic)}
    content["templates"] = [
        {"template": each.template, **dict(each.values)} for each in sheet.sections
    ]
    if sheet.text:
        content["text"] = sheet.text
    if sheet.free:
        content["free_bits"] = sheet.free
    if sheet.unread is not None:
        content["unread"] = {"why": sheet.unread.why, "bits": sheet.unread.bits}
    return content


def sheet_from_json(content: Any) -> Sheet:
    """Return the sheet of a JSON object; `encode` checks its values.

    Raises
    ------
    InputError
        When it isn't an object of this form.
    """
    allowed = ("basic", "templates", "text", "free_bits", "unread")
    if not isinstance(content, Mapping) or "basic" not in content:
        raise InputError(
            "no sheet",
            Message("a JSON object with {allowed}", ", ".join(allowed)),
            "see `teds read`",
        )
    strange = [str(name) for name in content if name not in allowed]
    if strange:
        raise InputError(Message("a sheet with {strange}", ", ".join(strange)), ", ".join(allowed))
    templates, unread = content.get("templates", []), content.get("unread")
    if not isinstance(templates, list) or not all(
        isinstance(each, dict) and isinstance(each.get("template"), int) for each in templates
    ):
        raise InputError(
            "templates of a sheet", 'objects with "template": NUMBER', "correct the sheet"
        )
    sections = tuple(
        Section(
            each["template"], {name: value for name, value in each.items() if name != "template"}
        )
        for each in templates
    )
    if unread is not None and not (isinstance(unread, dict) and set(unread) == {"why", "bits"}):
        raise InputError("unread bits of a sheet", "why and bits", "copy them from `teds read`")
    text, free = content.get("text", ""), content.get("free_bits", "")
    if not isinstance(text, str) or not isinstance(free, str):
        raise InputError("text or free_bits of a sheet", "text", "write it in quotes")
    return Sheet(
        content["basic"], sections, text, free, None if unread is None else Unread(**unread)
    )
