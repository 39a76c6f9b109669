"""Contents of each command's `--json` answer: fields of its results, and a few more.

A new command needs a record here. The documentation of answers is generated from this file, and
tests compare it with the commands' output. Names end with their unit; `None` means that a value is
unknown or doesn't exist.
"""

from __future__ import annotations

import builtins
import importlib
import inspect
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from types import NoneType
from typing import Any, get_args, get_origin, get_type_hints

__all__ = ["ANSWERS", "WITHOUT_ANSWER", "Record", "dataclass_of"]


@dataclass(frozen=True, eq=False)
class Record:
    """A JSON object of an answer: fields of a dataclass, and additional facts.

    The kind of a fact is a type, a record, a dataclass as ``module:Name``, or a list or ``{str:
    …}`` of one of them.

    Parameters
    ----------
    about : str
        Description of the content in one sentence.
    source : str
        The dataclass, as ``module:Name``.
    chosen : str
        Fields, properties and methods to include, each as ``key`` or ``key=path``; empty for all
        fields.
    facts : mapping of str to kind
        Facts that the command always adds.
    sometimes : mapping of str to kind
        Facts that the command adds with certain options or results.
    """

    about: str
    source: str = ""
    chosen: str = ""
    facts: Mapping[str, Any] = field(default_factory=dict)
    sometimes: Mapping[str, Any] = field(default_factory=dict)

    @property
    def paths(self) -> dict[str, str]:
        """Path of each value in the dataclass, by its key."""
        if self.source and not self.chosen:
            return {each.name: each.name for each in fields(dataclass_of(self.source))}
        pairs = (each.partition("=") for each in self.chosen.split())
        return {key: path or key for key, _, path in pairs}

    def of(self, entry: object, **facts: Any) -> dict[str, Any]:
        """Return the JSON object of an entry, with additional facts."""
        return {key: _value(entry, path) for key, path in self.paths.items()} | facts

    def kinds(self) -> dict[str, Any]:
        """Return the type of every key, for documentation and tests."""
        kinds = {key: _kind(dataclass_of(self.source), path) for key, path in self.paths.items()}
        return kinds | dict(self.facts) | dict(self.sometimes)


def _value(entry: Any, path: str) -> Any:
    for name in path.split("."):
        if entry is None:
            return None
        entry = getattr(entry, name)
        entry = entry() if callable(entry) else entry
    return entry


def dataclass_of(source: str) -> Any:
    """Return a dataclass by ``module:Name``."""
    module, _, name = source.partition(":")
    return getattr(importlib.import_module(module), name)


def _kind(owner: Any, path: str) -> Any:
    """Return the annotation of a field, property or method; ``Any`` if it is unknown."""
    missing = False
    for name in path.split("."):
        missing = missing or NoneType in get_args(owner)
        owner = _without_none(owner)
        member = inspect.getattr_static(owner, name, None)
        member = member.fget if isinstance(member, property) else member
        if inspect.isfunction(member):
            owner = _hints(member)["return"]
        else:
            owner = _hints(owner).get(name, Any)
            if getattr(get_origin(owner), "__name__", "") == "Mapped":  # a column of the registry
                (owner,) = get_args(owner)
    return owner | None if missing else owner


def _hints(annotated: Any) -> dict[str, Any]:
    """Return annotations; names that only type checkers import become ``Any``."""

    class Names(dict[str, Any]):
        def __missing__(self, name: str) -> Any:
            return Any

    known = vars(builtins) | vars(inspect.getmodule(annotated))
    return {} if annotated is Any else get_type_hints(annotated, localns=Names(known))


def _without_none(kind: Any) -> Any:
    inside = [each for each in get_args(kind) if each is not NoneType]
    return inside[0] if NoneType in get_args(kind) else kind


_FILES = {"files": [str]}

