"""All operations by name: those of the package, and those that files and packages add."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import cached_property
from importlib import import_module
from importlib.metadata import entry_points
from importlib.resources import files
from typing import TYPE_CHECKING

from torquebench.errors import InputError
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.operations.operation import Operation

__all__ = ["ENTRY_POINTS", "OPERATIONS", "find_operation", "summary_of"]

ENTRY_POINTS = "torquebench.operations"
"""Group of the entry points by which an installed package adds operations."""

_PACKAGED: Mapping[str, str] = {
    "zero": "checking:ZERO",
    "calibrate": "calibrating:CALIBRATE",
    "resume": "calibrating:RESUME",
    "verification": "checking:VERIFICATION",
    "check": "checking:CHECK",
    "test": "reducers:TEST",
    "standard-reducer": "reducers:STANDARD_REDUCER",
    "record": "recording:RECORD",
    "certificate": "certificates:CERTIFICATE",
    "records compare-models": "models:COMPARE_MODELS",
    "records fit-model": "models:FIT_MODEL",
    "records use": "models:USE",
    "records deactivate": "models:DEACTIVATE",
    "records compare-tests": "reducers:COMPARE_TESTS",
    "records review": "certificates:REVIEW",
    "records finish": "calibrating:FINISH",
    "records discard": "calibrating:DISCARD",
}
"""Where the package's operations are, by name."""


class _Operations(Mapping[str, "Operation"]):
    """Operations by name; a module is imported when one of its operations is needed."""

    @cached_property
    def _places(self) -> dict[str, str]:
        package = "torquebench.operations"
        places = {name: f"{package}.{place}" for name, place in _PACKAGED.items()}
        for point in entry_points(group=ENTRY_POINTS):
            places.setdefault(point.name.replace("_", " "), point.value)
        return places

    def __getitem__(self, name: str) -> Operation:
        module, _, attribute = self._places[name].partition(":")
        operation: Operation = getattr(import_module(module), attribute)
        return operation

    def __contains__(self, name: object) -> bool:
        return name in self._places

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


def summary_of(name: str) -> str:
    """Return the first line about a packaged operation from its source, without importing it.

    A list of commands needs no more, and would take half as long again with all libraries.
    """
    module, _, attribute = _PACKAGED[name].partition(":")
    source = files("torquebench.operations").joinpath(f"{module}.py").read_text(encoding="utf-8")
    found = re.search(rf"^{attribute} = Operation\(\s*[^,]*,\s*(\w+),", source, re.MULTILINE)
    assert found is not None
    line = re.search(rf'^class {found[1]}\(.*\n    """(.*?)(?:""")?$', source, re.MULTILINE)
    assert line is not None
    return line[1]


OPERATIONS: Mapping[str, Operation] = _Operations()
"""All operations by name, in the order in which interfaces list them."""


def find_operation(name: str) -> Operation:
    """Return an operation by its name or its key.

    Raises
    ------
    InputError
        There is none.
    """
    found = next((each for each in OPERATIONS if name in (each, each.replace(" ", "-"))), None)
    if found is None:
        raise InputError(
            Message("no operation {name!r}", name[:40]),
            Message("one of {list}", ", ".join(OPERATIONS)),
        )
    return OPERATIONS[found]
