"""The fault campaign's outcomes: kept in a file, told on the terminal, written into the docs."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.fault_judging import PROBLEMS, Outcome, line_of

__all__ = ["Kept", "Start", "counted", "section", "summary"]

Fault = Callable[[int, int], Outcome]
Start = Callable[[Fault, int, int], Callable[[], Outcome]]

PERCENTILES = (50.0, 90.0, 99.0, 100.0)


class Kept:
    """Outcomes in a file of JSON lines, so that a campaign can go on where it was interrupted.

    Parameters
    ----------
    path : pathlib.Path or None
        None keeps them in memory only.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self.outcomes: dict[tuple[str, int, int], Outcome] = {}
        if path is not None and path.exists():
            for line in path.read_text(encoding="utf-8").splitlines():
                part, values = json.loads(line)
                outcome = Outcome(**values | {"problems": tuple(values["problems"])})
                self.outcomes[part, outcome.seed, outcome.index] = outcome

    def begin(
        self, part: str, fault: Fault, number: int, seed: int, start: Start = partial
    ) -> list[Callable[[], Outcome]]:
        """Begin with so many faults of a part; return what returns their outcomes, in order.

        Parameters
        ----------
        part : str
        fault : callable
            Goes through one, by its index and seed.
        number, seed : int
        start : callable
            Takes `fault`, index and seed, and returns what returns the outcome: by default it is
            gone through when that is asked for. Not called where the outcome is known from an
            earlier slice.
        """
        known = {index: self.outcomes.get((part, seed, index)) for index in range(number)}
        runs = {index: start(fault, index, seed) for index in known if known[index] is None}
        return [
            partial(self._keep, part, runs[index]) if outcome is None else partial(_same, outcome)
            for index, outcome in known.items()
        ]

    def one(self, part: str, seed: int, index: int, run: Callable[[], Outcome]) -> Outcome:
        """Return one outcome, known or gone through now."""
        known = self.outcomes.get((part, seed, index))
        return self._keep(part, run) if known is None else known

    def _keep(self, part: str, run: Callable[[], Outcome]) -> Outcome:
        outcome = run()
        self.outcomes[part, outcome.seed, outcome.index] = outcome
        if self._path is not None:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps([part, asdict(outcome)]) + "\n")
        return outcome


def _same(outcome: Outcome) -> Outcome:
    return outcome


def counted(outcomes: Sequence[Outcome]) -> dict[str, int]:
    """Count faults by what was wrong after them."""
    return {
        title: sum(any(p.startswith(f"{kind}:") for p in each.problems) for each in outcomes)
        for kind, title in PROBLEMS.items()
    }


def _lasted_min(outcomes: Sequence[Outcome]) -> float:
    return sum(each.lasted_s for each in outcomes) / 60.0


def _times(outcomes: Sequence[Outcome], name: str) -> str:
    """Return percentiles of a time, and of how many."""
    times = np.array([getattr(each, name) for each in outcomes])
    times = times[np.isfinite(times)]
    if not times.size:
        return "–"
    shares = np.percentile(times, PERCENTILES)
    return ", ".join(f"{share:.2f}" for share in shares) + f" ({times.size})"


def summary(outcomes: Sequence[Outcome], name: str) -> Iterator[str]:
    """Say in lines what was survived."""
    failed = [outcome for outcome in outcomes if outcome.problems]
    procedures = len({outcome.procedure for outcome in outcomes})
    yield (
        f"\nfaults survived {len(outcomes) - len(failed)} of {len(outcomes)}, "
        f"{kinds(outcomes)} kinds, {procedures} procedures, {name}"
    )
    yield "  " + ", ".join(f"{count} {title}" for title, count in counted(outcomes).items())
    status = Counter(outcome.status for outcome in outcomes)
    yield "  " + ", ".join(f"{count} {how}" for how, count in status.most_common())
    if lasted_min := _lasted_min(outcomes):
        yield f"  {lasted_min:.1f} min in real time"
    yield f"  to both drives off, p50 p90 p99 max, s of bench time: {_times(outcomes, 'safe_s')}"
    if any(math.isfinite(outcome.wall_s) for outcome in outcomes):
        yield f"  the same, s of wall time: {_times(outcomes, 'wall_s')}"
    yield f"  acknowledged points kept: {sum(each.points for each in outcomes)}"
    yield "  alarms: " + ", ".join(sorted({each.alarm for each in outcomes if each.alarm}))
    for each in failed:
        yield "  " + line_of(each)


def kinds(outcomes: Sequence[Outcome]) -> int:
    """Count kinds of faults: on the wire each as one, whichever instrument it befell."""
    return len({each.kind.split(" ", 2)[-1] if each.kind.startswith("wire: ") else each.kind
                for each in outcomes})  # fmt: skip


def section(parts: dict[str, Sequence[Outcome]], remark: str) -> str:
    """Return the campaign's section of the docs, as Markdown.

    Parameters
    ----------
    parts : dict
        Outcomes by what they were measured on; undisturbed work is told below the table.
    remark : str
        On which machine, at which load.
    """
    faults = {name: part for name, part in parts.items() if not _lasted_min(part)}
    every = [outcome for outcomes in faults.values() for outcome in outcomes]
    problems = list(PROBLEMS.values())
    lines = [
        f"Simulated throughout; {remark}",
        "",
        f"| part | faults | kinds | survived | {' | '.join(problems)} |",
        "| --- " * (4 + len(problems)) + "|",
    ]
    for name, outcomes in (*faults.items(), ("together", every)):
        survived = sum(not each.problems for each in outcomes)
        cells = [name, len(outcomes), kinds(outcomes), survived, *counted(outcomes).values()]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    for name, outcomes in parts.items():
        if name not in faults:
            alarms = sum(bool(each.problems) for each in outcomes)
            lines += ["", f"{name.capitalize()}: {_lasted_min(outcomes):.0f} min, "
                      f"{len(outcomes)} procedures, {alarms} with a false alarm."]  # fmt: skip
    lines += [
        f"\nNot survived: {each.kind} in {each.procedure} (seed {each.seed}, "
        f"number {each.index}): {'; '.join(each.problems)}."
        for each in (outcome for part in parts.values() for outcome in part)
        if each.problems
    ]
    return "\n".join(lines)
