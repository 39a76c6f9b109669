"""Rows of a table as readings: records follow their history, steady means say what they are."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from tests.unit.chain.test_measuring_chain import OF_LIMITS, RANGE_NM
from tests.unit.chain.test_measuring_chain import calibration as points
from tests.unit.dynamics.simulated_chain import SimulatedChain, steps

from torquebench.calibration import CalibrationData
from torquebench.campaign.dynamics import identify_dynamics
from torquebench.chain import MeasuringChain, Readings, RecordedStream, joined, rows_of
from torquebench.compensation import Provenance, StoredModel, make_model, save_model
from torquebench.errors import InputError
from torquebench.tables import read_readings
from torquebench.tables.readings import calibration_csv


@pytest.fixture(scope="module")
def chain() -> MeasuringChain:
    """A chain at standstill with hysteresis."""
    return MeasuringChain(make_model("hybrid", range_nm=RANGE_NM).fit(*points()), OF_LIMITS)


def record(count: int = 300) -> Readings:
    turns = 4.5 * np.pi
    return Readings(
        0.9 * RANGE_NM * np.sin(np.linspace(0.0, turns, count)), time_s=0.1 * np.arange(count)
    )


def test_a_record_without_a_branch_follows_the_history(chain: MeasuringChain) -> None:
    rows = record()
    found, live = chain.torque(rows), chain.stream().push(rows)
    np.testing.assert_array_equal(found.value_nm, live.value_nm)
    np.testing.assert_array_equal(found.expanded_uncertainty_nm, live.expanded_uncertainty_nm)
    alone = chain.torque(replace(rows, time_s=None))
    unloading = slice(180, 198)  # after the loop was gone round once
    followed, unknown = (each.component("hysteresis")[unloading] for each in (found, alone))
    assert np.all(followed < 0.35 * unknown)


def test_a_record_is_the_same_however_it_is_cut(chain: MeasuringChain) -> None:
    rows = record()
    assert rows.time_s is not None
    time_s = rows.time_s.copy()
    time_s[120:] += 5.0  # a gap
    time_s[121:] += 3.0  # and one after the next row
    time_s[220:] -= 15.0  # another record
    broken = replace(rows, time_s=time_s)
    whole = chain.torque(broken)
    stream = RecordedStream(chain)
    cuts = [0, 2, 119, 120, 121, 219, 221, 300]
    blocks = [rows_of(broken, slice(*pair)) for pair in pairwise(cuts)]
    pieces = joined([stream.torque(*pair) for pair in pairwise([*blocks, None])])
    np.testing.assert_array_equal(pieces.value_nm, whole.value_nm)
    np.testing.assert_array_equal(pieces.expanded_uncertainty_nm, whole.expanded_uncertainty_nm)
    for start, stop in ((0, 120), (120, 121), (121, 220), (220, 300)):
        own = slice(start, stop)
        alone = chain.torque(rows_of(broken, own))
        np.testing.assert_array_equal(whole.value_nm[own], alone.value_nm)


def test_steady_means_are_taken_at_a_constant_speed_over_the_ripple() -> None:
    steady = CalibrationData([5.0, 6.0], [5.0, 6.0], [1, 1], [1, 1], 10.0, time_s=[0.0, 60.0])
    known = steady.readings()
    assert (known.acceleration_rad_s2, known.window_s, known.time_s) == (0.0, np.inf, None)
    quick = replace(
        steady, time_s=np.array([0.0, 0.1]), speed_rpm=np.zeros(2), angle_rad=np.zeros(2)
    )
    known = quick.readings()
    assert (known.acceleration_rad_s2, known.window_s) == (None, None)
    assert known.time_s is quick.time_s
    assert known.angle_rad is quick.angle_rad
    assert "steady" not in calibration_csv(quick)


def test_the_zero_of_points_is_what_their_table_says_or_one_is_told() -> None:
    warm = CalibrationData([5.0, 6.0], [5.0, 6.0], [1, 1], [1, 1], 10.0, temperature_c=[20.0, 25.0])
    zeroed = warm.readings().zero_temperature_c
    assert np.asarray(zeroed).tolist() == [20.0, 20.0]
    assert warm.readings(zero_temperature_c=22.0).zero_temperature_c == 22.0
    assert warm.readings(zeroed_each_series=False).zero_temperature_c is None


@pytest.mark.parametrize(
    ("comment", "acceleration", "window_s"),
    [("", None, None), ("# steady = true\n", 0.0, np.inf), ("# window_s = 0.25\n", None, 0.25)],
)
def test_a_file_of_readings_states_what_its_rows_are(
    tmp_path: Path, comment: str, acceleration: float | None, window_s: float | None
) -> None:
    file = tmp_path / "readings.csv"
    file.write_text(f"{comment}reading_nm,branch\n5,up\n")
    known = read_readings(file).readings()
    assert (known.acceleration_rad_s2, known.window_s) == (acceleration, window_s)


@pytest.mark.parametrize("window", ["0", "-1", "long"])
def test_a_window_without_a_length_is_named(tmp_path: Path, window: str) -> None:
    file = tmp_path / "readings.csv"
    file.write_text(f"# window_s = {window}\nreading_nm\n5\n")
    with pytest.raises(InputError, match=f"the comment says window_s = '{window}'"):
        read_readings(file).readings()


def test_a_written_calibration_gives_apply_what_it_gives_verify(
    chain: MeasuringChain, tmp_path: Path
) -> None:
    data = CalibrationData(
        [500.0, 900.0], [501.0, 902.0], [1, 1], [1, -1], RANGE_NM, speed_rpm=[10.0, 10.0],
        time_s=[0.0, 50.0], temperature_c=[23.0, 25.0], zero_temperature_c=[23.0, 23.0],
    )  # fmt: skip
    file = tmp_path / "points.csv"
    file.write_text(calibration_csv(data))
    verified = chain.torque(replace(data.readings(), zero_age_h=None))
    applied = chain.torque(read_readings(file).readings(zero_temperature_c=23.0))
    np.testing.assert_array_equal(applied.value_nm, verified.value_nm)
    np.testing.assert_array_equal(applied.expanded_uncertainty_nm, verified.expanded_uncertainty_nm)


def test_dynamics_are_identified_along_the_history_of_a_record(tmp_path: Path) -> None:
    features, standard = points(noise_nm=0.0)
    model = make_model("hybrid", range_nm=RANGE_NM).fit(features, standard)
    save_model(tmp_path / "model.json", StoredModel(model, Provenance(RANGE_NM)))
    time_s, reading, torque = 50.0 * np.array(SimulatedChain().run(steps, 0.09))
    time_s /= 50.0
    curve = MeasuringChain(model)
    followed = curve.torque(Readings(reading, time_s=time_s)).value_nm
    assert np.ptp(followed - curve.torque(Readings(reading)).value_nm) > 0.05

    def table(name: str, column: np.ndarray) -> Path:
        rows = np.column_stack([time_s, column, torque])
        names = "time_s,reading_nm,standard_nm"
        np.savetxt(tmp_path / name, rows, "%.17g", ",", header=names, comments="")
        return tmp_path / name

    found = identify_dynamics([table("raw.csv", reading)], model=tmp_path / "model.json")
    expected = identify_dynamics([table("compensated.csv", followed)])
    assert found.transfer == expected.transfer
