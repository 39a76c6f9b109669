"""The benches of examples/benches against peers: doctor, whole calibrations, cable and process."""

import json
import math
import os
import random
import re
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Literal

import pytest
from tests.peers.cia402_node import Cia402Peer
from tests.peers.daqmx_server import CounterCardPeer
from tests.peers.displays import ScalePeer
from tests.peers.ethercat_device import LIBRARY, EthercatNetwork, EthercatPeer
from tests.peers.hbm_amplifiers import HbmPeer
from tests.peers.modbus_device import READ_COILS, READ_INPUT, ModbusDevicePeer
from tests.peers.moteus_controller import MoteusPeer
from tests.peers.odrive_node import OdrivePeer
from tests.peers.plc import AdsPlc, Reducer, S7Plc
from tests.support.draws import nightly
from tests.system.command_line import environment, wait_until
from tests.system.networked import CAN_BUS, WATCHDOG_S, waiting
from tests.system.panel_api import SLOW
from tests.system.peer_bench import GAIN, NOISE_SHARE, RANGE_NM, ZERO_SHARE, stated, toml

pytestmark = SLOW
EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "benches"
Example = Literal["beckhoff", "siemens", "open", "odrive", "ethercat", "papers"]
OPEN = ("open", "odrive", "ethercat")
"""The open bench with its own drives, and with others in their place."""
BENCHES = ("beckhoff", "siemens", *OPEN, "papers")
LOADS_NM = {"beckhoff": 50.0, "siemens": 50.0, "papers": 2000.0} | dict.fromkeys(OPEN, 10.0)
"""Range of the module that is calibrated."""
DRIVE_S, ANSWER_S = (
    4.9,
    {"ads": 2.0, "s7": 2.0, "hbm": 1.0, "serial": 1.0, "modbus": 2.0, "nidaqmx": 20.0},
)


class ModbusFixture(ExitStack):
    """Contacts and probes on Modbus modules, in the place of a PLC."""

    reducer: Reducer | None = None

    def __init__(self, driver: dict[str, Any]) -> None:
        super().__init__()
        self._contacts, probes = ModbusDevicePeer(), ModbusDevicePeer()
        self._contacts.bits[READ_COILS] = dict.fromkeys(range(22), False)
        self._contacts.written = self._follow
        self._follow()
        probes.registers[READ_INPUT] = dict.fromkeys(range(1536, 1542), 230)
        for key, peer in (
            ("modes", self._contacts),
            ("clamp", self._contacts),
            ("temperature", probes),
        ):
            driver[key]["address"] = peer.address
        for each in (self._contacts, probes):
            self.enter_context(each)

    @property
    def clamped(self) -> bool:
        return self._contacts.bits[READ_COILS][20]

    def _follow(self) -> None:
        bits = self._contacts.bits[READ_COILS]
        coils = [bits[16 + k] for k in range(6)]
        made: list[bool] = []
        for driven, locked in ((coils[0], coils[1]), (coils[2], coils[3])):
            made += [not driven and not locked, driven, locked]
        made += [coils[4], coils[4], not coils[4]]
        bits |= dict(enumerate(made))


