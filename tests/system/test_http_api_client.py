"""The client of the HTTP API against a running panel: sync and async, events, files, refusals."""

import asyncio
import contextlib
import io
import json
import os
import re
import subprocess
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import jsonschema  # type: ignore[import-untyped]
import pyarrow.parquet as pq
import pytest
from tests.system.panel_api import PASSWORD, SLOW, Server, administrator, person, program, serving

from torquebench.chain import load_chain
from torquebench.client import AsyncClient, Client, Event, JobError, RefusedError
from torquebench.operations import OPERATIONS

pytestmark = SLOW
MOST_REQUESTS = 15


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with serving(tmp_path_factory.mktemp("panel"), "--fast") as running:
        yield running


@pytest.fixture(scope="module")
def admin(server: Server) -> Iterator[httpx.Client]:
    with administrator(server) as signed_in:
        person(server, signed_in, "Max", "metrologist").close()
        yield signed_in


@contextlib.contextmanager
def as_max(server: Server) -> Iterator[Client]:
    with Client(server.url) as client:
        client.sign_in("Max", PASSWORD)
        try:
            yield client
        finally:
            client.request("DELETE", "/command")


@contextlib.contextmanager
def token_of(server: Server, admin: httpx.Client, name: str, role: str) -> Iterator[str]:
    with program(server, admin, name, role) as client:
        try:
            yield client.headers["Authorization"].removeprefix("Bearer ")
        finally:
            client.delete("/command")


@pytest.fixture
def max_(server: Server, admin: httpx.Client) -> Iterator[Client]:
    with as_max(server) as client:
        yield client


@pytest.fixture(scope="module")
def calibrated(server: Server, admin: httpx.Client) -> dict[str, Any]:
    """Calibrate, fit, verify, activate and read; return the results with the requests made."""
    asked: list[str] = []
    points: list[Event] = []
    with as_max(server) as bench:
        bench.http.event_hooks["request"].append(lambda request: asked.append(str(request.url)))

        def watch(event: Event) -> None:
            if event.name == "points":
                points.extend(event.data["points"])

        found = bench.run("calibrate", watch, side="output", step_percent=20.0)
        (module,) = found["modules"]
        number = module["calibration_id"]
        fitted = bench.records_fit_model(calibration=number, model="polynomial-3")
        fresh = {"groups": 2, "points": 6, "tolerance_percent_fs": 0.5}
        verified = bench.verification(side="output", calibration=number, **fresh)
        bench.records_use(model=module["models"][0]["model_id"], reason="best of all")
        reading = bench.reading("output_torque_nm")
    return {
        "requests": asked,
        "points": points,
        "reading": reading,
        "calibrate": found,
        "records-fit-model": fitted,
        "verification": verified,
    }


def test_from_calibration_to_reading_in_few_requests(calibrated: dict[str, Any]) -> None:
    assert len(calibrated["requests"]) <= MOST_REQUESTS, calibrated["requests"]
    assert abs(calibrated["reading"]) < 100.0
    assert [each["number"] for each in calibrated["points"]] == list(
        range(1, len(calibrated["points"]) + 1)
    )
    assert sum(each["stream"] == "points" for each in calibrated["points"]) == 20


def test_results_are_as_the_description_says(
    calibrated: dict[str, Any], admin: httpx.Client
) -> None:
    schemas = admin.get("/openapi.json").json()["components"]["schemas"]
    for name in ("calibrate", "records-fit-model", "verification"):
        schema = OPERATIONS[name.replace("records-", "records ")].result.__name__
        whole = {"components": {"schemas": schemas}, "$ref": f"#/components/schemas/{schema}"}
        jsonschema.Draft202012Validator(whole).validate(calibrated[name])
        assert set(calibrated[name]) == set(schemas[schema]["properties"]), name
    (module,) = calibrated["calibrate"]["modules"]
    numbers = {each["model_id"] for each in module["models"]}
    verified = calibrated["verification"]["models"]
    assert {each["model_id"] for each in verified} >= numbers | {None}


