"""A whole bench of independent peers in real time: drives, contacts, probes and amplifiers."""

import contextlib
import math
import random
import struct
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from tests.peers.cia402_node import Cia402Peer
from tests.peers.modbus_device import READ_COILS, READ_DISCRETE, READ_INPUT, ModbusDevicePeer
from tests.peers.modbus_drive import ModbusDrivePeer
from tests.peers.motor import Motor
from tests.system.networked import PATIENT_DRIVE_S, WATCHDOG_S

from torquebench.bench.description import DEFAULT_BENCH

GAIN, ZERO_SHARE, NOISE_SHARE = 1.003, 2e-3, 2e-5
"""Of a module against its standard; shares of the range."""
GEAR = {"input": -2.0, "output": 1.0}
"""Turns of the motor per turn of the shaft: the input module's gear reverses."""
RANGE_NM = {"input": 50.0, "output": 2000.0}


@dataclass
class PeerBench:
    """What the peers of a bench do; `torque_nm` is that which acts between the flanges."""

    motors: dict[str, Motor]
    contacts: ModbusDevicePeer
    random: random.Random

    def torque_nm(self, side: str) -> float:
        motor = self.motors[side]
        with motor.lock:
            motor.look()
            clamped = self.contacts.bits[READ_COILS][4]
            return GEAR[side] * motor.torque.present if motor.on and clamped else 0.0

    def module_nm(self, side: str) -> float:
        """Reading of a module's own transducer."""
        noise = self.random.gauss(ZERO_SHARE, NOISE_SHARE) * RANGE_NM[side]
        return GAIN * self.torque_nm(side) + noise

    def standard_nm(self, side: str) -> float:
        """Reading of the standard."""
        return self.torque_nm(side) + self.random.gauss(0.0, NOISE_SHARE) * RANGE_NM[side]


def _contacts() -> ModbusDevicePeer:
    """Mode conversion and clamp, whose contacts follow the coils at once."""
    peer = ModbusDevicePeer()
    plate = b"".join(text.ljust(16, b"\0") for text in (b"peer works", b"I/O", b"IO-1", b"1"))
    words = struct.unpack(">32H", plate)
    peer.registers[READ_INPUT] = dict(zip(range(900, 932), words, strict=True))
    peer.bits[READ_COILS] = dict.fromkeys(range(6), False)

    def follow() -> None:
        coils = peer.bits[READ_COILS]
        bits = []
        for driven, locked in ((coils[0], coils[1]), (coils[2], coils[3])):
            bits += [not driven and not locked, driven, locked]
        bits += [coils[4], coils[4], not coils[4]]
        peer.bits[READ_DISCRETE] = dict(enumerate(bits))

    follow()
    peer.written = follow
    return peer


def _probes() -> ModbusDevicePeer:
    peer = ModbusDevicePeer()
    peer.registers[READ_INPUT] = dict.fromkeys(range(1536, 1542), 232)
    return peer


@contextlib.contextmanager
def peer_bench() -> Iterator[tuple[PeerBench, dict[str, Any]]]:
    """Start the peers; yield them and a description without counter and reference."""
    with contextlib.ExitStack() as peers:
        drive = peers.enter_context(ModbusDrivePeer("OWN-1"))
        node = peers.enter_context(Cia402Peer(9, 1234567, 0.0))
        contacts = peers.enter_context(_contacts())
        probes = peers.enter_context(_probes())
        bench = PeerBench(
            {"input": drive.motor, "output": node.motor}, contacts, random.Random(20261127)
        )
        text = (resources.files("torquebench.bench") / DEFAULT_BENCH).read_text(encoding="utf-8")
        values = tomllib.loads(text)
        values["bench"] |= {"driver": "instruments", "name": "Bench of peers"}
        values["input"]["drive"]["serial"] = "OWN-1"
        values["output"]["drive"]["serial"] = "1234567"
        for side in ("input", "output"):  # time for a busy computer
            values[side]["drive"] |= {"watchdog_s": WATCHDOG_S, "gear_ratio": GEAR[side]}
        values["safety"] = {"signal_loss_s": 2.0, "stall_s": 10.0}
        values["counter"] |= {"window_s": 0.05, "block_s": 0.2}
        modbus, patient = {"protocol": "modbus"}, {"timeout_s": PATIENT_DRIVE_S}
        bus = {"interface": "socketcand", "host": "127.0.0.1", "port": node.port, "channel": "can0"}
        values["driver"] = {
            "input_drive": modbus | {"address": drive.address} | patient,
            "output_drive": {"protocol": "canopen", "bus": bus, "node": 9} | patient,
            "modes": modbus | {"address": contacts.address},
            "clamp": modbus | {"address": contacts.address},
            "temperature": modbus
            | {
                "address": probes.address,
                "map": "moxa-e1260",
                "probes": {name: k for k, name in enumerate(values["temperatures"])},
            },
            "angles": {"protocol": "drives"},
        }
        yield bench, values


def amplified(values: dict[str, Any], signal: str, full: dict[str, float] | None = None) -> None:
    """Describe the modules' transducers with a signal that an amplifier states."""
    for side, nominal_nm in RANGE_NM.items():
        described = values[side]["transducer"]
        for key in ("option_khz", "sensitivity_cw_hz_per_nm", "sensitivity_ccw_hz_per_nm"):
            described.pop(key, None)
        described |= {
            "nominal_torque_nm": nominal_nm,
            "signal": signal,
            "filter_delay_s": 0.004,
            "signal_uncertainty_percent": 0.002,
        }
        if full is not None:
            described["signal_at_nominal"] = full[side]


def toml(values: dict[str, Any], path: Path) -> Path:
    """Write a description."""
    lines: list[str] = []

    def write(table: dict[str, Any], name: str) -> None:
        if name:
            lines.append(f"[{name}]")
        lines.extend(f"{key} = {_text(value)}" for key, value in table.items() if not _table(value))
        for key, value in table.items():
            if _table(value):
                write(value, f"{name}.{key}" if name else key)

    write(values, "")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _table(value: Any) -> bool:
    return isinstance(value, dict)


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"').replace("\r", "\\r") + '"'
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(value)
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_text, value)) + "]"
    return str(value)


Stated = Callable[[], tuple[float, int]]


def stated(value: Callable[[], float]) -> Stated:
    """Return a channel of an amplifier without a fault."""
    return lambda: (value(), 0)
