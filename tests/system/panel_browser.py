"""A panel's server and a browser in front of it, as a person has them."""

import contextlib
import re
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from selenium import webdriver
from selenium.common.exceptions import (
    NoSuchElementException,
    StaleElementReferenceException,
    TimeoutException,
)
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.ui import Select, WebDriverWait
from tests.programs import program
from tests.system.command_line import COMMAND, environment, prepared, wait_until
from tests.system.panel_api import SLOW
from tests.system.prepared_commands import RunningCommand

HARMLESS = "ERR_", "Failed to fetch", "WebSocket", "transport=polling", "reading 'dispose'"
"""In messages of the browser's console about lost connections, and about charts of NiceGUI that are
removed before they have drawn anything: its clean-up misses what drawing would have made."""
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
PEOPLE = {
    "Admin": ("administrator", "a correct horse 2026"),
    "Ana": ("metrologist", "ana measures torque"),
    "Ben": ("operator", "ben turns the shaft"),
}
PATIENCE_S = 300.0
"""On a slow machine everything comes in the end; where it comes at once, patience costs nothing."""
ENGLISH = re.compile(r"[a-z]{3,} [a-z]{2,}")
"""Two words beside each other: names of pictures and columns are single ones."""
TEXT = r"return document.body?.innerText.replace(/[\t\u00a0]/g, ' ') ?? ''"
"""As cheap as the browser has it: WebDriver's own way to read a page walks through every element,
and asked each 0.2 s it took half a processor."""
STILL = """
const [button, done] = arguments;
button.scrollIntoView({block: 'center'});
const place = () => JSON.stringify(button.getBoundingClientRect());
const before = place();
requestAnimationFrame(() => requestAnimationFrame(() => {
  const {x, y, width, height} = button.getBoundingClientRect();
  const above = document.elementFromPoint(x + width / 2, y + height / 2);
  const ready = !button.matches('.unready [data-press]') && button.ariaBusy !== 'true';
  done(ready && place() === before && button.contains(above));
}));
"""


def people(data: Path) -> None:
    """Make the accounts that the tests sign in with."""
    from torquebench.panel.service import Actor
    from torquebench.panel.service.access.people import People
    from torquebench.panel.service.store import PanelStore

    data.mkdir(parents=True, exist_ok=True)
    store = PanelStore(data)
    accounts = People(store)
    try:
        assert accounts.setup_code is not None
        accounts.set_up(accounts.setup_code, "Admin", PEOPLE["Admin"][1], "test")
        administrator = Actor("Admin", "administrator", "test")
        for name, (role, password) in PEOPLE.items():
            if name != "Admin":
                accounts.add_user(administrator, name, role, password)
    finally:
        accounts.close()
        store.close()


class Panel:
    """The `torquebench panel` command on a free port, which may be ended and started again."""

    def __init__(self, folder: Path, *options: str) -> None:
        self.folder, self.options = folder, options
        self.port = 0
        self._log = folder / "panel.log"
        self.process: RunningCommand | None = None

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    @property
    def said(self) -> str:
        """What the server has said since it was started last."""
        return self._log.read_text()

    def start(self) -> None:
        """Start the server, on the port that it had before."""
        with self._log.open("wb") as file:  # a pipe that nobody reads would hold it up one day
            command = [COMMAND, "panel", "--data", "data", "--port", str(self.port), *self.options]
            self.process = prepared().start(command, self.folder, environment(), file)

        def served() -> bool:
            found = re.search(r"http://\S+:(\d+)", self.said)
            assert found or self.process is None or self.process.poll() is None, self.said
            self.port = int(found[1]) if found else self.port
            return found is not None

        wait_until(served, "a panel that serves")

    def end(self, how: signal.Signals = signal.SIGTERM) -> None:
        """End the server."""
        if self.process is not None:
            self.process.send_signal(how)
            self.process.wait(timeout=PATIENCE_S)
            self.process = None


@contextlib.contextmanager
def running_panel(folder: Path, *options: str) -> Iterator[Panel]:
    """Serve a panel with accounts; it is gone when the block ends."""
    people(folder / "data")
    panel = Panel(folder, *options)
    panel.start()
    try:
        yield panel
    finally:
        panel.end()


