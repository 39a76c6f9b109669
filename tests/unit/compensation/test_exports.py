"""Exports, each read back by what will read it: NumPy, a C compiler, ONNX Runtime."""

import itertools
import json
import subprocess
import sys

import numpy as np
import onnx
import onnxruntime
import pytest
from tests.support.structured_text import Program

from torquebench.compensation import Provenance, features, make_model
from torquebench.compensation.export.branches import followed_branches, turning_nm
from torquebench.compensation.export.formats import export_table
from torquebench.compensation.hysteresis import HistoryCompensator, one_sided_path
from torquebench.compensation.table import compile_table
from torquebench.errors import InputError

_RANGE = 2000.0
_PROVENANCE = Provenance(
    range_nm=_RANGE,
    side="output",
    transducer_serial="T-4711",
    counter_identity="counter 1",
    training_data_sha256="ab" * 32,
    software_version="0.1.0",
    created="2024-05-17T10:00:00+00:00",
    metrics={"worst_percent_fs": 0.03, "noise_nm": 0.412},
)


def with_faults(table, reading, branch):
    """The table's torque, at the nearest limit where a reading is outside, and which ones are."""
    torque = np.empty(reading.size)
    outside = table.curve.evaluate(reading, branch.astype(np.int8), torque)
    fault = ~((reading >= table.reading_low_nm) & (reading <= table.reading_high_nm))
    assert np.count_nonzero(fault) == outside
    return torque, fault


def _model(kind):
    share = np.linspace(0.0, 1.0, 14)
    share = np.concatenate([share, share[::-1], -share, -share[::-1]])
    branch = np.repeat([1.0, -1.0, 1.0, -1.0], 14)
    extra = 3e-3 * share + 2e-3 * share * np.abs(share) + 3e-4 * np.tanh(share / 0.01)
    extra += 2e-4 * np.sign(share) * branch * np.abs(share) * (1 - np.abs(share))
    extra += 1e-4 * np.sin(40.0 * share)
    reading = _RANGE * (share - extra)
    X, standard = features(reading, branch), _RANGE * share
    if kind == "step":
        parameters = {"per_direction": True, "degree": 2, "outliers": "keep"}
        standard = standard + np.sign(share)
        return make_model("polynomial", range_nm=_RANGE, **parameters).fit(X, standard)
    return make_model(kind, range_nm=_RANGE).fit(X, standard)


@pytest.fixture(scope="module", params=["hybrid", "radial-basis", "step"])
def case(request):
    model = _model(request.param)
    # a tight tolerance makes the network's table cubic
    tolerance = 1e-9 if request.param == "radial-basis" else 1e-6
    return model, compile_table(model, tolerance=tolerance)


@pytest.fixture(scope="module")
def probe(case):
    table = case[1]
    generator = np.random.default_rng(5)
    spread = generator.uniform(table.reading_low_nm, table.reading_high_nm, 500)
    near = generator.uniform(-50.0, 50.0, 200)
    ends = [table.reading_low_nm, table.reading_high_nm, 0.0, 1e-3, -1e-3]
    reading = np.concatenate([spread, near, ends])
    return reading, generator.integers(-1, 2, reading.size)


def test_tables_of_both_degrees_are_exported(case):
    model, table = case
    assert table.curve.degree == (3 if model.kind == "radial-basis" else 1)


def test_csv_is_read_back(case, probe, tmp_path):
    model, table = case
    path = export_table(tmp_path / "table.csv", table, _PROVENANCE)
    lines = path.read_text("ascii").splitlines()
    comments = int(lines[0].split()[1])
    assert all(line.startswith("#") for line in lines[:comments])
    assert "transducer: T-4711" in "\n".join(lines[:comments])
    assert "# scatter of a single reading: 0.412 N m (k = 1)" in lines[:comments]
    names = lines[comments].split(",")
    rows = np.loadtxt(path, delimiter=",", skiprows=comments + 1)
    assert np.all(np.diff(rows[:, 0]) > 0)
    assert (rows[0, 0], rows[-1, 0]) == (table.reading_low_nm, table.reading_high_nm)
    stated = float(next(line for line in lines if "between the rows" in line).split()[-3])
    reading, _ = probe
    for branch, name in ((1, "up"), (-1, "down"), (0, "unknown")):
        column = rows[:, names.index(f"torque_{name}_nm")]
        beside = np.where(reading == 0.0, 1e-9, reading)  # 0 counts as clockwise in tables
        X = features(beside, np.full(reading.size, branch))
        error = np.abs(np.interp(reading, rows[:, 0], column) - model.predict(X))
        assert error.max() <= stated * 1.01
        assert stated < 2e-6 * _RANGE
        deviation = rows[:, names.index(f"curve_uncertainty_{name}_nm")]
        expected = model.predict(X, return_std=True)[1]
        read_back = np.interp(reading, rows[:, 0], deviation)
        beside = reading != 0.0  # at 0 itself a model has no direction, a table takes the positive
        np.testing.assert_allclose(
            read_back[beside], expected[beside], rtol=0.05, atol=2e-6 * _RANGE
        )


