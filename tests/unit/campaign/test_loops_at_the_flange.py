"""What a bench's description says of its flange comes to the loops that are evaluated."""

from dataclasses import fields

import numpy as np
import pytest
from tests.swinging_flange import RATED_NM, swinging_loop

from torquebench.bench.description import default_bench
from torquebench.bench.devices import SynchronousRecording
from torquebench.campaign.reducers.kinds.hysteresis import WORK as HYSTERESIS
from torquebench.campaign.reducers.uncertainty import Bench
from torquebench.chain import TorqueParts
from torquebench.procedures.reducers.loop import Loop, LoopRecording
from torquebench.reducers import load_reducer

REDUCER = load_reducer("harmonic-20")


def described(inertia):
    bench = default_bench()
    output = bench.output.model_copy(update={"flange_inertia_kgm2": inertia})
    return bench.model_copy(update={"output": output})


def loops(ripple_nm, inertia_nm=None, **parts_nm):
    """Return one loop, with a correction by the chain and parts of its uncertainty."""
    time, torque, angle = swinging_loop(0.25, ripple_nm)
    nothing = np.zeros(time.size)
    corrected = nothing if inertia_nm is None else inertia_nm(time, angle)
    columns = dict.fromkeys((each.name for each in fields(TorqueParts)), nothing)
    columns |= {"curve_nm": nothing + 0.01}
    columns |= {name: np.broadcast_to(value, time.shape) for name, value in parts_nm.items()}
    parts = TorqueParts(**columns)
    recording = SynchronousRecording(
        time, nothing, torque + corrected, parts, parts, nothing, corrected, nothing, angle
    )
    return LoopRecording(
        (Loop(0.0, 1, recording),), RATED_NM, {"input": True, "output": True}, 23.0
    )


def test_the_described_flange_is_taken_off_and_said():
    measured = loops(0.02 * RATED_NM)
    taken, left = (
        HYSTERESIS.evaluate(Bench(described(inertia), {}, {}), REDUCER, measured)
        for inertia in (0.25, None)
    )
    assert taken.result.backlash.value > 1.05 * left.result.backlash.value
    assert (
        "the torque that accelerates the output flange, "
        "0.25 kg·m² ± 10 %, is subtracted" in taken.remarks
    )
    assert any("the inertia of the output flange isn't described" in each for each in left.remarks)


@pytest.mark.parametrize("inertia", [0.25, None])
def test_nothing_is_said_of_a_flange_that_does_not_swing(inertia):
    found = HYSTERESIS.evaluate(Bench(described(inertia), {}, {}), REDUCER, loops(0.0))
    assert not any("accelerates the output flange" in each for each in found.remarks)


def slowly_corrected(time, angle):
    """Return what a chain subtracts that knows the acceleration only as a mean over blocks."""
    step = time[1] - time[0]
    acceleration = np.gradient(np.gradient(angle, step), step)
    return -0.25 * np.convolve(acceleration, np.ones(5) / 5.0, mode="same")


def test_inertia_that_the_chain_corrects_is_not_subtracted_twice():
    bench = Bench(described(0.25), {}, {})
    alone, by_both = (
        HYSTERESIS.evaluate(bench, REDUCER, loops(0.02 * RATED_NM, each)).result
        for each in (None, slowly_corrected)
    )
    assert by_both.backlash.value == pytest.approx(alone.backlash.value, rel=1e-9)
    assert by_both.energy.value == pytest.approx(alone.energy.value, rel=1e-9)
    # a chain whose flange isn't described keeps its own correction
    left = HYSTERESIS.evaluate(
        Bench(described(None), {}, {}), REDUCER, loops(0.02 * RATED_NM, slowly_corrected)
    ).result
    assert left.backlash.value != pytest.approx(alone.backlash.value, rel=1e-3)


@pytest.mark.parametrize(
    ("part", "line", "quantity"),
    [
        ("scale_nm", "torque scale", "stiffness"),
        ("mounting_nm", "mounting", "stiffness"),
        ("zero_nm", "torque zero", "lost_motion"),
        ("shift_nm", "torque zero", "lost_motion"),
        ("curve_nm", "torque branch", "backlash"),
        ("loading_nm", "loading effects", "backlash"),
        ("scatter_nm", "loading effects", "backlash"),
    ],
)
def test_every_part_of_a_loops_torque_counts_but_noise(part, line, quantity):
    bench = Bench(described(None), {}, {})
    plain, with_it, noisy = (
        getattr(HYSTERESIS.evaluate(bench, REDUCER, loops(0.0, **each)).result, quantity)
        for each in ({}, {part: 0.2}, {"noise_nm": 0.2})
    )
    size = {each.name: each.contribution for each in with_it.lines}[line]
    before = {each.name: each.contribution for each in plain.lines}.get(line, 0.0)
    assert size > 1.2 * before
    assert with_it.standard_uncertainty > plain.standard_uncertainty
    assert noisy == plain
