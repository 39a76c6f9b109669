"""A bench of separate instruments, all simulated, on ports that nobody else has."""

import contextlib
import functools
import random
import re
import socket
import tempfile
import tomllib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from importlib import resources
from pathlib import Path
from typing import Any

import bluesky.plan_stubs as bps
from tests.peers.motor import Motor
from tests.system.command_line import started

from torquebench.bench.description import DEFAULT_BENCH, BenchDescription
from torquebench.bench.drivers.simulated.control import SimulationControl
from torquebench.station import Station
from torquebench.testing.drives import MotorCase
from torquebench.validation import validated

ANY_PORT = "127.0.0.1:0"
WATCHDOG_S = 10.0
PATIENT_S = {
    "modbus": 20.0,
    "scpi": 20.0,
    "nidaqmx": 20.0,
    "hbm": 20.0,
    "serial": 20.0,
    "opcua": 20.0,
    "ads": 20.0,
    "s7": 20.0,
}
PATIENT_DRIVE_S = 4.9
"""How long answers may take: a busy computer may stand for seconds. A drive's second try has to
come before its watchdog, whose time is the longest that there is."""
HASTY_S = {
    "modbus": 0.8,
    "scpi": 0.8,
    "nidaqmx": 0.6,
    "hbm": 0.4,
    "serial": 0.4,
    "opcua": 0.4,
    "ads": 0.4,
    "s7": 0.4,
}
HASTY_DRIVE_S = 0.3
HASTY_COUNTER_S = 2.5
"""The same where a test waits for answers that don't come; a counter is asked only once."""
DRIVES = ("input_drive", "output_drive")
PROBES = {
    "ambient": 0,
    "input_transducer": 1,
    "output_transducer": 2,
    "reducer": 3,
    "calibrator": 4,
}
CAN_BUS = {"interface": "socketcand", "host": "127.0.0.1", "port": 0, "channel": "can0"}


def modbus(**keys: Any) -> dict[str, Any]:
    return {"protocol": "modbus", "address": ANY_PORT, **keys}


def scpi(**keys: Any) -> dict[str, Any]:
    return {"protocol": "scpi", "address": ANY_PORT, **keys}


def scpi_counter() -> dict[str, Any]:
    channels = {"input_torque": ANY_PORT, "output_torque": ANY_PORT}
    return {"protocol": "scpi", "channels": channels}


def canopen() -> dict[str, Any]:
    return {"protocol": "canopen", "bus": CAN_BUS, "node": 5}


def daqmx() -> dict[str, Any]:
    return {
        "protocol": "nidaqmx",
        "address": ANY_PORT,
        "device": "Dev1",
        "channels": {"input_torque": "Dev1/ctr0", "output_torque": "Dev1/ctr1"},
        "encoders": {"input": "Dev1/ctr2", "output": "Dev1/ctr3"},
        "clock": "Dev1/ctr4",
    }


@functools.cache
def compile_kernels() -> None:
    """Compile what a bench computes: in a process with simulators, they wait meanwhile."""
    with tempfile.TemporaryDirectory() as folder, Station.open(None, Path(folder)) as station:
        station.run(bps.sleep(0.2), kind="warm-up")


def described(**sections: Any) -> BenchDescription:
    """Describe a bench with an instrument for each role.

    `sections` replace them, None leaves one out.
    """
    compile_kernels()
    text = (resources.files("torquebench.bench") / DEFAULT_BENCH).read_text(encoding="utf-8")
    values = tomllib.loads(text)
    values["bench"] |= {"driver": "instruments", "name": "Networked bench"}
    values["output"]["drive"]["serial"] = "402005"
    for side in ("input", "output"):
        values[side]["drive"]["watchdog_s"] = WATCHDOG_S
    angles = {"angles": modbus(registers={"input": 0, "output": 2})}
    if sections.get("counter", {}).get("protocol") == "nidaqmx":
        values["counter"]["serial"] = "0A1B2C3D"
        angles = {}
    values["driver"] = {
        "simulation": {"control": ANY_PORT},
        "counter": scpi_counter(),
        **angles,
        "input_drive": {"protocol": "modbus", "address": ANY_PORT},
        "output_drive": canopen(),
        "reference": scpi(),
        "temperature": modbus(probes=PROBES, interval_s=0.0),
        "modes": modbus(),
        "clamp": modbus(),
        **sections,
    }
    chosen = values["driver"]
    values["driver"] = {
        key: waiting(key, section, PATIENT_DRIVE_S, PATIENT_S) | section
        for key, section in chosen.items()
        if section is not None
    }
    return validated(BenchDescription, values, "networked.toml")


