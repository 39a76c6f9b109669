"""What answers at once imports nothing that takes long: help, lists of records, and refusals."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from tests.support.draws import nightly
from tests.system.command_line import run

from torquebench.operations import OPERATIONS
from torquebench.records import Registry

HEAVY = [
    *("asammdf", "bluesky", "fastapi", "h5py", "matplotlib", "nicegui", "nptdms", "numba", "onnx"),
    *("openpyxl", "ophyd_async", "pandas", "polars", "pyarrow", "scipy", "skfem", "sklearn"),
]
LIBRARIES = ["alembic", "numpy", "pydantic", "sqlalchemy"]

ONE_AFTER_ANOTHER = """
import contextlib, io, json, sys
from torquebench.cli import main
heavy, commands = json.loads(sys.argv[1])
for command in commands:
    sys.argv = ["torquebench", *command]
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as e:
        try:
            main()
        except SystemExit as end:
            code = end.code
    print(json.dumps([command, code, sorted(set(heavy) & set(sys.modules)), e.getvalue()]))
"""

REFUSED = [
    "fit none.csv",
    "fit table.csv",
    "fit table.csv --model nonsense",
    "fit calibration.csv --empty none.csv",
    "fit calibration.csv --empty table.csv",
    "fit table.csv --out none/model.json",
    "apply none.json table.csv --out torque.csv",
    "apply table.csv table.csv --out torque.csv",
    "verify none.json table.csv",
    "evaluate static none.csv --reference-uncertainty 0.02 --resolution 0.01",
    "evaluate static table.csv --profile none --reference-uncertainty 0.02 --resolution 0.01",
    "evaluate hysteresis table.csv --rated-torque 4 --column torque=b --column angle=a",
    "evaluate friction table.csv --column speed=a[rpm] --column torque=b",
    "evaluate no-load table.csv --column speed=a",
    "evaluate breakaway table.csv --kind starting --column time=a",
    "evaluate transmission-error table.csv --column input=a",
    "evaluate efficiency table.csv --column speed=a",
    "calibrate",
    "calibrate nowhere",
    "calibrate output --profile none",
    "calibrate output --model none",
    "calibrate output --bench none.toml",
    "check output --bench none.toml",
    "measure --bench none.toml",
    "test nonsense",
    "test hysteresis --bench none.toml",
    "test hysteresis --reducer none",
    "simulate --bench none.toml",
    "panel --bench none.toml",
    "panel --host 10.0.0.1",
    "demo --out none/report.html",
    "demo --bench none.toml",
    "certificate",
    "certificate none --data records",
    "export none.json --out table.h",
    "export none.json --out table.xyz",
    "budget none.json --reading 3",
    "records list nonsense",
    "records show none --data records",
    "records list --data none",
]


def answers(folder: Path, heavy: list[str], *commands: str) -> list[list[object]]:
    asked = json.dumps([heavy, [command.split() for command in commands]])
    result = subprocess.run(
        [sys.executable, "-c", ONE_AFTER_ANOTHER, asked],
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
    )
    return [json.loads(line) for line in result.stdout.splitlines()]


def test_help_imports_no_library() -> None:
    (answer,) = answers(Path(), [*HEAVY, *LIBRARIES], "--help")
    assert answer[1:3] == [0, []]


def test_help_of_a_command_imports_nothing_heavy(tmp_path: Path) -> None:
    commands = [
        *("fit", "evaluate", "calibrate", "test", "panel", "measure", "demo", "records"),
        *(name for name in OPERATIONS if " " in name),
    ]
    for command, code, heavy, _ in answers(tmp_path, HEAVY, *(f"{c} --help" for c in commands)):
        assert (code, heavy) == (0, []), command


def test_a_refusal_imports_nothing_heavy(tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text("a,b\n1,2\n")
    calibration = Path(__file__).parents[2] / "examples" / "calibration-output.csv"
    (tmp_path / "calibration.csv").write_bytes(calibration.read_bytes())
    (tmp_path / "records").mkdir()
    Registry.open(tmp_path / "records").close()
    for command, code, heavy, said in answers(tmp_path, HEAVY, *REFUSED):
        assert (code, heavy) == (2, []), (command, said)


@pytest.mark.nightly
def test_only_a_report_of_a_fit_draws(tmp_path: Path) -> None:
    calibration = Path(__file__).parents[2] / "examples" / "calibration-output.csv"
    (tmp_path / "points.csv").write_bytes(calibration.read_bytes())
    drawing = ["jinja2", "matplotlib", "PIL"]
    unneeded = [*drawing, "scipy.ndimage", "torquebench.bench.description"]
    fits = ("fit points.csv --model hybrid", "fit points.csv --report a.html --report b.pdf")
    alone, reported = answers(tmp_path, unneeded, *fits)
    assert alone[1:3] == [0, []], alone
    assert reported[1] == 0, reported
    assert "matplotlib" in reported[2]
    assert {path.name for path in tmp_path.iterdir()} == {
        *("points.csv", "model.json", "a.html", "b.pdf")
    }


def test_lists_of_records_import_nothing_heavy(tmp_path: Path) -> None:
    Registry.open(tmp_path).close()
    lists = [f"records list {kind} --data ." for kind in ("runs", "all", "models", "equipment")]
    others = [name for name in HEAVY if name != "pyarrow"]  # run folders are looked into
    for command, code, heavy, said in answers(tmp_path, others, *lists):
        assert (code, heavy) == (0, []), (command, said)


FIRST_WORDS = """
import json, sys
from torquebench.cli import main