class OpenPlant(ModbusFixture):
    """Two motors with controllers of one kind, and four load cells."""

    def __init__(
        self, values: dict[str, Any], module_nm: Any, standard_nm: Any, kind: Example
    ) -> None:
        driver = values["driver"]
        super().__init__(driver)
        self._gear = {side: values[side]["drive"].get("gear_ratio", 1.0) for side in RANGE_NM}
        self.motors: dict[str, Any] = {}
        for number, side in enumerate(RANGE_NM):
            place, limits = number + 1, ("maximum_torque_nm", "maximum_speed_rpm")
            kept = {key: driver[f"{side}_drive"][key] for key in limits}
            if kind == "odrive":
                node = self.motors[side] = OdrivePeer(place, 0.5 * WATCHDOG_S)
                node.serial += number
                bus = CAN_BUS | {"port": node.port}
                driver[f"{side}_drive"] = kept | {"protocol": kind, "bus": bus, "node": place}
                values[side]["drive"]["serial"] = f"{node.serial:012X}"
            elif kind == "ethercat":
                self.motors[side] = EthercatPeer(place)
                values[side]["drive"]["serial"] = str(place)
            else:
                motor = self.motors[side] = MoteusPeer(place, True, place)
                driver[f"{side}_drive"]["address"] = motor.address
                values[side]["drive"]["serial"] = f"1122334455667788{place:08X}"
            for role, channel, torque in (
                ("counter", "torque", module_nm),
                ("reference", "reference", standard_nm),
            ):
                cell = self.enter_context(
                    ScalePeer(lambda side=side, torque=torque: round(torque(side), 5))
                )
                driver[role]["channels"][f"{side}_{channel}"] = cell.address
        if kind == "ethercat":
            self.network = self.enter_context(EthercatNetwork(*self.motors.values()))
            for number, side in enumerate(RANGE_NM):
                section = {"adapter": self.network.address, "position": number, "cycle_s": 0.01}
                driver[f"{side}_drive"] = section | {"protocol": kind}
        else:
            for controller in self.motors.values():
                self.enter_context(controller)

    def mount(self, reducer: Reducer) -> None:
        """Put a reducer between the flanges."""
        self.reducer = reducer
        driving, driven = self.motors["input"], self.motors["output"]
        driving.turns = True
        ratio = self._gear["output"] / (self._gear["input"] * reducer.ratio)

        def turned() -> float:
            driving.look()
            return float(driving.position * ratio)

        driven.follows = turned

    def cut(self, side: str) -> None:
        """Pull the cable of a controller."""
        controller = self.motors[side]
        if isinstance(controller, EthercatPeer):
            self.network.start("", "disconnect", duration_s=600.0)
        elif isinstance(controller, OdrivePeer):
            controller.cut = True
        else:
            controller.start("", "drop")

    def torque_nm(self, side: str) -> float:
        """Return the torque of a side's motor against what is clamped or mounted."""
        controller = self.motors[side]
        controller.look()
        if self.reducer is not None:
            speed_rad_s = controller.velocity * math.tau / self._gear[side]
            return self.reducer.friction_nm(speed_rad_s) if side == "input" else 0.0
        if isinstance(controller, EthercatPeer):
            motor_nm = controller.motor.torque.present
        else:
            motor_nm = controller.torque_nm if controller.powered else 0.0
        return float(self._gear[side] * motor_nm) if self.clamped else 0.0


class PapersPlant(ModbusFixture):
    """Transducers of 60 kHz at an NI card, a DMP41 for the calibrator, two CANopen drives."""

    def __init__(self, values: dict[str, Any], module_nm: Any, standard_nm: Any) -> None:
        driver = values["driver"]
        super().__init__(driver)
        self.nodes = {side: Cia402Peer(8 + k, 8800 + k) for k, side in enumerate(RANGE_NM)}
        for side, node in self.nodes.items():
            self.enter_context(node)
            driver[f"{side}_drive"]["bus"] = CAN_BUS | {"port": node.port}
            values[side]["drive"]["serial"] = str(8800 + list(RANGE_NM).index(side))
        by_counter = {"PXI1Slot2/ctr0": "input", "PXI1Slot2/ctr1": "output"}

        def frequency_hz(counter: str) -> float:
            side = by_counter[counter]
            return 60e3 + 30e3 * float(module_nm(side)) / RANGE_NM[side]

        self.nodes["input"].largest_rpm = 1500
        self.card = self.enter_context(CounterCardPeer(0x0A1B2C3D, frequency_hz, 0.0))
        driver["counter"]["address"] = self.card.address
        standards = {
            k + 1: stated(lambda side=side: standard_nm(side))  # type: ignore[misc]
            for k, side in enumerate(RANGE_NM)
        }
        amplifier = self.enter_context(HbmPeer("DMP41", standards, False))
        driver["reference"]["address"] = amplifier.address

    def mount(self, reducer: Reducer) -> None:
        """Put a reducer between the flanges."""
        self.reducer = reducer
        motor = self.nodes["input"].motor
        counts = {"PXI1Slot2/ctr2": 360000.0, "PXI1Slot2/ctr3": 3600000.0 / reducer.ratio}

        def turned(counter: str) -> float:
            with motor.lock:
                return counts[counter] * motor.angle_rad / math.tau

        self.card.counts = turned

    def cut(self, side: str) -> None:
        """Pull the cable of a drive."""
        self.nodes[side].cut = True

    def torque_nm(self, side: str) -> float:
        """Return the torque of a side's drive against what is clamped or mounted."""
        motor = self.nodes[side].motor
        with motor.lock:
            motor.look()
            if self.reducer is not None:
                speed_rad_s = motor.speed.present if motor.on else 0.0
                return self.reducer.friction_nm(speed_rad_s) if side == "input" else 0.0
            return motor.torque.present if motor.on and self.clamped else 0.0


