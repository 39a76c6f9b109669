"""Texts of the panel in a language, by their English."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Literal, Protocol

from torquebench.message import Message
from torquebench.panel.text.words import ALARM_TITLES
from torquebench.translations import translated
from torquebench.uncertainty import Verdict
from torquebench.units import minus_signs

Language = Literal["en", "zh"]
LANGUAGES: Mapping[Language, str] = {"en": "English", "zh": "中文"}
"""Each language's own name."""
JOINTS: Mapping[Language, str] = {"en": "; ", "zh": "；"}


LABEL_PARTS = re.compile(r"([,;:↑↓]\s*|\s*[-+−]?\d[\d.]*\s*)")
"""What stands between the words of a label of numbers and words."""


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
    accepted_codes = (part.strip()[:2].lower() for part in (accepted or "").split(","))
    for code in (wanted, *accepted_codes):
        for language in LANGUAGES:
            if code == language:
                return language
    return "en"


class Text:
    """The texts of one language.

    Examples
    --------
    >>> text = Text("zh")
    >>> text("In command: {who}", who="Ana"), text("Fitting models")
    ('操作权：Ana', '正在拟合模型')
    >>> Text("en")(Message("{torque:g} N·m, {branch}", -40.0, "down"))
    '−40 N·m, down'
    """

    def __init__(self, language: Language = "en") -> None:
        self.language = language

    def __call__(self, english: str, **values: object) -> str:
        """Return an English text, term or message in this language, its placeholders filled."""
        known = translated(english, self.language)
        known = known.format(**values) if values else known
        return minus_signs(known) if isinstance(english, Message) else known

    def verdict(self, value: str) -> str:
        """Return the label of a verdict; empty without a verdict.

        Examples
        --------
        >>> Text("en").verdict("conditionalPass")
        'conditional pass'
        """
        return self(Verdict(value).label)

    def alarm(self, kind: str) -> str:
        """Return the title of a kind of alarm.

        Examples
        --------
        >>> Text("en").alarm("torque limit"), Text("en").alarm("operator missing")
        ('Torque limit', 'Nobody at the bench')
        """
        return self.title(ALARM_TITLES.get(kind, kind))

    def title(self, term: str) -> str:
        """Return a term of the core as a heading.

        Examples
        --------
        >>> Text("en").title("standard deviation")
        'Standard deviation'
        """
        heading = self(term)
        return heading[:1].upper() + heading[1:]

    def label(self, said: str) -> str:
        """Return a drawing's label in this language, if need be by its parts between numbers.

        Examples
        --------
        >>> Text("zh").label("median, clockwise"), Text("zh").label("repeat 2")
        ('中位数，顺时针', '重复 2')
        """
        known = self(said)
        return known if known != said else "".join(map(self, LABEL_PARTS.split(said)))

    def sentence(self, said: str) -> str:
        """Translate a message of the core, and make it a sentence.

        Examples
        --------
        >>> Text("en").sentence("reset the drive")
        'Reset the drive.'
        """
        words, end = self(said), "。" if self.language == "zh" else "."
        return words[:1].upper() + words[1:] + ("" if words.endswith(end) else end)

    def refusal(self, error: Refusal) -> tuple[str, str]:
        """Return two texts of an error: what was found, and allowed values with remedy."""
        allowed = error.allowed and self("Allowed: {allowed}", allowed=self(error.allowed))
        more = (allowed, self(error.remedy))
        return self(error.found), JOINTS[self.language].join(part for part in more if part)

    def refusal_line(self, error: Refusal) -> str:
        """Return all texts of an error in one line."""
        return JOINTS[self.language].join(part for part in self.refusal(error) if part)
