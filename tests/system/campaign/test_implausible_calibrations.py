"""A calibration that contradicts itself is kept, marked and not put into use, but by a person."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from torquebench import cli
from torquebench.bench.roles import Side
from torquebench.calibration import CalibrationData, load_profile
from torquebench.campaign.calibrating import CALIBRATION, measure_calibration
from torquebench.campaign.fitting import ModelChoice, fit_models, fit_table
from torquebench.campaign.registering import (
    RegisteredCalibration,
    registers_calibration,
)
from torquebench.compensation import load_model
from torquebench.errors import InputError, RecordError
from torquebench.progress import NoProgress
from torquebench.records import Registry
from torquebench.station import Station
from torquebench.twin import FaultKind

PROFILE = load_profile("rapid-in-situ").with_options(step_percent=10.0)
KIND = "polynomial-2"


@dataclass
class Breaks(NoProgress):
    """Breaks a channel of the simulated bench when so many points are measured."""

    station: Station
    channel: str
    kind: FaultKind
    amount: float
    after: int

    def reach(self, done: int, detail: str = "") -> None:
        super().reach(done, detail)
        twin = self.station.drivers.counter.twin
        if done == self.after:
            twin.inject_fault(
                self.channel, self.kind, start_s=twin.time_s, duration_s=1e6, amount=self.amount
            )


def calibrate(
    station: Station, side: Side, progress: NoProgress | None = None
) -> tuple[CalibrationData, RegisteredCalibration]:
    known = registers_calibration([ModelChoice(KIND)], KIND)
    measured = measure_calibration(
        station, side, PROFILE, metadata=known, progress=progress or NoProgress()
    )
    done = CALIBRATION.evaluate_and_register(station.registry, measured)
    return measured.result.data, done.registered


def in_use(station: Station, data: CalibrationData) -> int | None:
    entry = station.registry.active_model(data.transducer_serial, data.counter_identity)
    return None if entry is None else entry.model_id


def test_a_standard_whose_span_changes_after_some_points_spoils_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    side: Side = "input"
    with Station.open(None, tmp_path) as station:
        data, healthy = calibrate(station, side)
        good = healthy.models[KIND]
        assert good.contradictions == ()
        assert in_use(station, data) == good.model_id

        changed, registered = calibrate(
            station, side, Breaks(station, f"{side}_reference", "wrong_span", 0.97, after=12)
        )
        entry = registered.models[KIND]
        kinds = {each.kind for each in entry.contradictions}
        assert {"scale", "change"} <= kinds
        assert in_use(station, changed) == good.model_id
        stored = load_model(entry.file).provenance
        assert len(stored.contradictions) == len(entry.contradictions)
        assert stored.contradictions[0].startswith("rows 8 to ")
        assert load_model(good.file).provenance.contradictions == ()

        with pytest.raises(RecordError, match="contradicts itself: rows 8 to "):
            station.registry.activate(entry.model_id, operator="A. Kim", reason="why not")
        with pytest.raises(InputError, match="without a reason"):
            station.registry.activate(
                entry.model_id, operator="A. Kim", reason=" ", despite_contradictions=True
            )
        with pytest.raises(InputError, match="without a name"):
            station.registry.activate(
                entry.model_id, reason="the standard was read wrongly", despite_contradictions=True
            )
        assert in_use(station, changed) == good.model_id

    named = [
        "--despite-contradictions",
        "--by",
        "A. Kim",
        "--reason",
        "the standard was read wrongly",
        "--data",
        str(tmp_path),
    ]
    monkeypatch.setattr(
        "sys.argv",
        ["torquebench", "records", "use", f"model-{entry.model_id}", *named],
    )
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert not end.value.code
    assert f"In use: model-{entry.model_id}" in capsys.readouterr().out
    with Registry.open(tmp_path) as registry:
        active = registry.active_model(changed.transducer_serial, changed.counter_identity)
        assert active is not None
        assert active.model_id == entry.model_id
        decision = registry.activations(changed.transducer_serial)[-1]
        assert decision.operator == "A. Kim"
        assert "contradicts itself: the standard was read wrongly" in decision.reason


def loop(wrong_from: int | None = None) -> CalibrationData:
    rng = np.random.default_rng(1)
    rising = np.linspace(5.0, 100.0, 20)
    torque = np.concatenate([rising, rising[-2::-1], [0.0]])
    branch = np.concatenate([np.ones(20), -np.ones(20)])
    standard = np.concatenate([torque, -torque])
    reading = 0.995 * standard + 1e-5 * np.abs(standard) * standard
    reading = reading + rng.normal(0.0, 0.005, standard.size)
    if wrong_from is not None:
        standard = np.where(np.arange(standard.size) >= wrong_from, 0.97 * standard, standard)
    return CalibrationData(reading, standard, np.repeat([1, 2], 40), np.tile(branch, 2), 100.0)


def test_contradicting_points_are_not_called_outliers() -> None:
    (fitted,) = fit_models(loop(wrong_from=4), [ModelChoice(KIND)])
    assert fitted.contradictions
    assert [remark for remark in fitted.remarks if "outlier" in remark] == []
    (fitted,) = fit_models(loop(), [ModelChoice(KIND)])
    assert fitted.contradictions == ()


def test_a_fit_from_a_table_finds_them_too() -> None:
    fitted = fit_table(loop(wrong_from=30), "table.csv", KIND)
    assert fitted.contradictions[0].kind == "scale"
    assert fitted.contradictions[0].found.startswith("rows 31 to 80 (series 1, ")
    assert fit_table(loop(), "table.csv", KIND).contradictions == ()
