"""A job is in sight on every page, and its result comes to whoever started it."""

import signal
from collections.abc import Iterator

import httpx
import pytest
from selenium.webdriver.common.by import By
from tests.system.command_line import patient_bench
from tests.system.panel_browser import PEOPLE, SLOW, Panel, Visitor, browser, running_panel

pytestmark = SLOW
STRIP = ".job-strip"
UNCOVERED = """
const foot = (selector) => document.querySelector(selector).getBoundingClientRect();
return foot('.trend').bottom <= foot('.job-strip').top;
"""

JOB = "Calibrate the output module"


@pytest.fixture(scope="module")
def panel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Panel]:
    folder = tmp_path_factory.mktemp("panel")
    bench = ("--bench", patient_bench(folder).name)  # in real time: a job takes a while
    with running_panel(folder, *bench) as panel:
        yield panel


@pytest.fixture(scope="module")
def person(panel: Panel, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Visitor]:
    with browser(panel, tmp_path_factory.mktemp("browser")) as visitor:
        visitor.sign_in("Admin")
        yield visitor


def strip(person: Visitor) -> str:
    found = person.driver.find_elements(By.CSS_SELECTOR, STRIP)
    return found[0].text if found and found[0].is_displayed() else ""


def abort(person: Visitor) -> None:
    person.press("Abort")
    confirm = ".sheet button.danger"
    person.wait(
        lambda: person.driver.find_element(By.CSS_SELECTOR, confirm).click() is None, "the question"
    )


def dismiss(person: Visitor) -> None:
    note = f"//*[contains(@class, 'messages')]/div[contains(., '{JOB}: aborted')]//button"
    person.driver.find_element(By.XPATH, note).click()
    person.wait(lambda: f"{JOB}: aborted" not in person.text, "a dismissed message")


def begin(person: Visitor) -> None:
    person.open("/calibrate")
    person.press("Start calibration")
    person.sees("under way")
    assert strip(person) == ""  # the page shows the job itself


@pytest.mark.nightly
def test_a_job_is_seen_and_ended_from_another_page(person: Visitor) -> None:
    begin(person)
    person.size(1440, 900)
    for path in ("/", "/records", "/settings", "/alarms"):
        person.open(path)
        person.wait(lambda: f"{JOB}: under way" in strip(person), "the job on the page")
        if path == "/":
            person.wait(lambda: person.driver.execute_script(UNCOVERED), "three whole plots")
    assert person.axe() == []
    abort(person)
    person.sees(f"{JOB}: aborted")
    person.wait(lambda: strip(person) == "", "no strip")
    person.open("/records")
    person.sees(f"{JOB}: aborted")  # until it is dismissed
    dismiss(person)
    person.open("/alarms")
    person.sees("No active alarms")
    assert f"{JOB}: aborted" not in person.text
    assert person.problems() == []


@pytest.mark.nightly
def test_a_page_that_was_left_takes_no_message_from_the_next(person: Visitor) -> None:
    """The page of calibrations shows the result itself, and lives on for seconds after it is left.

    The job ends in this time.
    """
    begin(person)
    person.open("/alarms")
    abort(person)
    person.sees(f"{JOB}: aborted")
    dismiss(person)


@pytest.mark.nightly
def test_a_failure_is_told_where_its_page_was_left_and_its_form_begins_with_the_request(
    panel: Panel, person: Visitor
) -> None:
    person.open("/reducer")
    person.choose("Reducer", "rv-40e")
    person.fill("Serial", "S-77")
    person.press("Start test")
    person.wait(lambda: "under way" in person.text, "a test under way")
    person.open("/alarms")
    abort(person)
    person.sees("aborted by Admin")
    person.open("/reducer")
    person.wait(lambda: person.field("Serial").get_attribute("value") == "S-77", "its request")
    with httpx.Client(base_url=f"{panel.url}/api/v1") as client:
        session = client.post("/session", json={"name": "Admin", "password": PEOPLE["Admin"][1]})
        client.headers["Authorization"] = f"Bearer {session.json()['token']}"
        client.post("/command", json={"force": True}).raise_for_status()
        for kind, request in (("zero", {"sides": ["output"]}), ("calibrate", {"side": "output"})):
            begun = client.post(f"/operations/{kind}", json=request).raise_for_status()
            job = f"/jobs/{begun.json()['job_id']}"
            client.post(f"{job}/abort", json={}).raise_for_status()
            person.wait(lambda job=job: client.get(job).json()["finished"], "its end")
        client.delete("/command").raise_for_status()
    person.open("/calibrate")  # it shows the newest job only
    person.sees("Zeroing: aborted")


@pytest.mark.nightly
def test_a_server_that_died_says_so_to_who_had_started_something(
    panel: Panel, person: Visitor
) -> None:
    begin(person)
    # The page would load itself again when the server is back, instead of the page asked for.
    person.driver.get("about:blank")
    panel.end(signal.SIGKILL)
    panel.start()
    person.sign_in("Ben", "/alarms")
    person.sees("No active alarms")
    assert "interrupted" not in person.text
    person.driver.delete_all_cookies()
    person.sign_in("Admin", "/alarms")
    person.sees(f"{JOB}: interrupted by the end of the server")
    person.sees("Measured points are kept")
