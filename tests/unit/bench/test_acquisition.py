import threading
import time
from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tests.support.draws import nightly

from torquebench.bench import acquisition
from torquebench.bench.active_chain import ActiveChain
from torquebench.bench.blocks import CONDITIONS, Block
from torquebench.bench.roles import CHANNELS
from torquebench.chain import MeasuringChain, Temperature, Zero
from torquebench.compensation import features, make_model
from torquebench.errors import BenchError, SignalFault
from torquebench.signals import SignalFaultKind

if TYPE_CHECKING:
    from tests.unit.bench.conftest import LowBench
else:
    LowBench = Any

OpenBench = Callable[..., Any]


class Journal:
    """Keeps blocks in memory, until it is told to fail."""

    def __init__(self) -> None:
        self.blocks: list[Block] = []
        self.full = False

    def write(self, block: Block) -> None:
        if self.full:
            raise OSError(28, "No space left on device")
        self.blocks += [block.part(*bounds) for bounds in pairwise(bounds_of(block))]

    @property
    def indices(self) -> list[int]:
        return indices_of(self.blocks)


def bounds_of(block: Block) -> list[float]:
    """When the blocks begin and end that were joined into one."""
    return [block.start_s, *block.records[CONDITIONS].time_s.tolist()]


def indices_of(blocks: Iterable[Block]) -> list[int]:
    return [round(block.start_s / 0.05) for block in blocks]


def test_torque_comes_out_of_edges_within_the_chains_error(bench: LowBench) -> None:
    bench.load_output(400.0)
    bench.clock.wait_until(1.0)
    reading = bench.acquisition.window("output_torque", 0.6, 0.9)
    standard = bench.acquisition.window("output_reference", 0.6, 0.9)
    assert len(reading) == len(standard) == 30
    assert reading["reading_nm"].mean() == pytest.approx(400.0, abs=0.02 * 2000.0)
    true = bench.simulated.true_torque("output", 0.6, 0.9)
    assert standard["reading_nm"].mean() == pytest.approx(true, abs=5.0)


def test_it_stands_still_when_nobody_needs_time(bench: LowBench) -> None:
    bench.clock.wait(0.2)
    before = bench.acquisition.blocks
    assert not bench.clock.wait_for_demand(0.1)
    assert bench.acquisition.blocks == before


def timed(bench: LowBench) -> set[str]:
    return {name for name in bench.acquisition.latest_block.records if name in CHANNELS}


def test_the_modules_always_run_and_a_standard_only_while_it_is_used(bench: LowBench) -> None:
    assert timed(bench) == {"input_torque", "output_torque"}
    with pytest.raises(SignalFault, match="nothing mounted"):
        bench.acquisition.reading_nm("output_reference")
    bench.drivers.operator.mount("verification_standard")
    bench.acquisition.select_for("verification_standard")
    bench.clock.wait(0.1)
    assert len(timed(bench)) == 4
    bench.acquisition.use_reference("input")
    bench.clock.wait(0.1)
    assert "output_reference" not in timed(bench)
    bench.acquisition.use_reference("output")
    bench.clock.wait(0.1)
    assert bench.acquisition.reading_nm("output_reference") == pytest.approx(0.0, abs=5.0)


def test_a_measured_zero_holds_until_another_standard_is_mounted(bench: LowBench) -> None:
    bench.drivers.operator.mount("calibrator")
    bench.acquisition.select_for("calibrator")
    bench.clock.wait_until(0.3)
    for channel in ("output_torque", "output_reference"):
        mean = bench.acquisition.window(channel, 0.1, 0.3)["frequency_hz"].mean()
        bench.acquisition.set_zero(channel, float(mean), 0.0)
    bench.clock.wait_until(0.5)
    reading = bench.acquisition.window("output_torque", 0.35, 0.5)["reading_nm"]
    assert abs(reading.mean()) < 0.5
    bench.acquisition.select_for("verification_standard")
    assert bench.acquisition.channel("output_reference").zero == 60e3
    assert bench.acquisition.channel("output_torque").zero != 60e3
    with pytest.raises(SignalFault, match="4 % of the nominal torque"):
        bench.acquisition.set_zero("output_torque", 70e3, 0.0)


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ("silent", {SignalFaultKind.NO_PULSES, SignalFaultKind.MISSING_PULSES}),
        ("missing_pulses", {SignalFaultKind.MISSING_PULSES}),
        ("doubled_pulses", {SignalFaultKind.DOUBLED_PULSES}),
        ("out_of_modulation", {SignalFaultKind.OUT_OF_MODULATION}),
    ],
)
def test_a_fault_is_carried_as_a_fault_and_never_as_a_number(
    bench: LowBench, kind: Any, expected: set[SignalFaultKind]
) -> None:
    bench.clock.wait_until(0.2)
    bench.simulated.twin.inject_fault("output_torque", kind, duration_s=0.1)
    bench.clock.wait_until(0.4)
    samples = bench.acquisition.channel("output_torque").recent.window(0.22, 0.29)
    assert {SignalFaultKind(code) for code in samples["fault"].tolist()} <= expected
    assert np.isnan(samples["reading_nm"]).all()
    with pytest.raises(SignalFault, match="output_torque"):
        bench.acquisition.window("output_torque", 0.22, 0.29)
    assert len(bench.acquisition.window("input_torque", 0.22, 0.29))
    bench.clock.wait_until(0.6)
    assert len(bench.acquisition.window("output_torque", 0.4, 0.6))


