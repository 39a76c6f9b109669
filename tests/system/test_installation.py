"""What `pip install torquebench` brings: the wheel, and commands without the extras."""

import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest
from tests.system.command_line import environment

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
WITHOUT_EXTRAS = """
import importlib.metadata, re, sys
extras = {"alembic", "bluesky", "event_model", "ophyd_async", "segno", "sqlalchemy", "structlog",
          "typst", "argon2", "nicegui", "fastapi", "starlette", "uvicorn", "paho", "asyncua"}
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
        ("fit", str(EXAMPLES / "calibration-output.csv"), "--report", "m.html", "--out", "m.json"),
        ("verify", "m.json", str(EXAMPLES / "verification-output.csv")),
        ("apply", "m.json", str(EXAMPLES / "readings-output.csv"), "--out", "torque.csv"),
    ):
        done = without_extras(tmp_path, *arguments)
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "m.html").is_file()


@pytest.mark.parametrize(
    ("command", "extra"),
    [
        ("records list", "bench"),
        ("panel", "panel"),
    ],
)
def test_a_command_that_needs_an_extra_names_it(tmp_path: Path, command: str, extra: str) -> None:
    done = without_extras(tmp_path, *command.split())
    assert done.returncode == 2
    assert f"pip install 'torquebench[{extra}]'" in " ".join(done.stderr.split())
    assert list(tmp_path.iterdir()) == []


def built(builder: str, source: Path, into: Path) -> Path:
    """Build a wheel or an sdist as `pip` and `python -m build` do."""
    code = (
        f"from hatchling.builders.{builder} import {builder.capitalize()}Builder as B; import sys;"
    )
    code += "print(*B(sys.argv[1]).build(directory=sys.argv[2], versions=['standard']))"
    command = [sys.executable, "-c", code, str(source), str(into)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return Path(done.stdout.split()[-1])


def take_over_kernels(installed: Path) -> None:
    """Take over what is compiled already: compiling all again takes longer than the demo itself.

    The cache knows its source file by size and time.
    """
    for source in (ROOT / "src" / "torquebench").rglob("*.py"):
        here = installed / "torquebench" / source.relative_to(ROOT / "src" / "torquebench")
        kernels = list((source.parent / "__pycache__").glob(f"{source.stem}.*.nb[ci]"))
        if kernels:
            os.utime(here, ns=(source.stat().st_atime_ns, source.stat().st_mtime_ns))
            (here.parent / "__pycache__").mkdir(exist_ok=True)
        for kernel in kernels:
            shutil.copy(kernel, here.parent / "__pycache__")


def packed(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return {name for name in archive.namelist() if name.startswith("torquebench/")}


def test_wheel_and_sdist_hold_every_file_and_the_installed_wheel_runs_the_demo(
    tmp_path: Path,
) -> None:
    wheel = built("wheel", ROOT, tmp_path)
    sdist = built("sdist", ROOT, tmp_path)
    with tarfile.open(sdist) as archive:
        archive.extractall(tmp_path, filter="data")
    unpacked = next(path for path in tmp_path.iterdir() if path.is_dir())
    again = built("wheel", unpacked, tmp_path / "again")
    listed = subprocess.run(
        ["git", "ls-files", "src"], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.split()
    assert packed(wheel) == packed(again) == {name.removeprefix("src/") for name in listed}
    assert "torquebench/py.typed" in packed(wheel)

    installed = tmp_path / "installed"
    install = ["-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--target"]
    subprocess.run([sys.executable, *install, str(installed), str(wheel)], check=True)
    take_over_kernels(installed)
    folder = tmp_path / "empty"
    folder.mkdir()
    command = [sys.executable, str(installed / "bin" / "torquebench")]
    for arguments in (["--version"], ["demo", "--quick", "--quiet"]):
        done = subprocess.run(
            [*command, *arguments],
            cwd=folder,
            env=environment() | {"PYTHONPATH": str(installed)},
            check=False,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr
        if "--version" in arguments:
            assert done.stdout.split()[1] in wheel.name
    assert (folder / "torquebench-demo.html").is_file()
