"""The recording of a reducer test and its evaluation, right after the test or at any later time."""

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
        Data of the bench for the evaluation.
    found : Evaluated
        Result of `torquebench.reducers`, and remarks.
    quantities : tuple of ReducerTestQuantity
        Quantities with verdicts; their uncertainty includes that of limited sampling.
    budgets : mapping of str to Budget
        Budget of every quantity, by its key.
    """

    bench: Bench
    found: Evaluated
    quantities: tuple[ReducerTestQuantity, ...]
    budgets: Mapping[str, Budget]


@dataclass(frozen=True, eq=False)
class RecordedTest:
    """All inputs of a reducer test's evaluation, except the bench's description.

    Parameters
    ----------
    settings : object
        Settings of the test's plan.
    short : bool
        Whether the test is a short one.
    known : Known
        Twist and empty run of the bench, as stated or recorded.
    recording : object
        Recording of the plan.
    """

    test: TestName
    reducer: ReducerDescription
    settings: Any
    short: bool
    known: Known
    recording: Any

    def file(self) -> bytes:
        """Return the content of the file that is stored in the run's folder."""
        return recording_file(self)

    @classmethod
    def read(cls, content: bytes, origin: str) -> Self:
        """Rebuild the recording from the content that `file` returned.

        Raises
        ------
        RecordError
            The file isn't a reducer test's, or has content that this version doesn't know.
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
        """Evaluate the test with this version of torquebench.

        Parameters
        ----------
        description : BenchDescription
            Description of the bench at the time of the test.

        Raises
        ------
        InputError
            The recording can't be evaluated.
        """
        work = TESTS[self.test].work()
        bench = Bench(description, self.known.twists(), self.known.tares(self.reducer.signed_ratio))
        evaluation = work.evaluate(bench, self.reducer, self.recording)
        unsampled = work.unsampled(self.settings)
        evaluation = replace(
            evaluation, remarks=(*evaluation.remarks, *(entry.remark for entry in unsampled))
        )
        result = PartlySampled(evaluation.result, unsampled)
        judged = verdicts(result, self.reducer)
        budgets = {quantity.key: quantity.estimate for quantity in result.quantities()}
        budgets |= {entry.key: entry.estimate for entry in judged}
        quantities = result_quantities(result, judged, conditional=self.short)
        return EvaluatedTest(bench, evaluation, quantities, budgets)
