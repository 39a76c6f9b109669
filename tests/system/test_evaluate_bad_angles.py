"""Bad loops and bad angles at `torquebench evaluate`: refused or named, with exit code 2 or 1."""

import contextlib
import io
import sys

import numpy as np
import pytest

from torquebench.cli import main

ARCMIN = np.pi / 10800.0
RATED, RATIO = 400.0, 20.0


def evaluate(*arguments):
    """Run the command in this process; exit code, and everything it says on one line."""
    said = io.StringIO()
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(sys, "argv", ["torquebench", "evaluate", *map(str, arguments)])
        with (
            contextlib.redirect_stdout(said),
            contextlib.redirect_stderr(said),
            pytest.raises(SystemExit) as left,
        ):
            main()
    return int(left.value.code or 0), " ".join(said.getvalue().split())


def write(path, header, *columns):
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="")
    return path


def loops(path, *, gap=0.0, preload=0.0, samples=1500):
    half = np.linspace(-RATED, RATED, samples)
    torque = np.tile(np.concatenate([half, half[::-1]]), 3)
    side = np.tile(np.repeat([-1.0, 1.0], samples), 3)
    play = 1.5 * np.tanh((torque - preload) / 5.0)
    twist = torque / 110.0 + play + side * 0.3 * (1 - (torque / RATED) ** 2)
    twist = twist + gap * np.linspace(0, 1, torque.size)
    return write(path, "torque_nm,angle_arcmin", torque, twist)


def test_loops_that_dont_close_are_refused(tmp_path):
    data = loops(tmp_path / "loops.csv", gap=6.0)
    code, said = evaluate("hysteresis", data, "--rated-torque", RATED)
    assert code == 2
    assert "doesn't close" in said
    assert "slip" in said


def test_backlash_that_a_preload_hides_is_named_beside_the_values(tmp_path):
    data = loops(tmp_path / "loops.csv", preload=70.0)
    code, said = evaluate("hysteresis", data, "--rated-torque", RATED)
    assert code == 1, said  # the values stand there, but aren't to be used
    assert "backlash hidden by preload" in said
    assert "softest around 6" in said or "softest around 7" in said


def angles(path, *, revolutions=1.05, size=12000, slip=0.0, ratio=RATIO):
    """Both angles over one run in each direction, in degrees."""
    given, taken, place = [], [], 0.3
    for direction in (1, -1):
        turned = place + direction * np.linspace(0, 2 * np.pi * revolutions, size)
        place = turned[-1]
        error = 12.0 * np.sin(turned) + 6.0 * np.sin(RATIO * turned + 1.0)
        error = error + slip * (np.arange(size) > 0.45 * size)
        given.append(np.degrees(ratio * turned))
        taken.append(np.degrees(turned) + error / 3600.0)
    return write(path, "input_deg,output_deg", np.concatenate(given), np.concatenate(taken))


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"slip": 20.0}, ("jumps by 20", "slips")),
        ({"ratio": 20.001}, ("the ratio is wrong", "20.001")),
        ({"ratio": 25.0}, ("a ratio of 25",)),
        ({"revolutions": 0.8}, ("0.8 output revolutions", "whole output revolution")),
        ({"size": 150}, ("samples per period", "sample faster")),
    ],
)
def test_bad_angles_are_refused_by_name(tmp_path, changed, words):
    data = angles(tmp_path / "angles.csv", **changed)
    code, said = evaluate("transmission-error", data, "--ratio", RATIO)
    assert code == 2, said
    for word in words:
        assert word in said
    assert "Traceback" not in said


def test_a_good_record_of_the_same_kind_passes(tmp_path):
    code, said = evaluate("transmission-error", angles(tmp_path / "a.csv"), "--ratio", RATIO)
    assert code == 0, said
    assert "transmission error" in said
