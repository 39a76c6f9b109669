"""A station on simulated instruments over real sockets: plans, alarms, truth, doctor, demo."""

import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.draws import nightly
from tests.system.command_line import run, widest_line
from tests.system.networked import (
    canopen,
    daqmx,
    described,
    free_ports,
    modbus,
    patient_example,
)
from tests.system.test_station_runs import staircase

from torquebench.bench.certificates.encoder import encoder_certificates
from torquebench.bench.description import BenchDescription, load_bench
from torquebench.bench.drivers.simulated.control import SimulationControl
from torquebench.bench.drivers.simulated.driver import open_simulated
from torquebench.errors import BenchError, InputError, TorquebenchError
from torquebench.operations.bench_checks import drives, instruments
from torquebench.simulators import KINDS, Simulators
from torquebench.station import Station

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "networked.toml"


@pytest.fixture(params=["scpi", nightly("nidaqmx"), "nidaqmx-with-reference"])
def simulators(request: pytest.FixtureRequest) -> Iterator[Simulators]:
    sections: dict[str, Any] = {}
    if request.param == "nidaqmx":
        sections = {"counter": daqmx(), "reference": modbus()}
    elif request.param == "nidaqmx-with-reference":  # all transducers to the counter
        counter = daqmx()
        counter["channels"] |= {"input_reference": "Dev1/ctr5", "output_reference": "Dev1/ctr6"}
        sections = {"counter": counter, "reference": None}
    with Simulators(described(**sections)) as running:
        yield running


@pytest.fixture
def station(simulators: Simulators, tmp_path: Path) -> Iterator[Station]:
    with Station.open(simulators.description, tmp_path) as opened:
        yield opened


def becomes(condition: Callable[[], object]) -> bool:
    """Wait patiently for something."""
    deadline = time.monotonic() + 120.0
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.01)
    return bool(condition())


def test_a_staircase_over_sockets_states_the_true_torque(station: Station) -> None:
    record = station.run(staircase(station.devices, [0.0, 400.0, 800.0]), kind="calibrate-output")
    rows = record.result
    standard = np.array([row["standard_nm"] for row in rows])
    true = np.array([row["true_torque_nm"] for row in rows])
    np.testing.assert_allclose(standard, [0.0, 400.0, 800.0], atol=12.0)
    np.testing.assert_allclose(standard, true, atol=1.5)
    assert record.metadata["simulated"] is True
    assert record.metadata["counter_identity"] == station.drivers.counter.clock_identity


@pytest.mark.parametrize(
    "simulators", ["scpi", nightly("nidaqmx"), nightly("nidaqmx-with-reference")], indirect=True
)
def test_a_lying_drive_brings_the_bench_to_its_safe_state(
    station: Station, simulators: Simulators
) -> None:
    station.run(staircase(station.devices, [0.0, 200.0]), kind="load")
    simulators.misbehaviour.start("output_drive", "lie")
    with pytest.raises(TorquebenchError, match="drive"):
        station.run(staircase(station.devices, [0.0, 200.0]), kind="load")
    assert not station.supervisor.wait_safe(120.0), "it says that it is on"
    assert "output side: drive still on" in station.supervisor.alarm.found
    simulators.misbehaviour.heal()
    assert becomes(lambda: station.supervisor.safe)
    assert not any(drive.state().enabled for drive in simulators.plant.bench.drives.values())


