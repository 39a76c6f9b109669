"""Packages that import their public names when somebody asks."""

import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import torquebench

ROOT = Path(torquebench.__file__).parent
PACKAGES = sorted(
    ".".join(("torquebench", *stub.parent.relative_to(ROOT).parts))
    for stub in ROOT.rglob("__init__.pyi")
)


@pytest.mark.parametrize("name", PACKAGES)
def test_every_public_name_is_there_and_no_module_replaces_it(name: str) -> None:
    package = import_module(name)
    folder = Path(str(package.__file__)).parent
    assert package.__all__
    for public in package.__all__:
        assert hasattr(package, public)
        assert not (folder / f"{public}.py").exists(), f"importing {name}.{public} replaces it"


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match=r"torquebench\.signals.*nothing"):
        import_module("torquebench.signals").nothing  # noqa: B018


def test_a_package_imports_none_of_its_modules() -> None:
    code = (
        f"import sys, {', '.join(PACKAGES)}\n"
        "print([m for m in sys.modules if m in ('numpy', 'scipy', 'sklearn', 'pydantic')])"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == "[]"
