"""Mechanics from the command line: designs, sections, supports, and what is refused."""

from pathlib import Path

import pytest
from tests.system.command_line import run, widest_line

CHAIN = """name = "my chain"
range_nm = 100.0
outer_diameter_m = 0.04
inner_diameter_m = 0.0
length_m = 0.2
shear_modulus_pa = 79e9
shaft_radius_m = 0.02
coaxiality_error_m = 2e-5
angular_misalignment_rad = 1e-4
strain_coefficient_n_per_m = 5e7
elastic_coefficient_n_per_rad = 3.6e5
radial_stiffness_n_per_m = 1.25e4
"""


def test_a_design_of_ones_own(tmp_path: Path) -> None:
    (tmp_path / "chain.toml").write_text(CHAIN)
    command = ("mechanics", "additional-torque", "chain.toml", "--report", "chain.html")
    result = run(*command, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert widest_line(result.stdout) <= 80
    for text in ("bearing friction", "angular misalignment", "coaxiality error", "0.03 mm changes"):
        assert text in result.stdout, text
    assert "my chain" in (tmp_path / "chain.html").read_text()


def test_supports_of_other_dimensions(tmp_path: Path) -> None:
    result = run("mechanics", "supports", "--height", "0.4", "--torque", "500", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "times as stiff with the same mass" in result.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["additional-torque", "none.toml"], "no design"),
        (["additional-torque", "bad.toml"], "key nonsense"),
        (["additional-torque", "missing.toml"], "outer_diameter_m = None"),
        (["supports", "--arm-height", "0.6"], "lower than its column"),
        (["supports", "--cylinder", "0.1"], "larger diameter"),
        (["sections", "--report", "x.doc"], "x.doc"),
    ],
)
def test_bad_input_is_refused(tmp_path: Path, arguments: list[str], message: str) -> None:
    (tmp_path / "bad.toml").write_text(CHAIN + "nonsense = 1\n")
    (tmp_path / "missing.toml").write_text("range_nm = 100.0\n")
    result = run("mechanics", *arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert message in " ".join(result.stderr.split())
