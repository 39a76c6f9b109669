"""Every operation by command, API and job: the same result, and the same refusal."""

import time
from pathlib import Path
from typing import Any

import pytest

from torquebench.operations import OPERATIONS, PackagedLibrary, Place
from torquebench.panel.service import Actor, BenchService
from torquebench.progress import NO_PROGRESS
from torquebench.testing.operations import Interfaces, OperationContract

CHIEF = Actor("Chief", "administrator", "chief")
ANA = Actor("ana", "metrologist", "client-1", "client")
QUICK = {"side": "input", "step_percent": 50.0, "models": ["polynomial-2"]}
FOREIGN = ("hysteresis", "friction", "no-load", "transmission-error", "efficiency")
EXAMPLES = Path(__file__).parents[3] / "examples"
READINGS = str(EXAMPLES / "readings-output.csv")
STATIC = {
    "table": str(EXAMPLES / "calibration-output.csv"),
    "resolution_nm": 0.01,
    "reference_uncertainty": "0.02 of torque",
}
MODEL = "model.json"
"""A model file that is fitted first."""
POSSIBLE: dict[str, dict[str, Any]] = {
    "zero": {},
    "calibrate": QUICK,
    "check": {"side": "input", "tolerance_percent_fs": 5.0},
    "verification": {
        "side": "input",
        "groups": 2,
        "points": 6,
        "seed": 1,
        "tolerance_percent_fs": 5.0,
    },
    "test": {"test": "starting", "short": True},
    "standard-reducer": {"repeats": 2},
    "record": {"name": "noise", "duration_s": 1.0},
    "certificate": {"calibration": "calibration-1", "languages": ["de"]},
    "fit": {"tables": [STATIC["table"]], "model": "polynomial-2", "out": "fitted.json"},
    "apply": {"model": MODEL, "readings": READINGS, "out": "torque.csv"},
    "verify": {"model": MODEL, "table": str(EXAMPLES / "verification-output.csv")},
    "export": {"model": MODEL, "out": "table.h"},
    "budget": {"model": MODEL, "readings_nm": [100.0, -50.0], "reference": "0.02 of torque"},
    "evaluate static": STATIC,
    "evaluate hysteresis": {
        "data": [str(EXAMPLES / "loops-rv-40e.csv")],
        "reducer": "rv-40e",
    },
    "bench new": {"out": "bench.toml", "drives": "modbus"},
    "records import": {
        **STATIC,
        "profile": "check",
        "measured_by": "Chief",
        "reference_serial": "R-9",
    },
    "records compare": {"first": "calibration-1", "second": "calibration-2"},
    "records drift": {"serial": "SIM-T50"},
    "records compare-models": {"calibration": 1},
    "records fit-model": {"calibration": 1, "model": "polynomial-3"},
    "records use": {"model": 1, "reason": "checked"},
    "records deactivate": {"side": "input"},
    "records review": {"record": "calibration-1", "remark": "as expected"},
    "records compare-tests": {"runs": ["A1", "A2"]},
}
"""Requests that are done; runs are named by their specimens here."""
REFUSED: dict[str, dict[str, Any]] = {
    "zero": {"sides": ["middle"]},
    "calibrate": {"side": "both", "up_to_nm": 40.0},
    "resume": {"run_id": "none"},
    "check": {"side": "middle"},
    "verification": {"side": "input", "models": [99]},
    "test": {"test": "starting", "short": True, "repeats": 5},
    "standard-reducer": {"reducer": "rv-40e"},
    "record": {"name": ""},
    "turn": {"side": "input", "profile": "none"},
    "certificate": {"calibration": "calibration-99"},
    "fit": {"tables": [READINGS]},
    "apply": {"model": READINGS, "readings": READINGS, "out": "torque.csv"},
    "verify": {"model": MODEL, "table": READINGS},
    "export": {"model": READINGS, "out": "table.h"},
    "budget": {"model": MODEL, "readings_nm": [1e9]},
    "evaluate static": {**STATIC, "reference_uncertainty": "20 of torque"},
    **{f"evaluate {name}": {"data": [READINGS]} for name in FOREIGN},
    "evaluate breakaway": {"data": [READINGS], "kind": "sideways"},
    "evaluate dynamics": {"runs": [READINGS], "out": "filter.json"},
    "evaluate lubrication": {"run": READINGS, "model": READINGS, "out": "chain.json"},
    "bench new": {"out": "bench.toml", "counter": "hbm"},
    "records import": {**STATIC, "performed": "2099-01-01"},
    "records compare": {"first": "calibration-1", "second": "calibration-99"},
    "records drift": {"serial": "X-1"},
    "records compare-models": {"calibration": 99},
    "records fit-model": {"calibration": 1, "model": "magic"},
    "records use": {"model": 99},
    "records deactivate": {"side": "middle"},
    "records compare-tests": {"runs": ["none", "nothing"]},
    "records review": {"record": "calibration-99"},
    "records finish": {"run_id": "none"},
    "records discard": {"run_id": "none", "reason": "a trial"},
}


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("measured") / "data"
    with BenchService.open(None, folder, fast=True) as service:
        service.clients.add(CHIEF, ANA.name, ANA.role)
        for name, request in (
            ("calibrate", QUICK),
            ("calibrate", QUICK),
            ("test", {**POSSIBLE["test"], "serial": "A1", "subtract_twist": False}),
            ("test", {**POSSIBLE["test"], "serial": "A2", "subtract_twist": False}),
        ):
            job = service.jobs.start(ANA, name, request)
            while service.jobs.busy:
                time.sleep(0.05)
            assert service.jobs.get(job.job_id).state == "done"
    (folder / "laboratory.toml").write_text(
        '[policy]\nunreviewed = "state"\n[laboratory]\nname = "Lab"\n'
        'city = "Ulm"\ncountry = "DE"\npeople = ["Chief", "Olga"]\n',
        encoding="utf-8",
    )
    fit = OPERATIONS["fit"]
    request = {**POSSIBLE["fit"], "out": folder / MODEL}
    place = Place("", PackagedLibrary())
    fit.run(place, fit.request.model_validate(request), NO_PROGRESS)
    return folder


def _placed(values: dict[str, Any], records: Path, folder: Path) -> dict[str, Any]:
    """Return a request with the model's path, and a path of the file to be written."""
    if values.get("model") == MODEL:
        values = {**values, "model": str(records / MODEL)}
    return {**values, "out": str(folder / values["out"])} if "out" in values else values


class TestOperations(OperationContract):
    @pytest.fixture(params=POSSIBLE)
    def possible_request(
        self, request: pytest.FixtureRequest, interfaces: Interfaces, tmp_path: Path
    ) -> tuple[str, dict[str, Any]]:
        runs = interfaces.service.station.registry.runs()
        names = [run.run_id for run in runs if run.kind.startswith("test-")]
        specimens = dict(zip(("A2", "A1"), names, strict=True))
        values = POSSIBLE[request.param]
        return request.param, {
            name: [specimens.get(each, each) for each in value] if name == "runs" else value
            for name, value in _placed(values, interfaces.folder, tmp_path).items()
        }

    @pytest.fixture(params=REFUSED)
    def refused_request(
        self, request: pytest.FixtureRequest, interfaces: Interfaces, tmp_path: Path
    ) -> tuple[str, dict[str, Any]]:
        return request.param, _placed(REFUSED[request.param], interfaces.folder, tmp_path)

    @pytest.fixture
    def recorded(self, measured: Path) -> Path:
        return measured


def test_every_operation_is_compared() -> None:
    assert set(REFUSED) == {name for name, each in OPERATIONS.items() if each.served}
