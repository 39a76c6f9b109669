"""A person at the panel: live values, stop, alarms, settings, keyboard, phone, a lost server."""

import contextlib
import signal
import time
from collections.abc import Iterator
from datetime import datetime
from zoneinfo import ZoneInfo

import httpx
import psutil
import pytest
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from tests.support.draws import nightly
from tests.system.panel_browser import (
    PATIENCE_S,
    PEOPLE,
    SLOW,
    Panel,
    Visitor,
    browser,
    running_panel,
)
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from torquebench.panel.pages.frame import REFRESH_S

pytestmark = SLOW
PATHS = ("/", "/setup", "/calibrate", "/reducer", "/records", "/settings", "/alarms")


@pytest.fixture(scope="module")
def panel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Panel]:
    with running_panel(tmp_path_factory.mktemp("panel"), "--fast") as panel:
        yield panel


@pytest.fixture(scope="module")
def person(panel: Panel, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Visitor]:
    with browser(panel, tmp_path_factory.mktemp("browser")) as visitor:
        visitor.sign_in("Admin")
        yield visitor


@pytest.fixture(scope="module")
def _second(panel: Panel, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Visitor]:
    with browser(panel, tmp_path_factory.mktemp("browser")) as visitor:
        yield visitor


@pytest.fixture
def stranger(_second: Visitor) -> Iterator[Visitor]:
    """Somebody with a browser of his own who isn't signed in."""
    _second.open("/sign-in")
    _second.driver.delete_all_cookies()
    yield _second
    _second.open("/sign-in")  # a page of the bench would go on being painted


@pytest.fixture(autouse=True)
def ordinary_screen(person: Visitor) -> Iterator[None]:
    """Whatever a test leaves behind, the next one begins with the usual screen and language."""
    yield
    person.size(1440, 900)
    for cookie in ("torquebench_language", "torquebench_look"):
        person.driver.delete_cookie(cookie)


def painted(person: Visitor) -> int:
    return int(person.driver.execute_script("return window.torquebench.painted"))


def test_live_values_are_painted_as_they_come(person: Visitor) -> None:
    person.open("/")
    before = painted(person)
    person.wait(lambda: painted(person) > before + 20, "twenty painted updates")
    value = person.driver.find_element(By.CSS_SELECTOR, ".tile.output .value span").text
    assert abs(float(value.replace("−", "-"))) < 50.0
    assert "Not compensated" in person.text
    assert "simulated" in person.text
    person.press("1 min")
    before = painted(person)
    person.wait(lambda: painted(person) > before + 5, "updates of another span")
    assert person.problems() == []


def test_stop_acts_at_once_and_is_acknowledged_by_name(person: Visitor) -> None:
    person.open("/records")
    person.driver.find_element(By.CSS_SELECTOR, "[data-stop]").click()
    person.sees("The bench is stopped")
    person.press("See the alarms")
    person.sees("Stopped by a person")
    assert "by Admin" in person.text
    assert "acknowledge it when" not in person.text  # what to do is said once
    person.press("Acknowledge as Admin")
    person.sees("No active alarms")
    person.sees("acknowledged by Admin")


def test_somebody_not_signed_in_can_stop_but_not_look(person: Visitor, stranger: Visitor) -> None:
    stranger.open("/records")
    assert "/sign-in" in stranger.driver.current_url
    stranger.driver.find_element(By.TAG_NAME, "body").send_keys(Keys.F8)
    person.open("/alarms")
    person.sees("somebody not signed in")
    person.press("Acknowledge as Admin")
    person.sees("No active alarms")


@pytest.mark.nightly
def test_wrong_passwords_are_refused_and_nobody_is_sent_elsewhere(
    panel: Panel, stranger: Visitor
) -> None:
    stranger.open("/sign-in?next=https://elsewhere.example/")
    stranger.driver.find_element(By.NAME, "name").send_keys("Ben")
    stranger.driver.find_element(By.NAME, "password").send_keys("guessed", Keys.ENTER)
    stranger.sees("Name and password don't belong together.")
    assert stranger.driver.current_url.startswith(panel.url)


IN_SIGHT = """
const button = [...document.querySelectorAll('button')].find(
  each => each.textContent.includes('Apply these changes'));
const { top, bottom } = button.getBoundingClientRect();
return window.scrollY < 400 && top > 0 && bottom <= window.innerHeight;
"""


