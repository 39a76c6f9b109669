"""Amplifiers and displays against peers of their manuals, over sockets and pseudo-terminals."""

import math
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import numpy as np
import pytest
from tests.peers.displays import DisplayPeer, ScalePeer
from tests.peers.hbm_amplifiers import PLATES, HbmPeer
from tests.peers.opcua_plc import PlcPeer
from tests.system.networked import described

from torquebench.bench.drivers.base import CounterCard, ReferenceReadout
from torquebench.bench.drivers.instruments import open_role
from torquebench.errors import BenchError, InputError

FAMILIES = ("DMP41", "MGCplus", "PMX")
LATE_BLOCKS = 40
"""So many blocks a busy computer may be late with a question in every window."""
OVERFLOW, LIMIT_SWITCH = 0x20, 0x05
MODULES = {"input_torque": 1, "output_torque": 2}
STANDARDS = {"input_reference": 1, "output_reference": 2}


def constant(value: float, status: int = 0) -> Callable[[], tuple[float, int]]:
    return lambda: (value, status)


def hbm(family: str, values: dict[int, Any] | None = None, *, serial: bool = False) -> HbmPeer:
    values = values or {1: constant(10.0), 2: constant(-250.5), 3: constant(0.0)}
    return HbmPeer(family, values, serial)  # type: ignore[arg-type]


def counter(peer: HbmPeer, family: str, **keys: Any) -> CounterCard:
    section = {
        "protocol": "hbm",
        "family": family,
        "address": peer.address,
        "channels": MODULES,
        "serial": "AMP-1",
    }
    opened: CounterCard = open_role(described(counter=section | keys), "counter")
    return opened


def displays(channels: dict[str, str], **keys: Any) -> CounterCard:
    section = {"protocol": "serial", "channels": channels, "serial": "D-1", "timeout_s": 1.0}
    opened: CounterCard = open_role(described(counter=section | keys), "counter")
    return opened


def signals(instrument: CounterCard, name: str, blocks: int = 2) -> list[float]:
    """Return the values of a channel that weren't lost on a busy computer."""
    read: list[float] = []
    for block in range(LATE_BLOCKS):
        stated = instrument.read_block(0.05).records[name]["signal"]
        assert stated.size == 5
        read += stated[~np.isnan(stated)].tolist()
        if read and block >= blocks:
            break
    return read


def read(instrument: CounterCard, blocks: int) -> None:
    for _ in range(blocks):
        instrument.read_block(0.05)


# -- HBM's interpreter ------------------------------------------------------------------------


@pytest.mark.parametrize("serial", [False, True], ids=["TCP", "RS-232"])
@pytest.mark.parametrize("family", FAMILIES)
def test_an_amplifier_states_the_values_of_the_modules(family: str, serial: bool) -> None:
    with hbm(family, serial=serial) as peer:
        amplifier = counter(peer, family)
        try:
            plate = PLATES[family].split(",")
            identity = amplifier.identity()
            assert (identity.manufacturer, identity.model) == ("HBM", plate[1])
            assert identity.serial == ("AMP-1" if plate[2] == "0" else plate[2])
            assert amplifier.clock_identity.startswith(f"{identity.serial}/")
            assert set(signals(amplifier, "input_torque")) == {10.0}
            assert set(signals(amplifier, "output_torque")) == {-250.5}
            amplifier.select(frozenset({"output_torque"}))
            block = amplifier.read_block(0.1)
        finally:
            amplifier.close()
    assert set(block.records) == {"output_torque"}
    time_s = block.records["output_torque"].time_s
    assert np.all(np.diff(time_s) > 0.0)
    assert block.start_s <= time_s[0] <= time_s[-1] <= block.stop_s


@pytest.mark.parametrize("family", FAMILIES)
def test_a_value_with_overflow_is_missing_and_one_at_a_limit_switch_is_not(family: str) -> None:
    switched = LIMIT_SWITCH if family == "DMP41" else 0
    values = {1: constant(10.0, OVERFLOW), 2: constant(20.0, switched)}
    with hbm(family, values) as peer:
        amplifier = counter(peer, family)
        try:
            assert signals(amplifier, "input_torque") == []
            assert set(signals(amplifier, "output_torque")) == {20.0}
        finally:
            amplifier.close()


def test_values_that_another_program_left_streaming_are_not_taken_for_answers() -> None:
    with hbm("DMP41", serial=True) as peer:
        peer.leave_streaming()
        peer.answer("SRB0")
        time.sleep(0.1)
        amplifier = counter(peer, "DMP41")
        try:
            assert not peer.streaming
            assert set(signals(amplifier, "input_torque")) == {10.0}
        finally:
            amplifier.close()


