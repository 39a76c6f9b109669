"""What `pip install torquebench` brings: the wheel, and commands without the extras."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from tests.system.command_line import environment

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
WITHOUT_EXTRAS = """
import importlib.metadata, re, sys
extras = {"alembic", "bluesky", "event_model", "ophyd_async", "segno", "sqlalchemy", "structlog",
          "typst", "argon2", "nicegui", "fastapi", "starlette", "uvicorn"}
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in extras:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Missing())
sys.argv[0] = "torquebench"
from torquebench.cli import main
raise SystemExit(main())
"""


def without_extras(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", WITHOUT_EXTRAS, *arguments],
        cwd=folder,
        env=environment(),
        capture_output=True,
        text=True,
        check=False,
    )


def test_tables_are_fitted_verified_and_compensated_without_extras(tmp_path: Path) -> None:
    for arguments in (
        ("fit", str(EXAMPLES / "calibration-output.csv"), "--range", "2000", "--out", "m.json"),
        ("verify", "m.json", str(EXAMPLES / "verification-output.csv")),
        ("apply", "m.json", str(EXAMPLES / "readings-output.csv"), "--out", "torque.csv"),
    ):
        done = without_extras(tmp_path, *arguments)
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "m.html").is_file()


@pytest.mark.parametrize(("command", "extra"), [("records list", "bench"), ("panel", "panel")])
def test_a_command_that_needs_an_extra_names_it(tmp_path: Path, command: str, extra: str) -> None:
    done = without_extras(tmp_path, *command.split())
    assert done.returncode == 2
    assert f"pip install 'torquebench[{extra}]'" in " ".join(done.stderr.split())
    assert list(tmp_path.iterdir()) == []


def test_the_wheel_holds_every_file_of_the_package_and_runs(tmp_path: Path) -> None:
    build = "from hatchling.builders.wheel import WheelBuilder; import sys;"
    build += "print(*WheelBuilder(sys.argv[1]).build(directory=sys.argv[2], versions=['standard']))"
    subprocess.run([sys.executable, "-c", build, str(ROOT), str(tmp_path)], check=True)
    wheel = next(tmp_path.glob("*.whl"))
    with zipfile.ZipFile(wheel) as archive:
        packed = {name for name in archive.namelist() if name.startswith("torquebench/")}
        archive.extractall(tmp_path / "installed")
    listed = subprocess.run(
        ["git", "ls-files", "src"], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.split()
    assert packed == {name.removeprefix("src/") for name in listed}
    said = subprocess.run(
        [sys.executable, "-m", "torquebench", "--version"],
        cwd=tmp_path,
        env=environment() | {"PYTHONPATH": str(tmp_path / "installed")},
        check=True,
        capture_output=True,
        text=True,
    )
    assert said.stdout.split()[1] in wheel.name