@pytest.mark.nightly
def test_limits_are_changed_as_a_difference_and_undone(person: Visitor) -> None:
    person.open("/settings")
    entry = person.driver.find_element(By.CSS_SELECTOR, "[data-key='output.limits.torque_nm']")
    entry.send_keys(Keys.CONTROL, "a")
    entry.send_keys("many")
    field = entry.find_element(By.XPATH, "ancestor::div[contains(@class, 'field')]")
    person.wait(lambda: "Allowed: a number, above 0" in field.text, "an answer beside the field")
    assert "a number, above 0 to 1,000,000 N·m" in field.text
    assert "output.limits" not in field.text
    person.sees("Values that can't be: 1.")
    assert not person.driver.find_element(
        By.XPATH, "//button[contains(., 'Apply these changes')]"
    ).is_enabled()
    entry.send_keys(Keys.CONTROL, "a")
    entry.send_keys("2100")
    person.sees("What would change")
    person.sees("Output module: Limits: Maximum torque")
    person.wait(lambda: person.driver.execute_script(IN_SIGHT), "the button to apply, in sight")
    change = person.driver.find_element(By.CSS_SELECTOR, "ul.change li")
    assert change.text.split()[-3:] == ["2400", "2100", "N·m"]
    person.press("Apply these changes")
    person.sees("Changed and logged.")
    person.press("Changes")
    person.sees("Output module: Limits: Maximum torque")
    person.press("Undo")
    person.sees("undoes change")
    assert person.problems() == []


ANSWERED = """
const done = arguments[0];
const preview = document.querySelector('.preview');
const sheet = document.querySelector('link[href*="panel.css"]').href;
const tests = [...document.querySelectorAll('label')];
tests.find(each => each.textContent.includes('Full test')).click();
let answered = 0, began = false;
const ask = async () => {
  await fetch(sheet, {cache: 'no-store'});
  const busy = preview.getAttribute('aria-busy') === 'true';
  answered += busy;
  began ||= busy;
  if ((began && !busy)) done(answered);
  else setTimeout(ask);
};
ask();
"""


@pytest.mark.nightly
def test_the_server_answers_while_a_full_test_is_rehearsed(person: Visitor) -> None:
    person.open("/reducer")
    person.sees("Dry run")
    person.driver.set_script_timeout(120)
    assert person.driver.execute_async_script(ANSWERED) > 3
    person.sees("Dry run")
    assert person.problems() == []


@pytest.mark.nightly
def test_tokens_and_the_log_have_pages_with_the_readers_clock(person: Visitor) -> None:
    driver = person.driver
    driver.execute_cdp_cmd("Emulation.setTimezoneOverride", {"timezoneId": "Asia/Tokyo"})
    driver.execute_cdp_cmd("Emulation.setLocaleOverride", {"locale": "de-DE"})
    try:
        person.open("/settings")
        person.press("Tokens")
        person.fill("Program", "logger")
        person.press("Make a token")
        person.sees("it isn't shown again")
        token = driver.find_element(By.TAG_NAME, "code").text
        bench = f"{person.panel.url}/api/v1/bench"
        headers = {"Authorization": f"Bearer {token}"}
        assert httpx.get(bench, headers=headers, timeout=PATIENCE_S).status_code == 200
        person.press("Revoke")
        person.sees("from now on and for good")
        driver.find_element(By.CSS_SELECTOR, ".sheet .danger").click()
        person.sees("No program has a token.")
        assert httpx.get(bench, headers=headers, timeout=PATIENCE_S).status_code == 401
        person.press("Log")
        person.sees("revoked a client")
        person.wait(lambda: driver.execute_script("return !!document.querySelector('time').title"),
                    "a local time")  # fmt: skip
        local, utc = driver.execute_script(
            "const time = document.querySelector('time'); return [time.textContent, time.dateTime];"
        )
        at = datetime.fromisoformat(utc).astimezone(ZoneInfo("Asia/Tokyo"))
        assert local == f"{at:%d.%m.%Y, %H:%M}"
        assert person.axe() == person.problems() == []
    finally:
        driver.execute_cdp_cmd("Emulation.setTimezoneOverride", {"timezoneId": ""})
        driver.execute_cdp_cmd("Emulation.setLocaleOverride", {})


