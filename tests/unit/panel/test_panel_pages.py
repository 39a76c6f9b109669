from torquebench.panel.pages import PAGES
from torquebench.panel.pages.sign_in import safe_target
from torquebench.panel.text import LANGUAGES, Text


def test_every_page_has_its_own_path_key_and_title_in_every_language() -> None:
    assert len({page.path for page in PAGES.values()}) == len(PAGES)
    assert sorted(page.place for page in PAGES.values()) == list(range(1, len(PAGES) + 1))
    for language in LANGUAGES:
        titles = {Text(language)(f"navigation.{name}") for name in PAGES}
        assert len(titles) == len(PAGES)


def test_every_page_may_be_opened_after_signing_in() -> None:
    for page in PAGES.values():
        assert safe_target(page.path) == page.path
