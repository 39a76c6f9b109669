"""Recordings of other benches through the command, with answers that their makers know.

The files in `unit/reducers/field` are synthetic and shaped after public reports.
"""

import gzip
import json
from pathlib import Path

import numpy as np
import pytest
from tests.support import recordings
from tests.system.test_evaluate_reducer_commands import evaluate, refused, write

FIELD = Path(__file__).parents[1] / "unit" / "reducers" / "field"


def told(folder, test, file, *options):
    """Return what the command answers: all quantities by key, and the findings by name."""
    data = FIELD / file
    if data.suffix == ".gz":
        unpacked = folder / data.stem
        unpacked.write_bytes(gzip.decompress(data.read_bytes()))
        data = unpacked
    output = folder / "out"
    found = evaluate(test, data, *options, "--output", output)
    assert found.exit_code == 0, found.output
    content = json.loads((output / "result.json").read_text(encoding="utf-8"))
    keys = [each["key"] for each in content["quantities"]]
    assert len(set(keys)) == len(keys)
    quantities = {each["key"]: each for each in content["quantities"]}
    return quantities, {each["name"]: each["message"] for each in content["findings"]}


def covers(quantity, truth, largest=None):
    """Assert that a value is known, differs from the truth by less than U, and U is no guess."""
    expanded = quantity["coverage_factor"] * quantity["standard_uncertainty"]
    assert expanded > 0.0
    assert quantity["value"] == pytest.approx(truth, abs=expanded + 1e-9)
    if largest is not None:
        assert expanded < largest


def efficiencies(quantities):
    return sorted(
        round(each["value"], 1) for key, each in quantities.items() if "efficiency" in key
    )


def test_points_of_one_speed_keep_their_torques_apart(tmp_path):
    found, _ = told(tmp_path, "efficiency", "efficiency_same_key.csv", "--ratio", 1)
    assert efficiencies(found) == [60.0, 80.0, 90.0]


def test_near_torques_are_points_of_their_own_and_their_u_is_unknown(tmp_path):
    found, findings = told(tmp_path, "efficiency", "efficiency_chain.csv", "--ratio", 10)
    assert efficiencies(found) == [77.8, 78.6, 79.8, 80.0, 82.0, 90.0]
    assert all(each["standard_uncertainty"] is None for each in found.values())
    assert "no repeats" in findings


def test_every_near_torque_is_shown(tmp_path):
    shown = evaluate("efficiency", FIELD / "efficiency_chain.csv", "--ratio", 10).output
    for share in ("77.778", "78.641", "79.808", "80", "82", "90"):
        assert share in shown
    assert "unknown" in shown


def test_a_grid_without_repeats_has_no_u(tmp_path):
    found, _ = told(tmp_path, "efficiency", "efficiency_grid.csv", "--ratio", 10)
    assert efficiencies(found) == [90.0, 91.0, 92.0, 93.0]
    assert all(each["standard_uncertainty"] is None for each in found.values())


def test_both_directions_of_slow_points_stay_apart(tmp_path):
    found, findings = told(tmp_path, "friction", "friction_directions_merged.csv")
    for part in ("coulomb", "viscous"):
        forward, backward = (found[f"{part}_{way}clockwise"] for way in ("", "counter_"))
        assert forward["value"] == pytest.approx(backward["value"])
    assert "at rest" not in findings


@pytest.mark.parametrize("file", ["friction_ramp.csv", "friction_ramp_1_9.csv"])
def test_a_ramp_of_speed_is_read_as_one(tmp_path, file):
    found, findings = told(tmp_path, "friction", file)
    assert found["coulomb_clockwise"]["value"] == pytest.approx(0.5, rel=1e-3)
    per_rpm = found["viscous_clockwise"]["value"] * 3.14159265 / 30.0
    assert per_rpm == pytest.approx(3e-4, rel=1e-3)
    assert "ramp of speed" in findings
    points, findings = told(tmp_path, "no-load", file)
    assert len([key for key in points if key.startswith("no_load")]) > 20
    assert "ramp of speed" in findings


