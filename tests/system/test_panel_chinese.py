"""Somebody who reads Chinese at the panel: no English sentence is left on the main pages."""

import re
from collections.abc import Iterator
from importlib import resources
from pathlib import Path

import pytest
from selenium.common.exceptions import (
    ElementClickInterceptedException,
    InvalidElementStateException,
)
from selenium.webdriver.common.by import By
from tests.system.panel_browser import SLOW, Visitor, browser, running_panel

from torquebench.bench.description import DEFAULT_BENCH
from torquebench.panel.text import Text

pytestmark = SLOW
CHINESE = Text("zh")
TABLE = Path(__file__).parents[2] / "examples" / "calibration-output.csv"


@pytest.fixture(scope="module")
def ana(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Visitor]:
    folder: Path = tmp_path_factory.mktemp("panel")
    description = (resources.files("torquebench.bench") / DEFAULT_BENCH).read_text("utf-8")
    (folder / "bench.toml").write_text(f"{description}\n[safety]\npresence_s = 3600\n", "utf-8")
    with (
        running_panel(folder, "--fast", "--bench", "bench.toml") as panel,
        browser(panel, folder / "ana", language="zh-CN") as visitor,
    ):
        visitor.sign_in("Ana")
        yield visitor


def all_chinese(ana: Visitor, *keys: str) -> None:
    """Wait for some texts of a page; then nothing on it may be English."""
    for key in keys:
        ana.sees(CHINESE(key))
    assert ana.english() == []


def confirm(ana: Visitor) -> None:
    """Press the last button of the dialog that is open, and wait until it has closed."""
    dialog = (By.CSS_SELECTOR, ".q-dialog .sheet button")

    def pressed() -> bool:
        shown = [each for each in ana.driver.find_elements(*dialog) if each.is_displayed()]
        try:
            shown[-1].click()
        except (IndexError, InvalidElementStateException, ElementClickInterceptedException):
            return False  # not there yet, or still moving
        return True

    ana.wait(pressed, "a dialog")
    ana.wait(lambda: not ana.driver.find_elements(*dialog), "the dialog's end")


def commands(person: Visitor) -> bool:
    """Take command unless a test before has left it with the person; say whether it is theirs."""
    if CHINESE("Give up command") in person.text:
        return True
    label = CHINESE("Take command")
    for found in person.driver.find_elements(By.XPATH, f"//button[contains(., '{label}')]"):
        if found.is_displayed():
            found.click()
            break
    return False


@pytest.mark.nightly
def test_an_interrupted_calibration_is_gone_on_with_by_whoever_is_at_the_bench(
    ana: Visitor,
) -> None:
    ana.open("/calibrate")
    all_chinese(ana, "Dry run", "Somebody is in command and has confirmed presence at the bench")
    ana.fill(CHINESE("Step size"), "10")
    ana.wait(lambda: commands(ana), "command of the bench")
    ana.sees(
        CHINESE(
            "The drives have power only while somebody is at the bench. Take command "
            "there and confirm."
        )
    )
    ana.press(CHINESE("I am at the bench"))
    ana.sees(
        CHINESE(
            "The drives have power only while somebody is at the bench. Confirmed for "
            "{seconds} s more.",
            seconds=3600,
        )[:20]
    )
    ana.press(CHINESE("Start calibration"))
    first = CHINESE(
        "Point {number}: reading {reading}, standard {standard}, error {error} N·m",
        number="#",
        reading="",
        standard="",
        error="",
    ).partition("#")[0]
    ana.sees(first)
    ana.press(CHINESE("Pause"))
    all_chinese(ana, "paused, no torque")
    ana.press(CHINESE("Abort"))
    confirm(ana)
    all_chinese(ana, "aborted", "A calibration was interrupted")
    ana.press(CHINESE("Go on with it"))
    confirm(ana)
    all_chinese(
        ana,
        "Before and after",
        "Every kind of model is fitted repeatedly with points left out, and its "
        "errors are computed at those points. This takes some minutes; the bench "
        "isn't moved.",
    )
    assert "40" in ana.text
    ana.press(CHINESE("Give up command"))
    assert ana.problems() == []


@pytest.mark.nightly
def test_a_table_from_elsewhere_is_looked_at_entered_and_taken_up(
    ana: Visitor, tmp_path: Path
) -> None:
    ana.open("/records")
    all_chinese(ana, "Runs")
    ana.driver.find_element(By.CSS_SELECTOR, ".tabs button:nth-child(2)").click()
    ana.press(CHINESE("Enter external calibration"))
    chosen = ana.wait(
        lambda: ana.driver.find_element(By.CSS_SELECTOR, "input[type=file]"), "a place for a file"
    )
    large, wrong = tmp_path / "large.csv", tmp_path / "wrong.csv"
    large.write_text("reading_nm,standard_nm\n" + "1,2\n" * 140_000)
    wrong.write_text("reading_nm,standard_nm\n1,2\n3,many\n")
    chosen.send_keys(str(large))
    ana.sees("524288")
    chosen.send_keys(str(wrong))
    ana.sees("wrong.csv")
    for title, value in (
        ("Resolution", "0.01"),
        ("Transducer, serial number", "4711"),
        ("Indicator", "DMP41"),
        ("Standard, serial number", "R-9"),
        ("Measured by", "Ana"),
    ):
        ana.fill(CHINESE(title), value)
    look = CHINESE("Check first")
    ana.press(look)
    ana.sees("'many'")
    assert ana.english("wrong.csv") == []
    stated = tmp_path / "stated.csv"
    stated.write_text(f"# reference_uncertainty = 0.02\n{TABLE.read_text('utf-8')}", "utf-8")
    chosen.send_keys(str(stated))
    ana.sees("stated.csv")
    ana.press(look)
    ana.sees(CHINESE("Static evaluation"))
    ana.sees(CHINESE("Clockwise"))
    assert ana.english() == []
    ana.press(CHINESE("Start"))
    ana.sees("calibration-")
    entered = re.search(r"calibration-(\d+)", ana.text)
    assert entered is not None
    ana.open(f"/calibrations/{entered[1]}")
    all_chinese(ana, "Before and after", "Compare all models")
    assert "100" in ana.text
    ana.press(CHINESE("Begin another calibration"))
    all_chinese(ana, "Dry run", "Somebody is in command and has confirmed presence at the bench")
    assert ana.problems() == []


@pytest.mark.nightly
def test_an_alarm_says_what_it_is_and_what_to_do(ana: Visitor) -> None:
    ana.open("/alarms")
    ana.driver.find_element(By.CSS_SELECTOR, "[data-stop]").click()
    all_chinese(
        ana,
        "Stopped by a person",
        "Ask why it was stopped. Acknowledge when the bench is safe to move.",
    )
    ana.press(CHINESE("Acknowledge as {who}", who="Ana"))
    all_chinese(ana, "No active alarms. The bench may move.", "Earlier alarms")
    for path, key in (("/", "Cursors"), ("/reducer", "Dry run"),
                      ("/settings", "Channels and limits")):  # fmt: skip
        ana.open(path)
        all_chinese(ana, key)
