"""Benches of a plant for tests: a data directory with sealed runs, made without measuring."""

from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from torquebench.calibration import CalibrationData
from torquebench.records import CalibrationEntry, Equipment, Registry, RunFolder, RunSummary

START = datetime(2026, 1, 5, 6, 0, tzinfo=UTC)


def budget(value: float, u: float, unit: str) -> dict[str, Any]:
    return {"value": value, "unit": unit, "standard_uncertainty": u}


def add_run(
    registry: Registry,
    run_id: str,
    kind: str,
    results: Any,
    *,
    hours: float = 0.0,
    status: Any = "completed",
    simulated: bool = True,
    metadata: Mapping[str, Any] | None = None,
    files: Mapping[str, bytes] | None = None,
) -> RunFolder:
    """Write, seal and register one run with results, and further metadata and files."""
    started = START + timedelta(hours=hours)
    folder = RunFolder.create(
        registry.root / "runs",
        {**(metadata or {}), "simulated": simulated},
        kind=kind,
        run_id=run_id,
    )
    folder.samples({"time_s": [0.0, 1.0], "torque_nm": [1.0, 2.0]})
    registry.add_run(
        RunSummary(
            run_id=run_id,
            kind=kind,
            started=started,
            simulated=simulated,
            software_version="0.1.0",
            folder=registry.root / "runs" / run_id,
            operator="Ana",
            bench="Bench",
        )
    )
    folder.write_files(files or {})
    folder.write_results(results)
    sealed = folder.seal(status)
    registry.end_run(sealed, started + timedelta(minutes=5))
    return sealed


def backlash_results(
    serial: str, value: float = 0.8, *, kind: str = "RV-40E", quantity: str = "backlash"
) -> dict[str, Any]:
    """Return the results of a reducer test with one quantity."""
    return {
        "test": "hysteresis",
        "short": False,
        "reducer": {"name": kind},
        "serial": serial,
        "quantities": [
            {
                "key": quantity,
                "title": "backlash",
                "value": value,
                "expanded_uncertainty": 0.05,
                "unit": "arcmin",
                "limit": "",
                "verdict": "",
            }
        ],
    }


def calibration_results(serial: str = "T-1", span_percent: float = 0.1) -> dict[str, Any]:
    """Return the results of a calibration with a given error of its span."""
    standard = [0.0, 250.0, 500.0, 1000.0, 500.0, 250.0, 0.0, -500.0, -1000.0, -500.0, 0.0]
    branch = [1, 1, 1, 1, -1, -1, -1, 1, 1, -1, -1]
    return {
        "data": {
            "reading_nm": [value * (1.0 + span_percent / 100.0) for value in standard],
            "standard_nm": standard,
            "series": [1] * len(standard),
            "branch": branch,
            "range_nm": 1000.0,
            "side": "output",
            "transducer_serial": serial,
            "counter_identity": "C-1/oscillator",
            "simulated": True,
        },
        "unsettled": 0,
        "standard_serial": "CAL-1",
        "placement": None,
    }


def add_calibration(
    registry: Registry, run_id: str, serial: str, span_percent: float, *, days: float
) -> None:
    """Measure and register a calibration with a given error of its span."""
    results = calibration_results(serial, span_percent)
    add_run(registry, run_id, "calibrate-output", results, hours=24.0 * days)
    registry.add_calibration(
        CalibrationEntry.of_points(
            CalibrationData(**results["data"]),
            performed=START + timedelta(days=days),
            run_id=run_id,
            due=(START + timedelta(days=days + 365)).date(),
        )
    )


def filled(data: Path, tests: int = 3, *, prefix: str = "S") -> Path:
    """Make a data directory with a few tests and a calibration."""
    with Registry.open(data) as registry:
        registry.add_equipment(
            Equipment("transducer", "T-1", "HBM", "T10F", 1000.0, {"side": "output"})
        )
        for number in range(tests):
            serial = f"{prefix}-{number + 1}"
            registry.add_equipment(Equipment("reducer", serial, details={"batch": f"B{number}"}))
            run_id = f"20260105T0{number}0000Z-test-hysteresis-000{number}"
            results = backlash_results(serial, 0.8 + 0.01 * number)
            add_run(registry, run_id, "test-hysteresis", results, hours=number)
        run_id = "20260105T090000Z-calibrate-output-0009"
        add_run(registry, run_id, "calibrate-output", calibration_results(), hours=9)
    return data
