"""Texts of the panel in a language: by a short name, or the English text of the core."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from functools import cache
from importlib import resources
from typing import Any, Literal, Protocol, get_args

from torquebench.translations import templates, translated
from torquebench.uncertainty import Verdict

__all__ = ["LANGUAGES", "Language", "Text", "choose_language", "words"]

Language = Literal["en", "zh"]
LANGUAGES: tuple[Language, ...] = get_args(Language)
JOINTS: Mapping[Language, str] = {"en": "; ", "zh": "；"}


class Refusal(Protocol):
    """An error, or the stored parts of an error."""

    @property
    def found(self) -> str:
        """What was found."""

    @property
    def allowed(self) -> str:
        """What is allowed."""

    @property
    def remedy(self) -> str:
        """What to do."""


@cache
def words() -> Mapping[str, str]:
    """Return the English text of every short name, such as a button's.

    Examples
    --------
    >>> words()["navigation.live"]
    'Live'
    """
    folder = resources.files("torquebench.panel.text")
    found: dict[str, str] = {}
    for name in ("en.toml", "settings_en.toml"):
        found |= _flat(tomllib.loads((folder / name).read_text(encoding="utf-8")))
    return found


def _flat(table: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []
    for key, value in table.items():
        if isinstance(value, Mapping):
            found.extend(_flat(value, f"{prefix}{key}."))
        else:
            found.append((prefix + key, value))
    return found


def choose_language(wanted: str | None, accepted: str | None) -> Language:
    """Return the user's language, else the browser's, else English.

    Parameters
    ----------
    wanted : str or None
        The choice on the panel.
    accepted : str or None
        The browser's Accept-Language header.

    Examples
    --------
    >>> choose_language(None, "zh-CN,zh;q=0.9,en;q=0.8"), choose_language("en", "zh")
    ('zh', 'en')
    """
    if wanted in LANGUAGES:
        return wanted
    for part in (accepted or "").split(","):
        code = part.partition(";")[0].strip()[:2].lower()
        if code in LANGUAGES:
            return code
    return "en"


class Text:
    """The texts of one language.

    Examples
    --------
    >>> text = Text("en")
    >>> text("alarms.acknowledged", who="Ana", when="12:00:05")
    'Acknowledged by Ana at 12:00:05'
    """

    def __init__(self, language: Language = "en") -> None:
        self.language = language

    def __call__(self, key: str, **values: object) -> str:
        """Return a text with its placeholders filled."""
        found = words().get(key, key)
        if self.language != "en":
            known = templates(self.language)
            found = known.get(key) or known.get(found, found)
        return found.format(**values) if values else found

    def maybe(self, key: str, otherwise: str) -> str:
        """Return the text of a key; without one, the translation of a term of the core."""
        return self(key) if key in words() else self.core(otherwise)

    def core(self, said: str) -> str:
        """Translate a message of the core.

        Examples
        --------
        >>> Text("zh").core("Fitting models")
        '正在拟合模型'
        """
        return translated(said, self.language)

    def verdict(self, value: str) -> str:
        """Return the label of a verdict; empty without a verdict.

        Examples
        --------
        >>> Text("en").verdict("conditionalPass")
        'conditional pass'
        """
        return self.core(Verdict(value).label)

    def alarm(self, kind: str) -> str:
        """Return the title of a kind of alarm.

        Examples
        --------
        >>> Text("en").alarm("torque limit"), Text("en").alarm("operator missing")
        ('Torque limit', 'Nobody at the bench')
        """
        return self.title(self.maybe(f"alarm.{kind.replace(' ', '_')}", kind))

    def title(self, term: str) -> str:
        """Return a term of the core as a heading.

        Examples
        --------
        >>> Text("en").title("standard deviation")
        'Standard deviation'
        """
        heading = self.core(term)
        return heading[:1].upper() + heading[1:]

    def sentence(self, said: str) -> str:
        """Translate a message of the core, and make it a sentence.

        Examples
        --------
        >>> Text("en").sentence("reset the drive")
        'Reset the drive.'
        """
        words, end = self.core(said), "。" if self.language == "zh" else "."
        return words[:1].upper() + words[1:] + ("" if words.endswith(end) else end)

    def refusal(self, error: Refusal) -> tuple[str, str]:
        """Return two texts of an error: what was found, and allowed values with remedy."""
        allowed = error.allowed and self("alarms.allowed", allowed=self.core(error.allowed))
        more = (allowed, self.core(error.remedy))
        return self.core(error.found), JOINTS[self.language].join(part for part in more if part)

    def refusal_line(self, error: Refusal) -> str:
        """Return all texts of an error in one line."""
        return JOINTS[self.language].join(part for part in self.refusal(error) if part)