def test_break_away_is_the_torque_before_it_drops(tmp_path):
    found, _ = told(tmp_path, "breakaway", "breakaway_torque_drops.csv.gz", "--kind", "starting")
    covers(found["starting_torque"], 0.3, largest=0.01)


def test_a_staircase_slips_at_a_level_that_was_applied(tmp_path):
    file = "breakaway_staircase.csv"
    found, _ = told(tmp_path, "breakaway", file, "--kind", "back-driving")
    torque = found["back_driving_torque"]
    assert torque["value"] == pytest.approx(9.0)
    assert "slips at 9 N·m, held at 8 N·m" in torque["rule"]
    covers(torque, 8.5, largest=1.5)


LOOP = {"stiffness": 12.5, "backlash": 0.18, "lost_motion": 0.48}


@pytest.mark.parametrize(
    ("file", "options"),
    [
        ("hysteresis_coarse_encoder.csv", ("--column", "angle=enc[counts/16384]")),
        ("hysteresis_stepped.csv", ()),
        ("hysteresis_drift.csv", ()),
    ],
)
def test_loops_are_read_by_counts_by_levels_and_without_their_drift(tmp_path, file, options):
    found, findings = told(tmp_path, "hysteresis", file, "--rated-torque", 100, *options)
    for key, truth in LOOP.items():
        covers(found[key], truth)
    assert ("drift" in findings) == ("drift" in file)


def test_one_noisy_loop_states_what_it_can_tell(tmp_path):
    file = "hysteresis_one_loop.csv"
    found, findings = told(tmp_path, "hysteresis", file, "--rated-torque", 100)
    covers(found["stiffness"], 12.5)
    assert "how they repeat" in findings["few loops"]


@pytest.mark.parametrize(
    ("file", "ratio", "order", "degrees"),
    [
        # 8° of order 4 over the input's angle has overtones over the output's: 12 is too few.
        ("te_strong_order_4.csv", 1, 12, pytest.approx(16.0, rel=0.06)),
        ("te_strong_order_4.csv", 1, 24, pytest.approx(16.0, rel=0.02)),
        ("te_large_error_one_turn.csv", 10, 1, pytest.approx(1.0, rel=1e-3)),
    ],
)
def test_strong_orders_are_no_wrong_ratio(tmp_path, file, ratio, order, degrees):
    options = ("--ratio", ratio, "--highest-order", order)
    found, findings = told(tmp_path, "transmission-error", file, *options)
    assert found["transmission_error"]["value"] / 3600.0 == degrees
    assert ("strong order left out" in findings) == (order == 12)


def test_one_bad_sample_is_named_by_its_row_and_can_be_kept(tmp_path):
    lines = (FIELD / "hysteresis_stepped.csv").read_text(encoding="utf-8").splitlines()
    torque, angle = lines[200].split(",")
    lines[200] = f"{torque},{float(angle) + 50.0}"
    data = tmp_path / "bad.csv"
    data.write_text("\n".join(lines) + "\n", encoding="utf-8")
    found = evaluate("hysteresis", data, "--rated-torque", 100, "--output", tmp_path / "out")
    assert found.exit_code == 0, found.output
    content = json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))
    messages = {each["name"]: each["message"] for each in content["findings"]}
    assert "row 201" in messages["outliers"]
    for each in content["quantities"]:
        if each["key"] in LOOP:
            covers(each, LOOP[each["key"]])
    kept = evaluate("hysteresis", data, "--rated-torque", 100, "--keep-outliers")
    assert "row 201" in kept.output
    assert "kept" in kept.output


