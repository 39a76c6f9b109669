"""All operations by name: those of torquebench, of installed packages and of Python files."""

from __future__ import annotations

import os
import re
import sys
import traceback
from collections.abc import Iterator, Mapping
from functools import cached_property
from importlib import import_module
from importlib.resources import files
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import TYPE_CHECKING

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.plugins import OPERATIONS as ADDED
from torquebench.plugins import entry_points, load

if TYPE_CHECKING:
    from torquebench.operations.operation import Operation


OWN_FILES = "TORQUEBENCH_OPERATIONS"
"""Environment variable with the paths of Python files that add operations, as in PATH."""

_PACKAGED: Mapping[str, str] = {
    "zero": "checking:ZERO",
    "calibrate": "calibrating:CALIBRATE",
    "resume": "calibrating:RESUME",
    "verification": "checking:VERIFICATION",
    "check": "checking:CHECK",
    "test": "reducers:TEST",
    "standard-reducer": "reducers:STANDARD_REDUCER",
    "record": "recording:RECORD",
    "run": "queue:RUN",
    "turn": "turning:TURN_MODULE",
    "certificate": "certificates:CERTIFICATE",
    "fit": "compensating:FIT",
    "apply": "compensating:APPLY",
    "verify": "compensating:VERIFY",
    "export": "compensating:EXPORT",
    "budget": "compensating:BUDGET",
    "evaluate static": "static:STATIC",
    "evaluate hysteresis": "evaluating:HYSTERESIS",
    "evaluate friction": "evaluating:FRICTION",
    "evaluate no-load": "evaluating:NO_LOAD",
    "evaluate breakaway": "evaluating:BREAKAWAY",
    "evaluate transmission-error": "evaluating:TRANSMISSION_ERROR",
    "evaluate efficiency": "evaluating:EFFICIENCY",
    "evaluate dynamics": "dynamics:DYNAMICS",
    "evaluate lubrication": "dynamics:LUBRICATION",
    "bench new": "bench_setup:NEW_BENCH",
    "doctor": "doctor:DOCTOR",
    "papers": "papers:PAPERS",
    "papers-tables": "papers:PAPERS_TABLES",
    "in-place": "papers:IN_PLACE",
    "mechanics additional-torque": "mechanics:ADDITIONAL_TORQUE",
    "mechanics sections": "mechanics:SECTIONS",
    "mechanics supports": "mechanics:SUPPORTS",
    "records list": "listing:LIST",
    "records show": "listing:SHOW",
    "records audit": "listing:AUDIT",
    "records verify": "keeping:VERIFY_RECORDS",
    "records amend": "keeping:AMEND",
    "records import": "static:IMPORT",
    "records export": "keeping:EXPORT_RUN",
    "records export-data": "keeping:EXPORT_DATA",
    "records equipment": "equipment:EQUIPMENT",
    "records add-equipment": "equipment:ADD_EQUIPMENT",
    "records add-certificate": "equipment:ADD_CERTIFICATE",
    "records fit-part": "equipment:FIT_PART",
    "records adjust": "equipment:ADJUST",
    "records compare": "history:COMPARE",
    "records drift": "history:DRIFT",
    "records due": "due:DUE",
    "records laboratory": "laboratory:LABORATORY",
    "records compare-models": "models:COMPARE_MODELS",
    "records fit-model": "models:FIT_MODEL",
    "records use": "models:USE",
    "records deactivate": "models:DEACTIVATE",
    "records compare-tests": "reducers:COMPARE_TESTS",
    "records review": "certificates:REVIEW",
    "records finish": "calibrating:FINISH",
    "records discard": "calibrating:DISCARD",
    "records backup": "keeping:BACKUP",
    "records restore": "keeping:RESTORE",
    "records rebuild": "keeping:REBUILD",
}
"""Module and attribute of each of torquebench's operations, by name."""


