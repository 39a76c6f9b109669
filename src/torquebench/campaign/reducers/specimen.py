"""One reducer on one bench: each test is a run, evaluated and registered."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from torquebench import __version__
from torquebench.campaign.measuring import OnPause, measure, operator_name
from torquebench.campaign.reducers.catalogue import ReducerTest
from torquebench.campaign.reducers.preparation import Known, Preparation
from torquebench.campaign.reducers.results import (
    ReducerTestOutcome,
    ReducerTestQuantity,
    plain_budget,
)
from torquebench.campaign.reducers.sampling import PartlySampled
from torquebench.campaign.reducers.settings import ReducerTestSettings, reducer_limits
from torquebench.campaign.reducers.uncertainty import Bench
from torquebench.campaign.reducers.work import Evaluated
from torquebench.procedures import Plan
from torquebench.progress import Progress
from torquebench.reducers import QuantityVerdict, ReducerDescription, ReducerResult, verdicts
from torquebench.station import SPECIMEN, RunRecord, Station
from torquebench.uncertainty import Verdict

__all__ = ["Specimen"]


@dataclass
class Specimen:
    """One reducer on one bench, tested once or several times."""

    station: Station
    reducer: ReducerDescription
    settings: ReducerTestSettings
    serial: str
    progress: Progress
    on_pause: OnPause | None
    known: Known = field(init=False)

    def __post_init__(self) -> None:
        self.known = Known.stated(self.settings)

    def prepare(self, preparation: Preparation) -> None:
        """Measure something of the bench itself."""

        def plan() -> Plan[Any]:
            return preparation.plan(self.station.devices)

        record = self._run(preparation.name, preparation.title, plan, plan)
        preparation.learn(self.known, record.result)

    def test(self, test: ReducerTest) -> ReducerTestOutcome:
        """Run a test and return its results."""
        bench = Bench(self.station.description, self.known.twists, self.known.tares)
        work, settings = test.work(), self.settings.plans[test.name]
        kept: list[tuple[Any, Evaluated, tuple[ReducerTestQuantity, ...]]] = []

        def plan() -> Plan[Any]:
            limits = reducer_limits(self.reducer)
            return work.plan(self.station.devices, limits, settings)

        def evaluated() -> Plan[Any]:
            recording = yield from plan()
            found = work.evaluate(bench, self.reducer, recording)
            unsampled = work.unsampled(settings)
            found = replace(found, remarks=(*found.remarks, *(each.remark for each in unsampled)))
            whole = PartlySampled(found.result, unsampled)
            judged = _quantities(
                whole, verdicts(whole, self.reducer), conditional=self.settings.is_short
            )
            kept.append((recording, found, judged))
            return self._results(test, found, whole, judged)

        # A rehearsal records nothing that could be evaluated.
        short = self.settings.is_short
        kind = f"test-{test.name}-short" if short else f"test-{test.name}"
        title = f"{test.title}, short test" if short else test.title
        run = self._run(kind, title, evaluated, plan)
        recording, found, quantities = kept[-1]
        return ReducerTestOutcome(
            name=test.name,
            title=title,
            quantities=quantities,
            verdict=Verdict.worst(each.verdict for each in quantities),
            remarks=found.remarks,
            findings=tuple(getattr(found.result, "findings", ())),
            recording=recording,
            result=found.result,
            run=run,
            short=short,
        )

    def _run(
        self,
        kind: str,
        title: str,
        plan: Callable[[], Plan[Any]],
        rehearsed: Callable[[], Plan[Any]],
    ) -> RunRecord:
        return measure(
            self.station,
            plan,
            rehearsed=rehearsed,
            kind=kind,
            title=title,
            metadata={
                "side": "output",
                "reducer_name": self.reducer.name,
                "serial": self.serial,
                "profile_name": self.reducer.name,
                "operator": operator_name(),
                SPECIMEN: self._equipment(),
            },
            progress=self.progress,
            on_pause=self.on_pause,
        ).record

    def _equipment(self) -> dict[str, Any] | None:
        """Return the specimen as an item of equipment; None without a serial number."""
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

    def _results(
        self,
        test: ReducerTest,
        found: Evaluated,
        whole: PartlySampled,
        quantities: tuple[ReducerTestQuantity, ...],
    ) -> dict[str, Any]:
        """Return the content of the run's ``results.json``."""
        budgets = {each.key: plain_budget(each.estimate) for each in whole.quantities()}
        budgets |= {each.key: plain_budget(each.estimate) for each in verdicts(whole, self.reducer)}
        return {
            "test": test.name,
            "short": self.settings.is_short,
            "reducer": self.reducer.model_dump(mode="json"),
            "serial": self.serial,
            "simulated": self.station.description.simulated,
            "software_version": __version__,
            "quantities": [{**vars(each), "budget": budgets[each.key]} for each in quantities],
            "findings": list(getattr(found.result, "findings", ())),
            "remarks": list(found.remarks),
            "empty_run": dict(self.known.tares),
            "evaluation": found.result,
        }


def _quantities(
    result: ReducerResult, judged: tuple[QuantityVerdict, ...], *, conditional: bool
) -> tuple[ReducerTestQuantity, ...]:
    limits = {each.key: each for each in judged}
    found = [(each.key, each.title, each.estimate, each.rule) for each in result.quantities()]
    # A limit between measured points, such as an efficiency, isn't in the list of quantities.
    known = {key for key, _, _, _ in found}
    found += [
        (each.key, each.title, each.estimate, "interpolated")
        for each in judged
        if each.key not in known
    ]
    rows = []
    for key, title, estimate, rule in found:
        held = limits.get(key)
        verdict = Verdict.NONE if held is None else held.decision.verdict
        if conditional and verdict is Verdict.PASS:
            verdict = Verdict.CONDITIONAL_PASS
        rows.append(
            ReducerTestQuantity(
                key=key,
                title=title,
                value=estimate.value,
                expanded_uncertainty=estimate.expanded_uncertainty(),
                unit=estimate.unit,
                limit="" if held is None else held.limit,
                verdict=verdict,
                rule=rule,
            )
        )
    return tuple(rows)
