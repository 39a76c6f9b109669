from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from torquebench.calibration import CalibrationData
from torquebench.campaign.drifting import drift_of, next_due
from torquebench.campaign.fitting import store_model
from torquebench.chain import Inertia, MeasuredRotation, MeasuredTemperature
from torquebench.compensation import make_model
from torquebench.records import CalibrationEntry, Registry, RunSummary, Zeroing

START = datetime(2024, 1, 31, 12, 0, tzinfo=UTC)


@pytest.fixture
def registry(tmp_path):
    with Registry.open(tmp_path) as opened:
        yield opened


def calibrate(registry, moment, gain, up_to=50.0):
    torque = np.array([-1.0, -0.5, 0.5, 1.0]) * up_to
    data = CalibrationData(
        torque * gain,
        torque,
        [1] * 4,
        [1] * 4,
        50.0,
        transducer_serial="T-1",
        counter_identity="C-1",
        simulated=True,  # points may repeat
    )
    registry.add_calibration(CalibrationEntry.of_points(data, performed=moment))


def test_a_steady_drift_is_found_and_calibrated_in_time(registry):
    for number in range(7):
        calibrate(registry, START + timedelta(days=91 * number), 1.0 + 2e-4 * number)
    clockwise, counter_clockwise = drift_of(registry, "T-1", tolerance_percent=0.15)
    assert clockwise.values == pytest.approx([0.02 * number for number in range(7)])
    assert clockwise.trend.significant
    assert clockwise.trend.per_year == pytest.approx(0.02 * 365.25 / 91, rel=1e-6)
    # 0.15 % beyond the last calibration, which the chain is compensated by
    left = clockwise.prediction.expected - clockwise.moments[-1]
    assert left == pytest.approx(timedelta(days=91 * 7.5), abs=timedelta(days=2))
    due = next_due((clockwise, counter_clockwise), longest_days=365)
    assert clockwise.moments[-1].date() <= due <= clockwise.prediction.expected.date()


def test_the_chart_reads_in_the_order_of_measuring_not_of_entering(registry):
    calibrate(registry, START + timedelta(days=50), 1.001)
    calibrate(registry, START, 1.0)
    (clockwise, _) = drift_of(registry, "T-1", tolerance_percent=0.1)
    assert clockwise.values == pytest.approx([0.0, 0.1])
    assert clockwise.chart is None
    assert clockwise.prediction is None
    assert next_due((clockwise,), longest_days=100) == (START + timedelta(days=150)).date()


def test_one_zero_a_run_enters_the_chart_and_an_hour_predicts_nothing(registry, tmp_path):
    from torquebench.records import Equipment

    registry.add_equipment(Equipment("transducer", "T-1", range_nm=50.0))
    for run in range(4):
        name = f"run-{run}"
        registry.add_run(
            RunSummary(
                run_id=name,
                kind="zero",
                started=START,
                simulated=True,
                software_version="0.1.0",
                folder=tmp_path / name,
            )
        )
        for again in range(3):
            moment = START + timedelta(minutes=10 * run + again)
            registry.add_zeroing(
                Zeroing(
                    transducer_serial="T-1",
                    performed=moment,
                    zero_hz=6e4,
                    zero_nm=0.05 * run + again,
                    run_id=name,
                )
            )
    (zero,) = drift_of(registry, "T-1", tolerance_percent=0.1)
    assert zero.values == pytest.approx([0.0, 0.1, 0.2, 0.3])
    assert zero.chart is not None
    assert zero.trend is None
    assert zero.prediction is None
    assert next_due((zero,), longest_days=365) is None


def test_remarks_say_what_the_chart_sees(registry):
    for number, gain in enumerate([1.0, 1.0001, 1.0, 1.0001, 1.0, 1.01]):
        calibrate(registry, START + timedelta(days=number), gain)
    clockwise, _ = drift_of(registry, "T-1", tolerance_percent=0.1, base=5)
    assert [clockwise.remark(row) for row in range(6)] == [*[""] * 5, "outside the limits, a jump"]


def test_spans_over_different_ranges_are_not_compared(registry):
    for number in range(6):
        part = number % 2
        moment = START + timedelta(days=91 * number)
        calibrate(registry, moment, 1.005 if part else 1.0, 15.0 if part else 50.0)
    found = {series.title: series for series in drift_of(registry, "T-1", tolerance_percent=0.1)}
    assert set(found) == {
        f"Span error {direction} up to {reach} N·m"
        for direction in ("clockwise", "counter-clockwise")
        for reach in (50, 15)
    }
    for series in found.values():
        assert len(series.values) == 3
        assert [series.remark(row) for row in range(3)] == ["", "", ""]


def turning_model(registry, folder, number):
    """Enter a calibration with a model whose empty runs showed what has changed since."""
    drag = 0.02 + 0.001 * number
    tables = [((0.0, 0.0), (size, size)) for size in (0.01, 0.001, drag, 0.001)]
    effects = (
        MeasuredTemperature("runs", 23.0, 13.0, 33.0, (13.0, 23.0, 33.0), (-0.05, 0.0, 0.05),
                            (0.001, 0.0, 0.001)),
        MeasuredRotation("runs", 23.0, -1000.0, 1000.0, 13.0, 33.0, (0.0, 1000.0), (13.0, 33.0),
                         *tables, lubrication=1.0 + 0.5 * number),
        Inertia("ramps", 0.0025, 1e-5, 30.0),
    )  # fmt: skip
    torque = np.linspace(-50.0, 50.0, 10)
    data = CalibrationData(torque, torque, [1] * 10, [1] * 10, 50.0, transducer_serial="T-1",
                           counter_identity="C-1", simulated=True)  # fmt: skip
    model = make_model("polynomial", range_nm=50.0).fit(data.features(2), torque)
    file = folder / f"model-{number}.json"
    store_model(file, model, data, {}, effects)
    entry = registry.add_calibration(
        CalibrationEntry.of_points(data, performed=START + timedelta(days=number))
    )
    registry.add_model(entry, kind="polynomial", file=file, side="input", metrics={})


def test_effects_of_empty_runs_have_their_charts(registry, tmp_path):
    turning_model(registry, tmp_path, 0)

    def charts():
        found = drift_of(registry, "T-1", tolerance_percent=0.1, models=registry.models("T-1"))
        return {each.title: each for each in found}

    assert not any("1/min" in title for title in charts())  # one run shows no drift
    turning_model(registry, tmp_path, 1)
    found = charts()
    assert found["Bearing drag at 1000 1/min"].values == pytest.approx([0.04, 1.5 * 0.042])
    assert found["Zero over temperature"].values == pytest.approx([0.1, 0.1])
    assert found["Inertia's torque at 30 rad/s²"].values == pytest.approx([0.15, 0.15])
    assert not any(each.calibrations for title, each in found.items() if "1/min" in title)
    days = tuple(START + timedelta(days=number) for number in range(2))  # not those of the fits
    assert found["Zero over temperature"].moments == days
    (tmp_path / "model-0.json").unlink()
    assert "Bearing drag at 1000 1/min" not in charts()