class _Operations(Mapping[str, "Operation"]):
    """Operations by name; a module is imported when one of its operations is needed."""

    def __getitem__(self, name: str) -> Operation:
        if place := _PACKAGED.get(name):
            module, _, attribute = place.partition(":")
            operation: Operation = getattr(
                import_module(f"torquebench.operations.{module}"), attribute
            )
            return operation
        return self._added[name]

    @cached_property
    def _added(self) -> dict[str, Operation]:
        """Operations of installed packages and of files."""
        added: dict[str, Operation] = {}
        for origin, operation in (*_of_packages(), *_of_files()):
            if operation.name in _PACKAGED or operation.name in added:
                raise InputError(
                    Message("{origin}: an operation {name!r}", origin, operation.name),
                    "a name that no other operation has",
                    "choose another name",
                )
            added[operation.name] = operation
        return added

    def __contains__(self, name: object) -> bool:
        return name in _PACKAGED or name in self._added

    def __iter__(self) -> Iterator[str]:
        yield from _PACKAGED
        yield from self._added

    def __len__(self) -> int:
        return len(_PACKAGED) + len(self._added)


def _of_packages() -> Iterator[tuple[str, Operation]]:
    for point in entry_points(ADDED):
        yield point.value, load(point)


def _of_files() -> Iterator[tuple[str, Operation]]:
    """Yield the operations of the files in the environment, each with its file's path.

    Raises
    ------
    InputError
        A file is missing, fails, or has no operation.
    """
    for path in filter(None, os.environ.get(OWN_FILES, "").split(os.pathsep)):
        if not Path(path).is_file():
            raise InputError(
                Message("{path}: no such file", path),
                "Python files with operations",
                Message("see --operations and the environment variable {name}", OWN_FILES),
            )
        name = f"torquebench_operations_{Path(path).stem}"
        spec = spec_from_file_location(name, path)
        assert spec is not None
        assert spec.loader is not None
        module = sys.modules[name] = module_from_spec(spec)
        try:
            spec.loader.exec_module(module)
        except Exception as error:  # a user's file may raise any exception
            frames = traceback.extract_tb(error.__traceback__)
            lines = [frame.lineno for frame in frames if frame.filename == spec.origin]
            line = error.lineno if isinstance(error, SyntaxError) else (lines or [0])[-1]
            raise InputError(
                Message(
                    "{path}, line {line}: {kind}: {error}", path, line, type(error).__name__, error
                ),
                "a Python file that can be imported",
            ) from error
        from torquebench.operations.operation import Operation

        own = [value for value in vars(module).values() if isinstance(value, Operation)]
        own = [operation for operation in own if operation.request.__module__ == name]
        if not own:
            raise InputError(
                Message("{path}: no operation", path), "a variable with an `Operation`"
            )
        yield from ((path, operation) for operation in own)


def summary_of(name: str) -> str:
    """Return an operation's summary; for torquebench's operations without importing them.

    A list of commands needs only the summaries, and importing all operations would take half as
    long again.
    """
    if name not in _PACKAGED:
        return OPERATIONS[name].summary
    module, _, attribute = _PACKAGED[name].partition(":")
    source = files("torquebench.operations").joinpath(f"{module}.py").read_text(encoding="utf-8")
    request = re.search(rf"^{attribute} = \w+\(\s*[^,]*,\s*(\w+)[,)]", source, re.MULTILINE)
    assert request is not None
    line = re.search(rf'^class {request[1]}\(.*\n    """(.*?)(?:""")?$', source, re.MULTILINE)
    assert line is not None
    return line[1]


OPERATIONS: Mapping[str, Operation] = _Operations()
"""All operations by name, in the order in which interfaces list them."""


def find_operation(name: str) -> Operation:
    """Return an operation by its name or its key.

    Raises
    ------
    InputError
        There is no operation of this name.
    """
    found = next((each for each in OPERATIONS if name in (each, each.replace(" ", "-"))), None)
    if found is None:
        raise InputError(
            Message("no operation {name!r}", name[:40]),
            Message("one of {list}", ", ".join(OPERATIONS)),
        )
    return OPERATIONS[found]
