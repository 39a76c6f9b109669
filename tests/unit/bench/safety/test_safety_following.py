"""Drives that don't do what they are told, and drives that do, only late."""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from torquebench.bench.blocks import CONDITIONS, Block
from torquebench.bench.description import default_bench
from torquebench.bench.safety import AlarmKind
from torquebench.bench.safety.following import FollowingJudge
from torquebench.bench.state import CommandState
from torquebench.errors import BenchError
from torquebench.signals import Record
from torquebench.units import RPM_PER_RAD_S

if TYPE_CHECKING:
    from tests.unit.bench.conftest import LowBench
else:
    LowBench = Any

OpenBench = Callable[..., Any]
BLOCK_S = 0.05
RATE = 4000.0


def test_a_drive_that_pulls_the_other_way_is_stopped(bench: LowBench) -> None:
    bench.load_output(900.0)
    bench.clock.wait(1.0)
    assert bench.supervisor.alarm is None
    bench.drivers.drives["output"].command_torque(-900.0, RATE)
    began_s = bench.clock.now()
    with pytest.raises(BenchError, match=r"not followed: output drive: .* instead of 900\.0 N·m"):
        bench.clock.wait(5.0)
    alarm = bench.supervisor.alarm
    assert alarm is not None
    assert (alarm.kind, alarm.source) == (AlarmKind.FOLLOWING, "output")
    assert alarm.allowed == "at most 200 N·m apart"
    assert alarm.time_s - began_s < 0.8
    assert bench.supervisor.wait_safe(60.0)
    assert bench.zeroed_and_off()


def test_a_drive_that_keeps_its_torque_is_stopped(bench: LowBench) -> None:
    bench.load_output(900.0)
    bench.clock.wait(1.0)
    bench.commands.output.ask("torque", 100.0, RATE, bench.clock.now())
    bench.commands.output.told(
        "torque", bench.commands.output.set_points["torque"], bench.clock.now()
    )  # it never hears of it
    with pytest.raises(BenchError, match=r"instead of 100\.0 N·m"):
        bench.clock.wait(5.0)


@pytest.mark.parametrize("percent", [0.0, 30.0])
def test_how_far_apart_they_may_be_is_the_benchs_own_matter(
    open_bench: OpenBench, percent: float
) -> None:
    with open_bench(safety__following_percent=percent) as bench:
        bench.load_output(300.0)
        bench.clock.wait(0.5)
        bench.drivers.drives["output"].command_torque(-200.0, RATE)
        bench.clock.wait(2.0)
        assert bench.supervisor.alarm is None


class Read:
    """Judges torques and speeds that nothing but this test has made."""

    def __init__(self, *, standard: bool) -> None:
        self.commands = CommandState()
        self.judge = FollowingJudge(default_bench(), self.commands)
        self.standard = standard
        self.now_s = 0.0

    def block(self, torque_nm: float, speed_rad_s: float = 0.0) -> str:
        """Take one block; return what is found wrong."""
        start_s, self.now_s = self.now_s, self.now_s + BLOCK_S
        time_s = np.linspace(start_s, self.now_s, 5)
        reading = Record({"time_s": time_s, "reading_nm": torque_nm, "fault": np.uint8(0)})
        speeds = {"input_speed_rad_s": 0.0, "output_speed_rad_s": speed_rad_s}
        records = {
            "output_torque": reading,
            CONDITIONS: Record({"time_s": np.array([self.now_s]), **speeds}),
        }
        if self.standard:
            records["output_reference"] = reading
        found = self.judge.judge(Block(start_s, self.now_s, {}, records))
        return "" if found is None else found.found


targets = st.lists(
    st.tuples(st.floats(-2000.0, 2000.0), st.integers(1, 40)), min_size=1, max_size=6
)


