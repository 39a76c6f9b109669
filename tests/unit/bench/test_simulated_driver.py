from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from torquebench.bench.blocks import Block
from torquebench.bench.description import BenchDescription, default_bench
from torquebench.bench.drivers import open_drivers
from torquebench.bench.drivers.base import (
    Clamp,
    CounterCard,
    Drive,
    DriverSet,
    ModeConverter,
    OperatorPrompts,
    ReferenceReadout,
    Temperature,
    TrueTorqueSource,
)
from torquebench.errors import BenchError, InputError

Describe = Callable[..., BenchDescription]


def loaded(description: BenchDescription, torque_nm: float = 200.0) -> DriverSet:
    drivers = open_drivers(description)
    drivers.operator.mount("calibrator")
    drivers.clamp.set_clamped(True)
    drivers.modes.set_mode("input", "locked")
    drivers.modes.set_mode("output", "driven")
    drivers.drives["output"].enable()
    drivers.drives["output"].command_torque(torque_nm, 1000.0)
    return drivers


def run(drivers: DriverSet, duration_s: float, block_s: float = 0.05) -> list[Block]:
    blocks = []
    for _ in range(round(duration_s / block_s)):
        drivers.drives["output"].feed_watchdog()
        blocks.append(drivers.counter.read_block(block_s))
    return blocks


def test_it_plays_every_role(describe: Describe) -> None:
    drivers = open_drivers(describe(driver__reference="readout"))
    assert isinstance(drivers.counter, CounterCard)
    assert isinstance(drivers.modes, ModeConverter)
    assert isinstance(drivers.clamp, Clamp)
    assert isinstance(drivers.temperature, Temperature)
    assert isinstance(drivers.operator, OperatorPrompts)
    assert isinstance(drivers.reference, ReferenceReadout)
    assert isinstance(drivers.truth, TrueTorqueSource)
    assert all(isinstance(drive, Drive) for drive in drivers.drives.values())
    serials = {identity.role: identity.serial for identity in drivers.identities()}
    assert serials["input.drive"] == "SIM-DRIVE-IN"
    assert drivers.counter.clock_identity == "SIM-COUNTER-1/oscillator-1"
    drivers.close()
    drivers.close()


def test_blocks_follow_each_other_without_gap_or_overlap(describe: Describe) -> None:
    drivers = loaded(describe())
    blocks = run(drivers, 0.5)
    for channel, first in blocks[0].edges.items():
        stop = first.start_tick
        for block in blocks:
            assert block.edges[channel].start_tick == stop
            assert (np.diff(block.edges[channel].ticks) > 0).all()
            stop = block.edges[channel].stop_tick


def test_the_same_seed_gives_the_same_edges_and_another_one_does_not(describe: Describe) -> None:
    def ticks(seed: int) -> Any:
        blocks = run(loaded(describe(driver__seed=seed)), 0.3)
        return np.concatenate([block.edges["output_torque"].ticks for block in blocks])

    first, again, other = ticks(3), ticks(3), ticks(4)
    np.testing.assert_array_equal(first, again)
    assert first.size != other.size or (first != other).any()


def test_an_idle_channel_has_no_edges_and_comes_back(describe: Describe) -> None:
    drivers = open_drivers(describe())
    drivers.operator.mount("calibrator")
    drivers.counter.select(frozenset({"input_torque"}))
    assert set(drivers.counter.read_block(0.05).edges) == {"input_torque"}
    drivers.counter.select(frozenset({"input_torque", "output_reference"}))
    assert len(drivers.counter.read_block(0.05).edges["output_reference"]) > 2000


def test_a_drive_ramps_at_its_rate_and_reports_its_set_point(describe: Describe) -> None:
    drivers = loaded(describe(), torque_nm=200.0)  # at 1000 N·m/s
    setpoints = []
    for _ in range(6):
        run(drivers, 0.05)
        setpoints.append(drivers.drives["output"].state().torque_nm)
    assert setpoints == pytest.approx([50.0, 100.0, 150.0, 200.0, 200.0, 200.0])
    drivers.drives["output"].ramp_to_zero(0.1)
    run(drivers, 0.05)
    assert drivers.drives["output"].state().torque_nm == pytest.approx(100.0)
    run(drivers, 0.05)
    assert drivers.drives["output"].state().torque_nm == 0.0


def test_a_drive_that_nobody_feeds_takes_its_torque_off_by_itself(describe: Describe) -> None:
    drivers = loaded(describe(output__drive__watchdog_s=0.2))
    for _ in range(6):
        drivers.counter.read_block(0.05)
    state = drivers.drives["output"].state()
    assert not state.enabled
    assert "watchdog" in state.fault
    with pytest.raises(BenchError, match="watchdog"):
        drivers.drives["output"].command_torque(1.0, 1.0)


def test_the_true_torque_is_the_one_that_was_asked_for_within_the_loading_accuracy(
    describe: Describe,
) -> None:
    drivers = loaded(describe())
    run(drivers, 1.0)
    assert drivers.truth is not None
    assert drivers.truth.true_torque("output", 0.6, 0.9) == pytest.approx(200.0, abs=4.0)
    with pytest.raises(BenchError, match="true torque"):
        drivers.truth.true_torque("output", 900.0, 901.0)


def test_a_dense_sweep_follows_the_path_with_its_branches(describe: Describe) -> None:
    drivers = open_drivers(describe())
    assert drivers.truth is not None
    reading, branch = drivers.truth.dense_sweep("output", np.array([0.0, 1000.0, 2000.0, 1000.0]))
    assert reading == pytest.approx([0.0, 1000.0, 2000.0, 1000.0], abs=0.02 * 2000.0)
    assert branch[1:].tolist() == [1, 1, -1]


def test_it_refuses_a_description_of_another_bench(describe: Describe) -> None:
    with pytest.raises(InputError, match=r"output\.transducer: 5000 N·m"):
        open_drivers(describe(output__transducer__nominal_torque_nm=5000))
    with pytest.raises(InputError, match="360000 counts per revolution"):
        open_drivers(describe(input__encoder__counts_per_revolution=1000))
    with pytest.raises(InputError, match="timebase_hz"):
        open_drivers(describe(counter__timebase_hz=80e6))


def test_a_closed_counter_says_so(describe: Describe) -> None:
    drivers = open_drivers(describe())
    drivers.close()
    with pytest.raises(BenchError, match="closed"):
        drivers.counter.read_block(0.05)


def test_a_transducer_alone_has_no_chain_and_the_reducer_its_certificate() -> None:
    drivers = open_drivers(default_bench())
    assert drivers.truth is not None
    path = np.linspace(0.0, 2000.0, 11)
    chain, alone = (
        np.max(np.abs(drivers.truth.dense_sweep("output", path, alone=each)[0] - path))
        for each in (False, True)
    )
    assert alone < 0.3 * chain
    certified = drivers.reducer_certificate
    assert [point.speed_rpm for point in certified[-2:]] == [1100.0, 1200.0]
    assert 0.2 < certified[0].torque_nm < certified[-1].torque_nm < 1.5
