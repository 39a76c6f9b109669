"""A session that `doctor --record` kept is replayed to the driver."""

import json
from pathlib import Path

import numpy as np
import pytest
from tests.peers.hbm_amplifiers import HbmPeer
from tests.system.networked import described

from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.instruments import open_role
from torquebench.bench.drivers.recording import recorded
from torquebench.errors import InputError
from torquebench.testing.replay import Replay


def bench(address: str) -> BenchDescription:
    channels = {"input_torque": 1, "output_torque": 2}
    keys = {"protocol": "hbm", "family": "PMX", "address": address, "timeout_s": 2.0}
    found = described(counter=keys | {"channels": channels})
    slow = found.counter.model_copy(update={"window_s": 0.05, "block_s": 0.1})
    return found.model_copy(update={"counter": slow})


def values(description: BenchDescription) -> set[float]:
    counter = open_role(description, "counter")
    try:
        assert counter.identity().manufacturer == "HBM"
        read = [counter.read_block(0.2).records["input_torque"]["signal"] for _ in range(4)]
    finally:
        counter.close()
    found = np.concatenate(read)
    return set(found[~np.isnan(found)].tolist())


def test_a_recorded_session_answers_as_the_device_did(tmp_path: Path) -> None:
    file = tmp_path / "session.jsonl"
    with HbmPeer("PMX", {1: lambda: (10.5, 0), 2: lambda: (-3.0, 0)}, False) as peer:
        with recorded(file, {"bench": "peers"}):
            assert values(bench(peer.address)) == {10.5}
        values(bench(peer.address))  # nothing of this is recorded
    lines = file.read_text(encoding="utf-8").splitlines()
    first, *events = map(json.loads, lines)
    assert first["bench"] == "peers"
    assert {event["event"] for event in events} == {"sent", "received", "answer"}
    assert {event["address"] for event in events} == {peer.address}
    times = [event["t_s"] for event in events]
    assert times == sorted(times)
    with Replay(lines, "counter") as device:
        assert values(bench(device.address)) == {10.5}


def test_a_silence_is_recorded_as_a_failure(tmp_path: Path) -> None:
    file = tmp_path / "session.jsonl"
    channels = {1: lambda: (1.0, 0), 2: lambda: (1.0, 0)}
    with HbmPeer("PMX", channels, False) as peer, recorded(file, {}):
        amplifier = open_role(bench(peer.address), "counter")
        try:
            peer.start("counter", "drop", replies=1)
            amplifier.identity()
        finally:
            amplifier.close()
    assert "no answer in" in file.read_text(encoding="utf-8")


def test_a_file_that_exists_is_not_overwritten(tmp_path: Path) -> None:
    file = tmp_path / "session.jsonl"
    file.write_text("mine", encoding="utf-8")
    with pytest.raises(InputError, match=r"session\.jsonl"), recorded(file, {}):
        pass
    assert file.read_text(encoding="utf-8") == "mine"
