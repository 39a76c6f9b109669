"""What `make run` shows while pip installs."""

import io
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest
from tests.packages import Display, Installation

SCRIPT = Path(__file__).resolve().parents[1] / "packages.py"
SAID = """\
Obtaining file:///bench
Collecting numpy>=2.0 (from torquebench==0.3.0)
  Downloading numpy-2.4.6-cp311-cp311-manylinux_2_28_x86_64.whl.metadata (6.1 kB)
Collecting jinja2>=3.1 (from torquebench==0.3.0)
  Using cached jinja2-3.1.6-py3-none-any.whl.metadata (2.9 kB)
Downloading numpy-2.4.6-cp311-cp311-manylinux_2_28_x86_64.whl (16.6 MB)
Using cached jinja2-3.1.6-py3-none-any.whl (134 kB)
Building editable for torquebench (pyproject.toml): started
Installing collected packages: numpy, jinja2, torquebench
Successfully installed jinja2-3.1.6 numpy-2.4.6 torquebench-0.3.0
"""


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_each_package_is_shown_with_how_far_it_is(tmp_path: Path) -> None:
    stream, kept = Terminal(), []
    Installation(Display(stream), tmp_path).read(io.StringIO(SAID), kept)
    shown = [each.strip() for each in stream.getvalue().split("\r")]
    assert shown[1:6] == [
        "looking up package 1: numpy",
        "looking up package 2: jinja2",
        "fetching 1 of 2 (17 MB): numpy 2.4.6",
        "fetching 2 of 2 (17 MB): jinja2 3.1.6",
        "unpacking 3 packages",
    ]
    assert "".join(kept) == SAID


def wheel(folder: Path) -> Path:
    file = folder / "tiny-1.0-py3-none-any.whl"
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("tiny.py", "")
        archive.writestr(
            "tiny-1.0.dist-info/METADATA",
            "Metadata-Version: 2.1\nName: tiny\nVersion: 1.0\n",
        )
        archive.writestr(
            "tiny-1.0.dist-info/WHEEL",
            "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        )
        archive.writestr("tiny-1.0.dist-info/RECORD", "")
    return file


@pytest.mark.nightly
def test_a_package_is_installed_and_a_missing_one_is_told_by_pip(tmp_path: Path) -> None:
    venv.create(tmp_path / "venv", with_pip=True)
    python = tmp_path / "venv" / "bin" / "python"
    for name, code in ((wheel(tmp_path), 0), (tmp_path / "other-1.0-py3-none-any.whl", 1)):
        done = subprocess.run(
            [sys.executable, "-I", SCRIPT, python, "--no-index", name],
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == code, done.stderr
        if code:
            assert "other-1.0" in done.stderr
        else:
            assert "packages are installed in" in done.stdout
            subprocess.run([python, "-c", "import tiny"], check=True)
