"""The papers' page, as a user makes it: measured, and made again from its own tables."""

import re
from html import unescape
from pathlib import Path

import pytest
from tests.system.command_line import run, widest_line
from tests.system.networked import simulating

from torquebench.papers.items import ITEMS


def words(page: str) -> str:
    """Return a page without its figures."""
    return re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL)


THEIRS = re.compile(r"Papers: (.*?)\. Here: ", re.DOTALL)


def test_a_quick_page_of_the_simulated_bench(tmp_path: Path) -> None:
    result = run("papers", "--quick", "--no-study", "--out", "a.pdf", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert widest_line(result.stdout) <= 80
    assert "- simulated" in result.stdout
    assert not (tmp_path / "torquebench-data").exists()
    assert (tmp_path / "a.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.nightly
def test_a_bench_over_sockets_and_its_recorded_folder_give_the_same_page(tmp_path: Path) -> None:
    page = ("papers", "--quick", "--no-study")
    with simulating(tmp_path) as (bench, _):
        mounted = ("--mounting", "coaxiality_mm=0.012", "--mounting", "lubricant=oil 7")
        result = run(
            *(*page, "--bench", bench, "--yes", "--out", "a.html", "--save", "tables", *mounted),
            cwd=tmp_path,
        )
    assert result.returncode == 0, result.stderr
    first = (tmp_path / "a.html").read_text()
    again = run(*page, "--data", "tables", "--out", "b.html", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    assert words((tmp_path / "b.html").read_text()) == words(first)

    assert "every figure on this page is simulated" in first
    assert "0.012 mm (≤ 0.03 mm)" in first
    assert "oil 7" in first
    sections = re.split(r"<h2[^>]*>", first)[2:]
    assert [int(each.partition(".")[0]) for each in sections] == list(range(1, 22))
    for number, section in enumerate(sections, 1):
        if number != 15:  # the study was omitted
            assert "<svg" in section or "<table" in section or "<dl" in section, number
        theirs = THEIRS.search(section)
        assert theirs is not None
        assert unescape(theirs[1]) == ITEMS[number].theirs
    log = (tmp_path / "torquebench-data").rglob("*audit*")
    moved = "".join(each.read_text() for each in log if each.is_file())
    assert '"guide rail"' in moved


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--data", "none"], "no folder none"),
        (["--out", "page.docx"], "page.docx"),
        (["--bench", "bench.toml", "--data", "."], "one of both"),
        (["--reducer", "rv-40e"], "no certified_friction"),
        (["--data", ".", "--save", "x"], "--data alone"),
    ],
)
def test_bad_arguments_are_refused(tmp_path: Path, arguments: list[str], message: str) -> None:
    result = run("papers", *arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert message in " ".join(result.stderr.split())
