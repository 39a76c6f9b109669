"""The papers' page, as a user makes it: measured, and made again from its own tables."""

import re
from html import unescape
from pathlib import Path

import pytest
from tests.system.command_line import COMMAND, environment, prepared, run, widest_line
from tests.system.networked import simulating

from torquebench.papers.items import ITEMS


def words(page: str) -> str:
    """Return a page without its figures."""
    return re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL)


PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "papers-item-by-item.md"
THEIRS = re.compile(r"Papers: (.*?)\. Here: ", re.DOTALL)


@pytest.mark.nightly
def test_a_quick_page_of_the_simulated_bench(tmp_path: Path) -> None:
    result = run("papers", "--no-study", "--out", "a.pdf", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert widest_line(result.stdout) <= 80
    assert "- simulated" in result.stdout
    assert not (tmp_path / "torquebench-data").exists()
    assert (tmp_path / "a.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.nightly
def test_tables_of_a_bench_over_sockets_make_the_page(tmp_path: Path) -> None:
    with simulating(tmp_path) as (bench, _):
        mounted = ("--mounting", "coaxiality_mm=0.012", "--mounting", "lubricant=oil 7")
        result = run(
            *("papers-tables", "--quick", "--bench", bench, "--yes", "--out", "tables", *mounted),
            cwd=tmp_path,
        )
    assert result.returncode == 0, result.stderr
    made = run("papers", "tables", "--no-study", "--out", "a.html", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    first = (tmp_path / "a.html").read_text()

    assert "every figure on this page is simulated" in first
    assert "0.012 mm (≤ 0.03 mm)" in first
    assert "oil 7" in first
    *sections, last = re.split(r"<h2[^>]*>", first)[2:]
    assert last.startswith("Beyond the papers")
    assert [int(each.partition(".")[0]) for each in sections] == list(range(1, 23))
    for number, section in enumerate(sections, 1):
        if number != 15:  # the study was omitted
            assert "<svg" in section or "<table" in section or "<dl" in section, number
        theirs = THEIRS.search(section)
        assert theirs is not None
        assert unescape(theirs[1]) == ITEMS[number].theirs
    log = (tmp_path / "torquebench-data").rglob("*audit*")
    moved = "".join(each.read_text() for each in log if each.is_file())
    assert '"guide rail"' in moved


HERE = re.compile(r"\. Here: (.*?) Command: ", re.DOTALL)
OF_THE_FIRST_BENCH = (*range(1, 14), *range(19, 23))
"""Items whose figures are those of seed 1, or computed."""


@pytest.mark.nightly
@pytest.mark.timeout(1800)
def test_the_documentations_page_has_the_figures_of_this_version(tmp_path: Path) -> None:
    """Otherwise: python -m benchmarks.papers_page --write."""
    command = [COMMAND, "papers", "--whole", "--seeds", "1", "--no-study", "--out", "a.html"]
    result = prepared().run(command, tmp_path, environment(), 1500.0)
    assert result.returncode == 0, result.stderr
    text = unescape(re.sub(r"<[^>]+>", "", words((tmp_path / "a.html").read_text())))
    measured = [found.split() for found in HERE.findall(text)]
    shown = [found.split() for found in HERE.findall(PAGE.read_text(encoding="utf-8"))]
    assert len(measured) == len(shown) == len(ITEMS)
    for number in OF_THE_FIRST_BENCH:
        here, there = measured[number - 1], shown[number - 1]
        assert len(here) == len(there), f"item {number}: {here}"
        assert all(map(_same, there, here)), f"item {number}: {here}, {there}"


def _same(shown: str, measured: str) -> bool:
    """Return whether two words are equal, numbers to 2 %: linear algebra differs by processor."""
    try:
        return float(shown.strip("(%;)")) == pytest.approx(float(measured.strip("(%;)")), rel=0.02)
    except ValueError:
        return shown == measured


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["papers", "none"], "no folder none"),
        (["papers", "--out", "page.docx"], "page.docx"),
        (["papers-tables", "--reducer", "rv-40e"], "no certified_friction"),
    ],
)
def test_bad_arguments_are_refused(tmp_path: Path, arguments: list[str], message: str) -> None:
    result = run(*arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert message in " ".join(result.stderr.split())
