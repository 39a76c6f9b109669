"""The standard reducer as the bench's end-to-end check, from the command line."""

from pathlib import Path

from tests.system.command_line import run, widest_line

REDUCER = """name = "standard 7"
kind = "rv"
ratio = 80.0
rated_torque_nm = 2000.0
acceleration_torque_nm = 4000.0
momentary_peak_torque_nm = 8000.0
max_input_speed_rpm = 1200.0
certificate = "F-7"
"""
POINT = "[[certified_friction]]\nspeed_rpm = {}\ntorque_nm = {}\nexpanded_uncertainty_nm = 0.01\n"


def test_a_certificate_that_the_bench_contradicts_fails(tmp_path: Path) -> None:
    points = POINT.format(100, 0.9) + POINT.format(200, 0.9)
    (tmp_path / "standard.toml").write_text(REDUCER + points)
    result = run(
        *("standard-reducer", "--reducer", "standard.toml", "--repeats", "2"),
        *("--report", "r.html", "--data", "data"),
        cwd=tmp_path,
    )
    assert result.returncode == 1, result.stderr
    assert widest_line(result.stdout) <= 80
    assert "standard 7, failed" in result.stdout
    assert " - simulated" in result.stdout
    assert "tolerance 0.1 % FS." in " ".join(result.stdout.split())
    assert "fail: Standard reducer: error" in result.stdout
    assert "not compensated" in result.stdout
    report = (tmp_path / "r.html").read_text()
    assert "F-7" in report
    assert "out of 0.1 % FS" in report


def test_a_reducer_without_certificate_is_refused(tmp_path: Path) -> None:
    result = run("standard-reducer", "--reducer", "rv-40e", cwd=tmp_path)
    assert result.returncode == 2
    assert "certified_friction" in result.stderr
