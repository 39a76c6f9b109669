"""Translates the English messages of the packages below the panel.

As in gettext, the English template of a `Message` is the key: a catalogue holds ``"at most {limit}
N·m" = "不超过 {limit} N·m"``. A message without translation stays English, with all of its values.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from functools import cache
from importlib import resources

from torquebench.message import Message

__all__ = ["core_templates", "has_words", "translated"]

WORD = re.compile(r"[^\W\d_]{2,}")
NOT_WORDS = re.compile(
    r"\{\w+\}|`[^`]*`|\b(Hz|N·m|Pa|arcmin|arcsec|bar|kHz|kg|min|mm|ms|ppm|rad|rpm|torquebench)\b"
)


@cache
def core_templates(language: str) -> Mapping[str, str]:
    """Return the sentences of a language by their English template.

    Examples
    --------
    >>> core_templates("zh")["Mount the {what} between the flanges."]
    '请将{what}安装到两法兰之间。'
    """
    found: dict[str, str] = {}
    folder = resources.files("torquebench.panel.text") / f"core_{language}"
    if folder.is_dir():
        for file in sorted(folder.iterdir(), key=lambda each: each.name):
            for section in tomllib.loads(file.read_text(encoding="utf-8")).values():
                found.update(section)
    return found


@cache
def has_words(template: str) -> bool:
    """Return whether a template has words, other than units and commands, to be translated.

    Examples
    --------
    >>> has_words("at most {limit} N·m"), has_words("{name}: {value} N·m")
    (True, False)
    """
    return WORD.search(NOT_WORDS.sub("", template)) is not None


def translated(said: str, language: str) -> str:
    """Return a message of the core in another language; unchanged if a part of it is unknown.

    Examples
    --------
    >>> said = Message("{side} speed", "input")
    >>> translated(said, "zh"), translated("SIM-T2000", "zh")
    ('输入端转速', 'SIM-T2000')
    """
    return said if language == "en" else _known(said, core_templates(language)) or said


def _known(said: str, templates: Mapping[str, str]) -> str | None:
    """Return the translation of a message or a name, None if there is none."""
    if not said:
        return ""
    if not isinstance(said, Message):
        if said[:1] == said[-1:] == "'" and said[1:-1] in templates:
            return f"“{templates[said[1:-1]]}”"
        return templates.get(said)
    template = templates.get(said.template)
    if template is None:
        if has_words(said.template):
            return None
        template = said.template
    values, joined = {}, "0" in said.values
    for name, value in said.values.items():
        known = _known(value, templates)
        if known is None and (isinstance(value, Message) or (joined and has_words(value))):
            return None
        values[name] = value if known is None else known
    return template.join(values.values()) if joined else template.format_map(values)
