"""Each unit factor is stated once."""

import ast
import re
from collections.abc import Iterator
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


def test_times_are_in_seconds_and_a_year_has_its_mean_length():
    assert (units.MINUTE, units.HOUR, units.DAY) == (60, 3600, 86400)
    assert units.DAY / units.HOUR == units.HOURS_PER_DAY
    assert units.HOURS_PER_YEAR == 8766.0
    assert units.TURN * units.DEG_PER_RAD == units.DEG_PER_TURN
    assert units.DEG_S_PER_RPM == 6.0


ANGLES = {"degrees", "radians", "deg2rad", "rad2deg"}
FACTORS = {
    60: "",
    360: "",
    3600: "",
    86400: "",
    365.25: "",
    24: r"days?\b",
    1000: r"(_khz|(?<!_per)_m?s)\b",
}
"""Constants that convert, each with the quantity that shows it; without one it always converts."""
PRODUCTS = (ast.Mult, ast.Div, ast.FloorDiv, ast.Mod)


def conversions(tree: ast.AST) -> Iterator[ast.expr]:
    """Yield expressions that convert a unit by hand."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and node.attr in ANGLES:
            yield node
        if not (isinstance(node, ast.BinOp) and isinstance(node.op, PRODUCTS)):
            continue
        for factor, other in ((node.left, node.right), (node.right, node.left)):
            if not isinstance(factor, ast.Constant):
                continue
            named = FACTORS.get(factor.value)
            words = ast.unparse(other)
            if named is not None and re.search(named, words):
                yield node
            doubled = isinstance(node.op, ast.Mult) and factor.value == 2
            if doubled and re.match(r"\w*\.?pi\b", words):
                yield node


@pytest.mark.parametrize(
    "text",
    [
        "np.degrees(angle)",
        "math.radians(angle)",
        "2 * np.pi / counts",
        "2.0 * pi * frequency",
        "60.0 / abs(speed_rpm)",
        "seconds // 60",
        "passed / 3600.0",
        "days * 365.25",
        "24.0 * age_days",
        "transducer.option_khz * 1e3",
        "round(1000 * delay_s)",
    ],
)
def test_a_conversion_by_hand_is_recognized(text: str):
    assert list(conversions(ast.parse(text)))


@pytest.mark.parametrize("text", ["np.pi / 2.0", "angle * DEG_PER_RAD", "1.0 / 24", "1e3 * torque"])
def test_what_converts_nothing_or_by_name_is_not(text: str):
    assert not list(conversions(ast.parse(text)))


def test_no_other_module_states_a_factor_of_its_own():
    found = []
    for path in SOURCE.rglob("*.py"):
        if path.name == "units.py":
            continue
        text = path.read_text("utf-8")
        place = path.relative_to(SOURCE)
        found += [
            f"{place}:{number}: {line.strip()}"
            for number, line in enumerate(text.splitlines(), 1)
            if FACTOR.search(line)
        ]
        found += [
            f"{place}:{node.lineno}: {ast.unparse(node)}" for node in conversions(ast.parse(text))
        ]
    assert found == []
