"""Where an adaptive calibration measures next, on which branch, and when it ends."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.calibration import (
    CalibrationData,
    Placement,
    Step,
    even_points,
    extension_steps,
    load_profile,
    place_points,
)
from torquebench.calibration.profile import Profile
from torquebench.errors import InputError

RANGE_NM = 100.0
TEMPLATE = Step(kind="point", series=4, index=3, nominal_nm=1.0, branch=1, duration_s=0.5)


def measured(points: int, noise_nm: float = 0.005) -> CalibrationData:
    """A loop up and down in both directions of a chain with a curved error and a kink."""
    half = points // 4
    rising = np.linspace(RANGE_NM / half, RANGE_NM, half)
    loop = np.concatenate([rising, rising[::-1]])
    branch = np.concatenate([np.ones(half), -np.ones(half)])
    standard, branch = np.concatenate([loop, -loop]), np.concatenate([branch, branch])
    error = 0.3 * (standard / RANGE_NM) ** 2 + 0.1 * np.maximum(standard / RANGE_NM - 0.6, 0.0)
    noise = np.random.default_rng(7).normal(0.0, noise_nm, standard.size)
    series = np.repeat([1, 2], 2 * half)
    reading = np.clip(standard - error + noise, -RANGE_NM, RANGE_NM)
    return CalibrationData(reading, standard, series, branch, RANGE_NM)


def test_the_profile_begins_with_a_coarse_series_in_both_directions() -> None:
    profile = load_profile("adaptive")
    points = [step for step in profile.staircase(RANGE_NM) if step.recorded]
    assert len(points) == 24
    assert {(np.sign(step.nominal_nm), step.branch) for step in points if step.nominal_nm} == {
        (1, 1), (1, -1), (-1, 1), (-1, -1)
    }  # fmt: skip
    assert profile.adaptive is not None
    assert profile.adaptive.points == 120


def test_other_profiles_keep_the_hash_that_they_had() -> None:
    settings = load_profile("rapid-in-situ").model_dump(mode="json")
    del settings["adaptive"]
    assert Profile.model_validate(settings).sha256 == load_profile("rapid-in-situ").sha256
    adaptive = load_profile("adaptive")
    assert adaptive.with_options(points=60).sha256 != adaptive.sha256


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"points": 12}, "the coarse series alone has 24"),
        ({"rising_only": True}, "rising_only"),
        ({"target_percent": 0.0}, "target_percent"),
    ],
)
def test_options_that_an_adaptive_profile_cannot_have(options: dict, named: str) -> None:
    with pytest.raises(InputError, match=named):
        load_profile("adaptive").with_options(**options)


def test_another_profile_has_no_target() -> None:
    with pytest.raises(InputError, match="target_percent"):
        load_profile("staircase").with_options(target_percent=0.1)


def test_an_adaptive_profile_needs_decreasing_torque() -> None:
    document = load_profile("adaptive").model_dump(mode="python")
    document["positions"] = [{"series": ["up"]}]
    with pytest.raises(ValueError, match="one up-down series"):
        Profile.model_validate(document)


@given(
    st.lists(
        st.tuples(st.floats(-RANGE_NM, RANGE_NM), st.sampled_from([1, -1])),
        min_size=1,
        max_size=30,
        unique=True,
    )
)
def test_every_point_is_met_on_its_branch_of_the_full_loop(
    wanted: list[tuple[float, int]],
) -> None:
    target = np.array([torque for torque, _ in wanted])
    branch = np.array([side for _, side in wanted], dtype=np.int8)
    steps = extension_steps((target, branch), TEMPLATE, (1, -1), RANGE_NM)
    recorded = [(step.nominal_nm, step.branch) for step in steps if step.recorded]
    assert sorted(recorded) == sorted(wanted)
    assert [step.series for step in steps] == sorted(step.series for step in steps)
    assert {step.series for step in steps} == {5, 6}
    turned = 0.0
    for before, after in itertools.pairwise([TEMPLATE, *steps]):
        if after.series != before.series:
            turned = 0.0
        if after.branch > 0:
            assert abs(after.nominal_nm) >= (abs(before.nominal_nm) if turned else 0.0)
        turned = max(turned, abs(after.nominal_nm))
        if after.branch < 0:
            assert turned == RANGE_NM
    assert steps[-1].nominal_nm == 0.0


def test_points_are_placed_where_the_model_is_least_certain() -> None:
    settings = load_profile("adaptive").with_options(points=36).adaptive
    assert settings is not None
    found = place_points(measured(24), settings.model_copy(update={"model": "polynomial-3"}))
    assert found.nominal_nm.size == 12
    assert found.predicted_percent < found.now_percent
    assert set(found.branch.tolist()) <= {1, -1}


def test_nothing_is_placed_once_the_target_is_reached_or_the_budget_used() -> None:
    settings = load_profile("adaptive").with_options(target_percent=5.0).adaptive
    assert settings is not None
    settings = settings.model_copy(update={"model": "polynomial-3"})
    reached = place_points(measured(24), settings)
    assert reached.nominal_nm.size == 0
    placement = Placement.of([reached.round(24)], settings)
    assert (placement.reason, placement.points) == ("target", 24)

    used = place_points(measured(24), settings.model_copy(update={"points": 24}))
    assert used.nominal_nm.size == 0
    missed = settings.model_copy(update={"points": 24, "target_percent": 1e-6})
    placement = Placement.of([place_points(measured(24), missed).round(24)], missed)
    assert placement.reason == "budget"
    assert placement.sentence.endswith("budget of 24 points used, target 1e-06 % FS not reached")


@given(st.integers(0, 60), st.sampled_from([(1,), (-1,), (1, -1), (-1, 1)]))
def test_a_rehearsal_has_as_many_points_as_the_budget(count: int, signs: tuple[int, ...]) -> None:
    target, branch = even_points(RANGE_NM, count, signs)
    assert target.size == branch.size == count
    assert np.all(np.abs(target) < RANGE_NM)
    assert set(np.sign(target).tolist()) <= {float(sign) for sign in signs}
