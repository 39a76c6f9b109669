"""An adaptive calibration from the command line to its certificate; equipment and adjustments."""

import json
import re
from pathlib import Path

import pytest
from tests.system.command_line import laboratory, run, widest_line


@pytest.mark.nightly
def test_an_adaptive_calibration_says_how_many_points_and_why(tmp_path: Path) -> None:
    options = ("output", "--profile", "adaptive", "--points", 40, "--target", 0.001)
    rehearsed = run("calibrate", *options, "--dry-run", cwd=tmp_path)
    assert rehearsed.returncode == 0, rehearsed.stderr
    shown = " ".join(rehearsed.stdout.split())
    assert "up to 24 points at a time" in shown
    assert "or until 40 points are measured" in shown
    assert widest_line(rehearsed.stdout) <= 80
    assert not list(tmp_path.iterdir())

    done = run("calibrate", *options, "--data", "data", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    said = " ".join(done.stdout.split())
    assert "40 points: 24 even ones and 16 placed in 1 round" in said
    assert "budget of 40 points used, target 0.001 % FS not reached" in said
    assert widest_line(done.stdout) <= 80
    (folder,) = (tmp_path / "data" / "runs").iterdir()
    placement = json.loads((folder / "results.json").read_text())["placement"]
    assert [each["points"] for each in placement["rounds"]] == [24, 40]

    adjusted = ("records", "adjust", "transducer", "SIM-T2000", "moved", "--by", "Kim")
    earlier = run(*adjusted, "--performed", "2025-03-01", "--data", "data", cwd=tmp_path)
    assert "calibrate again" not in earlier.stderr
    shown = run("records", "show", "calibration-1", "--data", "data", cwd=tmp_path)
    assert "24 even ones" in shown.stdout
    laboratory(tmp_path / "data")
    issued = run(
        *("certificate", "latest", "--authorised-by", "A. Boss", "--data", "data"), cwd=tmp_path
    )
    assert issued.returncode == 0, issued.stderr
    (record,) = (tmp_path / "data" / "certificates").glob("*/*.json")
    content = json.loads(record.read_text())
    assert content["method"]["placement"] == [24, 16, 1]
    assert [len(table["rows"]) for table in content["static"]] == [6] * 4  # the coarse series


def test_equipment_is_entered_and_shown(tmp_path: Path) -> None:
    def records(*arguments: object) -> tuple[int, str]:
        done = run("records", *arguments, "--data", "data", cwd=tmp_path)
        assert widest_line(done.stdout) <= 80
        assert "Traceback" not in done.stderr
        return done.returncode, " ".join((done.stdout + done.stderr).split())

    assert records("add-equipment", "transducer", "T-1", "--manufacturer", "HBK")[0] == 0
    assert records("add-equipment", "bench", "Bench 4")[0] == 0
    part = ("transducer", "T-1", "bench", "Bench 4", "--role", "output.transducer")
    assert records("fit-part", *part, "--by", "Kim")[0] == 0
    done = ("span set", "--by", "Kim", "--before", "span=1.0", "--after", "span=0.995")
    assert records("adjust", "transducer", "T-1", *done, "--checked-by", "Bo")[0] == 0
    code, shown = records("equipment", "T-1")
    assert code == 0
    assert re.search(r"adjusted \d{4}-\d\d-\d\d span set by Kim; span 1.0 to 0.995", shown)
    assert "output.transducer T-1 since" in records("equipment", "Bench 4")[1]
    assert (
        records("adjust", "transducer", "T-1", *done, "--performed", "2025-03-01T00:30+02:00")[0]
        == 0
    )
    assert "adjusted 2025-02-28 span set by Kim" in records("equipment", "T-1")[1]
    code, said = records("adjust", "transducer", "T-1", *done, "--performed", "2200-01-01")
    assert code == 2
    assert "performed on 2200-01-01, in the future" in said
    code, said = records("adjust", "transducer", "T-1", *done, "--performed", "1.3.2025")
    assert code == 2
    assert "2026-01-31T14:05+01:00" in said
    code, said = records("adjust", "transducer", "T-2", *done)
    assert code == 2
    assert "add-equipment transducer T-2" in said
    assert records("adjust", "transducer", "T-1", "x", "--by", "Kim", "--before", "span")[0] == 2
    assert records("verify")[0] == 0
