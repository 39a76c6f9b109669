"""A new bench description by its instruments, and the scan that searches for them."""

import contextlib
import socket
import sys
import threading
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import canopen
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.peers.ethercat_device import LIBRARY, EthercatNetwork, EthercatPeer
from tests.system.command_line import at_terminal, run

from torquebench.bench import scanning
from torquebench.bench.description import load_bench, parse_bench
from torquebench.bench.drivers.instruments import open_role
from torquebench.bench.drivers.plugins import find_plugin, protocols
from torquebench.bench.new_description import (
    COUNTERS,
    FoundInstrument,
    NewBench,
    SideValues,
    description_text,
    protocols_of,
)
from torquebench.bench.roles import Signal
from torquebench.bench.scanning import addresses_of, scan
from torquebench.errors import BenchError, InputError

PROJECT = Path(__file__).resolve().parents[3]
SIDES = {
    "input": SideValues(50.0, 1300.0, 360000),
    "output": SideValues(2000.0, 20.0, 3600000, 5.0),
}
KEYS = {"drive": ("input_drive", "output_drive"), "modes": ("modes", "clamp")}


BENCH = NewBench(
    name='Bench "7"',
    counter="hbm",
    drives="canopen",
    reference="counter",
    angles="drives",
    fixture="modbus",
    temperature="modbus",
    signal="Nm",
    sides=SIDES,
    ratio=80.0,
)


def new_bench(**changed: Any) -> NewBench:
    return replace(BENCH, **changed)


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_every_choice_is_a_description_or_is_refused_with_what_serves(data: st.DataObject) -> None:
    chosen = {
        key: data.draw(st.sampled_from((*more, *protocols_of(role))))
        for key, role, more in (
            ("counter", "counter", ()),
            ("drives", "drive", ()),
            ("reference", "reference", ("counter",)),
            ("angles", "angles", ("counter",)),
            ("fixture", "modes", ()),
            ("temperature", "temperature", ()),
        )
    }
    bench = new_bench(**chosen, signal=data.draw(st.sampled_from(get_args(Signal))))
    counter = bench.counter in COUNTERS
    refused = bench.angles == "counter" and bench.counter != "nidaqmx"
    refused |= bench.counter != "nidaqmx" and (bench.signal == "frequency") != counter
    if refused:
        with pytest.raises(InputError, match="allowed: "):
            description_text(bench)
        return
    described = parse_bench(description_text(bench))
    assert described.name == bench.name
    assert ("reference" in described.driver) == (bench.reference != "counter")


@pytest.mark.parametrize(
    ("protocol", "role"),
    [
        (protocol, role)
        for role in ("counter", "drive", "reference", "angles", "modes", "temperature")
        for protocol in protocols_of(role)
        if protocol != "drives"
    ],
)
def test_a_driver_takes_the_keys_of_its_section(protocol: str, role: str, tmp_path: Path) -> None:
    """Nothing is there to answer: a wrong key would be refused before that is noticed."""
    chosen: dict[str, object] = {{"drive": "drives", "modes": "fixture"}.get(role, role): protocol}
    if role == "counter" and protocol in ("nidaqmx", "scpi", "opendaq"):
        chosen |= {
            "signal": "frequency",
            "angles": "counter" if protocol == "nidaqmx" else "drives",
        }
    path = tmp_path / "bench.toml"
    path.write_text(
        description_text(new_bench(**chosen)).replace("192.168.0.", "127.0.0."), encoding="utf-8"
    )
    for key in KEYS.get(role, (role,)):
        with contextlib.suppress(BenchError):
            instrument = open_role(load_bench(path), key)
            getattr(instrument, "close", bool)()


def test_every_driver_has_a_section_for_each_of_its_roles() -> None:
    own = {"rail", "supply", "clamp"}  # like those of the modes, or left out
    for name in protocols():
        if name in ("simulated",):
            continue
        for role in {*find_plugin(name, "protocol").openers} - own:
            assert name in protocols_of(role), (name, role)


EXAMPLES = {
    "papers": (
        "--name=Bench of the papers",
        "--reference=hbm",
        "--angles=counter",
    ),
    "beckhoff": (
        "--name=Beckhoff bench",
        "--counter=ads",
        "--signal=V",
        "--drives=ads",
        "--reference=ads",
        "--fixture=ads",
        "--temperature=ads",
        "--input-encoder=1048576",
        "--output-encoder=8388608",
    ),
    "siemens": (
        "--name=Siemens and PMX bench",
        "--counter=hbm",
        "--signal=mV/V",
        "--drives=s7",
        "--fixture=s7",
        "--temperature=s7",
        "--input-encoder=1048576",
        "--output-encoder=8388608",
    ),
    "open": (
        "--name=Open bench",
        "--counter=serial",
        "--signal=Nm",
        "--drives=moteus",
        "--reference=serial",
        "--ratio=10",
        "--input-range=10",
        "--output-range=100",
        "--input-speed=500",
        "--output-speed=60",
        "--output-gear-ratio=5",
        "--input-encoder=100000",
        "--output-encoder=500000",
    ),
}
"""Options of `bench new` that write the benches of examples/benches."""


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_example_benches_are_what_the_command_writes(name: str, tmp_path: Path) -> None:
    path = tmp_path / f"{name}.toml"
    run("bench", "new", path.name, *EXAMPLES[name], cwd=tmp_path)
    example = PROJECT / "examples" / "benches" / path.name
    assert path.read_text(encoding="utf-8") == example.read_text(encoding="utf-8")


