"""Whatever a person presses, the server's log has no traceback and the browser no error."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.system.panel_browser import SLOW, Panel, Visitor, browser, running_panel

pytestmark = SLOW
READY = """
const shown = (each) => each.offsetParent !== null && !each.disabled;
const place = document.querySelector('.sheet') ?? document.querySelector('.page');
return [...place.querySelectorAll('[data-press]')].filter(shown)
  .map((each) => [each.id, (each.ariaLabel ?? each.innerText.split('\\n').at(-1))
    .replaceAll(/[0-9]/g, '#')]);
"""
PRESS = """
const [id, done] = arguments;
document.getElementById(id)?.click();
const waited = performance.now();
const look = () => {
  const busy = document.getElementById(id)?.hasAttribute('aria-busy');
  if (busy && performance.now() - waited < 20000) setTimeout(look, 30); else setTimeout(done, 80);
};
setTimeout(look, 30);
"""
FILL = """
for (const each of document.querySelectorAll('.sheet input')) {
  each.value = arguments[0];
  each.dispatchEvent(new Event('input', { bubbles: true }));
}
"""
CHOOSE = """
for (const each of document.querySelectorAll('.page select')) {
  if (each.disabled) continue;
  each.selectedIndex = (each.selectedIndex + 1) % each.options.length;
  each.dispatchEvent(new Event('change', { bubbles: true }));
}
"""
MOST = 60


@pytest.fixture
def panel(tmp_path: Path) -> Iterator[Panel]:
    with running_panel(tmp_path, "--fast") as panel:
        yield panel


def press_everything(person: Visitor, path: str) -> set[str]:
    """Press every button of a page once, those too that come up meanwhile; say yes to dialogs."""
    driver, pressed = person.driver, set[str]()
    person.open(path)
    driver.execute_script(CHOOSE)
    for _ in range(MOST):
        if not person.driver.current_url.startswith(person.panel.url + path):
            person.open(path)
        ready = driver.execute_script(READY)
        # The last one first: what a tab shows comes before the next tab.
        found = next((each for each in reversed(ready) if each[1] not in pressed), None)
        if found is None:
            return pressed
        pressed.add(found[1])
        driver.execute_async_script(PRESS, found[0])
        if driver.execute_script("return !!document.querySelector('.sheet')"):
            driver.execute_script(FILL, f"own-{len(pressed)}")
            confirm = driver.execute_script(READY)[-1]
            driver.execute_async_script(PRESS, confirm[0])
            if driver.execute_script("return !!document.querySelector('.sheet')"):
                person.open(path)
    return pressed


@pytest.mark.nightly
def test_everything_is_pressed_and_nothing_breaks(panel: Panel, tmp_path: Path) -> None:
    with browser(panel, tmp_path / "admin") as admin, browser(panel, tmp_path / "ana") as ana:
        admin.sign_in("Admin", "/calibrate")
        admin.fill("Step size", "20")
        admin.press("Start calibration")
        admin.sees("Before and after")
        pressed = press_everything(admin, "/settings")
        assert {"Copy under a new name", "Make a token", "Add a person"} <= pressed
        pressed = press_everything(admin, "/records")
        assert any(each.startswith("Open") for each in pressed)
        admin.open("/operations/zero")
        admin.press("Start", within="//main")
        admin.sees("Zero measured")
        admin.press("Add to the queue")
        admin.open("/operations")
        admin.press("Start the queue")
        admin.sees("Zeroing: done")
        for path in ("/", "/reducer", "/calibrate", "/records", "/alarms"):
            press_everything(admin, path)
        ana.sign_in("Ana", "/records")
        ana.driver.execute_script("fetch('/panel/sign-out', { method: 'POST' })")
        ana.wait(lambda: "/sign-in" in ana.driver.current_url, "being sent to the sign-in page")
        admin.open("/alarms")
        assert admin.problems() == []
    assert "Traceback" not in panel.said, panel.said