def test_a_standard_with_its_own_readout_gives_the_same_torque(open_bench: OpenBench) -> None:
    def standard(reference: str) -> Any:
        with open_bench(driver__reference=reference) as bench:
            bench.load_output(300.0)
            bench.clock.wait_until(0.8)
            channel = bench.acquisition.channel("output_reference")
            counted = channel.transducer.scale().signal(10.0 / 15.0)
            channel.zero = float(counted)  # in Hz, or in N·m
            bench.clock.wait_until(1.0)
            return channel.recent.window(0.5, 1.0)

    by_edges, by_readout = standard("edges"), standard("readout")
    np.testing.assert_allclose(by_readout.time_s, by_edges.time_s)
    np.testing.assert_allclose(by_readout["reading_nm"], by_edges["reading_nm"], rtol=1e-9)


def test_the_journal_gets_every_block_in_order(bench: LowBench) -> None:
    journal = Journal()
    bench.clock.wait_until(0.1)
    bench.acquisition.set_journal(journal)
    bench.clock.wait(1.0)
    bench.acquisition.set_journal(None)
    count = len(journal.blocks)
    bench.clock.wait(0.5)
    assert len(journal.blocks) == count == 20
    assert journal.indices == list(range(2, 22))


def test_a_viewer_may_begin_before_it_is_added(bench: LowBench) -> None:
    bench.acquisition.remember(0.5)
    bench.clock.wait_until(2.0)
    viewer = bench.acquisition.add_viewer(before_s=0.3)
    bench.clock.wait(0.2)
    late = bench.acquisition.add_viewer(before_s=9.0)
    blocks = [block for _ in range(len(viewer._blocks)) if (block := viewer.get(0.0))]
    assert blocks[0].start_s <= 1.7 + 1e-9
    assert blocks[-1].stop_s >= 2.2 - 1e-9
    for before, after in pairwise(blocks):
        assert after.follows(before)
    remembered = [block for _ in range(len(late._blocks)) if (block := late.get(0.0))]
    assert sum(block.stop_s - block.start_s for block in remembered) >= 0.5 - 1e-9
    assert not any(block.edges for block in remembered)


def test_what_is_remembered_takes_few_objects(bench: LowBench) -> None:
    bench.acquisition.remember(10.0)
    bench.clock.wait_until(12.0)
    kept = [*bench.acquisition._past, *bench.acquisition._newest]
    assert 10.0 <= kept[-1].stop_s - kept[0].start_s <= 12.0 + 1e-9
    assert len(kept) < 40  # 240 blocks of 50 ms
    assert all(after.follows(before) for before, after in pairwise(kept))


def test_a_complete_viewer_misses_nothing_in_fast_time(bench: LowBench) -> None:
    viewer = bench.acquisition.add_viewer(2, complete=True)
    bench.clock.require(2.0)
    blocks = []
    while not blocks or blocks[-1].stop_s < 2.0 - 1e-9:
        block = viewer.get(60.0)
        assert block is not None
        blocks.append(block)
    assert viewer.dropped == 0
    assert all(after.follows(before) for before, after in pairwise(blocks))
    bench.clock.require(4.0)
    bench.acquisition.remove_viewer(viewer)  # acquisition waits for nobody who has gone
    bench.clock.wait_until(4.0)