def test_models_and_data_are_downloaded(
    calibrated: dict[str, Any], max_: Client, tmp_path: Path
) -> None:
    number = calibrated["records-fit-model"]["modules"][0]["models"][-1]["model_id"]
    model = max_.download(f"/models/{number}/file", tmp_path / "model.json")
    assert load_chain(model).model.range_nm == 2000.0
    run_id = calibrated["calibrate"]["run_ids"][0]
    (written,) = max_.records_export_data(run=run_id, out="samples.parquet")["files"]
    samples = max_.download(f"/files/{written}", tmp_path / "samples.parquet")
    assert "output_torque_nm" in pq.read_table(samples).column_names
    with pytest.raises(RefusedError) as refused:
        max_.download("/models/99/file", tmp_path / "none.json")
    assert refused.value.status == 404
    assert sorted(path.name for path in tmp_path.iterdir()) == ["model.json", "samples.parquet"]


@pytest.mark.nightly
def test_exported_points_go_back_in_as_a_table(calibrated: dict[str, Any], max_: Client) -> None:
    run_id = calibrated["calibrate"]["run_ids"][0]
    (written,) = max_.records_export(run=run_id)["files"]
    exported = max_.http.get(f"/files/{written}").content
    with zipfile.ZipFile(io.BytesIO(exported)) as archive:
        table = archive.read(f"{run_id}/points.csv")
    serial = "A/12 #7?.. 扭矩"
    handed_in = max_.http.post(
        "/files",
        params={"name": "points.csv"},
        content=table,
        headers={"Content-Type": "application/octet-stream"},
    ).json()
    request = {
        "table": handed_in["file"],
        "profile": "rapid-in-situ",
        "reference_uncertainty": "0.02 of torque",
        "resolution_nm": 0.01,
        "performed": "2026-03-02T10:00:00Z",
    }
    seen = max_.run("evaluate-static", **request)
    assert (seen["points"], seen["simulated"], seen["range_nm"]) == (20, True, 2000.0)
    entered = max_.run(
        "records-import",
        **request,
        transducer=serial,
        indicator="DMP41",
        measured_by=max_.get("/people")[0],
        reference_serial="R/9",
    )
    found = max_.get("/calibrations", transducer=serial)
    assert [f"calibration-{each['calibration_id']}" for each in found] == [entered["calibration"]]
    drift = max_.records_drift(serial=serial)
    assert all(len(each["moments"]) == 1 for each in drift["charts"])


def test_what_is_wrong_is_refused_at_the_request(calibrated: dict[str, Any], max_: Client) -> None:
    number = calibrated["calibrate"]["modules"][0]["calibration_id"]
    jobs = max_.get("/jobs")
    for kind, request, status in (
        ("calibrate", {"side": "output", "models": ["guess"]}, 422),
        ("calibrate", {"side": "output", "profile": "nobodys"}, 422),
        ("records-fit-model", {"calibration": 999, "model": "hybrid"}, 409),
        ("records-fit-model", {"calibration": number, "model": "polynomial-31"}, 422),
        ("verification", {"side": "output", "calibration": 999}, 409),
        ("test", {"test": "hysteresis", "reducer": "nobodys"}, 422),
    ):
        with pytest.raises(RefusedError) as refused:
            max_.start(kind, **request)
        assert refused.value.status == status, (kind, refused.value)
    for path, query in (("/runs", {"limti": 3}), ("/bench", {"x": 1}), ("/events", {"job": 1})):
        with pytest.raises(RefusedError, match="unknown query parameters") as refused:
            max_.get(path, **query)
        assert refused.value.status == 422
    assert max_.get("/jobs") == jobs