def test_pages_load_nothing_from_elsewhere(person: Visitor) -> None:
    for path in (*PATHS, "/sign-in", "/nowhere", "/panel/static/panel.js"):
        policy = httpx.get(person.panel.url + path, timeout=PATIENCE_S).headers[
            "Content-Security-Policy"
        ]
        parts = {part.split()[0]: set(part.split()[1:]) for part in policy.split(";")}
        assert parts["default-src"] == parts["connect-src"] == {"'self'"}
        compiled = {"'unsafe-inline'", "'unsafe-eval'"} if path in PATHS else set()
        assert parts["script-src"] == {"'self'"} | compiled, path
        inline = {"'unsafe-inline'", "data:", "blob:", "'none'", "'self'"}
        assert set().union(*(parts[each] for each in parts if each != "script-src")) <= inline
    for path in ("/sign-in", "/nowhere"):
        person.open(path)
        script = "return performance.getEntriesByType('resource').map((each) => each.name)"
        loaded = person.driver.execute_script(script)
        assert len(loaded) >= 2
        assert all(each.startswith(f"{person.panel.url}/panel/static/") for each in loaded)
    assert [each for each in person.problems() if "404" not in each] == []  # the policy held


@pytest.mark.nightly
def test_a_page_is_printed_without_buttons_and_with_its_charts(person: Visitor) -> None:
    driver = person.driver
    person.open("/calibrate")
    person.sees("Dry run")
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    person.size(688, 990)  # of A4 within its margins
    try:
        hidden = ("button", ".rail", ".bar")
        shown = (
            "return [...document.querySelectorAll(arguments[0])]"
            ".filter((each) => each.offsetHeight).length"
        )
        for each in hidden:
            assert driver.execute_script(shown, each) == 0
        width, height = driver.execute_script(
            "const box = document.querySelector('.chart canvas').getBoundingClientRect();"
            "return [box.width, box.height];"
        )
        assert 400.0 < width <= 688.0
        assert height > 100.0
    finally:
        driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})


COVERED = """
const foot = document.querySelector('.rail')?.getBoundingClientRect().top ?? window.innerHeight;
const head = document.querySelector('.bar')?.getBoundingClientRect().bottom ?? 0;
return [...document.querySelectorAll('.page button, .page a.control, .page input, .page select')]
  .filter((each) => each.checkVisibility() && each.getBoundingClientRect().height < 100)
  .filter((each) => {
    each.scrollIntoView({ block: 'nearest' });
    const { top, bottom } = each.getBoundingClientRect();
    return bottom > foot || top < head;
  })
  .map((each) => each.outerHTML.slice(0, 120));
"""


@pytest.mark.parametrize("path", ["/sign-in", *map(nightly, PATHS)])
def test_a_page_is_accessible_and_fits_a_phone(person: Visitor, path: str) -> None:
    person.open(path)
    assert person.axe() == []
    person.size(390, 844)
    person.open(path)
    width = person.driver.execute_script("return document.documentElement.scrollWidth")
    assert width <= 390
    small = person.driver.execute_script(
        "return [...document.querySelectorAll('button, a.control, .rail a, input, select')]"
        ".filter((each) => each.offsetParent && !each.matches('[type=radio], [type=checkbox]'))"
        ".filter((each) => each.getBoundingClientRect().height < 48)"
        ".map((each) => each.outerHTML.slice(0, 120))"
    )
    assert small == []
    assert person.driver.execute_script(COVERED) == []
    assert person.axe() == []


@pytest.mark.nightly
def test_a_newcomer_sees_which_steps_are_done_and_states_the_laboratory(
    person: Visitor, panel: Panel
) -> None:
    done = "return [...document.querySelectorAll('.checklist .done a')].map((each) => each.text)"
    person.open("/setup")
    person.sees("Until the first certificate")
    assert "Calibrate a module" not in person.driver.execute_script(done)
    assert "Add a second person" in person.driver.execute_script(done)
    person.press("State the laboratory and its customer")
    person.fill("Name", "Lab Nord")
    person.fill("City", "Ulm")
    person.fill("Country", "Germany")
    person.press("Start")
    person.sees("a country's two capital letters")
    person.fill("Country", "DE")
    person.press("Start")
    person.sees("Certificates name Lab Nord.")
    assert 'city = "Ulm"' in (panel.folder / "data" / "laboratory.toml").read_text("utf-8")
    person.press("New bench")
    person.wait(lambda: "part=bench" in person.driver.current_url, "the part in the address")
    person.driver.refresh()
    person.connected()
    person.press("Laboratory and customer")
    person.wait(
        lambda: person.field("Name").get_attribute("value") == "Lab Nord", "the stated laboratory"
    )
    assert person.problems() == []


