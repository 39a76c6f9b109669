import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.calibration import (
    Profile,
    available_profiles,
    load_profile,
)
from torquebench.errors import InputError

SMALLEST = """
name = "own"
title = "Own profile"
source = "the laboratory"
[loading]
pattern = "ladder"
steps_percent = [50.0, 100.0]
duration_s = 1.0
settle_limit_s = 2.0
directions = ["clockwise"]
[[positions]]
series = ["up-down"]
"""


def points(steps):
    return [step for step in steps if step.recorded]


def percents(steps, range_nm=100.0):
    return [round(100 * step.nominal_nm / range_nm, 9) for step in steps]


@pytest.mark.parametrize("name", available_profiles())
def test_every_packaged_profile_is_unverified_and_stays_within_its_range(name):
    profile = load_profile(name)
    assert profile.name == name
    assert not profile.verified
    assert len(profile.sha256) == 64
    steps = profile.staircase(2000.0, np.random.default_rng(1))
    assert max(abs(step.nominal_nm) for step in steps) <= 2000.0
    for number in {step.series for step in points(steps)}:
        indices = [step.index for step in points(steps) if step.series == number]
        assert indices == list(range(len(indices)))


def test_rapid_calibration_goes_up_and_down_in_both_directions():
    steps = points(load_profile("rapid-in-situ").staircase(50.0))
    up = [step for step in steps if step.series == 1 and step.branch == 1]
    down = [step for step in steps if step.series == 1 and step.branch == -1]
    assert percents(up, 50.0) == [2.0 * k for k in range(1, 51)]
    assert percents(down, 50.0) == [2.0 * k for k in range(49, -1, -1)]
    assert [step.nominal_nm for step in steps[100:]] == [-step.nominal_nm for step in steps[:100]]
    assert {step.duration_s for step in steps} == {0.5}


def test_rapid_calibration_takes_its_zero_once_after_preloading_both_directions():
    kinds = [step.kind for step in load_profile("rapid-in-situ").staircase(50.0)]
    assert kinds[:5] == ["preload"] * 4 + ["zero"]
    assert set(kinds[5:]) == {"point"}


def test_rising_only_is_the_sources_series():
    profile = load_profile("rapid-in-situ").with_options(rising_only=True)
    steps = points(profile.staircase(50.0))
    assert len(steps) == 100
    assert {step.branch for step in steps} == {1}


def test_staircase_is_two_rising_series_then_pairs_in_further_positions():
    steps = load_profile("staircase").staircase(2000.0)
    clockwise = [step for step in points(steps) if step.series in (1, 2)]
    assert percents(clockwise, 2000.0) == [10, 20, 30, 40, 50, 60, 80, 100, 0] * 2
    assert {step.position_deg for step in clockwise} == {0.0}
    positions = [(step.position_deg, step.change) for step in steps if step.change != "none"]
    assert positions == [(120.0, "rotation"), (240.0, "rotation")]
    preloads = [step for step in steps if step.kind == "preload" and step.nominal_nm != 0]
    assert len(preloads) == 3 + 3 + 4 * 1
    series = {step.series for step in points(steps)}
    assert series == set(range(1, 9))
    zeros = [step for step in steps if step.kind == "zero"]
    assert [step.series for step in zeros] == sorted(series)


def test_reversing_cycles_pass_both_zeros():
    steps = [
        step for step in points(load_profile("reversing").staircase(100.0)) if step.series == 2
    ]
    path = percents(steps)
    up = [10.0 * k for k in range(1, 11)]
    down = [*up[-2::-1], 0.0]
    assert path == [*up, *down, *[-percent for percent in up], *[-percent for percent in down]]
    assert load_profile("reversing").with_options(repeats=5).staircase(1.0)[-1].series == 5


