import hashlib
import json
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import httpx
import pytest
from tests.system.panel_api import PASSWORD, SLOW, Server, administrator, person, program, serving
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

pytestmark = SLOW


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with serving(tmp_path_factory.mktemp("panel"), "--fast") as running:
        yield running


@pytest.fixture(scope="module")
def admin(server: Server) -> Iterator[httpx.Client]:
    with administrator(server) as signed_in:
        yield signed_in


@pytest.fixture(scope="module")
def people(server: Server, admin: httpx.Client) -> Iterator[dict[str, httpx.Client]]:
    found = {
        "Olga": person(server, admin, "Olga", "operator"),
        "Max": person(server, admin, "Max", "metrologist"),
        "plant": program(server, admin, "plant", "operator"),
    }
    yield found
    for each in found.values():
        each.close()


@pytest.fixture(autouse=True)
def _nobody_commands(admin: httpx.Client) -> Iterator[None]:
    yield
    _wait(lambda: not admin.get("/bench").json()["job_id"])
    _wait(lambda: admin.post("/alarms/acknowledge").status_code == 200)
    admin.post("/command", json={"force": True})
    admin.delete("/command")


def _wait(condition: Callable[[], Any]) -> Any:
    deadline = time.monotonic() + 300.0
    while not (found := condition()):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    return found


def _done(client: httpx.Client, started: httpx.Response) -> dict[str, Any]:
    assert started.status_code == 202, started.text
    path = f"/jobs/{started.json()['job_id']}"
    return _wait(lambda: (view := client.get(path).json())["finished"] and view)


def test_nothing_is_told_or_done_without_a_token(server: Server) -> None:
    with server.client() as nobody, server.client("tb_wrong") as stranger:
        described = nobody.get("/openapi.json").json()
        for path, operations in described["paths"].items():
            if path in ("/setup", "/session"):
                continue
            for method in operations:
                for client in (nobody, stranger):
                    address = path.replace("{number}", "1").replace("{", "").replace("}", "")
                    answer = client.request(method, address)
                    assert answer.status_code in (401, 422), (method, path)
                    assert answer.headers["content-type"] == "application/problem+json"


def test_the_bench_is_told_to_whoever_is_signed_in(people: dict[str, httpx.Client]) -> None:
    for client in people.values():
        bench = client.get("/bench").json()
        assert bench["simulated"]
        assert bench["connection"] == "live"
        rows = client.get("/live", params={"signals": ["output_raw_nm"]}).json()
        assert list(rows["values"]) == ["output_raw_nm"]
        newer = client.get("/live", params={"since": rows["sequence"]}).json()
        assert newer["missed"] == 0
        trend = client.get("/trend", params={"seconds": 3600, "points": 5}).json()
        assert 0 < len(trend["time_s"]) <= 5


def test_wrong_arguments_are_explained_as_in_files(admin: httpx.Client) -> None:
    """What was found, what is allowed and what to do, for queries and bodies."""
    asked = admin.get("/trend", params={"seconds": "x", "points": 5}).json()
    assert asked["detail"] == "query: seconds = 'x'"
    assert asked["allowed"] == "a number, above 0 to 3,600"
    assert asked["remedy"] == "correct the value"
    asked = admin.post("/users", json={"nam": "Ana"}).json()
    assert asked["detail"] == "body: nam is not a key of this section"
    assert asked["allowed"] == "name, role, password"
    assert "also wrong: name, role, password" in asked["remedy"]


def test_a_stream_of_live_rows_has_no_gap(server: Server, people: dict[str, httpx.Client]) -> None:
    token = people["plant"].headers["Authorization"].removeprefix("Bearer ")
    with connect(server.url.replace("http", "ws") + "/api/v1/stream", open_timeout=200) as socket:
        socket.send(json.dumps({"token": token, "signals": ["output_raw_nm"]}))
        first = json.loads(socket.recv(timeout=200))
        second = json.loads(socket.recv(timeout=200))
    assert second["sequence"] - len(second["time_s"]) == first["sequence"]
    assert second["time_s"][0] > first["time_s"][-1]


