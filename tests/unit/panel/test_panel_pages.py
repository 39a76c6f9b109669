import re

import pytest
from nicegui import Client, ui

from torquebench.errors import InputError
from torquebench.panel.components.elements import words
from torquebench.panel.pages import PAGES
from torquebench.panel.pages.sign_in import safe_target
from torquebench.panel.pages.view import part
from torquebench.panel.service import NotSignedInError
from torquebench.panel.text import LANGUAGES, Text


def test_every_page_has_its_own_path_key_and_title_in_every_language() -> None:
    assert len({page.path for page in PAGES.values()}) == len(PAGES)
    places = sorted(page.place for page in PAGES.values() if page.place)
    assert places == list(range(1, len(places) + 1))
    for language in LANGUAGES:
        titles = {Text(language)(page.title) for page in PAGES.values() if page.place}
        assert len(titles) == len(places)


def test_every_page_may_be_opened_after_signing_in() -> None:
    for page in PAGES.values():
        address = re.sub(r"{\w+}", "20261128T134045Z-x.1", page.path) + "?part=a&at=1"
        assert safe_target(address) == address
    assert safe_target("/calibrations/1/x") == safe_target("//calibrations/1") == "/"


@pytest.mark.parametrize(
    ("failure", "shown"),
    [
        (KeyError("degree"), "This part can't be shown: KeyError: 'degree'"),
        (InputError("a broken run", "an intact one", "restore it"), "a broken run"),
    ],
)
def test_a_part_that_fails_says_so_and_the_rest_is_shown(failure: Exception, shown: str) -> None:
    with Client(ui.page("/parts"), request=None) as client:
        words("p", "before")
        with part(Text("en")):
            words("p", "begun")
            raise failure
        words("p", "after")
    texts = [getattr(each, "text", "") for each in client.elements.values()]
    assert [each for each in texts if each in ("before", "begun", "after")] == [
        "before",
        "begun",
        "after",
    ]
    assert any(shown in each for each in texts)


def test_a_part_without_a_session_leads_to_signing_in() -> None:
    with pytest.raises(NotSignedInError), part(Text("en")):
        raise NotSignedInError("nobody", "somebody")
