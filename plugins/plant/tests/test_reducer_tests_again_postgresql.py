"""Reducer tests evaluated again from their recordings: same bits, or a list of the changes."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from plugins.plant.tests.plant_bench import add_run, backlash_results
from sqlalchemy import text
from tests import postgresql_server
from tests.system.command_line import run

from torquebench.bench.description import default_bench
from torquebench.bench.roles import SIDES
from torquebench.campaign.reducers.catalogue import TESTS
from torquebench.campaign.reducers.recorded import RecordedTest
from torquebench.campaign.reducers.results import ReducerTestOutcome, plain_budget
from torquebench.campaign.reducers.settings import ReducerTestSettings
from torquebench.campaign.reducers.tests import run_reducer_test
from torquebench.procedures.reducers.empty_run import EmptyRunSettings
from torquebench.procedures.reducers.first_motion import BreakawaySettings
from torquebench.procedures.reducers.loop import BenchTwistSettings, HysteresisSettings
from torquebench.procedures.reducers.setup import WarmUp
from torquebench.records import MANIFEST, RECORDING, Registry, RunFolder, sha256_of_file
from torquebench.reducers import load_reducer
from torquebench.station import Station
from torquebench.uncertainty import Budget
from torquebench_plant import Plant, differences, forward, reevaluate
from torquebench_plant.reevaluation import BUDGETS_ONLY, RunTask, SealedFolder, reevaluate_run

pytestmark = pytest.mark.nightly  # by day calibrations and checks are evaluated again
REDUCER = load_reducer("rv-40e")
BEFORE = "20260105T000000Z-test-hysteresis-0000"
OTHER_RULE = "20260106T000000Z-test-hysteresis-0001"


def quick_settings() -> ReducerTestSettings:
    """Return settings of every test with as little motion as its evaluation takes."""
    once = BreakawaySettings(positions=1)
    short = ReducerTestSettings.short()
    no_load, efficiency = short.plans["no-load"], short.plans["efficiency"]
    sweep = replace(no_load.sweep, speeds_rpm=(100.0, 300.0, 600.0, 1000.0), repeats=2)
    settings = ReducerTestSettings().with_plans(
        {
            "starting": once,
            "back-driving": once,
            "transmission-error": short.plans["transmission-error"],
            "hysteresis": HysteresisSettings(loops=1, positions_deg=(0.0,), loop_s=10.0),
            "no-load": replace(no_load, sweep=sweep, warm_up=WarmUp(longest_s=0.0)),
            "efficiency": replace(efficiency, torque_shares=(0.5, 1.0), speeds_rpm=(300.0, 900.0)),
        }
    )
    return replace(
        settings,
        bench_twist=BenchTwistSettings(cycles=1, cycle_s=10.0),
        empty_run=EmptyRunSettings(speeds_rpm=(100.0, 500.0, 1000.0), repeats=1),
        tare_always=True,
    )


@pytest.fixture(scope="module")
def tested(
    tmp_path_factory: pytest.TempPathFactory, plant_socket: Path
) -> Iterator[tuple[Plant, tuple[ReducerTestOutcome, ...]]]:
    """All reducer tests with compensated torques; one is of an old version, one was changed."""
    place = tmp_path_factory.mktemp("tested")
    (place / "share").mkdir()
    for side in SIDES:
        options = ("--step", 25, "--model", "polynomial", "--data", place / "data")
        done = run("calibrate", side, *options, cwd=place)
        assert done.returncode == 0, done.stderr
    described = default_bench()
    described = described.model_copy(
        update={
            "driver": {**described.driver, "reducer": "rv-40e"},
            "bench": described.bench.model_copy(update={"reducer_ratio": REDUCER.ratio}),
        }
    )
    with Station.open(described, place / "data") as station:
        for side in SIDES:
            station.activate_compensation(side)
        record = run_reducer_test(station, "full", REDUCER, quick_settings(), serial="S-1")
        assert record.failures == ()
    with Registry.open(place / "data") as registry:
        results = backlash_results("S-2", 0.8)
        estimate = Budget(0.8, 0.025, float("inf"), (), "arcmin")
        results["short"] = True
        results["quantities"][0] |= {
            "budget": plain_budget(estimate),
            "limit": "≤ 1 arcmin",
            "expanded_uncertainty": estimate.expanded_uncertainty(),
            "verdict": "conditional-pass",
        }
        add_run(registry, BEFORE, "test-hysteresis-short", results)
        add_other_rule(registry, record.outcomes)
        url = postgresql_server.create_database(plant_socket, "tested")
        with Plant.create(url, f"file://{place}/share") as plant:
            _, link = plant.register_bench("Bench 1")
            assert forward(registry, link).problems == []
            reevaluate(plant, "serial", label="serial", kinds=["test"])
            yield plant, record.outcomes


def add_other_rule(registry: Registry, outcomes: tuple[ReducerTestOutcome, ...]) -> None:
    """Register a loop test whose results follow another maker's rule than its recording states."""
    (loops,) = (each for each in outcomes if each.name == "hysteresis")
    recorded = recording_of(loops)
    assert recorded.reducer.lost_motion_rule != "yaskawa"
    other = recorded.reducer.model_copy(update={"lost_motion_rule": "yaskawa"})
    add_run(
        registry,
        OTHER_RULE,
        "test-hysteresis",
        RunFolder.open(loops.run.folder).results,
        metadata=RunFolder.open(loops.run.folder).metadata,
        files={RECORDING: replace(recorded, reducer=other).file()},
    )


