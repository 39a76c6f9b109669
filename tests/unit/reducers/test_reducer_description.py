from pathlib import Path

import pytest

from torquebench.errors import InputError
from torquebench.reducers import available_reducers, load_reducer

GOOD = """
name = "R"
kind = "rv"
ratio = 80
rated_torque_nm = 400
acceleration_torque_nm = 800
momentary_peak_torque_nm = 1600
max_input_speed_rpm = 2000
"""


def test_packaged_types_and_a_file_load(tmp_path: Path) -> None:
    assert {load_reducer(name).name for name in available_reducers()}
    path = tmp_path / "r.toml"
    path.write_text(GOOD + "reversed = true\n", encoding="utf-8")
    assert load_reducer(path).signed_ratio == -80.0


@pytest.mark.parametrize(
    ("text", "named"),
    [
        (GOOD.replace("ratio = 80", ""), "ratio"),
        (GOOD.replace("ratio = 80", "ratio = -80"), "ratio"),
        (GOOD.replace("ratio = 80", "ratio = nan"), "ratio"),
        (GOOD.replace('"rv"', '"belt"'), "kind"),
        (GOOD + "colour = 1\n", "colour"),
        (GOOD.replace("800", "300"), "have to rise"),
        (GOOD + "region_torques_nm = [20, 10]\n", "T1 < T2"),
        (GOOD + "stiffness_interval = [0.9, 0.5]\n", "stiffness_interval"),
        (GOOD + 'lost_motion_rule = "mine"\n', "lost_motion_rule"),
        (GOOD + "[limits]\nbacklash_arcmin = 0\n", "limits.backlash_arcmin"),
        (GOOD + "[[limits.efficiency]]\ntorque_nm = 1\nspeed_rpm = 1\npercent = 100\n", "percent"),
        ("name = ", "valid TOML"),
    ],
)
def test_a_wrong_description_names_its_key(tmp_path: Path, text: str, named: str) -> None:
    path = tmp_path / "r.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"r\.toml") as caught:
        load_reducer(path)
    assert named in str(caught.value)


def test_no_description_and_no_text(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no reducer 'nobodys'"):
        load_reducer("nobodys")
    (tmp_path / "r.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="UTF-8"):
        load_reducer(tmp_path / "r.toml")