def test_everything_is_reached_by_keyboard(person: Visitor) -> None:
    person.open("/")
    body = person.driver.find_element(By.TAG_NAME, "body")
    body.send_keys(Keys.TAB)
    assert person.driver.switch_to.active_element.text == "Skip to the page's content"
    person.driver.switch_to.active_element.send_keys(Keys.ALT, "6")
    person.sees("No active alarms")
    menu = person.driver.find_element(By.CSS_SELECTOR, "[aria-label='Menu']")
    menu.send_keys(Keys.ENTER)
    person.sees("F8: stop the bench")
    assert person.axe() == []
    person.driver.switch_to.active_element.send_keys(Keys.ESCAPE)
    person.wait(lambda: "F8: stop the bench" not in person.text, "a closed menu")
    outline = person.driver.execute_script(
        "document.querySelector('.rail a').focus({focusVisible: true});"
        "return getComputedStyle(document.activeElement).outlineWidth"
    )
    assert outline == "3px"


@pytest.mark.nightly
def test_chinese_and_dark_are_chosen_in_the_menu(person: Visitor) -> None:
    person.open("/alarms")
    person.driver.find_element(By.CSS_SELECTOR, "[aria-label='Menu']").click()
    person.press("中文")
    person.sees("没有报警")
    assert person.driver.find_element(By.TAG_NAME, "html").get_attribute("lang") == "zh-CN"
    person.driver.find_element(By.CSS_SELECTOR, "[aria-label='菜单']").click()
    person.press("深色")
    person.wait(
        lambda: (
            person.driver.execute_script("return document.documentElement.dataset.theme") == "dark"
        ),
        "the dark look",
    )
    person.connected()
    assert person.axe() == []
    person.driver.find_element(By.CSS_SELECTOR, "[aria-label='菜单']").click()
    person.press("English")
    person.sees("No active alarms")


@pytest.mark.nightly
def test_a_dialog_is_in_its_place_from_the_first_moment(person: Visitor) -> None:
    person.open("/alarms")
    places = person.driver.execute_async_script(
        """
        const [done] = arguments, seen = [];
        const look = () => {
          const button = document.querySelector('.sheet [lang=zh]');
          if (button) seen.push(JSON.stringify(button.getBoundingClientRect()));
          if (seen.length < 30) requestAnimationFrame(look); else done([...new Set(seen)]);
        };
        document.querySelector("[aria-label='Menu']").click();
        look();
        """
    )
    assert len(places) == 1


@pytest.mark.parametrize("size", [(1440, 900), (390, 844)])
def test_a_dialog_does_not_cover_the_stop(person: Visitor, size: tuple[int, int]) -> None:
    person.size(*size)
    person.open("/alarms")
    point(person, "[aria-label='Menu']", "mousePressed", "mouseReleased")
    person.sees("F8: stop the bench")
    assert person.driver.execute_script(
        "const {x, y, width, height} ="
        " document.querySelector('[data-stop]').getBoundingClientRect();"
        "const sheet = document.querySelector('.sheet').getBoundingClientRect();"
        "return sheet.top >= y + height"
        " && document.elementFromPoint(x + width / 2, y + height / 2).matches('[data-stop]');"
    )


@pytest.mark.nightly
def test_no_press_is_lost_by_a_slow_browser(person: Visitor) -> None:
    """Aimed at where the button is seen first, without waiting for anything to settle."""
    person.open("/alarms")
    person.driver.execute_cdp_cmd("Emulation.setCPUThrottlingRate", {"rate": 8})
    try:
        for _ in range(8):
            point(person, "[aria-label='Menu']", "mousePressed", "mouseReleased")
            point(person, ".sheet .end button", "mousePressed", "mouseReleased")
            person.wait(
                lambda: not person.driver.find_elements(By.CLASS_NAME, "sheet"), "a closed menu", 20
            )
    finally:
        person.driver.execute_cdp_cmd("Emulation.setCPUThrottlingRate", {"rate": 1})


def point(person: Visitor, selector: str, *events: str) -> None:
    """Aim at a button as soon as it is there, and press or let go."""
    place = person.wait(
        lambda: person.driver.execute_script(
            "const found = document.querySelector(arguments[0])?.getBoundingClientRect();"
            "return found?.width ? [found.x + found.width / 2, found.y + found.height / 2] : null",
            selector,
        ),
        f"{selector} to aim at",
    )
    for event in events:
        person.driver.execute_cdp_cmd(
            "Input.dispatchMouseEvent",
            {
                "type": event,
                "x": place[0],
                "y": place[1],
                "button": "left",
                "buttons": int(event == "mousePressed"),
                "clickCount": 1,
            },
        )