@pytest.mark.parametrize(("family", "command"), [("DMP41", "CHS130"), ("PMX", "PCS2,8")])
def test_a_channel_that_the_amplifier_does_not_have_is_refused_by_its_command(
    family: str, command: str
) -> None:
    channels = {"input_torque": 8, "output_torque": 2}
    with hbm(family) as peer, pytest.raises(BenchError, match=f"refuses '{command}'"):
        counter(peer, family, channels=channels)


def test_another_family_than_described_is_refused_by_name() -> None:
    with hbm("DMP41") as peer, pytest.raises(BenchError, match="refuses 'PCS1,2'"):
        counter(peer, "PMX")


def test_an_amplifier_that_is_slower_than_the_window_is_refused_on_opening() -> None:
    with hbm("DMP41") as peer:
        peer.busy_s = 0.03
        with pytest.raises(InputError, match=r"an answer takes 0\.\d+.*window_s = 0\.01"):
            counter(peer, "DMP41")


def test_a_window_that_was_not_asked_for_in_time_is_lost_and_the_next_one_is_not() -> None:
    with hbm("PMX") as peer:
        amplifier = counter(peer, "PMX")
        try:
            amplifier.read_block(0.05)
            time.sleep(0.1)
            late = amplifier.read_block(0.1).records["input_torque"]
            assert np.isnan(late["signal"]).any()
            assert signals(amplifier, "input_torque", 4)[-1] == 10.0
        finally:
            amplifier.close()


def test_a_cable_that_is_pulled_is_an_error_that_names_the_amplifier() -> None:
    with hbm("PMX") as peer:
        amplifier = counter(peer, "PMX", timeout_s=0.2)
        try:
            amplifier.read_block(0.05)
            peer.start("counter", "disconnect", duration_s=60.0)
            begun = time.monotonic()
            with pytest.raises(BenchError, match=peer.address):
                read(amplifier, 100)
            assert time.monotonic() - begun < 20.0
        finally:
            amplifier.close()


def test_an_amplifier_of_the_standard_states_samples_by_the_bench_clock() -> None:
    begun = time.monotonic()
    values = {1: lambda: (time.monotonic() - begun, 0), 2: constant(7.0)}
    with hbm("DMP41", values) as peer:
        section = {
            "protocol": "hbm",
            "family": "DMP41",
            "address": peer.address,
            "channels": STANDARDS,
            "period_s": 0.02,
        }
        readout: ReferenceReadout = open_role(described(reference=section), "reference")
        try:
            parts = []
            for _ in range(20):
                time.sleep(0.05)
                now_s = time.monotonic() - begun
                parts.append(readout.read("input", now_s, now_s))
                other = readout.read("output", now_s, now_s)["signal"]
                assert set(other[~np.isnan(other)]) <= {7.0}
        finally:
            readout.close()
    time_s = np.concatenate([part.time_s for part in parts])
    stated_s = np.concatenate([part["signal"] for part in parts])
    valid = ~np.isnan(stated_s)
    assert valid.sum() > 10
    assert np.all(np.diff(time_s) > 0.0)
    # its values are their own times, where this computer has not stood meanwhile
    assert np.median(np.abs(time_s - stated_s)[valid]) < 0.1


# -- displays ---------------------------------------------------------------------------------


def test_displays_are_asked_and_their_text_is_read() -> None:
    torque = {"input": 12.345, "output": -1500.0}
    with (
        DisplayPeer(lambda: torque["input"], comma=True) as one,
        DisplayPeer(lambda: torque["output"]) as two,
    ):
        channels = {"input_torque": one.address, "output_torque": two.address}
        instrument = displays(channels, request="P", terminator="\r")
        try:
            assert set(signals(instrument, "input_torque")) == {12.345}
            assert set(signals(instrument, "output_torque")) == {-1500.0}
            torque["input"] = math.nan
            assert signals(instrument, "input_torque") == []
            torque["input"] = 3.0
            assert set(signals(instrument, "input_torque")) == {3.0}
            assert instrument.identity().serial == "D-1"
        finally:
            instrument.close()