def test_csv_with_decimal_commas_holds_the_same_numbers(case, tmp_path):
    table = case[1]
    plain = export_table(tmp_path / "plain.csv", table, _PROVENANCE).read_text("ascii")
    commas = export_table(tmp_path / "commas.csv", table, _PROVENANCE, decimal_comma=True)
    comments = int(plain.split()[1])
    numbers = [line.replace(";", ".") for line in commas.read_text("ascii").splitlines()]
    swapped = [line.translate(str.maketrans(",.", ".,")) for line in numbers]
    assert swapped[comments:] == plain.splitlines()[comments:]
    with pytest.raises(InputError, match=r"decimal comma in table\.h"):
        export_table(tmp_path / "table.h", table, _PROVENANCE, decimal_comma=True)


_PROGRAM = """
#include <stdio.h>
#include "my_table.h"
int main(void)
{
    double reading, torque, deviation;
    int branch;
    while (scanf("%lf %d", &reading, &branch) == 2) {
        int outside = my_table_torque(reading, branch, &torque);
        my_table_curve_uncertainty(reading, branch, &deviation);
        printf("%d %.17g %.17g\\n", outside, torque, deviation);
    }
    return 0;
}
"""


def test_c_header_is_compiled_and_agrees(case, probe, tmp_path):
    _, table = case
    export_table(tmp_path / "my_table.h", table, _PROVENANCE)
    (tmp_path / "main.c").write_text(_PROGRAM)
    flags = ["-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror"]
    plain_c = ["cc", "-std=c99", "-O1", *flags, "main.c", "-o", "main"]
    subprocess.run(plain_c, cwd=tmp_path, check=True)
    cpp = ["c++", "-x", "c++", "-std=c++11", "-fsyntax-only", *flags, "main.c"]
    subprocess.run(cpp, cwd=tmp_path, check=True)
    reading, branch = probe
    reading = np.concatenate([reading, [2500.0, -2500.0, np.nan]])
    branch = np.concatenate([branch, [1, -1, 0]])
    text = "\n".join(f"{r!r} {b}" for r, b in zip(reading.tolist(), branch.tolist(), strict=True))
    result = subprocess.run(
        [tmp_path / "main"], input=text, capture_output=True, text=True, check=True
    )
    rows = np.array([line.split() for line in result.stdout.splitlines()], dtype=float)
    expected, fault = with_faults(table, reading, branch)
    np.testing.assert_array_equal(rows[:, 0] != 0, fault)
    np.testing.assert_allclose(rows[:, 1], expected, atol=1e-6)
    np.testing.assert_allclose(rows[:, 2], table.standard_uncertainty(reading, branch), atol=1e-6)


def test_structured_text_runs_on_an_interpreter_and_agrees(case, probe, tmp_path):
    _, table = case
    path = export_table(tmp_path / "8 chain.st", table, _PROVENANCE)
    units = Program(path.read_text("ascii")).units
    torque, spread, block = (
        units[f"table_8_chain_{name}"] for name in ("torque", "curve_uncertainty", "compensation")
    )
    reading, branch = probe
    found = [torque(*row) for row in zip(reading.tolist(), branch.tolist(), strict=True)]
    np.testing.assert_allclose(found, table.torque(reading, branch), atol=1e-6)
    found = [spread(*row) for row in zip(reading.tolist(), branch.tolist(), strict=True)]
    np.testing.assert_allclose(found, table.standard_uncertainty(reading, branch), atol=1e-6)
    stream = _stream(table)
    branches = followed_branches(stream, turning_nm(table))
    for value, side in zip(stream.tolist(), branches.tolist(), strict=True):
        block(value)
        assert block.values["branch"] == side
        assert not block.values["outside"]
        assert block.values["torque_nm"] == pytest.approx(table.at(value, side), abs=1e-6)
    for outside in (1.1 * table.reading_high_nm, np.nan):
        block(outside)
        assert block.values["outside"]
        assert block.values["branch"] == branches[-1] or outside == outside


def _stream(table):
    """A noisy random walk between random turning points."""
    generator = np.random.default_rng(11)
    turns = generator.uniform(table.reading_low_nm, table.reading_high_nm, 12) * 0.98
    steps = [np.linspace(a, b, 40) for a, b in itertools.pairwise([0.0, *turns])]
    walk = np.concatenate(steps)
    return walk + 0.2 * turning_nm(table) * generator.standard_normal(walk.size)