HOLDS_ON = """
const after = window.setTimeout;
window.setTimeout = (act, ms, ...given) => after(act, ms === 10000 ? 600000 : ms, ...given);
"""
"""A page waits 10 s for a mouse to be let go: on a busy computer that is no time."""


@pytest.mark.nightly
def test_a_press_of_what_changes_while_the_mouse_is_down_is_answered(
    person: Visitor, stranger: Visitor
) -> None:
    stop, acknowledge = "[data-stop]", ".panel .spread button.primary"
    stranger.open("/sign-in")
    person.open("/alarms")
    point(person, stop, "mousePressed", "mouseReleased")
    person.sees("Acknowledge as Admin")
    strangers = person.text.count("somebody not signed in")  # of alarms before
    person.driver.execute_script(HOLDS_ON)
    point(person, acknowledge, "mousePressed")
    point(stranger, stop, "mousePressed", "mouseReleased")  # a second alarm: the page is rebuilt
    answered = "return window.torquebench.stopMilliseconds !== null"
    stranger.wait(lambda: stranger.driver.execute_script(answered), "a stop that is answered")
    time.sleep(2 * REFRESH_S)
    assert person.text.count("somebody not signed in") == strangers  # what is aimed at stays
    point(person, acknowledge, "mouseReleased")
    person.sees("The page changed while “Acknowledge as Admin” was pressed: nothing was done.")
    person.wait(lambda: person.text.count("somebody not signed in") > strangers, "the second alarm")
    person.press("Acknowledge as Admin")
    person.sees("No active alarms")


def test_a_button_that_needs_the_server_says_when_it_is_not_ready(person: Visitor) -> None:
    driver, menu = person.driver, "[aria-label='Menu']"
    look = "return getComputedStyle(document.querySelector(arguments[0])).borderTopStyle"
    added = driver.execute_cdp_cmd(
        "Page.addScriptToEvaluateOnNewDocument",
        {
            "source": "const Real = WebSocket; window.blocked = true;"
            "window.WebSocket = function (...given) { return window.blocked ?"
            " { readyState: 0, send() {}, close() {} } : new Real(...given); };"
        },
    )
    try:
        driver.get(person.panel.url + "/alarms")
        person.wait(lambda: driver.execute_script(look, menu) == "dashed", "a button that waits")
        point(person, menu, "mousePressed", "mouseReleased")
        person.sees("Not connected yet: nothing was done.")
    finally:
        driver.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", added)
    driver.execute_script("window.blocked = false; socket.disconnect(); socket.connect();")
    person.wait(lambda: driver.execute_script(look, menu) == "solid", "a button that is ready")
    assert "Not connected yet" not in person.text
    assert not driver.find_elements(By.CLASS_NAME, "sheet")
    point(person, menu, "mousePressed", "mouseReleased")
    person.sees("F8: stop the bench")


@pytest.mark.nightly
def test_notices_are_switched_on_and_tell_of_an_alarm(person: Visitor) -> None:
    driver = person.driver
    granted = {"permissions": ["notifications"], "origin": person.panel.url}
    driver.execute_cdp_cmd("Browser.grantPermissions", granted)
    person.open("/alarms")
    body = driver.find_element(By.TAG_NAME, "body")
    body.send_keys("?")
    person.sees("F8: stop the bench")
    person.sees("?: this menu")
    person.press("On")
    pressed = "return document.querySelector('[data-notices=on]')?.ariaPressed"
    person.wait(lambda: driver.execute_script(pressed) == "true", "notices that are on")
    person.press("Close")
    body.send_keys(Keys.F8)
    told = "return window.torquebench.noticed"
    person.wait(lambda: len(driver.execute_script(told)) == 1, "one notice")
    assert "stop" in driver.execute_script(told)[0].lower()
    assert driver.execute_script("return Notification.permission") == "granted"
    person.press("Acknowledge")
    driver.execute_script("localStorage.setItem('torquebench-notices', 'off')")
    body.send_keys(Keys.F8)
    person.sees("Acknowledge")
    assert len(driver.execute_script(told)) == 1
    person.press("Acknowledge")


def test_two_people_one_commands_and_the_other_watches(person: Visitor, stranger: Visitor) -> None:
    person.open("/calibrate")
    person.press("Take command")
    person.sees("You are in command")
    ben = stranger
    ben.sign_in("Ben", "/calibrate")
    ben.sees("In command: Admin")
    ben.press("Start calibration")
    ben.sees("Admin is in command of the bench")
    person.press("Give up command")
    ben.sees("Nobody is in command")
    ben.press("Take command")
    ben.sees("You are in command")
    person.sees("In command: Ben")
    ben.press("Give up command")
    ben.sees("Nobody is in command")


