"""The papers' page, as a user makes it: measured, and made again from its own tables."""

import re
from pathlib import Path

import pytest
from tests.system.command_line import run, widest_line


def words(page: str) -> str:
    """Return a page without its figures."""
    return re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL)


def test_a_quick_page_and_the_same_one_from_its_tables(tmp_path: Path) -> None:
    command = ["papers", "--quick", "--no-study"]
    result = run(*command, "--out", "a.html", "--out", "a.pdf", "--save", "tables", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert widest_line(result.stdout) <= 80
    assert "- simulated" in result.stdout
    assert not (tmp_path / "torquebench-data").exists()
    page = (tmp_path / "a.html").read_text()
    assert "every figure on this page is simulated" in page
    for number in range(1, 22):
        assert re.search(rf"<h2>{number}\. ", page), number
    assert page.count("<svg") >= 11
    assert (tmp_path / "a.pdf").read_bytes().startswith(b"%PDF")

    again = run(*command, "--data", "tables", "--out", "b.html", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    assert words((tmp_path / "b.html").read_text()) == words(page)


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