@contextmanager
def example(kind: Example, folder: Path) -> Iterator[tuple[Any, Path]]:
    """Start the peers of an example; yield its PLC and the example with the peers' addresses."""
    file = EXAMPLES / f"{'open' if kind in OPEN else kind}.toml"
    values = tomllib.loads(file.read_text(encoding="utf-8"))
    noise = random.Random(20261128)
    plc: Any = None

    ranges = {side: values[side]["range_nm"] for side in RANGE_NM}

    def standard_nm(side: str) -> float:
        acting = 0.0 if plc is None else float(plc.torque_nm(side))
        return acting + noise.gauss(0.0, NOISE_SHARE) * ranges[side]

    def module_nm(side: str) -> float:
        return GAIN * standard_nm(side) + ZERO_SHARE * ranges[side]

    def temperature_c() -> float:
        return 23.0

    probes = {
        "fAmbient": temperature_c,
        "fInputProbe": temperature_c,
        "fOutputProbe": temperature_c,
    }
    with ExitStack() as peers:
        if kind == "beckhoff":
            torques = {
                **{
                    f"f{s.capitalize()}Torque": lambda s=s: 10 * module_nm(s) / RANGE_NM[s]
                    for s in RANGE_NM
                },
                **{f"f{s.capitalize()}Reference": lambda s=s: standard_nm(s) for s in RANGE_NM},
            }
            plc = AdsPlc(probes | torques)
        elif kind in OPEN:
            plc = OpenPlant(values, module_nm, standard_nm, kind)
        elif kind == "papers":
            plc = PapersPlant(values, module_nm, standard_nm)
        else:
            plc = S7Plc(probes)
            full = {s: values[s]["transducer"]["signal_at_nominal"] for s in RANGE_NM}
            channels = {
                1: stated(lambda: module_nm("input") * full["input"] / RANGE_NM["input"]),
                2: stated(lambda: module_nm("output") * full["output"] / RANGE_NM["output"]),
                3: stated(lambda: standard_nm("input")),
                4: stated(lambda: standard_nm("output")),
            }
            pmx = peers.enter_context(HbmPeer("PMX", channels, False))
        peers.enter_context(plc)
        for key, section in values["driver"].items():
            if section["protocol"] == "hbm" and kind == "siemens":
                section["address"] = pmx.address
            elif section["protocol"] in ("ads", "s7"):
                section |= {k: v for k, v in plc.section().items() if k in section}
            section |= waiting(key, section, DRIVE_S, ANSWER_S)  # time for a busy computer
        for side in RANGE_NM:
            values[side]["drive"]["watchdog_s"] = WATCHDOG_S
        values["safety"] |= {"signal_loss_s": 2.0, "stall_s": 10.0}
        if kind != "papers":
            values["counter"]["block_s"] = 0.2
        yield plc, toml(values, folder / "bench.toml")


def surroundings(kind: Example) -> dict[str, str]:
    """Return the environment of a command; EtherCAT's library is replaced by a fake."""
    found = environment()
    if kind == "ethercat":
        found["PYTHONPATH"] = os.pathsep.join(filter(None, [LIBRARY, found.get("PYTHONPATH", "")]))
    return found


def command(*words: str, bench: Path) -> list[str]:
    options = ["--bench", str(bench), "--data", str(bench.parent / "data")]
    return [sys.executable, "-m", "torquebench", *words, *options]


@contextmanager
def calibrating(kind: Example, folder: Path) -> Iterator[tuple[Any, Any]]:
    with example(kind, folder) as (plc, bench):
        side = "output" if kind == "papers" else "input"
        words = ("calibrate", side, "--yes", "--step", "25", "--repeats", "1")
        with subprocess.Popen(
            command(*words, bench=bench),
            env=surroundings(kind),
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        ) as process:
            try:
                yield plc, process
            finally:
                process.kill()


