"""Every procedure of the bench, with settings that are quick, for the fault campaign."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any

import numpy as np

from torquebench.bench.roles import Side
from torquebench.calibration import Profile, load_profile
from torquebench.campaign.reducers.settings import ReducerTestSettings, reducer_limits
from torquebench.campaign.reducers.tests import rehearse_reducer_test, run_reducer_test
from torquebench.procedures import (
    FrictionSettings,
    calibrate,
    friction_sweep,
    rehearse,
    verify,
    zero_modules,
)
from torquebench.procedures.reducers.first_motion import BreakawaySettings, breakaway
from torquebench.procedures.reducers.loop import (
    BenchTwistSettings,
    HysteresisSettings,
    bench_twist,
    hysteresis_loops,
)
from torquebench.procedures.reducers.running import (
    EfficiencySettings,
    NoLoadSettings,
    efficiency_map,
    no_load_running,
)
from torquebench.procedures.reducers.setup import WarmUp
from torquebench.procedures.reducers.turning import TransmissionSettings, transmission_error
from torquebench.reducers import load_reducer
from torquebench.station import Station

__all__ = ["PROCEDURES", "REDUCER", "Procedure"]

Plan = Generator[Any, Any, Any]
MakePlan = Callable[[Station], Plan]

SPECIMEN = load_reducer("standard")
REDUCER = reducer_limits(SPECIMEN)
FRICTION = FrictionSettings(speeds_rpm=(200.0, 600.0), repeats=1, zero_s=0.5)
COLD = WarmUp(longest_s=0.0)
SETTINGS = ReducerTestSettings(
    plans={
        "no-load": NoLoadSettings(
            FrictionSettings(speeds_rpm=(200.0, 400.0, 600.0, 900.0), repeats=1, zero_s=0.5), COLD
        ),
        "starting": BreakawaySettings(2, ramp_s=3.0, zero_s=0.5),
        "back-driving": BreakawaySettings(2, ramp_s=3.0, zero_s=0.5),
        "hysteresis": HysteresisSettings(1, (0.0,), 1.0, 12.0, zero_s=0.5),
        "transmission-error": TransmissionSettings(output_rpm=10.0, settle_s=0.5),
        "efficiency": EfficiencySettings(
            torque_shares=(0.5,), speeds_rpm=(300.0, 600.0), zero_s=0.5, warm_up=COLD
        ),
    },
    bench_twist=BenchTwistSettings(cycles=1, cycle_s=6.0),
)
QUICKER = 60.0
"""How much shorter the holds of slow profiles are here."""
SOONER = 0.3
"""Share of its rehearsal that a breakaway lasts: the motion comes long before the ramp's end."""


@dataclass(frozen=True)
class Procedure:
    """A procedure, what it loads, and what matters of it to a fault.

    Parameters
    ----------
    name : str
    go : callable
        Goes through it on a station and returns its result.
    lasts_s : callable
        Returns how long that takes on a station, s of bench time.
    side : {"input", "output"}
        The side that it loads.
    standard : bool
        Whether a standard is mounted and read.
    loads : bool
        Whether a drive gets power at all.
    angles : bool
        Whether angles are watched or measured.
    waits_for_motion : bool
        Whether a side that begins to turn is what it waits for, or can't be.
    """

    name: str
    go: Callable[[Station], object]
    lasts_s: Callable[[Station], float]
    side: Side
    standard: bool = False
    loads: bool = True
    angles: bool = True
    waits_for_motion: bool = False


def _planned(name: str, plan: MakePlan, side: Side, share: float = 1.0, **about: bool) -> Procedure:
    """Describe a procedure that is one plan, of whose rehearsal it takes a share."""
    return Procedure(
        name,
        lambda station: station.run(plan(station), kind=_kind(name)).result,
        lambda station: share * rehearse(station.devices, plan(station)).duration_s,
        side,
        **about,
    )


def _kind(name: str) -> str:
    """Return how such a run is called: what it calibrates is what `--resume` looks at."""
    words = name.split()
    return f"calibrate-{words[1]}" if words[0] == "calibrate" else name.replace(" ", "-")


