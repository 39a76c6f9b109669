"""Each unit factor is stated once."""

import re
from pathlib import Path

import pytest

from torquebench import units

SOURCE = Path(units.__file__).parent
FACTOR = re.compile(
    r"60(?:\.0)? ?/ ?\(?2(?:\.0)? ?\* ?(?:np\.|math\.)?pi"
    r"|2(?:\.0)? ?\* ?(?:np\.|math\.)?pi ?/ ?60"
    r"|30(?:\.0)? ?/ ?(?:np\.|math\.)?pi|pi ?/ ?(?:30|180|10800|648000)|180(?:\.0)? ?/ ?\w*\.?pi"
    r"|6\.28318|0\.00029088|3437\.7(?!5: )"
)


def test_one_rpm_is_a_turn_a_minute():
    assert pytest.approx(0.10471975511965978) == units.RAD_S_PER_RPM
    assert pytest.approx(9.549296585513721) == units.RPM_PER_RAD_S


def test_an_arcminute_is_the_sixtieth_of_a_degree():
    assert pytest.approx(0.2908882086657216e-3) == units.ARCMIN
    assert pytest.approx(4.84813681109536e-6) == units.ARCSEC
    # 1 N·m/arcmin is 3437.75 N·m/rad, as data sheets of reducers convert it.
    assert pytest.approx(3437.75, abs=0.005) == units.NM_PER_RAD_OF_NM_PER_ARCMIN


def test_no_other_module_states_a_factor_of_its_own():
    found = [
        f"{path.relative_to(SOURCE)}:{number}: {line.strip()}"
        for path in SOURCE.rglob("*.py")
        if path.name != "units.py"
        for number, line in enumerate(path.read_text("utf-8").splitlines(), 1)
        if FACTOR.search(line)
    ]
    assert found == []
