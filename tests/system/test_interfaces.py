"""Every operation by command, API and job: the same result, and the same refusal."""

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tests.support.draws import nightly
from tests.unit.chain.test_lubrication import CHAIN as CHAIN_EFFECTS
from tests.unit.chain.test_lubrication import lubricated
from tests.unit.dynamics.simulated_chain import SimulatedChain, sines, steps

from torquebench.chain import MeasuringChain
from torquebench.compensation import load_model, save_model
from torquebench.operations import OPERATIONS, PackagedLibrary, Place, parameters
from torquebench.panel.service import Actor, BenchService
from torquebench.progress import NO_PROGRESS
from torquebench.testing.operations import Interfaces, OperationContract

CHIEF = Actor("Chief", "administrator", "chief")
ANA = Actor("ana", "metrologist", "client-1", "client")
QUICK = {"side": "input", "step_percent": 50.0, "models": ["polynomial-2"]}
EXAMPLES = Path(__file__).parents[2] / "examples"
FIELD = Path(__file__).parents[1] / "unit" / "reducers" / "field"
READINGS = str(EXAMPLES / "readings-output.csv")
STATIC = {
    "table": str(EXAMPLES / "calibration-output.csv"),
    "resolution_nm": 0.01,
    "reference_uncertainty": "0.02 of torque",
}
RUN = "run of A1"
"""A run of the records."""
FRICTION = "friction.csv"
MADE = ("model.json", "chain.json", FRICTION, "empty.csv", "steps.csv", "sines.csv")
"""Files that are made first: models without and with effects, and tables."""
MODEL, CHAIN = MADE[:2]
TRANSDUCER = {"kind": "transducer", "serial": "SIM-T50"}
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
    "evaluate hysteresis": {"data": [str(EXAMPLES / "loops-rv-40e.csv")], "reducer": "rv-40e"},
    "evaluate friction": {"data": [FRICTION]},
    "evaluate no-load": {"data": [FRICTION]},
    "evaluate breakaway": {
        "data": [str(FIELD / "breakaway_staircase.csv")],
        "kind": "back-driving",
    },
    "bench new": {"out": "bench.toml", "drives": "modbus"},
    "evaluate transmission-error": {
        "data": [str(FIELD / "te_large_error_one_turn.csv")],
        "ratio": 10.0,
        "highest_order": 1.0,
    },
    "evaluate efficiency": {"data": [str(FIELD / "efficiency_chain.csv")], "ratio": 10.0},
    "evaluate dynamics": {"runs": ["steps.csv", "sines.csv"], "out": "filter.json"},
    "evaluate lubrication": {"run": "empty.csv", "model": CHAIN, "out": "renewed.json"},
    "doctor": {},
    "mechanics additional-torque": {"design": "input"},
    "papers": {"tables": [STATIC["table"]], "study": False, "out": ["papers.html", "papers.pdf"]},
    "mechanics sections": {},
    "records list": {"kind": "calibrations"},
    "records show": {"name": "calibration-1"},
    "records audit": {"alarms": True},
    "records verify": {},
    "records amend": {
        "record": "calibration-2",
        "changes": {"profile_name": "steps"},
        "reason": "a slip",
    },
    "records export": {"run": RUN, "out": "run.zip"},
    "records export-data": {"run": RUN, "out": "samples.csv"},
    "records equipment": {"serial": "SIM-T50"},
    "records add-equipment": {"kind": "reducer", "serial": "R-1", "details": {"ratio": "80"}},
    "records add-certificate": {
        **TRANSDUCER,
        "number": "K-1",
        "uncertainty_percent": 0.05,
        "due": "2099-01-31",
    },
    "records fit-part": {
        **TRANSDUCER,
        "into_kind": "bench",
        "into_serial": "Simulated reducer bench",
        "role": "spare",
    },
    "records adjust": {"kind": "encoder", "serial": "SIM-ENC-IN", "what": "cleaned"},
    "records import": {
        **STATIC,
        "profile": "check",
        "measured_by": "Chief",
        "reference_serial": "R-9",
    },
    "records compare": {"first": "calibration-1", "second": "calibration-2"},
    "records drift": {"serial": "SIM-T50"},
    "records due": {"within_days": 3650},
    "records laboratory": {
        "name": "Lab “K”",
        "city": "Ulm",
        "country": "DE",
        "customer_name": "A & B",
        "customer_city": "北京",
        "customer_country": "CN",
    },
    "records compare-models": {"calibration": 1},
    "records fit-model": {"calibration": 1, "model": "polynomial-3"},
    "records use": {"model": 1, "reason": "checked"},
    "records deactivate": {"side": "input"},
    "records review": {"record": "calibration-1", "remark": "as expected"},
    "records compare-tests": {"runs": [RUN, "run of A2"]},
}
"""Requests that are done."""
OF_INTERRUPTED_RUNS = {"resume", "records finish", "records discard"}
BY_DAY = {
    *("zero", "calibrate", "check", "certificate", "fit", "apply", "export", "evaluate static"),
    *("evaluate hysteresis", "bench new", "doctor", "mechanics sections", "records list"),
    *("records show", "records audit", "records amend", "records export", "records equipment"),
    *("records import", "records use", "records deactivate", "records review"),
}
"""One of each kind; the others are compared nightly, their refusals by day."""
LONG = {"turn", "in-place", "papers-tables", "mechanics supports"}
"""They take long; `tests/system` runs them."""
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
    **{
        f"evaluate {name}": {"data": [READINGS]}
        for name in ("hysteresis", "friction", "no-load", "transmission-error", "efficiency")
    },
    "evaluate breakaway": {"data": [READINGS], "kind": "sideways"},
    "evaluate dynamics": {"runs": [READINGS], "out": "filter.json"},
    "evaluate lubrication": {"run": READINGS, "model": READINGS, "out": "chain.json"},
    "bench new": {"out": "bench.toml", "counter": "hbm"},
    "in-place": {"side": "middle"},
    "papers-tables": {"reducer": "rv-40e"},
    "mechanics additional-torque": {"design": "none"},
    "papers": {"tables": [READINGS]},
    "mechanics supports": {"arm_height": 0.9},
    "records list": {"kind": "nonsense"},
    "records show": {"name": "calibration-99"},
    "records audit": {"run": "none"},
    "records verify": {"end": ["none"]},
    "records amend": {"record": "lamp-1", "changes": {"profile_name": "x"}, "reason": "a slip"},
    "records export": {"run": "none", "out": "run.zip"},
    "records export-data": {"run": RUN, "out": "samples.csv", "format": "hdf5"},
    "records equipment": {"serial": "X-1"},
    "records add-equipment": {"kind": "lamp", "serial": "R-1"},
    "records add-certificate": {
        "kind": "drive",
        "serial": "X-1",
        "number": "K-1",
        "uncertainty_percent": 0.05,
        "due": "2099-01-31",
    },
    "records fit-part": {**TRANSDUCER, "into_kind": "bench", "into_serial": "X", "role": "spare"},
    "records adjust": {"kind": "drive", "serial": "X-1", "what": "cleaned"},
    "records import": {**STATIC, "performed": "2099-01-01"},
    "records compare": {"first": "calibration-1", "second": "calibration-99"},
    "records drift": {"serial": "X-1"},
    "records due": {"within_days": 40_000},
    "records laboratory": {"name": "Lab", "city": "Ulm", "country": "Germany"},
    "records compare-models": {"calibration": 99},
    "records fit-model": {"calibration": 1, "model": "magic"},
    "records use": {"model": 99},
    "records deactivate": {"side": "middle"},
    "records compare-tests": {"runs": ["none", "nothing"]},
    "records review": {"record": "calibration-99"},
    "records finish": {"run_id": "none"},
    "records discard": {"run_id": "none", "reason": "a trial"},
}


