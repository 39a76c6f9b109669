"""Two people calibrate the output module in their browsers, from start to certificate."""

import re
import sqlite3
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any

import pytest
from selenium.webdriver.support.select import Select
from tests.support.draws import nightly
from tests.system.panel_browser import PEOPLE, SLOW, Visitor, browser, running_panel

from torquebench.records import Registry, RunFolder

pytestmark = SLOW


@pytest.fixture
def visitors(tmp_path: Path) -> Iterator[tuple[Visitor, Visitor]]:
    with (
        running_panel(tmp_path, "--fast") as panel,
        browser(panel, tmp_path / "ben") as ben,
        browser(panel, tmp_path / "ana") as ana,
    ):
        yield ben, ana
        assert "Traceback" not in panel.said, panel.said


@pytest.fixture
def downloads(visitors: tuple[Visitor, Visitor], tmp_path: Path) -> Path:
    folder = {"behavior": "allow", "downloadPath": str(tmp_path)}
    visitors[0].driver.execute_cdp_cmd("Browser.setDownloadBehavior", folder)
    return tmp_path


CHARTS = """
return [...document.querySelectorAll('.chart')]
  .map((each) => window.getElement(Number(each.id.slice(1)))?.chart?.getOption())
  .filter(Boolean)
  .map(({xAxis: [x], yAxis: [y], legend: [legend], series}) => ({
    kind: x.type, x: x.name, y: y.name, legend: legend.show,
    names: series.map((each) => each.name), points: series.map((each) => each.data.length)}))
"""


def charts(visitor: Visitor) -> list[dict[str, Any]]:
    """Return what the page's charts show."""
    return list(visitor.driver.execute_script(CHARTS))


@pytest.mark.parametrize("whole", [False, nightly(True)])
def test_one_measures_and_verifies_and_the_other_signs_and_certifies(
    visitors: tuple[Visitor, Visitor], whole: bool
) -> None:
    ben, ana = visitors
    ben.sign_in("Ben", "/calibrate")
    if whole:
        add_a_profile(ana)
        ben.choose("Profile", "small-torques")
        ben.fill("Maximum torque", "60")
        ben.sees("60 of 2400 N·m")
        ben.open("/calibrate")
    ben.choose("Profile", "own-rapid" if whole else "rapid-in-situ")
    measure_and_verify(ben, ana)
    sign_and_certify(ben, ana)
    if whole:
        look_at_the_records(ben, ana)
    ana.open("/alarms")  # a live page paints all the time, and the next test has use for the time
    assert ana.problems() == ben.problems() == []


def add_a_profile(ana: Visitor) -> None:
    ana.sign_in("Ana", "/calibrate")
    ana.press("Upload or edit own profiles")
    ana.sees("Add one from a TOML file")
    shipped = resources.files("torquebench.calibration") / "profiles" / "rapid-in-situ.toml"
    ana.driver.find_element("css selector", "input[type=file]").send_keys(str(shipped))
    ana.sees("Kept under the name")
    ana.fill("Kept under the name", "own-rapid")
    ana.fill("Title", "Rapid, as we do it")
    ana.sees("What would change")
    ana.press("Apply these changes")
    ana.sees("Changed and logged.")


def measure_and_verify(ben: Visitor, ana: Visitor) -> None:
    ben.fill("Step size", "20")
    ben.sees("2000 of 2400 N·m")
    ben.press("Start calibration")
    ben.wait(lambda: ben.driver.current_url.endswith("/calibrations/1"), "the address")
    ben.sees("Before and after")
    assert "fresh points verify a model" in ben.text
    ben.wait(lambda: [each["points"][:2] for each in charts(ben)[:2]] == [[20], [20, 20]], "errors")

    ana.sign_in("Ana", "/calibrate")
    ana.sees("In command: Ben")
    ana.press("Start calibration")
    ana.sees("Ben is in command of the bench")
    assert ana.axe() == []  # with the message
    ana.driver.find_element("css selector", ".messages button").click()
    ana.press("Open")
    ana.sees("Before and after")
    assert ana.driver.current_url.endswith("/calibrations/1")

    assert ben.button("Next step").rect["y"] < 600.0  # above the fold
    ben.press("Next step")
    ben.fill("Groups", "2")
    ben.press("Mounting", within="//main")
    ben.fill("Coaxiality found", "0.012")
    ben.press("Start verification")
    ben.sees("Verify again")
    with Registry.open(ben.panel.folder / "data") as registry:
        verification = next(run for run in registry.runs() if run.kind == "verify-output")
        kept = RunFolder.open(verification.folder).metadata
    assert kept["mounting_record"] == {"coaxiality_mm": 0.012}
    ben.press("Next step")
    ben.sees("Sign off and put into use")
    assert "may view this but not change it" in ben.text
    ben.driver.back()
    ben.sees("Verify again")


