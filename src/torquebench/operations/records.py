"""Find records of the data directory by name."""

from __future__ import annotations

from torquebench import records
from torquebench.errors import InputError
from torquebench.message import Message


def find_run(registry: records.Registry, name: str) -> records.RunSummary:
    """Return a run by its name, the beginning of its name, or "latest".

    Raises
    ------
    InputError
        No record has this name, or several have.
    """
    found = registry.runs(limit=1) if name == "latest" else registry.runs_beginning(name, limit=2)
    if len(found) == 1 or (found and found[0].run_id == name):
        return found[0]
    if found:
        raise InputError(
            Message("several runs begin with {name!r}", name), "one run", "give more of its id"
        )
    raise InputError(Message("no run {run!r}", name), "a name from the list of runs")


def find_calibration(registry: records.Registry, name: str) -> records.CalibrationEntry:
    """Return a calibration by a name such as calibration-3, its run's name, or "latest".

    Raises
    ------
    InputError
        No record has this name, or several have.
    RecordError
        Its run isn't sealed.
    """
    kind, _, number = name.rpartition("-")
    if kind == "calibration" and number.isdecimal():
        return registry.calibration(int(number))
    if name == "latest":
        newest = registry.calibrations(limit=1)
        if not newest:
            raise InputError("no calibration is registered", "one", "run `torquebench calibrate`")
        return newest[0]
    run = find_run(registry, name)

    from torquebench.reports.certificate import calibration_of

    return calibration_of(registry, run.run_id)
