"""The generator of chains with a known truth, and the benchmark that compares models on them."""

from importlib import import_module
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
import pytest
from benchmarks import compensation as benchmark
from benchmarks.__main__ import QUESTIONS
from benchmarks.compensation_contenders import DEFAULT, contenders
from benchmarks.compensation_results import (
    accuracy_figures,
    comparison_rows,
    family_rows,
    interval_figures,
)
from benchmarks.reporting import AIMS, Aim, aim, judge, write_section
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console
from tests.pictures import charts
from tests.support.chain_shapes import SHAPES
from tests.support.chains import FAMILIES, REPEATABILITY, Noise, known_form, make_chain, path

QUICK = (DEFAULT, "known form", "raw reading", "radial-basis", "polynomial-2 per direction")


@settings(max_examples=20)
@given(family=st.sampled_from(sorted(FAMILIES)), seed=st.integers(0, 5000))
def test_the_same_seed_gives_the_same_chain(family: str, seed: int) -> None:
    one, other = make_chain(family, seed), make_chain(family, seed)
    assert one == other
    np.testing.assert_array_equal(one.calibration(20).X, other.calibration(20).X)
    assert make_chain(family, seed + 1) != one
    assert not np.array_equal(one.calibration(20).X, one.calibration(20, repeat=1).X)


@settings(max_examples=20)
@given(family=st.sampled_from(sorted(FAMILIES)), seed=st.integers(0, 5000))
def test_loops_close_at_full_scale_and_readings_stay_one_to_one(family: str, seed: int) -> None:
    chain = make_chain(family, seed)
    ends = np.array([-2000.0, 2000.0])
    up, down = (chain.reading(ends, np.full(2, b)) for b in (1.0, -1.0))
    np.testing.assert_allclose(up, down, atol=1e-9)
    for branch in (1.0, -1.0):
        torque = np.linspace(5.0, 2000.0, 300)
        assert np.all(np.diff(chain.reading(torque, np.full(300, branch))) > 0)


@pytest.mark.parametrize("points", [50, 53, 200])
def test_the_path_goes_up_and_down_in_both_directions(points: int) -> None:
    torque, branch, direction = path(points, 2000.0)
    assert torque.size == branch.size == direction.size == points
    assert torque.max() == 2000.0
    assert torque.min() == -2000.0
    grows = np.diff(np.abs(np.concatenate([[0.0], torque]))) > 0
    np.testing.assert_array_equal(grows, branch > 0)


def test_the_reference_family_has_the_difficulty_it_was_made_for() -> None:
    raw, bound = [], []
    for seed in range(25):
        chain = make_chain("reference", seed)
        data, dense = chain.calibration(50), chain.dense(200)
        raw.append(np.max(np.abs(dense.X[:, 0] - dense.torque_nm)) / 20)
        error = known_form(chain, data).predict(dense.X) - dense.torque_nm
        bound.append([np.max(np.abs(error)) / 20, np.sqrt(np.mean(error**2)) / 20])
    assert np.median(raw) == pytest.approx(0.66, abs=0.1)  # % of full scale
    assert np.median(bound, axis=0) == pytest.approx([0.024, 0.0093], rel=0.15)


def test_the_known_form_without_noise_is_exact() -> None:
    for family in FAMILIES:
        chain = make_chain(family, 3)
        data = chain.calibration(80)
        truth = chain.additional_torque(data.standard_nm, data.X[:, 1])
        reading = data.standard_nm - truth
        exact = type(data)(np.column_stack([reading, data.X[:, 1:]]), data.standard_nm)
        dense = chain.dense(100)
        error = known_form(chain, exact).predict(dense.X) - dense.torque_nm
        assert np.max(np.abs(error)) < 1e-6, family


def test_with_constants_unknown_the_known_form_does_worse() -> None:
    chain = make_chain("reference", 12)
    data, dense = chain.calibration(200), chain.dense(100)
    told, untold = (
        float(np.std(known_form(chain, data, nonlinear=n).predict(dense.X) - dense.torque_nm))
        for n in (False, True)
    )
    assert told < untold


@pytest.mark.parametrize("noise", [Noise(), Noise(freedom=3.0), Noise(outliers=0.06)])
def test_every_noise_has_the_same_standard_deviation(noise: Noise) -> None:
    drawn = noise.draw(400_000, np.random.default_rng(1))
    assert np.std(drawn) == pytest.approx(REPEATABILITY, rel=0.1)
    weights = noise.weights(np.array([0.0, 10 * REPEATABILITY]))
    assert weights[1] <= weights[0]


