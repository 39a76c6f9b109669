"""The documentation's code is a reader's: Python runs, commands are understood and run offline."""

import contextlib
import doctest
import io
import os
import re
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from tests.support.draws import nightly
from typer.core import TyperGroup

from torquebench.cli import main, whole_command
from torquebench.records import Registry

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    str(page.relative_to(ROOT))
    for page in (
        ROOT / "README.md",
        *(ROOT / "docs").rglob("*.md"),
        *(ROOT / "plugins").glob("*/docs/*.md"),
    )
    if not {"decisions", "generated", "project"} & set(page.parts)
)
NEED_A_SERVER = {"docs/reference/http-api.md"}  # run by test_http_api_client
OFFLINE = {"apply", "budget", "evaluate", "export", "fit", "verify"}
"""Commands that need nothing but files."""
RECORDS = {"add-certificate", "add-equipment", "adjust", "equipment", "fit-part", "list"}
NEED_RECORDINGS = {"steps.csv", "cold.csv", "chain.json", "dynamics.json", "empty.csv"}
"""Files of a turning bench: test_documentation_bench runs what reads them."""
OF_OTHERS = {
    "Tare-torque.csv",
    "base_runin1.csv",
    "transmission_stiffness_cpg.csv",
    "cpg_backlash_sine_vel_2.500tps_2.00s.csv",
}
"""Public recordings that aren't part of the project."""
LONGEST = "docs/how-to/work-in-python.md"
ALLOWED = (0, 1)  # 1: a finding about the example's points, as it is documented
FENCE = re.compile(r"^[ ]*```(\w*)\n(.*?)^[ ]*```", re.S | re.M)


def blocks(page: str, *languages: str) -> list[str]:
    text = (ROOT / page).read_text(encoding="utf-8")
    found = [
        (language, "\n".join(line.removeprefix(" " * _indent(body)) for line in body.splitlines()))
        for language, body in FENCE.findall(text)
    ]
    return [body for language, body in found if language in languages]


def _indent(body: str) -> int:
    return min((len(line) - len(line.lstrip()) for line in body.splitlines() if line), default=0)


def commands(page: str) -> Iterator[list[str]]:
    """Yield the words of every torquebench command of a page.

    Those of a user's own operations are run by `test_own_operation`: they exist in a process only.
    """
    for block in blocks(page, "", "sh", "bash", "console"):
        for line in block.replace("\\\n", " ").splitlines():
            line = line.strip().removeprefix("$ ").partition(" > ")[0]
            if line.startswith("torquebench ") and "…" not in line:
                words = shlex.split(line, comments=True)[1:]
                if words[0] != "--operations":
                    yield words


WITH_PYTHON = [page for page in PAGES if blocks(page, "python") and page not in NEED_A_SERVER]
WITH_COMMANDS = [page for page in PAGES if list(commands(page))]


