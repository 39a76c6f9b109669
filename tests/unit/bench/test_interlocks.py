from typing import TYPE_CHECKING, Any

import pytest

from torquebench.bench import interlocks
from torquebench.bench.safety import AlarmKind
from torquebench.errors import InputError, InterlockError, LimitError, SignalFault

if TYPE_CHECKING:
    from tests.unit.bench.conftest import LowBench
else:
    LowBench = Any


def ready(bench: LowBench) -> LowBench:
    """Everything that torque on the output needs."""
    bench.clock.wait(0.1)
    bench.load_output(0.0)
    bench.clock.wait(0.1)
    return bench


def test_torque_is_allowed_when_everything_is_in_place(bench: LowBench) -> None:
    interlocks.check_set_point(ready(bench).state, "output", "torque", 2000.0)
    interlocks.check_set_point(bench.state, "output", "speed", 1.0)


def test_no_torque_without_clamp(bench: LowBench) -> None:
    ready(bench).drivers.clamp.set_clamped(False)
    with pytest.raises(InterlockError, match="clamp open"):
        interlocks.check_set_point(bench.state, "output", "torque", 1.0)
    with pytest.raises(InterlockError, match="clamp open"):
        interlocks.check_set_point(bench.state, "output", "speed", 1.0)
    interlocks.check_set_point(bench.state, "output", "torque", 0.0)


@pytest.mark.parametrize("mode", ["free", "locked"])
def test_no_torque_and_no_speed_on_a_side_that_is_not_driven(bench: LowBench, mode: Any) -> None:
    ready(bench).drivers.modes.set_mode("output", mode)
    with pytest.raises(InterlockError, match=mode):
        interlocks.check_set_point(bench.state, "output", "torque", -5.0)
    with pytest.raises(InterlockError, match=mode):
        interlocks.check_set_point(bench.state, "output", "speed", -0.1)


def test_no_torque_from_a_drive_that_is_off(bench: LowBench) -> None:
    ready(bench).commands.output.enabled = False
    with pytest.raises(InterlockError, match="which is off"):
        interlocks.check_set_point(bench.state, "output", "torque", 5.0)


@pytest.mark.parametrize("value", [2401.0, -2401.0, float("nan"), float("inf")])
def test_no_torque_beyond_the_limit(bench: LowBench, value: float) -> None:
    with pytest.raises(
        LimitError, match=r"N·m requested from the output drive; allowed: ±2400 N·m"
    ):
        interlocks.check_set_point(ready(bench).state, "output", "torque", value)


@pytest.mark.parametrize("value", [3.0, -3.0, float("nan")])
def test_no_speed_beyond_the_limit(bench: LowBench, value: float) -> None:
    with pytest.raises(LimitError, match=r"±20 rpm"):
        interlocks.check_set_point(ready(bench).state, "output", "speed", value)


def test_nothing_moves_while_an_alarm_is_latched(bench: LowBench) -> None:
    ready(bench).supervisor.trip(AlarmKind.STOP, "test", "stop", "", "go on")
    assert bench.supervisor.wait_safe(60.0)
    for refused in (
        lambda: interlocks.check_set_point(bench.state, "output", "torque", 1.0),
        lambda: interlocks.check_set_point(bench.state, "output", "speed", 1.0),
        lambda: interlocks.check_enable(bench.state, "output"),
        lambda: interlocks.check_procedure(bench.state, "calibration"),
    ):
        with pytest.raises(InterlockError, match="alarm is latched"):
            refused()
    interlocks.check_set_point(bench.state, "output", "torque", 0.0)


def test_no_power_without_a_torque_signal(bench: LowBench) -> None:
    bench.clock.wait(0.1)
    interlocks.check_enable(bench.state, "output")
    bench.simulated.twin.inject_fault("output_torque", "silent", duration_s=1.0)
    bench.clock.wait(0.1)
    with pytest.raises(SignalFault, match="output_torque"):
        interlocks.check_enable(bench.state, "output")


def test_no_mode_change_under_load(bench: LowBench) -> None:
    interlocks.check_mode_change(ready(bench).state, "input", "free")
    bench.load_output(500.0)
    with pytest.raises(InterlockError, match="500 N·m"):
        interlocks.check_mode_change(bench.state, "input", "free")
    bench.clock.wait(0.5)
    bench.commands.output.torque_nm = 0.0  # told to unload, and not unloaded yet
    with pytest.raises(InterlockError, match="output transducer reads"):
        interlocks.check_mode_change(bench.state, "output", "free")
    with pytest.raises(InputError, match="sideways"):
        interlocks.check_mode_change(bench.state, "output", "sideways")


