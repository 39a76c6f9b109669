"""What a reducer test recorded, and its only evaluation: right after the test, and ever again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

from torquebench.bench.description import BenchDescription
from torquebench.campaign.reducers.catalogue import TESTS, TestName
from torquebench.campaign.reducers.preparation import Known
from torquebench.campaign.reducers.quantities import ReducerTestQuantity, result_quantities
from torquebench.campaign.reducers.sampling import PartlySampled
from torquebench.campaign.reducers.uncertainty import Bench
from torquebench.campaign.reducers.work import Evaluated
from torquebench.errors import RecordError
from torquebench.message import Message
from torquebench.records import from_plain, recording_content, recording_file
from torquebench.reducers import ReducerDescription, verdicts
from torquebench.uncertainty import Budget

__all__ = ["EvaluatedTest", "RecordedTest"]


@dataclass(frozen=True)
class EvaluatedTest:
    """Results of a reducer test.

    Parameters
    ----------
    bench : Bench
        Its data in the evaluation.
    found : Evaluated
        Result of `torquebench.reducers`, and remarks.
    quantities : tuple of ReducerTestQuantity
        With the uncertainty of limited sampling, and verdicts.
    budgets : mapping of str to Budget
        Of every quantity, by its key.
    """

    bench: Bench
    found: Evaluated
    quantities: tuple[ReducerTestQuantity, ...]
    budgets: Mapping[str, Budget]


@dataclass(frozen=True, eq=False)
class RecordedTest:
    """Everything that the evaluation of a reducer test takes, except the bench's description.

    Parameters
    ----------
    test : str
    reducer : ReducerDescription
    settings : object
        Of the test's plan.
    short : bool
        Whether it is a short test.
    known : Known
        Twist and empty run of the bench, as stated or recorded.
    recording : object
        What the plan recorded.
    """

    test: TestName
    reducer: ReducerDescription
    settings: Any
    short: bool
    known: Known
    recording: Any

    def file(self) -> bytes:
        """Return the content of the file in the run's folder."""
        return recording_file(self)

    @classmethod
    def read(cls, content: bytes, origin: str) -> Self:
        """Read the file that `file` wrote.

        Raises
        ------
        RecordError
            It isn't such a file, or this version doesn't know what it holds.
        """
        plain = recording_content(content, origin)
        if not isinstance(plain, dict) or plain.get("test") not in TESTS:
            raise RecordError(
                Message("{origin} is no recording of a reducer test", origin), ", ".join(TESTS)
            )
        work = TESTS[plain["test"]].work()
        kinds = {
            "test": TestName,
            "reducer": ReducerDescription,
            "settings": type(work.settings),
            "short": bool,
            "known": Known,
            "recording": work.recording,
        }
        return cls(
            **{
                name: from_plain(kind, plain.get(name), f"{origin}, {name}")
                for name, kind in kinds.items()
            }
        )

    def evaluated(self, description: BenchDescription) -> EvaluatedTest:
        """Evaluate the test with this version.

        Parameters
        ----------
        description : BenchDescription
            Of the bench at that time.

        Raises
        ------
        InputError
            What was recorded can't be evaluated.
        """
        work = TESTS[self.test].work()
        bench = Bench(description, self.known.twists(), self.known.tares(self.reducer.signed_ratio))
        found = work.evaluate(bench, self.reducer, self.recording)
        unsampled = work.unsampled(self.settings)
        found = replace(found, remarks=(*found.remarks, *(each.remark for each in unsampled)))
        whole = PartlySampled(found.result, unsampled)
        judged = verdicts(whole, self.reducer)
        budgets = {each.key: each.estimate for each in whole.quantities()}
        budgets |= {each.key: each.estimate for each in judged}
        quantities = result_quantities(whole, judged, conditional=self.short)
        return EvaluatedTest(bench, found, quantities, budgets)
