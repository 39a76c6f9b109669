"""A person at the live chart: zoom, cursors, peaks, markers, channels, spectrum, files."""

import csv
import json
import re
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlencode, urlsplit

import pytest
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.support.select import Select
from tests.system.panel_browser import SLOW, Visitor, browser, running_panel

pytestmark = SLOW
CHART = "const chart = getElement(Number(document.querySelector('.trend-box').id.slice(1))).chart;"

OF_RUN = "const chart = getElement(Number(document.querySelector('.chart').id.slice(1)))?.chart;"
LAST_TIME = f"{OF_RUN} return chart.getOption().series[0].data.at(-1)[0];"
DRAWS_SPANS = f"{OF_RUN} return chart?.drawsSpans === true;"
ENDS = ("Span from", "Span to")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("chart")


@pytest.fixture(scope="module")
def person(folder: Path) -> Iterator[Visitor]:
    with running_panel(folder, "--fast") as panel, browser(panel, folder / "browser") as visitor:
        visitor.driver.execute_cdp_cmd(
            "Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(folder)}
        )
        visitor.sign_in("Admin")
        yield visitor


def option(person: Visitor, what: str) -> Any:
    return person.driver.execute_script(f"{CHART} return chart.getOption().{what};")


def span_s(person: Visitor) -> float:
    return float(option(person, "xAxis[0].max") - option(person, "xAxis[0].min")) / 1000.0


def heads(person: Visitor) -> list[str]:
    found = person.driver.find_elements(By.CSS_SELECTOR, ".trend-values thead th")
    return [each.text for each in found]


def saved(person: Visitor, folder: Path, ending: str, name: str = "torquebench-*") -> Path:
    def found() -> Path | None:
        return next(folder.glob(f"{name}.{ending}"), None)

    file: Path = person.wait(found, f"a saved {ending}")
    return file


@pytest.fixture(autouse=True)
def ordinary_screen(person: Visitor) -> Iterator[None]:
    """Let every test begin with the usual screen."""
    yield
    person.size(1440, 900)


def choose_tool(person: Visitor, tool: str) -> None:
    """Choose from the menu of the toolbar, which then closes."""
    person.press("More", within="//details")
    person.press(tool, within="//details")
    menu = "return document.querySelector('.trend-tools .menu').open"
    person.wait(lambda: not person.driver.execute_script(menu), "a closed menu")


@pytest.mark.nightly
def test_a_small_screen_shows_one_row_of_tools_and_three_plots_of_160_pixels(
    person: Visitor,
) -> None:
    person.size(1366, 768)
    person.open("/")
    person.wait(lambda: option(person, "legend[0].data"), "lines in the first plot")
    bottom = "return document.querySelector('.trend').getBoundingClientRect().bottom"
    assert person.driver.execute_script(bottom) <= 768
    heights = option(person, "grid.map((grid) => grid.height)")
    assert len(heights) == 3
    assert min(heights) >= 160
    tops = (
        "return [...document.querySelectorAll('.trend-tools .control')]"
        ".filter((each) => each.checkVisibility()).map((each) => each.getBoundingClientRect().top)"
    )
    assert len(set(person.driver.execute_script(tops))) == 1
    named = option(person, "legend.map((legend) => legend.data)")
    assert named == [
        ["Output, raw torque"],
        ["Input, raw torque"],
        ["Input, speed", "Output, speed"],
    ]
    drawn = option(person, "series.map(({name, z, lineStyle}) => [name, z, lineStyle.width])")
    beneath = [each for each in drawn if "raw" in each[0]]
    above = [each for each in drawn if each not in beneath]
    assert max(z for _, z, _ in beneath) < min(z for _, z, _ in above)
    assert min(width for *_, width in beneath) >= 2 * max(width for *_, width in above)
    person.size(390, 844)
    person.wait(lambda: len(set(person.driver.execute_script(tops))) == 3, "three rows of tools")


def test_without_a_model_live_leads_to_the_calibration(person: Visitor) -> None:
    person.open("/")
    for side in ("input", "output"):
        person.press("Calibrate", within=f"//section[contains(@class, '{side}')]")
        person.sees("Start calibration")
        person.open("/")


