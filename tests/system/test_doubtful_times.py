"""Expired standards and clocks that run backwards are named where they would be used."""

import subprocess
import sys
from datetime import UTC, datetime, timedelta
from importlib.resources import files
from pathlib import Path

import pytest
from tests.system.command_line import laboratory, run

from torquebench.records import Registry, Report, RunFolder, RunSummary
from torquebench.records.runs.time_check import expired_standard, times_of_run


def words(text: str) -> str:
    return " ".join(text.split())


@pytest.fixture(scope="module")
def expired(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A bench both of whose standards have expired, and a calibration of it."""
    folder = tmp_path_factory.mktemp("expired")
    packaged = files("torquebench.bench").joinpath("simulated.toml").read_text(encoding="utf-8")
    lines = []
    for line in packaged.splitlines():
        lines.append(line)
        if line in ("[calibrator]", "[verification_standard]"):
            lines.append("certificate_due = 2021-03-31")
    bench = folder / "bench.toml"
    bench.write_text("\n".join(lines) + "\n", encoding="utf-8")
    done = run(
        *("calibrate", "output", "--bench", bench, "--step", 25),
        *("--model", "polynomial", "--data", folder / "data"),
        cwd=folder,
    )
    assert done.returncode == 0, done.stderr
    (folder / "said.txt").write_text(done.stderr, encoding="utf-8")
    return bench, folder / "data"


def test_calibrate_names_an_expired_calibrator(expired: tuple[Path, Path]) -> None:
    said = words((expired[1].parent / "said.txt").read_text(encoding="utf-8"))
    assert "the certificate of the calibrator SIM-CAL-1 expired on 2021-03-31" in said
    assert "verification standard" not in said, "it isn't used"


def test_verification_names_an_expired_standard(expired: tuple[Path, Path]) -> None:
    bench, data = expired
    done = run(
        *("verification", "output", "--bench", bench, "--groups", 1, "--points", 4),
        *("--data", data),
        cwd=data.parent,
    )
    said = words(done.stderr)
    assert "certificate of the verification standard SIM-VER-1 expired on 2021-03-31" in said


def test_doctor_verify_and_certificate_name_it_too(expired: tuple[Path, Path]) -> None:
    bench, data = expired
    done = run("doctor", "--bench", bench, "--data", data, cwd=data.parent)
    assert done.returncode == 1
    for standard in ("calibrator SIM-CAL-1", "verification standard SIM-VER-1"):
        assert f"the certificate of the {standard} expired on 2021-03-31" in words(done.stdout)
    verified = run("records", "verify", "--data", data, cwd=data.parent)
    assert verified.returncode == 0, verified.stdout
    assert "against SIM-CAL-1, whose certificate" in words(verified.stderr)
    assert "had expired on 2021-03-31" in words(verified.stderr)
    laboratory(data)
    issued = run(
        *("certificate", "latest", "--out", data.parent / "out", "--data", data), cwd=data.parent
    )
    assert "expired on 2021-03-31" in words(issued.stderr)


def test_a_new_certificate_counts(expired: tuple[Path, Path], tmp_path: Path) -> None:
    with Registry.open(tmp_path) as registry:
        past = datetime(2021, 3, 31).date()
        later = datetime(2099, 1, 1).date()
        assert "expired on 2021-03-31" in expired_standard(registry, "calibrator", "R-9", past)
        assert expired_standard(registry, "calibrator", "R-9", past, past) == ""
        registry.add_report(Report("calibrator", "R-9", "K-2", due=later))
        assert expired_standard(registry, "calibrator", "R-9", past) == ""
        assert expired_standard(registry, "calibrator", "R-8", None) == ""


AHEAD = """
import sys
from datetime import datetime, timedelta
from pathlib import Path
import torquebench.records.registry.database as database
class Ahead(datetime):
    @classmethod
    def now(cls, tz=None):
        return datetime.now(tz) + timedelta(days=3)
database.datetime = Ahead
from torquebench.records import Equipment, Registry
with Registry.open(Path(sys.argv[1])) as registry:
    registry.add_equipment(Equipment("reducer", "R-1"))
"""


def test_a_clock_behind_the_records_is_named_before_it_is_used(tmp_path: Path) -> None:
    data = tmp_path / "data"
    subprocess.run([sys.executable, "-c", AHEAD, str(data)], check=True)
    done = run("doctor", "--data", data, cwd=tmp_path)
    assert done.returncode == 1
    said = words(done.stdout)
    assert "this computer's clock says" in said
    assert "3.0 days before the newest record" in said
    assert "set this computer's clock" in said
    calibrated = run(
        *("calibrate", "output", "--step", 50, "--model", "polynomial", "--data", data),
        cwd=tmp_path,
    )
    assert calibrated.returncode == 0, calibrated.stderr
    assert "3.0 days before the newest record; set the clock" in words(calibrated.stderr)


def test_a_run_that_ended_before_it_began_is_shown_so(tmp_path: Path) -> None:
    now = datetime.now(UTC)
    with Registry.open(tmp_path) as registry:
        writer = RunFolder.create(tmp_path / "runs", {}, kind="zero", run_id="run-9")
        registry.add_run(
            RunSummary(
                run_id="run-9",
                kind="zero",
                started=now,
                simulated=True,
                software_version="0.2.0",
                folder=writer.path,
            )
        )
        registry.end_run(writer.seal(), now - timedelta(hours=3))
        assert times_of_run(registry.run("run-9")).startswith("run run-9 ended (")
    done = run("records", "show", "run-9", "--data", tmp_path, cwd=tmp_path)
    assert "before it began" in words(done.stdout)