def test_verification_groups_are_fresh_and_off_the_grid():
    profile = load_profile("verification")
    steps = points(profile.staircase(100.0, np.random.default_rng(3)))
    groups = [[step.nominal_nm for step in steps if step.series == k] for k in range(1, 11)]
    assert [len(group) for group in groups] == [50] * 10
    assert len({tuple(group) for group in groups}) == 10
    off = np.abs(np.array(groups) / 2.0 - np.rint(np.array(groups) / 2.0))
    assert off.min() >= 0.25 - 1e-12
    again = points(profile.staircase(100.0, np.random.default_rng(3)))
    assert again == steps


@given(
    points_of_group=st.integers(4, 120),
    groups=st.integers(1, 4),
    seed=st.integers(0, 2**32 - 1),
)
def test_verification_of_any_size_rises_and_falls_in_both_directions(points_of_group, groups, seed):
    profile = load_profile("verification").with_options(points=points_of_group, groups=groups)
    steps = profile.staircase(1.0, np.random.default_rng(seed))
    for number in range(1, groups + 1):
        group = [step for step in steps if step.series == number and step.kind != "zero"]
        targets = np.array([step.nominal_nm for step in group])
        assert sum(step.recorded for step in group) == points_of_group
        for sign in (1, -1):
            side = targets[np.sign(targets) == sign]
            top = int(np.argmax(np.abs(side)))
            assert abs(side[top]) == 1.0
            assert np.all(np.diff(np.abs(side[: top + 1])) >= 0)
            assert np.all(np.diff(np.abs(side[top:])) <= 0)


@given(step=st.floats(0.5, 100.0))
def test_ladders_of_any_step_end_at_full_scale(step):
    profile = load_profile("rapid-in-situ").with_options(step_percent=step)
    rising = [each.nominal_nm for each in points(profile.staircase(1.0)) if each.branch == 1]
    half = rising[: len(rising) // 2]
    assert half[-1] == pytest.approx(1.0)
    assert np.all(np.diff(half) > 0)


def test_options_change_the_hash_and_only_where_they_exist():
    profile = load_profile("rapid-in-situ")
    assert profile.with_options().sha256 == profile.sha256
    assert profile.with_options(step_percent=5.0).sha256 != profile.sha256
    with pytest.raises(InputError, match="option groups for the profile rapid-in-situ"):
        profile.with_options(groups=3)
    with pytest.raises(InputError, match=r"loading\.step_percent = 0"):
        profile.with_options(step_percent=0.0)
    with pytest.raises(InputError, match=r"loading\.points = 2"):
        load_profile("verification").with_options(points=2)


def test_repeats_load_each_series_again():
    steps = points(load_profile("rapid-in-situ").with_options(repeats=3).staircase(1.0))
    assert [step.series for step in steps] == [k for k in range(1, 7) for _ in range(100)]


def test_own_steps_give_way_to_an_even_step():
    profile = load_profile("staircase").with_options(step_percent=20.0)
    rising = [step for step in points(profile.staircase(100.0)) if step.series == 1]
    assert percents(rising) == [20, 40, 60, 80, 100, 0]


def test_random_points_need_a_generator():
    with pytest.raises(InputError, match="without a random generator"):
        load_profile("verification").staircase(100.0)


@pytest.mark.parametrize("range_nm", [0.0, -1.0, float("inf")])
def test_a_range_must_be_above_zero(range_nm):
    with pytest.raises(InputError, match="range"):
        load_profile("rapid-in-situ").staircase(range_nm)


def test_own_profiles_are_read_from_their_path(tmp_path):
    path = tmp_path / "own.toml"
    path.write_text(SMALLEST, encoding="utf-8")
    assert load_profile(path).name == "own"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("duration_s = 1.0", "duration_s = -1.0", r"own\.toml: loading\.duration_s = -1\.0"),
        ("duration_s = 1.0", "", r"loading\.duration_s is missing"),
        ("duration_s = 1.0", "duration_s = 1.0\nspeed = 3", r"loading\.speed is not a key"),
        ('["clockwise"]', '["left"]', "loading.directions.0 = 'left'"),
        ('["clockwise"]', '["clockwise", "clockwise"]', "contains a direction twice"),
        ("[50.0, 100.0]", "[100.0, 50.0]", "must increase"),
        ("[50.0, 100.0]", "[50.0, 100.0]\nstep_percent = 2.0", "exactly one of step_percent"),
        ('"ladder"', '"random"', "groups and points"),
        ('name = "own"', "name = own", "valid TOML"),
    ],
)
def test_errors_of_own_profiles_name_file_key_and_value(old, new, message):
    with pytest.raises(InputError, match=message):
        Profile.from_toml(SMALLEST.replace(old, new), "own.toml")