def test_the_mouse_reads_all_charts_at_one_time(person: Visitor) -> None:
    person.open("/")
    person.wait(lambda: len(heads(person)) == 5, "a table of values")
    assert heads(person)[1] == "Newest"
    plot = person.driver.find_element(By.CSS_SELECTOR, ".trend")
    rows = "return [...document.querySelectorAll('.pointed li')].map((each) => each.textContent)"

    def read() -> list[str]:
        ActionChains(person.driver).move_to_element_with_offset(plot, 40, 0).perform()
        ActionChains(person.driver).move_by_offset(3, 3).perform()
        found: list[str] = person.driver.execute_script(rows)
        return found if len(found) == 5 else []

    time, *values = person.wait(read, "readings at the mouse")
    assert re.fullmatch(r"\d\d:\d\d:\d\d\.\d\d", time)
    assert [re.sub(r"[−\d.]+ ", " ", each) for each in values] == [
        "Output, raw torque N·m", "Input, raw torque N·m", "Input, speed rpm", "Output, speed rpm",
    ]  # fmt: skip
    share = (
        "const height = (place) => document.querySelector(place).getBoundingClientRect().height;"
        "return height('.pointed') / height('.trend')"
    )
    assert person.driver.execute_script(share) > 0.9
    ActionChains(person.driver).move_to_element(
        person.driver.find_element(By.TAG_NAME, "header")
    ).perform()
    person.wait(lambda: not person.driver.execute_script(rows), "no readings without the mouse")


def test_a_span_is_drawn_held_and_left_again(person: Visitor) -> None:
    person.open("/")
    person.wait(lambda: len(heads(person)) == 5, "a table of values")
    person.wait(lambda: span_s(person) == pytest.approx(10.0, abs=0.01), "ten seconds")
    plot = person.driver.find_element(By.CSS_SELECTOR, ".trend")
    ActionChains(person.driver).move_to_element_with_offset(
        plot, -100, 0
    ).click_and_hold().move_by_offset(200, 0).release().perform()
    person.wait(lambda: span_s(person) < 6.0, "a shorter span")
    held = option(person, "xAxis[0].min")
    person.press("Cursors")
    person.wait(lambda: heads(person)[-1] == "B − A", "differences")
    cursor = person.driver.find_element(By.CSS_SELECTOR, ".cursor")
    before = heads(person)[0]
    ActionChains(person.driver).drag_and_drop_by_offset(cursor, -60, 0).perform()
    person.wait(lambda: heads(person)[0] != before, "another difference of times")
    assert option(person, "xAxis[0].min") == held
    assert person.axe() == []
    person.press("Live")
    person.wait(lambda: span_s(person) > 9.9, "the whole span again")
    person.wait(lambda: option(person, "xAxis[0].min") > held, "a chart that follows")
    assert person.problems() == []


def test_a_scale_ends_a_little_beyond_the_values_and_has_a_tick_at_zero(person: Visitor) -> None:
    person.open("/")
    scale = (
        "const place = document.querySelector('.trend').closest('.trend-box').id.slice(1);"
        "const axis = {floor: arguments[3], room: arguments[2], low: 0, high: 1, ends: null};"
        "return window.getElement(Number(place)).scaled(axis, [arguments[0], arguments[1]])"
    )
    for ends, room, floor, found in (
        ((-2001.0, 2001.0), 60, 1, {"min": -2500, "max": 2500, "interval": 2500}),
        ((-2001.0, 2001.0), 160, 1, {"min": -2500, "max": 2500, "interval": 2500}),
        ((-40.0, 1950.0), 160, 1, {"min": -500, "max": 2000, "interval": 500}),
        ((0.3, 0.7), 160, 1, {"min": 0, "max": 1, "interval": 0.2}),
        ((0.0, 0.0), 160, 0, {"min": -0.5, "max": 0.5, "interval": 0.25}),
    ):
        assert person.driver.execute_script(scale, *ends, room, floor) == found
    for constant in (-1e20, 80.0, 1e300):  # as a ratio or a power at rest
        drawn = person.driver.execute_script(scale, constant, constant, 160, 0)
        assert drawn["min"] < constant < drawn["max"]