def sign_and_certify(ben: Visitor, ana: Visitor) -> None:
    ana.driver.delete_all_cookies()
    ana.sign_in("Ana", "/calibrations/1")  # the address outlives signing in
    ana.sees("Model to be used")
    assert "Ben" in ana.text  # who measured what is signed
    ana.sees("Verdict at fresh points, tolerance 0.1 % FS")
    ana.press("Preview the certificate")
    pages = (
        "return [...document.querySelectorAll('.certificate-pages img')].map(e => e.naturalWidth)"
    )
    ana.wait(lambda: len(ana.driver.execute_script(pages)) >= 2, "the certificate's pages")
    assert min(ana.driver.execute_script(pages)) > 600
    assert not list((ana.panel.folder / "data" / "certificates").glob("*"))
    ana.fill("Your password", PEOPLE["Ana"][1])
    ana.press("Sign and put into use")
    ana.sees("Ben is in command of the bench")
    ben.press("Give up command")
    ben.sees("Nobody is in command")
    ana.fill("Your password", "a wrong password")
    ana.press("Sign and put into use")
    ana.sees("don't belong together")
    ana.fill("Your password", PEOPLE["Ana"][1])
    with sqlite3.connect(ana.panel.folder / "data" / "registry.sqlite") as held:
        held.execute("BEGIN IMMEDIATE")  # signing waits for it; nobody else does
        button = ana.button("Sign and put into use")
        ana.press("Sign and put into use")
        ben.open("/alarms")
        ben.sees("No active alarms")
        assert button.get_attribute("aria-busy") == "true"
        held.rollback()
    ana.sees("Signed.")
    assert "broke" not in ana.text

    ana.fill("Your password", PEOPLE["Ana"][1])
    ana.press("Issue the certificate")
    ana.sees("is issued")
    assert ana.button("Download").text.endswith((".pdf", ".xml", ".json"))


def look_at_the_records(ben: Visitor, ana: Visitor) -> None:
    ana.open("/calibrations/1?step=models")
    ana.press("Fit another model")
    ana.choose("Model", "published-network")
    ana.fill("Parameters", "epochs=40")
    ana.press("Fit it to the rising points alone")
    ana.press("Fit this model")
    ana.sees("network, gradient descent")
    ana.press("Additional torque")
    ana.sees("40 epochs; RMS of the residuals")

    ana.open("/")
    ana.sees("Compensated:")
    ana.sees("(k = 2)")
    switch_a_correction(ben, ana)
    ana.press("Give up command")
    ana.sees("Nobody is in command")

    ana.open("/records")
    ana.sees("1 to ")
    ana.press("Open")  # the verification, which is the newest
    ana.wait(lambda: len(charts(ana)) == 3, "charts of samples, zeros and points")
    samples, _, points = charts(ana)
    assert (samples["y"], samples["legend"]) == ("Output, frequency of the transducer, Hz", False)
    assert (points["x"], points["y"], points["legend"]) == (
        "Torque of the standard, N·m",
        "Error, N·m",
        False,
    )
    assert re.search(r"… 12 of \d+ rows; the export has all\.", ana.text)
    ana.open("/records?part=calibrations")
    ana.sees("in use: ")
    ana.size(800, 1000)
    ana.press("Compare")
    compared = ["No. 1, Raw", "No. 1, Compensated"]
    ana.wait(lambda: [each["names"] for each in charts(ana)] == [compared], "errors compared")
    runs = Select(ana.field("Overlay the points of a run"))
    verification = str(runs.options[1].get_attribute("value"))  # the newest of them
    ana.choose("Overlay the points of a run", verification)
    overlaid = [*compared, verification]
    ana.wait(lambda: [each["names"] for each in charts(ana)] == [overlaid], "a run's points, too")
    ana.open(f"/records?part=calibrations&with=1,{verification}")
    ana.wait(lambda: [each["names"] for each in charts(ana)] == [overlaid], "both at an address")
    wide = (
        "return [...document.querySelectorAll('.scroll')]"
        ".filter((each) => each.scrollWidth > each.clientWidth + 1).length"
    )
    assert ana.driver.execute_script(wide) == 0  # no column is out of sight
    ana.press("Certificates")
    for role in ("Checked", "Authorised"):
        ana.sees(f"{role} by Ana: signed with the password of the account Ana")
    ana.press("Drift")
    ana.wait(lambda: {each["kind"] for each in charts(ana)} == {"time"}, "drift over time")
    ana.size(1440, 900)


