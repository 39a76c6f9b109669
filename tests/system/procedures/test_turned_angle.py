"""Turning to another position: late commands cost nothing, drives and encoders that err do."""

from collections.abc import Callable, Generator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bluesky.utils import Msg
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from tests.support.draws import nightly

from torquebench.bench.description import default_bench
from torquebench.bench.state import SideCommands, Turned
from torquebench.campaign.reducers.settings import reducer_limits
from torquebench.errors import TorquebenchError
from torquebench.procedures.guarding import turning_limits
from torquebench.procedures.messages import sleep
from torquebench.procedures.reducers.setup import REDUCER_SETUP, run_metadata, turn_output
from torquebench.procedures.setup import measured_in
from torquebench.reducers import load_reducer
from torquebench.station import Station

Plan = Generator[Msg, Any, Any]
LIMITS = reducer_limits(load_reducer("standard"))
RATE = 250.0
"""rad/s²."""

moves = st.tuples(
    st.floats(2.0, 40.0).flatmap(lambda deg: st.sampled_from((deg, -deg))),
    st.floats(30.0, 300.0),
    st.floats(0.0, 2.0),
    st.floats(0.0, 5.0),
)
"""Angle of the output, speed, and how late both commands come: degrees, 1/min, s."""


def late(plan: Plan, station: Station, before_s: list[float]) -> Plan:
    """Hold up each command of the input's speed."""
    axis, waits_s = station.devices.input.drive.speed, iter(before_s)
    answer = None
    while True:
        try:
            message = plan.send(answer)
        except StopIteration:
            return
        if message.command == "set" and message.obj is axis:
            yield from sleep(next(waits_s))
        answer = yield message


def turning(station: Station, plan: Plan) -> None:
    """Run a plan on the bench with a reducer."""
    devices = station.devices
    metadata = run_metadata(devices, "turning", LIMITS, 0, side="input")
    limits = turning_limits(devices, "input", 2.0 * LIMITS.turning_rpm)
    station.run(measured_in(REDUCER_SETUP, devices, plan, metadata, limits), kind="turning")


@settings(max_examples=3, deadline=None, phases=[Phase.generate])
@given(wanted=st.lists(moves, min_size=2, max_size=4))
def test_a_command_that_comes_late_is_no_fault(
    tmp_path_factory: pytest.TempPathFactory, wanted: list[tuple[float, float, float, float]]
) -> None:
    def plan() -> Plan:
        for output_deg, rpm, start_s, stop_s in wanted:
            turn = turn_output(station.devices, LIMITS, output_deg, speed_rpm=rpm)
            yield from late(turn, station, [start_s, stop_s])

    with Station.open(None, tmp_path_factory.mktemp("late")) as station:
        turning(station, plan())


def scaled(station: Station, share: float) -> None:
    """Have the input's drive turn at a share of the speed that it is told."""
    drive: Any = station.drivers.drives["input"]
    told = drive.command_speed
    drive.command_speed = lambda speed, rate: told(share * speed, rate)


def slips(station: Station, side: str) -> None:
    """Have an encoder lose a quarter of the angle that the input turns by at the shaft's end."""
    twin: Any = station.drivers.counter.twin
    module = station.description.module(side)
    turns = 0.25 * (10.0 * abs(LIMITS.ratio) if side == "input" else 10.0) / 360.0
    counts = turns * module.encoder.counts_per_revolution
    twin.inject_fault(side, "encoder_slip", start_s=twin.time_s + 0.5, amount=counts)


@pytest.mark.parametrize("stop_s", [0.0, nightly(3.0)])
@pytest.mark.parametrize(
    "broken",
    [
        lambda station: scaled(station, 0.0),
        lambda station: scaled(station, 0.5),
        lambda station: scaled(station, 1.5),
        lambda station: scaled(station, -1.0),
        lambda station: slips(station, "input"),
        lambda station: slips(station, "output"),
    ],
    ids=["ignores", "saturates", "races", "turns the other way", "input slips", "output slips"],
)
def test_a_drive_or_an_encoder_that_errs_is_found(
    tmp_path: Path, broken: Callable[[Station], None], stop_s: float
) -> None:
    def plan() -> Plan:
        broken(station)
        turn = turn_output(station.devices, LIMITS, 10.0)
        yield from late(turn, station, [0.0, stop_s])

    safety = default_bench().safety.model_copy(update={"following_percent": 0.0})
    alone = default_bench().model_copy(update={"safety": safety})  # no supervisor compares speeds
    with (
        Station.open(alone, tmp_path) as station,
        pytest.raises(TorquebenchError, match=r"turned by|slip"),
    ):
        turning(station, plan())


ramps = st.lists(
    st.tuples(
        st.floats(-50.0, 50.0),
        st.floats(0.6, 1.0),
        st.lists(st.tuples(st.floats(0.0, 0.3), st.floats(0.0, 0.2)), min_size=1, max_size=4),
    ),
    max_size=4,
)
"""Speed, time since the ramp before; of each slice the pause before and how long it was given."""


@given(told=ramps, share=st.floats(0.0, 1.0), more_s=st.floats(0.0, 2.0))
def test_the_angle_of_a_drive_that_follows_is_within_what_its_commands_allow(
    told: list[tuple[float, float, list[tuple[float, float]]]], share: float, more_s: float
) -> None:
    side, now_s, taken = SideCommands(), 0.0, [(0.0, 0.0)]
    for speed, since_s, slices in told:
        now_s, start = now_s + since_s, side.speed_rad_s
        for number, (pause_s, lasts_s) in enumerate(slices, 1):
            target = start + (speed - start) * number / len(slices)
            asked = side.ask("speed", target, RATE, now_s + pause_s)
            now_s += pause_s + lasts_s
            side.told("speed", asked, now_s)
            taken.append((asked.asked_s + share * lasts_s, target))
    found = side.turned.until(now_s + more_s)
    true_rad = stepped(taken, now_s + more_s)
    assert abs(found.angle_rad - true_rad) <= found.uncertain_rad + 1e-3


def stepped(taken: list[tuple[float, float]], stop_s: float) -> float:
    """Return the angle of a drive that takes each command at its time, by small steps."""
    angle, present = 0.0, 0.0
    for (start_s, target), (end_s, _) in pairwise([*taken, (stop_s, 0.0)]):
        steps = max(1, round((end_s - start_s) / 1e-4))
        step_s = (end_s - start_s) / steps
        speeds = present + np.sign(target - present) * np.minimum(
            RATE * step_s * np.arange(steps + 1), abs(target - present)
        )
        angle += float(np.trapezoid(speeds, dx=step_s))
        present = float(speeds[-1])
    return angle


def test_a_stop_ramps_within_its_own_time() -> None:
    side = SideCommands()
    side.told("speed", side.ask("speed", 10.0, RATE, 0.0), 0.0)
    side.told_zero(side.ask_zero(1.0, 2.0), 1.0)
    side.at_zero(5.0)
    expected = 10.0 * (1.0 - 0.5 * 10.0 / RATE) + 0.5 * 10.0 * 2.0
    assert side.turned.until(6.0).angle_rad == pytest.approx(expected)
    assert Turned().until(5.0).angle_rad == 0.0
