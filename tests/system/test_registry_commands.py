import html
import json
import re
import sqlite3
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from tests.system.command_line import run

from torquebench.calibration import CalibrationData, load_profile
from torquebench.records import (
    CalibrationEntry,
    CheckEntry,
    Registry,
    Zeroing,
    calibration_changes,
)
from torquebench.tables import write_calibration


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    """A data directory after a coarse calibration and a check of the simulated output module."""
    folder = tmp_path_factory.mktemp("calibrated")
    done = run(
        *("calibrate", "output", "--step", 25, "--model", "polynomial"),
        *("--data", folder / "data"),
        cwd=folder,
        TORQUEBENCH_OPERATOR="Ana",
    )
    assert done.returncode == 0, done.stderr
    checked = run(
        *("check", "output", "--tolerance", 0.5, "--data", folder / "data"),
        cwd=folder,
        TORQUEBENCH_OPERATOR="Ana",
    )
    assert checked.returncode == 0, checked.stderr
    assert re.search(r"(pass|conditional pass): worst", checked.stdout)
    return folder / "data"


def records(data, *arguments):
    return run("records", *arguments, "--data", data, cwd=data.parent)


def copied(calibrated, tmp_path):
    import shutil

    return shutil.copytree(calibrated, tmp_path / "data")


def test_what_was_entered_is_verified_with_its_chain(calibrated):
    done = records(calibrated, "verify")
    assert done.returncode == 0, done.stdout
    assert "2 run folders and 1 files, " in " ".join(done.stdout.split())
    with Registry.open(calibrated) as registry:
        head = registry.head()
        (entry,) = registry.calibrations("SIM-T2000")
        (check,) = registry.checks("SIM-T2000")
        assert {zero.run_id for zero in registry.zeroings("SIM-T2000")} == {
            entry.run_id,
            check.run_id,
        }
        roles = {part.role: part.part for part in registry.components(
            ("bench", "Simulated reducer bench")
        )}  # fmt: skip
    assert f"chain end {head}" in " ".join(done.stdout.split())
    assert entry.measured_by == check.measured_by == "Ana"
    assert entry.standard_serial == "SIM-CAL-1"
    assert check.standard_serial == "SIM-VER-1"
    assert roles["output.transducer"] == ("transducer", "SIM-T2000")
    assert records(calibrated, "verify", "--end", str(head)).returncode == 0


def test_a_changed_row_is_shown_with_table_and_field(calibrated, tmp_path):
    data = copied(calibrated, tmp_path)
    connection = sqlite3.connect(data / "registry.sqlite")
    with pytest.raises(sqlite3.IntegrityError, match="append-only"):
        connection.execute("UPDATE calibrations SET measured_by = 'Eve'")
    connection.execute("DROP TRIGGER keep_calibrations_update")
    connection.execute("UPDATE calibrations SET measured_by = 'Eve'")
    connection.commit()
    connection.close()
    done = records(data, "verify")
    assert done.returncode == 1
    for word in ("calibrations 1", "measured_by", "'Eve'", "'Ana'"):
        assert word in done.stdout
    with Registry.open(data) as registry:
        (entry,) = registry.calibrations()
        assert calibration_changes(registry, entry.calibration_id) == (
            "calibrations 1, measured_by: 'Eve' instead of 'Ana'",
        )


def test_a_changed_run_folder_is_shown(calibrated, tmp_path):
    data = copied(calibrated, tmp_path)
    with Registry.open(data) as registry:
        (entry,) = registry.calibrations()
        folder = registry.run(entry.run_id).folder
        results = folder / "results.json"
        results.write_text(results.read_text(encoding="utf-8").replace("0", "1", 1), "utf-8")
        assert calibration_changes(registry, entry.calibration_id) == ()  # the rows are intact
    done = records(data, "verify")
    assert done.returncode == 1
    assert "changed after sealing" in " ".join(done.stdout.split())
    assert records(data, "verify", "--no-files").returncode == 0


def test_reviews_need_a_second_person_and_amendments_leave_the_record_alone(calibrated, tmp_path):
    data = copied(calibrated, tmp_path)
    refused = records(data, "review", "calibration-1", "--by", "Ana")
    assert refused.returncode == 1
    assert "a person other than Ana" in refused.stderr
    assert records(data, "review", "calibration-1", "--by", "Ben").returncode == 0
    amended = records(
        data, "amend", "calibration-1", "measured_by=Anna", "--by", "Ben", "--reason", "misspelt"
    )
    assert amended.returncode == 0, amended.stderr
    shown = records(data, "show", "calibration-1").stdout
    assert re.search(r"measured by +Ana\b", shown)
    assert re.search(r"checked by +Ben", shown)
    assert "measured_by = Anna (Ben: misspelt)" in " ".join(shown.split())