@pytest.mark.parametrize(
    "message", ["", "{}", '{"token": "x"}', '{"token": "tb_x"}', "[" * 1000, '{"rate": 1e9}']
)
def test_a_stream_without_a_token_ends_at_once(server: Server, message: str) -> None:
    with connect(server.url.replace("http", "ws") + "/api/v1/stream", open_timeout=200) as socket:
        socket.send(message)
        with pytest.raises(ConnectionClosed) as closed:
            socket.recv(timeout=200)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1008


def test_one_session_commands_and_any_may_stop(people: dict[str, httpx.Client]) -> None:
    olga, plant, chief = people["Olga"], people["plant"], people["Max"]
    started = olga.post("/operations/calibrate", json={"side": "output", "step_percent": 2})
    assert started.status_code == 202
    job = started.json()["job_id"]
    assert plant.get("/command").json()["holder"] == "Olga"
    for refused in (
        plant.post("/operations/zero", json={}),
        plant.post(f"/jobs/{job}/pause"),
        plant.post(f"/jobs/{job}/abort", json={}),
        plant.post("/command", json={"force": True}),
    ):
        assert refused.status_code == 409, refused.text
        assert refused.json()["type"] == "torquebench:LeaseError"
    assert olga.post("/operations/zero", json={}).json()["type"] == "torquebench:BusyError"
    stopped = plant.post("/stop", json={"reason": "smoke"})
    assert stopped.status_code == 200
    view = _wait(lambda: (found := chief.get(f"/jobs/{job}").json())["finished"] and found)
    assert view["state"] == "failed"
    assert "smoke, by plant (client)" in view["problem"]["found"]
    (alarm,) = chief.get("/alarms", params={"active": True}).json()
    assert alarm["level"] == "critical"
    refused = olga.post("/operations/zero", json={})
    assert refused.status_code == 503
    cleared = _wait(
        lambda: (found := olga.post("/alarms/acknowledge")).status_code == 200 and found
    )
    assert cleared.json()["acknowledged_by"] == "Olga"


def test_a_stop_waits_for_no_other_request(
    server: Server, people: dict[str, httpx.Client], admin: httpx.Client
) -> None:
    done = []

    def sign_in() -> None:
        with server.client() as nobody:
            nobody.post("/session", json={"name": "Max", "password": PASSWORD})
        done.append(time.monotonic())

    crowd = [threading.Thread(target=sign_in) for _ in range(60)]
    for thread in crowd:
        thread.start()
    assert people["plant"].post("/stop", json={"reason": "in a crowd"}).status_code == 200
    stopped = time.monotonic()
    for thread in crowd:
        thread.join()
    assert any(moment > stopped for moment in done), "the stop came after all of them"
    assert admin.get("/alarms", params={"active": True}).json()


def test_a_job_is_paused_resumed_and_aborted(people: dict[str, httpx.Client]) -> None:
    olga = people["Olga"]
    job = olga.post("/operations/calibrate", json={"side": "output", "step_percent": 2}).json()[
        "job_id"
    ]
    _wait(lambda: olga.get(f"/jobs/{job}/points").json())
    assert olga.post(f"/jobs/{job}/pause").status_code == 200
    _wait(lambda: olga.get(f"/jobs/{job}").json()["state"] == "paused")
    held = olga.get(f"/jobs/{job}").json()["points"]
    assert olga.post(f"/jobs/{job}/resume").status_code == 200
    _wait(lambda: olga.get(f"/jobs/{job}").json()["points"] > held)
    newer = olga.get(f"/jobs/{job}/points", params={"since": held}).json()
    assert newer[0]["number"] == held + 1
    assert olga.post(f"/jobs/{job}/abort", json={"reason": "lunch"}).status_code == 200
    view = _wait(lambda: (found := olga.get(f"/jobs/{job}").json())["finished"] and found)
    assert view["state"] == "aborted"


