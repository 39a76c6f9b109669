import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from tests.support.draws import nightly
from tests.system.panel_api import SLOW, administrator, program, serving

SCHEMATHESIS = str(Path(sys.executable).parent / "schemathesis")
pytestmark = SLOW
EXAMPLES = 3
RULES = """\
# A body that is longer than the schema allows may also be longer than the server reads.
[checks.negative_data_rejection]
expected-statuses = [
    "400", "401", "403", "404", "405", "406", "409", "413", "415", "422", "428", "429", "5xx"]
# No schema can say: passwords of few characters, endless staircases, parameters of a network that
# isn't asked for, text that is no table, streams that a run doesn't have, reducers without
# certified friction, years before 1900, names of operations, an empty queue.
[[operations]]
include-name-regex = "POST /operations/.*"
checks.positive_data_acceptance.expected-statuses = [
    "2xx", "401", "403", "404", "409", "422", "429", "503"]
[[operations]]
include-name = ["POST /users", "PATCH /users/{name}", "GET /runs",
                "POST /files", "POST /queue", "POST /queue/start"]
checks.positive_data_acceptance.expected-statuses = [
    "2xx", "401", "403", "404", "409", "422", "429", "503"]
[[operations]]
include-name = ["GET /events"]  # goes on without end: see test_http_api_client
enabled = false
"""


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("phases", "chosen"),
    [("coverage", ("--include-method", "GET")), nightly("coverage,fuzzing", ())],
)
def test_schemathesis_finds_nothing_wrong_with_any_operation(
    phases: str, chosen: tuple[str, ...], tmp_path: Path
) -> None:
    (tmp_path / "schemathesis.toml").write_text(RULES, encoding="utf-8")
    with serving(tmp_path, "--fast") as server, administrator(server) as admin:
        fuzz = program(server, admin, "fuzz", "administrator")
        report = subprocess.run(
            [
                SCHEMATHESIS,
                "run",
                f"{server.url}/api/v1/openapi.json",
                "--header",
                f"Authorization: {fuzz.headers['Authorization']}",
                "--phases",
                phases,
                "--max-examples",
                str(EXAMPLES),
                "--seed",
                "1",
                "--request-timeout",
                "120",
                "--no-color",
                *chosen,
            ],
            cwd=tmp_path,
            env={**os.environ, "PYTHONWARNINGS": "default"},
            capture_output=True,
            text=True,
            timeout=1000,
            check=False,
        )
        fuzz.close()
        alive = admin.get("/session")
    assert report.returncode == 0, report.stdout[-8000:] + report.stderr[-2000:]
    tested = re.search(r"Tested: (\d+)", report.stdout)
    assert tested is not None
    assert int(tested[1]) > (25 if chosen else 60), "operations"
    assert alive.status_code in (200, 401), "the program may have changed the account itself"
