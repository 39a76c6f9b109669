"""Torques and speeds of recordings in every usual unit: in a column, a comment, a file's name."""

import numpy as np
import pytest

from torquebench.campaign.reducers.columns import read_columns
from torquebench.errors import InputError

WANTED = {"speed": "speed", "torque": "torque"}
POUND, GRAVITY, INCH = 0.45359237, 9.80665, 0.0254
# N·m and 1/min per unit, by the definitions of pound, inch and standard gravity
TORQUES = {
    **dict.fromkeys(("Nm", "N·m", "N.m"), 1.0),
    **dict.fromkeys(("Nmm", "N·mm", "mNm"), 1e-3),
    "kNm": 1e3,
    **dict.fromkeys(("kgf·cm", "kgf.cm", "kgcm", "kgf-cm"), 0.01 * GRAVITY),
    **dict.fromkeys(("oz·in", "ozin", "oz-in", "ozf·in"), POUND / 16.0 * GRAVITY * INCH),
    **dict.fromkeys(("lbf·ft", "ft-lb", "lb-ft"), POUND * GRAVITY * 12.0 * INCH),
    **dict.fromkeys(("lbf·in", "in-lb"), POUND * GRAVITY * INCH),
}
SPEEDS = {
    **dict.fromkeys(("rpm", "1/min"), 1.0),
    **dict.fromkeys(("rps", "Hz"), 60.0),
    "rad/s": 30.0 / np.pi,
    "deg/s": 1.0 / 6.0,
}
UNITS = [
    *(("torque", unit, factor) for unit, factor in TORQUES.items()),
    *(("speed", unit, factor) for unit, factor in SPEEDS.items()),
]


def read(folder, name, text, wanted=WANTED):
    file = folder / name
    file.write_text(text, encoding="utf-8")
    return read_columns([file], wanted, list(wanted), (), ()).numbers


@pytest.mark.parametrize(("kind", "unit", "factor"), UNITS)
def test_a_quantity_is_converted_wherever_it_stands(tmp_path, kind, unit, factor):
    value = 12.5
    other = {"torque": "speed_rpm", "speed": "torque_nm"}[kind]
    column = f"{other},{kind} [{unit}]\n2,{value}\n3,{-value}\n"
    np.testing.assert_allclose(
        read(tmp_path, "log.csv", column)[kind], [value * factor, -value * factor], rtol=1e-9
    )
    alone = f"{other},time_s\n2,0\n3,1\n"
    texts = [("log.csv", f"# {kind} = {value} {unit}\n{alone}")]
    if "/" not in unit:
        texts += [(f"drag {value}{unit}.csv", alone), (f"drag_{value} {unit}_2.csv", alone)]
    for name, text in texts:
        np.testing.assert_allclose(
            read(tmp_path, name, text)[kind], [value * factor] * 2, rtol=1e-9, err_msg=name
        )


@pytest.mark.parametrize("name", ["drag 5rpm or 6rpm.csv", "drag 5.csv", "drag 5V.csv", "5-6.csv"])
def test_no_value_is_guessed_from_a_name(tmp_path, name):
    with pytest.raises(InputError, match="no column speed_rpm"):
        read(tmp_path, name, "torque_nm,time_s\n2,0\n3,1\n")


def test_the_torque_in_a_name_is_one_torque_only(tmp_path):
    wanted = {"input_torque": "torque", "output_torque": "torque", "speed": "speed"}
    with pytest.raises(InputError, match="no column input_torque_nm"):
        read(tmp_path, "map 40Nm.csv", "speed_rpm,time_s\n2,0\n3,1\n", wanted)
    numbers = read(tmp_path, "map 40Nm.csv", "speed_rpm,input_torque_nm\n2,5\n3,6\n", wanted)
    assert numbers["output_torque"].tolist() == [40.0, 40.0]
