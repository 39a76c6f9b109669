"""Both languages say the same things with the same placeholders, and every key is used."""

import re
from pathlib import Path
from string import Formatter

import pytest

import torquebench.panel
from torquebench.bench.safety import AlarmKind
from torquebench.panel.text import LANGUAGES, Text, choose_language, words

PANEL = Path(torquebench.panel.__file__).parent
KEY = re.compile(r"""\b(?:text|said|Text\(language\))\(\s*f?["']([a-z_]+\.[^"']+)["']""")


def placeholders(text: str) -> set[str]:
    return {name for _, name, _, _ in Formatter().parse(text) if name is not None}


def sources() -> str:
    files = [file for file in PANEL.rglob("*.py") if file.parent.name != "text"]
    return "\n".join(file.read_text(encoding="utf-8") for file in files)


def test_both_languages_have_the_same_keys() -> None:
    assert list(words("en")) == list(words("zh"))


@pytest.mark.parametrize("key", words("en"))
def test_a_text_has_the_same_placeholders_in_both_languages(key: str) -> None:
    assert placeholders(words("en")[key]) == placeholders(words("zh")[key])
    assert words("zh")[key].strip()


def test_chinese_is_chinese_nearly_everywhere() -> None:
    def latin(text: str) -> bool:
        return not re.search(r"[\u4e00-\u9fff]", text)

    english = {key for key, text in words("zh").items() if latin(text)}
    assert english <= {
        "chart.between",
        "chart.table",
        "column.of_side",
        "live.uncertainty",
        "job.ended",
        "job.stage",
        "reducer.uncertainty",
    }


def test_every_literal_key_on_a_page_exists() -> None:
    missing = {
        key
        for key in re.findall(r"""["']([a-z_]+\.[a-z_]+[a-z])["']""", sources())
        if key.split(".")[0] in {name.split(".")[0] for name in words("en")}
    } - set(words("en"))
    assert missing == set()


def test_every_alarm_has_a_title_and_what_to_do() -> None:
    for kind in AlarmKind:
        key = kind.value.replace(" ", "_")
        assert words("en")[f"alarm.{key}"]
        assert words("en")[f"alarm.{key}_do"]


def test_no_group_of_texts_is_unused() -> None:
    text = sources()
    unused = [
        key
        for key in words("en")
        if key not in text
        and not re.search(rf"""f["']{re.escape(key.split(".")[0])}\.""", text)
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