def test_boards_that_send_by_themselves_state_their_newest_whole_line() -> None:
    counts = iter(range(800_000, 10_000_000, 10))
    with ScalePeer(lambda: next(counts)) as one, ScalePeer(lambda: -838_861) as two:
        time.sleep(0.1)
        channels = {"input_torque": one.address, "output_torque": two.address}
        section = {"protocol": "serial", "channels": channels, "serial": "HX-1", "timeout_s": 1.0}
        bench = described(counter=section | {"scale": 2.0 / 838_861})
        slow = bench.counter.model_copy(update={"window_s": 0.05, "block_s": 0.05})
        instrument = open_role(bench.model_copy(update={"counter": slow}), "counter")
        try:
            blocks = [instrument.read_block(0.1) for _ in range(5)]
            rising = np.concatenate([block.records["input_torque"]["signal"] for block in blocks])
            rising = rising[~np.isnan(rising)] / (2.0 / 838_861)
            assert np.all(np.diff(rising) > 0.0)
            assert 800_000 <= rising.min() <= rising.max() < next(counts)
            assert blocks[-1].records["output_torque"]["signal"][-1] == pytest.approx(-2.0)
            one.silence()
            with pytest.raises(BenchError, match=r"display of input_torque.*no answer"):
                read(instrument, 6)
        finally:
            instrument.close()


def test_a_text_that_does_not_match_the_pattern_is_an_error_with_the_text() -> None:
    with DisplayPeer(lambda: 1.0) as one, DisplayPeer(lambda: 1.0) as two:
        channels = {"input_torque": one.address, "output_torque": two.address}
        keys = {"request": "P", "terminator": "\r", "pattern": r"(?P<value>\d+) lbf.ft"}
        with pytest.raises(BenchError, match=r"'1\.000 N\.m' doesn't match"):
            displays(channels, **keys)


def test_a_plug_that_is_pulled_out_is_an_error_that_names_the_port() -> None:
    with DisplayPeer(lambda: 1.0) as one, DisplayPeer(lambda: 2.0) as two:
        channels = {"input_torque": one.address, "output_torque": two.address}
        instrument = displays(channels, request="P", terminator="\r")
        try:
            instrument.read_block(0.05)
            one.pull_out()
            with pytest.raises(BenchError, match=one.address):
                read(instrument, 3)
        finally:
            instrument.close()


def test_a_pattern_without_a_value_is_refused() -> None:
    with pytest.raises(InputError, match=r"driver\.counter: pattern.*\(\?P<value>"):
        displays({"input_torque": "/dev/ttyS9", "output_torque": "/dev/ttyS8"}, pattern=r"\d+")


def test_a_standard_needs_a_channel_for_each_side() -> None:
    channels = {"input_reference": 1}
    with hbm("PMX") as peer:
        section = {"protocol": "hbm", "family": "PMX", "address": peer.address}
        bench = described(reference=section | {"channels": channels})
        with pytest.raises(InputError, match="without output_reference"):
            open_role(bench, "reference")


# -- a PLC by OPC UA --------------------------------------------------------------------------


def by_plc(peer: PlcPeer, *nodes: str) -> CounterCard:
    channels = dict(zip(("input_torque", "output_torque"), nodes, strict=True))
    section = {"protocol": "opcua", "address": peer.address, "serial": "PLC-1", "timeout_s": 2.0}
    opened: CounterCard = open_role(described(counter=section | {"channels": channels}), "counter")
    return opened


def test_a_variable_of_bad_quality_is_missing_and_never_its_last_value() -> None:
    torque: dict[str, float | None] = {"A": 10.0, "B": -3.5}
    with PlcPeer({name: lambda name=name: torque[name] for name in torque}) as peer:  # type: ignore[misc]
        instrument = by_plc(peer, "ns=2;s=A", "ns=2;s=B")
        try:
            assert set(signals(instrument, "input_torque")) == {10.0}
            assert instrument.identity().serial == "PLC-1"
            torque["A"] = None
            deadline = time.monotonic() + 60.0
            while (stated := signals(instrument, "input_torque")) and time.monotonic() < deadline:
                assert set(stated) == {10.0}
            assert set(signals(instrument, "output_torque")) == {-3.5}
        finally:
            instrument.close()


@pytest.mark.parametrize(
    ("node", "message"),
    [("ns=2;s=X", "no variable ns=2;s=X"), ("i=2261", "i=2261 of counter states '.+'")],
)
def test_a_variable_that_is_missing_or_no_number_is_named(node: str, message: str) -> None:
    with PlcPeer({"A": lambda: 1.0}) as peer, pytest.raises(BenchError, match=message):
        by_plc(peer, node, "ns=2;s=A")


def test_a_plc_that_starts_again_is_read_again() -> None:
    with ExitStack() as running:
        with PlcPeer({"A": lambda: 1.0}) as peer:
            instrument = by_plc(peer, "ns=2;s=A", "ns=2;s=A")
            running.callback(instrument.close)
            assert set(signals(instrument, "input_torque")) == {1.0}
        running.enter_context(PlcPeer({"A": lambda: 2.0}, peer.port))
        deadline = time.monotonic() + 60.0
        while not (stated := signals(instrument, "input_torque")):  # windows of its absence
            assert time.monotonic() < deadline
        assert set(stated) == {2.0}
        instrument.close()