@pytest.fixture
def reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a reader who has the examples and tables of the names that pages use."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    (tmp_path / "bench.toml").symlink_to(ROOT / "examples" / "bench.toml")
    for example, names in (
        ("calibration-output.csv", ("calibration.csv", "data.csv")),
        ("verification-output.csv", ("fresh.csv", "fresh-points.csv")),
        ("readings-output.csv", ("readings.csv",)),
    ):
        lines = (ROOT / "examples" / example).read_text(encoding="utf-8").splitlines()
        own = "\n".join(line for line in lines if not line.startswith("#")) + "\n"
        for name in names:
            (tmp_path / name).write_text(own, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def loops() -> str:
    """Three torque-angle loops of an RV reducer: N·m beside revolutions."""
    phase = np.linspace(0.0, 6.0 * np.pi, 901)
    torque = 412.0 * (2.0 / np.pi) * np.arcsin(-np.cos(phase))
    angle = torque / 110.0 - 0.3 * np.tanh(20.0 * np.sin(phase))
    rows = zip(torque, angle / 21600.0, strict=True)
    return "\n".join(["Torque,Position", *(f"{t:.6f},{a:.12f}" for t, a in rows)]) + "\n"


def run(words: list[str], monkeypatch: pytest.MonkeyPatch) -> tuple[object, str]:
    monkeypatch.setattr(sys, "argv", ["torquebench", *words])
    told = io.StringIO()
    with contextlib.redirect_stdout(told), contextlib.redirect_stderr(told):
        try:
            main()
        except SystemExit as end:
            return end.code or 0, told.getvalue()
    return 0, told.getvalue()


@pytest.mark.parametrize(
    "page", [nightly(page) if page == LONGEST else page for page in WITH_PYTHON]
)
def test_python_of_a_page_runs(page: str, reader: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names: dict[str, object] = {"__name__": "__main__"}
    text = "\n".join(blocks(page, "python"))
    if text.lstrip().startswith(">>>"):
        options = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
        examples = doctest.DocTestParser().get_doctest(text, names, page, page, 0)
        result = doctest.DocTestRunner(optionflags=options).run(examples)
        assert result.failed == 0, capsys.readouterr().out
    else:
        exec(compile(text, page, "exec"), names)


@pytest.mark.parametrize("page", WITH_COMMANDS)
def test_commands_of_a_page_are_understood(page: str) -> None:
    root = whole_command()
    for words in commands(page):
        command, context, rest = root, None, words
        while isinstance(command, TyperGroup):
            context = command.make_context(command.name or "torquebench", [rest[0]], parent=context)
            found = command.get_command(context, rest[0])
            assert found is not None, f"{page}: {' '.join(words)}"
            command, rest = found, rest[1:]
        command.make_context(command.name or "", list(rest), parent=context)


def runs_offline(words: list[str]) -> bool:
    if (NEED_RECORDINGS | OF_OTHERS) & set(words) or words[:2] == ["records", "import"]:
        return False
    if words[0] == "records":
        return words[1] in RECORDS and "calibration-3" not in words
    return words[0] in OFFLINE or ("--dry-run" in words and words[0] == "calibrate")


OFFLINE_PAGES = [page for page in WITH_COMMANDS if any(map(runs_offline, commands(page)))]
TUTORIAL = "docs/tutorial.md"


@pytest.mark.parametrize(
    "page", [page if page == TUTORIAL else nightly(page) for page in OFFLINE_PAGES]
)
def test_offline_commands_of_a_page_run(
    page: str, reader: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Registry.open(Path(os.environ["TORQUEBENCH_DATA"])).close()
    (reader / "loops.csv").write_text(loops(), encoding="utf-8")
    for words in filter(runs_offline, commands(page)):
        code, told = run(words, monkeypatch)
        assert code in ALLOWED, f"{page}: torquebench {' '.join(words)}\n{told}"


def test_every_page_with_code_is_looked_at() -> None:
    assert {"README.md", TUTORIAL} <= set(OFFLINE_PAGES)
    assert len(WITH_PYTHON) >= 6
    assert len(WITH_COMMANDS) >= 12


def test_the_readme_shows_what_its_commands_print(
    reader: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Line by line, in order: the same words, and numbers that differ by a few percent at most."""
    shown = blocks("README.md", "text")
    assert len(shown) == len(list(commands("README.md"))) == 3
    for words, output in zip(commands("README.md"), shown, strict=True):
        code, told = run(words, monkeypatch)
        assert code == 0, f"torquebench {' '.join(words)}\n{told}"
        printed = iter([line.split() for line in told.splitlines()])
        for line in output.splitlines():
            assert any(_alike(line.split(), one) for one in printed), f"{line}\n\n{told}"


def _alike(shown: list[str], printed: list[str]) -> bool:
    return len(shown) == len(printed) and all(map(_same, shown, printed))


def _same(shown: str, printed: str) -> bool:
    try:
        return float(shown) == pytest.approx(float(printed), rel=0.05)
    except ValueError:
        return shown == printed
