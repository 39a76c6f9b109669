"""Comparison of runs of one reducer test: specimens of a type, or one specimen before and after."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from torquebench.campaign.reducers.results import budget_from_plain
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.records import RunFolder, RunSummary
from torquebench.reducers import Change, SpecimenComparison, change_between, compare_specimens
from torquebench.uncertainty import Budget


@dataclass(frozen=True)
class SpecimenQuantity:
    """One value from a run.

    Parameters
    ----------
    limit, verdict : str
        Limit of the data sheet, and verdict; empty without a limit.
    """

    title: str
    estimate: Budget
    limit: str
    verdict: str


@dataclass(frozen=True)
class SpecimenResults:
    """Results of one run of a reducer test.

    Parameters
    ----------
    chain : mapping or None
        Active models at that time.
    short : bool
        Whether the test was a short one.
    quantities : mapping of str to SpecimenQuantity
        By key.
    """

    run_id: str
    test: str
    reducer: str
    serial: str
    bench: str
    chain: Any
    simulated: bool
    short: bool
    quantities: Mapping[str, SpecimenQuantity]

    @property
    def name(self) -> str:
        """Serial number, or the run's id without one."""
        return self.serial or self.run_id


@dataclass(frozen=True)
class ReducerComparison:
    """Comparison of runs of one test of one type of reducer.

    Parameters
    ----------
    specimens : tuple of SpecimenResults
        Specimens; two entries for one specimen before and after.
    changes : mapping of str to Change
        Empty for several specimens.
    values : mapping of str to SpecimenComparison
        Empty for before and after.
    same_chain : bool
        Whether all runs come from one bench with the same models, so that common errors cancel.
    left_out : int
        Number of values that aren't in every run.
    """

    specimens: tuple[SpecimenResults, ...]
    changes: Mapping[str, Change]
    values: Mapping[str, SpecimenComparison]
    same_chain: bool
    left_out: int

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys of the values that all runs have, in the order of the first run."""
        return tuple(self.changes or self.values)

    @property
    def simulated(self) -> bool:
        """Whether any run comes from a simulated bench."""
        return any(specimen.simulated for specimen in self.specimens)

    def title(self, key: str) -> str:
        """Return the title of a value."""
        return self.specimens[0].quantities[key].title


def tested_specimen(run: RunSummary) -> SpecimenResults:
    """Return the results of a run of a reducer test.

    Raises
    ------
    InputError
        The run isn't a reducer test, or wasn't completed.
    """
    folder = RunFolder.open(run.folder)
    results = folder.results
    if not (isinstance(results, dict) and run.kind.startswith("test-") and "quantities" in results):
        raise InputError(
            Message("run {run_id} ({kind}, {status})", run.run_id, run.kind, run.status),
            "a completed reducer test",
            "look for runs of the kind test-… in `torquebench records list`",
        )
    return SpecimenResults(
        run_id=run.run_id,
        test=str(results["test"]),
        reducer=str(results["reducer"]["name"]),
        serial=str(results["serial"]),
        bench=run.bench,
        chain=folder.metadata.get("compensation"),
        simulated=run.simulated,
        short=bool(results.get("short", False)),
        quantities={
            row["key"]: SpecimenQuantity(
                title=row["title"],
                estimate=budget_from_plain(row["budget"]),
                limit=row.get("limit", ""),
                verdict=row.get("verdict", ""),
            )
            for row in results["quantities"]
        },
    )


def compared(specimens: Sequence[SpecimenResults], *, change: bool = False) -> ReducerComparison:
    """Compare specimens of one type, or with `change` one specimen before and after.

    Raises
    ------
    InputError
        Runs of different tests or types, several of one specimen, or nothing in common.
    """
    _check(specimens, change)
    first = specimens[0]
    keys = [
        key for key in first.quantities if all(key in specimen.quantities for specimen in specimens)
    ]
    if not keys:
        raise InputError("runs without a common value", "runs with the same settings")
    same = all(
        specimen.bench == first.bench and specimen.chain == first.chain for specimen in specimens
    )
    changes: dict[str, Change] = {}
    values: dict[str, SpecimenComparison] = {}
    for key in keys:
        estimates = {specimen.name: specimen.quantities[key].estimate for specimen in specimens}
        if change:
            before, after = (specimen.quantities[key].estimate for specimen in specimens)
            changes[key] = change_between(key, before, after, same_calibration=same)
        else:
            values[key] = compare_specimens(key, estimates, same_calibration=same)
    every = {key for specimen in specimens for key in specimen.quantities}
    return ReducerComparison(tuple(specimens), changes, values, same, len(every) - len(keys))


def _check(specimens: Sequence[SpecimenResults], change: bool) -> None:
    """Refuse runs that can't be compared: of several tests or reducers, or of one specimen."""
    different = len({specimen.run_id for specimen in specimens})
    if different < max(2, len(specimens)):
        raise InputError(
            Message("{count} runs, {different} of them different", len(specimens), different),
            "two runs or more",
        )
    for what in ("test", "reducer"):
        names = sorted({getattr(specimen, what) for specimen in specimens})
        if len(names) > 1:
            raise InputError(
                Message("runs of {names}", " and ".join(names)), Message("one {what}", what)
            )
    serials = [specimen.serial for specimen in specimens]
    named = ", ".join(serial or "no serial" for serial in serials)
    if change and (len(specimens) != 2 or len(set(serials)) > 1):
        raise InputError(
            Message("{count} runs of {said}", len(specimens), named),
            "two runs of one specimen for --change",
            "name the run before and the run after, or leave --change out",
        )
    if not change and len(set(serials)) < len(serials):
        raise InputError(
            Message("several runs of one specimen: {said}", named),
            "one run per specimen",
            "give --serial when testing, or --change for before and after",
        )
