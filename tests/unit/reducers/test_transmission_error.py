"""Transmission errors of known orders; every kind of bad record is named."""

import numpy as np
import pytest

from torquebench.errors import InputError
from torquebench.reducers import (
    AngleUncertainty,
    evaluate_transmission_error,
    load_reducer,
    verdicts,
)

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
        ({"size": 400}, "samples per period"),
        ({"slip": 15.0}, "jumps by 15"),
        ({"ratio": 41.004}, "the ratio is wrong"),
        ({"ratio": 40.0}, "show a ratio of 40;"),
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
        ((np.where(np.arange(given.size) % 9 == 0, np.nan, given), taken, RATIO), "row 1"),
    ):
        with pytest.raises(InputError, match=match):
            evaluate_transmission_error(*arguments)


def encoder_errors(generator, *, known_rad, turned, ratio):
    """Errors of both encoders, once around each, with the standard deviations that are stated."""
    phase = generator.uniform(0, 2 * np.pi, 2)
    scale = 2.0**0.5 * known_rad
    return (
        scale * np.sin(turned + phase[0]) * abs(generator.standard_normal()),
        ratio * scale * np.sin(ratio * turned + phase[1]) * abs(generator.standard_normal()),
    )


def test_intervals_hold_the_truth_in_about_95_percent():
    """Encoders with errors of the size stated, noise, another reducer each time; 120 draws."""
    fine = np.linspace(0, 2 * np.pi, 20001)
    ratio, draws = 12.0, 120
    held = {"whole": 0, "order": 0}
    width = []
    for seed in range(draws):
        generator = np.random.default_rng(seed)
        orders = {1.0: 12.0, 2.0: 5.0, ratio: 9.0, 2 * ratio: 4.0}
        phases = generator.uniform(0, 2 * np.pi, len(orders))
        sizes = [each * generator.uniform(0.7, 1.3) * ARCSEC for each in orders.values()]

        def true(phi, sizes=sizes, orders=orders, phases=phases):
            waves = zip(sizes, orders, phases, strict=True)
            return sum(a * np.sin(k * phi + p) for a, k, p in waves)

        known = 0.5 * ARCSEC
        turned = np.linspace(0.0, 2 * np.pi * 2.02, 800)
        output, given = encoder_errors(generator, known_rad=known, turned=turned, ratio=ratio)
        noise = 0.5 * ARCSEC * generator.standard_normal(turned.size)
        result = evaluate_transmission_error(
            ratio * turned + given,
            turned + true(turned) + output + noise,
            ratio,
            uncertainty=AngleUncertainty(known, ratio * known),
        )
        low, high = result.peak_to_peak.interval()
        held["whole"] += low <= np.ptp(true(fine)) / ARCSEC <= high
        width.append(high - low)
        first = next(each for each in result.directions[0].orders if each.order == 1.0)
        low, high = first.amplitude.interval()
        held["order"] += low <= sizes[0] / ARCSEC <= high
    assert 0.91 * draws <= held["whole"], held
    assert 0.91 * draws <= held["order"], held
    assert np.median(width) < 12.0 * known / ARCSEC  # and not by being wide


def test_an_error_is_a_function_of_the_outputs_own_angle():
    """Over the input's angle orders would bend each other, and lose what is above the highest."""
    output = np.linspace(0.0, 2.02 * np.pi, 60_001)
    error = (23.0 * np.sin(200.0 * output) + 5.4 * np.sin(400.0 * output + 1.0)) * ARCSEC
    found = evaluate_transmission_error(
        100.0 * (output - error), output, 100.0, highest_order=400.0
    )
    truth = np.ptp(error) / ARCSEC
    assert found.peak_to_peak.value == pytest.approx(truth, abs=0.02)
    amplitudes = {each.order: each.amplitude.value for each in found.directions[0].orders}
    assert amplitudes[400.0] == pytest.approx(5.4, abs=0.01)