heavy, command = json.loads(sys.argv[1])

class FirstWords:
    encoding, said = "utf-8", ""

    def write(self, text):
        self.said += text
        if self.said.strip():
            print(json.dumps([self.said.strip(), sorted(set(heavy) & set(sys.modules))]))
            sys.stdout.flush()
            import os
            os._exit(0)

    def flush(self):
        pass

    def isatty(self):
        return False

sys.argv = ["torquebench", *command]
sys.stderr = FirstWords()
main()
"""


@pytest.mark.parametrize(
    ("command", "words"), [("measure", "opening"), ("doctor", "checking the installation")]
)
def test_what_takes_seconds_says_first_what_it_does(
    tmp_path: Path, command: str, words: str
) -> None:
    asked = json.dumps([HEAVY, [command]])
    told = subprocess.run(
        [sys.executable, "-c", FIRST_WORDS, asked],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    said, heavy = json.loads(told.stdout.splitlines()[-1])
    assert (words in said, heavy) == (True, [])


@pytest.mark.parametrize(
    ("command", "not_needed"),
    [
        nightly(
            "apply model.json plain.csv --out torque.parquet",
            ["matplotlib", "pandas", "scipy.optimize", "scipy.signal", "sklearn"],
        ),
        nightly(
            "fit calibration.csv --model polynomial --out other.json",
            ["pandas", "pyarrow", "scipy.interpolate", "sklearn"],
        ),
        (
            "verify model.json verification.csv",
            ["matplotlib", "pandas", "pyarrow", "scipy.signal", "sklearn"],
        ),
    ],
)
def test_a_command_imports_only_what_it_needs(
    tmp_path: Path, command: str, not_needed: list[str]
) -> None:
    examples = Path(__file__).parents[2] / "examples"
    (tmp_path / "plain.csv").write_text("reading_nm\n12.5\n")
    for name in ("calibration", "verification"):
        (tmp_path / f"{name}.csv").write_bytes((examples / f"{name}-output.csv").read_bytes())
    if "model.json" in command:
        fitted = ("--model", "polynomial", "--out", "model.json")
        assert run("fit", "calibration.csv", *fitted, cwd=tmp_path).returncode == 0
    ((_, code, imported, said),) = answers(tmp_path, not_needed, command)
    assert (code, imported) == (0, []), said


AT_REST = """
import sys
from torquebench.panel.lean_import import import_nicegui

import_nicegui()
from torquebench.panel import pages, server
from torquebench.panel.service import BenchService

pages.import_pages()
loaded = set(sys.modules)
import aiohttp  # others still find it

heavy = {"matplotlib", "pandas", "sklearn", "scipy.optimize", "scipy.signal", "scipy.special"}
print(sorted(heavy & loaded), sorted({"aiohttp", "requests", "tornado.web"} & loaded))
"""


@pytest.mark.nightly
def test_a_server_at_rest_has_no_library_for_fits_and_no_other_server() -> None:
    said = subprocess.run([sys.executable, "-c", AT_REST], capture_output=True, text=True)
    assert said.stdout == "[] []\n", said