def test_shapes_of_unit_amplitude_stay_within_their_size() -> None:
    x = np.linspace(-1, 1, 101)
    for name in ("smooth-step", "rational-step", "triangle", "bump", "resonance", "packet", "loop"):
        constants = {"smooth-step": (0.01,), "rational-step": (0.01,), "packet": (0.1, 0.1, 0.2)}
        value = SHAPES[name](x, np.ones(101), *constants.get(name, (0.3, 0.7)))
        assert np.max(np.abs(value)) <= 1.0 + 1e-9


@pytest.mark.nightly
def test_the_comparison_ranks_the_bound_first_and_the_raw_reading_last() -> None:
    field = [contender for contender in contenders() if contender.name in QUICK]
    results = benchmark.compare(
        Console(quiet=True), field, ["reference", "quadratic"], range(2), 50
    )
    headings, rows = comparison_rows(results)
    by_name = {row[0]: dict(zip(headings, row, strict=True)) for row in rows}
    rms = {name: float(row["RMS, % FS"]) for name, row in by_name.items()}
    assert min(rms, key=lambda name: rms[name]) == "known form"
    assert max(rms, key=lambda name: rms[name]) == "raw reading"
    assert by_name["raw reading"]["coverage of the curve"] == "–"
    _, by_family = family_rows({50: results}, ["reference", "quadratic"])
    assert [row[0] for row in by_family] == ["reference", "quadratic"]
    figures = accuracy_figures(results, ["reference", "quadratic"], 50)
    assert figures.keys() >= {
        "RMS / bound, all families, 50 points",
        "RMS / bound, quadratic, 50 points",
    }
    figures |= interval_figures(results, [DEFAULT, "radial-basis"], 50)
    values = {name: value for name, (value, _) in figures.items()}
    text, met = judge(Console(quiet=True), "compensation", values)
    assert met == ("MISSED" not in text)
    assert text.count("| met |") + text.count("| MISSED |") == len(figures)


def test_a_figure_is_judged_only_where_chance_leaves_a_verdict() -> None:
    figures = {f"coverage, {kind}, all, 50 points": 0.92 for kind in ("a", "b", "c")}
    names = list(figures)
    allowed = {names[0]: 0.005, names[1]: 0.015, names[2]: 0.03}
    text, met = judge(Console(quiet=True), "compensation", figures, allowed)
    assert not met
    assert "0.93 to 0.97 ± 0.005 | MISSED" in text
    assert "0.93 to 0.97 ± 0.015 | met" in text
    assert names[2] not in text
    assert "(1 not judged: too few chains)" in text


def test_an_aim_is_met_inside_its_interval_only() -> None:
    assert Aim(0.93, 0.97).met(0.95)
    assert not Aim(0.93, 0.97).met(0.92)
    assert Aim(0.93, 0.97).met(0.92, allowed=0.02)
    assert not Aim(high=1.0).met(float("nan"))
    assert aim("rotating", "RMS / known form, arctangent").high == 3.0
    assert aim("rotating", "RMS / known form, smooth").high == 2.0


def test_every_benchmark_with_aims_can_be_run() -> None:
    assert AIMS.keys() <= QUESTIONS.keys()
    for name in QUESTIONS:
        assert callable(import_module(f"benchmarks.{name}").main), name


def test_the_section_is_replaced_and_the_rest_kept(tmp_path: Path) -> None:
    document = tmp_path / "docs" / "benchmarks.md"
    write_section(document, "models", "first")
    assert document.read_text().startswith("# Benchmarks")
    document.write_text(document.read_text() + "\n## Another\n")
    write_section(document, "models", "second")
    text = document.read_text()
    assert "first" not in text
    assert text.count("<!-- models: begin -->") == text.count("<!-- models: end -->") == 1
    assert text.rstrip().endswith("## Another")


def test_charts_show_what_the_tables_say(tmp_path: Path) -> None:
    """A chart that isn't drawn again after its table changed is found."""
    for chart in charts.draw(tmp_path):
        heading = escape(charts.said(charts.CHARTS[chart.stem][0]))
        assert heading in chart.read_text(encoding="utf-8")
        assert heading in (charts.FOLDER / chart.name).read_text(encoding="utf-8")


def test_every_other_library_takes_part_and_follows_the_chain() -> None:
    chain = make_chain("quadratic", 0)
    data, dense = chain.calibration(50), chain.dense(50)
    for contender in contenders():
        if contender.own or contender.name == "raw reading":
            continue
        torque, std, _scatter = contender.fit(chain, data)(dense.X)
        assert np.sqrt(np.mean((torque - dense.torque_nm) ** 2)) < 3.0, contender.name
        assert std is None or np.all(std >= 0)
