"""Messages in English that keep their template and values, so that a panel can translate them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache
from string import Formatter
from typing import Any

__all__ = ["Message"]

_FORMATTER = Formatter()
_Part = tuple[str, str | None, str | None, str | None]


class Message(str):
    """An English text with its template and values.

    Parameters
    ----------
    template : str
        Template as for `str.format`, with named placeholders: ``"range {range_nm:g} N·m"``.
    *values : object
        One value for each name, in the order of their first occurrence; a value may be a message
        itself.

    Attributes
    ----------
    template : str
        The template without format specifications, the key of its translations.
    values : mapping of str to str
        The formatted values; one that is a message stays a message.

    Examples
    --------
    >>> said = Message("range {range_nm:.1f} N·m", 2000)
    >>> said, said.template, said.values
    ('range 2000.0 N·m', 'range {range_nm} N·m', {'range_nm': '2000.0'})
    """

    __slots__ = ("template", "values")
    template: str
    values: Mapping[str, str]

    def __new__(cls, template: str, /, *values: object) -> Message:
        """Format the template."""
        parts, names = _parsed(template)
        given = dict(zip(names, values, strict=True))
        key, shown = "", {}
        for literal, name, spec, conversion in parts:
            key += literal.replace("{", "{{").replace("}", "}}")
            if name is not None:
                shown[name] = _shown(given, name, spec or "", conversion)
                key += f"{{{name}}}"
        return _made(key.format_map(shown), key, shown)

    @classmethod
    def joined(cls, parts: Iterable[str], joint: str = ", ") -> Message:
        """Join messages to one, with the joint as template and the parts as numbered values.

        Examples
        --------
        >>> Message.joined(["few loops", Message("{count} positions", 2)], "; ")
        'few loops; 2 positions'
        """
        said = tuple(parts)
        if not said:
            return _made("", "", {})
        return _made(joint.join(said), joint, {str(place): each for place, each in enumerate(said)})

    @staticmethod
    def of(error: BaseException) -> str:
        """Return the text of an error, as a message if it was created from one."""
        said = error.args[0] if error.args else None
        return said if isinstance(said, Message) else str(error)

    def as_plain(self) -> dict[str, Any]:
        """Return template and values for JSON.

        Examples
        --------
        >>> Message.restored(Message("{count} points", 3).as_plain())
        '3 points'
        """
        values = {
            name: value.as_plain() if isinstance(value, Message) else value
            for name, value in self.values.items()
        }
        return {"template": self.template, "values": values}

    @classmethod
    def restored(cls, plain: Mapping[str, Any]) -> Message:
        """Rebuild a message from the values of `as_plain`."""
        template = plain["template"]
        values: dict[str, str] = {
            name: value if isinstance(value, str) else cls.restored(value)
            for name, value in plain["values"].items()
        }
        joined = "0" in values
        text = template.join(values.values()) if joined else template.format_map(values)
        return _made(text, template, values)

    def __reduce__(self) -> tuple[object, tuple[str, str, Mapping[str, str]]]:
        return _made, (str(self), self.template, self.values)


def _made(text: str, template: str, values: Mapping[str, str]) -> Message:
    made = str.__new__(Message, text)
    made.template, made.values = template, values
    return made


@cache
def _parsed(template: str) -> tuple[tuple[_Part, ...], tuple[str, ...]]:
    """Return the parts of a template, and its names in the order of their first occurrence."""
    parts = tuple(_FORMATTER.parse(template))
    names: list[str] = []
    for _, name, spec, _ in parts:
        if name is not None:
            names += [name, *(inner for _, inner, _, _ in _FORMATTER.parse(spec or "") if inner)]
    return parts, tuple(dict.fromkeys(names))


def _shown(given: Mapping[str, object], name: str, spec: str, conversion: str | None) -> str:
    value = given[name]
    if isinstance(value, BaseException):
        value = Message.of(value)
    if isinstance(value, Message) and not spec and not conversion:
        return value
    converted = _FORMATTER.convert_field(value, conversion)
    return format(converted, _FORMATTER.vformat(spec, (), given))
