import sys
from importlib import metadata
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.system.networked import described

from torquebench.bench.drivers import open_drivers
from torquebench.bench.drivers.base import DriverSet
from torquebench.bench.drivers.instruments import open_role
from torquebench.bench.drivers.links import Link, WireError, split_address
from torquebench.bench.drivers.modbus import register_map
from torquebench.bench.drivers.plugins import (
    DriverPlugin,
    InstrumentRequest,
    find_plugin,
    protocols,
)
from torquebench.bench.drivers.scpi.link import numbers
from torquebench.errors import BenchError, InputError

CLAMP = object()


def own_plugin() -> DriverPlugin:
    def opener(request: InstrumentRequest) -> object:
        assert request.options == {"colour": "red"}
        assert request.role == "clamp"
        return CLAMP

    def bench(description: Any) -> DriverSet:
        raise BenchError(f"{description.name} opened by a plug-in")

    return DriverPlugin("own", {"clamp": opener}, bench)


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have a package with an entry point installed."""
    point = metadata.EntryPoint("own", f"{__name__}:own_plugin", "torquebench.drivers")
    monkeypatch.setitem(sys.modules, __name__, sys.modules.get(__name__, _this_module()))
    real = metadata.entry_points

    def entry_points(**selection: Any) -> Any:
        if selection.get("group") == "torquebench.drivers":
            return [point]
        return real(**selection)

    monkeypatch.setattr(metadata, "entry_points", entry_points)


def _this_module() -> Any:
    import types

    module = types.ModuleType(__name__)
    module.own_plugin = own_plugin  # type: ignore[attr-defined]
    return module


def test_the_package_brings_five_protocols() -> None:
    assert {"modbus", "scpi", "canopen", "nidaqmx", "opendaq"} <= set(protocols())


@pytest.mark.usefixtures("installed")
def test_a_protocol_of_another_package_serves_a_role() -> None:
    description = described(clamp={"protocol": "own", "colour": "red"})
    assert open_role(description, "clamp") is CLAMP


@pytest.mark.usefixtures("installed")
def test_another_package_opens_a_bench_of_its_own_kind() -> None:
    description = described()
    own = description.bench.model_copy(update={"driver": "own"})
    with pytest.raises(BenchError, match="opened by a plug-in"):
        open_drivers(description.model_copy(update={"bench": own}))


def test_an_unknown_protocol_is_refused_with_those_that_there_are() -> None:
    with pytest.raises(InputError, match=r"driver\.clamp\.protocol = 'telepathy'.*modbus"):
        open_role(described(clamp={"protocol": "telepathy"}), "clamp")
    with pytest.raises(InputError, match=r"protocol is missing"):
        open_role(described(clamp={}), "clamp")


def test_a_protocol_is_refused_in_a_role_that_it_does_not_serve() -> None:
    with pytest.raises(InputError, match="serves as drive"):
        open_role(described(clamp={"protocol": "canopen"}), "clamp")


@pytest.mark.parametrize(
    ("protocol", "library", "role"),
    [
        ("canopen", "canopen", "output_drive"),
        ("modbus", "pymodbus.client", "clamp"),
        ("nidaqmx", "nidaqmx", "counter"),
        ("opendaq", "opendaq", "counter"),
    ],
)
def test_a_library_that_is_missing_is_named_with_how_to_install_it(
    protocol: str, library: str, role: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from tests.system import networked

    sections = {
        "canopen": networked.canopen(),
        "modbus": networked.modbus(),
        "nidaqmx": networked.daqmx(),
        "opendaq": {
            "protocol": "opendaq",
            "address": "daq.nd://127.0.0.1",
            "channels": {"input_torque": {"signal": "a"}, "output_torque": {"signal": "b"}},
        },
    }
    description = described(**{role: sections[protocol]})
    find_plugin(protocol, "test")
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(InputError, match=rf"pip install torquebench\[{protocol}\]"):
        open_role(description, role)


def test_angles_beside_a_counter_that_times_encoders_are_refused() -> None:
    from torquebench.bench.drivers.instruments import _check_needs_angles

    class Counter:
        times_encoders = True

    with pytest.raises(InputError, match=r"\[driver\.angles\]"):
        _check_needs_angles(Counter())


# -- links and numbers ------------------------------------------------------------------------


class FlakyLink(Link[int]):
    """A connection that fails as often as it is told to."""

    def __init__(self, failures: int) -> None:
        super().__init__("thing", "here", 0.1)
        self.failures = failures
        self.closed: list[int] = []

    def _open(self) -> int:
        return self.reconnects

    def _close(self, connection: int) -> None:
        self.closed.append(connection)
        raise OSError("gone already")

    def ask(self) -> int:
        def question(connection: int) -> int:
            if self.failures > 0:
                self.failures -= 1
                raise WireError("noise")
            return connection

        return self.call(question)


def test_a_link_asks_once_more_over_a_new_connection() -> None:
    link = FlakyLink(failures=1)
    assert link.ask() == 1
    assert link.closed == [0]
    assert link.ask() == 1


def test_a_link_gives_up_with_what_failed() -> None:
    link = FlakyLink(failures=5)
    with pytest.raises(BenchError, match="thing at here: noise"):
        link.ask()
    assert link.failures == 3


def test_a_link_is_closed_for_good() -> None:
    link = FlakyLink(failures=0)
    link.ask()
    link.close()
    link.close()
    with pytest.raises(BenchError, match="closed"):
        link.ask()


@pytest.mark.parametrize("address", ["", "host", "host:", ":1", "host:0", "host:70000", "h:x"])
def test_addresses_that_are_none_are_refused(address: str) -> None:
    with pytest.raises(InputError):
        split_address(address)


@given(st.floats(width=32, allow_nan=False))
def test_floats_pass_through_registers(value: float) -> None:
    words = register_map.from_float(value)
    assert all(0 <= word < 65536 for word in words)
    assert register_map.float_of(words) == value


@given(st.integers(-(2**31), 2**31 - 1))
def test_integers_pass_through_registers(value: int) -> None:
    assert register_map.integer_of(register_map.from_integer(value)) == value


@given(st.text(alphabet=st.characters(min_codepoint=32, max_codepoint=126), max_size=16))
def test_texts_pass_through_registers(text: str) -> None:
    assert register_map.text_of(register_map.from_text(text)) == text


@given(st.text(max_size=30))
def test_an_answer_is_numbers_or_an_error(answer: str) -> None:
    try:
        values = numbers(answer, "counter")
    except BenchError:
        return
    assert all(isinstance(value, float) for value in values)