@pytest.mark.nightly
def test_a_cursor_reads_nothing_where_there_is_no_reading(person: Visitor) -> None:
    person.open("/")
    read = (
        "const place = document.querySelector('.trend').closest('.trend-box').id.slice(1);"
        "const points = [0, 1, 2, 3, 13, 14].map((time) => ({time, mean: 10 * time}));"
        "return window.getElement(Number(place)).at(points, arguments[0])"
    )
    read_at = {time: person.driver.execute_script(read, time) for time in (-5, 0.4, 3, 8, 13.6, 30)}
    assert read_at == {-5: None, 0.4: 0, 3: 30, 8: None, 13.6: 140, 30: None}


@pytest.mark.nightly
def test_times_are_those_of_the_clock(person: Visitor) -> None:
    person.open("/")
    late = person.wait(
        lambda: person.driver.execute_script(
            f"{CHART} const end = chart.getOption().xAxis[0].max;"
            "return end > 1e12 ? Math.abs(Date.now() - end) : null"
        ),
        "an axis of times",
    )
    assert late < 60_000


def test_peaks_are_held(person: Visitor) -> None:
    person.open("/")
    choose_tool(person, "Peak hold")
    person.wait(lambda: heads(person)[-1] == "Highest held", "held peaks")
    choose_tool(person, "Peak hold")
    person.wait(lambda: heads(person)[-1] == "Mean", "no held peaks")


@pytest.mark.nightly
def test_a_marker_is_seen_with_its_note(person: Visitor) -> None:
    person.open("/")
    person.press("10 min")  # in ten seconds it may be gone before anybody looks
    choose_tool(person, "Marker")
    person.fill("Note", "clamp tightened")
    person.press("Set the marker")

    def seen() -> bool:
        lines = option(person, "series[0].markLine?.data") or []
        return any("clamp tightened" in str(line) for line in lines)

    person.wait(seen, "the marker in the chart")
    person.open("/")
    person.wait(seen, "the marker after loading the page anew")
    person.press("10 s")  # the span is kept for the person


@pytest.mark.nightly
def test_channels_and_scales_are_kept_for_the_person(person: Visitor) -> None:
    person.open("/")
    choose_tool(person, "Channels")
    for signal in ("raw torque", "compensated torque", "torque of the standard"):
        person.choose(f"Input, {signal}", "")
    person.choose("Output, temperature of the transducer", "3")
    person.choose("Efficiency", "3")
    person.press("Apply")
    person.sees("one chart has 2 scales at most")
    person.choose("Efficiency", "")
    person.choose("Output, temperature of the transducer", "2")
    scale = person.driver.find_elements(By.XPATH, "//label[normalize-space(.)='Left scale']")[0]
    control = person.driver.find_element(By.ID, str(scale.get_attribute("for")))
    control.find_element(By.CSS_SELECTOR, "option[value=range]").click()
    person.press("Apply")
    person.wait(lambda: option(person, "yAxis[2].name") == "Output, °C", "another channel")
    person.open("/")
    person.wait(lambda: option(person, "yAxis[2].name") == "Output, °C", "the same channels")
    person.wait(lambda: option(person, "yAxis[0].max") == 2000, "the bench's range")
    assert option(person, "yAxis[0].min") == -2000
    choose_tool(person, "Channels")
    assert person.axe() == []
    person.press("Restore the default")
    person.wait(lambda: option(person, "yAxis[2].name") == "Input, N·m", "the usual channels")
    assert person.problems() == []


def moments(address: str) -> list[float]:
    """Return the ends of the span in an address, s since 1970."""
    query = parse_qs(urlsplit(address).query)
    return [datetime.fromisoformat(query[key][0]).timestamp() for key in ("from", "to")]


def choose_view(person: Visitor, view: str) -> None:
    person.driver.find_element(By.CSS_SELECTOR, f"[aria-label='{view}']").click()