def spoilt(test):
    """Return the header, the rows and the options of a recording with a bad sample, and its row."""
    rng = np.random.default_rng(7)
    if test in ("friction", "no-load"):
        record = recordings.speed_record(rng, bad="torque")
        return "speed_rpm,torque_nm", (record.speed, record.torque), (), record.bad_row
    if test == "efficiency":
        points = recordings.efficiency_record(rng, bad=True)
        header = "input_torque_nm,output_torque_nm,speed_rpm"
        columns = (points.drive, points.load, points.speed)
        return header, columns, ("--ratio", points.ratio), points.bad_row
    if test == "breakaway":
        ramps = recordings.ramp_record(rng, bad="torque")
        columns = (ramps.run, ramps.time, ramps.angle, ramps.torque)
        return "run,time_s,angle_arcmin,torque_nm", columns, ("--kind", "starting"), ramps.bad_row
    turns = recordings.angle_record(rng, bad=True, samples=2000, highest=20.0)
    options = ("--ratio", turns.ratio, "--highest-order", 20)
    return "input_deg,output_deg", (turns.driving, turns.driven), options, turns.bad_row


@pytest.mark.parametrize(
    "test", ["friction", "no-load", "efficiency", "breakaway", "transmission-error"]
)
def test_every_command_names_a_bad_sample_as_the_file_counts(tmp_path, test):
    header, columns, options, bad = spoilt(test)
    data = write(tmp_path / "bad.csv", header, np.column_stack(columns).tolist())
    for keep, word in (((), "left out"), (("--keep-outliers",), "kept")):
        found = evaluate(test, data, *options, *keep)
        told = " ".join(found.output.split())
        if keep and found.exit_code == 2:  # a jump of an encoder, for one
            assert "or leave --keep-outliers out" in told
        else:
            assert f"in row {bad + 2}: far from its neighbours, {word}" in told, told


def test_two_encoders_that_swing_give_lost_motion_and_too_few_strokes_are_refused(tmp_path):
    rows = []
    for stroke in range(6):
        for place in range(200):
            across = place / 199.0
            turned = 20.0 * (across if stroke % 2 == 0 else 1.0 - across)
            lag = 0.0 if stroke % 2 == 0 else 0.1  # 6 arcmin
            rows.append([30.0 * turned, round(turned + lag, 6)])
    data = write(tmp_path / "swing.csv", "input_deg,output_deg", rows)
    report = tmp_path / "report.html"
    found = evaluate(
        "transmission-error", data, "--ratio", 30, "--output", tmp_path / "o", "--report", report
    )
    assert found.exit_code == 0, found.output
    content = json.loads((tmp_path / "o" / "result.json").read_text(encoding="utf-8"))
    by_key = {each["key"]: each["value"] for each in content["quantities"]}
    assert by_key["lost_motion"] == pytest.approx(6.0, rel=0.01)
    assert (tmp_path / "o" / "curves.csv").read_text(encoding="utf-8").startswith("stroke,")
    assert "stroke by stroke" in report.read_text(encoding="utf-8")
    ahead = [[given, given / 15.0 - taken] for given, taken in rows]
    late = write(tmp_path / "late.csv", "input_deg,output_deg", ahead)
    found = evaluate("transmission-error", late, "--ratio", 30)
    assert found.exit_code == 1
    assert "delayed" in " ".join(found.output.split())
    short = write(tmp_path / "short.csv", "input_deg,output_deg", rows[:200])
    refused(evaluate("transmission-error", short, "--ratio", 30), "1 strokes", "whole output")


def motor_loops():
    """Current and angle of a motor 50:1 whose output is locked; backlash 0.48 arcmin."""
    rows = []
    for _ in range(3):
        for direction in (1, -1):
            for step in range(201):
                torque = direction * (step - 100.0)
                opened = 0.24 * (1.0 - (torque / 100.0) ** 2)
                twist = (torque / 12.5 - direction * opened) / 60.0
                rows.append([torque / 50.0 / 0.1, 50.0 * twist])
    return rows


