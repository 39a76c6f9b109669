"""No-load torque, break-away torque, efficiency, comparison: values and named bad input."""

import numpy as np
import pytest

from torquebench.errors import InputError
from torquebench.reducers import (
    TorqueUncertainty,
    budget,
    change_between,
    compare_specimens,
    evaluate_breakaway,
    evaluate_efficiency,
    evaluate_no_load,
)
from torquebench.uncertainty import BudgetLine, Shared


def test_no_load_torque_of_repeats_and_its_refusal():
    generator = np.random.default_rng(2)
    speed = np.tile([200.0, 600.0, 1000.0], 6)
    torque = 0.03 + 5e-5 * speed + 2e-4 * generator.standard_normal(speed.size)
    branch, repeat = np.tile(np.repeat([1, -1], 3), 3), np.repeat([1, 2, 3], 6)
    known = TorqueUncertainty(1e-3, 0.002)
    result = evaluate_no_load(speed, torque, repeat=repeat, branch=branch, uncertainty=known)
    for point in result.points:
        low, high = point.torque.interval()
        assert low <= 0.03 + 5e-5 * point.speed_rpm <= high
    with pytest.raises(InputError, match="zero just before"):
        evaluate_no_load(speed, torque, repeat=repeat, uncertainty=known, largest_share=0.01)
    warm = np.linspace(20.0, 30.0, speed.size)
    found = evaluate_no_load(speed, torque, repeat=repeat, temperature_c=warm).findings
    assert "unsteady temperature" in {each.name for each in found}


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_break_away_torque_of_ramps(sign):
    generator = np.random.default_rng(3)
    time = np.linspace(0.0, 4.0, 800)
    start = 2.5
    angle = 5.0 * np.maximum(0.0, time - start) ** 2 + 2e-5 * generator.standard_normal(800)
    result = evaluate_breakaway(time, sign * angle, sign * 0.01 * time)
    assert result.torque.value == pytest.approx(0.025, abs=3e-4)
    with pytest.raises(InputError, match="stays within"):
        evaluate_breakaway(time, 1e-5 * generator.standard_normal(800), 0.01 * time)


def test_efficiency_by_the_definition_and_swapped_columns():
    # Harmonic Drive's scaling: 78 % times 0.93 is 73 %.
    assert round(78 * 0.93) == 73
    load = np.array([100.0, 200.0, 400.0] * 2)
    speed = np.repeat([300.0, 900.0], 3)
    drive = load / 80 + 0.2 + 1e-4 * speed
    known = TorqueUncertainty(zero_nm=0.01)
    found = evaluate_efficiency(drive, load, speed, 80.0, input_uncertainty=known)
    point = found.points[0]
    assert point.efficiency.value == pytest.approx(100 * 100 / 80 / (100 / 80 + 0.23))
    expected = point.efficiency.value * 0.01 / (100 / 80 + 0.23)
    assert point.efficiency.standard_uncertainty == pytest.approx(expected)
    between = found.at(300.0, 600.0)
    assert between.value == pytest.approx(100 * 3.75 / (3.75 + 0.26))
    with pytest.raises(InputError, match="swapped"):
        evaluate_efficiency(load, drive, speed, 80.0)
    with pytest.raises(InputError, match="unlike sign"):
        evaluate_efficiency(drive, -load, speed, 80.0)


def test_what_both_measurements_share_cancels_in_a_change():
    scale = BudgetLine("any name", 0.5, shared=Shared.CALIBRATION)
    parts = [scale, BudgetLine("loops", 0.1)]
    change = change_between("stiffness", budget(100, "N·m", parts), budget(99, "N·m", parts))
    assert change.change.standard_uncertainty == pytest.approx(0.02**0.5)
    assert change.significant
    other = change_between(
        "stiffness",
        budget(100, "N·m", parts),
        budget(99, "N·m", parts),
        same_calibration=False,
    )
    assert other.change.standard_uncertainty == pytest.approx(0.52**0.5)
    with pytest.raises(InputError, match="one unit"):
        change_between("x", budget(1, "N·m", parts), budget(1, "J", parts))


@pytest.mark.parametrize("shared", [Shared.MOUNTING, Shared.ZEROING, Shared.LOADING])
def test_a_specimen_is_mounted_and_zeroed_anew_between_two_tests(shared):
    parts = [BudgetLine("torque scale", 0.5, shared=shared)]
    first, second = (budget(value, "N·m", parts) for value in (100.0, 99.0))
    change = change_between("stiffness", first, second)
    assert change.change.standard_uncertainty == pytest.approx(0.5**0.5)
    found = compare_specimens("stiffness", {"A": first, "B": second})
    assert [line.name for line in found.mean.lines] == ["specimens"]


def test_the_mean_of_specimens_has_the_errors_of_the_calibration():
    parts = [BudgetLine("any name", 0.5, shared=Shared.CALIBRATION)]
    values = {name: budget(value, "N·m", parts) for name, value in (("A", 100.0), ("B", 100.0))}
    assert compare_specimens("x", values).mean.standard_uncertainty == pytest.approx(0.5)
    parts.append(BudgetLine("loops", 0.01))
    far = {"A": 1.0, "B": 1.01, "C": 1.02, "D": 1.5}
    every = {name: budget(value, "N·m", parts) for name, value in far.items()}
    assert compare_specimens("x", every).outliers == ("D",)
    assert not compare_specimens("x", every, same_calibration=False).outliers