def _write(path: Path, names: str, *columns: Any) -> None:
    lines = (",".join(f"{value:.9g}" for value in row) for row in zip(*columns, strict=True))
    path.write_text("\n".join([names, *lines]) + "\n", encoding="utf-8")


def _make_files(folder: Path) -> None:
    """Fit a small model, add effects to a copy of it, and write tables."""
    fit = OPERATIONS["fit"]
    request = {**POSSIBLE["fit"], "out": folder / MODEL}
    fit.run(Place("", PackagedLibrary()), fit.request.model_validate(request), NO_PROGRESS)
    stored = load_model(folder / MODEL)
    effects = MeasuringChain.of(stored).with_effects(CHAIN_EFFECTS).specification()
    provenance = replace(stored.provenance, effects=effects)
    save_model(folder / CHAIN, replace(stored, provenance=provenance))
    run = lubricated(0.8)
    columns = (run.time_s, run.reading_nm, run.speed_rpm, run.temperature_c)
    _write(folder / "empty.csv", "time_s,reading_nm,speed_rpm,temperature_c", *columns)
    chain = SimulatedChain(noise_nm=0.005)
    for name, torque, duration_s in (("steps", steps, 0.09), ("sines", sines, 0.25)):
        names = "time_s,reading_nm,standard_nm"
        _write(folder / f"{name}.csv", names, *chain.run(torque, duration_s))
    speeds = [sign * speed for sign in (1, -1) for speed in (100.0, 300.0, 600.0, 1000.0)] * 2
    torques = [0.2 * (1 if speed > 0 else -1) + 1e-4 * speed for speed in speeds]
    repeats = [1] * 8 + [2] * 8
    _write(folder / FRICTION, "speed_rpm,torque_nm,repeat", speeds, torques, repeats)


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
            ended = service.jobs.get(job.job_id)
            assert ended.state == "done", ended.problem
    (folder / "laboratory.toml").write_text(
        '[policy]\nunreviewed = "state"\n[laboratory]\nname = "Lab"\n'
        'city = "Ulm"\ncountry = "DE"\npeople = ["Chief", "Olga"]\n',
        encoding="utf-8",
    )
    _make_files(folder)
    return folder


