"""Records of the data directory: found by name, exported, kept and checked."""

from __future__ import annotations

from torquebench import records
from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["find_run"]


def find_run(registry: records.Registry, name: str) -> records.RunSummary:
    """Return the run of this name, beginning of a name, or "latest".

    Raises
    ------
    InputError
        There is none, or more than one.
    """
    found = registry.runs(limit=1) if name == "latest" else registry.runs_beginning(name, limit=2)
    if len(found) == 1 or (found and found[0].run_id == name):
        return found[0]
    if found:
        raise InputError(
            Message("several runs begin with {name!r}", name), "one run", "give more of its id"
        )
    raise InputError(Message("no run {run!r}", name), "a name from the list of runs")
