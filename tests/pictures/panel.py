"""Screenshots of the panel on the simulated bench, light and dark."""

import re
import subprocess
import time
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path

from PIL import Image
from selenium.webdriver.common.by import By
from tests.system.command_line import COMMAND, environment
from tests.system.panel_browser import PEOPLE, Visitor, browser, running_panel

SIZE = (1440, 900)
LIVE_TORQUE = 1000.0


def make(images: Path, scratch: Path) -> Iterator[Path]:
    """Work through a calibration and a reducer test, and photograph what pages show."""
    folder = images / "panel"
    with (
        running_panel(scratch, "--fast") as panel,
        browser(panel, scratch / "ben", width=SIZE[0], height=SIZE[1]) as ben,
    ):
        ben.sign_in("Ben", "/calibrate")
        ben.sees("2000 of 2400 N·m")
        yield from photographed(ben, folder / "calibrate-prepare.png")
        ben.fill("Step size", "20")  # the page was loaded again
        ben.sees("2000 of 2400 N·m")
        ben.press("Start calibration")
        ben.sees("Before and after")
        ben.press("Compare all models")
        ben.sees("Least error at points left out:")
        yield from photographed(ben, folder / "calibrate-models.png", "Before and after")
        ben.press("Next step")
        ben.press("Start verification")
        ben.sees("Verify again")
        ben.press("Give up command")
        ben.sees("Nobody is in command")
        with browser(panel, scratch / "ana", width=SIZE[0], height=SIZE[1]) as ana:
            ana.sign_in("Ana", "/calibrations/1")
            ana.sees("Model to be used")
            ana.fill("Your password", PEOPLE["Ana"][1])
            ana.press("Sign and put into use")
            ana.sees("Signed.")
            ana.press("Give up command")
        ben.open("/reducer")
        ben.choose("Reducer", "standard")
        ben.fill("Serial", "S-1")
        ben.press("Short test: few points", within="//main")
        ben.sees("Dry run")
        ben.press("Start test")
        ben.sees("Data sheet")
        yield from photographed(ben, folder / "reducer-result.png", "Data sheet")
        ben.open("/records")
        yield from photographed(ben, folder / "records.png")
        panel.end()
    yield from live(folder, scratch / "live")


def live(folder: Path, scratch: Path) -> Iterator[Path]:
    """Photograph the live page under load, the alarms after a stop, and the settings."""
    scratch.mkdir()
    command = [COMMAND, "calibrate", "output", "--step", "10", "--data", "data"]
    subprocess.run(command, cwd=scratch, env=environment(), check=True, capture_output=True)
    with (
        running_panel(scratch) as panel,
        browser(panel, scratch / "ana", width=SIZE[0], height=SIZE[1]) as ana,
    ):
        ana.sign_in("Ana", "/calibrate")
        ana.sees("Dry run")
        ana.press("Start calibration")
        ana.open("/")
        ana.wait(lambda: largest_torque(ana) > LIVE_TORQUE, "a loaded module")
        yield from photographed(ana, folder / "live.png")
        ana.driver.find_element(By.CSS_SELECTOR, "[data-stop]").click()
        ana.sees("The bench is stopped")
        ana.open("/alarms")
        ana.sees("Stopped by a person")
        yield from photographed(ana, folder / "alarms.png", "Stopped by a person")
        ana.open("/settings")
        yield from photographed(ana, folder / "settings.png")


def largest_torque(visitor: Visitor) -> float:
    """Return the largest torque that the live page says, N·m."""
    said = re.findall(r"([−-]?\d+\.\d+)\s*N·m", visitor.text)
    return max((abs(float(each.replace("−", "-"))) for each in said), default=0.0)


def photographed(visitor: Visitor, light: Path, text: str = "") -> Iterator[Path]:
    """Keep what a page shows, in both looks; the page is loaded again for the second one."""
    light.parent.mkdir(parents=True, exist_ok=True)
    for look, path in (("light", light), ("dark", light.with_stem(f"{light.stem}-dark"))):
        visitor.driver.add_cookie({"name": "torquebench_look", "value": look})
        visitor.driver.refresh()
        visitor.connected()
        if text:
            visitor.sees(text, 60.0)
        time.sleep(1.5)  # charts are painted, and a result has been scrolled to
        visitor.driver.execute_script("window.scrollTo({top: 0, behavior: 'instant'})")
        picture = Image.open(BytesIO(visitor.driver.get_screenshot_as_png())).convert("RGB")
        picture.quantize(256).save(path, optimize=True)  # a third of the size
        yield path
