"""The age of a calibration counts from the day it was measured, whenever a model is fitted."""

from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, date, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from tests.streamed import streamed
from tests.support.tables import parse_calibration

from torquebench.bench import default_bench
from torquebench.calibration import CalibrationData
from torquebench.campaign.fitting import ModelChoice, fit_models, store_model
from torquebench.chain import Drift, MeasuringChain, Readings, load_chain
from torquebench.compensation import load_model, make_model
from torquebench.errors import InputError
from torquebench.records import CalibrationEntry, Registry
from torquebench.station.matching import compensation_for
from torquebench.tables import read_readings
from torquebench.tables.readings import calibration_csv

DRIFT = Drift("data sheet", 0.05, 8766.0)
TODAY = datetime.now(UTC).date()
MODULE = default_bench().module("output")
COUNTER = default_bench().counter.identity


def points(day: date | None) -> CalibrationData:
    standard = np.linspace(-MODULE.range_nm, MODULE.range_nm, 21)
    noise = 1e-5 * MODULE.range_nm * np.random.default_rng(1).standard_normal(21)
    return CalibrationData(
        standard + noise, standard, [1] * 21, [1] * 21, MODULE.range_nm, side="output",
        transducer_serial=MODULE.transducer.serial, counter_identity=COUNTER, measured_on=day,
    )  # fmt: skip


def stored(folder: Path, day: date | None) -> Path:
    """Return the file of a model that is fitted today to points of a day."""
    data = points(day)
    model = make_model("polynomial", degree=1, range_nm=data.range_nm)
    model.fit(data.features(1), data.standard_nm)
    store_model(folder / "model.json", model, data, {}, (DRIFT,))
    return folder / "model.json"


@pytest.fixture
def registry(tmp_path: Path) -> Iterator[Registry]:
    with Registry.open(tmp_path / "data") as opened:
        yield opened


def share_of_limit(drift_nm: np.ndarray, torque_nm: np.ndarray) -> float:
    """Return a drift's uncertainty as a share of that of a year."""
    year = 5e-4 * np.abs(torque_nm[0]) / np.sqrt(3.0)
    return float(np.abs(drift_nm[0]) / year)


@pytest.mark.parametrize(("days", "expected"), [(0, 0.0), (400, 400 / 365.25), (None, 1.0)])
def test_a_refit_of_old_points_does_not_make_them_new(
    registry: Registry, tmp_path: Path, days: int | None, expected: float
) -> None:
    day = None if days is None else TODAY - timedelta(days=days)
    file = stored(tmp_path, day)
    entry = registry.add_calibration(
        CalibrationEntry.of_points(points(day), performed=datetime.now(UTC))
    )
    model = registry.add_model(entry, kind="polynomial", file=file, side="output", metrics={})
    registry.activate(model.model_id)
    active = compensation_for(registry, default_bench(), COUNTER, "output")
    torque = streamed(active, [0.0], [100.0], [0.0], speed_rpm=0.0, temperature_c=23.0)
    live = share_of_limit(torque.component("drift"), torque.value_nm)
    assert live == pytest.approx(expected, abs=0.01)

    # a file that states its day gives the same
    readings = tmp_path / "readings.csv"
    readings.write_text(f"# measured_on = {TODAY}\nreading_nm\n100\n")
    rows = load_chain(file).torque(read_readings(readings).readings())
    assert share_of_limit(rows.component("drift"), rows.value_nm) == pytest.approx(live, rel=1e-9)


def test_an_unknown_day_of_the_readings_counts_the_whole_interval(tmp_path: Path) -> None:
    chain = load_chain(stored(tmp_path, TODAY))
    alone = chain.torque(Readings(np.array([100.0])))
    assert share_of_limit(alone.component("drift"), alone.value_nm) == pytest.approx(1.0)
    record = chain.torque(
        Readings(np.array([100.0, 101.0]), time_s=np.array([0.0, 1.0]), measured_on=TODAY)
    )
    assert not record.component("drift").any()
    stated = Readings(np.array([100.0]), measured_on=TODAY, calibration_age_h=8766.0)
    assert share_of_limit(chain.torque(stated).component("drift"), alone.value_nm) == pytest.approx(
        1.0
    )


def test_the_day_belongs_to_points_models_and_files(tmp_path: Path) -> None:
    day = date(2025, 3, 31)
    data = points(day)
    text = calibration_csv(data)
    assert "# measured_on = 2025-03-31\n" in text
    assert parse_calibration(text, "a table").measured_on == day
    assert replace(data, measured_on="2025-03-31").measured_on == day  # as results hold it
    assert load_model(stored(tmp_path, day)).provenance.calibrated_on == "2025-03-31"
    (fitted,) = fit_models(data, [ModelChoice("polynomial-1")])
    assert fitted.chain.calibrated_on == day
    assert fitted.chain.with_effects([DRIFT]).age_h(date(2025, 4, 1)) == 24.0
    later = points(date(2025, 6, 1))
    assert CalibrationData.concatenate([later, data]).measured_on == day
    assert CalibrationData.concatenate([data, points(None)]).measured_on is None
    assert MeasuringChain(fitted.model).age_h(day) is None


@pytest.mark.parametrize("said", ["31.3.2025", "spring"])
def test_a_day_that_is_none_is_named(said: str) -> None:
    text = calibration_csv(points(date(2025, 3, 31))).replace("2025-03-31", said)
    with pytest.raises(InputError, match=f"the comment says measured_on = '{said}'"):
        parse_calibration(text, "a table")
