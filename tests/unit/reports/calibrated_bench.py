"""A data directory with one sealed, registered calibration, made without a bench."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, date, datetime
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from torquebench.calibration import CalibrationData, Profile, load_profile
from torquebench.campaign.fitting import store_model
from torquebench.compensation import CompensationModel, make_model
from torquebench.records import (
    CalibrationEntry,
    Equipment,
    Registry,
    Report,
    RunFolder,
    RunSummary,
    json_text,
)
from torquebench.records.signatures import Signature

RANGE_NM = 2000.0


@dataclass(frozen=True)
class CalibratedBench:
    registry: Registry
    run_id: str
    folder: Path
    calibration: CalibrationEntry


def points(profile: Profile, *, simulated: bool, temperature_drift_k: float) -> CalibrationData:
    """Return readings of a chain with a curved error and a loop, noise by a fixed seed."""
    steps = [step for step in profile.staircase(RANGE_NM) if step.recorded]
    generator = np.random.default_rng(20)
    standard = np.array([step.nominal_nm for step in steps])
    branch = np.array([step.branch for step in steps])
    share = standard / RANGE_NM
    error = -12.0 * share + 2.0 * share**2 + 0.4 * branch * (1.0 - share**2)
    reading = standard + error + generator.normal(0.0, 0.3, standard.size)
    return CalibrationData(
        reading_nm=reading,
        standard_nm=standard,
        series=np.array([step.series for step in steps]),
        branch=branch,
        range_nm=RANGE_NM,
        side="output",
        transducer_serial="T-7",
        counter_identity="C-1/oscillator-1",
        nominal_nm=standard,
        position_deg=np.array([step.position_deg for step in steps]),
        temperature_c=23.0 + np.linspace(0.0, temperature_drift_k, standard.size),
        true_torque_nm=standard if simulated else None,
        tared=True,
    )


def calibrated_bench(
    registry: Registry,
    *,
    simulated: bool = True,
    due: date | None = None,
    temperature_drift_k: float = 0.2,
    seal: bool = True,
    profile: Profile | None = None,
    operator: str = "M. Weber",
    ended_h: int = 10,
) -> CalibratedBench:
    chosen = profile or load_profile("rapid-in-situ").with_options(step_percent=20.0)
    data = points(chosen, simulated=simulated, temperature_drift_k=temperature_drift_k)
    metadata: Mapping[str, Any] = {
        "bench": {
            "calibrator": {
                "serial": "CAL-3",
                "model": "two reference transducers",
                "certificate_number": "PTB-12345",
                "certificate_date": "2026-01-15",
                "expanded_uncertainty_percent": 0.02,
            }
        },
        "simulated": simulated,
    }
    registry.add_equipment(Equipment("transducer", "T-7", "HBK", "T40B", RANGE_NM))
    if due is not None:
        registry.add_report(
            Report("calibrator", "CAL-3", "PTB-12345", "PTB", date(2026, 1, 15), due)
        )
    writer = RunFolder.create(registry.root / "runs", metadata, kind="calibrate-output")
    started = datetime(2026, 3, 2, 9, 30, tzinfo=UTC)
    registry.add_run(
        RunSummary(
            run_id=writer.run_id,
            kind="calibrate-output",
            started=started,
            simulated=simulated,
            software_version="0.1.0",
            folder=writer.path,
            side="output",
            operator=operator,
            bench="Bench 4",
            profile_name=chosen.name,
            profile_sha256=chosen.sha256,
        )
    )
    _documents(writer, data, chosen)
    writer.write_results({"data": data, "unsettled": 0, "standard_serial": "CAL-3"})
    if not seal:
        writer.close()
    else:
        registry.end_run(writer.seal(), started.replace(hour=ended_h))
    entry = registry.add_calibration(
        CalibrationEntry.of_points(
            data,
            performed=started,
            run_id=writer.run_id,
            standard_serial="CAL-3",
            profile_name=chosen.name,
            profile_sha256=chosen.sha256,
            measured_by=operator,
            signature=Signature.typed(),
        )
    )
    model = _fitted(data.features(2).tobytes(), data.standard_nm.tobytes())
    path = registry.root / "models" / f"{writer.run_id}.json"
    store_model(path, model, data, {})
    registry.activate(registry.add_model(entry, kind=model.kind, file=path).model_id)
    return CalibratedBench(registry, writer.run_id, writer.path, entry)


@cache
def _fitted(features: bytes, standard_nm: bytes) -> CompensationModel:
    """Return a fitted model; most tests have the same points."""
    X = np.frombuffer(features).reshape(-1, 2)
    model = make_model("polynomial", degree=2, range_nm=RANGE_NM)
    return model.fit(X, np.frombuffer(standard_nm))


def _documents(writer: Any, data: CalibrationData, profile: Profile) -> None:
    settings = json.loads(json_text(profile))
    writer.document("start", {"uid": "s", "time": 0.0, "profile": {"settings": settings}})
    keys = {name: {"units": "N·m"} for name in ("output-steady-reading_nm", "point-nominal_nm")}
    writer.document(
        "descriptor", {"uid": "d", "name": "points", "run_start": "s", "data_keys": keys}
    )
    for number, (reading, standard) in enumerate(
        zip(data.reading_nm, data.standard_nm, strict=True)
    ):
        values = {"output-steady-reading_nm": reading, "point-nominal_nm": standard}
        writer.document("event", {"descriptor": "d", "time": 1.0 + number, "data": values})
    writer.document("stop", {"uid": "e", "run_start": "s"})
    writer.samples({"time_s": np.arange(5) * 0.01, "output_torque_hz": np.full(5, 60000.0)})
