"""A short test is marked short, passes conditionally at best, and never states a smaller U."""

from dataclasses import replace
from pathlib import Path

import pytest
from tests.support.draws import nightly

from torquebench.bench.description import BenchDescription, default_bench
from torquebench.campaign.reducers import comparison
from torquebench.campaign.reducers.settings import ReducerTestSettings
from torquebench.campaign.reducers.tests import run_reducer_test
from torquebench.procedures.reducers.loop import HysteresisSettings, even_positions
from torquebench.records import RunFolder
from torquebench.reducers import load_reducer
from torquebench.reports.page import render_page
from torquebench.reports.reducers.report import reducer_page
from torquebench.station import Station
from torquebench.uncertainty import Verdict

REDUCER = load_reducer("rv-40e")
KNOWN_TWIST = 1e-3


def bench() -> BenchDescription:
    described = default_bench()
    settings = described.bench.model_copy(update={"reducer_ratio": REDUCER.ratio})
    driver = {**described.driver, "reducer": "rv-40e"}
    return described.model_copy(update={"driver": driver, "bench": settings})


@pytest.mark.nightly
def test_short_loops_are_marked_and_less_certain_than_full_ones(tmp_path: Path) -> None:
    short = replace(ReducerTestSettings.short(), twist_arcmin_per_nm=KNOWN_TWIST)
    loops = HysteresisSettings(loops=1, positions_deg=even_positions(3), loop_s=20.0)
    full = replace(
        ReducerTestSettings().with_plans({"hysteresis": loops}), twist_arcmin_per_nm=KNOWN_TWIST
    )
    with Station.open(bench(), tmp_path) as station:
        look = run_reducer_test(station, "hysteresis", REDUCER, short, serial="S1")
        whole = run_reducer_test(station, "hysteresis", REDUCER, full, serial="S1")
        (entered,) = station.registry.runs(kind="test-hysteresis-short")
        assert comparison.tested_specimen(entered).short
        (entered,) = station.registry.runs(kind="test-hysteresis")
        assert not comparison.tested_specimen(entered).short
    assert look.short
    assert not whole.short
    (outcome,), (other,) = look.outcomes, whole.outcomes
    certain = {each.key: each.expanded_uncertainty for each in other.quantities}
    for each in outcome.quantities:
        # What the chain adds goes by the loop's slope, which two tests find to some tenths of a %.
        assert each.expanded_uncertainty > 0.99 * certain[each.key], each.key
    assert any(each.verdict is Verdict.CONDITIONAL_PASS for each in outcome.quantities)
    assert not any(each.verdict is Verdict.PASS for each in outcome.quantities)
    assert any("too few to show" in remark for remark in outcome.remarks)
    assert not any("too few to show" in remark for remark in other.remarks)
    results = RunFolder.open(outcome.run.folder).results
    assert results["short"] is True
    stiffness = next(row for row in results["quantities"] if row["key"] == "stiffness")
    names = {line["name"] for line in stiffness["budget"]["contributions"]}
    assert "positions not sampled" in names
    page = render_page(reducer_page(look))
    assert "Short reducer test" in page
    assert "short test: a first impression" in page
    assert "short" not in render_page(reducer_page(whole)).lower()


@pytest.mark.parametrize("name", [nightly("no-load"), "efficiency"])
def test_a_cold_reducer_counts_in_u(name: str, tmp_path: Path) -> None:
    settings = ReducerTestSettings.short()
    with Station.open(bench(), tmp_path) as station:
        (outcome,) = run_reducer_test(station, name, REDUCER, settings).outcomes
    raw = {each.key: each.estimate for each in outcome.result.quantities()}
    for each in outcome.quantities:
        assert each.expanded_uncertainty > raw[each.key].expanded_uncertainty()
    assert any("wasn't warmed up" in remark for remark in outcome.remarks)
    assert outcome.title.endswith("short test")
