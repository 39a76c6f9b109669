"""Looks up the translation of messages, terms and short names.

As in gettext, the English template of a `Message` is the key: a catalogue holds ``"at most {limit}
N·m" = "不超过 {limit} N·m"``. A message without translation stays English, with all of its values.
A short name, such as that of a component in a budget, stands for its English term in ``en/``.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from importlib import resources
from typing import Any

from torquebench.errors import TorquebenchError
from torquebench.message import Message
from torquebench.plugins import TRANSLATIONS, entry_points, load

WORD = re.compile(r"[^\W\d_]{2,}")
NOT_WORDS = re.compile(
    r"\{\w+\}|`[^`]*`|\b(Hz|N·m|Pa|arcmin|arcsec|bar|kHz|kg|min|mm|ms|ppm|rad/s²|rad|rpm|torquebench)\b"
)
NUMBER = re.compile(r"-?\d+(\.\d+)?(e[-+]?\d+)?")


@cache
def templates(language: str) -> Mapping[str, str]:
    """Return the texts of a language by their English template, or by their short name.

    Examples
    --------
    >>> templates("zh")["Mount the {what} between the flanges."]
    '请将{what}安装到两法兰之间。'
    >>> templates("en")["creep"], templates("de")["creep"]
    ('creep under load', 'Kriechen unter Last')
    """
    texts: dict[str, str] = {}
    packages: list[Any] = ["torquebench"]
    for point in entry_points(TRANSLATIONS):
        with suppress(TorquebenchError):  # the command line warns of a package that fails
            packages.insert(0, load(point))
    for package in packages:
        folder = resources.files(package) / "translations" / language
        if folder.is_dir():
            for file in sorted(folder.iterdir(), key=lambda file: file.name):
                for section in tomllib.loads(file.read_text(encoding="utf-8")).values():
                    texts.update(section)
    if language == "en":
        return texts
    names = {name: texts[term] for name, term in templates("en").items() if term in texts}
    return names | texts


@cache
def has_words(template: str) -> bool:
    """Return whether a template has words, other than units and commands, to be translated.

    Examples
    --------
    >>> has_words("at most {limit} N·m"), has_words("{name}: {value} N·m")
    (True, False)
    """
    return WORD.search(NOT_WORDS.sub("", template)) is not None


def translated(said: str, language: str, number: Callable[[str], str] = str) -> str:
    """Return a message, term or short name in a language; unchanged if a part of it is unknown.

    Parameters
    ----------
    said : str
    language : {"en", "de", "zh"}
    number : callable, optional
        Sets the marks of values that are numbers.

    Examples
    --------
    >>> said = Message("{side} speed", "input")
    >>> translated(said, "zh"), translated("SIM-T2000", "zh"), translated("creep", "en")
    ('输入端转速', 'SIM-T2000', 'creep under load')
    """
    return _known(said, language, number) or said


def _known(said: str, language: str, number: Callable[[str], str]) -> str | None:
    """Return the translation of a message, a term or a name, None if there is none."""
    texts = templates(language)
    if not said:
        return ""
    if not isinstance(said, Message):
        if said[:1] == said[-1:] == "'" and said[1:-1] in texts:
            return f"“{texts[said[1:-1]]}”"
        return number(said) if NUMBER.fullmatch(said) else texts.get(said)
    template = texts.get(said.template)
    if template is None:
        if language != "en" and has_words(said.template):
            return None
        template = said.template
    values, joined = {}, "0" in said.values
    for name, value in said.values.items():
        known = _known(value, language, number)
        lacking = isinstance(value, Message) or (joined and has_words(value))
        if known is None and lacking and language != "en":
            return None
        values[name] = value if known is None else known
    return template.join(values.values()) if joined else template.format_map(values)
