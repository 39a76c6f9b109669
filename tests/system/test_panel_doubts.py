"""Expired standards, impossible times and contradictory models at the panel, by its records."""

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from importlib.resources import files
from pathlib import Path

import pytest
from selenium.webdriver.common.by import By
from tests.system.campaign.test_implausible_calibrations import KIND, Breaks, calibrate
from tests.system.panel_api import administrator, serving
from tests.system.panel_browser import PEOPLE, SLOW, Visitor, browser, running_panel

from torquebench.bench.description import DEFAULT_BENCH, load_bench
from torquebench.panel.text import Text
from torquebench.records import Registry, RunFolder, RunSummary
from torquebench.station import Station

pytestmark = SLOW
CHINESE = Text("zh")
BENCH = ("--fast", "--bench", "bench.toml")
REASON = "标准器读数有误"


@pytest.fixture
def doubtful(tmp_path: Path) -> tuple[Path, int]:
    """Records with an expired standard, a run that ended early, a model that contradicts itself."""
    packaged = files("torquebench.bench").joinpath(DEFAULT_BENCH).read_text(encoding="utf-8")
    expired = packaged.replace("[calibrator]\n", "[calibrator]\ncertificate_due = 2021-01-15\n")
    (tmp_path / "bench.toml").write_text(expired, encoding="utf-8")
    with Station.open(load_bench(tmp_path / "bench.toml"), tmp_path / "data") as station:
        broken = Breaks(station, "input_reference", "wrong_span", 0.97, after=12)
        model = calibrate(station, "input", broken)[1].models[KIND]
        assert model.contradictions
        now, runs = datetime.now(UTC), tmp_path / "data" / "runs"
        writer = RunFolder.create(runs, {}, kind="zero", run_id="run-9")
        station.registry.add_run(
            RunSummary(
                run_id="run-9",
                kind="zero",
                started=now,
                simulated=True,
                software_version="0.2.0",
                folder=writer.path,
            )
        )
        station.registry.end_run(writer.seal(), now - timedelta(hours=3))
    return tmp_path, model.model_id


def test_the_api_names_what_is_doubtful_about_records(doubtful: tuple[Path, int]) -> None:
    folder, _ = doubtful
    with serving(folder, *BENCH) as server, administrator(server) as admin:
        (listed,) = admin.get("/calibrations").json()
        (doubt,) = listed["doubts"]
        assert "against SIM-CAL-1, whose certificate" in doubt
        assert "had expired on 2021-01-15" in doubt
        assert admin.get("/calibrations/1").json()["calibration"]["doubts"] == [doubt]
        page = admin.get("/runs").json()
        assert page["doubts"] == [], "the clock is right"
        named = {run["run_id"]: run["doubts"] for run in page["runs"]}
        (early,) = named.pop("run-9")
        assert "before it began" in early
        assert not any(named.values())
        assert admin.get("/runs/run-9").json()["run"]["doubts"] == [early]


@pytest.fixture
def ana(doubtful: tuple[Path, int]) -> Iterator[Visitor]:
    folder, _ = doubtful
    with (
        running_panel(folder, *BENCH) as panel,
        browser(panel, folder / "ana", language="zh-CN") as visitor,
    ):
        visitor.sign_in("Ana", "/records")
        yield visitor


@pytest.mark.nightly
def test_they_are_named_on_the_page_and_a_person_decides_for_the_model(
    ana: Visitor, doubtful: tuple[Path, int]
) -> None:
    folder, model_id = doubtful
    ana.sees(CHINESE("Doubtful"))
    ana.sees("时钟被拨回")
    assert ana.english() == []
    ana.driver.find_element(By.CSS_SELECTOR, ".tabs button:nth-child(2)").click()
    ana.sees("已于 2021-01-15 到期")
    ana.press(CHINESE("Compare"))
    ana.press(CHINESE("Open calibration {number} in the wizard", number=1))
    ana.sees(CHINESE("Before and after"))
    ana.press(CHINESE("Next step"))
    ana.press(CHINESE("Next step"))
    ana.sees(CHINESE("This calibration contradicts itself"))
    assert ana.english() == []
    if CHINESE("Give up command") not in ana.text:
        ana.press(CHINESE("Take command"))
    ana.fill(CHINESE("Your password"), PEOPLE["Ana"][1])
    ana.press(CHINESE("Sign and put into use"))
    ana.sees(CHINESE("Say why, or find the cause and calibrate again."))
    with Registry.open(folder / "data") as registry:
        assert registry.activations("SIM-T50") == [], "nothing is used without a reason"
    ana.fill(CHINESE("Why the model is used nevertheless, for the record"), REASON)
    ana.fill(CHINESE("Your password"), PEOPLE["Ana"][1])
    ana.press(CHINESE("Sign and put into use"))
    ana.sees(CHINESE("Signed. The readings are compensated by the chosen model from now on."))
    with Registry.open(folder / "data") as registry:
        (decision,) = registry.activations("SIM-T50")
    assert decision.model_id == model_id
    assert decision.operator.startswith("Ana")
    assert "contradicts itself" in decision.reason
    assert REASON in decision.reason
    ana.open("/calibrate")
    ana.sees("扭矩校准器 SIM-CAL-1 的证书已于 2021-01-15 到期")  # before the next one begins
    assert ana.english() == []
    assert ana.problems() == []