@pytest.mark.nightly
def test_a_deactivated_person_is_sent_away_and_a_page_number_alone_opens_nothing(
    panel: Panel, person: Visitor, stranger: Visitor
) -> None:
    stranger.sign_in("Ben", "/")
    query = "return new URLSearchParams(socket.io.opts.query).toString()"
    address = f"ws{panel.url.removeprefix('http')}/_nicegui_ws/socket.io/?EIO=4&transport=websocket"
    with pytest.raises(InvalidStatus):
        connect(f"{address}&{stranger.driver.execute_script(query)}", open_timeout=PATIENCE_S)
    with httpx.Client(base_url=f"{panel.url}/api/v1", timeout=PATIENCE_S) as admin:
        given = {"name": "Admin", "password": PEOPLE["Admin"][1]}
        token = admin.post("/session", json=given).json()["token"]
        admin.headers["Authorization"] = f"Bearer {token}"
        admin.patch("/users/Ben", json={"active": False}).raise_for_status()
        try:
            stranger.wait(lambda: "/sign-in" in stranger.driver.current_url, "being sent away")
        finally:
            admin.patch("/users/Ben", json={"active": True}).raise_for_status()


def test_a_lost_server_is_unmistakable_and_the_page_comes_back(
    panel: Panel, person: Visitor
) -> None:
    person.open("/")
    before = painted(person)
    person.wait(lambda: painted(person) > before + 5, "live values")
    felt = person.driver.execute_script(
        "window.torquebench.done = () => {};"  # the answer is lost with the server
        "const menu = document.querySelector('[aria-label=Menu]');"
        "menu.click(); return menu.ariaBusy;"
    )
    assert felt == "true"
    panel.end(signal.SIGKILL)
    person.sees("The connection broke while “Menu” was pressed.")
    popup = person.driver.find_element(By.ID, "popup")
    person.wait(lambda: popup.is_displayed(), "the notice of a lost connection")
    person.wait(
        lambda: person.driver.find_elements(By.CSS_SELECTOR, ".stale .tile"), "old values in grey"
    )
    person.driver.find_element(By.CSS_SELECTOR, "[data-stop]").click()
    person.sees("Use the red emergency stop")
    panel.start()
    person.wait(
        lambda: (
            not person.driver.find_elements(By.CSS_SELECTOR, ".stale .tile") and painted(person) > 5
        ),
        "live values again",
    )
    person.connected()
    assert not person.driver.find_element(By.ID, "popup").is_displayed()


@pytest.mark.nightly
def test_what_was_typed_outlasts_a_lost_connection(person: Visitor) -> None:
    person.open("/calibrate")
    person.fill("Maximum torque", "60")
    person.sees("60 of 2400 N·m")
    person.driver.execute_script(
        "window.same = true; socket.on('disconnect', () => { window.lost = true; });"
    )
    with asleep(person):
        time.sleep(12.0)  # the server has missed it by then
    person.wait(lambda: person.driver.execute_script("return window.lost"), "a lost connection")
    person.connected()
    assert person.field("Maximum torque").get_attribute("value") == "60"
    person.fill("Maximum torque", "61")
    person.sees("61 of 2400 N·m")
    assert person.driver.execute_script("return window.same") is True  # it wasn't loaded anew


@contextlib.contextmanager
def asleep(person: Visitor) -> Iterator[None]:
    """Stop all processes of a browser for a while, as a closed laptop does."""
    driver = psutil.Process(person.driver.service.process.pid)
    processes = driver.children(recursive=True)
    for each in processes:
        each.suspend()
    try:
        yield
    finally:
        for each in processes:
            each.resume()


@pytest.mark.nightly
def test_memory_of_the_page_stays_flat(person: Visitor) -> None:
    def heap() -> float:
        person.driver.execute_cdp_cmd("HeapProfiler.collectGarbage", {})
        return float(person.driver.execute_cdp_cmd("Runtime.getHeapUsage", {})["usedSize"])

    person.open("/")
    person.wait(lambda: painted(person) > 60, "a warm page")
    before, first = heap(), painted(person)
    person.wait(lambda: painted(person) > first + 100, "a hundred updates more")
    person.wait(lambda: heap() < before + 2e6, "memory that is given back")