@pytest.mark.nightly
def test_a_channel_is_computed_by_a_formula_whose_unit_is_checked(person: Visitor) -> None:
    person.open("/")
    choose_tool(person, "Computed channels")
    person.choose("Example", "power")
    assert person.field("Formula").get_attribute("value") == "output_torque * output_speed"
    person.fill("Name", "Twice the raw torque")
    person.fill("Formula", "2 * output_raw")
    person.press("Add")
    person.sees("'2 * output_raw' is in N·m, which is no multiple of W")
    person.choose("Unit of the result", "N·m")
    person.press("Add")
    person.sees("= 2 * output_raw, N·m")
    assert person.axe() == []
    person.press("Close", within="//div[contains(@class, 'sheet')]")
    values = "return [...document.querySelectorAll('.trend-values tbody tr')].map((row) => "
    values += (
        "[row.children[0].textContent, Number(row.children[4].textContent.replace('−', '-'))])"
    )

    def twice() -> bool:
        rows = dict(person.driver.execute_script(values))
        found = rows.get("Twice the raw torque, N·m"), rows.get("Output, raw torque, N·m")
        return None not in found and abs(found[0] - 2.0 * found[1]) < 0.02

    person.wait(twice, "twice the mean of the raw torque")
    person.open("/")
    person.wait(twice, "the same channel after loading the page anew")
    choose_tool(person, "Computed channels")
    person.press("Remove", within="//div[contains(@class, 'sheet')]")
    person.wait(lambda: "2 * output_raw" not in person.text, "a removed channel")
    person.press("Close", within="//div[contains(@class, 'sheet')]")
    person.wait(lambda: len(option(person, "series")) == 8, "the usual lines")


@pytest.mark.nightly
def test_an_address_leads_to_view_layout_and_span(person: Visitor, tmp_path: Path) -> None:
    person.open("/")
    choose_view(person, "Large numbers")
    large = "return [...document.querySelectorAll('.digits b')].map((each) => each.textContent)"
    person.wait(lambda: "0.00 rpm" in person.driver.execute_script(large), "large numbers")
    assert person.axe() == []
    choose_view(person, "XY plot")
    person.wait(lambda: option(person, "xAxis[0]?.name") == "Output, shaft angle, °", "an XY plot")
    choose_tool(person, "Channels")
    person.choose("Horizontal", "input_raw_nm")
    assert person.axe() == []
    person.press("Apply")
    person.wait(lambda: option(person, "xAxis[0]?.name") == "Input, raw torque, N·m", "another x")
    pairs = "series.flatMap((line) => line.data).filter(([x, y]) => x < 0 && y !== null).length"
    person.wait(lambda: option(person, pairs) > 20, "pairs of readings")
    person.press("1 min")
    person.press("◂")
    person.wait(lambda: "from=" in person.driver.current_url, "the span in the address")
    address = person.driver.current_url.removeprefix(person.panel.url)
    with browser(person.panel, tmp_path) as other:
        other.sign_in("Ben", "/")
        other.open(address)
        other.wait(lambda: option(other, "xAxis[0]?.name") == "Input, raw torque, N·m", "the view")
        other.wait(lambda: "from=" in other.driver.current_url, "the held span")
        ends = [moments(each.driver.current_url) for each in (person, other)]
        assert ends[0] == pytest.approx(ends[1], abs=1.0)
        pressed = other.driver.find_elements(By.CSS_SELECTOR, "[aria-pressed=true]")
        assert [each.text for each in pressed] == ["timeline", "1 min"]
        other.open("/")  # what he looked at isn't his own layout
        other.wait(lambda: option(other, "grid.length") == 3, "his own layout")
    choose_tool(person, "Channels")
    person.press("Restore the default")
    person.press("10 s")
    choose_view(person, "Charts over time")
    person.wait(lambda: option(person, "grid.length") == 3, "charts over time")
    assert person.problems() == []


@pytest.mark.nightly
def test_a_span_is_typed_by_the_clock(person: Visitor) -> None:
    person.open("/")
    choose_tool(person, "Span of time")
    person.sees("are kept.")
    assert person.axe() == []
    person.press("Show span")
    person.sees("no readings in this span")
    typed = """
      const now = Date.now(), type = (input, at) => {
        input.value = new Date(at).toTimeString().slice(0, 8);
        for (const kind of ["input", "change"]) input.dispatchEvent(new Event(kind));
      };
      const [from, to] = document.querySelectorAll("input[type=time]");
      type(from, now - 4000);
      type(to, now - 2000);
      return now / 1000;
    """
    now_s = person.driver.execute_script(typed)
    person.press("Show span")
    person.wait(lambda: "from=" in person.driver.current_url, "the span in the address")
    assert moments(person.driver.current_url) == pytest.approx([now_s - 4.0, now_s - 2.0], abs=1.01)
    person.press("Live")
    assert person.problems() == []


