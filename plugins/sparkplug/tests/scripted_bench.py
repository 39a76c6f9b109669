"""A bench for the Sparkplug publisher whose readings are set by a test."""

import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from torquebench_sparkplug.metrics import DEVICES, NODE, Reading, Readings
from torquebench_sparkplug.payload import Quality
from torquebench_sparkplug.publisher import Publisher
from torquebench_sparkplug.settings import SparkplugSettings

PATIENCE_S = 120.0


@dataclass
class ScriptedBench:
    """Holds the readings for the publisher, and the publisher's messages."""

    values: dict[str, dict[str, Reading]] = field(default_factory=dict)
    alive: bool = True
    counting: bool = False
    counted: int = 0
    reads: int = 0
    notes: list[str] = field(default_factory=list)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __post_init__(self) -> None:
        self.put(NODE, "Bench/State", "idle")
        for device in DEVICES:
            self.put(device, "Torque/Range", 2000.0)
            self.put(device, "Torque/Value", 10.0)
            self.put(device, "Speed/Value", 0.0)

    def put(self, device: str, name: str, value: Any, quality: Quality = Quality.GOOD) -> None:
        """Set a metric's value, measured now."""
        with self._lock:
            now = round(time.time() * 1000)
            self.values.setdefault(device, {})[name] = Reading(value, now, quality)

    def read(self) -> Readings:
        """Return the set readings; while `counting`, the input's speed changes with each call."""
        if self.counting:
            self.counted += 1
            self.put("input", "Speed/Value", float(self.counted))
        with self._lock:
            values = {device: dict(found) for device, found in self.values.items()}
            self.reads += 1
        return Readings(values, self.alive)

    def taken(self) -> None:
        """Wait until the publisher has read the set values, and sent or stored them."""
        enough, deadline = self.reads + 2, time.monotonic() + PATIENCE_S
        while self.reads < enough:
            assert time.monotonic() < deadline
            time.sleep(0.01)

    def publisher(self, folder: Path, *brokers: str, **settings: Any) -> Publisher:
        """Return a publisher that samples this bench ten times a second."""
        known = {"group_id": "Hall 3", "edge_node_id": "Bench 7", "interval_s": 0.1}
        known |= {"reconnect_first_s": 0.1, "reconnect_longest_s": 0.3, "keep_alive_s": 5}
        asked = SparkplugSettings.model_validate({"brokers": brokers} | known | settings)
        return Publisher(asked, folder, self.read, self.notes.append)
