"""Whole calibrations on amplifiers and displays, against peers in real time; cable and process."""

import os
import re
import signal
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Literal

import pytest
from tests.peers.displays import DisplayPeer, ScalePeer
from tests.peers.hbm_amplifiers import HbmPeer
from tests.peers.lines import LinePeer
from tests.peers.opcua_plc import PlcPeer
from tests.system.command_line import started, wait_until
from tests.system.panel_api import SLOW
from tests.system.peer_bench import GAIN, RANGE_NM, PeerBench, amplified, peer_bench, stated, toml

from torquebench.testing.cable import Cable

pytestmark = SLOW
FULL = {"input": 2.0, "output": 1.5}
COUNTS = 838_861
"""Counts of a converter at 1 mV/V."""
STANDS_S = 14.0
Amplifier = Literal["hbm", "displays", "plc"]


def hbm_amplifiers(bench: PeerBench, values: dict[str, Any], peers: ExitStack) -> LinePeer:
    """Modules in mV/V on a PMX by TCP, the standard in N·m on a DMP41 by RS-232."""
    amplified(values, "mV/V", FULL)
    sides = {1: "input", 2: "output"}
    modules = {
        k: stated(lambda side=side: bench.module_nm(side) * FULL[side] / RANGE_NM[side])  # type: ignore[misc]
        for k, side in sides.items()
    }
    standards = {
        k: stated(lambda side=side: bench.standard_nm(side))  # type: ignore[misc]
        for k, side in sides.items()
    }
    pmx = peers.enter_context(HbmPeer("PMX", modules, False))
    dmp = peers.enter_context(HbmPeer("DMP41", standards, True))
    values["counter"]["serial"] = "0009E5004711"
    keys = {"protocol": "hbm", "timeout_s": 1.0}
    values["driver"]["counter"] = keys | {
        "family": "PMX",
        "address": pmx.address,
        "channels": {"input_torque": 1, "output_torque": 2},
    }
    values["driver"]["reference"] = keys | {
        "family": "DMP41",
        "address": dmp.address,
        "channels": {"input_reference": 1, "output_reference": 2},
    }
    return pmx


def displays(bench: PeerBench, values: dict[str, Any], peers: ExitStack) -> LinePeer:
    """Modules on displays in N·m, the standard on load cells' converters; all on serial lines."""
    amplified(values, "Nm")
    values["counter"]["serial"] = "D-1"
    keys = {"protocol": "serial", "timeout_s": 1.0}
    shown = {
        f"{side}_torque": peers.enter_context(
            DisplayPeer(lambda side=side: bench.module_nm(side))  # type: ignore[misc]
        )
        for side in RANGE_NM
    }
    cells = {
        f"{side}_reference": peers.enter_context(
            ScalePeer(
                lambda side=side: round(  # type: ignore[misc]
                    COUNTS * FULL[side] * bench.standard_nm(side) / RANGE_NM[side]
                )
            )
        )
        for side in RANGE_NM
    }
    values["driver"]["counter"] = keys | {
        "channels": {name: peer.address for name, peer in shown.items()},
        "request": "P",
        "terminator": "\r",
        "serial": "D-1",
    }
    values["driver"]["reference"] = keys | {
        "channels": {name: peer.address for name, peer in cells.items()},
        "scale": 1.0 / COUNTS,
        "serial": "HX-1",
    }
    for side in RANGE_NM:
        values["calibrator"][side].pop("option_khz", None)
        values["calibrator"][side] |= {
            "signal": "mV/V",
            "signal_at_nominal": FULL[side],
            "filter_delay_s": 0.0,
            "signal_uncertainty_percent": 0.0,
        }
    return shown["input_torque"]


