"""The first quarter of an hour: two people, from signing in to a certificate, in twelve clicks."""

import time
from pathlib import Path

import pytest
from tests.system.panel_browser import PEOPLE, SLOW, Visitor, browser, running_panel

pytestmark = [SLOW, pytest.mark.nightly]
MOST_CLICKS = 12


class Clicks:
    """Counts clicks of people; a field that is typed into takes one, too."""

    def __init__(self) -> None:
        self.made: list[str] = []

    def sign_in(self, person: Visitor, name: str, path: str) -> None:
        person.sign_in(name, path)
        self.made.append("Sign in")

    def press(self, person: Visitor, label: str, within: str = "") -> None:
        person.press(label, within)
        self.made.append(label)

    def password(self, person: Visitor, name: str) -> None:
        person.fill("Your password", PEOPLE[name][1])
        self.made.append("Your password")


def test_two_people_need_twelve_clicks_to_the_first_certificate(tmp_path: Path) -> None:
    with (
        running_panel(tmp_path, "--fast") as panel,
        browser(panel, tmp_path / "ben") as ben,
        browser(panel, tmp_path / "ana") as ana,
    ):
        clicks, began = Clicks(), time.monotonic()
        clicks.sign_in(ben, "Ben", "/")
        clicks.press(ben, "Calibrate", within="//nav")
        clicks.press(ben, "Start calibration")
        ben.sees("Before and after")
        clicks.press(ben, "Next step")
        clicks.press(ben, "Start verification")
        ben.sees("Verify again")
        clicks.press(ben, "Give up command")
        clicks.sign_in(ana, "Ana", "/calibrations/1")  # the address that Ben has told
        clicks.password(ana, "Ana")
        clicks.press(ana, "Sign and put into use")
        ana.sees("Signed.")
        clicks.password(ana, "Ana")
        clicks.press(ana, "Issue the certificate")
        ana.sees("is issued")
        seconds = time.monotonic() - began
        print(f"{len(clicks.made)} clicks, {seconds:.0f} s: {', '.join(clicks.made)}")
        assert len(clicks.made) <= MOST_CLICKS
