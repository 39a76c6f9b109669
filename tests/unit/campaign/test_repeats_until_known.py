"""Running tests repeat until their means are known, where the torque is compensated."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.campaign.reducers.settings import ReducerTestSettings
from torquebench.errors import InputError
from torquebench.procedures.reducers.friction import FrictionSettings
from torquebench.procedures.reducers.running import (
    EfficiencySettings,
    NoLoadSettings,
    _more_sweeps,
    _open_shares,
)
from torquebench.procedures.reducers.setup import ReducerLimits
from torquebench.reducers.repeatability import errors_of_means

LIMITS = ReducerLimits(100.0, 400.0, 800.0, 2000.0)
SPEEDS = (100.0, 500.0)


class Table:
    """Points that scatter by a stated amount, as a running table hands them out."""

    def __init__(self, scatter: dict[float, float], repeats: int, compensated: bool = True) -> None:
        generator, rows = np.random.default_rng(4), []
        for repeat in range(1, repeats + 1):
            for sign in (1, -1):
                for speed in SPEEDS:
                    for load, width in scatter.items():
                        ideal = (0.16 if load == 0.0 else load / 75.0) * sign
                        torque = ideal + width * generator.standard_normal()
                        rows.append((sign * speed, load, torque, sign, repeat))
        self.known = compensated
        speed, load, torque, sign, repeat = np.array(rows).T
        self.nominal_rpm, self.nominal_nm = speed, -sign * load
        self.direction, self.repeat = sign, repeat
        self.torque_nm = {"input": torque, "output": -sign * load}

    def compensated(self) -> bool:
        return self.known

    def recording(self):
        return self


@pytest.mark.parametrize(
    ("scatter_nm", "repeats", "compensated", "more"),
    [
        (3e-3, 3, True, True),
        (3e-3, 12, True, False),
        (1e-5, 3, True, False),
        (3e-3, 3, False, False),
    ],
)
def test_no_load_torque_is_repeated_while_its_means_scatter(scatter_nm, repeats, compensated, more):
    settings = NoLoadSettings(FrictionSettings(speeds_rpm=SPEEDS))
    table = Table({0.0: scatter_nm}, repeats, compensated)
    assert _more_sweeps(settings, repeats, table) is more
    assert not _more_sweeps(replace(settings, target_percent=None), repeats, table)
    once = replace(settings, sweep=replace(settings.sweep, repeats=1))
    assert not _more_sweeps(once, repeats, table)


def test_efficiency_is_repeated_only_at_the_torques_that_scatter():
    settings = EfficiencySettings(torque_shares=(0.2, 1.0), speeds_rpm=SPEEDS)
    table = Table({80.0: 8e-3, 400.0: 2e-3}, 3)
    assert _open_shares(LIMITS, settings, (0.2, 1.0), 3, table) == [0.2]
    assert _open_shares(LIMITS, settings, (0.2,), 12, table) == ()
    assert _open_shares(LIMITS, settings, (0.2,), 3, Table({80.0: 8e-3}, 3, False)) == ()


def test_settings_say_how_long_a_test_may_get():
    assert ReducerTestSettings().longest().plans["no-load"].sweep.repeats == 12
    assert ReducerTestSettings().longest().plans["efficiency"].repeats == 12
    short = ReducerTestSettings.short()
    assert short.longest() == short
    with pytest.raises(InputError, match="target_percent"):
        NoLoadSettings(target_percent=0.0)
    with pytest.raises(InputError, match="target_points"):
        EfficiencySettings(target_points=-1.0)


@given(shift=st.floats(-10.0, 10.0), width=st.floats(1e-3, 1.0))
def test_what_repeats_share_counts_and_what_points_share_does_not(shift, width):
    repeat = np.repeat(np.arange(4.0), 4)
    point, sign = np.tile([1.0, 1.0, 2.0, 2.0], 4), np.tile([1.0, -1.0], 8)
    value = 20.0 + shift * point + width * repeat
    smallest, error = errors_of_means(value, point, sign, repeat)
    assert smallest == pytest.approx(min(20.0 + shift, 20.0 + 2.0 * shift) + 1.5 * width)
    assert error == pytest.approx(width * np.std(np.arange(4), ddof=1) / 2.0, rel=1e-6)
    assert errors_of_means(value[:4], point[:4], sign[:4], repeat[:4])[1] == np.inf


def test_loops_and_positions_are_as_many_as_asked_for():
    settings = ReducerTestSettings()
    assert len(settings.plans["hysteresis"].positions_deg) == 5
    more = settings.with_loops(10, 4).plans["hysteresis"]
    assert (more.loops, more.positions_deg) == (10, (0.0, 90.0, 180.0, 270.0))
    assert settings.with_loops() == settings
    with pytest.raises(InputError):
        settings.with_loops(0)


def test_more_repeats_are_those_of_the_empty_run_too():
    settings = ReducerTestSettings().with_repeats(60)
    assert settings.plans["no-load"].most_repeats == settings.plans["efficiency"].most_repeats == 60
    assert settings.plans["no-load"].sweep.repeats == settings.plans["efficiency"].repeats == 3
    assert settings.empty_run.repeats == 60
    assert settings.longest().plans["no-load"].sweep.repeats == 60
    one = ReducerTestSettings().with_repeats(1)
    assert (
        one.plans["no-load"].sweep.repeats
        == one.plans["efficiency"].repeats
        == one.empty_run.repeats
        == 1
    )
    assert replace(ReducerTestSettings(), empty_run=None).with_repeats(5).empty_run is None
    with pytest.raises(InputError):
        ReducerTestSettings().with_repeats(0)
