"""Every how-to command that needs a bench runs on the simulated one, in the order of its page.

Each page has a copy of one data directory with a sealed calibration, its verification and an
interrupted run. Words that stand for a reader's own names are replaced; nothing else is.
"""

import itertools
import re
import shutil
import unicodedata
from collections.abc import Callable, Iterator
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from tests.support.draws import nightly
from tests.system.command_line import run_python
from tests.system.killed_calibrations import KILLED
from tests.system.test_documentation_snippets import (
    ALLOWED,
    OF_OTHERS,
    PAGES,
    ROOT,
    blocks,
    commands,
    run,
    runs_offline,
)
from tests.system.test_dynamics_commands import CHAIN
from tests.system.test_dynamics_commands import write as write_quick
from tests.system.test_turning_chain_commands import write as write_turning
from tests.unit.chain.test_turning_chains import calibration, empty_run
from tests.unit.dynamics import test_identification as identification
from tests.unit.dynamics.simulated_chain import sines, steps

from torquebench.cli import whole_command

ELSEWHERE = {
    ("panel",): "test_http_api_client.py",  # and all that the panel does
    ("demo", "--bench", "examples/networked.toml", "--quick"): "test_networked_bench.py",
    ("papers",): "test_papers_command.py",
    ("simulate",): "test_networked_bench.py",
    ("plant",): "test_plant_commands.py",
    ("teds",): "test_teds_commands.py",
    ("certificate", "calibration-1"): "test_certificate_command.py",
    ("records", "compare-tests"): "test_reducer_test_command.py",
}
"""Commands that end by Ctrl-C only, take minutes or need a server: run there."""
WITHOUT_END = {"measure": ("--count", "1")}
"""Commands that go on until Ctrl-C, and what ends them."""
LONG = ("adaptive", "small-torques", "--repeats", "harmonic-20", "dynamics")
"""Long on a bench and run by tests of their own: here a dry run asks every limit and interlock."""
WITHOUT_RECORDS = ("issue-a-certificate", "evaluate-an-external-calibration")
"""Pages whose reader begins with an empty data directory."""
BY_DAY = "docs/how-to/evaluate-an-external-calibration.md"
PLACES = {"/mnt/backup/bench-4": "backup", "FOLDER": "exported", "T40B-1234": "SIM-T2000"}


def elsewhere(words: list[str]) -> bool:
    return any(tuple(words[: len(each)]) == each for each in ELSEWHERE)


BENCH_PAGES = [
    page
    for page in PAGES
    if page.startswith("docs/how-to/")
    and any(
        not (runs_offline(words) or elsewhere(words) or OF_OTHERS & set(words))
        for words in commands(page)
    )
]


@pytest.fixture(scope="module")
def worked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data directory in which the output was calibrated twice and verified."""
    data = tmp_path_factory.mktemp("worked") / "data"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TORQUEBENCH_DATA", str(data))
        for words in (
            ["calibrate", "output", "--step", "20", "--model", "hybrid", "--yes"],
            ["calibrate", "output", "--step", "20", "--model", "polynomial", "--yes"],
            ["verification", "output", "--groups", "2", "--points", "6"],
        ):
            code, told = run(words, patch)
            assert code in ALLOWED, told
    return data


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Data directories whose only calibration was killed in its second series."""
    folder = tmp_path_factory.mktemp("killed")
    child = run_python(KILLED, folder, "events-12", "events-13", cwd=folder)
    assert child.returncode == 0, child.stderr
    return folder


