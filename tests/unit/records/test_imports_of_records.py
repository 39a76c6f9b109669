"""Records are opened without the libraries that they don't need."""

import subprocess
import sys

import pytest

import torquebench
from torquebench import records


def loaded_by(statement: str) -> set[str]:
    code = f"import sys\n{statement}\nsys.stderr.write(' '.join(sys.modules))"
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    return {name.partition(".")[0] for name in result.stderr.split()}


def test_opening_a_registry_loads_no_numerics() -> None:
    loaded = loaded_by("from torquebench.records import Registry")
    assert "sqlalchemy" in loaded
    assert not loaded & {"scipy", "sklearn", "numba", "pandas"}


def test_every_public_name_is_there() -> None:
    for name in records.__all__:
        assert getattr(records, name) is not None
    assert set(records.__all__) <= set(dir(records))
    with pytest.raises(AttributeError, match="nothing"):
        _ = records.nothing
    with pytest.raises(AttributeError, match="nothing"):
        _ = torquebench.nothing
    assert torquebench.__version__