def test_the_command_asks_a_person_for_what_is_not_given(tmp_path: Path) -> None:
    code, shown = at_terminal(
        *("bench", "new", "bench.toml", "--drives", "moteus"),
        cwd=tmp_path,
        dialogue=[
            ("Name of the bench", "Lab 3\n"),
            ("torque of both modules", "serial\n"),
            ("transducers or their amplifier", "Nm\n"),
            ("calibrator", "\n"),
            ("encoders", "\n"),
        ],
    )
    assert code == 0, shown
    values = tomllib.loads((tmp_path / "bench.toml").read_text(encoding="utf-8"))
    assert values["bench"]["name"] == "Lab 3"
    assert values["driver"]["counter"]["protocol"] == "serial"
    assert values["driver"]["input_drive"]["protocol"] == "moteus"


def test_found_instruments_take_the_place_of_the_examples() -> None:
    found = (
        FoundInstrument("canopen", "pcan:PCAN_USBBUS1", "servo", "8801", node=3),
        FoundInstrument("canopen", "pcan:PCAN_USBBUS1", "servo", "8802", node=4),
        FoundInstrument("hbm", "10.0.0.5:55000", "HBM PMX", "4711"),
        FoundInstrument("modbus", "10.0.0.6:502", "a name\nwith two lines"),
    )
    text = description_text(new_bench(found=found))
    values = tomllib.loads(text)
    driver = values["driver"]
    assert [driver[f"{side}_drive"]["node"] for side in SIDES] == [3, 4]
    assert driver["input_drive"]["bus"] == {"interface": "pcan", "channel": "PCAN_USBBUS1"}
    assert values["output"]["drive"]["serial"] == "8802"
    assert driver["counter"]["address"] == "10.0.0.5:55000"
    assert values["counter"]["serial"] == "4711"
    assert driver["clamp"]["address"] != "10.0.0.6:502"  # nobody knows what this device is
    assert "#     modbus: 10.0.0.6:502" in text


@contextlib.contextmanager
def listening(answer: bytes) -> Iterator[int]:
    """Answer one line on each connection, like an instrument."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            with contextlib.suppress(OSError):
                while True:
                    connection, _ = server.accept()
                    with connection, connection.makefile("rwb") as lines:
                        for line in lines:
                            if line.strip().endswith(b"?"):
                                lines.write(answer)
                                lines.flush()

        threading.Thread(target=serve, daemon=True).start()
        yield server.getsockname()[1]
        server.shutdown(socket.SHUT_RDWR)


def test_instruments_at_hosts_say_who_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    with listening(b"Keysight,53230A,MY500,1.0\r\n") as scpi, listening(b"HBM,PMX,4711\r\n") as hbm:
        monkeypatch.setattr(scanning, "PORTS", {scpi: "scpi", hbm: "hbm", 1: "s7"})
        found = [each for each in scan(["127.0.0.1"]) if each.address.startswith("127.")]
    assert found == [
        FoundInstrument("scpi", f"127.0.0.1:{scpi}", "Keysight 53230A", "MY500"),
        FoundInstrument("hbm", f"127.0.0.1:{hbm}", "HBM PMX", "4711"),
    ]


def test_nodes_of_a_can_bus_are_found_with_their_names(tmp_path: Path) -> None:
    dictionary = tmp_path / "node.eds"
    source = PROJECT / "src" / "torquebench" / "bench" / "drivers" / "cia402.eds"
    dictionary.write_text(source.read_text(encoding="utf-8"), encoding="utf-8")
    bus = canopen.Network()
    bus.connect(interface="virtual", channel="scan")
    try:
        node = bus.create_node(8, str(dictionary))
        node.sdo[0x1018][4].raw = 8800
        found = scan(buses=["virtual:scan"])
    finally:
        bus.disconnect()
    nodes = [each for each in found if each.protocol == "canopen"]
    assert [(each.node, each.address, each.serial) for each in nodes] == [
        (8, "virtual:scan", "8800")
    ]


@pytest.mark.parametrize(
    ("hosts", "buses"), [(["10.0.0.0/8"], []), (["10.0.0.0/x"], []), ([], ["can0"])]
)
def test_a_wrong_place_to_search_is_refused(hosts: list[str], buses: list[str]) -> None:
    with pytest.raises(InputError):
        scan(hosts, buses)


def test_a_network_is_its_hosts() -> None:
    assert addresses_of(["10.0.0.0/30"]) == ["10.0.0.1", "10.0.0.2"]


def test_ethercat_drives_are_found_behind_a_stated_adapter(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.syspath_prepend(LIBRARY)
    for name in [name for name in sys.modules if name.partition(".")[0] == "pysoem"]:
        monkeypatch.delitem(sys.modules, name)
    with EthercatNetwork(EthercatPeer(11), EthercatPeer(12)) as network:
        found = [each for each in scan(adapters=[network.address]) if each.protocol == "ethercat"]
        address = network.address
    sys.modules.pop("pysoem")
    assert [(each.serial, each.node) for each in found] == [("11", 0), ("12", 1)]
    text = description_text(new_bench(drives="ethercat", found=tuple(found)))
    drives = tomllib.loads(text)["driver"]
    assert [drives[f"{side}_drive"]["position"] for side in ("input", "output")] == [0, 1]
    assert drives["output_drive"]["adapter"] == address