DEMO_MODULE = Record(
    "One module of the demo.",
    "torquebench.campaign.results:ModuleResult",
    "side range_nm transducer=transducer_serial recommended=recommended.name runs=run_ids",
    {"models": ["torquebench.calibration:ModelVerification"]},
)
DEMO = Record(
    "Both modules, raw and by each model.",
    "torquebench.campaign.results:DemoResult",
    "simulated bench_seconds",
    {"modules": [DEMO_MODULE], **_FILES},
)
FITTED = Record(
    "A model that was fitted to a table; `comparison` with `--compare`.",
    "torquebench.campaign.results:FitResult",
    "range_nm=data.range_nm simulated=data.simulated kind=name title raw fitted "
    "scatter_nm=noise.standard_deviation_nm contradictions",
    {"points": int, "columns": [Any], **_FILES},
    {"comparison": ["torquebench.compensation.selection:ModelScore"]},
)
APPLIED = Record(
    "Readings that were compensated.",
    "torquebench.tables.compensating:CompensatedFile",
    facts={"unmeasured": [str], "columns": [Any], **_FILES},
)
VERIFIED = Record(
    "Models at points that they weren't fitted to; the verdict is that of the second entry.",
    "torquebench.calibration:VerificationResult",
    "range_nm groups points simulated models",
    {"tolerance_percent_fs": float, "passed": bool, "not_in_u": [str]},
    {"columns": [Any], "cells": ["torquebench.calibration:Cell"], "run": str, **_FILES},
)
EXPORTED_MODEL = Record(
    "A model's table for other programs.",
    "torquebench.compensation.table:CompensationTable",
    "intervals=curve.intervals degree=curve.degree branch_aware=curve.branch_aware "
    "low_nm=reading_low_nm high_nm=reading_high_nm largest_deviation_nm=bound_nm",
    {"partial_loops_deviation_nm": float, **_FILES},
)
BUDGETED_READING = Record(
    "The budget of one compensated reading, and the interval of Monte Carlo. k is 2: u of curve "
    "and scatter contains Student's factor for `student_degrees_of_freedom`.",
    "torquebench.uncertainty:Validation",
    "torque_nm=budget.value standard_uncertainty_nm=budget.standard_uncertainty "
    "coverage_factor=budget.coverage_factor expanded_uncertainty_nm=budget.expanded_uncertainty "
    "lines=budget.lines monte_carlo_low_nm=monte_carlo.low monte_carlo_high_nm=monte_carlo.high "
    "agrees",
    {"reading_nm": float, "branch": str, "student_degrees_of_freedom": float},
)
BUDGETS = Record("One budget a reading.", facts={"readings": [BUDGETED_READING]})
MEASURED_LINE = Record(
    "One averaged interval; each is printed as a separate line with the key `line`.",
    "torquebench.cli.measure:MeasuredInterval",
)
MEASURED = Record(
    "Models in use; the measured lines precede it.",
    facts={"simulated": bool, "compensation": {str: str}, "not_in_u": {str: [str]}, "lines": int},
)
PAPER_ITEM = Record("One item of the source papers.", facts={"item": str, "verdict": str})
PAPERS = Record(
    "The items of the source papers.",
    facts={"simulated": bool, "items": [PAPER_ITEM], **_FILES},
)
IN_PLACE = Record(
    "Worst error of fresh readings in the chain, for each calibration.",
    facts={
        "side": str,
        "range_nm": float,
        "simulated": bool,
        "worst_percent_fs": {str: float | None},
    },
    sometimes=_FILES,
)
DOCTOR = Record(
    "All checks of `doctor`.",
    facts={"findings": ["torquebench.cli.doctor.bench:Finding"], "problems": int},
)
TABLE_OF_NUMBERS = Record(
    "A table as it is printed: the headers name quantity and unit.",
    facts={"header": [str], "rows": [[str | float]]},
)
MECHANICS = Record(
    "Results, in words and as tables.",
    facts={"result": str, "tables": [TABLE_OF_NUMBERS], "facts": {str: str}},
    sometimes=_FILES,
)
DEFECT = Record(
    "A record that has changed since its entry.",
    "torquebench.records.integrity:Finding",
    "kind where=place found=what remedy=way_back",
)
RECORDS_VERIFIED = Record(
    "All records and files compared with their entries.",
    "torquebench.records.integrity:IntegrityReport",
    "intact records runs files_compared=files audit_lines chain_end=head.__str__",
    {"defects": [DEFECT]},
)
ENTERED = Record("Entries in the registry.", facts={"record": str})
BACKED_UP = Record(
    "Result of a backup.",
    "torquebench.station.backup:Backup",
    "runs known_runs open_runs files_copied=files outside problems chain_end=head.__str__",
)
RESTORED = Record("Result of a restore.", "torquebench.station.backup:Restored")
REBUILT = Record("Content of a rebuilt registry.", "torquebench.campaign.rebuilding:Rebuilt")
EXPORTED_RUN = Record("An exported run.", facts={"folder": str, **_FILES})
EXPORTED_DATA = Record(
    "A run's samples or edges for other programs.",
    facts={"run": str, "stream": str, "format": str, **_FILES},
)
AUDIT = Record(
    "Lines of the audit log as they are written in its files.",
    facts={"lines": [{str: Any}], "earlier": int},
)
LISTED_RUN = Record(
    "One run.",
    "torquebench.records:RunSummary",
    "run=run_id started status bench simulated",
)
LISTED_CALIBRATION = Record(
    "One calibration.",
    "torquebench.records:CalibrationEntry",
    "performed transducer=transducer_serial points range_nm profile=profile_name simulated",
    {"name": str},
)
LISTED_MODEL = Record(
    "One model.",
    "torquebench.records:ModelEntry",
    "created kind transducer=transducer_serial range_nm simulated",
    {"name": str, "in_use": bool},
)
LISTED_EQUIPMENT = Record(
    "One piece of equipment.",
    "torquebench.records:Equipment",
    "kind serial manufacturer model range_nm",
)
LISTED = Record(
    "Content of the registry, the newest first; `more` names truncated lists.",
    facts={"more": [str]},
    sometimes={
        "runs": [LISTED_RUN],
        "calibrations": [LISTED_CALIBRATION],
        "models": [LISTED_MODEL],
        "equipment": [LISTED_EQUIPMENT],
    },
)
SHOWN = Record(
    "One record: `facts` as printed, `record` as registered.",
    facts={"name": str, "facts": {str: str}, "record": {str: Any}},
    sometimes={"verifications": [{str: Any}]},
)
EQUIPMENT_SHOWN = Record(
    "Equipment of one serial number with everything that was entered about it.",
    facts={"equipment": [{str: Any}]},
)
EVALUATED_STATIC = Record(
    "A calibration in steps; `results` as in the file of `--out`.",
    facts={
        "profile": {str: str},
        "data_sha256": str,
        "points": int,
        "range_nm": float,
        "columns": [Any],
        "deviations": ["torquebench.calibration:Deviation"],
        "remarks": [str],
        "results": Any,
    },
    sometimes={"calibration": str, "model": str | None, "run": str, **_FILES},
)
ESTIMATED_VALUE = Record(
    "A value with U (k = 2).",
    facts={"value": float, "expanded_uncertainty": float, "unit": str},
)
EVALUATED_DYNAMICS = Record(
    "Resonance, damping and lag of a chain, and the filter that inverts them.",
    "torquebench.campaign.dynamics:IdentifiedDynamics",
    "simulated bandwidth_hz=designed.bandwidth_hz noise_gain=designed.noise_gain "
    "delay_s=designed.delay_s",
    {"parameters": {str: ESTIMATED_VALUE}, **_FILES},
)
EVALUATED_LUBRICATION = Record(
    "Factor on the drag of the bearings by the present lubricant.",
    facts={"factor": ESTIMATED_VALUE, "record": str, **_FILES},
)
ANSWERS: dict[str, tuple[Record, ...]] = {
    "demo": (DEMO,),
    "fit": (FITTED,),
    "apply": (APPLIED,),
    "verify": (VERIFIED,),
    "export": (EXPORTED_MODEL,),
    "budget": (BUDGETS,),
    "measure": (MEASURED, MEASURED_LINE),
    "papers": (PAPERS,),
    "in-place": (IN_PLACE,),
    "doctor": (DOCTOR,),
    "mechanics additional-torque": (MECHANICS,),
    "mechanics sections": (MECHANICS,),
    "mechanics supports": (MECHANICS,),
    "records verify": (RECORDS_VERIFIED,),
    "records amend": (ENTERED,),
    "records backup": (BACKED_UP,),
    "records restore": (RESTORED,),
    "records rebuild": (REBUILT,),
    "records export": (EXPORTED_RUN,),
    "records export-data": (EXPORTED_DATA,),
    "records audit": (AUDIT,),
    "records equipment": (EQUIPMENT_SHOWN,),
    "records add-equipment": (ENTERED,),
    "records add-certificate": (ENTERED,),
    "records fit-part": (ENTERED,),
    "records adjust": (ENTERED,),
    "records list": (LISTED,),
    "records show": (SHOWN,),
    "evaluate static": (EVALUATED_STATIC,),
    "evaluate dynamics": (EVALUATED_DYNAMICS,),
    "evaluate lubrication": (EVALUATED_LUBRICATION,),
}
"""Records of each command's answer; a command prints one of them."""

WITHOUT_ANSWER = {
    "panel": "serves the panel until it is ended",
    "simulate": "serves simulated instruments until it is ended",
}
"""Commands without `--json`, and the reason."""
