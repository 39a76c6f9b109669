"""Values and uncertainties in digits, as GUM 7.2.6 has it."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.uncertainty import rounded, stated


@given(st.floats(1e-9, 1e9))
def test_uncertainty_has_at_most_two_significant_digits(value: float) -> None:
    shown, decimals = rounded(value)
    text = f"{shown:.{decimals}f}" if shown < 10.0 else f"{shown:g}"
    digits = text.split("e")[0].replace(".", "").strip("0")
    assert len(digits) <= 2
    assert shown == pytest.approx(value, rel=0.051)


@given(st.floats(-1e9, 1e9), st.floats(1e-9, 1e9))
def test_value_and_uncertainty_end_at_the_same_digit(value: float, expanded: float) -> None:
    shown, uncertainty = stated(value, expanded)
    if expanded >= 1e-9 * abs(value):
        assert len(shown.partition(".")[2]) == len(uncertainty.partition(".")[2])
        assert len(uncertainty.replace(".", "").strip("0")) <= 2
        assert abs(float(shown) - value) <= 0.051 * expanded
        assert float(uncertainty) == pytest.approx(expanded, rel=0.051)
    else:  # one digit of what is rounding only
        assert float(uncertainty) == pytest.approx(expanded, rel=0.51)


@pytest.mark.parametrize(
    ("value", "expanded", "words"),
    [
        (0.95, 0.0, ("0.95", "0")),
        (0.95, float("inf"), ("0.95", "unknown")),
        (1.0, 1e-16, ("1", "1e-16")),
        (1234.0, 0.0996, ("1234.00", "0.10")),
    ],
)
def test_what_has_no_digits_to_share(value: float, expanded: float, words: tuple[str, str]) -> None:
    assert stated(value, expanded) == words