def test_a_failing_journal_brings_the_bench_to_its_safe_state(bench: LowBench) -> None:
    journal = Journal()
    bench.load_output(500.0)
    bench.acquisition.set_journal(journal)
    bench.clock.wait(0.3)
    journal.full = True
    with pytest.raises(Exception, match="No space left"):
        bench.clock.wait(30.0)
    assert bench.supervisor.wait_safe(60.0)
    assert bench.zeroed_and_off()
    alarm = bench.supervisor.alarm
    assert alarm is not None
    assert alarm.kind.value == "journal failed"


def test_a_slow_viewer_loses_blocks_and_nobody_else_does(bench: LowBench) -> None:
    journal, slow, quick = Journal(), bench.acquisition.add_viewer(3), []
    viewer = bench.acquisition.add_viewer()
    bench.acquisition.set_journal(journal)
    bench.clock.wait(1.0)
    quick = list(iter(lambda: viewer.get(0.0), None))
    assert len(quick) == len(journal.blocks) == 20
    assert slow.dropped == 17
    assert indices_of(iter(lambda: slow.get(0.0), None)) == [18, 19, 20]
    bench.acquisition.remove_viewer(slow)
    bench.clock.wait(0.5)
    assert list(iter(lambda: slow.get(0.0), None)) == []
    assert bench.supervisor.alarm is None


def test_an_active_compensation_works_on_live_samples(bench: LowBench) -> None:
    readings = np.linspace(-300.0, 300.0, 61)
    model = make_model("polynomial", degree=1, range_nm=300.0).fit(
        readings[:, None], 1.01 * readings + 0.5
    )
    bench.acquisition.set_compensation(
        "output", ActiveChain(MeasuringChain(model), "1", "polynomial")
    )
    viewer = bench.acquisition.add_viewer()
    bench.load_output(200.0)
    bench.clock.wait(0.8)
    block = list(iter(lambda: viewer.get(0.0), None))[-1]
    assert block.stop_s == bench.acquisition.latest_block.stop_s
    reading = block.records["output_torque"]["reading_nm"]
    compensated = block.torques["output"]
    np.testing.assert_allclose(compensated.value_nm, 1.01 * reading + 0.5, atol=1e-6)
    assert (compensated.standard_uncertainty_nm >= 0.0).all()
    assert (block.records["output_torque"]["counter_nm"] > 0.0).all()
    bench.command_torque(500.0, 1e5)
    bench.clock.wait(0.5)
    beyond = list(iter(lambda: viewer.get(0.0), None))[-1].torques["output"]
    assert np.isnan(beyond.value_nm).all(), "beyond the calibrated range there is no number"
    bench.acquisition.set_compensation("output", None)
    bench.clock.wait(0.1)
    assert not list(iter(lambda: viewer.get(0.0), None))[-1].torques


@pytest.mark.parametrize("held", [1, nightly(7)])
def test_blocks_kept_together_state_the_same_to_the_last_bit(
    open_bench: OpenBench, monkeypatch: pytest.MonkeyPatch, held: int
) -> None:
    """Fast time compensates and keeps many blocks at once; the records don't show it."""
    size = np.concatenate((np.linspace(0.04, 1.0, 13), np.linspace(0.98, 0.02, 13)))
    torque, up = 500.0 * np.concatenate((size, -size)), np.tile(np.repeat([1.0, -1.0], 13), 2)
    loop = torque + 1e-3 * up * (500.0 - np.abs(torque)) * np.sign(torque)
    model = make_model("hybrid", range_nm=500.0).fit(
        features(torque, up, np.where(torque > 0, 1, 2)), loop
    )
    effects = (Zero("drift", 1.0), Temperature("data sheet", 0.1, 0.001, 23.0))

    def run(held_blocks: int) -> list[Block]:
        monkeypatch.setattr(acquisition, "HELD_BLOCKS", held_blocks)
        journal = Journal()
        with open_bench() as bench:
            bench.acquisition.set_journal(journal)
            bench.acquisition.set_compensation(
                "output", ActiveChain(MeasuringChain(model, effects), "1", "hybrid")
            )
            bench.load_output(300.0)
            bench.clock.wait(2.0)
            bench.acquisition.set_zero("output_torque", 60_001.0, 0.02)
            bench.command_torque(-200.0, 1000.0)
            bench.clock.wait(2.0)
            bench.acquisition.set_journal(None)
        return journal.blocks

    together, single = run(20), run(held)
    assert len(together) == len(single) == 80
    for first, second in zip(together, single, strict=True):
        assert first.records.keys() == second.records.keys()
        for name, record in first.records.items():
            for column in record:
                np.testing.assert_array_equal(record[column], second.records[name][column])
        for side, torque in first.torques.items():
            other = second.torques[side]
            np.testing.assert_array_equal(torque.value_nm, other.value_nm)
            np.testing.assert_array_equal(
                torque.standard_uncertainty_nm, other.standard_uncertainty_nm
            )


