"""Decision rules with guard band."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.errors import InputError
from torquebench.uncertainty import Tolerance, Verdict, conformance_probability, decide

_ORDER = [Verdict.PASS, Verdict.CONDITIONAL_PASS, Verdict.CONDITIONAL_FAIL, Verdict.FAIL]


@given(st.floats(-5, 5), st.floats(0, 2), st.floats(0.1, 3))
def test_verdicts_are_symmetric_and_get_worse_outwards(value, expanded, limit):
    tolerance = Tolerance(-limit, limit)
    verdict = decide(value, expanded, tolerance).verdict
    assert decide(-value, expanded, tolerance).verdict is verdict
    further = decide(value * 1.5, expanded, tolerance).verdict
    # with U wider than the tolerance nothing passes, and the order still holds
    assert _ORDER.index(further) >= _ORDER.index(verdict)


@given(st.floats(-3, 3), st.floats(0.01, 1))
def test_probability_matches_the_verdict(value, expanded):
    decision = decide(value, expanded, Tolerance(-1.0, 1.0))
    if decision.verdict is Verdict.PASS:
        assert decision.conformance_probability >= 0.954
    if decision.verdict is Verdict.FAIL:
        assert decision.conformance_probability <= 0.024
    if decision.verdict is Verdict.CONDITIONAL_FAIL:
        assert decision.conformance_probability <= 0.5 + 1e-9


def test_without_uncertainty_only_pass_and_fail_or_the_limit():
    assert decide(1.0, 0.0, Tolerance(-1.0, 1.0)).verdict is Verdict.PASS
    assert decide(1.0000001, 0.0, Tolerance(-1.0, 1.0)).verdict is Verdict.FAIL


def test_one_sided_tolerances():
    assert decide(0.5, 0.2, Tolerance(None, 1.0)).verdict is Verdict.PASS
    assert decide(0.5, 0.2, Tolerance(1.0, None)).verdict is Verdict.FAIL
    assert decide(1e6, 0.2, Tolerance(1.0, None)).conformance_probability == pytest.approx(1.0)


def test_tolerance_refers_to_reading_or_full_scale():
    share = Tolerance(-0.1, 0.1, "reading")
    assert decide(0.4, 0.05, share, reading=-500.0).verdict is Verdict.PASS
    assert decide(0.4, 0.05, share, reading=300.0).verdict is Verdict.FAIL
    with pytest.raises(InputError, match="no reading given"):
        decide(0.4, 0.05, share, full_scale=2000.0)


def test_finite_freedom_lowers_the_probability():
    few = conformance_probability(0.0, 0.5, -1.0, 1.0, 3.0)
    assert few < conformance_probability(0.0, 0.5, -1.0, 1.0)


def test_labels_and_certificate_values():
    assert Verdict.CONDITIONAL_PASS.value == "conditionalPass"
    assert Verdict.CONDITIONAL_FAIL.label == "conditional fail"
    assert "guard band w = U" in decide(0.0, 0.1, Tolerance(-1.0, 1.0)).rule()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Tolerance(None, None), "one or two finite limits"),
        (lambda: Tolerance(1.0, -1.0), "lower limit below"),
        (lambda: decide(float("nan"), 0.1, Tolerance(-1.0, 1.0)), "finite numbers"),
        (lambda: decide(0.0, -0.1, Tolerance(-1.0, 1.0)), "not negative"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(InputError, match=message):
        call()
