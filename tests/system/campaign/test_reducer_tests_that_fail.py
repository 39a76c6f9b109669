"""What goes wrong at the bench has a name, and takes no other part of a test along."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from torquebench.bench.active_chain import ActiveChain
from torquebench.bench.description import default_bench
from torquebench.bench.drivers.simulated.driver import SimulatedOptions
from torquebench.campaign.reducers import tests as reducer_tests
from torquebench.campaign.reducers.catalogue import TESTS
from torquebench.campaign.reducers.preparation import Known
from torquebench.campaign.reducers.recorded import RecordedTest
from torquebench.campaign.reducers.settings import ReducerTestSettings
from torquebench.campaign.reducers.tests import rehearse_reducer_test, run_reducer_test
from torquebench.chain import MeasuredRotation, MeasuringChain
from torquebench.compensation import features, make_model
from torquebench.errors import BenchError, InputError, TorquebenchError
from torquebench.procedures.reducers.empty_run import EmptyRunSettings
from torquebench.procedures.reducers.first_motion import BreakawaySettings
from torquebench.procedures.reducers.friction import FrictionSettings
from torquebench.procedures.reducers.running import NoLoadSettings
from torquebench.procedures.reducers.setup import WarmUp
from torquebench.records import RECORDING, RunFolder
from torquebench.reducers import load_reducer
from torquebench.reports.page_pdf import page_pdf
from torquebench.reports.reducers.report import reducer_page
from torquebench.station import Station

REDUCER = load_reducer("rv-40e")
ONE = BreakawaySettings(positions=1)
SHORT = ReducerTestSettings.short().with_plans({"starting": ONE, "back-driving": ONE})
SWEEP = FrictionSettings(speeds_rpm=(300.0,), repeats=1, counter_clockwise=False)


@pytest.fixture
def station(tmp_path: Path) -> Iterator[Station]:
    described = default_bench()
    settings = described.bench.model_copy(update={"reducer_ratio": REDUCER.ratio})
    driver = {**described.driver, "reducer": "rv-40e"}
    bench = described.model_copy(update={"driver": driver, "bench": settings})
    with Station.open(bench, tmp_path) as opened:
        yield opened


def test_a_part_that_fails_leaves_the_others_their_results(
    station: Station, monkeypatch: pytest.MonkeyPatch
) -> None:
    parts = [TESTS["starting"], TESTS["back-driving"]]
    monkeypatch.setattr(reducer_tests, "chosen_tests", lambda _name: parts)
    too_little = replace(ONE, expected_nm=0.01, largest_nm=0.02)
    record = run_reducer_test(
        station, "full", REDUCER, SHORT.with_plans({"starting": too_little}), serial="F1"
    )
    assert [each.name for each in record.outcomes] == ["back-driving"]
    (failure,) = record.failures
    assert failure.name == "starting"
    assert "nothing moved up to 0.02 N·m" in failure.message
    assert record.failed
    page = reducer_page(record)
    assert "Starting torque: no result" in [section.heading for section in page.sections]
    assert page_pdf(page).startswith(b"%PDF")
    (specimen,) = station.registry.equipment("reducer")
    assert (specimen.serial, specimen.model) == ("F1", REDUCER.name)


def test_a_drive_that_saturates_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = SimulatedOptions.parameters

    def weak(options: SimulatedOptions) -> object:
        found = drawn(options)
        drive = found.input.drive._replace(torque_limit_nm=0.1)
        return replace(found, input=replace(found.input, drive=drive))

    monkeypatch.setattr(SimulatedOptions, "parameters", weak)
    described = default_bench()
    settings = described.bench.model_copy(update={"reducer_ratio": REDUCER.ratio})
    driver = {**described.driver, "reducer": "rv-40e"}
    bench = described.model_copy(update={"driver": driver, "bench": settings})
    cold = SHORT.with_plans({"no-load": NoLoadSettings(SWEEP, WarmUp(longest_s=0.0))})
    with (
        Station.open(bench, tmp_path) as station,
        pytest.raises(TorquebenchError, match="saturat"),
    ):
        run_reducer_test(station, "no-load", REDUCER, cold)


def test_a_temperature_that_does_not_settle_is_named(station: Station) -> None:
    never = WarmUp(rate_k_per_min=1e-6, window_s=4.0, interval_s=2.0, longest_s=8.0)
    warming = SHORT.with_plans({"no-load": NoLoadSettings(SWEEP, never)})
    with pytest.raises(BenchError, match="still changes by"):
        run_reducer_test(station, "no-load", REDUCER, warming)


def test_an_empty_run_is_taken_off_and_kept(station: Station) -> None:
    cold = NoLoadSettings(replace(SWEEP, counter_clockwise=True), WarmUp(longest_s=0.0))
    empty = EmptyRunSettings(speeds_rpm=(100.0, 300.0), repeats=2, window_s=0.4)
    settings = replace(SHORT.with_plans({"no-load": cold}), empty_run=empty)
    record = run_reducer_test(station, "no-load", REDUCER, settings)
    kinds = {line.kind for line in station.registry.runs()}
    assert kinds == {"empty-run", "test-no-load-short"}
    (outcome,) = record.outcomes
    assert any("empty run is subtracted" in each for each in outcome.remarks)
    names = {line.name for line in outcome.result.points[0].torque.lines}
    assert {"tare", "tare transfer"} <= names
    assert not {"mounting and drag", "zero by speed"} & names


def test_what_cannot_be_evaluated_keeps_its_recording(station: Station) -> None:
    cold = NoLoadSettings(replace(SWEEP, counter_clockwise=True), WarmUp(longest_s=0.0))
    slow = EmptyRunSettings(speeds_rpm=(100.0, 200.0), repeats=1, window_s=0.4)
    settings = replace(SHORT.with_plans({"no-load": cold}), empty_run=slow)
    with pytest.raises(InputError, match="an empty run up to 200 rpm for a test at 30"):
        run_reducer_test(station, "no-load", REDUCER, settings)
    (line,) = station.registry.runs(kind="test-no-load-short")
    assert line.status == "failed"
    folder = RunFolder.open(line.folder)
    folder.verify()
    assert folder.results is None
    recorded = RecordedTest.read((folder.path / RECORDING).read_bytes(), line.run_id)
    assert (recorded.test, recorded.recording.speed_rpm["input"].size) == ("no-load", 2)
    alone = replace(recorded, known=Known()).evaluated(station.description)
    assert alone.quantities


def test_a_bench_can_leave_recordings_out(tmp_path: Path) -> None:
    described = default_bench()
    bench = described.model_copy(
        update={
            "driver": {**described.driver, "reducer": "rv-40e"},
            "bench": described.bench.model_copy(update={"reducer_ratio": REDUCER.ratio}),
            "recording": described.recording.model_copy(update={"reducer_tests": False}),
        }
    )
    with Station.open(bench, tmp_path) as station:
        record = run_reducer_test(station, "starting", REDUCER, SHORT)
        (line,) = station.registry.runs(kind="test-starting-short")
        folder = RunFolder.open(line.folder)
    assert record.outcomes[0].quantities
    assert folder.results
    assert not (folder.path / RECORDING).exists()


@pytest.mark.nightly
def test_a_chain_that_corrects_rotation_needs_no_empty_run(station: Station) -> None:
    torque = np.linspace(-50.0, 50.0, 30)
    model = make_model("polynomial", range_nm=50.0).fit(features(torque), torque)
    tables = [((0.0, 0.0), (size, size)) for size in (0.001, 0.0001, 0.004, 0.0002)]
    rotation = MeasuredRotation(
        "empty runs", 23.0, -1200.0, 1200.0, 10.0, 40.0, (0.0, 1200.0), (10.0, 40.0), *tables
    )
    active = ActiveChain(MeasuringChain(model, (rotation,)), "1", "polynomial")
    station.acquisition.set_compensation("input", active)
    cold = NoLoadSettings(replace(SWEEP, counter_clockwise=True), WarmUp(longest_s=0.0))
    empty = EmptyRunSettings(speeds_rpm=(100.0, 300.0), repeats=2, window_s=0.4)
    settings = replace(SHORT.with_plans({"no-load": cold}), empty_run=empty)
    try:
        (outcome,) = run_reducer_test(station, "no-load", REDUCER, settings).outcomes
        assert any("no empty run is needed" in each for each in outcome.remarks)
        names = {line.name for line in outcome.result.points[0].torque.lines}
        assert "tare" not in names
        assert "mounting and drag" in names
        always = replace(settings, tare_always=True)
        (outcome,) = run_reducer_test(station, "no-load", REDUCER, always).outcomes
        said = next(each for each in outcome.remarks if "the empty run differs from" in each)
        assert 0.0 < float(said.split()[-2]) < 0.1
        active.switch_off(["rotation"])
        parts = rehearse_reducer_test(station, "no-load", REDUCER, settings)
        assert [part.name for part in parts] == ["empty-run", "no-load"]
    finally:
        station.acquisition.set_compensation("input", None)
