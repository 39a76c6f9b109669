"""NI cards with four counters and with analogue inputs, against a peer of the gRPC service."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from tests.peers.daqmx_server import CounterCardPeer
from tests.system.networked import daqmx, described

from torquebench.bench.blocks import Block
from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.instruments import open_role
from torquebench.errors import BenchError, InputError
from torquebench.validation import validated

SERIAL = 0x0A1B2C3D


def card(peer: CounterCardPeer, **keys: Any) -> dict[str, Any]:
    section = daqmx() | {"address": peer.address, "timeout_s": 5.0} | keys
    return {key: value for key, value in section.items() if value is not None}


def amplified(bench: BenchDescription, signal: str, full: float) -> BenchDescription:
    """Describe both modules with a signal for an analogue input."""
    values = bench.model_dump()
    for side in ("input", "output"):
        found = values[side]["transducer"]
        nominal = {"nominal_torque_nm": found["nominal_torque_nm"], "serial": found["serial"]}
        values[side]["transducer"] = nominal | {
            "signal": signal,
            "signal_at_nominal": full,
            "filter_delay_s": 0.0,
            "signal_uncertainty_percent": 0.01,
        }
    return validated(BenchDescription, values, "amplified")


def blocks(counter: Any, count: int, channels: set[str]) -> list[Block]:
    counter.select(frozenset(channels))
    return [counter.read_block(0.05) for _ in range(count)]


def test_four_counters_time_four_transducers_by_the_clock_of_an_unused_analogue_input() -> None:
    names = ["input_torque", "output_torque", "input_reference", "output_reference"]
    channels = {name: f"Dev1/ctr{k}" for k, name in enumerate(names)}
    with CounterCardPeer(SERIAL, 61_234.5, 0.0, {"Dev1/ai0": lambda _: 0.0}) as peer:
        section = card(peer, channels=channels, encoders=None, clock="Dev1/ai0")
        counter = open_role(described(counter=section), "counter")
        try:
            assert not counter.times_encoders, "so that [driver.angles] may read them"
            read = blocks(counter, 4, set(names))
            tasks = {task.counter: task for task in peer.tasks.values()}
        finally:
            counter.close()
    assert set(tasks) == {*channels.values(), "ai"}
    assert {task.triggers[-1] for port, task in tasks.items() if port != "ai"} == {
        "/Dev1/ai/StartTrigger"
    }
    for name in names:
        edges = np.concatenate([block.edges[name].ticks for block in read])
        expected = np.rint(np.arange(1, edges.size + 1) / 61_234.5 * 1e8)
        assert edges.size == int(0.2 * 61_234.5)
        np.testing.assert_array_equal(edges, expected.astype(np.int64))
    assert all(not block.records for block in read)


@pytest.mark.parametrize(
    ("signal", "full", "setting"),
    [("V", 10.0, "±10 V"), ("mV/V", 2.0, "±3 mV/V at 5 V, 350 ohm")],
)
def test_voltages_and_bridges_are_means_of_windows_beside_encoders_of_the_same_clock(
    signal: str, full: float, setting: str
) -> None:
    inputs: dict[str, Callable[[float], float]] = {
        "Dev1/ai0": lambda time_s: 0.5 * full * time_s,
        "Dev1/ai1": lambda _: -0.25 * full,
    }
    channels = {"input_torque": "Dev1/ai0", "output_torque": "Dev1/ai1"}
    with CounterCardPeer(SERIAL, 60_000.0, 36_000.0, inputs) as peer:
        bench = amplified(
            described(counter=card(peer, channels=channels, clock=None)), signal, full
        )
        counter = open_role(bench, "counter")
        try:
            read = blocks(counter, 4, set(channels))
            tasks = {task.counter: task for task in peer.tasks.values()}
        finally:
            counter.close()
    assert tasks["ai"].inputs == [("Dev1/ai0", setting), ("Dev1/ai1", setting)]
    assert tasks["Dev1/ctr2"].triggers == ["/Dev1/ai/SampleClock", "/Dev1/ai/StartTrigger"]
    assert counter.shortest_read_s == max(bench.counter.window_s, 0.025)
    rising = [block.records["input_torque"] for block in read]
    time_s = np.concatenate([record.time_s for record in rising])
    np.testing.assert_allclose(np.diff(time_s), bench.counter.window_s)
    assert all(
        block.start_s <= record.time_s[0] for block, record in zip(read, rising, strict=True)
    )
    values = np.concatenate([record["signal"] for record in rising])
    np.testing.assert_allclose(values, 0.5 * full * time_s, atol=1e-9)
    counts = np.concatenate([block.records["input_angle"]["angle_counts"] for block in read])
    np.testing.assert_array_equal(counts, np.arange(200) * 36)


def test_an_overloaded_input_is_missing_and_never_its_limit() -> None:
    inputs: dict[str, Callable[[float], float]] = {
        "Dev1/ai0": lambda time_s: 10.4 if 0.05 <= time_s < 0.1 else 9.9,
        "Dev1/ai1": lambda _: 0.0,
    }
    channels = {"input_torque": "Dev1/ai0", "output_torque": "Dev1/ai1"}
    with CounterCardPeer(SERIAL, 60_000.0, 0.0, inputs) as peer:
        section = card(peer, channels=channels, clock=None, encoders=None)
        counter = open_role(amplified(described(counter=section), "V", 10.0), "counter")
        try:
            read = blocks(counter, 3, set(channels))
        finally:
            counter.close()
    means = [block.records["input_torque"]["signal"] for block in read]
    assert [bool(np.isnan(mean).all()) for mean in means] == [False, True, False]
    assert not math.isnan(read[1].records["output_torque"]["signal"][0])


def test_a_terminal_that_the_card_does_not_have_is_an_error_with_code_and_task() -> None:
    with CounterCardPeer(SERIAL, 60_000.0, 0.0) as peer:
        section = card(peer, encoders=None, clock="Dev1/ai7")
        counter = open_role(described(counter=section), "counter")
        try:
            with pytest.raises(BenchError, match=r"starting the counters.*-200170"):
                blocks(counter, 1, {"input_torque"})
        finally:
            counter.close()


ANALOG = {"input_torque": "Dev1/ai0", "output_torque": "Dev1/ai1"}


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"encoders": {"input": "Dev1/ctr2"}}, "encoders = only one, input"),
        ({"encoders": None}, "clock = Dev1/ctr4.*an analogue input such as Dev1/ai0"),
        ({"clock": None}, "clock = missing; allowed: one more counter"),
        ({"channels": ANALOG}, "clock = Dev1/ctr4.*whose own clock times everything"),
        ({"channels": ANALOG, "clock": None}, "input_torque at an analogue input.*'frequency'"),
    ],
)
def test_a_card_that_could_not_be_timed_is_refused(keys: dict[str, Any], message: str) -> None:
    with CounterCardPeer(SERIAL, 60_000.0, 0.0) as peer, pytest.raises(InputError, match=message):
        open_role(described(counter=card(peer, **keys)), "counter")