@settings(max_examples=50)
@given(targets, st.floats(0.0, 0.4), st.booleans())
def test_a_drive_that_follows_late_is_never_called_astray(
    commanded: list[tuple[float, int]], late_s: float, standard: bool
) -> None:
    read = Read(standard=standard)
    read.commands.output.on()
    read.block(0.0)
    path = [(0.0, 0.0)]  # where a drive would be that follows at once
    for target_nm, blocks in commanded:
        read.commands.output.ask("torque", target_nm, RATE, read.now_s)
        read.commands.output.told("torque", read.commands.output.set_points["torque"], read.now_s)
        for _ in range(blocks):
            time_s, torque_nm = path[-1]
            step = np.clip(target_nm - torque_nm, -RATE * BLOCK_S, RATE * BLOCK_S)
            path.append((time_s + BLOCK_S, torque_nm + float(step)))
            times, torques = zip(*path, strict=True)
            present = float(np.interp(time_s + BLOCK_S - late_s, times, torques))
            assert read.block(present) == ""


def test_nothing_is_held_against_a_drive_while_it_is_being_told() -> None:
    read = Read(standard=True)
    read.commands.output.on()
    read.commands.output.ask("torque", 1000.0, RATE, 0.0)
    assert {read.block(0.0) for _ in range(40)} == {""}  # two seconds on a bad wire
    read.commands.output.told("torque", read.commands.output.set_points["torque"], read.now_s)
    assert {read.block(0.0) for _ in range(10)} == {""}  # it may have come at their end
    assert "0.0 N·m instead of" in [read.block(0.0) for _ in range(10)][-1]


@pytest.mark.parametrize("goes_on", [True, False])
def test_a_drive_that_is_told_late_goes_on_with_its_ramp_until_then(goes_on: bool) -> None:
    """A busy computer told an abort half a second late: a wrong "command not followed"."""
    read, rate = Read(standard=True), 2000.0
    output = read.commands.output
    output.on()
    output.ask("torque", 2000.0, rate, 0.0)
    output.told("torque", output.set_points["torque"], 0.0)
    rising = np.arange(1, 21) * rate * BLOCK_S
    assert {read.block(torque) for torque in rising[:8]} == {""}
    asked = output.ask_zero(read.now_s, 0.4)
    assert {read.block(torque) for torque in rising[8:18]} == {""}  # it knows nothing of that
    output.told_zero(asked, read.now_s)
    falling = rising[17] * (np.ones(20) if goes_on else np.linspace(1.0, 0.0, 9)[1:])
    found = [read.block(torque) for torque in falling]
    assert ("instead of 0.0 N·m" in found[-1]) is goes_on
    assert goes_on or set(found) == {""}


@pytest.mark.parametrize("standard", [True, False])
def test_a_side_that_is_free_to_turn_may_take_up_less(standard: bool) -> None:
    read = Read(standard=standard)
    read.commands.output.on()
    read.commands.output.ask("torque", 1000.0, RATE, 0.0)
    read.commands.output.told("torque", read.commands.output.set_points["torque"], 0.0)
    found = {read.block(0.0) for _ in range(40)}
    assert (found == {""}) is not standard


@pytest.mark.parametrize(("turns", "wrong"), [(1.0, False), (0.0, False), (-1.0, True)])
def test_a_drive_that_turns_the_other_way_is_astray(turns: float, wrong: bool) -> None:
    read = Read(standard=False)
    read.commands.output.on()
    read.commands.output.ask("speed", 1.0, 10.0, 0.0)
    read.commands.output.told("speed", read.commands.output.set_points["speed"], 0.0)
    found = {read.block(0.0, turns) for _ in range(40)}
    assert any("rpm instead of" in each for each in found) is wrong


def test_a_reading_that_is_missing_says_nothing_of_the_drive() -> None:
    read = Read(standard=True)
    read.commands.output.on()
    read.commands.output.ask("torque", 1000.0, RATE, 0.0)
    read.commands.output.told("torque", read.commands.output.set_points["torque"], 0.0)
    assert {read.block(float("nan")) for _ in range(40)} == {""}


def test_a_drive_that_was_off_begins_anew() -> None:
    read = Read(standard=True)
    read.commands.output.on()
    read.commands.output.ask("torque", 1000.0, RATE, 0.0)
    read.commands.output.told("torque", read.commands.output.set_points["torque"], 0.0)
    for torque_nm in (200.0, 400.0, 600.0, 800.0, 1000.0):
        assert read.block(torque_nm) == ""
    read.commands.output.off(read.now_s)
    assert {read.block(0.0) for _ in range(5)} == {""}
    read.commands.output.on()
    assert {read.block(0.0) for _ in range(40)} == {""}


