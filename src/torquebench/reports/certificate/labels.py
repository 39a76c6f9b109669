"""Texts of a certificate in its languages, and their number formats.

`labels.toml` holds the headings and sentences of the layout; terms and messages of the core are
translated by `torquebench.translations`.
"""

import tomllib
from functools import cache
from importlib import resources

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.translations import translated
from torquebench.uncertainty import rounded
from torquebench.units import minus_signs

LANGUAGES = ("en", "de", "zh")


class Labels:
    """The labels, terms and number format of one language.

    Examples
    --------
    >>> german = labels_of("de")
    >>> german["title"], german.number(-0.25, 2)
    ('Kalibrierschein', '−0,25')
    >>> german.pair(1.23456, 0.0821)
    ('1,235', '0,082')
    """

    def __init__(self, language: str, words: dict[str, str]) -> None:
        self.language = language
        self._words = words

    def __getitem__(self, key: str) -> str:
        """Return the text of a label; for other keys, the translated term of the core."""
        return self._words.get(key) or self.said(key)

    def said(self, message: str) -> str:
        """Translate a message, term or short name of the core.

        Examples
        --------
        >>> labels_of("de").said(Message("at most {limit:g} K", 1.5))
        'höchstens 1,5 K'
        """
        return translated(message, self.language, self._marked)

    def number(self, value: float, decimals: int) -> str:
        """Return a number with a real minus sign and the language's decimal mark."""
        text = f"{value:.{decimals}f}"
        if float(text) == 0.0:
            text = text.removeprefix("-")
        return self._marked(text)

    def short(self, value: float, digits: int = 6) -> str:
        """Return a number with up to `digits` significant digits."""
        return self._marked(f"{value:.{digits}g}")

    def pair(self, value: float, expanded_uncertainty: float) -> tuple[str, str]:
        """Return value and uncertainty, rounded to two significant digits of the uncertainty."""
        decimals = rounded(expanded_uncertainty)[1]
        return self.number(value, decimals), self.uncertainty(expanded_uncertainty)

    def uncertainty(self, value: float) -> str:
        """Return an uncertainty with two significant digits."""
        shown, decimals = rounded(value)
        return self.number(shown, decimals)

    def _marked(self, text: str) -> str:
        text = minus_signs(text)
        return text.replace(".", ",") if self.language == "de" else text


def check_languages(languages: tuple[str, ...]) -> None:
    """Raise an error for a language that has no texts.

    Raises
    ------
    InputError
    """
    for language in languages:
        if language not in LANGUAGES:
            raise InputError(Message("language {language!r}", language), ", ".join(LANGUAGES))


@cache
def labels_of(language: str) -> Labels:
    """Return the labels of a language.

    Raises
    ------
    InputError
        Where the language has no texts.
    """
    check_languages((language,))
    text = (resources.files(__package__) / "labels.toml").read_text(encoding="utf-8")
    table = tomllib.loads(text)
    return Labels(language, {key: words[language] for key, words in table.items()})
