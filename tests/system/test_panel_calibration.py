"""Two people calibrate the output module in their browsers, from start to certificate."""

import re
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any

import pytest
from tests.system.panel_browser import PEOPLE, SLOW, Visitor, browser, running_panel

from torquebench.records import Registry, RunFolder

pytestmark = SLOW


@pytest.fixture(scope="module")
def visitors(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Visitor, Visitor]]:
    folder: Path = tmp_path_factory.mktemp("panel")
    with (
        running_panel(folder, "--fast") as panel,
        browser(panel, folder / "ben") as ben,
        browser(panel, folder / "ana") as ana,
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


def test_one_measures_and_verifies_and_the_other_signs_and_certifies(
    visitors: tuple[Visitor, Visitor],
) -> None:
    ben, ana = visitors
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

    ben.sign_in("Ben", "/calibrate")
    ben.choose("Profile", "small-torques")
    ben.fill("Largest torque", "60")
    ben.sees("60 N·m; the limit is 2400 N·m")
    ben.open("/calibrate")
    ben.choose("Profile", "own-rapid")
    ben.choose("Step of the staircase, % of range", "20")
    ben.sees("What would happen")
    assert "the limit is 2400 N·m" in ben.text

    ben.press("Mount the calibrator and begin")
    ben.sees("Before and after")
    assert "20 points; the raw reading is wrong by up to" in ben.text

    ana.sign_in("Ana", "/calibrate")
    ana.sees("In command: Ben")
    ana.sees("Before and after")
    ana.press("Begin another calibration")  # the wizard is everybody's: who commands decides
    ana.sees("Ben is in command of the bench")
    assert ana.axe() == []  # with the message
    ana.driver.find_element("css selector", ".messages button").click()
    assert "Before and after" in ana.text
    assert "Before and after" in ben.text

    ben.press("Back")
    ben.sees("Error of the raw reading")
    ben.sees("Zeros and preloads are steps without a point.")
    ben.wait(lambda: charts(ben)[0]["points"] == [20], "a staircase of the points alone")
    ben.press("Back")
    ben.sees("Mount the calibrator and begin")
    assert ben.field("Profile").get_attribute("value") == "own-rapid"
    ben.driver.back()
    ben.sees("Error of the raw reading")
    ben.driver.back()
    ben.sees("Shown models")
    raw, left = (spread(ben, place) for place in (0, 1))
    assert left["axis"] < 0.4 * raw["axis"]  # scaled to what the models leave
    assert left["colours"] == raw["colours"][1:]
    ben.press("polynomial, degree 2")
    ben.wait(lambda: len(spread(ben, 1)["colours"]) == 1, "one model's residuals")

    ben.press("Compare all models")
    ben.sees("Least error at points left out:")
    ben.press("Next step")
    ben.choose("Groups", "2")
    ben.press("Record of the mounting")
    ben.fill("Coaxiality found", "0.012")
    ben.press("Mount the verification standard and begin")
    ben.sees("Sign off and put into use")
    with Registry.open(ben.panel.folder / "data") as registry:
        verification = next(run for run in registry.runs() if run.kind == "verify-output")
        kept = RunFolder.open(verification.folder).metadata
    assert kept["mounting_record"] == {"coaxiality_mm": 0.012}
    assert "may view this but not change it" in ben.text

    ana.sees("Model to be used")
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
    ana.press("Sign and put into use")
    ana.sees("Signed.")

    ana.fill("Your password", PEOPLE["Ana"][1])
    ana.press("Issue the certificate")
    ana.sees("is issued")
    assert ana.button("Fetch").text.endswith((".pdf", ".xml", ".json"))

    for _ in range(3):
        ana.press("Back")
    ana.sees("Fit another model")
    ana.fill("Epochs", "40")
    ana.press("rising points only")
    ana.press("Fit this model")
    ana.sees("40 epochs, RMS of residuals")

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
    ana.press("Calibrations")
    ana.sees("in use: ")
    ana.size(800, 1000)
    ana.press("Compare")
    compared = ["No. 1, Raw", "No. 1, Compensated"]
    ana.wait(lambda: [each["names"] for each in charts(ana)] == [compared], "errors compared")
    wide = (
        "return [...document.querySelectorAll('.scroll')]"
        ".filter((each) => each.scrollWidth > each.clientWidth + 1).length"
    )
    assert ana.driver.execute_script(wide) == 0  # no column is out of sight
    ana.press("Drift")
    ana.wait(lambda: {each["kind"] for each in charts(ana)} == {"time"}, "drift over time")
    ana.size(1440, 900)
    ana.open("/alarms")  # a live page paints all the time, and the next test has use for the time
    assert ana.problems() == ben.problems() == []


def spread(visitor: Visitor, place: int) -> dict[str, Any]:
    """Return the height of a chart's axis and the colours of its lines."""
    script = """
    const place = document.querySelectorAll('.chart')[arguments[0]];
    const chart = getElement(Number(place.id.slice(1))).chart;
    const [low, high] = chart.getModel().getComponent('yAxis').axis.scale.getExtent();
    const colours = chart.getOption().series.map((each) => each.itemStyle.color);
    return { axis: high - low, colours };
    """
    found: dict[str, Any] = visitor.driver.execute_script(script, place)
    return found


def switch_a_correction(ben: Visitor, ana: Visitor) -> None:
    """Switch a correction off and on where its effect is shown, by the calibration just made."""
    ana.open("/")
    ana.sees("Effects on the output torque")
    row = "table.compact tr[data-effect='hysteresis']"
    ana.wait(lambda: "Within its range" in ana.driver.find_element("css selector", row).text, row)
    ana.press("Switch off", within="//tr[@data-effect='hysteresis']")
    ana.wait(lambda: "Switched off" in ana.driver.find_element("css selector", row).text, row)
    reference = "table.compact tr[data-effect='reference standard'] td"
    added, u, *_ = ana.driver.find_elements("css selector", reference)
    assert added.text == "–"
    assert float(u.text) >= 0.0
    ana.open("/")
    ana.wait(lambda: "Switched off" in ana.driver.find_element("css selector", row).text, row)
    assert ana.axe() == []
    ana.press("Switch on", within="//tr[@data-effect='hysteresis']")
    ana.wait(lambda: "Within its range" in ana.driver.find_element("css selector", row).text, row)
    ben.open("/")
    ben.sees("Effects on the output torque")
    assert not ben.driver.find_elements("css selector", "table.compact button")


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
    ben.fill("Serial number of the specimen", "S-1")
    ben.press("Quick look")
    ben.sees("What would happen")
    assert "Duration" in ben.text
    ben.press("Mount the reducer and begin")
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
    ben.choose("Repeats", "2")
    ben.press("Mount the standard reducer and begin")
    ben.sees("Certified and measured friction")
    ben.sees("Repeatability:")
    ben.press("Give up command")
    assert ben.problems() == []