def test_a_drive_going_to_zero_is_expected_there_before_it_has_answered(bench: LowBench) -> None:
    """Whoever watches is faster than a drive that answers late: a wrong "command not followed"."""
    bench.load_output(900.0)
    bench.clock.wait(1.0)
    drive, seen = bench.drivers.drives["output"], []
    told = drive.ramp_to_zero

    def slowly(duration_s: float) -> None:
        told(duration_s)
        seen.append(bench.commands.output.set_points["torque"])

    drive.ramp_to_zero = slowly  # type: ignore[method-assign]
    lasts_s = bench.supervisor.unload(["output"])
    (meanwhile,) = seen
    assert (meanwhile.value, meanwhile.told_s) == (0.0, np.inf)
    after = bench.commands.output.set_points["torque"]
    assert after == replace(meanwhile, told_s=after.told_s)
    bench.clock.wait(lasts_s + 1.0)
    assert bench.supervisor.alarm is None


@given(late_s=st.floats(0.0, 0.2), ramp_s=st.floats(0.2, 2.0))
@settings(max_examples=30)
def test_being_told_later_does_not_begin_the_ramp_anew(late_s: float, ramp_s: float) -> None:
    commands = CommandState().output
    asked = commands.ask_zero(1.0, ramp_s)
    commands.told_zero(asked, 1.0 + late_s)
    assert set(commands.set_points.values()) == {replace(asked, told_s=1.0 + late_s)}
    other = commands.ask_zero(2.0, ramp_s)
    commands.told_zero(asked, 3.0)
    assert all(point is other for point in commands.set_points.values())


SLOWLY = 100.0
"""N·m/s: a ramp that takes longer than a drive may lag."""


def test_a_turning_shaft_that_keeps_its_torque_may_change_its_speed(bench: LowBench) -> None:
    bench.load_output(900.0)
    bench.clock.wait(1.0)
    drive, commands = bench.drivers.drives["output"], bench.commands.output
    for rpm in (5.0, 10.0, 0.0):
        commands.ask("speed", rpm / RPM_PER_RAD_S, 1.0, bench.clock.now())
        drive.command_speed(rpm / RPM_PER_RAD_S, 1.0)
        commands.told("speed", commands.set_points["speed"], bench.clock.now())
        bench.clock.wait(2.0)
        bench.command_torque(900.0 + rpm, SLOWLY)
        bench.clock.wait(2.0)
    assert bench.supervisor.alarm is None
    drive.command_torque(-900.0, RATE)
    with pytest.raises(BenchError, match=r"output drive: .* instead of 900\.0 N·m"):
        bench.clock.wait(5.0)


def test_torque_is_watched_while_the_speed_of_a_held_shaft_changes() -> None:
    read = Read(standard=True)
    read.commands.output.on()
    for quantity, value in (("torque", 1000.0), ("speed", 1.0)):
        read.commands.output.ask(quantity, value, RATE, read.now_s)
        read.commands.output.told(quantity, read.commands.output.set_points[quantity], read.now_s)
    assert {read.block(1000.0, 0.5) for _ in range(40)} == {""}
    assert "0.0 N·m instead of 1000.0 N·m" in [read.block(0.0, 0.5) for _ in range(20)][-1]


@pytest.mark.parametrize("starts_at", [0.0, 20.0])
def test_a_shaft_that_turned_under_torque_is_taken_over_at_its_speed_or_from_rest(
    starts_at: float,
) -> None:
    read, rate = Read(standard=False), 2.0
    read.commands.output.on()
    read.commands.output.ask("torque", 100.0, RATE, 0.0)
    read.commands.output.told("torque", read.commands.output.set_points["torque"], 0.0)
    assert {read.block(100.0, 20.0) for _ in range(10)} == {""}
    read.commands.output.ask("speed", 25.0, rate, read.now_s)
    read.commands.output.told("speed", read.commands.output.set_points["speed"], read.now_s)
    speeds = np.minimum(25.0, starts_at + rate * BLOCK_S * np.arange(1, 400))
    assert {read.block(0.0, speed) for speed in speeds} == {""}
    found = [read.block(0.0, -20.0) for _ in range(20)][-1]
    assert f"instead of {25.0 * RPM_PER_RAD_S:.1f} rpm" in found
