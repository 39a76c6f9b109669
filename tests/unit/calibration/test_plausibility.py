"""What is said of contradictions, and the limits of size that a profile states for its bench."""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from tests.support.draws import some

from torquebench.calibration import (
    CalibrationData,
    Contradiction,
    Plausibility,
    Profile,
    examine_table,
    find_contradictions,
    infer_branch,
    load_profile,
)
from torquebench.tables import read_calibration
from torquebench.translations import translated
from torquebench.twin import BenchTwin, Preset, Side, TwinParameters

PROFILE = load_profile("rapid-in-situ").with_options(step_percent=10.0)
FIELD = Path(__file__).parent / "field"


@cache
def healthy(
    preset: Preset = "nominal", seed: int = 1, side: Side = "output", profile: Profile = PROFILE
) -> CalibrationData:
    """Return a calibration of a simulated bench: its chain, its standard, noise, re-seating."""
    twin = BenchTwin(TwinParameters.draw(preset, seed), seed, active_channels=())
    range_nm = {"input": 50.0, "output": 2000.0}[side]
    steps = [step for step in profile.staircase(range_nm) if step.recorded]
    rng = np.random.default_rng([seed, len(side)])
    nominal = np.array([step.nominal_nm for step in steps])
    # The preload has been round once; the path begins and ends without torque.
    path = np.concatenate([[0.0, range_nm, 0.0, -range_nm, 0.0], nominal])
    swept = twin.static_sweep(side, path)
    reading = (
        swept.reading_nm[5:]
        - swept.reading_nm[4]
        + 3e-5 * range_nm * rng.standard_normal(nominal.size)
    )
    standard = nominal * (1.0 + 1e-4 * rng.standard_normal())
    standard = standard + 2e-5 * range_nm * rng.standard_normal(nominal.size)
    return CalibrationData(
        reading_nm=reading,
        standard_nm=standard,
        series=np.array([step.series for step in steps]),
        branch=np.array([step.branch for step in steps]),
        range_nm=range_nm,
        nominal_nm=nominal,
        simulated=True,
        tared=True,
    )


def kinds(data: CalibrationData, limits: Plausibility = PROFILE.plausibility) -> set[str]:
    return {each.kind for each in find_contradictions(data, limits)}


Fault = Callable[[CalibrationData, np.ndarray], CalibrationData]


def span(part: str, factor: float) -> Fault:
    def spoil(data: CalibrationData, from_here: np.ndarray) -> CalibrationData:
        values = getattr(data, part)
        return replace(data, **{part: np.where(from_here, factor * values, values)})

    return spoil


def zero(part: str, percent: float) -> Fault:
    def spoil(data: CalibrationData, from_here: np.ndarray) -> CalibrationData:
        jump = np.where(from_here, percent / 100.0 * data.range_nm, 0.0)
        return replace(data, **{part: getattr(data, part) + jump})

    return spoil


def stuck(part: str) -> Fault:
    def spoil(data: CalibrationData, from_here: np.ndarray) -> CalibrationData:
        values = getattr(data, part)
        first = int(np.argmax(from_here))
        return replace(data, **{part: np.where(from_here, values[max(first - 1, 0)], values)})

    return spoil


FAULTS: dict[str, Fault] = {
    "standard's span - 3 %": span("standard_nm", 0.97),
    "module's span + 3 %": span("reading_nm", 1.03),
    "another range of the standard": span("standard_nm", 0.5),
    "standard's sign": span("standard_nm", -1.0),
    "module's sign": span("reading_nm", -1.0),
    "standard's zero + 0.5 % FS": zero("standard_nm", 0.5),
    "module's zero - 0.5 % FS": zero("reading_nm", -0.5),
    "stuck standard": stuck("standard_nm"),
    "stuck module": stuck("reading_nm"),
}


@pytest.mark.parametrize("first", some((19, 0, 4, 9, 20, 23, 30, 36), by_day=2))
def test_a_fault_of_a_bench_is_found_wherever_it_begins(first: int) -> None:
    """With the limits of its profile; a fault from the first point on is no contradiction."""
    data = healthy("worn", 4, "input")
    changes = ("stuck", "standard's zero", "module's zero")
    missed = [
        name
        for name, fault in FAULTS.items()
        if (first or not name.startswith(changes))
        and not kinds(fault(data, np.arange(len(data)) >= first))
    ]
    assert missed == []


@pytest.mark.parametrize("side", ["input", "output"])
@pytest.mark.parametrize("preset", ["nominal", "worn"])
def test_healthy_benches_contradict_nothing(preset: Preset, side: Side) -> None:
    assert {seed: kinds(healthy(preset, seed, side)) for seed in range(4)} == {
        seed: set() for seed in range(4)
    }


@pytest.mark.parametrize("name", ["reversing", "staircase", "check"])
def test_healthy_benches_contradict_nothing_by_other_profiles(name: str) -> None:
    profile = load_profile(name)
    for seed in range(2):
        for preset in ("nominal", "worn"):
            data = healthy(preset, seed, "output", profile)  # type: ignore[arg-type]
            assert find_contradictions(data, profile.plausibility) == ()


