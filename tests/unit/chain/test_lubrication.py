"""The drag's factor by the present lubricant, and the gradient of temperature."""

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.chain.test_turning_chains import TURNING, WARMTH, drag, empty_run, part, row

from torquebench.chain import (
    EmptyRun,
    Inertia,
    MeasuredRotation,
    MeasuredTemperature,
    identify_lubrication,
)
from torquebench.errors import InputError

SPEEDS = (0.0, *np.geomspace(2.0, 1100.0, 40).tolist())
WARM = (0.0, 10.0, 20.0, 23.0, 30.0, 40.0, 50.0)


def rotation() -> MeasuredRotation:
    """The drag of `empty_run`, without error."""
    table = tuple(
        tuple(drag(np.full(len(WARM), max(n, 1.0)), np.array(WARM)).tolist()) for n in SPEEDS
    )
    nothing = tuple((0.0,) * len(WARM) for _ in SPEEDS)
    return MeasuredRotation("empty runs", 23.0, -1000.0, 1000.0, 10.0, 40.0, SPEEDS, WARM,
                            nothing, nothing, table, nothing)  # fmt: skip


CHAIN = (WARMTH, rotation(), Inertia("ramps", 0.002, 1e-5, 300.0))


def lubricated(factor: float, viscous: float = 1.0, seed: int = 3, **known: float) -> EmptyRun:
    """An empty run at 23 °C with another drag."""
    run = empty_run(23.0, seed, **known)
    coulomb = 0.02 * np.where(np.abs(run.speed_rpm) > 0.5, np.sign(run.speed_rpm), 0.0)
    whole = drag(run.speed_rpm, run.temperature_c)
    changed = factor * (coulomb + viscous * (whole - coulomb))
    return replace(run, reading_nm=run.reading_nm - whole + changed + 0.4)


def test_the_factor_comes_back_within_its_u_and_its_record_says_by_what() -> None:
    misses = []
    for seed, factor in enumerate((0.6, 0.8, 1.0, 1.3)):
        found = identify_lubrication(CHAIN, lubricated(factor, seed=seed), "grease K, 12 g")
        assert found.lubrication_uncertainty < 0.08
        misses.append((found.lubrication - factor) / found.lubrication_uncertainty)
    assert np.max(np.abs(misses)) < 2.0
    assert found.record == "empty runs; drag multiplied by 1.3 by 23.csv (grease K, 12 g)"
    again = identify_lubrication((WARMTH, found, CHAIN[2]), lubricated(0.8))
    assert again.lubrication == pytest.approx(0.8, abs=2.0 * again.lubrication_uncertainty)
    assert again.record.count("multiplied") == 1
    at = {"speed_rpm": 500.0, "temperature_c": 30.0}
    before, after = (
        part(each.components(row(**at), np.zeros(1)), "bearing drag")[0]
        for each in (rotation(), again)
    )
    assert after == pytest.approx(again.lubrication * before)


@pytest.mark.parametrize("viscous", [0.5, 0.2])  # as thin grease and oil
def test_what_one_factor_leaves_at_single_speeds_is_in_u(viscous: float) -> None:
    found = identify_lubrication(CHAIN, lubricated(1.0, viscous=viscous))
    assert 0.4 < found.lubrication < 0.95
    for speed in (100.0, 300.0, 1000.0):
        parts = found.components(row(speed_rpm=speed, temperature_c=23.0), np.zeros(1))
        whole = drag(np.array([speed]), np.array([23.0]))[0]
        truth = 0.02 + viscous * (whole - 0.02)
        error = -part(parts, "bearing drag")[0] - truth
        assert abs(error) < 2.5 * abs(part(parts, "lubrication")[1])


def test_a_run_that_does_not_show_the_factor_is_refused_with_what_would() -> None:
    for effects, run, word in (
        ((WARMTH,), lubricated(1.0), "--empty"),
        (CHAIN, lubricated(1.0, least=0.0), "both directions"),
        (CHAIN, lubricated(-1.0), "positive factor"),
        (CHAIN, replace(lubricated(1.0), reading_nm=np.random.default_rng(1).normal(size=900)),
         "at a steady temperature"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=word):
            identify_lubrication(effects, run)


def test_an_unknown_state_of_the_lubricant_is_in_u() -> None:
    parts = TURNING.components(row(25.0, speed_rpm=600.0, temperature_c=0.0), np.array([25.0]))
    value, u = part(parts, "bearing drag")[0], part(parts, "lubrication")[1]
    assert u == pytest.approx(0.2 / np.sqrt(3.0) * value)
    assert part(parts, "lubrication")[0] == 0.0


def test_a_gradient_counts_by_the_slope_of_zero_and_span() -> None:
    def u(effect: MeasuredTemperature) -> float:
        parts = effect.components(row(20.0, temperature_c=50.0), np.array([20.0]))
        return part(parts, "temperature gradient")[1]

    slope = 0.27 / 27.0 + 20.0 * 0.0027 / 27.0
    assert u(WARMTH) == pytest.approx(0.5 / np.sqrt(3.0) * slope)
    assert u(replace(WARMTH, deviation_k=0.0)) == 0.0
