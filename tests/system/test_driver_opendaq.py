"""The openDAQ driver against openDAQ's own reference device, streamed over a real socket."""

import socket
import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import opendaq
import pytest
from tests.system.networked import described

from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.instruments import open_role
from torquebench.errors import BenchError, InputError

SERIAL = "DevSer0"


class ReferenceDevice:
    """Two channels that state a constant with noise, 1000 samples a second."""

    def __init__(self) -> None:
        with socket.create_server(("127.0.0.1", 0)) as reserved:
            self.port = reserved.getsockname()[1]
        builder = opendaq.InstanceBuilder()
        builder.global_log_level = opendaq.LogLevel.Off
        self.instance = builder.build()
        self.instance.set_root_device("daqref://device0")
        for channel in self.instance.channels:
            for name, value in (("Amplitude", 0.0), ("DC", 1.0), ("NoiseAmplitude", 0.005)):
                channel.set_property_value(name, value)
        kind = "OpenDAQNativeStreaming"
        found = opendaq.IServerType.cast_from(self.instance.available_server_types[kind])
        settings = opendaq.IComponentType.cast_from(found).create_default_config()
        settings.set_property_value("NativeStreamingPort", self.port)
        self.instance.add_server(kind, settings)

    def stop(self) -> None:
        for server in list(self.instance.servers):
            self.instance.remove_server(server)


@pytest.fixture(scope="module")
def device() -> Iterator[ReferenceDevice]:
    served = ReferenceDevice()
    yield served
    served.stop()


def bench(port: int, **keys: Any) -> BenchDescription:
    def signal(name: str) -> dict[str, Any]:
        return {"signal": name, "scale_hz": 1000.0, "offset_hz": 59e3}

    counter = {
        "protocol": "opendaq",
        "address": f"daq.nd://127.0.0.1:{port}",
        "channels": {"input_torque": signal("AI0"), "output_torque": signal("AI1")},
        "timeout_s": 20.0,
        **keys,
    }
    return described(counter=counter)


@pytest.fixture
def counter(device: ReferenceDevice) -> Iterator[Any]:
    opened = open_role(bench(device.port), "counter")
    yield opened
    opened.close()


def test_it_says_who_it_is(counter: Any) -> None:
    identity = counter.identity()
    assert identity.serial == SERIAL
    assert identity.manufacturer == "openDAQ"
    assert counter.clock_identity == f"{SERIAL}/oscillator-1"


def test_blocks_follow_each_other_without_a_gap(counter: Any) -> None:
    counter.select(frozenset({"input_torque"}))
    first, second = counter.read_block(0.05), counter.read_block(0.1)
    assert first.stop_s == second.start_s
    assert set(first.records) == {"input_torque"}
    samples = second.records["input_torque"]
    assert len(samples) == 10
    np.testing.assert_allclose(samples["frequency_hz"], 60e3, atol=10.0)
    assert not samples["fault"].any()


def test_a_channel_below_nothing_is_silent_and_no_number(device: ReferenceDevice) -> None:
    channels = {
        "input_torque": {"signal": "AI0", "scale_hz": 1000.0, "offset_hz": -1e4},
        "output_torque": {"signal": "RefCh1/Sig/AI1", "scale_hz": 1000.0},
    }
    opened = open_role(bench(device.port, channels=channels), "counter")
    try:
        samples = opened.read_block(0.05).records["input_torque"]
        assert samples["fault"].all()
        assert np.isnan(samples["frequency_hz"]).all()
    finally:
        opened.close()


def test_a_signal_that_the_device_does_not_have_is_named(device: ReferenceDevice) -> None:
    channels = {
        "input_torque": {"signal": "AI7", "scale_hz": 1.0},
        "output_torque": {"signal": "AI1", "scale_hz": 1.0},
    }
    with pytest.raises(InputError, match="AI7"):
        open_role(bench(device.port, channels=channels), "counter")


def test_volts_are_no_frequency(device: ReferenceDevice) -> None:
    channels = {"input_torque": {"signal": "AI0"}, "output_torque": {"signal": "AI1"}}
    with pytest.raises(InputError, match="signal of input_torque in V"):
        open_role(bench(device.port, channels=channels), "counter")


def test_a_window_without_whole_samples_is_refused(device: ReferenceDevice) -> None:
    description = bench(device.port)
    counting = description.counter.model_copy(update={"window_s": 0.0025, "block_s": 0.05})
    with pytest.raises(InputError, match="samples a second"):
        open_role(description.model_copy(update={"counter": counting}), "counter")


def test_nobody_at_its_address_is_an_error_that_names_it() -> None:
    with pytest.raises(BenchError, match=r"127\.0\.0\.1:9"):
        open_role(bench(9), "counter")


def test_a_device_that_goes_is_an_error_in_time() -> None:
    leaving = ReferenceDevice()
    opened = open_role(bench(leaving.port, timeout_s=1.0), "counter")
    try:
        opened.read_block(0.05)
        leaving.stop()
        started = time.monotonic()
        with pytest.raises(BenchError, match="samples"):
            opened.read_block(2.0)
        assert time.monotonic() - started < 60.0
    finally:
        opened.close()


def test_it_closes_twice_and_answers_nobody_afterwards(device: ReferenceDevice) -> None:
    opened = open_role(bench(device.port), "counter")
    closer = threading.Thread(target=opened.close)
    closer.start()
    closer.join()
    opened.close()
    with pytest.raises(BenchError, match="closed"):
        opened.read_block(0.05)