def test_what_happens_is_told_to_whoever_listens(server: Server, admin: httpx.Client) -> None:
    told: list[Event] = []

    def over() -> bool:
        """Whether the job's end and the acknowledgement were told, in whichever order."""
        return any(each.name == "job" and each.data["finished"] for each in told) and any(
            each.name == "alarm" and each.data["acknowledged_by"] for each in told
        )

    async def listened(token: str) -> None:
        async with AsyncClient(server.url, token) as bench, AsyncClient(server.url, token) as other:
            ready = asyncio.Event()

            async def listen() -> None:
                async for event in bench.events():
                    told.append(event)
                    ready.set()
                    if over():
                        return

            job = await other.start("calibrate", side="output", step_percent=2.0)
            listening = asyncio.create_task(listen())
            await ready.wait()
            await other.stop("a noise")
            ended = await other.wait(job["job_id"])
            assert "a noise" in ended["problem"]["found"]
            (alarm,) = await other.get("/alarms", active=True)
            with pytest.raises(RefusedError, match="an alarm that was raised in the meantime"):
                await _acknowledged(other, ["not this one"])
            await _acknowledged(other, [alarm["alarm_id"]])
            await asyncio.wait_for(listening, 240.0)

    with token_of(server, admin, "listener", "operator") as token:
        asyncio.run(listened(token))
    names = [event.name for event in told]
    assert {"job", "alarm"} <= set(names)
    ends = [event.data for event in told if event.name == "job" and event.data["finished"]]
    assert [each["state"] for each in ends] == ["failed"]
    alarms = [event.data for event in told if event.name == "alarm"]
    assert len({each["alarm_id"] for each in alarms}) == 1
    assert alarms[-1]["acknowledged_by"]


async def _acknowledged(bench: AsyncClient, alarm_ids: list[str]) -> None:
    """Acknowledge once the bench is in its safe state."""
    for _ in range(2000):
        try:
            await bench.post("/alarms/acknowledge", alarm_ids=alarm_ids)
        except RefusedError as error:
            if "in the meantime" in error.found:
                raise
            await asyncio.sleep(0.1)
        else:
            return
    raise AssertionError("the bench doesn't become safe")


@pytest.mark.nightly
def test_the_documentations_example_runs(
    server: Server,
    admin: httpx.Client,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    page = Path(__file__).parents[2] / "docs" / "reference" / "http-api.md"
    code = re.search(r"```python\n(from torquebench\.client.*?)```", page.read_text("utf-8"), re.S)
    assert code is not None
    monkeypatch.chdir(tmp_path)
    with token_of(server, admin, "reader", "metrologist") as token:
        exec(code[1].replace("http://127.0.0.1:8080", server.url), {"token": token})
    verdict, reading = capsys.readouterr().out.split()
    assert verdict in ("pass", "conditionalPass", "conditionalFail", "fail")
    assert abs(float(reading)) < 100.0
    assert json.loads(Path("model.json").read_text())["format"] == "torquebench-model"


def test_the_documentations_requests_by_curl_are_answered(
    server: Server, admin: httpx.Client
) -> None:
    page = Path(__file__).parents[2] / "docs" / "reference" / "http-api.md"
    requests = re.findall(r"```sh\n(curl .*?)```", page.read_text("utf-8"), re.S)
    assert requests
    session = admin.headers["Authorization"].removeprefix("Bearer ")
    for request in requests:
        answered = subprocess.run(
            ["sh", "-ec", request],
            env={**os.environ, "URL": server.url, "SESSION": session},
            capture_output=True,
            text=True,
            check=True,
            timeout=240,
        )
        assert "token" in json.loads(answered.stdout), answered.stdout
    named = [each["name"] for each in admin.get("/clients").json()]
    assert "plant" in named


def test_a_job_that_fails_is_an_error_with_its_reason(max_: Client) -> None:
    def stop(event: Event) -> None:
        if event.name == "points":
            max_.stop("a noise again")

    with pytest.raises(JobError, match="a noise again") as failed:
        max_.run("calibrate", stop, side="output", step_percent=2.0)
    assert failed.value.job["state"] == "failed"
    for _ in range(2000):
        try:
            max_.request("POST", "/alarms/acknowledge")
            break
        except RefusedError:
            time.sleep(0.1)
    assert max_.get("/alarms", active=True) == []


def test_a_stream_of_events_ends_with_its_token(server: Server, admin: httpx.Client) -> None:
    spare = program(server, admin, "spare", "operator")
    number = next(each for each in admin.get("/clients").json() if each["name"] == "spare")
    with spare.stream("GET", "/events") as answer:
        assert answer.headers["content-type"].startswith("text/event-stream")
        assert admin.delete(f"/clients/{number['client_id']}").status_code == 200
        assert all(json.loads(line[6:]) for line in answer.iter_lines() if line[:6] == "data: ")
    spare.close()
