"""One bad sample in a recording of any kind: found, named by its row, left out, or kept."""

import numpy as np
import pytest
from tests.support import recordings

from torquebench.errors import InputError
from torquebench.reducers import (
    LoopSettings,
    evaluate_breakaway,
    evaluate_efficiency,
    evaluate_friction,
    evaluate_hysteresis,
    evaluate_no_load,
    evaluate_swings,
    evaluate_transmission_error,
    unwrapped,
)

ARCMIN = np.pi / 10800.0


def loops(rng, bad, **options):
    shape = recordings.loop(str(rng.choice(recordings.SHAPES)), rng)
    record = recordings.loop_record(shape, rng, bad=bad, noise=0.003, **options)
    return (
        record,
        evaluate_hysteresis,
        (
            record.torque,
            record.angle * ARCMIN,
            LoopSettings(shape.rated),
        ),
    )


def ramps(rng, bad, **options):
    record = recordings.ramp_record(rng, bad=bad, **options)
    return record, evaluate_breakaway, (record.time, record.angle * ARCMIN, record.torque)


def no_load(rng, bad, **options):
    record = recordings.speed_record(rng, bad=bad, **options)
    return record, evaluate_no_load, (record.speed, record.torque)


def friction(rng, bad, **options):
    record = recordings.speed_record(rng, bad=bad, **options)
    return record, evaluate_friction, (record.speed, record.torque)


def efficiency(rng, bad, **options):
    record = recordings.efficiency_record(rng, bad=bad, **options)
    return record, evaluate_efficiency, (record.drive, record.load, record.speed, record.ratio)


def turns(rng, bad, **options):
    record = recordings.angle_record(rng, bad=bad, highest=30.0, **options)
    angles = [np.radians(each) for each in (record.driving, record.driven)]
    if options.get("wrapped"):
        angles = [unwrapped(each) for each in angles]
    return record, evaluate_transmission_error, (*angles, record.ratio)


def strokes(rng, bad, **options):
    record = recordings.swing_record(rng, bad=bad, **options)
    angles = (np.radians(record.driving), np.radians(record.driven))
    return record, evaluate_swings, (*angles, record.ratio)


LOG = {"log": 100, "repeats": 2}
KINDS = [
    *((loops, bad, options) for bad in ("torque", "angle") for options in ({}, {"levels": 20})),
    (loops, "angle", {"step": 0.05}),
    (loops, "angle", {"loops": 1}),
    (loops, "torque", {"single": True}),
    *((ramps, bad, options) for bad in ("torque", "angle") for options in ({}, {"levels": 8})),
    *(
        (test, "torque", options)
        for test in (no_load, friction)
        for options in ({}, {"repeats": 1}, {"both": False}, LOG, {"ramp": True})
    ),
    *((efficiency, True, options) for options in ({}, {"repeats": 1}, {**LOG, "noise": 0.01})),
    *(
        (turns, True, options)
        for options in ({}, {"wrapped": True}, {"strongest": 4.0}, {"step": 20.0})
    ),
    (strokes, True, {}),
    (strokes, True, {"step": 1.3}),
]
EACH = 1


@pytest.mark.parametrize(("recorded", "bad", "options"), KINDS)
def test_it_is_named_alone_and_kept_where_that_is_wanted(recorded, bad, options):
    for seed in range(EACH):
        record, evaluate, columns = recorded(np.random.default_rng(seed), bad, **options)
        more = {"run": record.run} if evaluate is evaluate_breakaway else {}
        row = np.arange(columns[0].size) + 101  # as a file counts
        found = evaluate(*columns, row=row, **more)
        (message,) = [each.message for each in found.findings if each.name == "outliers"]
        assert f"in row {record.bad_row + 101}: " in message, seed
        assert "left out" in message
        try:
            kept = evaluate(*columns, row=row, keep_outliers=True, **more)
        except InputError:
            continue  # it moves a loop's end, stops a ramp: what it does can't be evaluated
        messages = [each.message for each in kept.findings if each.name == "outliers"]
        assert f"in row {record.bad_row + 101}: " in messages[0]
        assert all("neighbours, kept" in message for message in messages)
