"""`import torquebench as tb`: frames in and out by their columns' names, short words for values."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from sklearn.model_selection import cross_val_score

import torquebench as tb
from torquebench.compensation import features, make_model

COUNT = 21
MAKERS: list[Callable[[dict[str, Any]], Any]] = [pd.DataFrame, pl.DataFrame, pa.table]


def points() -> dict[str, Any]:
    """Both ways over the range of a chain whose error differs between them by up to 0.4 N·m."""
    up = np.linspace(-100.0, 100.0, COUNT)
    reading = np.concatenate([up, up[::-1]])
    way = np.repeat([1.0, -1.0], COUNT)
    noise = np.random.default_rng(3).normal(0.0, 0.02, reading.size)
    standard = 1.01 * reading + 0.2 * way * (1.0 - (reading / 100.0) ** 2) + noise
    return {
        "branch": ["up" if each >= 0 else "down" for each in way * reading],
        "note": ["as found"] * reading.size,
        "standard_nm": standard,
        "reading_nm": reading,
    }


@pytest.fixture(scope="module")
def compensation() -> tb.Compensation:
    calibration = tb.read_calibration(points(), range_nm=100.0)
    return tb.fit(calibration, "hybrid", reference="0.05 of range")


@pytest.mark.parametrize("make", MAKERS)
def test_a_calibration_is_read_by_names(make: Callable[[dict[str, Any]], Any]) -> None:
    table = points()
    found = tb.read_calibration(make(table), range_nm=100.0)
    assert found.reading_nm.tolist() == table["reading_nm"].tolist()
    assert found.branch.tolist() == [{"up": 1, "down": -1}[word] for word in table["branch"]]
    assert found.sha256() == tb.read_calibration(table, range_nm=100.0).sha256()
    other = make({"Anzeige": [1.0, 900.0], "Moment": [0.0, 1.0], "Ast": ["auf", "auf"]})
    renamed = {"reading": "Anzeige[Nm]", "standard": "-Moment[kNm]", "branch": "Ast"}
    assert tb.read_calibration(other, columns=renamed).standard_nm.tolist() == [0.0, -1000.0]


@pytest.mark.parametrize("make", MAKERS)
def test_readings_come_back_as_they_came(
    make: Callable[[dict[str, Any]], Any], compensation: tb.Compensation
) -> None:
    frame = make({"branch": ["up", "down"], "reading_nm": [50.0, 50.0], "who": ["a", "b"]})
    torque = compensation.apply(frame)
    assert type(torque) is type(frame)
    back = pl.DataFrame(torque)
    assert back.columns[:3] == ["branch", "reading_nm", "who"]
    up, down = back["torque_nm"].to_list()
    assert up == pytest.approx(50.65, abs=0.1)
    assert down == pytest.approx(50.35, abs=0.1)
    assert back["additional_torque_nm"].to_list() == pytest.approx([up - 50.0, down - 50.0])
    assert min(back["expanded_uncertainty_nm"].to_list()) > 0.0
    single = compensation.torque(50.0, branch="up")
    assert float(single.value_nm[0]) == pytest.approx(up)
    with pytest.raises(tb.InputError, match="torque_nm already"):
        compensation.apply(torque)


def test_a_file_of_readings_gives_an_arrow_table(
    compensation: tb.Compensation, tmp_path: Path
) -> None:
    csv = tmp_path / "readings.csv"
    csv.write_text("# simulated = true\nAnzeige [Nm];Ast;Prüfer\n50,0;auf;Ana\n50,0;ab;Ana\n")
    by_csv = compensation.apply(csv)
    assert by_csv.column_names[:4] == ["Anzeige [Nm]", "Ast", "Prüfer", "torque_nm"]
    assert by_csv.schema.metadata == {b"simulated": b"true"}
    pq.write_table(by_csv.select(["Anzeige [Nm]", "Ast", "Prüfer"]), tmp_path / "readings.parquet")
    assert compensation.apply(tmp_path / "readings.parquet").equals(by_csv)
    with pytest.raises(tb.InputError, match="No such file"):
        compensation.apply(tmp_path / "none.csv")


@pytest.mark.parametrize("given", ["x", pl.DataFrame({"reading_nm": [1.0], "branch": ["up"]})])
def test_a_table_in_the_place_of_readings_is_named(
    compensation: tb.Compensation, given: Any
) -> None:
    with pytest.raises(tb.InputError, match="give a table to `apply`"):
        compensation.torque(given)
    with pytest.raises(tb.InputError, match="branch 'sideways'"):
        compensation.torque(1.0, branch="sideways")


def test_an_index_of_pandas_stays_with_its_rows(compensation: tb.Compensation) -> None:
    frame = pd.DataFrame({"reading_nm": [10.0, 90.0]}, index=["low", "high"]).iloc[::-1]
    torque = compensation.apply(frame)["torque_nm"]
    assert torque["high"] > 85.0 > 15.0 > torque["low"]


@pytest.mark.parametrize("make", MAKERS)
def test_an_estimator_takes_columns_by_names(make: Callable[[dict[str, Any]], Any]) -> None:
    table = points()
    names = ("branch", "reading_nm")  # swapped: by position the branch would be the reading
    frame = make({name: table[name] for name in names})
    X = features(table["reading_nm"], table["branch"])
    model = make_model("hybrid", range_nm=100.0)
    by_name = model.fit(frame, table["standard_nm"]).predict(frame)
    assert by_name.tolist() == model.fit(X, table["standard_nm"]).predict(X).tolist()
    with pytest.raises(tb.InputError, match="without the column reading_nm"):
        model.predict(make({"branch": ["up"]}))


@pytest.mark.nightly
@pytest.mark.usefixtures("curve_alone")
def test_scikit_learn_validates_without_nan() -> None:
    table = points()
    frame = pd.DataFrame(table)[["branch", "reading_nm"]]
    for model in (make_model("polynomial-2"), make_model("polynomial-2", range_nm=100.0)):
        scores = cross_val_score(model, frame, table["standard_nm"], error_score="raise")
        assert np.all(scores > 0.99)


def test_words_for_values_are_short(compensation: tb.Compensation) -> None:
    calibration = tb.read_calibration(points(), range_nm=100.0)
    comparison = tb.compare(calibration, ["polynomial-1", "polynomial-2"])
    assert len(repr(make_model("polynomial-2"))) < 120
    for value in (calibration, compensation, comparison, compensation.torque([1.0, 2.0])):
        assert len(repr(value)) < 120
        assert "<" in value._repr_html_()
    assert "raw reading" in comparison._repr_html_()
    assert pl.DataFrame(calibration).shape == (2 * COUNT, 4)


def test_figures_are_drawn_and_saved(compensation: tb.Compensation, tmp_path: Path) -> None:
    calibration = tb.read_calibration(points(), range_nm=100.0)
    comparison = tb.compare(calibration, ["polynomial-1", "polynomial-2"])
    stored = tb.load_model(compensation.save(tmp_path / "model.json"))
    for thing in (calibration, compensation, comparison, stored):
        assert "<svg" in tb.plot(thing)._repr_svg_()
    assert tb.plot(stored).save(tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(tb.InputError, match="svg"):
        tb.plot(stored).save(tmp_path / "a.gif")
    with pytest.raises(tb.InputError, match="a plot of a int"):
        tb.plot(3)  # type: ignore[arg-type]


def test_what_is_wrong_with_a_fit_is_a_warning() -> None:
    table = points()
    table["standard_nm"] = table["standard_nm"].copy()
    table["standard_nm"][5] += 1.5
    with pytest.warns(tb.FitWarning) as caught:
        tb.fit(tb.read_calibration(table, range_nm=100.0), "polynomial-2")
    assert "row 6: reading" in str(caught[0].message)
    assert "U of the reference standard isn't in U" in str(caught[-1].message)


def test_a_missing_column_names_the_parameter() -> None:
    with pytest.raises(tb.InputError, match="columns=") as caught:
        tb.read_calibration({"reading_nm": [1.0, 2.0], "drehmoment": [1.0, 2.0]})
    assert "--column" not in str(caught.value)
    with pytest.raises(tb.InputError, match="a int instead of a table"):
        tb.read_calibration(3)


def test_pandas_and_polars_are_optional() -> None:
    code = (
        "import sys, torquebench as tb\n"
        "assert 'numpy' not in sys.modules\n"
        "class Absent:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name in ('pandas', 'polars'):\n"
        "            raise ModuleNotFoundError(name)\n"
        "sys.meta_path.insert(0, Absent())\n"
        "reading = [-2.0, -1.0, 0.0, 1.0, 2.0]\n"
        "points = {'reading_nm': reading, 'standard_nm': reading, 'branch': ['up'] * 5}\n"
        "print(tb.read_calibration(points, range_nm=2.0))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "CalibrationData(5 points, 2 N·m)"
