"""The drivers of examples/drivers, one for each role, keep the contract."""

import importlib.util
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.peers.lines import LinePeer
from tests.peers.motor import Motor
from tests.support.draws import nightly
from tests.system.networked import HASTY_DRIVE_S, described, motor_case

from torquebench.bench.description import (
    BenchDescription,
    GuideRailDescription,
    PowerSupplyDescription,
)
from torquebench.bench.drivers import plugins
from torquebench.testing.drivers import DriverCase, DriverContract
from torquebench.testing.drives import DriveContract, MotorCase

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "drivers" / "ascii_bench.py"


def example() -> Any:
    spec = importlib.util.spec_from_file_location("ascii_bench", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class AsciiPeer(LinePeer):
    """A drive, amplifiers, probes, encoders and a fixture behind one port."""

    def __init__(self) -> None:
        super().__init__()
        self.motor = Motor()
        self.coils = [0] * 6
        self._asked_s = {"1": time.monotonic(), "2": time.monotonic()}

    def answer(self, line: str) -> str:
        word, *rest = line.split()
        motor = self.motor
        with motor.lock:
            motor.look()
            if word == "ID?":
                return "peers ascii A-1"
            fixed = {"T?": "12.5 12.5", "A?": "-7 2500", "P?": "23 23 23 23 23"}
            if word in fixed:
                return fixed[word]
            if word == "C?":
                return " ".join(str(int(bit)) for bit in self._contacts())
            if word == "SET":
                self.coils[int(rest[0])] = int(rest[1])
                return "OK"
            if word == "LIM?":
                return "60 150"
            if word == "ST?":
                fault = 1 if motor.tripped else 0
                return f"{int(motor.on)} {fault} {motor.torque.present} {motor.speed.present}"
            if word == "V?" and rest[0] in self._asked_s:
                count = int((time.monotonic() - self._asked_s[rest[0]]) / 0.01)
                self._asked_s[rest[0]] += 0.01 * count
                return " ".join(["12.5"] * min(count, 1000)) or " "
            return self._obey(word, [float(text) for text in rest])

    def _contacts(self) -> list[int]:
        made: list[int] = []
        for driven, locked in (self.coils[0:2], self.coils[2:4]):
            made += [int(not driven and not locked), driven, locked]
        clamp, rail = self.coils[4:6]
        return [*made, clamp, clamp, 1 - clamp, rail, 1 - rail, 1]

    def _obey(self, word: str, numbers: list[float]) -> str:
        motor = self.motor
        if word == "WD":
            motor.watchdog_s = numbers[0]
            motor.feed()
        elif word == "ON":
            motor.reset()
            motor.power(True)
        elif word == "OFF":
            motor.power(False)
        elif word == "FEED":
            motor.feed()
        elif word == "ZERO":
            motor.torque.zero(numbers[0])
            motor.speed.zero(numbers[0])
        elif word in ("TQ", "SP") and motor.on:
            (motor.torque if word == "TQ" else motor.speed).go(*numbers)
        else:
            return "ERR"
        return "OK"


@pytest.fixture(autouse=True)
def announced(monkeypatch: pytest.MonkeyPatch) -> None:
    module = example()
    point = SimpleNamespace(name="ascii", load=lambda: module.PLUGIN)
    monkeypatch.setattr(plugins, "entry_points", lambda _: [point])


@pytest.fixture(scope="module")
def running() -> Iterator[AsciiPeer]:
    with AsciiPeer() as peer:
        yield peer


def bench(peer: AsciiPeer) -> BenchDescription:
    section = {"protocol": "ascii", "address": peer.address}
    alike = ("reference", "angles", "temperature", "modes", "clamp", "guide_rail", "power_supply")
    channels = dict.fromkeys(("input_torque", "output_torque"), "")
    found = described(
        counter=section | {"channels": channels, "timeout_s": 4.9},
        output_drive=section | {"timeout_s": 4.9},
        **dict.fromkeys(alike, section | {"timeout_s": 4.9}),
    )
    parts = {
        "guide_rail": GuideRailDescription(serial="A-1"),
        "power_supply": PowerSupplyDescription(serial="A-1"),
        "counter": found.counter.model_copy(
            update={"serial": "A-1", "window_s": 0.05, "block_s": 0.25}
        ),
    }
    found = found.model_copy(update=parts)
    drive = found.output.drive.model_copy(update={"serial": "A-1"})
    module = found.output.model_copy(update={"drive": drive})
    return found.model_copy(update={"output": module})


def _read_windows(counter: Any) -> Any:
    counter.select(frozenset({"input_torque", "output_torque"}))
    return counter.read_block(0.25)


def _has_values(block: Any) -> bool:
    """Whether every window is there, asked for in time or lost on a busy computer."""
    values = block.records["input_torque"]["signal"]
    return values.size == 5 and set(values[~np.isnan(values)]) <= {12.5}


CASES = [
    DriverCase(
        "counter",
        "counter",
        _read_windows,
        _has_values,
        lossy=True,
    ),
    DriverCase(
        "angles", "angles", lambda i: i.counts(), lambda c: c == {"input": -7, "output": 2500}
    ),
    DriverCase(
        "probes",
        "temperature",
        lambda i: i.temperatures(),
        lambda t: set(t.values()) == {23.0},
        quiet=True,
    ),
    DriverCase("modes", "modes", lambda i: i.mode("input"), lambda m: m == "free"),
    DriverCase("clamp", "clamp", lambda i: i.clamped(), lambda c: c is False),
    DriverCase("rail", "guide_rail", lambda i: i.position(), lambda p: p == "away"),
    DriverCase("supply", "power_supply", lambda i: i.supplies(), lambda s: s is True),
    DriverCase("drive", "output_drive", lambda i: i.state(), lambda s: not s.enabled),
    DriverCase(
        "read-out",
        "reference",
        lambda i: i.read("input", time.monotonic(), time.monotonic()),
        lambda r: r.time_s.shape == r["signal"].shape,
    ),
]


SAME_LINK = ("angles", "modes", "clamp", "rail", "supply")
"""Cases whose connection another one has as well."""


class TestAscii(DriverContract):
    @pytest.fixture(
        params=[nightly(each) if each.name in SAME_LINK else each for each in CASES],
        ids=lambda case: case.name,
    )
    def case(self, request: pytest.FixtureRequest) -> DriverCase:
        found: DriverCase = request.param
        return found

    @pytest.fixture
    def peer(self, running: AsciiPeer) -> Iterator[Any]:
        yield SimpleNamespace(description=bench(running), misbehaviour=running)
        running.heal()

    def hasty(self, description: BenchDescription) -> BenchDescription:
        driver = dict(description.driver)
        for key, section in driver.items():
            if section.get("protocol") == "ascii":
                driver[key] = section | {"timeout_s": HASTY_DRIVE_S}
        return description.model_copy(update={"driver": driver})


class TestDrive(DriveContract):
    @pytest.fixture
    def case(self, running: AsciiPeer) -> Iterator[MotorCase]:
        yield motor_case(bench(running), "output_drive", running.motor)
        running.motor.reset()