def test_a_drive_of_a_client_that_was_killed_stops_by_itself() -> None:
    with Simulators(described(counter=daqmx())) as running:
        program = (
            "import json, sys, time\n"
            "from torquebench.bench.description import default_bench\n"
            "from torquebench.bench.drivers.daqmx import DaqmxCounter, DaqmxOptions\n"
            "from torquebench.bench.drivers.modbus.link import ModbusLink, ModbusOptions\n"
            "from torquebench.bench.drivers.modbus.driver import ModbusDrive\n"
            "options = DaqmxOptions.model_validate_json(sys.argv[2])\n"
            "counter = DaqmxCounter(options, default_bench())\n"
            "counter.read_block(0.1)\n"
            "link = ModbusLink('drive', ModbusOptions(address=sys.argv[1], timeout_s=20))\n"
            "drive = ModbusDrive(link, 'input', 0.5)\n"
            "drive.enable()\n"
            "print('on', flush=True)\n"
            "time.sleep(60)\n"
        )
        address = running.description.driver["input_drive"]["address"]
        counter = dict(running.description.driver["counter"])
        counter.pop("protocol")
        client = subprocess.Popen(
            [sys.executable, "-c", program, address, json.dumps(counter)],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert client.stdout is not None
        assert client.stdout.readline().strip() == "on"
        drive = running.plant.bench.drives["input"]
        assert drive.state().enabled
        client.send_signal(signal.SIGKILL)
        client.communicate()
        assert becomes(lambda: not drive.state().enabled)
        assert "watchdog" in drive.state().fault


def test_orders_come_over_the_control_channel() -> None:
    with Simulators(described()) as running:
        control = SimulationControl(running.description.driver["simulation"]["control"])
        try:
            status = control.ask("status")
            assert status["mounted"] == "nothing"
            assert {"counter", "input_drive", "output_drive"} <= set(status["endpoints"])
            control.ask("mount", mounting="calibrator")
            assert control.ask("status")["mounted"] == "calibrator"
            control.ask("misbehave", endpoint="modes", kind="drop", replies=1)
            assert running.misbehaviour.endpoint("modes").active("drop")
            control.ask("heal")
            assert not any(running.misbehaviour.endpoint("modes").active(kind) for kind in KINDS)
            with pytest.raises(BenchError, match="endpoint 'nobody'"):
                control.ask("misbehave", endpoint="nobody", kind="drop")
            with pytest.raises(BenchError, match="unknown request"):
                control.ask("dance")
            with pytest.raises(BenchError, match="NaN is no number"):
                control.ask("sweep", side="output", torque_nm=[0.0, float("nan")])
            with pytest.raises(BenchError, match="mounting"):
                control.ask("mount", mounting="elephant")
        finally:
            control.close()


def test_simulated_encoders_bring_their_certificates_over_the_network(station: Station) -> None:
    local = described()
    alike = local.model_copy(update={"driver": {"seed": 1}})
    brought = open_simulated(alike).encoder_certificates
    found = encoder_certificates(
        station.description, station.devices.context.drivers.encoder_certificates
    )
    assert set(found) == {"input", "output"}
    for side, certificate in found.items():
        np.testing.assert_array_equal(certificate.error_rad, brought[side].error_rad)


def test_a_bench_of_real_instruments_has_no_simulators() -> None:
    description = described()
    driver = {key: value for key, value in description.driver.items() if key != "simulation"}
    with pytest.raises(InputError, match="no instruments to simulate"):
        Simulators(description.model_copy(update={"driver": driver}))


def test_a_port_in_use_is_named() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        for section in (
            {"input_drive": modbus(address=f"127.0.0.1:{port}")},
            {"output_drive": canopen() | {"bus": canopen()["bus"] | {"port": port}}},
            {"counter": daqmx() | {"address": f"127.0.0.1:{port}"}},
        ):
            with pytest.raises(BenchError, match=str(port)):
                Simulators(described(**section))


# -- commands ---------------------------------------------------------------------------------


def _on_free_ports(text: str) -> str:
    """Return a bench description with its ports replaced by free ones."""
    known = ("17000", "17001", "17010", "17011", "17020", "17030", "17031")
    for before, after in zip(known, free_ports(len(known)), strict=True):
        text = text.replace(before, str(after))
    return patient_example(text)


def test_simulate_serves_and_doctor_finds_everything_well(tmp_path: Path) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text(_on_free_ports(EXAMPLE.read_text(encoding="utf-8")), encoding="utf-8")
    program = "from torquebench.cli import main; main()"
    serving = subprocess.Popen(
        [sys.executable, "-c", program, "simulate", "--bench", str(bench)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert serving.stdout is not None
        lines = []
        while not lines or lines[-1].strip() != "Ready.":
            lines.append(serving.stdout.readline())
            assert lines[-1], serving.communicate()
        assert any("output_drive" in line and "canopen" in line for line in lines)
        checked = run("doctor", "--bench", bench, "--test-drives", cwd=tmp_path)
        assert checked.returncode == 0, checked.stdout
        assert widest_line(checked.stdout) <= 80
        words = " ".join(checked.stdout.split())
        for text in ("PXIe-6612", "402005", "input watchdog", "it stopped by itself", "Ready."):
            assert text in words
    finally:
        serving.send_signal(signal.SIGINT)
        _, said = serving.communicate(timeout=240)
    assert serving.returncode == 0
    assert "simulators ended" in said


@pytest.mark.nightly
def test_the_demo_starts_its_simulators_and_ends_them(tmp_path: Path) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text(_on_free_ports(EXAMPLE.read_text(encoding="utf-8")), encoding="utf-8")
    told = run("demo", "--quick", "--bench", bench, "--seed", 3, cwd=tmp_path)
    assert told.returncode == 0, told.stderr
    assert "simulators started for this demo" in told.stderr
    assert "seed 3" in told.stderr
    assert "against the true torque" in told.stdout
    assert "simulated" in (tmp_path / "torquebench-demo.html").read_text(encoding="utf-8")
    after = SimulationControl(load_bench(bench).driver["simulation"]["control"])
    with pytest.raises(BenchError, match="refused"):
        after.ask("status")


def test_doctor_names_each_instrument_that_fails_and_hides_no_other(tmp_path: Path) -> None:
    with Simulators(described()) as running:
        description = running.description
        other = description.counter.model_copy(update={"serial": "ANOTHER"})
        driver = dict(description.driver)
        driver["clamp"] = driver["clamp"] | {"address": "127.0.0.1:9"}
        broken = description.model_copy(update={"driver": driver, "counter": other})
        found = {finding.what: finding for finding in instruments(broken, tmp_path)}
    assert found["clamp"].state == "problem"
    assert "127.0.0.1:9" in found["clamp"].found
    assert found["clamp"].remedy
    assert found["counter"].state == "problem"
    assert "described is ANOTHER" in found["counter"].found
    for name in ("input drive", "output drive", "reference", "temperature", "modes", "angles"):
        assert found[name].state == "ok"


@pytest.mark.nightly
def test_doctor_notices_a_drive_without_a_watchdog(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with Simulators(described(counter=daqmx())) as running:
        monkeypatch.setattr(running.plant.bench, "_watch", lambda _: None)
        document = running.description.model_dump()
        for side in ("input", "output"):
            document[side]["drive"]["watchdog_s"] = 4.0
            document["driver"][f"{side}_drive"]["timeout_s"] = 1.9
        description = BenchDescription.model_validate(document)
        found = {finding.what: finding for finding in drives(description, tmp_path)}
    assert found["input watchdog"].state == "problem"
    assert "last line of defence" in found["input watchdog"].remedy
    assert found["input stop"].state == found["output stop"].state == "ok"


def test_simulators_of_a_real_bench_are_refused(tmp_path: Path) -> None:
    refused = run("simulate", "--bench", EXAMPLE.parent / "bench.toml", cwd=tmp_path)
    assert refused.returncode == 2
    assert "section [driver.simulation]" in refused.stderr
