"""Records and calibration points of a simulated fleet of benches.

Nothing is measured: rows and files, as benches would send them, are generated from a seed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from torquebench.records.chain import START, ChainHead, canonical, seal
from torquebench_plant import FolderStore, facts_of
from torquebench_plant.forwarding import points_table

__all__ = ["TYPES", "FleetBench", "calibration_points"]

BEGIN = datetime(2024, 1, 1, tzinfo=UTC)
YEARS = 2.0
TYPES = ("RV-20E", "RV-40E", "RV-110E", "CSG-32", "CSG-40")
MODELS = ("T40B", "T12HP", "4503B")
KINDS = ("test-hysteresis", "test-no-load", "check-output", "verify-output")
SHARES = (0.5, 0.3, 0.15, 0.05)
OPERATORS = tuple(f"operator-{k}" for k in range(40))
EVERY = 100
"""Number of runs of which one is a calibration."""


def calibration_points(span_percent: float, serial: str, seed: int) -> dict[str, Any]:
    """Return the results of a calibration with an error of its span and noise."""
    random = np.random.default_rng(seed)
    up = np.arange(0.0, 1001.0, 50.0)
    standard = np.concatenate([up, up[-2::-1], -up[1:], -up[-2::-1]])
    branch = np.concatenate([np.ones(21), -np.ones(20), np.ones(20), -np.ones(20)])
    noise = 0.05 * random.normal(size=standard.size)
    reading = standard * (1.0 + span_percent / 100.0) + 0.3 * np.sin(standard / 400.0) + noise
    return {
        "data": {
            "reading_nm": reading.tolist(),
            "standard_nm": standard.tolist(),
            "series": [1] * standard.size,
            "branch": branch.astype(int).tolist(),
            "range_nm": 1000.0,
            "side": "output",
            "transducer_serial": serial,
            "counter_identity": f"C-{serial}/oscillator",
            "simulated": True,
        },
        "unsettled": 0,
        "standard_serial": "CAL-1",
        "placement": None,
    }


@dataclass(frozen=True)
class FleetBench:
    """One bench of the fleet; benches of different halls have the same names.

    Parameters
    ----------
    seed, number : int
        Seed of the fleet, and number of the bench in the fleet, from 0.
    runs : int
        Number of runs that the bench recorded in two years.
    """

    seed: int
    number: int
    runs: int

    @property
    def name(self) -> str:
        """Return the bench's name in its hall."""
        return f"Bench {self.number % 50 + 1}"

    @property
    def place(self) -> str:
        """Return the hall's name."""
        return f"Hall {self.number // 50 + 1}"

    @property
    def serial(self) -> str:
        """Return the transducer's serial number."""
        return f"T-{self.number:04}"

    def records(self, root: str) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
        """Return the links of the bench's chain, and its reports about arrived folders."""
        links: list[dict[str, Any]] = []
        arrived: list[dict[str, Any]] = []
        head = ChainHead(0, START)

        def entered(table: str, key: int, moment: datetime, content: dict[str, Any]) -> None:
            nonlocal head
            link = seal(head, table, key, moment, canonical({"id": key, **content}))
            head = ChainHead(link.sequence, link.sha256)
            links.append(vars(link))

        self._equipment(entered)
        random = np.random.default_rng([self.seed, self.number])
        kinds = random.choice(len(KINDS), self.runs, p=SHARES)
        operators = random.integers(0, len(OPERATORS), self.runs)
        types = random.integers(0, len(TYPES), self.runs)
        values = 0.8 + 0.03 * random.normal(size=self.runs) + 0.005 * random.normal()
        failed = random.random(self.runs) < 0.01
        step = timedelta(days=365.25 * YEARS) / self.runs
        calibrations = 0
        for k in range(self.runs):
            started, key = BEGIN + k * step, k + 1
            calibrated = k % EVERY == 0
            kind = "calibrate-output" if calibrated else KINDS[kinds[k]]
            run_id = f"{started:%Y%m%dT%H%M%SZ}-{kind}-{key:04x}"
            manifest = hashlib.sha256(f"{self.seed}/{self.number}/{key}".encode()).hexdigest()
            entered(
                "runs",
                key,
                started,
                {
                    "run_id": run_id,
                    "kind": kind,
                    "started": started,
                    "side": "output",
                    "operator": OPERATORS[operators[k]],
                    "bench": self.name,
                    "simulated": True,
                    "profile_name": "rapid-in-situ",
                    "profile_sha256": "ab" * 32,
                    "software_version": "0.2.0",
                    "folder": f"runs/{run_id}",
                },
            )
            status = "failed" if failed[k] and not calibrated else "completed"
            ended = {
                "run_key": key,
                "finished": started + timedelta(minutes=8),
                "status": status,
                "reason": "",
                "manifest_sha256": manifest,
            }
            entered("run_ends", key, started, ended)
            results: Any = None
            if kind.startswith("test-"):
                results = self._tested(kind, key, TYPES[types[k]], float(values[k]))
            elif calibrated:
                calibrations += 1
                self._calibration(entered, calibrations, key, started)
            arrived.append(
                {
                    "run_id": run_id,
                    "manifest_sha256": manifest,
                    "url": f"{root}/runs/{run_id}",
                    "points_url": f"{root}/points/{run_id}.parquet" if calibrated else None,
                    "bytes": 150_000,
                    "left_out": ["edges.parquet"],
                    "facts": facts_of(results),
                }
            )
        return links, arrived

    def span_percent(self, started: datetime) -> float:
        """Return the transducer's span error on a day: drift of 0.02 % a year plus a constant."""
        own = np.random.default_rng([self.seed, self.number, 1]).normal()
        return 0.02 * (started - BEGIN).days / 365.25 + 0.05 * float(own)

    def write_points(self, store: FolderStore, root: str) -> int:
        """Write the bench's calibration points as Parquet files; return the number of files."""
        count = 0
        step = timedelta(days=365.25 * YEARS) / self.runs
        for k in range(0, self.runs, EVERY):
            started = BEGIN + k * step
            results = calibration_points(
                self.span_percent(started), self.serial, self.seed + 1000 * self.number + k
            )
            content = points_table(results, started)
            assert content is not None
            run_id = f"{started:%Y%m%dT%H%M%SZ}-calibrate-output-{k + 1:04x}"
            store.put(f"{root}/points/{run_id}.parquet", content)
            count += 1
        return count

    def _equipment(self, entered: Any) -> None:
        for key, (kind, serial) in enumerate(
            (("transducer", self.serial), ("counter", f"C-{self.serial}/oscillator")), start=1
        ):
            entered("equipment", key, BEGIN, {"kind": kind, "serial": serial, "recorded": BEGIN})
        entered(
            "equipment_descriptions",
            1,
            BEGIN,
            {
                "equipment_key": 1,
                "manufacturer": "simulated",
                "model": MODELS[0],
                "range_nm": 1000.0,
                "details": {"side": "output"},
                "recorded": BEGIN,
            },
        )

    def _calibration(self, entered: Any, number: int, run_key: int, started: datetime) -> None:
        span = self.span_percent(started)
        content = {
            "run_key": run_key,
            "transducer_key": 1,
            "counter_key": 2,
            "standard_key": None,
            "performed": started,
            "measured_by": "operator-1",
            "range_nm": 1000.0,
            "valid_low_nm": -1000.0,
            "valid_high_nm": 1000.0,
            "due": (started + timedelta(days=365)).date(),
            "points": 81,
            "data_sha256": "cd" * 32,
            "profile_name": "rapid-in-situ",
            "profile_sha256": "ab" * 32,
            "simulated": True,
            "files": {},
            "summary": {"span_error_percent": {"clockwise": span, "counter-clockwise": span}},
        }
        entered("calibrations", number, started, content)

    def _tested(self, kind: str, key: int, specimen_type: str, value: float) -> dict[str, Any]:
        quantity = "backlash" if kind == "test-hysteresis" else "no_load_torque"
        return {
            "test": kind.removeprefix("test-"),
            "reducer": {"name": specimen_type},
            "serial": f"S-{self.number:03}-{key:05}",
            "quantities": [
                {
                    "key": quantity,
                    "title": quantity.replace("_", " "),
                    "value": value,
                    "expanded_uncertainty": 0.02,
                    "unit": "arcmin" if quantity == "backlash" else "N·m",
                    "limit": "≤ 1",
                    "verdict": "pass",
                }
            ],
        }


def fleet(seed: int, benches: int, runs: int) -> Iterator[FleetBench]:
    """Yield benches that together have a number of runs."""
    for number in range(benches):
        yield FleetBench(seed, number, runs // benches)
