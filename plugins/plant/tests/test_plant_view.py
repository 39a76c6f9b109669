"""The plant's view in a browser, served by the command: it needs no bench, and only reads."""

import contextlib
import os
import re
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from plugins.plant.tests.plant_bench import filled
from tests import postgresql_server
from tests.system.command_line import COMMAND, TIMEOUT_S, environment, prepared, run

from torquebench.records import Registry
from torquebench_plant import Plant, forward

if postgresql_server.binaries() is None and not os.environ.get("CI"):
    __test__ = False  # conftest.py says in the report's head that PostgreSQL is left out


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """URL of a read-only role in a plant with two benches."""
    place = tmp_path_factory.mktemp("plant")
    with postgresql_server.server() as socket:
        database = postgresql_server.create_database(socket, "view")
        with Plant.create(database, f"file://{place}/share") as plant:
            for name in ("one", "other"):
                _, link = plant.register_bench("Bench <1>", "Hall 3")
                with Registry.open(filled(place / name, prefix=name)) as registry:
                    assert forward(registry, link).problems == []
            yield plant.add_reader("reader").render_as_string(hide_password=False)


@contextlib.contextmanager
def served(*options: str, **changes: str) -> Iterator[str]:
    command = [COMMAND, "plant", "view", "--port", "0", *options]
    process = prepared().start(command, Path("/"), environment(**changes))
    try:
        assert process.stdout is not None
        found = re.search(r"http://\S+", process.stdout.readline())
        assert found is not None
        yield found[0]
    finally:
        process.kill()
        process.communicate()


def test_the_plant_is_read_without_a_bench(reader: str, tmp_path: Path) -> None:
    with served("--plant", reader) as url, httpx.Client(base_url=url, timeout=TIMEOUT_S) as browser:
        first = browser.get("/")
        assert first.status_code == 200
        assert "2 Bench &lt;1&gt;" in first.text
        assert "never calibrated" in first.text
        runs = browser.get("/runs", params={"batch": "B1"})
        assert runs.text.count("test-hysteresis-0001") == 2
        times = re.findall(r"<td>(2026-\d\d-\d\d \d\d:\d\d)</td>", browser.get("/runs").text)
        assert times == sorted(times, reverse=True)
        assert len(set(times)) == 4
        chosen = {"specimen_type": "RV-40E", "quantity": "backlash", "upper": "1"}
        production = browser.get("/production", params=chosen)
        assert "Cpk" in production.text
        assert "<svg" in production.text
        chinese = browser.get("/production", params={**chosen, "lang": "zh"})
        assert "过程能力" in chinese.text
        assert "过程能力：RV-40E 的背隙，arcmin" in chinese.text
        assert "标准差" in chinese.text
        for page in ("overview", "runs", "transducers", "production"):
            shown = browser.get(f"/{page}", params={**chosen, "serial": "T-1", "lang": "zh"}).text
            for heading in re.findall(r"<th scope=\"col\">([^<]*)|<label>([^<]*) <input", shown):
                assert re.search(r"[\u4e00-\u9fff]", "".join(heading)), heading
        assert browser.get("/transducers", params={"serial": "T-1"}).status_code == 200
        table = browser.get("/runs.csv", params={"batch": "B1"})
        assert len(table.text.splitlines()) == 3
        assert browser.get("/charts.parquet", params=chosen).content[:4] == b"PAR1"
        wrong = browser.get("/production", params={**chosen, "quantity": "none"})
        assert wrong.status_code == 400
        assert "backlash" in wrong.text
        wrong = browser.get("/charts.csv", params={**chosen, "quantity": "none"})
        assert (wrong.status_code, "backlash" in wrong.text) == (400, True)
        assert browser.get("/transducers", params={"serial": "<script>"}).text.count("<script") == 0
        assert browser.get("/runs", params={"bench": "x"}).status_code == 400
        assert browser.get("/nothing").status_code == 404
        assert browser.get("/view.css").status_code == 200
        assert browser.post("/runs").status_code == 405
        foreign = browser.get("/", headers={"host": "elsewhere.example"})
        assert foreign.status_code == 403


def test_a_password_is_asked_for_where_others_can_read(reader: str) -> None:
    with served("--plant", reader, TORQUEBENCH_VIEW_PASSWORD="secret") as url:
        assert httpx.get(url, timeout=TIMEOUT_S).status_code == 401
        assert httpx.get(url, auth=("anybody", "wrong"), timeout=TIMEOUT_S).status_code == 401
        assert httpx.get(url, auth=("anybody", "secret"), timeout=TIMEOUT_S).status_code == 200
        assert httpx.get(f"{url}/runs.csv", timeout=TIMEOUT_S).status_code == 401
    everywhere = ("--host", "0.0.0.0", "--insecure-network", "--port", "0")
    done = run("plant", "view", *everywhere, "--plant", reader, cwd=Path("/"))
    assert done.returncode == 2
    assert "TORQUEBENCH_VIEW_PASSWORD" in done.stderr