@pytest.mark.nightly
def test_a_span_is_shown_as_spectrum_and_histogram(person: Visitor) -> None:
    person.open("/")
    choose_tool(person, "Spectrum")
    person.sees("standard deviation")
    rate = re.search(r" ([\d.]+) a second", person.text)
    assert rate is not None
    axis = (
        "const place = document.querySelector('.figure .chart').id.slice(1);"
        "const [line] = getElement(Number(place)).chart.getOption().series;"
        "return Math.max(...line.data.map(([frequency]) => frequency))"
    )
    highest_hz = person.wait(lambda: person.driver.execute_script(axis), "a spectrum")
    assert highest_hz == pytest.approx(float(rate[1]) / 2.0, rel=0.01)
    person.wait(
        lambda: len(person.driver.find_elements(By.CSS_SELECTOR, ".figure canvas")) == 2,
        "two charts",
    )
    assert person.axe() == []
    assert person.problems() == []


@pytest.mark.nightly
def test_the_chart_is_saved_as_picture_and_table(person: Visitor, folder: Path) -> None:
    twice_it = {"title": "Twice it", "formula": "2 * output_raw", "unit": "N·m"}
    bands = [{"signals": ["output_raw_nm", "=Twice it"]}]
    layout = json.dumps({"bands": bands, "computed": [twice_it]})
    person.open(f"/?{urlencode({'view': 'time', 'layout': layout})}")
    person.wait(lambda: len(heads(person)) == 5, "a table of values")
    choose_tool(person, "Picture")
    assert saved(person, folder, "png").read_bytes()[:4] == b"\x89PNG"
    choose_tool(person, "CSV")
    file = saved(person, folder, "csv")
    person.wait(lambda: file.stat().st_size > 0, "a written file")
    with file.open(newline="") as lines:
        rows = list(csv.DictReader(lines))
    assert len(rows) > 20
    assert float(rows[0]["output_raw_nm_min"]) <= float(rows[0]["output_raw_nm"])
    assert float(rows[-1]["bench_time_s"]) > float(rows[0]["bench_time_s"])
    assert rows[0]["time_utc"].startswith("20")
    twice = float(rows[0]["computed_Twice_it_N·m"])
    assert twice == pytest.approx(2.0 * float(rows[0]["output_raw_nm"]), abs=1e-4)


@pytest.mark.nightly
def test_signals_are_recorded_on_demand(person: Visitor) -> None:
    person.open("/")
    person.press("Record", within="//div[@role='toolbar']")
    person.fill("Name", "run-down")
    person.fill("Note", "without the coupling")
    person.choose("When it starts", "level")
    person.sees("Direction")
    assert person.axe() == []
    person.fill("Level", "much")
    person.fill("Also record before the start", "99")
    person.press("Record signals")
    person.sees("Allowed: a number, 0 to 60 s")
    wrong = person.driver.find_elements("css selector", "[aria-invalid=true]")
    assert len(wrong) == 2
    person.fill("Also record before the start", "0")
    person.choose("When it starts", "now")
    confirm_recording(person)
    person.wait(lambda: "s recorded" in person.text, "a recording under way")
    choose_tool(person, "Marker")
    person.fill("Note", "brake released")
    person.press("Set the marker")
    person.press("Finish")
    person.sees("Recording run-down: done")
    person.sees("run-down")
    person.open("/records")
    person.sees("Recording")
    person.press("Open")
    person.sees("without the coupling")
    person.sees("by hand")
    person.sees("brake released")
    person.choose("Samples as a file", "parquet")
    assert saved(person, person.panel.folder, "parquet", "*-samples").stat().st_size > 1000
    assert person.problems() == []


def confirm_recording(person: Visitor) -> None:
    record = "//div[contains(@class, 'sheet')]//button[contains(., 'Record signals')]"
    person.wait(
        lambda: person.driver.find_element(By.XPATH, record).click() is None, "the second press"
    )


