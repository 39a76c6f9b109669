"""The commands of a plant with three benches, one of them without a link for a while."""

import json
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from plugins.plant.tests.plant_bench import add_run, backlash_results, filled
from tests import postgresql_server
from tests.system import command_line
from tests.system.command_line import widest_line
from tests.system.test_json_answers import misfits

from torquebench.cli.output_options import RESULTS
from torquebench.records import Registry

if postgresql_server.binaries() is None and not os.environ.get("CI"):
    __test__ = False  # conftest.py says in the report's head that PostgreSQL is left out


def run(*words: object, cwd: Path = Path("/")) -> subprocess.CompletedProcess[str]:
    return command_line.run(*words, cwd=cwd)


@pytest.fixture
def server() -> Iterator[postgresql_server.Server]:
    """A new server for each test, because a test stops it and roles and entries remain on it."""
    with postgresql_server.restartable() as found:
        yield found


@pytest.fixture
def folder(server: postgresql_server.Server, tmp_path: Path) -> Path:
    """A folder with the benches' URLs of a plant in files."""
    (tmp_path / "share").mkdir()
    done = run("plant", "init", "--folders", f"file://{tmp_path}/share", "--plant", server.url)
    assert done.returncode == 0, done.stderr
    for name in ("Bench", "Bench", "Other"):
        options = ("--place", "Hall 3", "--json", "--plant", server.url)
        done = run("plant", "register", name, *options)
        assert done.returncode == 0, done.stderr
        answer = json.loads(done.stdout)["answer"]
        assert misfits(answer, RESULTS["plant register"]) == []
        number = answer["benches"][0]["number"]
        (tmp_path / f"url-{number}").write_text(answer["benches"][0]["url"])
        filled(tmp_path / f"data-{number}", prefix=f"S{number}")
    return tmp_path


def push(folder: Path, number: int, *options: object) -> tuple[int, str]:
    url = (folder / f"url-{number}").read_text()
    done = run("plant", "push", "--plant", url, "--data", folder / f"data-{number}", *options)
    return done.returncode, done.stdout + done.stderr


def test_benches_send_and_the_plant_lists(server: postgresql_server.Server, folder: Path) -> None:
    for number in (1, 2, 3):
        code, said = push(folder, number)
        assert code == 0, said
        assert "4 run folders" in said
    for command in (("status",), ("runs",), ("runs", "--batch", "B1"), ("verify", "--folders")):
        done = run("plant", *command, "--plant", server.url)
        assert done.returncode == 0, done.stderr
        assert widest_line(done.stdout) <= 80
        said = json.loads(run("plant", *command, "--json", "--plant", server.url).stdout)
        assert misfits(said["answer"], RESULTS[f"plant {command[0]}"]) == []
    questions = (
        ("due",),
        ("drift", "T-1"),
        ("specimens", "RV-40E", "backlash"),
        ("capability", "RV-40E", "backlash", "--upper", 1),
        ("charts", "RV-40E", "backlash"),
        ("outliers", "RV-40E", "backlash"),
        ("drift", "--kind", "T10F"),
    )
    for words in questions:
        done = run("plant", *words, "--plant", server.url, "--out", folder / "a.csv")
        assert done.returncode == 0, done.stderr
        assert widest_line(done.stdout) <= 80
        assert (folder / "a.csv").read_text().partition(",")[0].isidentifier()
    said = json.loads(run("plant", *words, "--json", "--plant", server.url).stdout)
    assert misfits(said["answer"], RESULTS["plant drift"]) == []
    listed = run("plant", "runs", "--bench", 2, "--kind", "test-hysteresis", "--plant", server.url)
    assert "3 runs" in listed.stdout
    assert "S2-1" in listed.stdout


def test_nothing_is_lost_while_the_link_is_down(
    server: postgresql_server.Server, folder: Path
) -> None:
    code, said = push(folder, 3)
    assert code == 0, said
    server.stop()
    with Registry.open(folder / "data-3") as registry:
        for number in range(5):
            add_run(
                registry, f"late-{number}", "test-hysteresis", backlash_results("S3-9"), hours=50
            )
    code, said = push(folder, 3)
    assert code == 1
    assert "plant's registry" in said
    server.start()
    code, said = push(folder, 3)
    assert code == 0, said
    assert "5 run folders" in said
    done = run("plant", "verify", "--folders", "--plant", server.url)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.nightly
def test_a_run_is_withdrawn_at_its_bench_too(
    server: postgresql_server.Server, folder: Path
) -> None:
    for number in (1, 2):  # both have a run of this name
        code, said = push(folder, number)
        assert code == 0, said
    run_id = "20260105T000000Z-test-hysteresis-0000"
    words = ("--by", "Boss", "--reason", "wrong oil", "--plant", server.url)
    done = run("plant", "withdraw", run_id, *words)
    assert done.returncode == 2
    done = run("plant", "withdraw", run_id, "--bench", 1, *words)
    assert done.returncode == 0, done.stderr
    code, said = push(folder, 1)
    assert code == 0
    assert "wrong oil" in said


def test_a_wrong_url_is_named(tmp_path: Path) -> None:
    for url, named in (("", "--plant"), ("sqlite:///x", "needs a server")):
        done = run("plant", "status", "--plant", url, cwd=tmp_path)
        assert done.returncode == 2
        assert named in " ".join(done.stderr.split())
