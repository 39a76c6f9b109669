"""Results of a reducer test: plain values for tables, figures, reports and the panel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from math import inf, isfinite
from typing import Any

from torquebench.campaign.reducers.catalogue import TestName
from torquebench.campaign.reducers.quantities import ReducerTestQuantity
from torquebench.reducers import Finding
from torquebench.station import RunRecord
from torquebench.uncertainty import Budget, BudgetLine, Shared, Verdict

__all__ = [
    "SHORT_TEST",
    "ReducerTestFailure",
    "ReducerTestOutcome",
    "ReducerTestRecord",
    "ReducerTestRehearsal",
    "budget_from_plain",
    "plain_budget",
]


SHORT_TEST = "short test: a first impression, not for comparison with a data sheet"


@dataclass(frozen=True)
class ReducerTestOutcome:
    """One test of one specimen.

    Attributes
    ----------
    name : str
        Name of the test, one of ``TESTS`` but not ``"full"``.
    title : str
        Name of the test in words.
    quantities : tuple of ReducerTestQuantity
        Results with limits and verdicts.
    verdict : str
        The worst verdict of its quantities; empty without limits.
    remarks : tuple of str
        Remarks: nominal uncertainties, points that didn't settle.
    findings : tuple of Finding
        Defects of the data; a severe one forbids a verdict.
    recording : object
        Recording of the plan (a frozen dataclass of arrays).
    result : object
        The evaluated result (a frozen dataclass of `torquebench.reducers`).
    run : RunRecord
        The run and its folder; its ``results.json`` holds the quantities.
    short : bool
        Whether it is a short test: its uncertainties include the reduced sampling, and a pass is
        only conditional.
    """

    name: TestName
    title: str
    quantities: tuple[ReducerTestQuantity, ...]
    verdict: Verdict
    remarks: tuple[str, ...]
    findings: tuple[Finding, ...]
    recording: Any
    result: Any
    run: RunRecord
    short: bool = False

    @property
    def severe(self) -> bool:
        """Whether a finding forbids a verdict."""
        return any(finding.severe for finding in self.findings)


@dataclass(frozen=True)
class ReducerTestFailure:
    """A part of a full test that has no result.

    Attributes
    ----------
    name, title : str
        Name of the part.
    message : str
        The error: what was found, what is allowed, what to do.
    remedy : str
        Additional remedy; empty if the message has it.
    """

    name: str
    title: str
    message: str
    remedy: str = ""


@dataclass(frozen=True)
class ReducerTestRecord:
    """All results of one call of `run_reducer_test`.

    Attributes
    ----------
    name : str
        The requested test; ``"full"`` has several outcomes.
    reducer_name, serial : str
        Type and specimen.
    reducer : mapping
        The description of the type as JSON.
    outcomes : tuple of ReducerTestOutcome
        Outcomes in the order in which the tests ran.
    failures : tuple of ReducerTestFailure
        Parts of a full test without a result.
    simulated : bool
        Whether figures must be labelled "simulated".
    started : datetime
        In UTC.
    bench_seconds : float
        Duration in bench time, s.
    """

    name: TestName
    reducer_name: str
    serial: str
    reducer: Mapping[str, Any]
    outcomes: tuple[ReducerTestOutcome, ...]
    failures: tuple[ReducerTestFailure, ...]
    simulated: bool
    started: datetime
    bench_name: str
    operator: str
    software_version: str
    bench_seconds: float

    @property
    def short(self) -> bool:
        """Whether the test was a short one."""
        return any(outcome.short for outcome in self.outcomes)

    @property
    def verdict(self) -> Verdict:
        """The worst verdict of all outcomes; empty if nothing was evaluated."""
        return Verdict.worst(outcome.verdict for outcome in self.outcomes)

    @property
    def failed(self) -> bool:
        """Whether a limit is exceeded, a finding forbids a verdict, or a part has no result."""
        severe = any(outcome.severe for outcome in self.outcomes)
        return self.verdict.failed or bool(self.failures) or severe


@dataclass(frozen=True)
class ReducerTestRehearsal:
    """Rehearsal of a reducer test: its plan, checked against all limits before anything moves.

    Attributes
    ----------
    duration_s : float
        Bench time without waiting for steady temperature or settling, s.
    longest_s : float
        The same with all repeats that a test may add until its means are certain enough, s.
    longest_warm_up_s : float
        Additional time of the warm-up at most, s.
    points : int
        Points that would be recorded.
    largest_torque_nm, largest_speed_rpm : mapping of side to float
        Largest commanded value of each side.
    modes : mapping of side to tuple of str
        Modes of each side, in order.
    """

    name: str
    title: str
    duration_s: float
    longest_s: float
    longest_warm_up_s: float
    points: int
    largest_torque_nm: Mapping[str, float] = field(default_factory=dict)
    largest_speed_rpm: Mapping[str, float] = field(default_factory=dict)
    modes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


def plain_budget(estimate: Budget) -> dict[str, Any]:
    """Return a budget as JSON values; unlimited degrees of freedom become null."""

    def freedom(value: float) -> float | None:
        return value if isfinite(value) else None

    return {
        "value": estimate.value,
        "unit": estimate.unit,
        "standard_uncertainty": estimate.standard_uncertainty,
        "degrees_of_freedom": freedom(estimate.degrees_of_freedom),
        "coverage_factor": estimate.coverage_factor(),
        "expanded_uncertainty": estimate.expanded_uncertainty(),
        "contributions": [
            {
                "name": line.name,
                "standard_uncertainty": line.contribution,
                "degrees_of_freedom": freedom(line.degrees_of_freedom),
                "sensitivity": line.sensitivity,
                "share": line.share,
                "shared": line.shared.value,
            }
            for line in estimate.lines
        ],
    }


def budget_from_plain(plain: Mapping[str, Any]) -> Budget:
    """Rebuild the budget from the values of `plain_budget`.

    Examples
    --------
    >>> found = Budget(1.0, 0.1, float("inf"), (), "arcmin")
    >>> budget_from_plain(plain_budget(found)) == found
    True
    """

    def freedom(value: float | None) -> float:
        return inf if value is None else float(value)

    unit = str(plain["unit"])
    lines = tuple(
        BudgetLine(
            name=str(line["name"]),
            standard_uncertainty=float(line["standard_uncertainty"]),
            degrees_of_freedom=freedom(line["degrees_of_freedom"]),
            sensitivity=float(line["sensitivity"]),
            unit=unit,
            share=float(line["share"]),
            shared=Shared(line["shared"]),
        )
        for line in plain["contributions"]
    )
    return Budget(
        float(plain["value"]),
        float(plain["standard_uncertainty"]),
        freedom(plain["degrees_of_freedom"]),
        lines,
        unit,
    )
