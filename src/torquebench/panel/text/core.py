"""Translates the English messages of the packages below the panel.

The measuring core raises errors, alarms and questions as English sentences that contain values. As
in gettext, the English template is the key: a catalogue holds ``"at most {limit} N·m" = "不超过
{limit} N·m"``, a sentence is matched with it, and the placeholders' values are inserted into the
translation, translated themselves if known.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib import resources

__all__ = ["core_templates", "translated"]

HOLE = re.compile(r"\{(\w+)\}")
WORDY = re.compile(r"(?<![a-zA-Z])(?!(?:rpm|rad|min|arcmin|arcsec)(?![a-z]))[a-z]{3,}")
"""An English word; not names with a capital letter, and not units."""
LONGEST = 600
"""Longest sentence that is looked up, in characters: longer ones contain a list."""
KEPT = 4096


@dataclass(frozen=True)
class _Template:
    pattern: re.Pattern[str]
    said: str
    weight: int


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
    if not folder.is_dir():
        return found
    for file in sorted(folder.iterdir(), key=lambda each: each.name):
        for section in tomllib.loads(file.read_text(encoding="utf-8")).values():
            found.update(section)
    return found


@cache
def _templates(language: str) -> tuple[_Template, ...]:
    """Return the templates with placeholders, the most specific first."""
    found = []
    for english, said in core_templates(language).items():
        if HOLE.search(english):
            parts = HOLE.split(english)
            pattern = "".join(
                f"(?P<{part}>.+?)" if place % 2 else re.escape(part)
                for place, part in enumerate(parts)
            )
            weight = sum(len(part) for part in parts[::2])
            found.append(_Template(re.compile(pattern, re.DOTALL), said, weight))
    return tuple(sorted(found, key=lambda each: -each.weight))


def translated(said: str, language: str) -> str:
    """Return a sentence of the core in another language; unchanged if it is unknown.

    Examples
    --------
    >>> translated("at most 2400 N·m", "zh"), translated("SIM-T2000", "zh")
    ('不超过 2400 N·m', 'SIM-T2000')
    >>> translated("output_torque 2450.0 N·m", "zh")
    '输出端扭矩 2450.0 N·m'
    """
    if language == "en" or not said or len(said) > LONGEST:
        return said
    return _found(said, language)


@lru_cache(maxsize=KEPT)
def _found(said: str, language: str) -> str:
    exact = core_templates(language)
    if said in exact:
        return exact[said]
    head, _, tail = said.partition(": ")
    if head in exact and tail and not _left(after := _found(tail, language)):
        return f"{exact[head]}：{after}"
    whole = _matched(said, language)
    if whole is not None and not WORDY.search(whole):
        return whole
    for cut in _pieces(said):
        parts = [_found(part, language) for part in cut.parts]
        known = sum(part != before for part, before in zip(parts, cut.parts, strict=True))
        if known and all(
            part != before or not WORDY.search(before)
            for part, before in zip(parts, cut.parts, strict=True)
        ):
            pieced = cut.joint.join(parts) + cut.end
            if whole is None or _left(pieced) < _left(whole):
                return pieced
    return said if whole is None else whole


def _left(said: str) -> int:
    """Return the number of words that are still English."""
    return len(WORDY.findall(said))


def _matched(said: str, language: str) -> str | None:
    first = None
    for template in _templates(language):
        match = template.pattern.fullmatch(said)
        if match is None:
            continue
        values = {name: _found(value, language) for name, value in match.groupdict().items()}
        filled = template.said.format_map(values)
        if not any(WORDY.search(value) for value in values.values()):
            return filled
        first = first or filled  # a name or a number format isn't a word; a better match may follow
    return first


@dataclass(frozen=True)
class _Cut:
    parts: tuple[str, ...]
    joint: str
    end: str = ""


def _pieces(said: str) -> Iterator[_Cut]:
    """Split a sentence at the points where parts were joined."""
    if said.endswith("."):
        yield _Cut((said[:-1],), "", "。")
    for joint, local in (("; ", "；"), (": ", "："), (", ", "，")):
        if joint in said:
            yield _Cut(tuple(said.split(joint)), local)
            head, _, tail = said.partition(joint)
            yield _Cut((head, tail), local)