def test_from_calibration_to_certificate(
    people: dict[str, httpx.Client], admin: httpx.Client
) -> None:
    olga, chief = people["Olga"], people["Max"]
    shown = olga.post(
        "/operations/calibrate/preview", json={"side": "output", "step_percent": 20}
    ).json()
    assert shown["points"] == 20
    assert shown["largest_torque_nm"] == {"output": 2000.0}
    assert shown["mounts"] in ([], ["calibrator"])  # another test may have mounted it
    done = _done(
        olga, olga.post("/operations/calibrate", json={"side": "output", "step_percent": 20})
    )
    result = done["result"]
    assert result["simulated"]
    (module,) = result["modules"]
    number, model = module["calibration_id"], module["models"][0]["model_id"]
    assert olga.get("/bench").json()["sides"]["output"]["compensation"] is None
    body = {"side": "output", "calibration": number, "groups": 2, "points": 6}
    body["tolerance_percent_fs"] = 0.5
    verified = _done(olga, olga.post("/operations/verification", json=body))
    assert verified["result"]["verdict"] == "pass", verified
    use, review = {"model": model, "reason": "checked"}, {"record": f"calibration-{number}"}
    assert olga.post("/operations/records-use", json=use).status_code == 403
    wrong = review | {"password": "wrong password"}
    assert chief.post("/operations/records-review", json=wrong).status_code == 401
    assert admin.get(f"/calibrations/{number}").json()["reviews"] == []
    assert olga.delete("/command").status_code == 204
    asked = {"password": PASSWORD, "tolerance_percent_fs": 0.5, "calibration": number}
    refused = _done(chief, chief.post("/operations/certificate", json=asked))
    assert "no second person checked it before it was put into use" in refused["problem"]["found"]
    signed = review | {"password": PASSWORD}
    assert chief.post("/operations/records-review", json=signed).status_code == 200
    assert chief.post("/operations/records-use", json=use).status_code == 200
    assert chief.get("/bench").json()["sides"]["output"]["compensation"]["model_id"] == model
    issued = _done(chief, chief.post("/operations/certificate", json=asked))["result"]
    certificate = issued["number"]
    assert issued["unreviewed"] == []
    assert issued["verdict"] == verified["result"]["verdict"]
    detail = olga.get(f"/calibrations/{number}").json()
    assert [each["checked_by"] for each in detail["reviews"]] == ["Max"]
    assert [each["number"] for each in detail["certificates"]] == [certificate]
    acts = detail["certificates"][0]["summary"]["acts"]
    stated = {act["role"]: (act["name"], act["signature"]["kind"]) for act in acts}
    assert stated["checked"] == stated["authorised"] == ("Max", "signed")
    assert stated["used"] == ("Max", "signed-in")
    name, sha256 = next(iter(detail["certificates"][0]["files"].items()))
    content = olga.get(f"/certificates/{certificate}/{name}").content
    assert content.startswith(b"%PDF")
    assert hashlib.sha256(content).hexdigest() == sha256
    for wanted, count in (("olga calibrate", 1), ("nobody", 0), ("%", 0)):
        params = {"text": wanted, "status": "completed", "since": "2020-01-01T00:00:00Z"}
        assert olga.get("/runs", params=params).json()["total"] >= count
        assert bool(olga.get("/runs", params=params).json()["runs"]) is bool(count)
    trend = {"columns": ["output_torque_nm"], "points": 10}
    shown = olga.get(f"/runs/{result['run_ids'][0]}/trend", params=trend).json()
    assert max(shown["columns"]["output_torque_nm"]["high"]) > 1900.0
    curve = olga.get(f"/calibrations/{number}/errors", params={"model_id": model}).json()
    assert max(map(abs, curve["model_error_nm"])) < max(map(abs, curve["raw_error_nm"]))
    drift = olga.post("/operations/records-drift", json={"serial": "SIM-T2000"}).json()
    assert {each["unit"] for each in drift["charts"]} == {"%", "% FS"}
    run = olga.get(f"/runs/{result['run_ids'][0]}").json()
    assert (run["run"]["operator"], run["changes"]) == ("Olga", [])
    exported = olga.post("/operations/records-export", json={"run": result["run_ids"][0]}).json()
    assert olga.get(f"/files/{exported['files'][0]}").content.startswith(b"PK")