def test_size_alone_is_no_contradiction() -> None:
    """A wrong span, a zero, spans that differ, an open loop: limits that only a profile states."""
    data = healthy()
    u = data.standard_nm / data.range_nm
    for change, kind in (
        (0.03 * data.standard_nm, "span"),
        (np.full(len(data), 10.0), "zero"),
        (np.where(u > 0, 0.01, 0.0) * data.standard_nm, "directions"),
        (20.0 * data.branch * np.sign(u) * (1.0 - np.abs(u)), "loop"),
    ):
        changed = replace(data, reading_nm=data.reading_nm + change)
        assert find_contradictions(changed) == ()
        assert kind in kinds(changed)


def test_rows_are_those_of_the_file() -> None:
    rows = np.arange(len(healthy())) + 7
    data = replace(healthy(), row=rows)
    changed = zero("standard_nm", 0.5)(data, np.arange(len(data)) >= 6)
    (found,) = find_contradictions(changed)
    assert found.kind == "zero"
    assert found.found.startswith("rows 13 to 46 (series 1, ")
    assert re.search(r"by \+(9\.9|10)\d? N·m ± 0\.\d+ N·m", found.found)
    assert found.cause == "A zero has moved there."
    named = replace(changed, table=np.array(["warm.csv"] * len(data)))
    assert find_contradictions(named)[0].found.startswith("warm.csv, rows 13 to 46")


def test_field_cases_name_the_series_that_differs() -> None:
    for name, expected in (("f5", "rows 10 to 17"), ("f5b", "rows 10 to 13")):
        (found,) = find_contradictions(read_calibration(next(FIELD.glob(f"{name}_*.csv"))))
        assert found.kind == "scale"
        assert found.found.startswith(expected)
        assert "-2 % ± " in found.found


@pytest.mark.parametrize("name", ["f2", "f6", "f7", "f9", "f10", "f11"])
def test_healthy_field_cases_contradict_nothing(name: str) -> None:
    assert find_contradictions(read_calibration(next(FIELD.glob(f"{name}_*.csv")))) == ()


def test_a_table_with_one_column_reversed_says_how_to_reverse_it() -> None:
    data = healthy()
    (found,) = find_contradictions(replace(data, reading_nm=-data.reading_nm))
    assert found.kind == "sign"
    assert "--column reading=-HEADER" in found.cause


def test_an_untared_table_is_examined_from_its_own_zeros() -> None:
    """A zero that differs over the series is no contradiction where each has its own."""
    rising = np.linspace(0.0, 100.0, 11)
    torque = np.tile(np.concatenate([rising, rising[-2::-1]]), 3)
    series = np.repeat([1, 2, 3], 21)
    branch = np.tile([1] * 11 + [-1] * 10, 3)
    noise = 0.01 * np.random.default_rng(1).normal(size=63)
    reading = 1.002 * torque + noise + np.array([0.0, 5.0, 3.0, 8.0])[series]
    data = CalibrationData(reading, torque, series, branch, 100.0)
    assert find_contradictions(data) == ()
    inside = replace(data, reading_nm=reading + np.where(np.arange(63) >= 30, 0.5, 0.0))
    assert examine_table(inside).disagreements[0].first == 30


def test_repeats_that_agree_exactly_from_their_own_zeros_are_examined() -> None:
    """Invented and rounded tables have no scatter at all."""
    standard = np.tile([0.0, 25.0, 50.0, 75.0, 100.0, 75.0, 50.0, 25.0, 0.0], 3)
    series = np.repeat([1, 2, 3], 9)
    reading = 0.999 * standard + np.repeat([0.0, 0.25, -0.5], 9)
    table = CalibrationData(reading, standard, series, infer_branch(standard, series), 100.0)
    assert examine_table(table).from_zeros


def test_a_chain_that_changed_since_the_last_calibration_is_named() -> None:
    data, limits = healthy(), PROFILE.plausibility
    before, torque = data.standard_nm * 1.005, data.standard_nm
    (found,) = find_contradictions(data, limits, torque_nm=torque, before_nm=before)
    assert found.kind == "change"
    assert "0.5 % of full scale" in found.found
    assert find_contradictions(data, limits, torque_nm=torque, before_nm=torque) == ()
    unknown = np.full(len(data), np.nan)
    assert find_contradictions(data, limits, torque_nm=torque, before_nm=unknown) == ()


def test_a_contradiction_is_read_back_from_a_model_file() -> None:
    data = zero("standard_nm", 0.5)(healthy(), np.arange(len(healthy())) >= 6)
    (found,) = find_contradictions(data)
    back = Contradiction.of_text(str(found))
    assert (back.found, back.allowed, back.cause) == (found.found, found.allowed, found.cause)


def test_the_profile_s_limits_count() -> None:
    data = span("reading_nm", 0.97)(healthy(), np.ones(len(healthy()), dtype=np.bool_))
    assert kinds(data) == {"span"}
    assert find_contradictions(data, Plausibility(span_percent=5.0)) == ()
    document = PROFILE.model_dump(mode="python")
    document["plausibility"]["span_percent"] = 5.0
    assert Profile.model_validate(document).sha256 != PROFILE.sha256


def test_settings_of_version_0_2_0_are_read() -> None:
    document = PROFILE.model_dump(mode="json")
    document["plausibility"] |= {"split_percent": 0.06, "scatter_percent": 0.15}
    assert Profile.model_validate(document) == PROFILE


def test_a_contradiction_is_chinese_as_a_whole() -> None:
    (found,) = find_contradictions(
        zero("standard_nm", 0.5)(healthy(), np.arange(len(healthy())) >= 6)
    )
    for sentence in (found.found, found.allowed, found.cause):
        assert translated(sentence, "zh") != sentence
