import contextlib
import io
import json
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from tests.swinging_flange import TRUE_BACKLASH, swinging_loop

from torquebench.cli import main

TOLERANCE = 1e-6
SPEEDS = (100.0, 300.0, 600.0, 1000.0)


@dataclass(frozen=True)
class Told:
    exit_code: int
    output: str


def evaluate(*arguments: object) -> Told:
    """Run the command in this process, output and messages together."""
    said = io.StringIO()
    words = ["torquebench", "evaluate", *map(str, arguments)]
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(sys, "argv", words)
        with (
            contextlib.redirect_stdout(said),
            contextlib.redirect_stderr(said),
            pytest.raises(SystemExit) as left,
        ):
            main()
    return Told(int(left.value.code or 0), said.getvalue())


def refused(found: Told, *words: str) -> None:
    assert found.exit_code == 2, found.output
    text = " ".join(found.output.split())
    for word in words:
        assert word in text, text
    assert "Traceback" not in text


def write(path: Path, header: str, rows: list[list[object]]) -> Path:
    lines = [header, *(",".join(str(cell) for cell in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def running() -> list[list[object]]:
    """Speed, torque 0.2 N·m + 0.1 mN·m/rpm against the motion's direction, repeat."""
    return [
        [sign * speed, sign * (0.2 + 1e-4 * speed), repeat]
        for repeat in (1, 2)
        for sign in (1, -1)
        for speed in SPEEDS
    ]


@pytest.fixture
def no_load(tmp_path: Path) -> Path:
    return write(tmp_path / "no-load.csv", "speed_rpm,torque_nm,repeat", running())


def quantities(output: Path) -> dict[str, float]:
    content = json.loads((output / "result.json").read_text(encoding="utf-8"))
    return {each["key"]: each["value"] for each in content["quantities"]}


def test_headers_with_units_are_found_and_everything_is_written(
    no_load: Path, tmp_path: Path
) -> None:
    output = tmp_path / "out"
    found = evaluate("no-load", no_load, "--output", output)
    assert found.exit_code == 0, found.output
    content = json.loads((output / "result.json").read_text(encoding="utf-8"))
    assert content["test"] == "no-load"
    assert content["data"] == "no-load.csv"
    assert len(content["data_sha256"]) == 64
    assert {"quantities", "verdicts", "findings", "settings"} <= set(content)
    assert all(each["unit"] and each["standard_uncertainty"] >= 0 for each in content["quantities"])
    assert [path.name for path in output.iterdir()] == ["result.json"]


def test_columns_of_other_names_units_and_sign_give_the_same(no_load: Path, tmp_path: Path) -> None:
    rows = [[v * np.pi / 30.0, -1e3 * m, n] for v, m, n in running()]  # type: ignore[operator]
    other = write(tmp_path / "other.csv", "Motor,Drag,repeat", rows)
    columns = ("--column", "speed=Motor[rad/s]", "--column", "torque=-Drag[mNm]")
    assert evaluate("no-load", no_load, "--output", tmp_path / "a").exit_code == 0
    found = evaluate("no-load", other, *columns, "--output", tmp_path / "b")
    assert found.exit_code == 0, found.output
    assert quantities(tmp_path / "b") == pytest.approx(quantities(tmp_path / "a"), rel=TOLERANCE)


def test_where_keeps_the_rows_that_are_meant(tmp_path: Path, no_load: Path) -> None:
    spoilt = [[v, 9.0 * m, n, 0] for v, m, n in running()]  # type: ignore[operator]
    rows = [[*row, 1] for row in running()] + spoilt
    mixed = write(tmp_path / "mixed.csv", "speed_rpm,torque_nm,repeat,good", rows)
    assert evaluate("no-load", no_load, "--output", tmp_path / "a").exit_code == 0
    found = evaluate("no-load", mixed, "--where", "good=1", "--output", tmp_path / "b")
    assert found.exit_code == 0, found.output
    assert quantities(tmp_path / "b") == pytest.approx(quantities(tmp_path / "a"), rel=TOLERANCE)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--where", "good=7"), ("no row is left",)),
        (("--where", "nobody=1"), ("--where nobody=1", "speed_rpm")),
        (("--where", "good=yes"), ("no row is left",)),
        (("--column", "torque=Nothing[Nm]"), ("no column Nothing",)),
        (("--column", "torque=torque_nm[rpm]"), ("the unit rpm", "nm")),
        (("--column", "torque=good"), ("names no unit",)),
        (("--column", "weight=good[kg]"), ("--column weight=good[kg]", "speed")),
        (("--column", "torque"), ("NAME=Header[unit]",)),
        (("--column", "torque=a_nm[Nm]", "--column", "torque=torque_nm[Nm]"), ("no column a_nm",)),
        (("--reducer", "nobodys"), ("no reducer 'nobodys'", "rv-40e")),
    ],
)
def test_wrong_options_name_what_there_is(
    tmp_path: Path, options: tuple[str, ...], words: tuple[str, ...]
) -> None:
    rows = [[*row, 1] for row in running()]
    data = write(tmp_path / "data.csv", "speed_rpm,torque_nm,repeat,good", rows)
    refused(evaluate("no-load", data, *options, "--output", tmp_path / "out"), *words)
    assert not (tmp_path / "out").exists()


def test_a_missing_column_file_or_number_is_named(tmp_path: Path) -> None:
    refused(evaluate("no-load", tmp_path / "nothing.csv"), "No such file")
    bare = write(tmp_path / "bare.csv", "speed_rpm,force_n", [[1, 2], [3, 4]])
    refused(evaluate("no-load", bare), "no column torque_nm", "force_n", "--column")
    twice = write(tmp_path / "twice.csv", "speed_rpm,torque_nm,torque_mnm", [[1, 2, 3]])
    refused(evaluate("no-load", twice), "one quantity twice")
    rows = running()
    rows[3][1] = "nan"
    hole = write(tmp_path / "hole.csv", "speed_rpm,torque_nm,repeat", rows)
    refused(evaluate("no-load", hole), "nan")
    rows[3][1] = "much"
    refused(
        evaluate("no-load", write(tmp_path / "word.csv", "speed_rpm,torque_nm,repeat", rows)),
        "much",
    )


def steady(swapped: bool) -> list[list[object]]:
    """Input and output torque of a reducer 80:1 with an efficiency of 80 %, at two speeds."""
    rows: list[list[object]] = []
    for speed in (300.0, 900.0):
        for load in (100.0, 200.0, 400.0):
            pair = [load / 80.0 / 0.8, load]
            rows.append([*(pair[::-1] if swapped else pair), speed])
    return rows


def test_efficiency_is_what_the_torques_say_and_swapped_columns_are_noticed(tmp_path: Path) -> None:
    header = "input_torque_nm,output_torque_nm,speed_rpm"
    data = write(tmp_path / "data.csv", header, steady(False))
    found = evaluate("efficiency", data, "--ratio", 80, "--output", tmp_path / "out")
    assert found.exit_code == 0, found.output
    assert all(v == pytest.approx(80.0, rel=1e-3) for v in quantities(tmp_path / "out").values())
    refused(evaluate("efficiency", data), "no ratio", "--ratio")
    swapped = write(tmp_path / "swapped.csv", header, steady(True))
    found = evaluate("efficiency", swapped, "--ratio", 80)
    assert found.exit_code in (1, 2), found.output
    assert "swapped" in " ".join(found.output.split())


def test_a_limit_that_is_not_kept_ends_with_1_and_the_result_is_there(tmp_path: Path) -> None:
    limits = "[[limits.no_load]]\nspeed_rpm = 600\ntorque_nm = {}\n"
    reducer = (
        'name = "R"\nkind = "rv"\nratio = 80\nrated_torque_nm = 400\n'
        "acceleration_torque_nm = 800\nmomentary_peak_torque_nm = 1600\n"
        "max_input_speed_rpm = 2000\n"
    )
    data = write(tmp_path / "data.csv", "speed_rpm,torque_nm,repeat", running())
    for torque, code in ((0.5, 0), (0.1, 1)):
        described = tmp_path / f"reducer-{code}.toml"
        described.write_text(reducer + limits.format(torque), encoding="utf-8")
        output = tmp_path / f"out-{code}"
        found = evaluate("no-load", data, "--reducer", described, "--output", output)
        assert found.exit_code == code, found.output
        content = json.loads((output / "result.json").read_text(encoding="utf-8"))
        assert [each["verdict"] for each in content["verdicts"]] != []


def test_an_output_that_is_a_file_is_refused(no_load: Path, tmp_path: Path) -> None:
    taken = tmp_path / "taken"
    taken.write_text("mine")
    refused(evaluate("no-load", no_load, "--output", taken), "is a file", "a folder")
    assert taken.read_text() == "mine"


@pytest.mark.parametrize("test", ["friction", "no-load"])
def test_a_column_of_demanded_speeds_shows_a_drive_at_its_end(tmp_path: Path, test: str) -> None:
    rows = [
        [*row, float(str(row[0])) * (1.2 if row[0] in (1000.0, -1000.0) else 1.0)]
        for row in running()
    ]
    data = write(tmp_path / "sweep.csv", "speed_rpm,torque_nm,repeat,demanded_rpm", rows)
    found = evaluate(test, data)
    assert found.exit_code == 0, found.output
    assert "drive saturation" in found.output
    assert "1200 rpm were requested and 1000 rpm reached" in " ".join(found.output.split())


def test_german_tables_with_decimal_commas_semicolons_and_units_are_read(tmp_path: Path) -> None:
    speed = np.tile(np.arange(100.0, 1100.0, 100.0), 2)
    torque = 0.3 + 2e-4 * speed + 1e-4 * np.cos(np.arange(speed.size))
    rows = [f"{a:.1f};{b:.6f};i.O.".replace(".", ",") for a, b in zip(speed, torque, strict=True)]
    header = "Drehzahl [U/min];Drehmoment [N·m];Bemerkung"
    data = tmp_path / "reibung.csv"
    data.write_text("\ufeff" + "\n".join([header, *rows]) + "\n", encoding="utf-8")
    columns = ("--column", "speed=Drehzahl [U/min]", "--column", "torque=Drehmoment [N·m]")
    found = evaluate("friction", data, *columns, "--output", tmp_path / "out")
    assert found.exit_code == 0, found.output
    assert quantities(tmp_path / "out")["coulomb_clockwise"] == pytest.approx(0.3, abs=1e-3)
    understood = evaluate("friction", data, "--output", tmp_path / "understood")
    assert understood.exit_code == 0, understood.output
    assert quantities(tmp_path / "understood") == quantities(tmp_path / "out")
    named = data.with_name("named.csv")
    named.write_text(data.read_text(encoding="utf-8").replace("Drehzahl", "Motor"), "utf-8")
    refused(evaluate("friction", named), "no column speed_rpm", "--column 'speed=Motor")
    latin = tmp_path / "latin.csv"
    latin.write_text("\n".join([header, *rows]), encoding="latin-1")
    found = evaluate("friction", latin, *columns, "--output", tmp_path / "latin")
    assert found.exit_code == 0, found.output
    assert quantities(tmp_path / "latin") == quantities(tmp_path / "out")


def test_what_a_flange_takes_to_move_is_taken_off(tmp_path: Path) -> None:
    columns = (np.char.mod("%.9f", column) for column in swinging_loop(0.25, 0.8))
    rows = np.column_stack(list(columns)).tolist()
    table = write(tmp_path / "loop.csv", "time_s,torque_nm,angle_rad", rows)
    arguments = ("hysteresis", table, "--rated-torque", 40)
    backlash = {}
    for flange in ((), ("--flange-inertia", 0.25)):
        folder = tmp_path / f"result{len(flange)}"
        assert evaluate(*arguments, *flange, "--output", folder).exit_code == 0
        backlash[len(flange)] = quantities(folder)["backlash"]
    settings = json.loads((tmp_path / "result2" / "result.json").read_text("utf-8"))["settings"]
    assert settings["flange"] == {"inertia_kgm2": 0.25, "inertia_uncertainty_percent": 10.0}
    assert backlash[2] == pytest.approx(TRUE_BACKLASH, rel=0.02)
    assert backlash[0] < 0.95 * TRUE_BACKLASH
    timeless = write(tmp_path / "timeless.csv", "torque_nm,angle_rad", [[0, 0], [1, 1]])
    refused(
        evaluate("hysteresis", timeless, "--rated-torque", 40, "--flange-inertia", 0.25), "time"
    )
    refused(evaluate(*arguments, "--flange-inertia", -1), "flange_inertia_kgm2 = -1")
