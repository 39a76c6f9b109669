"""What every operation keeps to: the same result and refusal by command, API and job."""

from __future__ import annotations

import asyncio
import json
import re
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import httpx
import pytest
from fastapi import FastAPI

from torquebench import cli
from torquebench.operations import find_operation, parameters
from torquebench.panel.api import create_api
from torquebench.panel.service import BenchService, JobView
from torquebench.reports.page import Facts, Page, Table
from torquebench.testing.accounts import PASSWORD, people_of

__all__ = ["Interfaces", "OperationContract"]


@dataclass
class Interfaces:
    """A bench behind the API, and a copy of its records for commands.

    Attributes
    ----------
    service : BenchService
    token : str
        Of its administrator.
    folder : pathlib.Path
        Records of the commands.
    command : callable
        Runs a command with its words; returns exit code and JSON.
    handed : dict of str to str
        Path of each file that was handed in, by its reference.
    """

    service: BenchService
    token: str
    folder: Path
    command: Callable[..., tuple[int, dict[str, Any]]] = lambda *_words: (0, {})
    handed: dict[str, str] = field(default_factory=dict)

    @cached_property
    def api(self) -> FastAPI:
        """The API, made before any job runs: FastAPI changes the process's warning filters."""
        return create_api(self.service)

    def http(self, method: str, path: str, body: Any = None) -> httpx.Response:
        """Ask the API."""

        async def asked() -> httpx.Response:
            transport = httpx.ASGITransport(self.api)
            own = {"Authorization": f"Bearer {self.token}"}
            async with httpx.AsyncClient(
                transport=transport, base_url="http://panel", headers=own
            ) as client:
                return await client.request(method, path, json=body)

        return asyncio.run(asked())

    def handed_in(self, file: str) -> str:
        """Hand in a file, and return its reference."""
        path = Path(file)
        reference = self.service.files.add(path.read_bytes(), path.name)
        self.handed[reference] = file
        return reference

    def over_http(self, name: str, values: dict[str, Any]) -> tuple[dict[str, Any], Any]:
        """Return what the API answers, and the job that it has started."""
        operation = find_operation(name)
        beside = {"password": PASSWORD} if operation.signed else {}
        files: dict[str, Any] = {}
        for parameter in parameters(operation.request):
            value = values.get(parameter.name)
            if value is None or parameter.kind != "path" or parameter.local:
                continue
            if parameter.output:
                several = isinstance(value, list)
                names = [Path(each).name for each in (value if several else [value])]
                files[parameter.name] = names if several else names[0]
            elif isinstance(value, list):
                files[parameter.name] = [self.handed_in(each) for each in value]
            else:
                files[parameter.name] = self.handed_in(value)
        answer = self.http("POST", f"/operations/{operation.key}", {**values, **files, **beside})
        if answer.status_code != 202:
            return answer.json(), None
        job = answer.json()
        deadline = time.monotonic() + 250.0
        while not job["finished"] or self.service.jobs.busy:
            assert time.monotonic() < deadline, job
            time.sleep(0.05)
            job = self.http("GET", f"/jobs/{job['job_id']}").json()
        return job["result"] or job["problem"], self.service.jobs.get(job["job_id"])

    def stored(self, job_id: str) -> JobView:
        """Return a job as it is stored for the time after a restart."""
        log, deadline = self.service.jobs.log, time.monotonic() + 60.0
        while job_id not in [each.job_id for each in log.newest(5)]:
            assert time.monotonic() < deadline, job_id
            time.sleep(0.05)
        return log.job(job_id)

    def by_command(self, name: str, values: dict[str, Any]) -> tuple[int, dict[str, Any]]:
        """Return exit code and JSON of the command."""
        operation = find_operation(name)
        words: list[str] = name.split()
        for parameter in parameters(operation.request):
            value = values.get(parameter.name)
            option = parameter.option
            if value is None or value is False:
                words += [f"--no-{option[2:]}"] * (value is False and parameter.default is True)
                continue
            several = value if isinstance(value, list) else [value]
            if parameter.numbered:
                several = [f"{parameter.numbered}-{each}" for each in several]
            if isinstance(value, dict):
                several = [f"{key}={each}" for key, each in value.items()]
            for each in several:
                words += [str(each)] if parameter.argument else [option] * (value is True) or [
                    option, str(each),
                ]  # fmt: skip
        if operation.signed or operation.role != "operator":
            words += ["--by", "Olga"]
        if operation.where != "files":
            words += ["--data", str(self.folder)]
        return self.command(*words, "--json")