def _placed(name: str, value: Any, interfaces: Interfaces, folder: Path) -> Any:
    """Return a request's value with paths, and the names of runs."""
    if isinstance(value, list):
        return [_placed(name, each, interfaces, folder) for each in value]
    if name == "out":
        return str(folder / value)
    if value in MADE:
        return str(interfaces.folder / value)
    if str(value).startswith("run of "):
        runs = interfaces.service.station.registry.runs()
        runs = [run.run_id for run in runs if run.kind.startswith("test-")]
        return runs[-1 if value == RUN else -2]
    return value


class TestOperations(OperationContract):
    @pytest.fixture(params=[name if name in BY_DAY else nightly(name) for name in POSSIBLE])
    def possible_request(
        self, request: pytest.FixtureRequest, interfaces: Interfaces, tmp_path: Path
    ) -> Iterator[tuple[str, dict[str, Any]]]:
        values = POSSIBLE[request.param].items()
        yield request.param, {k: _placed(k, each, interfaces, tmp_path) for k, each in values}
        if request.param == "records deactivate":  # tests of modules share these benches
            used = POSSIBLE["records use"]
            interfaces.over_http("records use", used)
            interfaces.by_command("records use", used)

    @pytest.fixture(params=REFUSED)
    def refused_request(
        self, request: pytest.FixtureRequest, interfaces: Interfaces, tmp_path: Path
    ) -> tuple[str, dict[str, Any]]:
        values = REFUSED[request.param].items()
        return request.param, {k: _placed(k, each, interfaces, tmp_path) for k, each in values}

    @pytest.fixture(scope="class")
    @classmethod
    def recorded(cls, measured: Path) -> Path:
        return measured


def test_every_operation_is_compared() -> None:
    served = {name for name, each in OPERATIONS.items() if each.served}
    assert set(POSSIBLE) == served - OF_INTERRUPTED_RUNS - LONG
    without_fields = {
        name for name in served if all(each.local for each in parameters(OPERATIONS[name].request))
    }
    assert set(REFUSED) == served - without_fields
