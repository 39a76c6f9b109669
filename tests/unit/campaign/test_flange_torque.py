"""Torque at the reducer's flange: what the flange takes to move isn't the reducer's."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from torquebench.bench.description import default_bench
from torquebench.bench.devices import SynchronousRecording
from torquebench.campaign.flange_torque import output_at_flange
from torquebench.campaign.reducer_evaluation import evaluate_loops
from torquebench.campaign.reducer_uncertainty import Bench
from torquebench.procedures.reducer_loop import Loop, LoopRecording
from torquebench.reducers import load_reducer

REDUCER = load_reducer("harmonic-20")
RATED = REDUCER.rated_torque_nm
STIFFNESS = 2.5e4
LAG_NM = 0.05 * RATED
INERTIA = 0.25
INTERVAL_S = 0.002
ARCMIN = np.pi / 10800.0


def described(inertia=INERTIA, percent=10.0):
    bench = default_bench()
    changed = {"flange_inertia_kgm2": inertia, "flange_inertia_uncertainty_percent": percent}
    return bench.model_copy(update={"output": bench.output.model_copy(update=changed)})


def recording(torque_nm, angle_rad, uncertainty_nm=0.01):
    rows = torque_nm.size
    nothing = np.zeros(rows)
    return SynchronousRecording(
        INTERVAL_S * np.arange(rows),
        nothing,
        torque_nm,
        np.full(rows, uncertainty_nm),
        np.full(rows, uncertainty_nm),
        nothing,
        angle_rad,
    )


def swung(inertia, frequency_hz, amplitude_rad):
    """A flange that swings on a straight spring: torque of the spring, of the transducer, angle."""
    time = INTERVAL_S * np.arange(1000)
    swing = 2.0 * np.pi * frequency_hz
    angle = 1e-3 * time + amplitude_rad * np.sin(swing * time)
    spring = STIFFNESS * angle
    acceleration = -(swing**2) * amplitude_rad * np.sin(swing * time)
    return spring, spring + inertia * acceleration, angle


@given(
    st.floats(0.01, 10.0),
    st.floats(1.0, 40.0),
    st.floats(1e-7, 1e-4),
)
@settings(max_examples=60)
def test_what_a_swinging_flange_takes_is_taken_off(inertia, frequency_hz, amplitude_rad):
    spring, read, angle = swung(inertia, frequency_hz, amplitude_rad)
    found = output_at_flange(recording(read, angle), described(inertia).output)
    inner = slice(5, -5)
    allowed = 0.07 * np.abs(read - spring).max() + 0.012 * STIFFNESS * amplitude_rad
    assert np.abs(found.output_torque_nm - spring)[inner].max() < allowed
    # Where there is no acceleration to be had, the torque stays as it was read.
    assert np.array_equal(found.output_torque_nm[:5], read[:5])
    assert np.array_equal(found.output_torque_nm[-5:], read[-5:])


def test_its_uncertainty_is_that_of_inertia_and_angle():
    _, read, angle = swung(INERTIA, 25.0, 2e-5)
    taken = recording(read, angle)
    known, unsure = (
        output_at_flange(taken, described(percent=percent).output) for percent in (0.0, 20.0)
    )
    inner = slice(5, -5)
    added = np.sqrt(unsure.output_uncertainty_nm**2 - known.output_uncertainty_nm**2)
    taken_nm = np.abs(read - STIFFNESS * angle)
    assert added[inner] == pytest.approx(0.1 * taken_nm[inner], abs=0.01 * taken_nm.max())
    # Counts of 3.6 million a turn, by the gain of the window for white noise.
    own = np.sqrt(known.output_uncertainty_nm**2 - 0.01**2)
    assert own[inner] == pytest.approx(INERTIA * 0.0322, rel=0.02)
    assert np.all(own[:5] == 0.0)


def test_white_noise_of_the_torque_is_halved():
    noise = np.random.default_rng(4).standard_normal(20_000)
    found = output_at_flange(recording(noise, np.zeros(noise.size)), described().output)
    assert found.output_torque_nm.std() == pytest.approx(1.0 / 3.0**0.5, rel=0.02)


def test_without_an_inertia_or_samples_enough_the_torque_stays():
    _, read, angle = swung(INERTIA, 25.0, 2e-5)
    taken = recording(read, angle)
    assert output_at_flange(taken, described(None).output) is taken
    short = recording(read[:8], angle[:8])
    assert np.array_equal(output_at_flange(short, described().output).output_torque_nm, read[:8])


def test_gaps_part_a_recording():
    _, read, angle = swung(INERTIA, 25.0, 2e-5)
    taken = recording(read, angle)
    late = 40.0 + taken.time_s
    # Without the gap there would be a jump of the angle, and with it an acceleration.
    second = replace(taken, time_s=late, output_angle_rad=angle + 0.5)
    joined = output_at_flange(SynchronousRecording.joined([taken, second]), described().output)
    alone = output_at_flange(taken, described().output)
    assert joined.output_torque_nm[:1000] == pytest.approx(alone.output_torque_nm)
    assert joined.output_torque_nm[1000:] == pytest.approx(alone.output_torque_nm, abs=1e-6)


def rippling_loop(generator):
    """A reducer of straight branches, whose flange a drive's ripple swings."""
    corners = (-1.1 * RATED, 1.1 * RATED, -1.1 * RATED)
    ramp = np.concatenate([np.linspace(*each, 10_000) for each in pairwise(corners)])
    time = INTERVAL_S * np.arange(ramp.size)
    angle = (ramp + 0.02 * RATED * np.sin(2.0 * np.pi * 25.0 * time)) / STIFFNESS
    # One elastic element that slips: each ripple takes it back, which narrows the mean loop.
    slipping, state = np.empty(angle.size), -LAG_NM
    for row, change in enumerate(np.diff(angle, prepend=angle[0])):
        state = float(np.clip(state + STIFFNESS * change, -LAG_NM, LAG_NM))
        slipping[row] = state
    acceleration = np.gradient(np.gradient(angle, INTERVAL_S), INTERVAL_S)
    torque = STIFFNESS * angle + slipping + INERTIA * acceleration
    return recording(torque, angle + 2e-7 * generator.standard_normal(angle.size))


def test_a_loop_is_as_wide_as_the_reducers_own():
    taken = rippling_loop(np.random.default_rng(3))
    loops = LoopRecording((Loop(0.0, 1, taken),), RATED, {"input": True, "output": True}, 23.0)
    wide, narrow = (
        evaluate_loops(Bench(described(inertia), {}, {}), REDUCER, loops)
        for inertia in (INERTIA, None)
    )
    truth = 2.0 * LAG_NM / STIFFNESS / ARCMIN
    found, without = wide.result.backlash, narrow.result.backlash
    assert found.value == pytest.approx(truth, rel=0.01)
    assert truth - without.value > without.expanded_uncertainty()
    assert any("0.25 kg·m² ± 10 %, is taken off" in remark for remark in wide.remarks)
    assert any("isn't described" in remark for remark in narrow.remarks)