class Visitor:
    """A person with a browser."""

    def __init__(self, driver: webdriver.Chrome, panel: Panel) -> None:
        self.driver, self.panel = driver, panel

    def english(self, *names: str) -> list[str]:
        """Return the lines of the page that hold an English sentence, some names aside."""
        lines = [line for line in self.text.splitlines() if line not in names]
        return [line for line in lines if ENGLISH.search(line)]

    def wait(self, condition: Callable[[], Any], what: str, seconds: float = PATIENCE_S) -> Any:
        """Wait until something is so."""
        passing = (NoSuchElementException, StaleElementReferenceException)
        waiting = WebDriverWait(self.driver, seconds, 0.2, ignored_exceptions=passing)
        try:
            return waiting.until(lambda _: condition(), what)
        except TimeoutException:
            said = (
                f"{self.driver.current_url}: {self.text[-2000:]}\n{self.driver.get_log('browser')}"
            )
            raise AssertionError(f"no {what}; {said}\n{self.panel.said[-4000:]}") from None

    def open(self, path: str) -> None:
        """Open a page and wait until it is connected."""
        self.driver.get(self.panel.url + path)
        self.connected()

    def connected(self) -> None:
        """Wait until the page's connection to the server stands and it shows something."""
        self.wait(
            lambda: self.driver.execute_script(
                "const plain = !!document.querySelector('body.plain');"
                "return (plain || window.did_handshake === true)"
                " && !!document.querySelector('h1')"
                " && document.styleSheets.length > (plain ? 0 : 1)"
            ),
            "a connected page",
        )

    def sign_in(self, name: str, path: str = "/") -> None:
        """Sign in and arrive at a page."""
        self.open(f"/sign-in?next={path}")
        self.driver.find_element(By.NAME, "name").send_keys(name)
        self.driver.find_element(By.NAME, "password").send_keys(PEOPLE[name][1])
        self.driver.find_element(By.CSS_SELECTOR, "form button[type=submit]").click()
        self.wait(lambda: "/sign-in" not in self.driver.current_url, "being signed in")
        self.connected()

    @property
    def text(self) -> str:
        """What the page says."""
        text: str = self.driver.execute_script(TEXT)
        return text

    def sees(self, text: str, seconds: float = PATIENCE_S) -> None:
        """Wait until the page says something."""
        self.wait(lambda: text in self.text, f"the page to say {text!r}", seconds)

    def button(self, label: str, within: str = "") -> WebElement:
        """Find a button or link by what it says, inside of an element if its XPath is given."""
        xpath = "|".join(
            f"{within}//{tag}[not(@disabled)][contains(normalize-space(.), '{label}')]"
            for tag in ("button", "a", "summary", "label")
        )

        def shown() -> WebElement | None:
            found = self.driver.find_elements(By.XPATH, xpath)
            return next((each for each in found if each.is_displayed()), None)

        found: WebElement = self.wait(shown, f"a button {label!r}")
        return found

    def press(self, label: str, within: str = "") -> None:
        """Press a button that stands still and says that it is ready, as people do."""

        def press() -> bool:
            button = self.button(label, within)
            if not self.driver.execute_async_script(STILL, button):
                return False
            button.click()
            return True

        self.wait(press, f"pressing {label!r}")

    def fill(self, label: str, value: str) -> None:
        """Type into a field."""

        def typed() -> bool:
            self.field(label).clear()
            self.field(label).send_keys(value)
            return True

        self.wait(typed, f"typing into {label!r}")

    def field(self, label: str) -> WebElement:
        """Find a field by its label."""
        xpath = f"//label[normalize-space(.)='{label}']"

        def labelled() -> list[WebElement]:
            found = self.driver.find_elements(By.XPATH, xpath)
            return [each for each in found if each.is_displayed()]

        name: WebElement = self.wait(labelled, f"a field {label!r}")[0]
        return self.driver.find_element(By.ID, str(name.get_attribute("for")))

    def choose(self, label: str, value: str) -> None:
        """Choose from a list."""

        def chosen() -> bool:
            Select(self.field(label)).select_by_value(value)
            return True

        self.wait(chosen, f"choosing {label!r}")

    def size(self, width: int, height: int) -> None:
        """Use a screen of another size."""
        self.driver.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride",
            {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 760},
        )

    def problems(self) -> list[str]:
        """Return what the browser's console says is wrong."""
        return [
            entry["message"]
            for entry in self.driver.get_log("browser")
            if entry["level"] == "SEVERE" and not any(each in entry["message"] for each in HARMLESS)
        ]

    def axe(self) -> list[str]:
        """Return what the accessibility check objects to."""
        from axe_selenium_python import Axe

        axe = Axe(self.driver)
        axe.inject()
        found = axe.run()["violations"]
        return [
            f"{each['id']}: {node['html'][:200]}" for each in found for node in each["nodes"][:3]
        ]


@contextlib.contextmanager
def browser(
    panel: Panel, folder: Path, *, width: int = 1440, height: int = 900, language: str = "en-US"
) -> Iterator[Visitor]:
    """Start a browser with a fresh profile."""
    options = Options()
    options.binary_location = str(program("chromium"))
    for flag in FLAGS:
        options.add_argument(flag)
    options.add_argument(f"--user-data-dir={folder / 'profile'}")
    options.add_argument(f"--window-size={width},{height}")
    options.add_argument(f"--lang={language}")
    options.add_experimental_option("prefs", {"intl.accept_languages": language})
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(str(program("chromedriver"))))
    driver.set_script_timeout(100.0)  # before the driver itself gives its answer up
    try:
        visitor = Visitor(driver, panel)
        visitor.size(width, height)
        yield visitor
    finally:
        driver.quit()


__all__ = ["PEOPLE", "SLOW", "Panel", "Visitor", "browser", "running_panel"]