def test_a_motors_current_and_angle_give_the_loop_at_the_output(tmp_path):
    data = write(tmp_path / "motor.csv", "current_A,angle_deg", motor_loops())
    options = ("--rated-torque", 100, "--ratio", 50, "--torque-constant", 0.1)
    found = evaluate("hysteresis", data, *options, "--output", tmp_path / "out")
    assert found.exit_code == 0, found.output
    content = json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))
    values = {each["key"]: each["value"] for each in content["quantities"]}
    in_the_middle = 1.0 / 12.5 + 2.0 * 0.24 * 75.0 / 100.0**2
    assert values["stiffness"] == pytest.approx(1.0 / in_the_middle, rel=1e-3)
    assert values["backlash"] == pytest.approx(0.48, rel=2e-3)
    rows = [[5.0 * current, angle] for current, angle in motor_loops()]
    mixed = write(tmp_path / "mixed.csv", "torque_nm,angle_deg", rows)
    options_of = ("--rated-torque", 100, "--ratio", 50, "--motor-columns", "motion")
    found = evaluate("hysteresis", mixed, *options_of, "--output", tmp_path / "mixed")
    content = json.loads((tmp_path / "mixed" / "result.json").read_text(encoding="utf-8"))
    again = {each["key"]: each["value"] for each in content["quantities"]}
    assert again == pytest.approx(values, rel=1e-6)
    # without the current a torque constant says nothing, and without it there is no torque
    torque = write(tmp_path / "torque.csv", "torque_nm,angle_deg", motor_loops())
    refused(evaluate("hysteresis", torque, *options), "no column current")
    refused(evaluate("hysteresis", data, "--rated-torque", 100), "no column torque_nm")
    refused(evaluate("hysteresis", data, *options[:2], "--ratio", 0, *options[4:]), "ratio 0")


def test_several_logs_have_their_speeds_in_their_names_or_comments(tmp_path):
    files = []
    for speed in (-1500, -900, -300, 300, 900, 1500):
        torque = (1000.0 * (0.3 + 2e-4 * abs(speed))) * (1 if speed > 0 else -1)
        rows = [[0.01 * k, torque + (k * 7919) % 11 - 5] for k in range(120)]
        named = speed % 900 == 0
        name = f"drag_{speed}rpm.csv" if named else f"drag {speed}.csv"
        header = "time_s,torque [N·mm]"
        if not named:
            header = f"# speed = {speed / 60.0} rps\n{header}"
        files.append(write(tmp_path / name, header, rows))
    output = tmp_path / "out"
    found = evaluate("friction", *files, "--output", output)
    assert found.exit_code == 0, found.output
    content = json.loads((output / "result.json").read_text(encoding="utf-8"))
    values = {each["key"]: each["value"] for each in content["quantities"]}
    for way in ("clockwise", "counter_clockwise"):
        assert values[f"coulomb_{way}"] == pytest.approx(0.3, rel=0.01)
        assert values[f"viscous_{way}"] * 3.14159265 / 30.0 == pytest.approx(2e-4, rel=0.01)
    assert "121-240" in found.output
    two = write(tmp_path / "drag 5rpm or 6rpm.csv", "time_s,torque_nm", [[0, 1], [1, 2]])
    refused(evaluate("friction", two), "no column speed_rpm")
    refused(evaluate("hysteresis", *files, "--rated-torque", 1), "data = ", "at most 1")


def test_every_ramp_of_several_files_is_a_run(tmp_path):
    unpacked = gzip.decompress((FIELD / "breakaway_torque_drops.csv.gz").read_bytes()).decode()
    header, *rows = unpacked.splitlines()
    half = len(rows) // 2
    runs = [[row.split(",") for row in part] for part in (rows[:half], rows[half:])]
    last = runs[0][-1][0]
    whole = [[row for row in rows if row[0] != last] for rows in runs]
    files = [write(tmp_path / f"{number}.csv", header, part) for number, part in enumerate(whole)]
    found = evaluate("breakaway", *files, "--kind", "starting", "--output", tmp_path / "out")
    assert found.exit_code == 0, found.output
    content = json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))
    quantity = next(each for each in content["quantities"] if each["key"] == "starting_torque")
    covers(quantity, 0.3, largest=0.01)
    count = sum(len({row[0] for row in part}) for part in whole)
    assert f"median of {count} ramps" in quantity["rule"]
