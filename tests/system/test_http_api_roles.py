"""Each operation of the API's own description × each role: who may is let in, nobody else is."""

from collections.abc import Iterator
from typing import Any

import httpx
import pytest
from tests.system.panel_api import PASSWORD, SLOW, Server, administrator, person, serving

from torquebench.operations import ROLES
from torquebench.panel.api.describing import EXAMPLES

pytestmark = SLOW
PATHS = {
    "{model_id}": "999",
    "{calibration_id}": "999",
    "{client_id}": "999",
    "{number}": "999",
    "{side}": "output",
    "{job_id}": "0" * 12,
    "{run_id}": "none",
    "{section}": "profiles",
    "{name}": "none",
}
SIGNED = {"password": PASSWORD}
BODIES: dict[str, dict[str, Any]] = {
    "add_user": {"name": "X", "role": "operator", "password": PASSWORD},  # X is too short a name
    "records_review": {"record": "calibration-999", **SIGNED},
    "records_fit_model": {"calibration": 999},
    "records_import": {"table": "none.csv", "resolution_nm": 0.1},
    "records_amend": {"record": "calibration-999", "changes": {"notes": ""}, "reason": "none"},
    "records_add_equipment": {"kind": "reducer", "serial": "none"},
    "records_add_certificate": {
        "kind": "transducer",
        "serial": "none",
        "number": "none",
        "uncertainty_percent": 0.1,
        "due": "2099-01-31",
    },
    "records_fit_part": {
        "kind": "transducer",
        "serial": "none",
        "into_kind": "bench",
        "into_serial": "none",
        "role": "none",
    },
    "records_laboratory": {"name": "Lab", "city": "Ulm", "country": "DE"},
    "records_adjust": {"kind": "transducer", "serial": "none", "what": "none"},
    "records_use": {"model": 999},
    "records_deactivate": {"side": "output"},
    "records_discard": {"run_id": "none", "reason": "none"},
    "certificate": {"calibration": 999, **SIGNED},
    "change_password": {"old": "wrong password", "new": PASSWORD},
    "take_command": {"force": False},
    "answer": {"done": True},
    "change": {"document": {}},
    "preview": {"document": {}},
}
OPEN = {"set_up", "sign_in"}
DISTURBING = {
    "records_add_equipment",
    "stop", "sign_out", "reopen", "events", "zero", "standard_reducer", "start_queue",
}  # fmt: skip
"""Let in, these would end the session or the bench of the others, or go on: tested elsewhere."""


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with serving(tmp_path_factory.mktemp("roles"), "--fast") as running:
        yield running


@pytest.fixture(scope="module")
def people(server: Server) -> Iterator[dict[str, httpx.Client]]:
    admin = administrator(server)
    found = {
        "operator": person(server, admin, "Olga", "operator"),
        "metrologist": person(server, admin, "Max", "metrologist"),
        "administrator": admin,
    }
    yield found
    for each in found.values():
        each.close()


def _operations(server: Server) -> list[tuple[str, str, dict[str, Any]]]:
    with server.client() as nobody:
        described = nobody.get("/openapi.json").json()
    return [
        (method, path, operation)
        for path, operations in described["paths"].items()
        for method, operation in operations.items()
    ]


def _ask(client: httpx.Client, method: str, path: str, operation: dict[str, Any]) -> httpx.Response:
    for name, value in PATHS.items():
        path = path.replace(name, value)
    if "requestBody" not in operation:
        return client.request(method, path)
    content = operation["requestBody"]["content"]
    if "application/json" not in content:
        return client.request(method, path, content=b"reading_nm\n", params={"name": "t.csv"})
    schema = content["application/json"]["schema"]
    example = EXAMPLES.get(schema["$ref"].rpartition("/")[2], {})
    return client.request(method, path, json=BODIES.get(operation["operationId"], example))


def test_nobody_and_strangers_are_let_in_nowhere(server: Server) -> None:
    strangers = ["", "tb_unknown", "x" * 43, "tb_" + "A" * 5000]
    for method, path, operation in _operations(server):
        if operation["operationId"] in OPEN:
            continue
        for token in strangers:
            with server.client(token) as client:
                answer = _ask(client, method, path, operation)
            assert answer.status_code == 401, (method, path, token, answer.text)
            assert answer.headers["www-authenticate"] == "Bearer"
            assert answer.json()["type"] == "torquebench:NotSignedInError"


@pytest.mark.parametrize("role", ROLES)
def test_a_role_is_let_in_where_the_description_says_so(
    server: Server, people: dict[str, httpx.Client], role: str
) -> None:
    asked = 0
    for method, path, operation in _operations(server):
        name = operation["operationId"]
        if name in OPEN:
            continue
        may = ROLES.index(role) >= ROLES.index(operation["x-role"])
        if may and name in DISTURBING:
            continue
        answer = _ask(people[role], method, path, operation)
        asked += 1
        assert (answer.status_code != 403) is may, (method, path, role, answer.text)
        assert answer.status_code < 500 or answer.status_code == 503, (method, path, answer.text)
        assert str(answer.status_code) in operation["responses"], (name, answer.text)
    assert asked > 50


def test_who_may_not_changes_nothing(server: Server, people: dict[str, httpx.Client]) -> None:
    chief = people["administrator"]
    assert {each["name"] for each in chief.get("/users").json()} == {"Admin", "Olga", "Max"}
    assert {each["created_by"] for each in chief.get("/clients").json()} <= {"Admin"}
    assert chief.get("/changes").json() == []
    assert chief.get("/alarms", params={"active": True}).json() == []
