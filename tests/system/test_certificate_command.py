"""From a calibration on the simulated bench to its checked certificate and its export."""

import shutil
import stat
import subprocess
from pathlib import Path

import pytest
from tests.system.command_line import laboratory, run, widest_line

NOT_SECRET = {"laboratory.toml", "bench.lock"}


@pytest.fixture(scope="module")
def calibration(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bench")
    done = run(
        *("calibrate", "output", "--step-percent", "25", "--model", "polynomial"),
        *("--data", "data"),
        cwd=folder,
    )
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture
def calibrated(calibration: Path, tmp_path: Path) -> Path:
    """The calibration's folder, a copy to each test: tests issue, and name a laboratory."""
    shutil.copytree(calibration, tmp_path / "bench")
    return tmp_path / "bench"


def only(folder: Path, suffix: str) -> Path:
    (found,) = folder.glob(f"*{suffix}")
    return found


def test_certificate_is_issued_checked_and_exported(calibrated: Path) -> None:
    asked = (
        *("certificate", "latest", "--authorised-by", "A. Boss", "--checked-by", "K. Sommer"),
        *("--language", "zh", "--out", "out", "--data", "data", "--tolerance", "0.5"),
    )
    refused = run(*asked, cwd=calibrated)
    assert refused.returncode == 1
    assert "isn't verified on fresh points" in " ".join(refused.stderr.split())
    assert not (calibrated / "data" / "certificates").exists()
    laboratory(calibrated / "data")
    issued = run(*asked, cwd=calibrated)
    assert issued.returncode == 0, issued.stderr
    assert "simulated" in issued.stdout
    assert widest_line(issued.stdout) <= 80
    for suffix in (".pdf", ".xml", ".json"):
        path = only(calibrated / "out", suffix)
        checked = run("certificate", "--check", path, "--data", "data", cwd=calibrated)
        assert checked.returncode == 0, checked.stdout
        assert "matches" in checked.stdout
    changed = calibrated / "changed.xml"
    changed.write_bytes(only(calibrated / "out", ".xml").read_bytes().replace(b"A. Boss", b"Me"))
    checked = run("certificate", "--check", changed, "--data", "data", cwd=calibrated)
    assert checked.returncode == 1
    assert "no match" in checked.stdout

    exported = run("records", "export", "latest", "--out", "all", "--data", "data", cwd=calibrated)
    assert exported.returncode == 0, exported.stderr
    sums = subprocess.run(
        ["sha256sum", "--check", "--quiet", "SHA256SUMS.txt"],
        cwd=calibrated / "all",
        capture_output=True,
        text=True,
        check=False,
    )
    assert sums.returncode == 0, sums.stdout


def test_unknown_run_is_one_message(calibrated: Path) -> None:
    done = run("certificate", "no-such-run", "--data", "data", cwd=calibrated)
    assert done.returncode == 2
    assert "no run 'no-such-run'" in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr
    assert done.stdout == ""


def test_tampered_run_gets_no_certificate(calibrated: Path, tmp_path: Path) -> None:
    shutil.copytree(calibrated / "data", tmp_path / "data")
    results = next((tmp_path / "data" / "runs").glob("*/results.json"))
    results.write_text(results.read_text().replace('"unsettled"', '"unsettled "'))
    done = run("certificate", "latest", "--data", "data", cwd=tmp_path)
    assert done.returncode == 1
    message = " ".join(done.stderr.split())
    assert "changed after sealing" in message
    assert "deviations.changed_record" in message
    assert not (tmp_path / "data" / "certificates").exists()


def test_records_are_their_owners_alone(calibrated: Path) -> None:
    """Registry, runs and certificates: 0600 and 0700, whatever the umask lets pass."""
    laboratory(calibrated / "data")
    issued = run(
        *("certificate", "latest", "--authorised-by", "A. Boss", "--data", "data"), cwd=calibrated
    )
    assert issued.returncode == 0, issued.stderr
    data = calibrated / "data"
    ours = [data, *(each for each in data.rglob("*") if each.name not in NOT_SECRET)]
    assert {"registry.sqlite", "runs", "certificates", "models"} <= {each.name for each in ours}
    assert {".pdf", ".json", ".jsonl", ".parquet"} <= {each.suffix for each in ours}
    for each in ours:
        wanted = 0o700 if each.is_dir() else 0o600
        assert stat.S_IMODE(each.stat().st_mode) == wanted, each
