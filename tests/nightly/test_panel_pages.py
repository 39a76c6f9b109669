"""Every page of the panel: accessible, as wide as its screen, without a failing part."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.keys import Keys
from tests.system.command_line import COMMAND, ROOT, environment
from tests.system.panel_browser import SLOW, Panel, Visitor, browser, running_panel

from torquebench.operations import OPERATIONS
from torquebench.panel.pages import PAGES

PAPER = (688, 990)
"""A4 within its margins, px."""
pytestmark = [SLOW, pytest.mark.nightly]
PARTS = {
    "/": ("?view=xy", "?view=digits"),
    "/records": ("?part=calibrations&with=1", "?part=drift", "?part=certificates"),
    "/settings": tuple(
        f"?part={part}" for part in ("profiles", "reducers", "users", "tokens", "log", "history")
    ),
    "/setup": tuple(f"?part={part}" for part in ("bench", "instruments", "laboratory", "people")),
    "/calibrations/1": tuple(
        f"?step={step}" for step in ("models", "verify", "sign", "certificate")
    ),
}
"""Parts of pages with an address of their own."""
NAMES = [each.name for each in OPERATIONS.values() if " " in each.name]
COMMANDS = re.compile("|".join(["--[a-z]", *NAMES]))
"""Commands and their options, which every language has in English."""
UNREAD = re.compile(r"\b20\d\d-\d\d-\d\d\b|[1-9]\.\d{5}|\.0*[1-9]\d{4}|\de-\d")
"""Days and figures as programs write them."""
TEXT = """
const times = [...document.querySelectorAll('time')];
times.forEach((each) => { each.hidden = true; });
const text = document.body.innerText;
times.forEach((each) => { each.hidden = false; });
return text;
"""
"""What a page says without its times, which the browser may not have written yet."""
CUT = """
const parts = '.page :is(button, label, h1, h2, h3, summary, .tag, dd, td, li)';
return [...document.querySelectorAll(parts)]
  .filter((each) => each.checkVisibility() && !each.closest('.scroll, .hidden-visually'))
  .filter((each) => each.getBoundingClientRect().right > innerWidth + 1)
  .map((each) => each.textContent.slice(0, 60));
"""
"""What a screen cuts although the page isn't wider than it: a box hides what goes beyond it."""
REACHABLE = """
document.addEventListener('focusin', ({target}) => {
  target.dataset.reached = getComputedStyle(target).outlineStyle;
});
const parts = ':is(a[href], button, input, select, textarea, summary, [tabindex="0"])';
const groups = new Set();
window.reachable = [...document.querySelectorAll(parts)]
  .filter((each) => each.checkVisibility() && !each.disabled)
  .filter((each) => each.type !== 'radio' || !groups.has(each.name) && groups.add(each.name));
return window.reachable.length;
"""
"""Everything that Tab has to reach; of a group of radio buttons, one."""
UNREACHED = """
const reached = (each) => each.type === 'radio'
  ? document.querySelector(`input[name="${each.name}"][data-reached]`) : each;
return window.reachable.filter((each) => each.isConnected)
  .filter((each) => !['solid', 'auto'].includes(reached(each)?.dataset.reached))
  .map((each) => each.outerHTML.slice(0, 120));
"""
"""What Tab hasn't reached, or what doesn't show that it has the focus."""
LEFT_ON_PAPER = """
return [...document.querySelectorAll('button, .rail, .bar, .messages')]
  .filter((each) => each.offsetHeight).map((each) => each.outerHTML.slice(0, 120));
"""
SETTLED = """
const [done] = arguments;
const busy = () => document.querySelector('.page p[role=status]');
const look = (left) => (busy() && left ? setTimeout(look, 100, left - 1) : setTimeout(done, 200));
look(100);
"""


@pytest.fixture(scope="module")
def panel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Panel]:
    folder: Path = tmp_path_factory.mktemp("panel")
    for command in (["calibrate", "output", "--step", "20"], ["zero"]):
        subprocess.run(
            [COMMAND, *command, "--data", "data"],
            cwd=folder, env=environment(), check=True, capture_output=True,
        )  # fmt: skip
    with running_panel(folder, "--fast") as panel:
        yield panel


@pytest.fixture(scope="module")
def person(panel: Panel, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Visitor]:
    with browser(panel, tmp_path_factory.mktemp("browser")) as visitor:
        visitor.sign_in("Admin")
        yield visitor


def addresses(panel: Panel) -> list[str]:
    """Return the addresses of all pages, parts and operations."""
    run = next(path.name for path in (panel.folder / "data" / "runs").iterdir() if path.is_dir())
    values = {"{run_id}": run, "{number}": "1", "{job_id}": "none"}
    found = ["/sign-in"]
    for page in PAGES.values():
        path = page.path
        if path.endswith("{key}"):
            found += [f"/operations/{each.key}" for each in OPERATIONS.values() if each.served]
            continue
        for name, value in values.items():
            path = path.replace(name, value)
        found += [path, *(path + part for part in PARTS.get(path, ()))]
    return found


@pytest.mark.parametrize(
    ("size", "look", "language"),
    [
        ((1366, 768), "light", "zh"),
        ((1920, 1080), "dark", "en"),
        ((390, 844), "dark", "zh"),
        ((390, 844), "light", "en"),  # whose words are longer
    ],
)
def test_every_page_is_accessible_and_fits_its_screen(
    person: Visitor, panel: Panel, size: tuple[int, int], look: str, language: str
) -> None:
    person.size(*size)
    for name, value in (("look", look), ("language", language)):
        person.driver.add_cookie({"name": f"torquebench_{name}", "value": value})
    wrong = []
    for address in addresses(panel):
        person.open(address)
        person.driver.execute_async_script(SETTLED)
        width = person.driver.execute_script("return document.documentElement.scrollWidth")
        wrong += [f"{address}: {each}" for each in (*person.axe(), *person.problems())]
        wrong += [f"{address}: {width} px wide"] * (width > size[0])
        wrong += [f"{address}: backquotes"] * ("`" in person.text)
        lines = person.driver.execute_script(TEXT).splitlines()
        wrong += [f"{address}: {line}" for line in lines if UNREAD.search(line)]
        hidden = person.driver.execute_script(CUT)
        wrong += [f"{address}: {each} is cut" for each in hidden]
        if language == "zh" and "?part=log" not in address:  # whose typed reasons stay as they are
            lines = [line for line in person.english() if not COMMANDS.search(line)]
            wrong += [f"{address}: {line}" for line in lines]
    assert wrong == []
    assert "Traceback" not in panel.said, panel.said


def test_every_page_is_used_by_keyboard_and_printed(person: Visitor, panel: Panel) -> None:
    person.size(1366, 768)
    person.driver.add_cookie({"name": "torquebench_language", "value": "en"})
    wrong = []
    for address in addresses(panel):
        person.open(address)
        person.driver.execute_async_script(SETTLED)
        count = person.driver.execute_script(REACHABLE)
        ActionChains(person.driver).send_keys(Keys.TAB * (count + 10)).perform()
        unreached = person.driver.execute_script(UNREACHED)
        wrong += [f"{address}: Tab doesn't reach {each}" for each in unreached]
        person.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
        person.size(*PAPER)
        left = person.driver.execute_script(LEFT_ON_PAPER)
        wrong += [f"{address}: printed with {each}" for each in left]
        width = person.driver.execute_script("return document.documentElement.scrollWidth")
        wrong += [f"{address}: {width} px wide on paper"] * (width > PAPER[0])
        person.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
        person.size(1366, 768)
    assert wrong == []


def test_the_panels_pictures_are_made_without_the_tests_surroundings(tmp_path: Path) -> None:
    ours = {"PICTURES": str(tmp_path), "PATH": os.environ["PATH"], "HOME": str(tmp_path)}
    command = [sys.executable, "-m", "tests.pictures", "panel"]
    made = subprocess.run(command, cwd=ROOT, env=ours, check=False, capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    assert {path.name for path in (tmp_path / "panel").iterdir()} == {
        path.name for path in (ROOT / "docs" / "images" / "panel").iterdir()
    }
