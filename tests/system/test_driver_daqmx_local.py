"""The NI-DAQmx driver without an address: this computer's driver, whose library NI alone has.

Below the `nidaqmx` package the calls go to the simulated device instead of NI's library; the
driver and the package are those of a card in this computer.
"""

import itertools
from collections.abc import Iterator
from typing import Any

import grpc
import nidaqmx
import pytest
from nidaqmx import _library_interpreter
from nidaqmx._grpc_interpreter import GrpcStubInterpreter
from tests.system.networked import daqmx, described, modbus

from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.instruments import open_role
from torquebench.errors import BenchError
from torquebench.simulators import Simulators


@pytest.fixture(scope="module")
def simulators() -> Iterator[Simulators]:
    with Simulators(described(reference=modbus(), counter=daqmx())) as running:
        yield running


def local(description: BenchDescription) -> BenchDescription:
    section = dict(description.driver["counter"])
    del section["address"]
    return description.model_copy(
        update={"driver": dict(description.driver) | {"counter": section}}
    )


def test_a_card_in_this_computer_is_read_every_few_milliseconds(
    simulators: Simulators, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = itertools.count()
    with grpc.insecure_channel(simulators.description.driver["counter"]["address"]) as channel:

        def library() -> Any:
            session = nidaqmx.GrpcSessionOptions(channel, f"local-{next(names)}")
            return GrpcStubInterpreter(session)

        monkeypatch.setattr(_library_interpreter, "LibraryInterpreter", library)
        counter = open_role(local(simulators.description), "counter")
        try:
            assert counter.shortest_read_s == 0.0
            assert counter.identity().details["address"] == "local"
            counter.select(frozenset({"input_torque"}))
            blocks = [counter.read_block(0.005) for _ in range(8)]
        finally:
            counter.close()
    for before, after in itertools.pairwise(blocks):
        assert after.start_s == before.stop_s
        assert abs(len(after.edges["input_torque"]) - 300) < 10
        assert len(after.records["output_angle"]) == 5


def test_without_the_native_driver_it_says_what_is_missing(simulators: Simulators) -> None:
    with pytest.raises(BenchError, match="NI-DAQmx driver isn't installed") as caught:
        open_role(local(simulators.description), "counter")
    assert "driver.counter.address" in caught.value.remedy