def _quick(profile: Profile, steps: tuple[float, ...], **options: Any) -> Profile:
    """Shorten a profile: other steps (% of the range) where they are given, and shorter holds."""
    text = profile.with_options(**options).model_dump(mode="python")
    if steps:
        text["loading"]["steps_percent"] = steps
    for table, keys in (
        ("loading", ("duration_s", "settle_limit_s")),
        ("preload", ("on_s", "off_s")),
        ("zero", ("duration_s",)),
    ):
        for key in keys:
            if text[table][key] >= QUICKER / 10.0:
                text[table][key] /= QUICKER
            text[table][key] = max(0.3, text[table][key])
    return Profile.model_validate(text)


def _calibration(side: Side, name: str, steps: tuple[float, ...] = (), **options: Any) -> Procedure:
    profile = _quick(load_profile(name), steps, **options)

    def plan(station: Station) -> Plan:
        return calibrate(station.devices, side, profile)

    return _planned(f"calibrate {side} {name}", plan, side, standard=True)


def _verification(side: Side, name: str, **options: Any) -> Procedure:
    profile = load_profile(name).with_options(**options)
    steps = profile.staircase(50.0 if side == "input" else 2000.0, np.random.default_rng(3))

    def plan(station: Station) -> Plan:
        return verify(station.devices, side, profile, steps)

    word = "check" if name == "check" else "verify"
    return _planned(f"{word} {side}", plan, side, standard=True)


def _test(name: str, side: Side, **about: bool) -> Procedure:
    """Describe a test of a reducer with everything around it, as the command has it run."""
    share = SOONER if name in ("starting", "back-driving") else 1.0

    def lasts_s(station: Station) -> float:
        *before, test = rehearse_reducer_test(station, name, SPECIMEN, SETTINGS)
        return sum(part.duration_s for part in before) + share * test.duration_s

    return Procedure(
        f"test {name}",
        lambda station: run_reducer_test(station, name, SPECIMEN, SETTINGS),
        lasts_s,
        side,
        **about,
    )


def _of(plan: Callable[..., Plan], *arguments: object) -> MakePlan:
    return lambda station: plan(station.devices, *arguments)


PROCEDURES: tuple[Procedure, ...] = (
    _planned("zero", _of(zero_modules), "output", loads=False),
    _calibration("input", "rapid-in-situ", step_percent=25.0),
    _calibration("output", "rapid-in-situ", step_percent=25.0),
    _calibration("output", "staircase", (50.0, 100.0)),
    _calibration("input", "reversing", step_percent=50.0, repeats=1),
    _calibration("output", "small-torques", (0.5, 3.0, 30.0), repeats=1),
    _calibration("output", "adaptive", points=48),
    _verification("input", "verification", groups=1, points=8),
    _verification("output", "verification", groups=1, points=8),
    _verification("output", "check"),
    _planned("friction sweep", _of(friction_sweep, FRICTION), "input", angles=False),
    _planned(
        "no-load running",
        _of(no_load_running, REDUCER, SETTINGS.plans["no-load"]),
        "input",
        angles=False,
    ),
    _planned(
        "hysteresis loops",
        _of(hysteresis_loops, REDUCER, SETTINGS.plans["hysteresis"]),
        "output",
        waits_for_motion=True,
    ),
    _planned(
        "starting torque",
        _of(breakaway, REDUCER, "input", SETTINGS.plans["starting"]),
        "input",
        SOONER,
        waits_for_motion=True,
    ),
    _planned(
        "back-driving torque",
        _of(breakaway, REDUCER, "output", SETTINGS.plans["back-driving"]),
        "output",
        SOONER,
        waits_for_motion=True,
    ),
    _planned(
        "transmission error",
        _of(transmission_error, REDUCER, SETTINGS.plans["transmission-error"]),
        "input",
    ),
    _planned(
        "efficiency map",
        _of(efficiency_map, REDUCER, SETTINGS.plans["efficiency"]),
        "input",
        angles=False,
    ),
    _planned(
        "bench twist",
        _of(bench_twist, SETTINGS.bench_twist, ("output",)),
        "output",
        standard=True,
        waits_for_motion=True,
    ),
    _test("starting", "input", waits_for_motion=True),
    _test("back-driving", "output", waits_for_motion=True),
    _test("transmission-error", "input"),
    _test("hysteresis", "output", waits_for_motion=True),
    _test("no-load", "input", angles=False),
    _test("efficiency", "input", angles=False),
)
