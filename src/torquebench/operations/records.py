"""Records of the data directory: found by name, exported, kept and checked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import field as dataclass_field
from pathlib import Path
from typing import Annotated, Any

from torquebench import records
from torquebench.campaign.calibration_comparison import (
    CalibrationComparison,
    CalibrationStep,
    compare_calibrations,
)
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations.operation import Calibration, Operation, Request, field
from torquebench.operations.place import Place
from torquebench.operations.result import HIDDEN, Result
from torquebench.progress import Progress
from torquebench.reports.page import Page

__all__ = ["COMPARE", "find_calibration", "find_run"]


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


def find_calibration(registry: records.Registry, name: str) -> records.CalibrationEntry:
    """Return the calibration of a name such as calibration-3, of a run, or the latest.

    Raises
    ------
    InputError
        There is none, or more than one.
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

    from torquebench.reports.certificate import calibration_of

    return calibration_of(registry, find_run(registry, name).run_id)


# -- compare --------------------------------------------------------------------------------


class CompareRequest(Request):
    """Compare two calibrations of one transducer, step by step.

    A change is significant if it exceeds the uncertainties of both calibrations (E_n beyond ±1).
    Only the common range of torques is compared.
    """

    first: Calibration
    second: Calibration
    out: Annotated[
        Path | None, field("Write the steps as CSV.", local=True, output=(".csv", ".txt", ".tsv"))
    ] = None


@dataclass(frozen=True, kw_only=True)
class ComparedCalibrations(Result):
    """Two calibrations of one transducer, by the time at which they were performed."""

    before: str
    after: str
    transducer_serial: str
    low_nm: float
    high_nm: float
    steps: Sequence[CalibrationStep]
    comparison: Any = dataclass_field(metadata=HIDDEN)

    def page(self) -> Page:
        """Return its description."""
        from torquebench.reports.calibration_comparison import calibration_comparison_page

        return calibration_comparison_page(self.comparison)


def run_compare(place: Place, request: CompareRequest, _progress: Progress) -> ComparedCalibrations:
    """Compare, and write the steps where a file is named."""
    names = (request.first, request.second)
    entries = [find_calibration(place.registry, name) for name in names]
    found = compare_calibrations(place.registry, *(each.calibration_id for each in entries))
    if request.out is not None:
        _write_steps(found, request.out)
    return ComparedCalibrations(
        headline=Message("{verdict}.", found.verdict()),
        simulated=found.simulated,
        run_ids=tuple(
            str(each.entry.run_id) for each in (found.before, found.after) if each.entry.run_id
        ),
        remarks=found.remarks,
        before=found.before.name,
        after=found.after.name,
        transducer_serial=found.after.entry.transducer_serial,
        low_nm=found.low_nm,
        high_nm=found.high_nm,
        steps=found.steps,
        comparison=found,
    )


def _write_steps(found: CalibrationComparison, path: Path) -> None:
    from dataclasses import astuple

    from torquebench.atomic_write import atomic_write

    lines = [f"# before = {found.before.name}", f"# after = {found.after.name}"]
    lines += ["# simulated = true"] * found.simulated
    lines.append("reading_nm,branch,before_nm,after_nm,change_nm,expanded_uncertainty_nm,e_n")
    lines += [",".join(map(repr, astuple(step))) for step in found.steps]
    atomic_write(path, ("\n".join(lines) + "\n").encode())


COMPARE = Operation(
    "records compare",
    CompareRequest,
    run_compare,
    lambda request: Message("Compare {first} with {second}", request.first, request.second),
    quick=True,
)