def plc(bench: PeerBench, values: dict[str, Any], peers: ExitStack) -> Cable:
    """Modules in V and the standard in N·m as variables of a PLC, behind one cable."""
    amplified(values, "V", {"input": 10.0, "output": 10.0})
    variables: dict[str, Any] = {}
    for side, range_nm in RANGE_NM.items():
        variables[f"{side}_torque"] = lambda side=side, range_nm=range_nm: (
            10.0 * bench.module_nm(side) / range_nm
        )
        variables[f"{side}_reference"] = lambda side=side: bench.standard_nm(side)
    server = peers.enter_context(PlcPeer(variables))
    cable = peers.enter_context(Cable(server.port))
    values["counter"]["serial"] = "PLC-1"
    for role, kind in (("counter", "torque"), ("reference", "reference")):
        values["driver"][role] = {
            "protocol": "opcua",
            "address": cable.address,
            "serial": "PLC-1",
            "timeout_s": 1.0,
            "channels": {f"{side}_{kind}": f"ns=2;s={side}_{kind}" for side in RANGE_NM},
        }
    return cable


@contextmanager
def calibrating(kind: Amplifier, folder: Path) -> Iterator[tuple[PeerBench, Any, Any]]:
    """Calibrate the input module; yield bench, the module's amplifier and the process."""
    with peer_bench() as (bench, values), ExitStack() as peers:
        connects: dict[str, Any] = {"hbm": hbm_amplifiers, "displays": displays, "plc": plc}
        amplifier = connects[kind](bench, values, peers)
        path = toml(values, folder / "bench.toml")
        options = ("--yes", "--step", 25, "--repeats", 1, "--data", "data")
        with started("calibrate", "input", "--bench", path, *options, cwd=folder) as process:
            yield bench, amplifier, process


KINDS: tuple[Amplifier, ...] = ("hbm", "displays", "plc")
"""`test_driver_contract` tests what differs between them."""


@pytest.mark.nightly
@pytest.mark.parametrize("kind", KINDS)
def test_a_module_is_calibrated_on_its_amplifier(kind: Amplifier, tmp_path: Path) -> None:
    with calibrating(kind, tmp_path) as (_, _, process):
        said = "".join(process.communicate(timeout=600.0))
        assert process.returncode == 0, said
    worst = {
        name: float(re.findall(rf"{name}\s+[\d.]+\s+[\d.]+\s+([\d.]+)", said)[0])
        for name in ("raw reading", "physics . Gaussian process")
    }
    assert worst["raw reading"] == pytest.approx(100.0 * (GAIN - 1.0), rel=0.1)  # % FS
    assert worst["physics . Gaussian process"] < 0.02


@pytest.mark.nightly
@pytest.mark.parametrize("kind", KINDS)
def test_a_cable_that_is_pulled_under_load_ends_it_unloaded(
    kind: Amplifier, tmp_path: Path
) -> None:
    with calibrating(kind, tmp_path) as (bench, amplifier, process):
        wait_until(lambda: bench.torque_nm("input") > 20.0, "a load")
        if kind != "displays":
            amplifier.start("counter", "disconnect", duration_s=600.0)
        else:
            amplifier.pull_out()
        pulled = time.monotonic()
        wait_until(lambda: abs(bench.torque_nm("input")) < 0.1, "no load")
        unloaded_s = time.monotonic() - pulled
        said = "".join(process.communicate(timeout=300.0))
    assert process.returncode == 1, said
    assert not bench.motors["input"].on
    assert amplifier.address in re.sub(r"\s+", "", said)
    # Signal loss, two answers of two attempts, and the time that a busy computer stands.
    assert unloaded_s < 2.0 + 4.0 * 1.0 + STANDS_S


@pytest.mark.nightly
def test_a_killed_process_leaves_the_load_to_the_drive(tmp_path: Path) -> None:
    with calibrating("hbm", tmp_path) as (bench, _, process):
        wait_until(lambda: bench.torque_nm("input") > 20.0, "a load")
        os.kill(process.pid, signal.SIGKILL)
        process.communicate()
        motor = bench.motors["input"]
        with motor.lock:
            motor.starve(motor.watchdog_s)
        wait_until(lambda: bench.torque_nm("input") == 0.0, "the drive's watchdog")
        assert motor.tripped
