"""Transmission errors of known orders; every kind of bad record is named."""

import numpy as np
import pytest

from torquebench.errors import InputError
from torquebench.reducers import evaluate_transmission_error, load_reducer, verdicts

ARCSEC = np.pi / 648000
RATIO = 41.0
ORDERS = {1.0: 15.0, 2.0: 6.0, 13.0: 4.0, 41.0: 10.0, 82.0: 3.0}


def error(phi):
    return sum(a * ARCSEC * np.sin(k * phi + k) for k, a in ORDERS.items())


def record(*, revolutions=1.0, size=8000, slip=0.0, ratio=RATIO, noise=0.2):
    generator = np.random.default_rng(4)
    given, taken, place = [], [], 0.7
    for direction in (1, -1):
        phi = place + direction * np.linspace(0, 2 * np.pi * revolutions, size)
        place = phi[-1]
        jump = slip * ARCSEC * (np.arange(size) > 0.4 * size)
        given.append(ratio * phi)
        taken.append(phi + error(phi) + jump + noise * ARCSEC * generator.standard_normal(size))
    return np.concatenate(given), np.concatenate(taken)


@pytest.mark.parametrize("revolutions", [1.0, 1.3, 3.0])
def test_peak_to_peak_and_orders_in_both_directions(revolutions):
    expected = np.ptp(error(np.linspace(0, 2 * np.pi, 100001))) / ARCSEC
    result = evaluate_transmission_error(*record(revolutions=revolutions), RATIO)
    assert {each.direction for each in result.directions} == {"clockwise", "counter-clockwise"}
    for each in result.directions:
        assert each.peak_to_peak.value == pytest.approx(expected, abs=0.3)
        found = {order.order: order.amplitude.value for order in each.orders[: len(ORDERS)]}
        assert found == pytest.approx(ORDERS, abs=0.05)
    first, second = (each.error_arcsec for each in result.directions)
    assert np.max(np.abs(first - second)) < 0.6
    judged = verdicts(result, load_reducer("rv-40e"))
    assert [each.decision.verdict.label for each in judged] == ["pass"]


@pytest.mark.parametrize(
    ("changed", "match"),
    [
        ({"revolutions": 0.9}, "0.9 output revolutions"),
        ({"size": 600}, "samples per period"),
        ({"slip": 15.0}, "jumps by 15"),
        ({"ratio": 41.004}, "the ratio is wrong"),
        ({"ratio": 40.0}, "show a ratio of 39.99"),
    ],
)
def test_bad_records_are_named(changed, match):
    with pytest.raises(InputError, match=match):
        evaluate_transmission_error(*record(**changed), RATIO)


@pytest.mark.parametrize("overshoot", [-0.3, -0.13, 0.0, 0.13, 0.3])
def test_two_recordings_with_a_gap_between_them_share_no_sample(overshoot):
    """While the input reverses nothing is recorded: the gap and the play in it are no slip."""
    size, lost = 16000, 10.0 * ARCSEC
    first = 0.17 + 2 * np.pi * np.linspace(0.0, 1.06, size)
    second = first[-1] + 2 * np.pi * overshoot - 2 * np.pi * np.linspace(0.0, 1.06, size)
    given = RATIO * np.concatenate([first, second])
    taken = np.concatenate([first + error(first) - lost, second + error(second) + lost])
    result = evaluate_transmission_error(given, taken, RATIO)
    expected = np.ptp(error(np.linspace(0, 2 * np.pi, 100001))) / ARCSEC
    assert len(result.directions) == 2
    for each in result.directions:
        assert each.peak_to_peak.value == pytest.approx(expected, abs=0.05)
    assert result.reversal_arcsec.value == pytest.approx(20.0, abs=0.1)


def test_swapped_reversed_and_missing_angles_are_named():
    given, taken = record()
    for arguments, match in (
        ((taken, given, RATIO), "swapped"),
        ((given, taken, -RATIO), "make the ratio negative"),
        ((np.where(np.arange(given.size) == 9, np.nan, given), taken, RATIO), "row 10"),
    ):
        with pytest.raises(InputError, match=match):
            evaluate_transmission_error(*arguments)
