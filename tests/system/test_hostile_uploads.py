"""Files that expand without end are uploaded while a calibration runs: it goes on, and may be
stopped at once."""

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from selenium.webdriver.common.by import By
from tests.hostile_files import FILES
from tests.system.command_line import wait_until
from tests.system.panel_browser import PEOPLE, SLOW, Panel, Visitor, browser, running_panel

pytestmark = SLOW
UPLOADED = ("far-cell-denied.xlsx", "one-long-word.parquet", "fill-values.h5", "packed-zeros.mat")
SHORT = Path(__file__).parents[2] / "examples" / "calibration-output.csv"


@pytest.fixture(scope="module")
def panel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Panel]:
    with running_panel(tmp_path_factory.mktemp("panel"), "--fast") as panel:
        yield panel


@pytest.fixture(scope="module")
def api(panel: Panel) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=f"{panel.url}/api/v1", timeout=300.0) as client:
        opened = client.post("/session", json={"name": "Ana", "password": PEOPLE["Ana"][1]})
        client.headers["Authorization"] = f"Bearer {opened.json()['token']}"
        yield client


@pytest.fixture
def job(api: httpx.Client) -> str:
    def begun() -> httpx.Response | None:
        asked = {"side": "output", "step_percent": 0.5, "repeats": 5}
        answer = api.post("/operations/calibrate", json=asked)
        if answer.status_code == 503:
            api.post("/alarms/acknowledge")
        return answer if answer.status_code == 202 else None

    answers: list[httpx.Response] = []
    wait_until(lambda: bool((a := begun()) and not answers.append(a)), "a calibration")
    number: str = answers[0].json()["job_id"]
    wait_until(lambda: points(api, number) > 0, "a point")
    return number


def points(api: httpx.Client, job: str) -> int:
    view = api.get(f"/jobs/{job}").json()
    assert not view["finished"], view
    return int(view["points"])


@pytest.mark.nightly
def test_hostile_files_are_refused_on_the_page_while_a_calibration_runs(
    api: httpx.Client, job: str, panel: Panel, tmp_path: Path
) -> None:
    with browser(panel, tmp_path / "browser") as ana:
        ana.sign_in("Ana", "/records")
        ana.open("/operations/evaluate-static")
        chosen = ana.wait(
            lambda: ana.driver.find_element(By.CSS_SELECTOR, "input[type=file]"), "a file's place"
        )
        for name in UPLOADED:
            FILES[name](tmp_path / name)
            before = points(api, job)
            chosen.send_keys(str(tmp_path / name))
            ana.fill("Resolution", "0.01")
            ana.fill("Reference uncertainty", "0.02 of torque")
            ana.press("Start")
            ana.wait(lambda name=name: _refused(ana, name), f"a refusal of {name}")
            wait_until(lambda before=before: points(api, job) > before, "further points")
        assert ana.problems() == []
    assert api.post("/stop", json={"reason": "the end"}).status_code == 200


def _refused(ana: Visitor, name: str) -> bool:
    text = ana.text
    return name in text and any(word in text for word in ("cells", "MB"))


def test_a_stop_waits_for_no_table(api: httpx.Client, job: str) -> None:
    """A table that is read is no reason to wait, nor are ten at a time."""
    handed_in = api.post(
        "/files",
        content=SHORT.read_bytes(),
        headers={"Content-Type": "application/octet-stream"},
    ).json()
    asked = {
        "table": handed_in["file"],
        "profile": "staircase",
        "reference_uncertainty": "0.02 of torque",
        "resolution_nm": 0.01,
        "performed": "2026-03-02T10:00:00Z",
        "reference_due": "2027-01-31",
    }
    answers: list[tuple[float, int]] = []

    def look() -> None:
        answer = api.post("/operations/evaluate-static", json=asked)
        answers.append((time.monotonic(), answer.status_code))

    crowd = [threading.Thread(target=look) for _ in range(10)]
    for thread in crowd:
        thread.start()
    assert api.post("/stop", json={"reason": "in a crowd"}).status_code == 200
    stopped = time.monotonic()
    for thread in crowd:
        thread.join()
    read = [moment for moment, status in answers if status == 200]
    assert read
    assert max(read) > stopped, "the stop came after all of them"
    assert {status for _, status in answers} <= {200, 409}
    wait_until(lambda: bool(api.get(f"/jobs/{job}").json()["finished"]), "the end")
    assert "in a crowd" in str(api.get(f"/jobs/{job}").json()["problem"])