@pytest.mark.parametrize(
    "path",
    [
        "/runs/..%2f..%2fetc%2fpasswd",
        "/runs/%2e%2e",
        "/certificates/../panel-secret",
        "/certificates/x/..%2f..%2fpanel-secret",
        "/settings/profiles/..%2f..%2fetc%2fpasswd",
        "/runs/a%00b",
    ],
)
def test_no_path_of_a_request_reaches_a_file(admin: httpx.Client, path: str) -> None:
    assert admin.get(path).status_code == 404


def test_guessing_locks_out(server: Server, admin: httpx.Client) -> None:
    person(server, admin, "Gus", "operator").close()
    with server.client() as nobody:
        body = {"name": "Gus", "password": "not his password"}
        answers = [nobody.post("/session", json=body) for _ in range(6)]
        assert [each.status_code for each in answers] == [401] * 5 + [429]
        assert int(answers[-1].headers["Retry-After"]) > 0
        right = nobody.post("/session", json={"name": "Gus", "password": PASSWORD})
        assert right.status_code == 429


def test_foreign_pages_hosts_and_large_bodies_are_refused(
    server: Server, admin: httpx.Client
) -> None:
    foreign = admin.post("/stop", json={}, headers={"Origin": "http://evil.example"})
    assert foreign.status_code == 403
    rebound = admin.get("/bench", headers={"Host": "evil.example"})
    assert rebound.status_code == 403
    large = admin.post("/stop", content=b"x" * 2_000_000)
    assert large.status_code == 413
    assert admin.get("/alarms", params={"active": True}).json() == []


def test_answers_carry_security_headers(server: Server, admin: httpx.Client) -> None:
    api = admin.get("/bench").headers
    assert api["content-security-policy"].startswith("default-src 'none'")
    assert api["cache-control"] == "no-store"
    page = httpx.get(server.url, follow_redirects=True, timeout=200).headers
    for headers in (api, page):
        assert headers["x-frame-options"] == "DENY"
        assert headers["x-content-type-options"] == "nosniff"
        assert "frame-ancestors 'none'" in headers["content-security-policy"]


def test_a_revoked_token_and_an_ended_session_count_no_longer(
    server: Server, admin: httpx.Client
) -> None:
    spare = program(server, admin, "spare", "operator")
    number = next(each for each in admin.get("/clients").json() if each["name"] == "spare")
    assert spare.get("/session").json()["kind"] == "client"
    assert admin.delete(f"/clients/{number['client_id']}").status_code == 200
    assert spare.get("/session").status_code == 401
    pia = person(server, admin, "Pia", "operator")
    assert pia.delete("/session").status_code == 204
    assert pia.get("/session").status_code == 401
    spare.close()
    pia.close()


def test_settings_change_with_a_difference_and_are_undone(admin: httpx.Client) -> None:
    document = {"document": {"output": {"limits": {"torque_nm": 2100.0}}}, "reason": "a test"}
    shown = admin.post("/settings/bench/bench/preview", json=document).json()
    assert [each["key"] for each in shown["differences"]] == ["output.limits.torque_nm"]
    made = admin.put("/settings/bench/bench", json=document).json()
    assert admin.post("/bench/reopen").status_code == 204
    assert admin.get("/bench").json()["sides"]["output"]["limit_nm"] == 2100.0
    assert admin.post(f"/changes/{made['number']}/undo", json={}).status_code == 200
    assert admin.post("/bench/reopen").status_code == 204
    assert admin.get("/bench").json()["sides"]["output"]["limit_nm"] == 2400.0
    assert admin.get("/changes").json()[0]["undoes"] == made["number"]
