"""No file imports itself through others: whoever reads one file needn't read five at once."""

import ast
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import torquebench

SOURCE = Path(torquebench.__file__).parent


def name_of(path: Path) -> str:
    parts = ("torquebench", *path.relative_to(SOURCE).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported(path: Path, modules: dict[str, Path]) -> Iterator[str]:
    """Yield every module of this package that a file imports, anywhere in it, for types too.

    An import by a name that is written out counts; one by a name that is put together, as of a
    kind of model or a protocol, doesn't.
    """
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                yield inner if inner in modules else node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith("import_module"):
            yield from (each.value for each in node.args if isinstance(each, ast.Constant))


@pytest.fixture(scope="module")
def graph() -> dict[str, set[str]]:
    modules = {name_of(path): path for path in SOURCE.rglob("*.py")}
    return {
        name: {other for other in imported(path, modules) if other in modules and other != name}
        for name, path in modules.items()
    }


def test_no_file_imports_in_a_circle(graph: dict[str, set[str]]) -> None:
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as circle:
        raise AssertionError(" imported by ".join(circle.args[1])) from None