def test_drift_is_charted_with_its_trend_and_a_due_date(calibrated, tmp_path):
    data = copied(calibrated, tmp_path)
    start = datetime(2025, 1, 31, tzinfo=UTC)
    torque = np.array([-2000.0, -1000.0, 1000.0, 2000.0])
    with Registry.open(data) as registry, registry.writing():
        for number in range(8):
            moment = start + timedelta(days=60 * number)
            points = CalibrationData(
                reading_nm=torque * (0.9935 + 1e-4 * number),
                standard_nm=torque,
                series=[1, 1, 2, 2],
                branch=[1, 1, 1, 1],
                range_nm=2000.0,
                transducer_serial="SIM-T2000",
                counter_identity="SIM-COUNTER-1/oscillator-1",
            )
            registry.add_calibration(CalibrationEntry.of_points(points, performed=moment))
            registry.add_zeroing(
                Zeroing(
                    transducer_serial="SIM-T2000", performed=moment, zero_hz=60010.0, zero_nm=0.7
                )
            )
            registry.add_check(
                CheckEntry(
                    transducer_serial="SIM-T2000",
                    performed=moment,
                    verdict="pass",
                    worst_percent_fs=0.02,
                    tolerance_percent_fs=0.1,
                    simulated=False,
                    summary={"signed_worst_percent_fs": 0.02},
                )
            )
    done = records(data, "drift", "SIM-T2000", "--tolerance", 0.2)
    assert done.returncode == 0, done.stderr
    assert "a trend: +0.0" in done.stdout
    assert "Mann-Kendall" in done.stdout
    assert "leaves ±0.2 %" in done.stdout
    assert re.search(r"Calibrate again by \d{4}-\d\d-\d\d", done.stdout)
    unknown = records(data, "drift", "X")
    assert unknown.returncode == 2
    assert "SIM-T2000" in unknown.stderr


def test_a_table_from_elsewhere_is_evaluated_and_held_against_its_profile(tmp_path):
    profile = load_profile("staircase")
    steps = [step for step in profile.staircase(100.0) if step.recorded]
    torque = np.array([step.nominal_nm for step in steps])
    rng = np.random.default_rng(1)
    points = CalibrationData(
        reading_nm=1.0005 * torque + 0.002 * rng.normal(size=torque.size),
        standard_nm=torque * 1.0002,
        series=[step.series for step in steps],
        branch=[step.branch for step in steps],
        range_nm=100.0,
        position_deg=[step.position_deg for step in steps],
        temperature_c=np.linspace(22.0, 23.5, torque.size),
        tared=True,
    )
    write_calibration(tmp_path / "whole.csv", points)
    options = (
        "--reference-uncertainty",
        "0.01 of torque",
        "--resolution",
        0.001,
        "--reference-serial",
        "TC-1",
    )
    done = run(
        *("evaluate", "static", "whole.csv", *options, "--performed", "2025-06-15"),
        *("--profile", "staircase", "--reference-due", "2025-12-31", "--out", "numbers.json"),
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr + done.stdout
    assert "environment.temperature_drift_k" in " ".join(done.stdout.split())
    assert "class 0.1 over the whole range" in done.stdout
    numbers = json.loads((tmp_path / "numbers.json").read_text(encoding="utf-8"))
    before = numbers["results"]["directions"][0]["before"]["evaluation"]
    assert before["indication_deviation_percent"][-1] == pytest.approx(0.03, abs=0.005)

    lacking = replace(points.subset(points.series != 5), nominal_nm=None)
    write_calibration(tmp_path / "lacking.csv", lacking)
    done = run(
        *("evaluate", "static", "lacking.csv", *options, "--performed", "2025-06-15"),
        *("--profile", "staircase", "--reference-due", "2025-06-14", "--report", "lacking.html"),
        cwd=tmp_path,
    )
    assert done.returncode == 1
    said = " ".join(done.stdout.split())
    assert "positions[1].series[0]" in said
    assert "reference.in_date" in said
    assert "the profile refuses a certificate" in done.stderr
    assert said.index("class 0.1 over the whole range") < said.index("positions[1].series[0]")
    assert "h: reversibility" in said
    page = html.unescape((tmp_path / "lacking.html").read_text(encoding="utf-8"))
    assert "(degree 3, N·m); class 0.1 over the whole range" in page
    done = run("evaluate", "static", "lacking.csv", *options, cwd=tmp_path)
    assert done.returncode == 0, "nobody asked for a certificate"
    assert "refuse" not in done.stdout + done.stderr

    tomorrow = f"{datetime.now() + timedelta(days=1):%Y-%m-%d}"
    done = run("evaluate", "static", "whole.csv", *options, "--performed", tomorrow, cwd=tmp_path)
    assert done.returncode == 2
    assert f"performed on {tomorrow}, in the future" in done.stderr

    write_calibration(tmp_path / "named.csv", replace(points, transducer_serial="T-1"))
    done = run("evaluate", "static", "named.csv", *options, "--transducer", "T-9", cwd=tmp_path)
    said = " ".join(done.stderr.split())
    assert "named.csv states transducer_serial = T-1; the given T-9 is used" in said


def test_a_list_says_that_there_is_more(calibrated):
    more = "There are more than these 1: --limit NUMBER, or --all"
    for kind in ("runs", "equipment"):
        assert more in records(calibrated, "list", kind, "--limit", 1).stdout
        assert "more" not in records(calibrated, "list", kind, "--limit", 1, "--all").stdout
    assert more not in records(calibrated, "list", "models", "--limit", 1).stdout