@pytest.mark.parametrize("kind", [kind if kind == "siemens" else nightly(kind) for kind in BENCHES])
def test_the_doctor_finds_the_example_ready(kind: Example, tmp_path: Path) -> None:
    with example(kind, tmp_path) as (_, bench):
        done = subprocess.run(
            command("doctor", "--record", "session.jsonl", bench=bench),
            env=surroundings(kind),
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=240.0,
        )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Ready." in done.stdout
    first, *events = map(json.loads, (tmp_path / "session.jsonl").read_text("utf-8").splitlines())
    driver = tomllib.loads(bench.read_text("utf-8"))["driver"]
    assert first["driver"].keys() == driver.keys()
    asked = {event["instrument"] for event in events}
    assert asked >= {"input drive", "output drive", "temperature"}


@pytest.mark.alone  # peers and bench run in real time
@pytest.mark.nightly
@pytest.mark.parametrize("kind", BENCHES)
def test_a_module_is_calibrated(kind: Example, tmp_path: Path) -> None:
    with calibrating(kind, tmp_path) as (_, process):
        said, _ = process.communicate(timeout=600.0)
        assert process.returncode == 0, said
    raw = float(re.findall(r"raw reading\s+[\d.]+\s+[\d.]+\s+([\d.]+)", said)[0])
    assert raw == pytest.approx(100.0 * (GAIN - 1.0), rel=0.1)  # % FS


@pytest.mark.alone  # peers and bench run in real time
@pytest.mark.nightly
@pytest.mark.parametrize("kind", ["beckhoff", "siemens", "open", "papers"])
def test_a_reducer_is_tested(kind: Example, tmp_path: Path) -> None:
    with example(kind, tmp_path) as (plant, bench):
        if kind in ("beckhoff", "siemens"):
            plant.program.reducer = Reducer()
        else:
            plant.mount(Reducer())
        text = bench.read_text(encoding="utf-8")
        text = re.sub("reducer_ratio = [0-9]+", "reducer_ratio = 121", text)
        quick = text.replace("speed_rate_rpm_per_s = 1300", "speed_rate_rpm_per_s = 6000")
        if kind == "open":  # the reducer's test takes up to 1000 rpm
            quick = quick.replace("speed_rpm = 500", "speed_rpm = 1300")
            quick = quick.replace("maximum_speed_rpm = 600", "maximum_speed_rpm = 1600")
        bench.write_text(quick, encoding="utf-8")
        done = subprocess.run(
            command(
                *("test", "no-load", "--short", "--reducer", "rv-40e", "--yes", "--json"),
                bench=bench,
            ),
            env=environment(),
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=600.0,
        )
    assert done.returncode == 0, done.stderr
    found = re.findall(r'"key": "no_load_(-?\d+)_rpm".*?"value": (-?[\d.]+)', done.stdout)
    assert len(found) > 4
    for rpm, value_nm in found:
        friction_nm = GAIN * Reducer.friction_nm(int(rpm) * math.tau / 60.0)
        assert float(value_nm) == pytest.approx(friction_nm, abs=0.003)


@pytest.mark.alone  # peers and bench run in real time
@pytest.mark.nightly
@pytest.mark.parametrize("kind", BENCHES)
def test_a_drive_whose_cable_is_pulled_removes_the_load_by_its_own_watchdog(
    kind: Example, tmp_path: Path
) -> None:
    side = "output" if kind == "papers" else "input"
    with calibrating(kind, tmp_path) as (plant, process):
        wait_until(lambda: plant.torque_nm(side) > 0.2 * LOADS_NM[kind], "a load")
        if kind in ("beckhoff", "siemens"):
            plant.start("", "disconnect", duration_s=600.0)
        else:
            plant.cut(side)
        wait_until(lambda: plant.torque_nm(side) == 0.0, "the drive's watchdog")
        output, _ = process.communicate(timeout=300.0)
    assert process.returncode == 1, output


@pytest.mark.alone  # peers and bench run in real time
@pytest.mark.nightly
@pytest.mark.parametrize("kind", BENCHES)
def test_a_killed_process_leaves_the_load_to_the_drives_watchdog(
    kind: Example, tmp_path: Path
) -> None:
    side = "output" if kind == "papers" else "input"
    with calibrating(kind, tmp_path) as (plant, process):
        wait_until(lambda: plant.torque_nm(side) > 0.2 * LOADS_NM[kind], "a load")
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        began = time.monotonic()
        wait_until(lambda: plant.torque_nm(side) == 0.0, "the drive's watchdog")
        assert time.monotonic() - began < WATCHDOG_S + 5.0
