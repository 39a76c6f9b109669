"""Every text of the panel has its Chinese with the same placeholders, and every key is used."""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from string import Formatter

import pytest

import torquebench.panel
from torquebench.bench.safety import AlarmKind
from torquebench.panel.text import LANGUAGES, Text, choose_language, words
from torquebench.translations import templates

PANEL = Path(torquebench.panel.__file__).parent
LABELS = PANEL.parent / "reports" / "certificate" / "labels.toml"
HOMONYMS = {
    "english",  # a language, the switch to the other one
    "name",  # of a person, of a thing
    "off",  # a switch of the page, a drive
    "on",
    "serial",  # a kind of line, a number
}
"""English texts that mean two things."""
KEY = re.compile(r"""\b(?:text|said|Text\(language\))\(\s*f?["']([a-z_]+\.[^"']+)["']""")


def placeholders(text: str) -> set[str]:
    return {name for _, name, _, _ in Formatter().parse(text) if name is not None}


def sources() -> str:
    files = [file for file in PANEL.rglob("*.py") if file.parent.name != "text"]
    return "\n".join(file.read_text(encoding="utf-8") for file in files)


def test_every_text_has_its_chinese_with_the_same_placeholders() -> None:
    known, chinese = templates("zh"), Text("zh")
    wrong = {
        key: english
        for key, english in words().items()
        if english not in known or placeholders(chinese(key)) != placeholders(english)
    }
    assert wrong == {}


def test_chinese_is_chinese_nearly_everywhere() -> None:
    def latin(text: str) -> bool:
        return not re.search(r"[\u4e00-\u9fff]", text)

    assert {key for key in words() if latin(Text("zh")(key))} <= {
        "chart.between",
        "chart.table",
        "live.uncertainty",
        "job.ended",
        "job.stage",
        "reducer.uncertainty",
    }


def test_every_literal_key_on_a_page_exists() -> None:
    missing = {
        key
        for key in re.findall(r"""["']([a-z_]+\.[a-z_]+[a-z])["']""", sources())
        if key.split(".")[0] in {name.split(".")[0] for name in words()}
    } - set(words())
    assert missing == set()


def test_every_alarm_has_a_title_and_what_to_do() -> None:
    chinese = Text("zh")
    for kind in AlarmKind:
        assert chinese.alarm(kind.value) != kind.value
        assert words()[f"alarm.{kind.value.replace(' ', '_')}_do"]


def test_no_group_of_texts_is_unused() -> None:
    text = sources()
    unused = [
        key
        for key in words()
        if key not in text
        and not re.search(rf"""f["']{re.escape(key.split(".")[0])}\.""", text)
        and f'headings(text, "{key.split(".")[0]}"' not in text
        and not re.search(rf"""maybe\(f["']{re.escape(key.split(".")[0])}\.""", text)
    ]
    assert unused == []


def test_the_chosen_language_wins_over_the_browsers() -> None:
    assert choose_language("zh", "en-GB,en;q=0.9") == "zh"
    assert choose_language("xx", "fr,zh-CN;q=0.8") == "zh"
    assert choose_language(None, None) == "en"


def test_placeholders_are_filled() -> None:
    for language in LANGUAGES:
        assert "Ana" in Text(language)("frame.in_command", who="Ana")


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


def test_every_page_has_a_title() -> None:
    pages = set(re.findall(r'\b(?:frame|tabs)\(\s*visitor, "(\w+)"', sources()))
    assert {"live", "operations", "settings"} <= pages
    assert {f"navigation.{page}" for page in pages} <= set(words())