def test_no_mode_change_in_motion(bench: LowBench) -> None:
    ready(bench).drivers.drives["output"].command_speed(1.0, 100.0)
    bench.clock.wait(1.0)
    with pytest.raises(InterlockError, match="turns at"):
        interlocks.check_mode_change(bench.state, "output", "free")


def test_the_clamp_closes_on_something_and_opens_without_load(bench: LowBench) -> None:
    bench.clock.wait(0.1)
    with pytest.raises(InterlockError, match="nothing mounted"):
        interlocks.check_clamp(bench.state, True)
    interlocks.check_clamp(bench.state, False)
    interlocks.check_clamp(ready(bench).state, False)
    bench.load_output(500.0)
    with pytest.raises(InterlockError, match="open the clamp"):
        interlocks.check_clamp(bench.state, False)


def test_mounting_needs_an_open_clamp_and_both_drives_off(bench: LowBench) -> None:
    interlocks.check_mounting(bench.state, "reducer")
    with pytest.raises(InputError, match="gearbox"):
        interlocks.check_mounting(bench.state, "gearbox")
    ready(bench)
    with pytest.raises(InterlockError, match="clamp closed"):
        interlocks.check_mounting(bench.state, "reducer")
    bench.drivers.clamp.set_clamped(False)
    with pytest.raises(InterlockError, match="output drive on"):
        interlocks.check_mounting(bench.state, "reducer")


@pytest.mark.parametrize(
    ("kind", "needed"),
    [
        ("calibration", "calibrator"),
        ("verification", "verification_standard"),
        ("reducer_test", "reducer"),
    ],
)
@pytest.mark.parametrize("mounted", ["calibrator", "verification_standard", "reducer", "nothing"])
def test_each_procedure_needs_its_own_thing_in_a_closed_clamp(
    bench: LowBench, kind: Any, needed: Any, mounted: Any
) -> None:
    bench.drivers.operator.mount(mounted)
    if mounted != needed:
        with pytest.raises(InterlockError, match=f"mount the {needed.replace('_', ' ')}"):
            interlocks.check_procedure(bench.state, kind)
        return
    with pytest.raises(InterlockError, match="clamp open"):
        interlocks.check_procedure(bench.state, kind)
    bench.drivers.clamp.set_clamped(True)
    interlocks.check_procedure(bench.state, kind)


def test_the_mounted_standard_is_known_by_its_serial(bench: LowBench) -> None:
    assert interlocks.standard_serial(bench.state) == ""
    bench.drivers.operator.mount("calibrator")
    assert interlocks.standard_serial(bench.state) == "SIM-CAL-1"
    bench.drivers.operator.mount("verification_standard")
    assert interlocks.standard_serial(bench.state) == "SIM-VER-1"


def test_an_empty_run_needs_nothing_between_the_flanges(bench: LowBench) -> None:
    bench.clock.wait(0.1)
    interlocks.check_procedure(bench.state, "empty_run")
    with pytest.raises(InterlockError, match="empty run with calibrator mounted"):
        interlocks.check_procedure(ready(bench).state, "empty_run")


def test_the_rail_moves_only_unloaded_and_unclamped(bench: LowBench) -> None:
    ready(bench).commands.output.enabled = False
    with pytest.raises(InterlockError, match="clamp closed"):
        interlocks.check_rail(bench.state, "away")
    bench.drivers.clamp.set_clamped(False)
    interlocks.check_rail(bench.state, "away")
    with pytest.raises(InputError, match="end, away"):
        interlocks.check_rail(bench.state, "between")
    bench.commands.output.enabled = True
    with pytest.raises(InterlockError, match="output drive on"):
        interlocks.check_rail(bench.state, "away")


def test_nothing_is_clamped_with_the_rail_away_from_its_end(bench: LowBench) -> None:
    ready(bench).drivers.clamp.set_clamped(False)
    bench.drivers.rail.move("away")
    with pytest.raises(InterlockError, match="drawn back"):
        interlocks.check_clamp(bench.state, True)
    bench.drivers.rail.move("end")
    interlocks.check_clamp(bench.state, True)


def test_no_drive_is_enabled_with_its_supply_off(bench: LowBench) -> None:
    interlocks.check_enable(ready(bench).state, "output")
    bench.drivers.supply.switch_supply(False)
    assert not bench.drivers.drives["output"].state().enabled
    with pytest.raises(InterlockError, match="supply off"):
        interlocks.check_enable(bench.state, "output")
