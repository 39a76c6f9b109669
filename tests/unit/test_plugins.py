"""Packages beside the core: what they may import, and what they say of themselves."""

import ast
import importlib
import inspect
import re
import tomllib
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest

from torquebench import __version__
from torquebench.panel.beside import PanelService
from torquebench.plugins import COMMANDS, DRIVERS, SERVICES, TRANSLATIONS

ROOT = Path(__file__).parents[2]
PLUGINS = sorted(path.parent for path in ROOT.glob("plugins/*/pyproject.toml"))
GUIDE = (ROOT / "docs" / "how-to" / "write-a-plugin.md").read_text(encoding="utf-8")
PUBLIC = set(
    re.findall(r"`(torquebench[\w.]*)`", GUIDE.partition("## What a plugin may import")[2])
)
"""Modules whose public names plugins may import."""


def project(plugin: Path) -> dict[str, Any]:
    return tomllib.loads((plugin / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def sources(folder: Path) -> Iterator[tuple[Path, ast.Module]]:
    for path in sorted(folder.rglob("*.py")):
        yield path, ast.parse(path.read_text(encoding="utf-8"))


def imported(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Yield module and name of every import of a file, wherever it stands."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield from ((node.module, alias.name) for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names)


@pytest.fixture(params=PLUGINS, ids=[path.name for path in PLUGINS])
def plugin(request: pytest.FixtureRequest) -> Path:
    return request.param


def test_there_are_plugins() -> None:
    assert {path.name for path in PLUGINS} == {"opcua", "plant", "sparkplug", "teds"}


@pytest.mark.parametrize(
    "folder",
    [*(path / "src" for path in PLUGINS), ROOT / "examples" / "operations"],
    ids=lambda path: path.parent.name,
)
def test_what_is_beside_the_core_imports_public_names_of_documented_modules_only(
    folder: Path,
) -> None:
    wrong = []
    for path, tree in sources(folder):
        for module, name in imported(tree):
            if module.partition(".")[0] != "torquebench":
                continue
            public = getattr(importlib.import_module(module), "__all__", ())
            if module not in PUBLIC or name not in public:
                wrong.append(f"{path.name}: {module}.{name}")
    assert wrong == []


def test_a_plugin_knows_no_other_plugin(plugin: Path) -> None:
    others = {f"torquebench_{path.name}" for path in PLUGINS} - {f"torquebench_{plugin.name}"}
    roots = {
        module.partition(".")[0]
        for _, tree in sources(plugin / "src")
        for module, _ in imported(tree)
    }
    assert not roots & others


def test_the_core_names_no_plugin() -> None:
    """Neither in its code nor in its help: it is whole without them."""
    words = re.compile(r"torquebench[_-](opcua|plant|sparkplug|teds)\b|--(opcua|sparkplug)\b")
    found = [
        str(path.relative_to(ROOT))
        for path in (ROOT / "src").rglob("*.py")
        if words.search(path.read_text(encoding="utf-8"))
    ]
    assert found == []


def test_versions_agree_and_the_core_is_required(plugin: Path) -> None:
    stated = project(plugin)
    assert stated["name"] == f"torquebench-{plugin.name}"
    assert stated["version"] == __version__
    assert any(re.match(r"torquebench(\[[\w,]+\])?[<>=]", each) for each in stated["dependencies"])


def test_every_entry_point_gives_what_its_group_is_for(plugin: Path) -> None:
    groups = project(plugin)["entry-points"]
    assert set(groups) <= {COMMANDS, DRIVERS, SERVICES, TRANSLATIONS}
    for group, points in groups.items():
        for name, value in points.items():
            thing = EntryPoint(name, value, group).load()
            if group == SERVICES:
                assert isinstance(thing, PanelService)
                assert thing.option == name
            elif group == TRANSLATIONS:
                assert list((Path(inspect.getfile(thing)).parent / "translations").glob("*/*.toml"))
            else:
                assert callable(thing)


def test_every_translated_text_is_in_the_plugin_source(plugin: Path) -> None:
    from tests.unit.panel.test_panel_core_words import constants, key

    said = set()
    for _, tree in sources(plugin / "src"):
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                said.add(node.value)
            elif isinstance(node, ast.Call) and ast.unparse(node.func) == "Message":
                said |= {key(text) for text in constants(node.args[0])}
    stale = [
        english
        for file in (plugin / "src").rglob("translations/*/*.toml")
        for section in tomllib.loads(file.read_text(encoding="utf-8")).values()
        for english in section
        if english not in said and english.lower().replace(" ", "_") not in said
    ]
    assert stale == []