def texts_of(page: Page) -> list[tuple[str, ...]]:
    """Return the texts of a page in their order, without figures."""
    texts: list[tuple[str, ...]] = []
    for section in page.sections:
        texts.append((section.heading, section.text))
        for block in section.blocks:
            if isinstance(block, Table):
                texts += [tuple(block.header), *map(tuple, block.rows)]
            elif isinstance(block, Facts):
                texts += map(tuple, block.items)
    return texts


def words_of(text: str) -> str:
    """Return a sentence without its figures and its people."""
    return re.sub(r"[-+]?\d[\d.]*(e[-+]\d+)?|Olga|Chief", "#", text)


class OperationContract:
    """Tests of an operation on the simulated bench; a subclass names it with its requests.

    Attributes
    ----------
    name : str
        Of the operation, as `torquebench.operations.OPERATIONS` has it.
    possible, refused : mapping of str to object
        A request that is done quickly, and one that is refused.

    Examples
    --------
    ::

        class TestCreep(OperationContract):
            name = "creep"
            possible = {"side": "output", "duration_s": 20.0, "interval_s": 10.0}
            refused = {"side": "middle"}
    """

    name: ClassVar[str]
    possible: ClassVar[Mapping[str, Any]]
    refused: ClassVar[Mapping[str, Any]]

    @pytest.fixture
    def possible_request(self) -> tuple[str, dict[str, Any]]:
        """Return an operation's name and a request that is done."""
        return self.name, dict(self.possible)

    @pytest.fixture
    def refused_request(self) -> tuple[str, dict[str, Any]]:
        """Return an operation's name and a request that is refused."""
        return self.name, dict(self.refused)

    @pytest.fixture(scope="class")
    @classmethod
    def recorded(cls, tmp_path_factory: pytest.TempPathFactory) -> Path:
        """Return a data folder whose copies the interfaces begin with; by default a new one."""
        folder = tmp_path_factory.mktemp("recorded") / "data"
        with BenchService.open(None, folder, fast=True):
            return folder

    @pytest.fixture(scope="class")
    @classmethod
    def benches(
        cls, recorded: Path, tmp_path_factory: pytest.TempPathFactory
    ) -> Iterator[Interfaces]:
        """Yield a bench behind the API and records for commands; all tests share them."""
        begun = tmp_path_factory.mktemp("interfaces")
        served, folder = (shutil.copytree(recorded, begun / name) for name in ("api", "command"))
        with people_of(served):
            pass
        with BenchService.open(None, served, fast=True) as service:
            token = service.people.sign_in("Chief", PASSWORD, "here")
            benches = Interfaces(service, token, folder)
            benches.http("GET", "/operations")  # the first request starts threads
            yield benches

    @pytest.fixture
    def interfaces(
        self,
        benches: Interfaces,
        monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str],
    ) -> Interfaces:
        """Return the benches with the command line beside them."""

        def command(*words: str) -> tuple[int, dict[str, Any]]:
            monkeypatch.setattr("sys.argv", ["torquebench", *words])
            with pytest.raises(SystemExit) as end:
                cli.main()
            return int(end.value.code or 0), json.loads(capsys.readouterr().out.splitlines()[-1])

        benches.command = command
        return benches

    def test_a_result_is_the_same(
        self, interfaces: Interfaces, possible_request: tuple[str, dict[str, Any]]
    ) -> None:
        """Compare the result of the job with that of the command."""
        name, request = possible_request
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
            stored = interfaces.stored(job.job_id).result
            assert stored is not None
            assert stored.plain() == job.result.plain()
            assert texts_of(stored.page()) == texts_of(job.result.page())

    def test_a_refusal_is_the_same(
        self, interfaces: Interfaces, refused_request: tuple[str, dict[str, Any]]
    ) -> None:
        """Compare the API's refusal with that of the command."""
        name, request = refused_request
        problem, _ = interfaces.over_http(name, request)
        said = problem.get("detail") or problem.get("found")
        assert said, problem
        for reference, file in interfaces.handed.items():
            said = said.replace(reference, file)
        code, printed = interfaces.by_command(name, request)
        assert code in (1, 2), printed
        found = printed["error"]["found"]
        assert found.removeprefix(f"{name}: ") == said.removeprefix("body: ").removeprefix(
            f"{name}: "
        )
