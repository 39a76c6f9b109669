"""Torque-angle loops by an own generator (no twin): values, symmetries, bad input, coverage."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from torquebench.errors import InputError
from torquebench.reducers import (
    LOST_MOTION_RULES,
    LoopSettings,
    LoopUncertainty,
    evaluate_hysteresis,
)
from torquebench.units import NM_PER_RAD_OF_NM_PER_ARCMIN

ARCMIN = np.pi / 180 / 60
RATED = 400.0
STIFFNESS = 110.0 * NM_PER_RAD_OF_NM_PER_ARCMIN
WIDTH, GAP, SOFT = 0.6 * ARCMIN, 0.4 * ARCMIN, 12.0
SETTINGS = LoopSettings(RATED)


def middle(torque):
    return torque / STIFFNESS + 0.5 * GAP * np.tanh(torque / SOFT)


def loops(count=3, samples=600, width=WIDTH, shift=0.0):
    """Torque and angle of loops −T → +T → −T."""
    half = np.linspace(-RATED, RATED, samples)
    torque = np.tile(np.concatenate([half, half[::-1]]), count)
    side = np.tile(np.repeat([-1.0, 1.0], samples), count)
    moved = torque - shift
    return torque, middle(moved) + side * 0.5 * width * (1 - (torque / RATED) ** 2), side


def truth(share=0.03):
    """Backlash, lost motion, stiffness on the loading branch and energy, in reported units."""
    load = np.linspace(0.5 * RATED, RATED, 20001)
    branch = middle(load) - 0.5 * WIDTH * (1 - (load / RATED) ** 2)
    slope = np.polyfit(load, branch, 1)[0]
    return {
        "backlash": WIDTH / ARCMIN,
        "lost_motion": 2 * middle(share * RATED) / ARCMIN,
        "stiffness": 1 / slope / NM_PER_RAD_OF_NM_PER_ARCMIN,
        "hysteresis_loss": WIDTH * RATED * 4 / 3,
    }


def values(result):
    return {each.key: each.estimate.value for each in result.quantities()}


def test_clean_loops_give_what_they_are_made_of():
    torque, angle, _ = loops()
    result = evaluate_hysteresis(torque, angle, SETTINGS)
    found = values(result)
    for key, value in truth().items():
        assert found[key] == pytest.approx(value, rel=2e-3), key
    assert not result.findings
    assert len(result.loops) == 3
    marks = {each.label for each in result.key_points}
    assert {"θ↑(0)", "θ↓(0)", "θ↑(+3 %)", "θ↓(−3 %)"} <= marks


@pytest.mark.parametrize(("name", "share"), [("harmonic-drive", 0.04), ("yaskawa", 0.05)])
def test_the_rule_sets_where_lost_motion_is_read(name, share):
    torque, angle, _ = loops()
    result = evaluate_hysteresis(torque, angle, LoopSettings(RATED, rule=name))
    assert result.lost_motion.value == pytest.approx(truth(share)["lost_motion"], rel=2e-3)
    rule = next(each.rule for each in result.quantities() if each.key == "lost_motion")
    assert f"{100 * share:g} %" in rule
    if LOST_MOTION_RULES[name].least_positions > 1:
        assert "few positions" in {each.name for each in result.findings}


def test_the_worst_position_counts_where_the_rule_says_so():
    parts = [loops(samples=900) for _ in range(4)]
    torque = np.concatenate([part[0] for part in parts])
    angle = np.concatenate([part[1] * (1 + 0.1 * k) for k, part in enumerate(parts)])
    position = np.repeat([0.0, 90.0, 180.0, 270.0], parts[0][0].size)
    worst = evaluate_hysteresis(
        torque, angle, LoopSettings(RATED, rule="yaskawa"), position=position
    )
    mean = evaluate_hysteresis(torque, angle, SETTINGS, position=position)
    assert worst.lost_motion.value == pytest.approx(1.3 * truth(0.05)["lost_motion"], rel=3e-3)
    assert mean.lost_motion.value == pytest.approx(1.15 * truth()["lost_motion"], rel=3e-3)
    assert not worst.findings


def test_the_benchs_own_twist_is_subtracted():
    torque, angle, _ = loops()
    compliance = 1 / (300 * NM_PER_RAD_OF_NM_PER_ARCMIN)
    bare = values(evaluate_hysteresis(torque, angle, SETTINGS))
    measured = angle + compliance * torque
    found = evaluate_hysteresis(
        torque,
        measured,
        SETTINGS,
        bench_compliance_rad_per_nm=compliance,
        uncertainty=LoopUncertainty(bench_compliance_rad_per_nm=0.01 * compliance),
    )
    assert values(found) == pytest.approx(bare, rel=1e-9)
    line = next(each for each in found.stiffness.lines if each.name == "bench compliance")
    expected = 0.01 * compliance * bare["stiffness"] ** 2 * NM_PER_RAD_OF_NM_PER_ARCMIN
    assert line.contribution == pytest.approx(expected, rel=1e-6)


def test_three_regions_of_the_harmonic_drive_example():
    # Harmonic Drive, HFUC-32-100: T = 60 N·m gives 7.15e-4 rad.
    t1, t2, k1, k2, k3 = 29.0, 108.0, 6.7e4, 1.1e5, 1.2e5
    half = np.linspace(-140.0, 140.0, 2001)
    load = np.abs(half)
    twist = np.minimum(load, t1) / k1 + np.clip(load - t1, 0, t2 - t1) / k2
    twist = np.sign(half) * (twist + np.maximum(load - t2, 0) / k3)
    torque = np.tile(np.concatenate([half, half[::-1]]), 3)
    angle = np.tile(np.concatenate([twist, twist[::-1]]), 3)
    settings = LoopSettings(140.0, rule="harmonic-drive", region_torques_nm=(t1, t2))
    regions = evaluate_hysteresis(torque, angle, settings).regions
    assert regions.first.value == pytest.approx(k1, rel=1e-3)
    assert regions.second.value == pytest.approx(k2, rel=1e-3)
    assert regions.third.value == pytest.approx(k3, rel=1e-3)
    twist_at_60 = t1 / regions.first.value + (60 - t1) / regions.second.value
    assert twist_at_60 == pytest.approx(7.15e-4, rel=1e-3)
    assert pytest.approx(3437.75, abs=0.005) == NM_PER_RAD_OF_NM_PER_ARCMIN


@hypothesis_settings(max_examples=5)
@given(
    offset=st.floats(-3.0, 3.0),
    scale=st.floats(0.2, 5.0),
    seed=st.integers(0, 2**16),
)
def test_symmetries(offset, scale, seed):
    torque, angle, _ = loops(samples=250)
    generator = np.random.default_rng(seed)
    angle = angle + 1e-7 * generator.standard_normal(angle.size)
    plain = values(evaluate_hysteresis(torque, angle, SETTINGS))
    moved = values(evaluate_hysteresis(torque, angle + offset, SETTINGS))
    assert moved == pytest.approx(plain, rel=1e-6)
    turned = values(evaluate_hysteresis(-torque, -angle, SETTINGS))
    mirrored = dict(plain)
    mirrored["stiffness_positive"], mirrored["stiffness_negative"] = (
        plain["stiffness_negative"],
        plain["stiffness_positive"],
    )
    assert turned == pytest.approx(mirrored, rel=1e-6)
    scaled = values(evaluate_hysteresis(torque, scale * angle, SETTINGS))
    for key, value in plain.items():
        expected = value / scale if "stiffness" in key else value * scale
        assert scaled[key] == pytest.approx(expected, rel=1e-6)


def refused(match, torque, angle, settings=SETTINGS, **more):
    with pytest.raises(InputError, match=match):
        evaluate_hysteresis(torque, angle, settings, **more)


def test_bad_input_is_named():
    torque, angle, _ = loops(samples=300)
    broken = angle.copy()
    broken[7::15] = np.nan
    refused("angle_rad is nan in row 8", torque, broken)
    refused("swapped", angle * 3437.75, torque)
    refused("reverse the sign", torque, -angle)
    refused("stands still", torque, np.zeros_like(angle))
    refused("doesn't close", torque, angle + np.linspace(0, 3 * ARCMIN, angle.size))
    refused("doesn't pass zero", torque + 500.0, angle, LoopSettings(400.0))
    refused("±800 N·m, the upper end", torque, angle, LoopSettings(800.0))
    refused("no whole loop", torque[:300], angle[:300])
    refused("input is locked|is locked", torque, angle * 1000)
    settling = LoopSettings(RATED, settling_loops=3)
    refused("no loop at position 0 after 3 settling loops", torque, angle, settling)


def test_settings_are_checked():
    with pytest.raises(InputError, match="nabtesco"):
        LoopSettings(RATED, rule="nobody")
    with pytest.raises(InputError, match="above 0"):
        LoopSettings(-1.0)
    with pytest.raises(InputError, match="rising"):
        LoopSettings(RATED, stiffness_interval=(1.0, 0.5))
    with pytest.raises(InputError, match="0 or more"):
        LoopUncertainty(angle_rad=-1.0)


def test_backlash_that_a_preload_hides_is_named():
    half = np.linspace(-RATED, RATED, 1200)
    torque = np.tile(np.concatenate([half, half[::-1]]), 3)
    gap = 3 * ARCMIN / 2 * np.tanh((torque - 60.0) / 6.0)
    result = evaluate_hysteresis(torque, torque / STIFFNESS + gap, SETTINGS)
    hidden = [each for each in result.findings if each.name == "backlash hidden by preload"]
    assert hidden
    assert hidden[0].severe
    assert "60" in hidden[0].message


def test_a_saturated_drive_is_named_with_and_without_its_demand():
    demanded, _, side = loops()
    demanded = demanded * 1.8
    torque = np.clip(demanded, -RATED, RATED)
    angle = middle(torque) + side * 0.5 * WIDTH * (1 - (torque / RATED) ** 2)
    for demand in (demanded, None):
        result = evaluate_hysteresis(torque, angle, SETTINGS, demanded_nm=demand)
        assert "drive saturation" in {each.name for each in result.findings}


def test_what_comes_before_the_first_whole_branch_is_no_loop():
    torque, angle, _ = loops()
    rise = np.linspace(0, -RATED, 300)
    result = evaluate_hysteresis(
        np.concatenate([rise, torque]), np.concatenate([rise / STIFFNESS, angle]), SETTINGS
    )
    assert len(result.loops) == 3
    assert result.backlash.value == pytest.approx(truth()["backlash"], rel=2e-3)
    left = evaluate_hysteresis(torque, angle, LoopSettings(RATED, settling_loops=1))
    assert [each.loop for each in left.loops] == [2, 3]


def test_noise_of_the_torque_is_averaged_and_said():
    torque, angle, _ = loops(samples=6000)
    noisy = torque + 8.0 * np.random.default_rng(1).standard_normal(torque.size)
    result = evaluate_hysteresis(noisy, angle, SETTINGS)
    assert "noisy torque" in {each.name for each in result.findings}
    assert result.backlash.value == pytest.approx(truth()["backlash"], rel=0.05)


@pytest.mark.nightly
def test_intervals_hold_the_truth_in_about_95_percent():
    """Independent errors of each kind, drawn as `LoopUncertainty` says."""
    known = LoopUncertainty(
        torque_relative=5e-4,
        torque_zero_nm=0.2,
        torque_branch_nm=0.3,
        angle_rad=0.01 * ARCMIN,
        angle_relative=3e-4,
    )
    clean, _, side = loops(samples=250)
    inside = dict.fromkeys(truth(), 0)
    draws = 60
    for seed in range(draws):
        generator = np.random.default_rng(seed)
        torques, angles, positions = [], [], []
        scale = 1 + known.torque_relative * generator.standard_normal()
        stretch = 1 + known.angle_relative * generator.standard_normal()
        by_branch = known.torque_branch_nm * generator.standard_normal(2)
        by_angle = known.angle_rad * generator.standard_normal((2, 2))
        for position in range(3):
            width = WIDTH * (1 + 0.02 * generator.standard_normal())
            zero = known.torque_zero_nm * generator.standard_normal()
            angle = middle(clean) + side * 0.5 * width * (1 - (clean / RATED) ** 2)
            branch = (side > 0).astype(int)
            sign = (clean > 0).astype(int)
            # Angle errors of each branch and sign, faded in so that loops stay closed.
            fade = np.tanh(np.abs(clean) / SOFT) * (1 - (clean / RATED) ** 8)
            error = by_angle[branch, sign] * fade + by_angle[branch, 0] * (1 - fade)
            noise = 0.02 * ARCMIN * generator.standard_normal(angle.size)
            torques.append(scale * clean + zero + by_branch[branch] * (1 - (clean / RATED) ** 8))
            angles.append(stretch * (angle + error) + noise)
            positions.append(np.full(clean.size, float(position)))
        result = evaluate_hysteresis(
            np.concatenate(torques),
            np.concatenate(angles),
            SETTINGS,
            position=np.concatenate(positions),
            uncertainty=known,
        )
        for each in result.quantities():
            if each.key in inside:
                low, high = each.estimate.interval()
                inside[each.key] += low <= truth()[each.key] <= high
    share = {key: count / draws for key, count in inside.items()}
    assert all(value >= 0.91 for value in share.values()), share