def recording_of(outcome: ReducerTestOutcome) -> RecordedTest:
    return RecordedTest.read((outcome.run.folder / RECORDING).read_bytes(), outcome.name)


def kept(plant: Plant, label: str) -> dict[str, tuple[str, str, str]]:
    query = 'SELECT run_id, "values", problem, remark FROM plant.reevaluations WHERE label = :label'
    with plant.transaction() as connection:
        rows = connection.execute(text(query), {"label": label})
        return {row.run_id: (row[1], row.problem, row.remark) for row in rows}


def test_every_test_is_evaluated_again_to_the_last_bit(
    tested: tuple[Plant, tuple[ReducerTestOutcome, ...]],
) -> None:
    plant, outcomes = tested
    assert {each.name for each in outcomes} == set(TESTS) - {"full"}
    found = kept(plant, "serial")
    for outcome in outcomes:
        values, problem, remark = found[outcome.run.run_id]
        assert (problem, remark) == ("", "")
        expected = {}
        for each in outcome.quantities:
            expected[f"{each.key} value"] = each.value
            expected[f"{each.key} expanded_uncertainty"] = each.expanded_uncertainty
            if each.limit:
                expected[f"{each.key} passes"] = float(each.verdict == "pass")
        assert json.loads(values) == expected, outcome.name
    assert any("passes" in name for name in json.loads(found[outcomes[2].run.run_id][0]))


def test_results_that_were_changed_after_sealing_are_found(
    tested: tuple[Plant, tuple[ReducerTestOutcome, ...]],
) -> None:
    """This also applies to a test with a recording, because its original results are sealed."""
    plant, outcomes = tested
    run_id = outcomes[0].run.run_id
    found = plant.run(run_id)
    manifest = sha256_of_file(outcomes[0].run.folder / MANIFEST)
    task = RunTask(
        found.bench_key, run_id, found.kind, plant.folders_url, SealedFolder(found.url, manifest)
    )
    assert reevaluate_run(task).problem == ""
    file = Path(found.url.removeprefix("file://")) / "results.json"
    content = file.read_bytes()
    file.write_bytes(content + b" ")
    try:
        assert "results.json was changed after sealing" in reevaluate_run(task).problem
    finally:
        file.write_bytes(content)


@pytest.mark.nightly
def test_processes_find_the_same_bits(
    tested: tuple[Plant, tuple[ReducerTestOutcome, ...]], tmp_path: Path
) -> None:
    plant, _ = tested
    url = plant.url.render_as_string(hide_password=False)
    options = ("--scheduler", "processes", "--label", "processes", "--kind", "test", "--plant", url)
    done = run("plant", "reevaluate", *options, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert f"1 run: {BUDGETS_ONLY}" in " ".join(done.stdout.split())
    assert kept(plant, "processes") == kept(plant, "serial")


def test_only_a_changed_evaluation_changes_values_and_they_stand_beside_the_old(
    tested: tuple[Plant, tuple[ReducerTestOutcome, ...]],
) -> None:
    plant, outcomes = tested
    answer = differences(plant, "serial")
    rows = answer.rows()
    assert {row["run"] for row in rows} == {OTHER_RULE}
    lost = next(row for row in rows if row["what"] == "lost_motion value")
    (loops,) = (each for each in outcomes if each.name == "hysteresis")
    assert lost["earlier"] == next(e.value for e in loops.quantities if e.key == "lost_motion")
    assert lost["now"] != lost["earlier"]
    assert lost["change"] == lost["now"] - lost["earlier"]
    assert "stiffness value" not in {row["what"] for row in rows}  # no rule of lost motion in it
    assert answer.facts["runs with a change"] == 1


def test_a_folder_without_recording_says_what_was_evaluated(
    tested: tuple[Plant, tuple[ReducerTestOutcome, ...]],
) -> None:
    plant, _ = tested
    values, problem, remark = kept(plant, "serial")[BEFORE]
    assert (problem, remark) == ("", BUDGETS_ONLY)
    # A short test that lies within its limit passes conditionally, now as then.
    assert json.loads(values)["backlash passes"] == 0.0
    assert differences(plant, "serial").notes == (f"1 run: {BUDGETS_ONLY}",)


def test_what_the_chains_and_the_bench_contribute_is_recorded(
    tested: tuple[Plant, tuple[ReducerTestOutcome, ...]],
) -> None:
    _, outcomes = tested
    recorded = {each.name: recording_of(each) for each in outcomes}
    assert recorded["hysteresis"].known.twists().keys() == {"input", "output"}
    assert recorded["hysteresis"].known.empty is None
    for name in ("no-load", "efficiency"):
        assert recorded[name].known.tares(REDUCER.signed_ratio).keys() == {"input", "output"}
        read = recorded[name].recording.stated["input"]
        stated = next(each for each in outcomes if each.name == name).recording.stated["input"]
        assert (read.standard_uncertainty_nm == stated.standard_uncertainty_nm).all()
        assert [each.shared for each in read.components] == [
            each.shared for each in stated.components
        ]
    assert recorded["starting"].known.twist is None
    loaded = recorded["hysteresis"].recording.loops[0].recording
    assert (loaded.output_parts.standard_uncertainty_nm > 0.0).all()
