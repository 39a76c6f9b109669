"""Each driver of this project keeps the contract; and what drives, modes and counters do."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from tests.peers.displays import DisplayPeer
from tests.peers.hbm_amplifiers import HbmPeer
from tests.peers.moteus_controller import MoteusPeer
from tests.peers.odrive_node import OdrivePeer
from tests.peers.opcua_plc import PlcPeer
from tests.peers.plc import AdsPlc, S7Plc
from tests.support.draws import nightly
from tests.system.networked import CAN_BUS, daqmx, described, hasty, modbus

from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.base import CounterCard, Drive
from torquebench.bench.drivers.instruments import open_role
from torquebench.errors import BenchError
from torquebench.simulators import Simulators
from torquebench.testing.cable import Cable
from torquebench.testing.drivers import DriverCase, DriverContract, Peer

AMPLIFIER_WINDOW_S = 0.05  # peers answer by Python, on a computer that is busy with other tests


@dataclass(frozen=True)
class Case(DriverCase):
    """A driver of this project, with the peer that it talks to."""

    variant: str = ""
    visa: bool = False  # reached by a VISA resource instead of a plain socket

    def description(self, described: BenchDescription) -> BenchDescription:
        if not self.visa:
            return described
        host, _, port = described.driver[self.key]["address"].partition(":")
        section = described.driver[self.key] | {"address": f"TCPIP::{host}::{port}::SOCKET"}
        driver = dict(described.driver) | {self.key: section}
        return described.model_copy(update={"driver": driver})


def _read_block(counter: CounterCard) -> Any:
    counter.select(frozenset({"input_torque", "output_torque"}))
    return counter.read_block(0.05)


def _read_windows(counter: CounterCard) -> Any:
    counter.select(frozenset({"input_torque", "output_torque"}))
    return counter.read_block(5 * AMPLIFIER_WINDOW_S)


def _has_pulses(block: Any) -> bool:
    found = block.records["input_torque"]
    return bool(np.all(np.abs(found["frequency_hz"] - 60e3) < 600.0)) and len(found) == 5


def _has_edges(block: Any) -> bool:
    edges = block.edges["input_torque"]
    angle = block.records["output_angle"]
    return abs(len(edges) - 3000) < 40 and len(angle) == 50


def _has_values(block: Any) -> bool:
    """Whether every window is there, asked for in time or lost on a busy computer."""
    values = block.records["input_torque"]["signal"]
    return values.size == 5 and set(values[~np.isnan(values)]) <= {10.0}


def _read_now(readout: Any) -> Any:
    """Read at the present time, which goes on between the calls."""
    now_s = time.monotonic()
    return readout.read("input", now_s, now_s)


def _read_amplifier(readout: Any) -> Any:
    """Read as often as its own thread needs to find out that nothing answers."""
    for _ in range(25):
        record = _read_now(readout)
        time.sleep(0.05)
    return record


@dataclass(frozen=True)
class PeerSide:
    """A peer in the place of the simulators."""

    description: BenchDescription
    misbehaviour: Any


@contextmanager
def _peers() -> Iterator[dict[str, PeerSide]]:
    """Start an amplifier and a display; both serve all channels."""
    values = {channel: (lambda: (10.0, 0)) for channel in (1, 2, 3, 4)}
    with (
        HbmPeer("PMX", values, False) as pmx,
        DisplayPeer(lambda: 10.0, serial=False) as display,
        PlcPeer({"A": lambda: 10.0}) as plc,
        Cable(plc.port) as cable,
    ):
        keys = {"protocol": "hbm", "family": "PMX", "address": pmx.address}
        hbm = described(
            counter=keys | {"channels": {"input_torque": 1, "output_torque": 2}},
            reference=keys | {"channels": {"input_reference": 3, "output_reference": 4}},
        )
        windows = {"window_s": AMPLIFIER_WINDOW_S, "block_s": 5 * AMPLIFIER_WINDOW_S}
        plate = hbm.counter.model_copy(update=windows | {"serial": "0009E5004711"})
        hbm = hbm.model_copy(
            update={
                "counter": plate,
                "calibrator": hbm.calibrator.model_copy(update={"serial": plate.serial}),
            }
        )
        channels = dict.fromkeys(("input_torque", "output_torque"), display.address)
        shown = described(
            counter={
                "protocol": "serial",
                "channels": channels,
                "request": "P",
                "terminator": "\r",
                "serial": hbm.serials["input.encoder"],
            }
        )
        shown = shown.model_copy(
            update={
                "counter": shown.counter.model_copy(
                    update=windows | {"serial": hbm.serials["input.encoder"]}
                )
            }
        )
        keys = {"protocol": "opcua", "address": f"opc.tcp://127.0.0.1:{cable.port}"}
        channels = dict.fromkeys(("input_torque", "output_torque"), "ns=2;s=A")
        named = shown.counter.serial
        by_plc = described(
            counter=keys | {"channels": channels, "serial": named},
            temperature=keys | {"probes": dict.fromkeys(shown.temperatures, "ns=2;s=A")},
        ).model_copy(update={"counter": shown.counter})
        benches = {
            "hbm": PeerSide(hbm, pmx),
            "display": PeerSide(shown, display),
            "opcua": PeerSide(by_plc, cable),
        }
        with (
            AdsPlc({"fA": lambda: 10.0}) as ads,
            S7Plc({"fA": lambda: 10.0}) as s7,
            MoteusPeer(3) as controller,
            OdrivePeer(3) as odrive,
            Cable(odrive.port) as bus,
        ):
            keys = {"maximum_torque_nm": 20.0, "maximum_speed_rpm": 600.0, "node": 3}
            moteus = described(
                input_drive={"protocol": "moteus", "address": controller.address} | keys
            )
            drive = moteus.input.drive.model_copy(update={"serial": "11223344556677880A0B0C0D"})
            module = moteus.input.model_copy(update={"drive": drive})
            benches["moteus"] = PeerSide(moteus.model_copy(update={"input": module}), controller)
            on_bus = described(
                input_drive={"protocol": "odrive", "bus": CAN_BUS | {"port": bus.port}} | keys
            )
            drive = drive.model_copy(update={"serial": f"{odrive.serial:012X}"})
            module = on_bus.input.model_copy(update={"drive": drive})
            benches["odrive"] = PeerSide(on_bus.model_copy(update={"input": module}), bus)
            yield benches | {"ads": _plc(ads, shown), "s7": _plc(s7, shown)}


def _plc(plc: AdsPlc | S7Plc, like: BenchDescription) -> PeerSide:
    """Describe a bench whose PLC is every instrument."""
    life = {} if isinstance(plc, AdsPlc) else {"life": plc.variable("Cycles")}
    channels = dict.fromkeys(("input_torque", "output_torque"), plc.variable("fA"))
    probes = dict.fromkeys(like.temperatures, plc.variable("fA"))
    named = {"serial": like.serials["output.drive"], "structure": plc.structure("Output")}
    bench = described(
        counter=plc.section(channels=channels, serial=like.counter.serial, **life),
        temperature=plc.section(probes=probes, **life),
        output_drive=plc.section(**named),
        modes=plc.section(structure=plc.structure("Fixture")),
    )
    return PeerSide(bench.model_copy(update={"counter": like.counter}), plc)


CASES = [
    Case(
        "modbus-drive",
        "input_drive",
        variant="a",
        read=lambda i: i.state(),
        right=lambda s: not s.enabled,
    ),
    Case(
        "canopen-drive",
        "output_drive",
        variant="a",
        read=lambda i: i.state(),
        right=lambda s: not s.enabled,
    ),
    Case(
        "modbus-temperature",
        "temperature",
        variant="a",
        read=lambda i: i.temperatures(),
        right=lambda t: len(t) == 5 and all(15.0 < value < 35.0 for value in t.values()),
        quiet=True,
    ),
    Case(
        "modbus-modes",
        "modes",
        variant="a",
        read=lambda i: i.mode("input"),
        right=lambda m: m == "free",
    ),
    Case(
        "modbus-clamp", "clamp", variant="a", read=lambda i: i.clamped(), right=lambda c: c is False
    ),
    Case(
        "modbus-angles",
        "angles",
        variant="a",
        read=lambda i: i.counts(),
        right=lambda c: set(c) == {"input", "output"},
    ),
    Case(
        "scpi-readout",
        "reference",
        variant="a",
        read=_read_now,
        right=lambda s: s.time_s.shape == s["signal"].shape,
    ),
    Case(
        "visa-readout",
        "reference",
        variant="a",
        read=_read_now,
        right=lambda s: s.time_s.shape == s["signal"].shape,
        visa=True,
    ),
    Case(
        "modbus-readout",
        "reference",
        variant="b",
        read=_read_now,
        right=lambda s: s.time_s.shape == s["signal"].shape,
    ),
    Case("scpi-counter", "counter", variant="a", read=_read_block, right=_has_pulses, lossy=True),
    Case("daqmx-counter", "counter", variant="b", read=_read_block, right=_has_edges, lossy=True),
    Case(
        "hbm-counter", "counter", variant="hbm", read=_read_windows, right=_has_values, lossy=True
    ),
    Case(
        "hbm-readout",
        "reference",
        variant="hbm",
        read=_read_amplifier,
        right=lambda s: s.time_s.shape == s["signal"].shape,
    ),
    Case(
        "display-counter",
        "counter",
        variant="display",
        read=_read_windows,
        right=_has_values,
        lossy=True,
    ),
    Case(
        "opcua-counter",
        "counter",
        variant="opcua",
        read=_read_windows,
        right=_has_values,
        lossy=True,
    ),
    Case(
        "opcua-temperature",
        "temperature",
        variant="opcua",
        read=lambda i: i.temperatures(),
        right=lambda t: set(t.values()) == {10.0},
        quiet=True,
    ),
    *(
        case
        for plc in ("ads", "s7")
        for case in (
            Case(
                f"{plc}-drive",
                "output_drive",
                variant=plc,
                read=lambda i: i.state(),
                right=lambda s: not s.enabled,
            ),
            Case(
                f"{plc}-counter",
                "counter",
                variant=plc,
                read=_read_windows,
                right=_has_values,
                lossy=True,
            ),
        )
    ),
    *(
        Case(
            f"{protocol}-drive",
            "input_drive",
            variant=protocol,
            read=lambda i: i.state(),
            right=lambda s: not s.enabled,
        )
        for protocol in ("moteus", "odrive")
    ),
    Case(
        "ads-temperature",
        "temperature",
        variant="ads",
        read=lambda i: i.temperatures(),
        right=lambda t: set(t.values()) == {10.0},
        quiet=True,
    ),
    Case(
        "s7-modes",
        "modes",
        variant="s7",
        read=lambda i: i.mode("input"),
        right=lambda m: m == "free",
    ),
]


SAME_LINK = (
    *("modbus-modes", "modbus-clamp", "modbus-angles", "modbus-readout"),
    *("ads-temperature", "s7-modes"),
)
"""Cases whose connection another one has as well."""


@pytest.fixture(scope="module")
def simulated() -> Iterator[dict[str, Any]]:
    other = described(reference=modbus(), counter=daqmx())
    with Simulators(described()) as first, Simulators(other) as second, _peers() as peers:
        for each in (first, second):  # as if a counter was read: time goes on by `go_on` alone
            each.plant.reading(True)
        yield {"a": first, "b": second, **peers}


class TestDrivers(DriverContract):
    @pytest.fixture(
        params=[nightly(each) if each.name in SAME_LINK else each for each in CASES],
        ids=lambda case: case.name,
    )
    def case(self, request: pytest.FixtureRequest) -> Case:
        found: Case = request.param
        return found

    @pytest.fixture
    def peer(self, case: Case, simulated: dict[str, Any]) -> Iterator[Peer]:
        chosen = simulated[case.variant]
        yield PeerSide(case.description(chosen.description), chosen.misbehaviour)
        chosen.misbehaviour.heal()

    def hasty(self, description: BenchDescription) -> BenchDescription:
        return hasty(description)

    test_many_callers_get_their_own_answers = pytest.mark.nightly(
        DriverContract.test_many_callers_get_their_own_answers
    )


# -- drives -----------------------------------------------------------------------------------


@pytest.fixture(params=["input_drive", "output_drive"])
def drive(request: pytest.FixtureRequest, simulated: dict[str, Simulators]) -> Iterator[Drive]:
    opened: Drive = open_role(simulated["a"].description, request.param)
    yield opened
    opened.disable()
    opened.close()


@pytest.fixture
def go_on(simulated: dict[str, Simulators]) -> Callable[[float], None]:
    plant = simulated["a"].plant

    def advance(duration_s: float) -> None:
        assert plant.require(plant.now_s + duration_s, 60.0)

    return advance


def feed(drive: Drive, go_on: Callable[[float], None], duration_s: float) -> None:
    for _ in range(round(duration_s / 0.1)):
        drive.feed_watchdog()
        go_on(0.1)


def test_a_lying_drive_is_off_for_all_that_it_says(
    drive: Drive, simulated: dict[str, Simulators]
) -> None:
    drive.enable()
    orders = simulated["a"].misbehaviour
    try:
        for name in ("input_drive", "output_drive"):
            orders.start(name, "lie")
        assert not drive.state().enabled
    finally:
        orders.heal()
    assert drive.state().enabled


def test_a_frozen_drive_states_what_was(
    drive: Drive, simulated: dict[str, Simulators], go_on: Callable[[float], None]
) -> None:
    drive.enable()
    orders = simulated["a"].misbehaviour
    try:
        for name in ("input_drive", "output_drive"):
            orders.start(name, "freeze")
        before = drive.state()
        drive.command_torque(10.0, 1000.0)
        feed(drive, go_on, 0.2)
        assert drive.state() == before
    finally:
        orders.heal()
    assert drive.state().torque_nm == pytest.approx(10.0, abs=0.5)


def test_a_canopen_drive_stops_quickly_and_can_be_enabled_again(
    simulated: dict[str, Simulators], go_on: Callable[[float], None]
) -> None:
    drive = open_role(simulated["a"].description, "output_drive")
    try:
        drive.enable()
        drive.command_torque(100.0, 1e4)
        feed(drive, go_on, 0.1)
        drive.quick_stop()
        assert not drive.state().enabled
        feed(drive, go_on, 0.2)
        assert simulated["a"].plant.bench.drives["output"].state().torque_nm == 0.0
        drive.enable()
        assert drive.state().enabled
        drive.disable()
    finally:
        drive.close()


# -- what is set ------------------------------------------------------------------------------


def test_modes_and_clamp_go_where_they_are_sent_and_say_so(
    simulated: dict[str, Simulators],
) -> None:
    description = simulated["a"].description
    modes, clamp = open_role(description, "modes"), open_role(description, "clamp")
    try:
        for side in ("input", "output"):
            modes.set_mode(side, "locked")
            assert modes.mode(side) == "locked"
            modes.set_mode(side, "free")
        simulated["a"].plant.bench.mount("calibrator")
        clamp.set_clamped(True)
        assert clamp.clamped()
        clamp.set_clamped(False)
        assert not clamp.clamped()
    finally:
        modes.close()
        clamp.close()


def test_a_travel_that_does_not_end_is_an_error(simulated: dict[str, Simulators]) -> None:
    modes = open_role(hasty(simulated["a"].description), "modes")
    try:
        simulated["a"].misbehaviour.start("modes", "freeze")
        assert modes.mode("input") == "free"  # what it states from now on
        with pytest.raises(BenchError, match="hasn't reached mode 'driven'"):
            modes.set_mode("input", "driven")
    finally:
        simulated["a"].misbehaviour.heal()
        modes.set_mode("input", "free")
        modes.close()


def test_a_counter_tells_how_far_the_computer_is_behind(simulated: dict[str, Simulators]) -> None:
    simulators = simulated["b"]
    counter = open_role(simulators.description, "counter")
    try:
        assert _read_block(counter).waiting_s == pytest.approx(0.002, abs=0.002)
        simulators.plant.require(simulators.plant.now_s + 0.3, 60.0)
        late = _read_block(counter)
        assert late.timed_s == pytest.approx(late.stop_s + 0.25, abs=0.01)
    finally:
        counter.close()
