"""The commands with a registry that is only in PostgreSQL, from one data folder and another."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests import postgresql_server
from tests.system.command_line import laboratory, run, widest_line

if postgresql_server.binaries() is None and not os.environ.get("CI"):
    __test__ = False  # conftest.py says in the report's head that PostgreSQL is left out


@pytest.fixture(scope="module")
def server() -> Iterator[str]:
    with postgresql_server.server() as socket:
        yield postgresql_server.create_database(socket, "commands")


@pytest.fixture(scope="module")
def calibrated(server: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("postgresql")
    done = run(
        *("--registry", server, "calibrate", "output", "--step", 25),
        *("--model", "polynomial", "--data", "data"),
        cwd=folder,
    )
    assert done.returncode == 0, done.stderr
    assert not (folder / "data" / "registry.sqlite").exists()
    return folder


def test_records_are_listed_shown_and_verified(calibrated: Path, server: str) -> None:
    def records(*arguments: str) -> str:
        done = run(
            *("records", *arguments, "--data", "data"), cwd=calibrated, TORQUEBENCH_REGISTRY=server
        )
        assert done.returncode == 0, done.stderr
        assert widest_line(done.stdout) <= 80
        return done.stdout

    assert "calibrate-output" in records("list", "runs")
    assert "SIM-T2000" in records("list")
    for name in ("latest", "model-1", "calibration-1"):
        assert "NOT INTACT" not in records("show", name)
    assert "unchanged" in records("verify")


def test_certificate_and_export_work_from_the_server_alone(
    calibrated: Path, server: str, tmp_path: Path
) -> None:
    """Another data folder on the same computer: the server knows where everything lies."""
    place = ("--data", "elsewhere")
    laboratory(tmp_path / "elsewhere")
    issued = run(
        *("--registry", server, "certificate", "latest", "--authorised-by", "A. Boss"),
        *("--out", "certificate", *place),
        cwd=tmp_path,
    )
    assert issued.returncode == 0, issued.stderr
    (pdf,) = (tmp_path / "certificate").glob("*.pdf")
    checked = run("--registry", server, "certificate", "--check", pdf, *place, cwd=tmp_path)
    assert checked.returncode == 0, checked.stderr
    assert "matches" in checked.stdout

    listed = run("--registry", server, "records", "list", "runs", *place, cwd=tmp_path).stdout
    measured = next(word for word in listed.split() if "calibrate-output" in word)
    exported = run(
        *("--registry", server, "records", "export", measured, "--out", "export", *place),
        cwd=tmp_path,
    )
    assert exported.returncode == 0, exported.stderr
    assert list((tmp_path / "export").glob("certificate-*.pdf"))
    assert not list(tmp_path.rglob("*.sqlite"))

    # The archive lies in the folder that issued it; who verifies from the other one finds it.
    verified = run("--registry", server, "records", "verify", "--data", "data", cwd=calibrated)
    assert verified.returncode == 0, verified.stdout
    (archived,) = (tmp_path / "elsewhere" / "certificates").glob("*/*.pdf")
    moved = archived.rename(tmp_path / archived.name)
    missing = run("--registry", server, "records", "verify", "--data", "data", cwd=calibrated)
    moved.rename(archived)
    assert missing.returncode == 1
    assert "missing" in missing.stdout


def test_the_daily_check_and_the_doctor_use_the_server(calibrated: Path, server: str) -> None:
    checked = run(
        *("check", "output", "--tolerance", 0.5, "--data", "data"),
        cwd=calibrated,
        TORQUEBENCH_REGISTRY=server,
    )
    assert checked.returncode == 0, checked.stderr
    examined = run("doctor", "--data", "data", cwd=calibrated, TORQUEBENCH_REGISTRY=server)
    assert examined.returncode == 0, examined.stdout
    assert "model-1" in examined.stdout


@pytest.mark.parametrize(
    ("url", "named"),
    [
        ("postgresql://nobody@127.0.0.1:1/none", "can't be opened"),
        ("mysql://server/records", "sqlite or postgresql"),
        ("not a url", "registry URL"),
    ],
)
def test_a_server_that_is_none_is_named(url: str, named: str, tmp_path: Path) -> None:
    done = run("--registry", url, "records", "list", cwd=tmp_path)
    assert done.returncode in (1, 2)
    assert named in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr
