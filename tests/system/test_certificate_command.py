"""From a calibration on the simulated bench to its checked certificate and its export."""

import shutil
import stat
import subprocess
from pathlib import Path

import pypdf
import pytest
from tests.digital_certificates import NM, certificate, new_list, quantity
from tests.system.command_line import laboratory, run, widest_line

from torquebench.testing.accounts import people_of

NOT_SECRET = {"laboratory.toml", "bench.lock"}


@pytest.fixture(scope="module")
def calibration(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bench")
    done = run(
        *("calibrate", "output", "--step", "25", "--model", "polynomial"),
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


FORGERY = (
    ("records", "review", "calibration-1", "--by", "K. Sommer"),
    ("records", "use", "model-1", "--by", "K. Sommer", "--reason", "checked"),
    ("certificate", "latest", "--authorised-by", "A. Boss", "--out", "out"),
)
"""One person's commands for the check by a second and the authorisation by a third."""


def test_typed_acts_are_stated_and_accounts_cant_be_typed(calibrated: Path) -> None:
    laboratory(calibrated / "data")
    for command in FORGERY:
        done = run(*command, "--data", "data", cwd=calibrated)
        assert done.returncode == 0, done.stderr
        assert "typed by" in " ".join(done.stdout.split()), done.stdout
        assert widest_line(done.stdout) <= 80
    pages = pypdf.PdfReader(only(calibrated / "out", ".pdf")).pages
    text = " ".join(" ".join(page.extract_text() for page in pages).split())
    assert text.count("not signed") >= 4
    assert only(calibrated / "out", ".xml").read_text().count("not signed") >= 4
    shown = run("records", "show", "calibration-1", "--data", "data", cwd=calibrated)
    assert "typed by" in " ".join(shown.stdout.split())

    check = ("certificate", "--check", only(calibrated / "out", ".pdf"), "--data", "data")
    assert run(*check, cwd=calibrated).returncode == 0
    with people_of(calibrated / "data", "K. Sommer", "A. Boss"):
        pass
    checked = run(*check, cwd=calibrated)
    assert checked.returncode == 1
    assert " ".join(checked.stdout.split()).count("typed, not signed") == 3
    before = run("records", "verify", "--data", "data", cwd=calibrated).stdout
    for command in FORGERY:
        refused = run(*command, "--data", "data", cwd=calibrated)
        assert refused.returncode == 2, refused.stdout
        message = " ".join(refused.stderr.split())
        assert "belongs to an account on the panel and was entered by somebody else" in message
    assert run("records", "verify", "--data", "data", cwd=calibrated).stdout == before


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


def foreign(folder: Path, **changed: str) -> Path:
    torque, u = (100.0, 500.0, 1000.0), (0.05, 0.1, 0.3)
    xml = certificate(
        "3.3.0",
        [
            quantity(new_list(torque, NM), "Reference", "basic_referenceValue", "3.3"),
            quantity(new_list(torque, NM, u), "Indication", "basic_measuredValue", "3.3"),
        ],
    )
    for old, new in changed.items():
        assert old in xml
        xml = xml.replace(old, new)
    path = folder / "standard.xml"
    path.write_text(xml, encoding="utf-8")
    return path


def test_certificate_of_another_laboratory_is_shown_and_validated(tmp_path: Path) -> None:
    valid = run("certificate", "--check", foreign(tmp_path), cwd=tmp_path)
    assert valid.returncode == 0, valid.stderr + valid.stdout
    for shown in ("K-2026-17", "Labor AG", "T-99", "3.3.0: valid"):
        assert shown in valid.stdout, valid.stdout
    assert ["500", "0.1", "0.02"] in [line.split() for line in valid.stdout.splitlines()]
    assert widest_line(valid.stdout) <= 80
    broken = run("certificate", "--check", foreign(tmp_path, city="cities"), cwd=tmp_path)
    assert broken.returncode == 1
    assert "cities" in broken.stdout + broken.stderr
    assert [each.name for each in tmp_path.iterdir()] == ["standard.xml"]  # no folder of records


def test_fit_counts_u_of_a_digital_certificate(tmp_path: Path) -> None:
    rows = [f"{x},{x * 1.001 + 0.01}" for x in range(-1000, 1001, 100)]
    (tmp_path / "t.csv").write_text("standard_nm,reading_nm\n" + "\n".join(rows))
    done = run("fit", "t.csv", "--reference", foreign(tmp_path), "--out", "m.json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    model = (tmp_path / "m.json").read_text()
    assert "certificate K-2026-17 of Torque transducer T-99, Labor AG" in model