def test_fast_time_compensates_and_keeps_many_blocks_at_once(bench: LowBench) -> None:
    counts: list[int] = []

    class Counting(Journal):
        def write(self, block: Block) -> None:
            counts.append(len(block.records[CONDITIONS]))

    bench.acquisition.set_journal(Counting())
    bench.clock.wait(1.0)
    bench.clock.wait(0.1)
    assert counts == [20, 2]


def test_speed_angle_and_temperature_are_those_of_the_bench(bench: LowBench) -> None:
    bench.load_output(0.0)
    bench.drivers.drives["output"].command_speed(1.0, 100.0)
    bench.clock.wait_until(2.0)
    assert bench.acquisition.speed_rad_s("output") == pytest.approx(1.0, abs=0.05)
    assert bench.acquisition.mean_speed_rad_s("output", 1.0, 2.0) == pytest.approx(1.0, abs=0.02)
    angles = bench.acquisition.angles("output", 1.0, 2.0)
    assert angles["angle_rad"][-1] - angles["angle_rad"][0] == pytest.approx(1.0, abs=0.02)
    assert bench.acquisition.angle_rad("output") > 1.0
    assert 10.0 < bench.acquisition.temperature_c("ambient") < 35.0
    with pytest.raises(SignalFault, match="nowhere"):
        bench.acquisition.temperature_c("nowhere")


def test_an_instrument_that_fails_ends_acquisition_and_wakes_whoever_waits(
    bench: LowBench,
) -> None:
    bench.load_output(500.0)
    bench.clock.wait(0.2)
    bench.simulated.close()
    with pytest.raises(BenchError, match="closed"):
        bench.clock.wait(1.0)
    assert bench.supervisor.wait_safe(60.0)
    assert bench.zeroed_and_off()
    with pytest.raises(BenchError, match="acquisition has ended"):
        bench.clock.wait(1.0)


def test_real_time_follows_the_wall(open_bench: OpenBench) -> None:
    with open_bench(real_time=True) as bench:
        started = time.monotonic()
        bench.clock.wait(0.5)
        assert time.monotonic() - started > 0.4


def test_blocks_of_a_bench_at_rest_are_held_for_patient_viewers(
    open_bench: OpenBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    with open_bench(real_time=True, safety__stall_s=60.0) as bench:
        evaluator, held = bench.acquisition._evaluator, []
        compensate = evaluator.compensate

        def compensating(blocks: list[Block], *others: Any) -> Block:
            held.append(len(blocks))
            return compensate(blocks, *others)

        def largest_held(duration_s: float) -> int:
            """Return how many blocks were held at most after the first ones."""
            del held[:]
            stop_s = bench.clock.now() + duration_s
            while bench.clock.now() < stop_s:  # a sleeper would have them released
                time.sleep(0.01)
            return max(held[1:], default=0)

        monkeypatch.setattr(evaluator, "compensate", compensating)
        viewer = bench.acquisition.add_viewer(1000)
        assert largest_held(0.6) == 1
        viewer.patience_s = 0.5
        assert largest_held(1.5) == 10
        bench.acquisition.add_viewer(1000)
        assert largest_held(0.6) == 1, "another viewer waits"
        bench.load_output(100.0)
        assert largest_held(0.6) == 1
        seen = []
        while (block := viewer.get(0.0)) is not None:
            seen.append((block.start_s, block.stop_s))
    for (_, stop_s), (start_s, _) in pairwise(seen):
        assert start_s == pytest.approx(stop_s, abs=1e-9)


def test_closing_leaves_no_thread(open_bench: OpenBench) -> None:
    before = threading.active_count()
    with open_bench() as bench:
        bench.clock.wait(0.1)
        assert threading.active_count() == before + 2
        bench.acquisition.close()
        bench.acquisition.close()
        with pytest.raises(BenchError, match="closed"):
            bench.clock.wait(1.0)
    assert threading.active_count() == before
