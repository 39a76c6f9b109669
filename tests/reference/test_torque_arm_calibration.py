"""A real torque arm, 0 to 360 N·m, ten points up and ten down.

Source: UNH-CORE turbine test bed, P. Bachant (MIT). The reading is the load cell's signal in V/V,
so the chain's published joint linear sensitivity comes first. The reference was typed in with a
resolution of 0.5 lbf at an arm of 0.2032 m: 0.45 N·m, which is 0.13 % of the range. Twenty points
with such a reference show a hysteresis of 0.9 % of the range and a curvature; they don't support
a statement about errors below about 0.1 % of the range, whatever a model leaves on them.
"""

import json
import re

import numpy as np
import pytest

from torquebench.calibration import (
    CalibrationData,
    evaluate_static,
    infer_branch,
    loading_series,
    summarise_errors,
)
from torquebench.compensation import compare
from torquebench.errors import InputError
from torquebench.tables import read_calibration, write_calibration

RANGE_NM = 360.0
REFERENCE_RESOLUTION_NM = 0.45


@pytest.fixture(scope="module")
def published(reference_data):
    path = reference_data("unh-torque-arm-cal/torque_arm_calibration.json")
    return json.loads(path.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def tables(reference_data):
    folder = reference_data("unh-torque-arm-cal")
    return [
        np.genfromtxt(folder / f"torque_arm_{name}.csv", delimiter=",", names=True)
        for name in ("ascending", "descending")
    ]


@pytest.fixture(scope="module")
def data(published, tables):
    line = published["linear regression all"]
    signal, standard, nominal = (
        np.concatenate([table[name] for table in tables])
        for name in ("mean_volts_per_volt", "mean_torque", "nominal_torque")
    )
    series = np.repeat([1, 2], 10)
    return CalibrationData(
        reading_nm=line["slope"] * signal + line["intercept"],
        standard_nm=standard,
        series=series,
        branch=infer_branch(standard, series),
        range_nm=RANGE_NM,
        nominal_nm=nominal,
    )


@pytest.mark.parametrize(
    ("name", "parts"), [("all", (0, 1)), ("ascending", (0,)), ("descending", (1,))]
)
def test_the_published_lines_follow_from_the_points(published, tables, name, parts):
    signal, standard = (
        np.concatenate([tables[part][column] for part in parts])
        for column in ("mean_volts_per_volt", "mean_torque")
    )
    line = published[f"linear regression {name}"]
    slope, intercept = np.polyfit(signal, standard, 1)
    assert slope == pytest.approx(line["slope"], rel=1e-9)
    assert intercept == pytest.approx(line["intercept"], rel=1e-9)


def test_branches_and_notes(data):
    assert data.branch.tolist() == [1] * 10 + [-1] * 10
    assert data.notes() == ("only clockwise points: nothing is known of counter-clockwise torque",)


def test_errors_that_the_linear_sensitivity_leaves(data):
    raw = summarise_errors(data.reading_nm, data.standard_nm, RANGE_NM)
    assert raw.worst_nm == pytest.approx(2.69, abs=0.005)
    assert raw.worst_percent_fs == pytest.approx(0.75, abs=0.005)
    # The published standard deviation of 1.63 N·m has 20 − 2 degrees of freedom.
    assert raw.rms_nm * np.sqrt(20 / 18) == pytest.approx(1.63, abs=0.005)


def test_reversibility_of_the_chain(data):
    # Ten points up are one series and ten points down another: joined they are one rise and fall,
    # each from its own zero.
    zero = np.where(data.series == 1, data.reading_nm[0], data.reading_nm[-1])
    joined = CalibrationData(
        reading_nm=data.reading_nm - zero,
        standard_nm=data.standard_nm,
        series=np.ones(20),
        branch=data.branch,
        range_nm=RANGE_NM,
        nominal_nm=data.nominal_nm,
        tared=True,
    )
    loading = loading_series(joined, 1)
    assert re.search(r"the step 40 N·m of series 1 .* deviation 5\.08 %", loading.remarks[0])
    torque = loading.torque_nm
    result = evaluate_static(
        torque, loading.series, resolution=0.01, reference_uncertainty_percent=0.2, scale=1.0
    )
    span_percent = result.reversibility_percent * result.mean / result.span
    assert span_percent[torque == 280.0] == pytest.approx(0.94, abs=0.04)
    assert span_percent[torque == 40.0] == pytest.approx(0.13, abs=0.04)


@pytest.mark.nightly
def test_models_are_compared_and_none_is_better_than_the_reference_resolves(data, tmp_path):
    path = tmp_path / "torque-arm.csv"
    write_calibration(path, data)
    table = read_calibration(path)
    assert table.sha256() == data.sha256()

    result = compare(table.features(), table.standard_nm, range_nm=RANGE_NM)
    scores = {score.name: score for score in result.scores}
    # What points left out show: the loop is real, and a model that sees the branch halves the
    # error of the best one that doesn't; none gets below the reference's resolution.
    blind = min(score.rms_nm for name, score in scores.items() if name.startswith("polynomial"))
    assert result.best == "hybrid"
    assert scores["hybrid"].rms_nm < 0.6 * blind < 0.6 * scores["polynomial-1"].rms_nm
    assert scores["hybrid"].rms_nm > REFERENCE_RESOLUTION_NM / np.sqrt(12)
    fitted = summarise_errors(
        result.models["hybrid"].predict(table.features()), table.standard_nm, RANGE_NM
    )
    raw = summarise_errors(table.reading_nm, table.standard_nm, RANGE_NM)
    assert fitted.rms_nm < raw.rms_nm
    # One direction only: the model refuses the other.
    with pytest.raises(InputError):
        result.models["hybrid"].predict(np.array([[-100.0, 1.0, 1.0]]))