def test_the_branch_function_of_the_c_header_follows_the_readings(case, tmp_path):
    _, table = case
    export_table(tmp_path / "my_table.h", table, _PROVENANCE)
    program = _PROGRAM.replace(
        "double reading", "my_table_history history = {0, 0, 0.0}; double reading"
    )
    program = program.replace(
        "&reading, &branch) == 2",
        "&reading, &branch) == 2 && (branch = my_table_branch(reading, &history)) < 2",
    )
    program = program.replace('%d %.17g %.17g\\n", outside', '%d %.17g %.17g\\n", branch')
    (tmp_path / "main.c").write_text(program.replace("int outside =", "(void)"))
    subprocess.run(
        ["cc", "-std=c99", "-Wall", "-Werror", "main.c", "-o", "main"], cwd=tmp_path, check=True
    )
    stream = _stream(table)
    done = subprocess.run(
        [tmp_path / "main"], input="\n".join(f"{r!r} 0" for r in stream.tolist()),
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    found = [int(line.split()[0]) for line in done.stdout.splitlines()]
    assert found == followed_branches(stream, turning_nm(table)).tolist()


def test_exports_state_their_largest_deviation_over_partial_loops(case, tmp_path):
    """A header stated 0.001 N·m where partial loops deviate by 0.48 N·m."""
    _, table = case
    for ending in ("csv", "h", "st"):
        text = export_table(tmp_path / f"a.{ending}", table, _PROVENANCE).read_text("ascii")
        lines = [line for line in text.splitlines() if "partial loops" in line]
        assert len(lines) == table.curve.branch_aware
    if not table.curve.branch_aware:
        return
    stated = float(lines[0].split()[-3])
    stream = _stream(table)
    live = HistoryCompensator(table)
    live.push(one_sided_path(table.full_scale_nm)[:5])
    error = live.push(stream).torque_nm - table.torque(
        stream, followed_branches(stream, turning_nm(table))
    )
    assert 0.2 * stated < np.abs(error[40:]).max() < 1.1 * stated


def test_onnx_runs_and_agrees(case, probe, tmp_path):
    _, table = case
    path = export_table(tmp_path / "table.onnx", table, _PROVENANCE)
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    reading, branch = probe
    reading = np.concatenate([reading, [2500.0, np.nan]])
    branch = np.concatenate([branch, [1, 0]]).astype(np.int64)
    torque, deviation, inside = session.run(
        ["torque_nm", "curve_uncertainty_nm", "in_range"],
        {"reading_nm": reading, "branch": branch},
    )
    expected, fault = with_faults(table, reading, branch)
    assert torque.dtype == np.float64
    np.testing.assert_array_equal(inside, ~fault)
    np.testing.assert_allclose(torque, expected, atol=1e-6)
    np.testing.assert_allclose(deviation, table.standard_uncertainty(reading, branch), atol=1e-6)
    metadata = {item.key: item.value for item in onnx.load(path).metadata_props}
    assert json.loads(metadata["provenance"])["transducer_serial"] == "T-4711"


def test_the_onnx_model_follows_the_readings_in_pieces(case, tmp_path):
    _, table = case
    path = export_table(tmp_path / "table.onnx", table, _PROVENANCE)
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    names = [output.name for output in session.get_outputs()]
    assert ("history_after" in names) == table.curve.branch_aware
    if not table.curve.branch_aware:
        return
    stream = _stream(table)
    branches = followed_branches(stream, turning_nm(table))
    history, torque, found = {}, [], []
    for part in np.split(stream, [1, 7, 200]):
        given = {"reading_nm": part, "branch": np.full(part.size, 2)}
        answer = dict(zip(names, session.run(None, {**given, **history}), strict=True))
        history = {"history": answer["history_after"]}
        torque.extend(answer["torque_nm"])
        found.extend(answer["branch_followed"])
    np.testing.assert_array_equal(found, branches)
    np.testing.assert_allclose(torque, table.torque(stream, branches), atol=1e-6)


def test_same_table_gives_the_same_bytes(case, tmp_path):
    for ending in ("csv", "h", "onnx", "st"):
        first = export_table(tmp_path / f"a.{ending}", case[1], _PROVENANCE).read_bytes()
        assert export_table(tmp_path / f"a.{ending}", case[1], _PROVENANCE).read_bytes() == first
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.csv", "a.h", "a.onnx", "a.st"]


@pytest.fixture(scope="module")
def plain():
    reading = np.linspace(-100.0, 100.0, 21)
    model = make_model("polynomial").fit(features(reading), 1.01 * reading)
    return compile_table(model, uncertainty=False)


def test_table_without_branches_or_uncertainty(plain, tmp_path):
    header = export_table(tmp_path / "7 plain.h", plain, Provenance(100.0)).read_text()
    assert "table_7_plain_torque" in header
    assert "curve_uncertainty" not in header
    path = export_table(tmp_path / "plain.onnx", plain, Provenance(100.0))
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    assert [output.name for output in session.get_outputs()] == ["torque_nm", "in_range"]


def test_unknown_ending_missing_folder_and_missing_package(plain, tmp_path, monkeypatch):
    with pytest.raises(InputError, match=r"\.csv, \.h, \.onnx, \.st"):
        export_table(tmp_path / "table.xlsx", plain, _PROVENANCE)
    with pytest.raises(InputError, match="can't write"):
        export_table(tmp_path / "no folder" / "table.h", plain, _PROVENANCE)
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(InputError, match=r"torquebench\[onnx\]"):
        export_table(tmp_path / "table.onnx", plain, _PROVENANCE)
