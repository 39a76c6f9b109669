"""Reducer tests on the simulated bench: rehearsed, run, registered, and read back."""

from pathlib import Path

import pytest

from torquebench.bench.description import BenchDescription, default_bench
from torquebench.campaign.reducers.catalogue import TESTS
from torquebench.campaign.reducers.results import budget_from_plain
from torquebench.campaign.reducers.settings import ReducerTestSettings
from torquebench.campaign.reducers.tests import rehearse_reducer_test, run_reducer_test
from torquebench.errors import InputError
from torquebench.records import RunFolder
from torquebench.reducers import load_reducer
from torquebench.station import Station

REDUCER = load_reducer("rv-40e")


def bench() -> BenchDescription:
    described = default_bench()
    settings = described.bench.model_copy(update={"reducer_ratio": REDUCER.ratio})
    driver = {**described.driver, "reducer": "rv-40e"}
    return described.model_copy(update={"driver": driver, "bench": settings})


def test_a_rehearsal_tells_durations_and_stays_within_the_data_sheet(tmp_path: Path) -> None:
    with Station.open(bench(), tmp_path) as station:
        parts = rehearse_reducer_test(station, "full", REDUCER)
        short = rehearse_reducer_test(station, "full", REDUCER, ReducerTestSettings.short())
        assert station.registry.number_of_runs() == 0
        with pytest.raises(InputError, match="hysteresis"):
            rehearse_reducer_test(station, "stiffness", REDUCER)
    tests = [name for name in TESTS if name != "full"]
    assert [part.name for part in parts] == ["bench-twist", "empty-run", *tests]
    assert [part.name for part in short] == ["bench-twist", *tests]
    in_short = {part.name: part for part in short}
    for part in parts:
        if part.name == "empty-run":
            assert part.modes["input"][-1] == part.modes["output"][-1] == "driven"
            continue
        quick = in_short[part.name]
        if part.name == "bench-twist":
            # Each side by what the loops bring to it: the locked input winds up, too.
            largest = part.largest_torque_nm
            assert largest["output"] == REDUCER.rated_torque_nm
            assert largest["input"] == pytest.approx(REDUCER.rated_torque_nm / REDUCER.ratio)
            continue
        assert part.largest_torque_nm["output"] <= REDUCER.acceleration_torque_nm
        assert part.largest_speed_rpm["input"] <= REDUCER.max_input_speed_rpm
        assert 0.0 < quick.duration_s < part.duration_s
        assert part.points > 0
    assert next(p for p in parts if p.name == "hysteresis").modes["input"][-1] == "locked"


def test_a_run_is_registered_and_its_results_can_be_read_back(tmp_path: Path) -> None:
    with Station.open(bench(), tmp_path) as station:
        record = run_reducer_test(
            station, "starting", REDUCER, ReducerTestSettings.short(), serial="S1"
        )
        (line,) = station.registry.runs(kind="test-starting-short")
    (outcome,) = record.outcomes
    assert (line.run_id, line.status, line.simulated) == (outcome.run.run_id, "completed", True)
    results = RunFolder.open(line.folder).results
    assert (results["test"], results["serial"]) == ("starting", "S1")
    both, *directions = outcome.quantities
    for row, quantity in zip(results["quantities"], outcome.quantities, strict=True):
        read = budget_from_plain(row["budget"])
        assert read.value == quantity.value
        assert read.expanded_uncertainty() == pytest.approx(quantity.expanded_uncertainty)
    # Nothing is compensated here: what the chain adds doesn't cancel between the directions.
    smallest = min(each.expanded_uncertainty for each in directions)
    assert both.expanded_uncertainty > 0.5 * smallest
    assert any("not compensated" in remark for remark in outcome.remarks)