def test_unknown_profiles_are_named(tmp_path):
    with pytest.raises(InputError, match="profile 'fast'"):
        load_profile("fast")
    with pytest.raises(InputError, match=r"missing\.toml"):
        load_profile(tmp_path / "missing.toml")


@given(up_to=st.floats(0.5, 30.0))
def test_a_profile_shrinks_to_a_largest_torque_and_its_preload_with_it(up_to):
    whole = load_profile("small-torques")
    part = whole.with_options(up_to_percent=up_to)
    steps = part.staircase(100.0)
    assert max(step.nominal_nm for step in steps) == pytest.approx(up_to)
    assert part.largest_percent == pytest.approx(up_to)
    assert part.loading.percents() == pytest.approx(
        [each * up_to / 30.0 for each in whole.loading.percents()], rel=1e-6
    )
    assert len(steps) == len(whole.staircase(100.0))


@given(up_to=st.floats(0.5, 89.0), seed=st.integers(0, 2**32 - 1))
def test_random_points_shrink_with_their_grid(up_to, seed):
    whole, part = (
        points(profile.staircase(100.0, np.random.default_rng(seed)))
        for profile in (load_profile("verification"), load_profile("verification").within(up_to))
    )
    assert [step.nominal_nm for step in part] == pytest.approx(
        [step.nominal_nm * up_to / 100.0 for step in whole]
    )


def test_a_profile_within_what_it_has_stays_as_it_is():
    for name in available_profiles():
        profile = load_profile(name)
        assert profile.within(profile.largest_percent) is profile
        assert profile.within(90.0) is profile
    assert load_profile("check").within(3.0).loading.percents() == pytest.approx([0.6, 1.8, 3.0])
    assert load_profile("small-torques").within(50.0).largest_percent == pytest.approx(30.0)


def test_a_ladder_shrinks_too_and_a_profile_without_it_keeps_its_hash():
    profile = load_profile("rapid-in-situ")
    part = profile.with_options(up_to_percent=20.0)
    assert part.loading.percents()[0] == pytest.approx(0.4)
    assert len(part.loading.percents()) == len(profile.loading.percents())
    assert (profile.largest_percent, part.largest_percent) == (100.0, 20.0)
    assert part.sha256 != profile.sha256
    assert load_profile("small-torques").largest_percent == 100.0  # its preload


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("small-torques", {"up_to_percent": 31.0}),
        ("small-torques", {"up_to_percent": 0.0}),
        ("small-torques", {"up_to_percent": float("nan")}),
        ("rapid-in-situ", {"up_to_percent": 20.0, "step_percent": 5.0}),
        ("verification", {"up_to_percent": 101.0}),
        ("adaptive", {"up_to_percent": 20.0}),
    ],
)
def test_what_cant_shrink_is_refused(name, options):
    with pytest.raises(InputError):
        load_profile(name).with_options(**options)


def test_groups_at_the_same_points() -> None:
    profile = load_profile("verification").with_options(groups=3, points=12)
    same = profile.with_options(same_points=True)
    steps = same.staircase(2000.0, np.random.default_rng(4))
    groups = [
        [step.nominal_nm for step in steps if step.series == k and step.recorded] for k in (1, 2, 3)
    ]
    assert groups[0] == groups[1] == groups[2]
    assert len(set(groups[0])) == 12
    assert same.sha256 != profile.sha256
    with pytest.raises(InputError, match="same_points"):
        load_profile("staircase").with_options(same_points=True)
