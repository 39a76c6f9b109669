"""One English text has one translation, and the panel speaks the language that was chosen."""

import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

import torquebench
from torquebench.bench.safety.alarms import ALARM_CATALOGUE, AlarmKind
from torquebench.panel.text import ALARM_TITLES, Text, choose_language
from torquebench.translations import templates

LABELS = Path(torquebench.__file__).parent / "reports" / "certificate" / "labels.toml"
HOMONYMS = {
    "compensation",  # the model of a certificate, what an interface does
    "factor",  # a number, an influence
    "off",  # a switch of the page, a drive
    "on",
    "serial",  # a kind of line, a number
}
"""English texts that mean two things."""


def test_every_alarm_has_a_title_and_what_to_do() -> None:
    chinese = Text("zh")
    for kind in AlarmKind:
        assert chinese.alarm(kind.value) != kind.value
        assert chinese(remedy := ALARM_CATALOGUE[kind].remedy) != remedy
    assert set(ALARM_TITLES) < {kind.value for kind in AlarmKind}


def test_the_chosen_language_wins_over_the_browsers() -> None:
    assert choose_language("zh", "en-GB,en;q=0.9") == "zh"
    assert choose_language("xx", "fr,zh-CN;q=0.8") == "zh"
    assert choose_language(None, None) == "en"


def pairs_of(language: str) -> Iterator[tuple[str, str]]:
    """Yield every English text with its translation, from all catalogues."""
    labels = tomllib.loads(LABELS.read_text(encoding="utf-8"))
    yield from ((label["en"], label[language]) for label in labels.values())
    names = templates("en")
    yield from (pair for pair in templates(language).items() if pair[0] not in names)


def same(text: str) -> str:
    """Return a text as it is compared: a term may begin a sentence."""
    return text.casefold().rstrip("。").removesuffix("." if " " in text else "")


@pytest.mark.parametrize("language", ["de", "zh"])
def test_one_english_text_has_one_translation(language: str) -> None:
    translations: dict[str, set[str]] = {}
    for english, translation in pairs_of(language):
        translations.setdefault(same(english), set()).add(same(translation))
    several = {english: said for english, said in translations.items() if len(said) > 1}
    assert {english: said for english, said in several.items() if english not in HOMONYMS} == {}
