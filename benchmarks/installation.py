"""What an installation needs: packages, size on disk and import time of the wheel with each extra.

The wheel is built and installed in an empty environment for each extra, with the tested versions
(`constraints.txt`). The demo and the panel then start in the one with `[panel]`, and the table of
README.md is written.
"""

from __future__ import annotations

import argparse
import json
import platform
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Sequence
from pathlib import Path

from benchmarks.reporting import write_section
from torquebench import __version__

__all__ = ["main"]

ROOT = Path(__file__).resolve().parents[1]
EXTRAS = {
    "": "`fit`, `verify`, `apply`, `export`, `budget`, `evaluate`, Python",
    "bench": "also the bench, the demo, records and certificates",
    "panel": "also the panel and its HTTP API",
}
IMPORTS = ("import torquebench", "from torquebench.compensation import make_model")
PORT = 8377
STARTING_S = 120.0


def _run(*command: str | Path, folder: Path) -> str:
    return subprocess.run(
        [str(part) for part in command], cwd=folder, check=True, stdout=subprocess.PIPE, text=True
    ).stdout


def _install(wheel: Path, extra: str, environment: Path) -> float:
    """Install the wheel in a new environment; return the wall time of pip, s."""
    _run(sys.executable, "-m", "venv", environment, folder=environment.parent)
    begin = time.perf_counter()
    requirement = f"torquebench[{extra}] @ {wheel.as_uri()}" if extra else wheel
    pip = ("-m", "pip", "install", "--quiet", "--constraint", ROOT / "constraints.txt")
    _run(environment / "bin" / "python", *pip, requirement, folder=environment.parent)
    return time.perf_counter() - begin


def _packages(environment: Path) -> int:
    listed = json.loads(
        _run(environment / "bin" / "pip", "list", "--format", "json", folder=environment)
    )
    return sum(package["name"] not in ("pip", "setuptools") for package in listed)


def _size_gb(environment: Path) -> float:
    """Return the size of the installed files, without pip's own, GB."""
    return (
        sum(
            path.lstat().st_size
            for path in (environment / "lib").rglob("*")
            if not {"pip", "setuptools", "pkg_resources"} & set(path.parts)
        )
        / 1e9
    )


def _import_s(environment: Path, statement: str) -> float:
    """Return the smallest processor time of an import beyond the interpreter's start, s."""
    code = f"import time; t = time.process_time(); {statement}; print(time.process_time() - t)"
    python = environment / "bin" / "python"
    return min(float(_run(python, "-c", code, folder=environment)) for _ in range(4))


def _panel_answers(environment: Path, folder: Path) -> float:
    """Start the panel with its simulated bench; return the time until its page answers, s."""
    begin = time.perf_counter()
    torquebench = str(environment / "bin" / "torquebench")
    command = [torquebench, "panel", "--port", str(PORT), "--data", str(folder)]
    with subprocess.Popen(command, cwd=environment) as panel:
        try:
            while time.perf_counter() - begin < STARTING_S:
                try:
                    with urllib.request.urlopen(f"http://127.0.0.1:{PORT}/") as page:
                        page.read()
                    return time.perf_counter() - begin
                except OSError:
                    time.sleep(0.2)
        finally:
            panel.terminate()
    raise TimeoutError(f"the panel didn't answer within {STARTING_S:.0f} s")


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure every extra, start demo and panel, and write the table of README.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, help="keep the environments in this folder")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        builder = "from hatchling.builders.wheel import WheelBuilder as B; import sys;"
        builder += "print(*B(sys.argv[1]).build(directory=sys.argv[2], versions=['standard']))"
        wheel = Path(_run(sys.executable, "-c", builder, ROOT, folder, folder=folder).split()[-1])
        rows = []
        for extra, purpose in EXTRAS.items():
            environment = folder / (extra or "minimal")
            seconds = _install(wheel, extra, environment)
            name = f"torquebench[{extra}]" if extra else "torquebench"
            count, size = _packages(environment), _size_gb(environment)
            rows.append(f"| `{name}` | {purpose} | {count} | {size:.2f} GB |")
            print(rows[-1], f"pip: {seconds:.0f} s", flush=True)
        light, models = (_import_s(folder / "minimal", statement) for statement in IMPORTS)
        _run(folder / "panel" / "bin" / "torquebench", "demo", "--quick", folder=folder)
        print(f"panel answers after {_panel_answers(folder / 'panel', folder / 'data'):.1f} s")
    python = platform.python_version()
    text = "\n".join(["| installed | for | packages | size |", "| --- | --- | --- | --- |", *rows])
    text += f"\n\n`{IMPORTS[0]}` takes {light:.2f} s of processor time, `{IMPORTS[1]}` "
    text += f"{models:.1f} s (`python -m benchmarks installation`, version {__version__}, "
    text += f"{platform.system()} {platform.machine()}, Python {python})."
    write_section(ROOT / "README.md", "installation", text)
    return 0
