"""Every operation by command, API and job: the same result, and the same refusal."""

import asyncio
import json
import re
import shutil
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest
from tests.accounts import PASSWORD, people_of

from torquebench import cli
from torquebench.operations import OPERATIONS, find_operation, parameters
from torquebench.panel.api import create_api
from torquebench.panel.service import Actor, BenchService

CHIEF = Actor("Chief", "administrator", "chief")
ANA = Actor("ana", "metrologist", "client-1", "client")
QUICK = {"side": "input", "step_percent": 50.0, "models": ["polynomial-2"]}
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


@dataclass
class Interfaces:
    """A bench behind the API, and a copy of its records for commands."""

    service: BenchService
    token: str
    folder: Path
    runs: dict[str, str]
    command: Callable[..., tuple[int, dict[str, Any]]]

    def ask(self, method: str, path: str, body: Any = None) -> httpx.Response:
        """Ask the API."""

        async def asked() -> httpx.Response:
            transport = httpx.ASGITransport(create_api(self.service))
            own = {"Authorization": f"Bearer {self.token}"}
            async with httpx.AsyncClient(
                transport=transport, base_url="http://panel", headers=own
            ) as client:
                return await client.request(method, path, json=body)

        return asyncio.run(asked())

    def request(self, values: dict[str, Any]) -> dict[str, Any]:
        """Return a request with the names of the runs."""
        return {
            name: [self.runs.get(each, each) for each in value] if name == "runs" else value
            for name, value in values.items()
        }

    def over_http(self, name: str, values: dict[str, Any]) -> tuple[dict[str, Any], Any]:
        """Return what the API answers, and the job that it has started."""
        operation = find_operation(name)
        beside = {"password": PASSWORD} if operation.signed else {}
        answer = self.ask("POST", f"/operations/{operation.key}", {**values, **beside})
        if answer.status_code != 202:
            return answer.json(), None
        job = answer.json()
        deadline = time.monotonic() + 250.0
        while not job["finished"] or self.service.jobs.busy:
            assert time.monotonic() < deadline, job
            time.sleep(0.05)
            job = self.ask("GET", f"/jobs/{job['job_id']}").json()
        return job["result"] or job["problem"], self.service.jobs.get(job["job_id"])

    def by_command(self, name: str, values: dict[str, Any]) -> tuple[int, dict[str, Any]]:
        """Return exit code and JSON of the command."""
        operation = find_operation(name)
        words: list[str] = name.split()
        for parameter in parameters(operation.request):
            value = values.get(parameter.name)
            option = parameter.option
            if value is None or value is False:
                continue
            several = value if isinstance(value, list) else [value]
            if isinstance(value, list) and option.endswith("s"):
                option = option[:-1]
            if parameter.numbered:
                several = [f"{parameter.numbered}-{each}" for each in several]
            for each in several:
                words += [str(each)] if parameter.argument else [option] * (value is True) or [
                    option, str(each),
                ]  # fmt: skip
        if operation.signed or operation.role != "operator":
            words += ["--by", "Olga"]
        return self.command(*words, "--json", "--data", str(self.folder))


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
    (folder / "laboratory.toml").write_text('[policy]\nunreviewed = "state"\n', encoding="utf-8")
    return folder


@pytest.fixture
def interfaces(
    measured: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> Iterator[Interfaces]:
    served, folder = (shutil.copytree(measured, tmp_path / name) for name in ("api", "command"))
    with people_of(served):
        pass

    def command(*words: str) -> tuple[int, dict[str, Any]]:
        monkeypatch.setattr("sys.argv", ["torquebench", *words])
        with pytest.raises(SystemExit) as end:
            cli.main()
        return int(end.value.code or 0), json.loads(capsys.readouterr().out.splitlines()[-1])

    with BenchService.open(None, served, fast=True) as service:
        runs = service.station.registry.runs()
        names = [run.run_id for run in runs if run.kind.startswith("test-")]
        token = service.people.sign_in("Chief", PASSWORD, "here")
        yield Interfaces(service, token, folder, dict(zip(("A2", "A1"), names, strict=True)),
                         command)  # fmt: skip


def words_of(text: str) -> str:
    """Return a sentence without its figures and its people."""
    return re.sub(r"[-+]?\d[\d.]*(e[-+]\d+)?|Olga|Chief", "#", text)


@pytest.mark.parametrize("name", POSSIBLE)
def test_a_result_is_the_same(interfaces: Interfaces, name: str) -> None:
    request = interfaces.request(POSSIBLE[name])
    result, job = interfaces.over_http(name, request)
    code, printed = interfaces.by_command(name, request)
    assert printed["error"] is None, printed
    assert "headline" in result, result
    answer = printed["answer"]
    assert set(answer) == set(result)
    assert code == (job.result.failed if job is not None else 0)
    for key in ("verdict", "simulated"):
        assert answer[key] == result[key]
    assert words_of(answer["headline"]) == words_of(result["headline"])
    if job is not None:
        assert job.result.plain().keys() == result.keys()


@pytest.mark.parametrize("name", REFUSED)
def test_a_refusal_is_the_same(interfaces: Interfaces, name: str) -> None:
    request = REFUSED[name]
    problem, _ = interfaces.over_http(name, request)
    said = problem.get("detail") or problem.get("found")
    assert said, problem
    code, printed = interfaces.by_command(name, request)
    assert code in (1, 2), printed
    found = printed["error"]["found"]
    assert found.removeprefix(f"{name}: ") == said.removeprefix("body: ").removeprefix(f"{name}: ")


def test_every_operation_is_compared() -> None:
    assert set(REFUSED) == {name for name, each in OPERATIONS.items() if each.served}