def switch_a_correction(ben: Visitor, ana: Visitor) -> None:
    """Switch a correction off and on where its effect is shown, by the calibration just made."""
    ana.open("/")
    ana.press("Effects on the output torque")
    row = "table.compact tr[data-effect='hysteresis']"
    ana.wait(lambda: "Within its range" in ana.driver.find_element("css selector", row).text, row)
    ana.press("Switch off", within="//tr[@data-effect='hysteresis']")
    ana.wait(lambda: "Switched off" in ana.driver.find_element("css selector", row).text, row)
    reference = "table.compact tr[data-effect='reference standard'] td"
    added, u, *_ = ana.driver.find_elements("css selector", reference)
    assert added.text == "–"
    assert float(u.text) >= 0.0
    ana.open("/")
    ana.press("Effects on the output torque")
    ana.wait(lambda: "Switched off" in ana.driver.find_element("css selector", row).text, row)
    assert ana.axe() == []
    ana.press("Switch on", within="//tr[@data-effect='hysteresis']")
    ana.wait(lambda: "Within its range" in ana.driver.find_element("css selector", row).text, row)
    ben.open("/")
    ben.press("Effects on the output torque")
    ben.sees("Within its range")
    assert not ben.driver.find_elements("css selector", "table.compact button")


@pytest.mark.nightly
def test_a_specimen_is_tested_for_hysteresis_and_compared(
    visitors: tuple[Visitor, Visitor],
    downloads: Path,
) -> None:
    ben, ana = visitors
    ana.sign_in("Ana", "/settings")
    ana.press("Reducers")
    ana.sees("Add one from a TOML file")
    shipped = resources.files("torquebench.reducers") / "types" / "rv-40e.toml"
    ana.driver.find_element("css selector", "input[type=file]").send_keys(str(shipped))
    ana.sees("Kept under the name")
    ana.fill("Kept under the name", "own-40e")
    ana.fill("Name", "Own 40E")
    ana.sees("What would change")
    ana.press("Apply these changes")
    ana.sees("Changed and logged.")
    ana.sees("own-40e")

    ben.sign_in("Ben", "/reducer")
    ben.choose("Reducer", "own-40e")
    ben.fill("Serial", "S-1")
    ben.press("Short test: few points")
    ben.sees("Dry run")
    ben.sees("Duration")
    ben.press("Start test")
    ben.sees("Data sheet")
    for quantity in ("backlash", "lost motion", "stiffness"):
        assert quantity in ben.text.lower()
    ben.sees("Own 40E, Specimen S-1")
    ben.sees("Key points")
    assert "θ↑" in ben.text
    ben.press("Report (PDF)")
    ben.wait(lambda: list(downloads.glob("*.pdf")), "a downloaded report")
    (report,) = downloads.glob("*.pdf")
    assert report.read_bytes().startswith(b"%PDF")
    ben.sees("Compared with earlier specimens")
    ben.press("Check the bench with a standard reducer")
    ben.press("Start measurement")
    ben.sees("Mean over rising and falling speed of each repeat")
    ben.sees("repeatability")
    ben.press("Give up command")
    assert ben.problems() == []
