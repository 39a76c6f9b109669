"""What `pip install torquebench` brings: the wheel, and commands without the extras."""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from pathlib import Path

import pytest
from tests.system.command_line import environment

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
PLUGINS = sorted(path.parent.name for path in ROOT.glob("plugins/*/pyproject.toml"))
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


def packed(wheel: Path, package: str = "torquebench") -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return {name for name in archive.namelist() if name.startswith(f"{package}/")}


def tracked(source: Path) -> set[str]:
    listed = subprocess.run(
        ["git", "ls-files", "."], cwd=source, check=True, capture_output=True, text=True
    )
    return set(listed.stdout.split())


def install(wheel: Path, target: Path) -> None:
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index"]
    subprocess.run([*command, "--target", str(target), str(wheel)], check=True)


def libraries(folder: Path) -> Path:
    """Link all installed packages but torquebench and its plugins, which are editable here."""
    folder.mkdir()
    for entry in Path(sysconfig.get_path("purelib")).iterdir():
        if "torquebench" not in entry.name.lower() and entry.suffix != ".pth":
            (folder / entry.name).symlink_to(entry)
    return folder


def isolated(code: str, *paths: Path) -> subprocess.CompletedProcess[str]:
    """Run code that sees the standard library and these folders only."""
    return subprocess.run(
        [sys.executable, "-S", "-c", code],
        env=environment() | {"PYTHONPATH": os.pathsep.join(map(str, paths)), "COLUMNS": "200"},
        cwd=paths[0],
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built("wheel", ROOT, tmp_path_factory.mktemp("wheel"))


def test_wheel_and_sdist_hold_every_file(wheel: Path, tmp_path: Path) -> None:
    sdist = built("sdist", ROOT, tmp_path)
    with tarfile.open(sdist) as archive:
        archive.extractall(tmp_path, filter="data")
    unpacked = next(path for path in tmp_path.iterdir() if path.is_dir())
    again = built("wheel", unpacked, tmp_path / "again")
    assert packed(wheel) == packed(again) == tracked(ROOT / "src")
    assert "torquebench/py.typed" in packed(wheel)


@pytest.mark.nightly
def test_the_installed_wheel_runs_the_demo(wheel: Path, tmp_path: Path) -> None:
    installed = tmp_path / "installed"
    install(wheel, installed)
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


COMMAND_LINE = """
import sys
sys.argv = ["torquebench", *{arguments}]
from torquebench.cli import main
raise SystemExit(main())
"""
EVERY_MODULE = """
import importlib, pkgutil
package = importlib.import_module("{package}")
for module in pkgutil.walk_packages(package.__path__, "{package}."):
    importlib.import_module(module.name)
print(package.__file__)
"""


@pytest.mark.nightly
def test_the_wheel_of_each_plugin_adds_what_the_core_alone_lacks(
    wheel: Path, tmp_path: Path
) -> None:
    core, together = tmp_path / "core", tmp_path / "together"
    others = libraries(tmp_path / "libraries")
    install(wheel, core)
    shutil.copytree(core, together)
    for name in PLUGINS:
        plugin = built("wheel", ROOT / "plugins" / name, tmp_path / name)
        package = f"torquebench_{name}"
        assert packed(plugin, package) == tracked(ROOT / "plugins" / name / "src")
        install(plugin, together)
        done = isolated(EVERY_MODULE.format(package=package), together, others)
        assert done.returncode == 0, done.stderr
        assert str(together) in done.stdout

    added = {
        ("--help",): ("plant", "teds"),
        ("panel", "--help"): ("--opcua", "--sparkplug"),
    }
    for arguments, words in added.items():
        code = COMMAND_LINE.format(arguments=arguments)
        alone, joined = isolated(code, core, others), isolated(code, together, others)
        assert (alone.returncode, joined.returncode) == (0, 0), alone.stderr + joined.stderr
        assert alone.stderr == ""
        for word in words:
            assert not re.search(rf"{word}\b", alone.stdout)
            assert re.search(rf"{word}\b", joined.stdout)
    for arguments, word in ((("plant", "--help"), "reevaluate"), (("teds", "--help"), "write")):
        code = COMMAND_LINE.format(arguments=arguments)
        assert isolated(code, core, others).returncode == 2
        assert word in isolated(code, together, others).stdout
