"""Contradictions between points: found wherever they begin, and none made up on healthy benches."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from torquebench.calibration import (
    CalibrationData,
    Plausibility,
    Profile,
    find_contradictions,
    find_split,
    load_profile,
)
from torquebench.errors import InputError
from torquebench.twin import BenchTwin, Preset, Side, TwinParameters

LIMITS = Plausibility()
PROFILE = load_profile("rapid-in-situ")


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
    )


def kinds(data: CalibrationData) -> set[str]:
    return {each.kind for each in find_contradictions(data, LIMITS)}


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


def slipping(data: CalibrationData, from_here: np.ndarray) -> CalibrationData:
    """A clamp that gives way: above 40 % of the range no more reaches the standard."""
    most = 0.4 * data.range_nm
    held = np.clip(data.standard_nm, -most, most)
    return replace(data, standard_nm=np.where(from_here, held, data.standard_nm))


def slipped(data: CalibrationData, from_here: np.ndarray) -> CalibrationData:
    """A clamp that has slipped once: 1 % of the range is lost on the way to the standard."""
    lost = 0.01 * data.range_nm * np.sign(data.standard_nm)
    return replace(data, standard_nm=np.where(from_here, data.standard_nm - lost, data.standard_nm))


FAULTS: dict[str, Fault] = {
    "standard's span + 3 %": span("standard_nm", 1.03),
    "standard's span - 3 %": span("standard_nm", 0.97),
    "module's span - 3 %": span("reading_nm", 0.97),
    "another range of the standard": span("standard_nm", 0.5),
    "standard's sign": span("standard_nm", -1.0),
    "module's sign": span("reading_nm", -1.0),
    "standard's zero + 0.5 % FS": zero("standard_nm", 0.5),
    "module's zero - 0.5 % FS": zero("reading_nm", -0.5),
    "stuck standard": stuck("standard_nm"),
    "stuck module": stuck("reading_nm"),
    "slipped clamp": slipped,
}
PLACES = (0, 1, 2, 3, 4, 5, 8, 20, 45, 49, 50, 51, 60, 90, 97, 99, 100, 101, 104, 120, 149, 150)
PLACES = (*PLACES, 151, 170, 190, 194)


def faulty() -> Iterator[tuple[str, int, CalibrationData]]:
    for preset, seed, side in (("nominal", 3, "output"), ("worn", 4, "input")):
        data = healthy(preset, seed, side)
        for name, fault in FAULTS.items():
            for first in PLACES:
                if name.startswith(("stuck", "standard's zero", "module's zero")) and not first:
                    continue  # that is another bench, not a change
                try:
                    yield name, first, fault(data, np.arange(len(data)) >= first)
                except InputError:  # beyond the range: refused before anything is fitted
                    continue


def test_a_fault_is_found_wherever_it_begins() -> None:
    missed = [(name, first) for name, first, data in faulty() if not kinds(data)]
    assert missed == []


@pytest.mark.parametrize("side", ["input", "output"])
@pytest.mark.parametrize("preset", ["nominal", "worn"])
def test_healthy_benches_contradict_nothing(preset: Preset, side: Side) -> None:
    found = {seed: kinds(healthy(preset, seed, side)) for seed in range(25)}
    assert {seed: each for seed, each in found.items() if each} == {}


@pytest.mark.parametrize("name", ["small-torques", "reversing", "staircase"])
def test_healthy_benches_contradict_nothing_by_other_profiles(name: str) -> None:
    profile = load_profile(name)
    limits = profile.plausibility
    for seed in range(6):
        for preset in ("nominal", "worn"):
            data = healthy(preset, seed, "output", profile)
            assert find_contradictions(data, limits) == ()


@pytest.mark.parametrize("first", [4, 8, 30, 50, 75, 110, 150, 180])
@pytest.mark.parametrize("part", ["standard_nm", "reading_nm"])
def test_a_change_of_span_is_named_with_place_and_size(part: str, first: int) -> None:
    data = healthy()
    changed = span(part, 0.97)(data, np.arange(len(data)) >= first)
    split = find_split(changed)
    assert split is not None
    assert abs(split.first - first) <= 1
    expected = -3.0 if part == "standard_nm" else 3.0
    assert split.span_percent == pytest.approx(expected, abs=max(split.span_expanded_percent, 0.3))
    assert split.series == changed.series[split.first]


def test_a_jump_of_zero_is_told_from_a_change_of_span() -> None:
    data = healthy()
    jumped = zero("standard_nm", 0.5)(data, np.arange(len(data)) >= 130)
    (split,) = [each for each in find_contradictions(jumped, LIMITS) if each.kind == "split"]
    assert "a zero has moved" in split.cause
    assert "before point 131 of 200" in split.found
    changed = span("standard_nm", 0.97)(data, np.arange(len(data)) >= 130)
    (split,) = [each for each in find_contradictions(changed, LIMITS) if each.kind == "split"]
    assert "the scale of the standard or of the module has changed" in split.cause


def test_outliers_are_no_contradiction() -> None:
    for rows in ((60,), (4,), (195,), (20, 140)):
        reading = healthy().reading_nm.copy()
        for error_nm in (4.0, 30.0):
            reading[list(rows)] += error_nm
            assert kinds(replace(healthy(), reading_nm=reading)) == set()


def test_a_slipping_clamp_is_found_while_torque_is_large() -> None:
    data = healthy()
    for first in (0, 15, 30, 60, 110, 160):
        assert kinds(slipping(data, np.arange(len(data)) >= first))


def test_repeated_series_that_differ_are_named() -> None:
    data = healthy("nominal", 1, "output", load_profile("reversing"))
    third = data.series == data.series.max()
    wandered = replace(data, reading_nm=data.reading_nm + np.where(third, 10.0, 0.0))
    assert {"repeats", "zero"} <= kinds(wandered)


def test_a_chain_that_changed_since_the_last_calibration_is_named() -> None:
    data = healthy()
    before = data.standard_nm * 1.005
    torque = data.standard_nm
    (found,) = find_contradictions(data, LIMITS, torque_nm=torque, before_nm=before)
    assert found.kind == "change"
    assert "0.5 % of full scale" in found.found
    assert find_contradictions(data, LIMITS, torque_nm=torque, before_nm=data.standard_nm) == ()
    unknown = np.full(len(data), np.nan)
    assert find_contradictions(data, LIMITS, torque_nm=torque, before_nm=unknown) == ()


def test_few_points_are_enough_for_nothing_but_what_they_show() -> None:
    few = CalibrationData([5.0, 10.0], [5.0, 10.0], [1, 1], [1, 1], 10.0)
    assert find_contradictions(few, LIMITS) == ()
    assert find_split(few) is None


def test_the_profile_s_limits_count() -> None:
    data = span("reading_nm", 0.97)(healthy(), np.ones(200, dtype=np.bool_))
    assert kinds(data) == {"span"}
    assert find_contradictions(data, Plausibility(span_percent=5.0)) == ()
    document = PROFILE.model_dump(mode="python")
    document["plausibility"]["span_percent"] = 5.0
    own = Profile.model_validate(document)
    assert own.sha256 != PROFILE.sha256