def seen_by(
    lock: AbstractContextManager[Any], look: Callable[[], None]
) -> Callable[[Callable[[], Any]], Callable[[], Any]]:
    """Return how a value of a peer is read: under its lock, after its watchdogs have acted."""

    def seen(value: Callable[[], Any]) -> Callable[[], Any]:
        def now() -> Any:
            with lock:
                look()
                return value()

        return now

    return seen


def motor_case(
    description: BenchDescription,
    key: str,
    motor: Motor,
    look: Callable[[], None] | None = None,
    **others: Any,
) -> MotorCase:
    """Describe a drive of a peer that has a `Motor`; `look` lets its watchdogs act."""
    seen = seen_by(motor.lock, look or motor.look)
    return MotorCase(
        description,
        key,
        powered=seen(lambda: motor.on),
        torque_nm=seen(lambda: motor.torque.present),
        speed_rad_s=seen(lambda: motor.speed.present),
        **{"starve": seen(lambda: motor.starve(motor.watchdog_s))} | others,
    )


def waiting(
    key: str, section: dict[str, Any], drive_s: float, others_s: dict[str, float]
) -> dict[str, float]:
    """Return how long a section's instrument may take to answer, as the section states it."""
    if key in DRIVES:
        return {"timeout_s": drive_s}
    protocol = section.get("protocol")
    return {"timeout_s": others_s[protocol]} if protocol in others_s else {}


def hasty(
    description: BenchDescription, *keys: str, drive_s: float = HASTY_DRIVE_S
) -> BenchDescription:
    """Return a description whose client soon takes an answer or a travel for lost.

    Only those instruments are meant whose sections are named, if any are.
    """
    driver = dict(description.driver)
    for key in keys or tuple(driver):
        driver[key] = driver[key] | waiting(key, driver[key], drive_s, HASTY_S)
        if key in ("modes", "clamp"):
            driver[key] = driver[key] | {"travel_s": 0.3}
        if key == "counter":
            driver[key] = driver[key] | {"timeout_s": HASTY_COUNTER_S}
    return description.model_copy(update={"driver": driver})


EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "networked.toml"


def free_ports(count: int) -> list[int]:
    """Return ports below those that the system gives to clients, so that nobody takes them."""
    ports: list[int] = []
    while len(ports) < count:
        port = random.SystemRandom().randrange(20_000, 30_000)
        if port in ports:
            continue
        with contextlib.suppress(OSError), socket.create_server(("127.0.0.1", port)):
            ports.append(port)
    return ports


def patient_example(text: str) -> str:
    """Return the example with time for a busy computer, in the drives' watchdogs above all."""
    text = re.sub(r"^watchdog_s = .*$\n", "", text, flags=re.MULTILINE)
    text = re.sub(
        r"^\[(input|output)\.drive\]$",
        rf"\g<0>\nwatchdog_s = {WATCHDOG_S}",
        text,
        flags=re.MULTILINE,
    )
    text = re.sub(r"^stall_s = .*$", "stall_s = 60.0", text, flags=re.MULTILINE)
    sections = tomllib.loads(text)["driver"]
    for key, section in sections.items():
        for name, value in waiting(key, section, PATIENT_DRIVE_S, PATIENT_S).items():
            text = re.sub(
                rf"^\[driver\.{key}\].*$", rf"\g<0>\n{name} = {value}", text, flags=re.MULTILINE
            )
    return text


@contextlib.contextmanager
def simulating(
    folder: Path, *options: str, patient: bool = True
) -> Iterator[tuple[Path, SimulationControl]]:
    """Run `torquebench simulate` on the networked example, on ports that nobody else has.

    It has time for a busy computer unless a test waits for answers that don't come.
    Yields the bench's description and the simulators' control.
    """
    text = EXAMPLE.read_text(encoding="utf-8")
    known = sorted(set(re.findall(r"\b170\d\d\b", text)))
    for used, port in zip(known, free_ports(len(known)), strict=True):
        text = re.sub(rf"\b{used}\b", str(port), text)
    bench = folder / "networked.toml"
    text = patient_example(text) if patient else text
    bench.write_text(text, encoding="utf-8")
    with started("simulate", "--bench", bench, *options, cwd=folder) as process:
        assert process.stdout is not None
        assert any(line.strip() == "Ready." for line in process.stdout), process.stderr
        address = tomllib.loads(text)["driver"]["simulation"]["control"]
        control = SimulationControl(address)
        try:
            yield bench, control
        finally:
            control.close()
