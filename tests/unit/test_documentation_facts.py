"""What the documentation says about the program is so: options, profiles, figures, version."""

import re
import tomllib
from pathlib import Path
from typing import Any

import typer

from torquebench import __version__
from torquebench.cli import app

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = [
    page
    for page in (ROOT / "README.md", *DOCS.rglob("*.md"))
    if not {"_build", "generated"} & set(page.parts)
]
READ = [page for page in PAGES if "decisions" not in page.parts]
OF_ALL = {"--json", "--quiet", "--debug", "--version", "--registry", "--help"}


def text(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def command_options() -> dict[str, set[str]]:
    found: dict[str, set[str]] = {}

    def walk(command: Any, path: str) -> None:
        for name, child in getattr(command, "commands", {}).items():
            walk(child, f"{path} {name}".strip())
        if not hasattr(command, "commands"):
            found[path] = {o for p in command.params for o in (*p.opts, *p.secondary_opts)}

    walk(typer.main.get_command(app), "")
    return found


def test_the_reference_gives_a_command_only_options_that_it_has() -> None:
    known = command_options()
    wrong = []
    for line in text(DOCS / "reference" / "commands.md").splitlines():
        cells = re.match(r"\| (`.*?) \| (.*) \|$", line)
        if not cells:
            continue
        named = [
            each
            for each in known
            for code in re.findall(r"`([^`]+)`", cells[1])
            if re.match(rf"{each.split()[0]}\b", code) and set(each.split()) <= _words(cells[1])
        ]
        allowed = OF_ALL.union(*(known[each] for each in named)) if named else None
        options = re.findall(r"`(--[a-z][a-z-]+)", f"{cells[1]} {cells[2]}")
        if allowed is not None:
            wrong += [f"{named}: {each}" for each in options if each not in allowed]
    assert wrong == []


def _words(cell: str) -> set[str]:
    return {
        word
        for code in re.findall(r"`([^`]+)`", cell)
        for part in code.split()
        for word in re.split(r"[\\|]+", part)
    }


def test_benchmarks_in_the_documentation_have_the_options_that_they_are_given() -> None:
    wrong = []
    for page in READ:
        for module, options in re.findall(
            r"`python -m benchmarks\.(\w+)((?: [^`]*)?)`", text(page)
        ):
            path = ROOT / "benchmarks" / f"{module}.py"
            folder = ROOT / "benchmarks" / module
            sources = [path] if path.is_file() else sorted(folder.glob("*.py"))
            assert sources, f"{page.name}: benchmarks.{module}"
            source = "\n".join(text(each) for each in sources)
            given = re.findall(r"--[a-z-]+", options)
            wrong += [f"{page.name}: {module} {each}" for each in given if each not in source]
    assert wrong == []


def test_the_page_of_benchmarks_is_short() -> None:
    lines = text(DOCS / "benchmarks.md").splitlines()
    prose = [line for line in lines if not line.startswith(("|", "#", "<!--", "!["))]
    assert len(" ".join(prose).split()) <= 1500


def test_coverage_of_drifting_chains_is_stated_in_one_place() -> None:
    families = re.compile(r"\*(?:warming|creeping)\*[^|]{0,40}\d+ %")
    assert [page.name for page in READ if families.search(text(page))] == ["benchmarks.md"]


def test_packaged_profiles_are_all_named() -> None:
    packaged = {
        each.stem for each in (ROOT / "src/torquebench/calibration/profiles").glob("*.toml")
    }
    page = text(DOCS / "how-to" / "evaluate-a-calibration-from-elsewhere.md")
    assert {name for name in packaged if f"`{name}`" not in page} == set()


def test_every_picture_is_shown_and_screenshots_have_both_looks() -> None:
    shown = {name for page in PAGES for name in re.findall(r"images/([\w/.-]+)", text(page))}
    there = {str(path.relative_to(DOCS / "images")) for path in (DOCS / "images").rglob("*.*")}
    assert shown == there
    light = {name for name in there if name.startswith("panel/") and "-dark" not in name}
    assert {name.replace(".png", "-dark.png") for name in light} <= there


def test_the_version_stands_in_one_place_and_citation_and_changes_follow_it() -> None:
    project = tomllib.loads(text(ROOT / "pyproject.toml"))
    assert "version" in project["project"]["dynamic"]
    assert project["tool"]["hatch"]["version"]["path"] == "src/torquebench/__init__.py"
    cited = re.search(r"^version: (\S+)$", text(ROOT / "CITATION.cff"), re.M)
    newest = re.search(r"^## (\d+\.\d+\.\d+)", text(ROOT / "CHANGELOG.md"), re.M)
    assert cited is not None
    assert newest is not None
    assert {cited[1], newest[1]} == {__version__}
