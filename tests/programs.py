"""The programs that the tests start: where they are, and how they are installed.

`make test` runs this file with any Python 3, before anything is installed: what is missing is
installed by apt where root may do that, and named otherwise, within seconds.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

_LEAST_PYTHON = (3, 11)
_PROGRAMS = (
    # program, package of Debian, what it is needed for
    ("git", "git", "lists the files of a checkout"),
    ("cc", "gcc libc6-dev", "compiles an exported C header"),
    ("curl", "curl", "sends the documentation's requests"),
    ("postgres", "postgresql", "keeps the registry on a server"),
    ("mosquitto", "mosquitto", "is the MQTT broker of Sparkplug"),
    ("chromium", "chromium", "shows the panel"),
    ("chromedriver", "chromium-driver", "drives the browser"),
)
_OTHER_NAMES = {"chromium": ("chromium-browser", "google-chrome")}
_FONTS = ("/usr/share/fonts", "/usr/local/share/fonts", "~/.local/share/fonts", "~/.fonts")


def program(name: str) -> str | None:
    """Return where a program is, also where ordinary users don't look, None without it."""
    if name == "postgres":
        folders = sorted(Path("/usr/lib/postgresql").glob("*/bin"), key=_version, reverse=True)
        found = shutil.which(name)
        folders = [*([Path(found).resolve().parent] if found else []), *folders]
        return next((str(each / name) for each in folders if (each / "initdb").is_file()), None)
    places = os.pathsep.join((os.environ.get("PATH", os.defpath), "/usr/sbin", "/usr/local/sbin"))
    names = (name, *_OTHER_NAMES.get(name, ()))
    return next(filter(None, (shutil.which(each, path=places) for each in names)), None)


def _version(folder: Path) -> tuple[int, ...]:
    return tuple(int(part) for part in folder.parent.name.split(".") if part.isdigit())


def _has_chinese_font() -> bool:
    return any(any(Path(each).expanduser().rglob("NotoSerifCJK*")) for each in _FONTS)


def missing(wanted: Sequence[str] = ()) -> list[tuple[str, str, str]]:
    """Return program, package and purpose of what isn't installed: of all, or of some by name."""
    lacking = [each for each in _PROGRAMS if program(each[0]) is None]
    if wanted:
        return [each for each in lacking if each[0] in wanted]
    if not _has_chinese_font():
        lacking.append(("Noto Serif CJK", "fonts-noto-cjk", "sets Chinese certificates"))
    created = Path(__file__).parents[1] / ".venv" / "bin" / "python"
    if not created.exists() and importlib.util.find_spec("ensurepip") is None:
        lacking.append(("ensurepip", "python3-venv", "creates the virtual environment"))
    return lacking


def main(wanted: Sequence[str] = ()) -> int:
    """Install what is missing, or name it; return the exit code."""
    if sys.version_info < _LEAST_PYTHON:
        least = ".".join(map(str, _LEAST_PYTHON))
        print(
            f"Python {sys.version.split()[0]} runs this; allowed: {least} or newer; "
            f"do: make PYTHON=python{least} …",
            file=sys.stderr,
        )
        return 2
    lacking = missing(wanted)
    packages = [package for _, names, _ in lacking for package in names.split()]
    apt = ["apt-get", "install", "-y", "--no-install-recommends", *packages]
    if lacking and hasattr(os, "geteuid") and os.geteuid() == 0 and shutil.which("apt-get"):
        print("installing for the tests:", *packages, flush=True)
        quiet = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
        subprocess.run(["apt-get", "update", "-qq"], env=quiet, check=False)
        subprocess.run([*apt, "-qq"], env=quiet, check=False, stdout=subprocess.DEVNULL)
        lacking = missing(wanted)
    if not lacking:
        return 0
    print("Programs are needed that aren't installed:", file=sys.stderr)
    for name, _, purpose in lacking:
        print(f"  {name:<15} {purpose}", file=sys.stderr)
    print("On Debian or Ubuntu, install them by:", file=sys.stderr)
    print("  sudo apt-get update && sudo", *apt, file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
