"""One reducer on one bench: each test is a run, evaluated and registered."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from torquebench import __version__
from torquebench.campaign.measuring import RunOptions, measure
from torquebench.campaign.reducers.catalogue import ReducerTest
from torquebench.campaign.reducers.preparation import Known, Preparation
from torquebench.campaign.reducers.recorded import EvaluatedTest, RecordedTest
from torquebench.campaign.reducers.results import ReducerTestOutcome, plain_budget
from torquebench.campaign.reducers.settings import ReducerTestSettings, reducer_limits
from torquebench.message import Message
from torquebench.procedures import Plan
from torquebench.records import RECORDING
from torquebench.reducers import ReducerDescription
from torquebench.station import SPECIMEN, RunRecord, Station
from torquebench.uncertainty import Verdict


@dataclass
class Specimen:
    """A reducer on a bench, tested once or several times."""

    station: Station
    reducer: ReducerDescription
    settings: ReducerTestSettings
    serial: str
    options: RunOptions
    known: Known = field(init=False)

    def __post_init__(self) -> None:
        self.known = Known(twist_arcmin_per_nm=self.settings.twist_arcmin_per_nm)

    def prepare(self, preparation: Preparation) -> None:
        """Measure a property of the bench itself before the tests."""

        def plan() -> Plan[Any]:
            return preparation.plan(self.station.devices)

        record = self._run(preparation.name, preparation.title, plan, plan)
        preparation.learn(self.known, record.result)

    def test(self, test: ReducerTest) -> ReducerTestOutcome:
        """Run a test and return its results."""
        work, settings = test.work(), self.settings.plans[test.name]
        short = self.settings.is_short
        sealed = self.station.description.recording.reducer_tests
        tests: list[RecordedTest] = []
        evaluations: list[EvaluatedTest] = []

        def plan() -> Plan[Any]:
            limits = reducer_limits(self.reducer)
            return work.plan(self.station.devices, limits, settings)

        def evaluated() -> Plan[Any]:
            """Measure the test, keep its recording, and evaluate it."""
            recording = yield from plan()
            prepared = self.known.needed_by(test)
            tests.append(
                RecordedTest(test.name, self.reducer, settings, short, prepared, recording)
            )
            evaluations.append(tests[-1].evaluated(self.station.description))
            return self._results(test, evaluations[-1])

        # A rehearsal records nothing to evaluate.
        kind = f"test-{test.name}-short" if short else f"test-{test.name}"
        title = Message("{title}, short test", test.title) if short else test.title
        run = self._run(
            kind,
            title,
            evaluated,
            plan,
            lambda: {RECORDING: tests[-1].file()} if tests and sealed else {},
        )
        evaluation, quantities = evaluations[-1].found, evaluations[-1].quantities
        return ReducerTestOutcome(
            name=test.name,
            title=title,
            quantities=quantities,
            verdict=Verdict.worst(quantity.verdict for quantity in quantities),
            remarks=evaluation.remarks,
            findings=tuple(getattr(evaluation.result, "findings", ())),
            recording=tests[-1].recording,
            result=evaluation.result,
            run=run,
            short=short,
        )

    def _run(
        self,
        kind: str,
        title: str,
        plan: Callable[[], Plan[Any]],
        rehearsed: Callable[[], Plan[Any]],
        files: Callable[[], Mapping[str, bytes]] = dict,
    ) -> RunRecord:
        """Measure a test of this specimen, with its identity in the run's metadata."""
        specimen = {
            "side": "output",
            "reducer_name": self.reducer.name,
            "serial": self.serial,
            "profile_name": self.reducer.name,
            SPECIMEN: self._equipment(),
        }
        options: RunOptions = {
            **self.options,
            "metadata": {**specimen, **self.options.get("metadata", {})},
        }
        return measure(
            self.station,
            plan,
            rehearsed=rehearsed,
            kind=kind,
            title=title,
            files=files,
            **options,
        ).record

    def _equipment(self) -> dict[str, Any] | None:
        """Return the specimen as a piece of equipment; None without a serial number."""
        if not self.serial:
            return None
        reducer = self.reducer
        return {
            "serial": self.serial,
            "model": reducer.name,
            "range_nm": reducer.rated_torque_nm,
            "details": {
                "kind": reducer.kind,
                "ratio": reducer.signed_ratio,
                "simulated": self.station.description.simulated,
            },
        }

    def _results(self, test: ReducerTest, evaluated: EvaluatedTest) -> dict[str, Any]:
        """Return the content of the run's ``results.json``."""
        evaluation, budgets = evaluated.found, evaluated.budgets
        return {
            "test": test.name,
            "short": self.settings.is_short,
            "reducer": self.reducer.model_dump(mode="json"),
            "serial": self.serial,
            "simulated": self.station.description.simulated,
            "software_version": __version__,
            "quantities": [
                {**vars(quantity), "budget": plain_budget(budgets[quantity.key])}
                for quantity in evaluated.quantities
            ],
            "findings": list(getattr(evaluation.result, "findings", ())),
            "remarks": list(evaluation.remarks),
            "empty_run": evaluated.bench.tares,
            "evaluation": evaluation.result,
        }