@pytest.fixture
def reader(
    request: pytest.FixtureRequest,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> Callable[[str], Path]:
    """Return what makes the folder of a page's reader, with the files that the page names."""

    def folder(page: str) -> Path:
        name = Path(page).stem
        if name in WITHOUT_RECORDS:
            (tmp_path / "data").mkdir()
        else:
            shutil.copytree(request.getfixturevalue("worked"), tmp_path / "data")
        (tmp_path / "examples").symlink_to(ROOT / "examples")
        (tmp_path / "bench.toml").symlink_to(ROOT / "examples" / "bench.toml")
        if name == "resume-a-calibration":
            killed = request.getfixturevalue("killed")
            for place, events in (("data", "events-12"), ("discarded", "events-13")):
                shutil.rmtree(tmp_path / place, ignore_errors=True)
                shutil.copytree(killed / events, tmp_path / place)
        elif name == "issue-a-certificate":
            (tmp_path / "data" / "laboratory.toml").write_text(blocks(page, "toml")[0], "utf-8")
        elif name == "evaluate-an-external-calibration":
            external_table(tmp_path)
        elif name == "measure-quick-torques":
            quick_tables(tmp_path)
        elif name == "measure-while-it-turns":
            turning_tables(tmp_path)
        elif name == "test-a-reducer":
            packaged = resources.files("torquebench.reducers") / "types" / "standard.toml"
            certificate, mark, certified = next(
                each for each in blocks(page, "toml") if "certified" in each
            ).partition("[[")
            text = packaged.read_text("utf-8")
            (tmp_path / "standard.toml").write_text(
                f"{certificate}{text}\n{mark}{certified}", "utf-8"
            )
        monkeypatch.chdir(tmp_path)
        monkeypatch.setenv("TORQUEBENCH_DATA", str(tmp_path / "data"))
        return tmp_path

    return folder


def external_table(folder: Path) -> None:
    """A table that says nothing of its bench, and a laboratory that it is entered in."""
    issue = "docs/how-to/issue-a-certificate.md"
    (folder / "data" / "laboratory.toml").write_text(blocks(issue, "toml")[0], "utf-8")
    lines = (ROOT / "examples" / "calibration-output.csv").read_text("utf-8").splitlines()
    own = "\n".join(line for line in lines if not line.startswith("#"))
    (folder / "data.csv").write_text(own + "\n", "utf-8")


def quick_tables(folder: Path) -> None:
    for name, torque, duration_s in (("steps", steps, 0.09), ("sines", sines, 0.25)):
        columns = CHAIN.run(torque, duration_s)
        write_quick(folder / f"{name}.csv", "time_s,reading_nm,standard_nm", *columns)
    write_quick(folder / "empty.csv", "time_s,reading_nm,speed_rpm", *identification.empty_run())
    shutil.copy(folder / "steps.csv", folder / "readings.csv")
    standard = np.linspace(-50.0, 50.0, 41)
    write_quick(folder / "data.csv", "reading_nm,standard_nm", standard * 0.998, standard)


def turning_tables(folder: Path) -> None:
    points = calibration()
    assert points.temperature_c is not None
    columns = (points.reading_nm, points.standard_nm, points.branch, points.temperature_c)
    names = "reading_nm,standard_nm,branch,temperature_c"
    write_turning(folder / "calibration.csv", names, *columns)
    for number, (name, celsius) in enumerate((("cold", 12.0), ("hall", 23.0), ("warm", 38.0))):
        each = empty_run(celsius, number)
        known = (each.time_s, each.reading_nm, each.speed_rpm, each.temperature_c)
        names = "time_s,reading_nm,speed_rpm,temperature_c"
        write_turning(folder / f"{name}.csv", names, *known)
        write_turning(folder / "readings.csv", names, *known)
    still = np.zeros(points.reading_nm.size)
    write_turning(
        folder / "points.csv",
        "reading_nm,standard_nm,branch,temperature_c,speed_rpm",
        *columns,
        still,
    )


def bench_commands(page: str, folder: Path, data: Path) -> Iterator[list[str]]:
    """Yield what is run of a page, with the reader's own names in place of the page's."""
    for words in commands(page):
        if elsewhere(words) or OF_OTHERS & set(words):
            continue
        words = [PLACES.get(word, word) for word in words]
        if words[:2] == ["records", "use"]:
            words[2] = "model-1"
        if "calibration-3" in words:
            words[words.index("calibration-3")] = "calibration-2"
        if words[:2] == ["records", "discard"]:
            words = [*words, "--data", str(folder / "discarded")]
            words[2] = next((folder / "discarded" / "runs").iterdir()).name
        if "RUN" in words:
            words[words.index("RUN")] = "latest"
        if "CERTIFICATE.pdf" in words:
            found = sorted(data.glob("certificates/*/*.pdf"))
            words[words.index("CERTIFICATE.pdf")] = str(found[0])
        yield [*words, *WITHOUT_END.get(words[0], ())]


def test_commands_of_the_pages_have_these_options() -> None:
    whole = whole_command()
    for words in itertools.chain.from_iterable(map(commands, BENCH_PAGES)):
        command, context, rest = whole, None, list(words)
        while True:
            context = command.make_context(command.name, rest, parent=context)
            if not hasattr(command, "get_command"):
                break
            rest = [*context._protected_args, *context.args]
            command = command.get_command(context, rest.pop(0))
            assert command is not None, words


@pytest.mark.timeout(900)
@pytest.mark.parametrize("page", [BY_DAY, *map(nightly, sorted({*BENCH_PAGES} - {BY_DAY}))])
def test_every_command_of_a_page_runs(
    page: str, reader: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = reader(page)
    for words in bench_commands(page, folder, folder / "data"):
        if words[0] in ("calibrate", "test", "turn") and any(mark in words for mark in LONG):
            words = [*words, "--dry-run"]
        if words[0] == "apply" and "--dynamics" in words:
            assert run(["fit", "data.csv", "--model", "polynomial"], monkeypatch)[0] == 0
        code, told = run(words, monkeypatch)
        assert code in ALLOWED, f"{page}: torquebench {' '.join(words)}\n{told}"
    assert not unportable(folder)


RESERVED = {
    "con",
    "prn",
    "aux",
    "nul",
    *(f"{port}{number}" for port in ("com", "lpt") for number in range(1, 10)),
}


def unportable(folder: Path) -> list[str]:
    """Return files whose names Windows or macOS refuses, changes or takes for another's."""
    seen: set[str] = set()
    refused = []
    for path in sorted(folder.rglob("*")):
        name, whole = path.name, unicodedata.normalize("NFC", str(path.relative_to(folder)))
        legal = not re.search(r'[<>:"\\|?*\x00-\x1f]|[. ]$', name) and len(whole) < 150
        if not legal or name.split(".")[0].lower() in RESERVED or whole.casefold() in seen:
            refused.append(whole)
        seen.add(whole.casefold())
    return refused


def test_names_that_other_systems_refuse_are_found(tmp_path: Path) -> None:
    for name in ("a:b", "nul.txt", "end.", "run", "Run", "free.csv"):
        (tmp_path / name).touch()
    assert unportable(tmp_path) == ["a:b", "end.", "nul.txt", "run"]