def drawn(person: Visitor) -> list[str]:
    """Return the names of the lines in the page's chart."""
    script = """
        const figure = document.querySelector(".chart");
        const chart = figure && getElement(Number(figure.id.slice(1)))?.chart;
        return chart ? chart.getOption().series.map((line) => line.name) : [];
    """
    return list(person.driver.execute_script(script))


@pytest.mark.nightly
def test_runs_are_laid_over_each_other_at_an_address(person: Visitor) -> None:
    person.open("/")
    for name in ("first", "second"):
        person.press("Record", within="//div[@role='toolbar']")
        person.fill("Name", name)
        person.fill("Length", "0.5")
        confirm_recording(person)
        person.sees(f"Recording {name}: done")
    person.open("/records")
    person.press("Open")
    person.sees("second")
    other = Select(person.field("Overlay another run")).options[1].get_attribute("value")
    person.choose("Overlay another run", str(other))
    person.sees("Remove the other runs")
    person.wait(lambda: other in drawn(person), "both runs in the chart")
    assert len(drawn(person)) == 2
    person.choose("Raw samples of", "input_speed_rad_s")
    person.wait(lambda: "column=input_speed_rad_s" in person.driver.current_url, "the address")
    address = person.driver.current_url.removeprefix(person.panel.url)
    person.open("/records")
    person.open(address)
    person.wait(lambda: len(drawn(person)) == 2, "both runs at their address")
    assert person.field("Raw samples of").get_attribute("value") == "input_speed_rad_s"
    assert person.axe() == []
    person.press("Remove the other runs")
    person.wait(lambda: len(drawn(person)) == 1, "one run")
    assert person.problems() == []


@pytest.mark.nightly
def test_a_span_of_a_run_is_drawn_typed_and_kept_in_its_address(person: Visitor) -> None:
    def ends() -> list[float]:
        return [float(str(person.field(end).get_attribute("value"))) for end in ENDS]

    def drawn_until_s() -> float:
        return float(person.driver.execute_script(LAST_TIME))

    person.open("/")
    person.press("Record", within="//div[@role='toolbar']")
    person.fill("Name", "a span")
    person.fill("Length", "2")
    confirm_recording(person)
    person.sees("Recording a span: done")
    person.open("/records")
    person.press("Open")
    person.sees("a span")
    person.wait(lambda: drawn(person), "the chart")
    assert drawn_until_s() > 1.5
    person.fill("Span from", "0.25")
    person.fill("Span to", "0.75")
    person.press("Show span")
    person.wait(lambda: "from=0.25&to=0.75" in person.driver.current_url, "the address")
    person.wait(lambda: drawn_until_s() < 0.8, "the span in the chart")
    address = person.driver.current_url.removeprefix(person.panel.url)
    person.open("/records")
    person.open(address)
    person.wait(lambda: drawn(person), "the chart at its address")
    assert drawn_until_s() < 0.8
    assert ends() == [0.25, 0.75]
    figure = person.driver.find_element(By.CSS_SELECTOR, ".chart canvas")
    person.wait(lambda: person.driver.execute_script(DRAWS_SPANS), "a chart to draw in")
    person.driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", figure)
    mouse = ActionChains(person.driver).move_to_element(figure).click_and_hold()
    mouse.move_by_offset(60, 0).release().perform()
    person.wait(lambda: ends() != [0.25, 0.75], "a shorter span")
    start, stop = ends()
    assert 0.25 < start < stop < 0.75
    assert person.axe() == []
    person.press("Whole run")
    person.wait(lambda: "from=" not in person.driver.current_url, "the address of the whole run")
    person.wait(lambda: drawn_until_s() > 1.5, "the whole run")
    assert person.problems() == []


LARGEST_INSIDE = """
return [...document.querySelectorAll('.digits > li')].map((tile) => {
  tile.querySelector('b').firstChild.textContent = '−2000.00 ';
  return tile.scrollWidth <= tile.clientWidth;
});
"""


@pytest.mark.nightly
def test_large_numbers_stay_in_their_tiles(person: Visitor) -> None:
    for size in ((1920, 1080), (1366, 768), (390, 844)):
        person.size(*size)
        person.open("/?view=digits")
        person.wait(lambda: person.driver.execute_script(LARGEST_INSIDE), "tiles")
        assert set(person.driver.execute_script(LARGEST_INSIDE)) == {True}, size
