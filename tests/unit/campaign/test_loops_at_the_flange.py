"""What a bench's description says of its flange comes to the loops that are evaluated."""

from dataclasses import fields, replace

import numpy as np
import pytest
from tests.support.draws import nightly
from tests.swinging_flange import RATED_NM, swinging_loop

from torquebench.bench.active_chain import ActiveChain
from torquebench.bench.description import default_bench
from torquebench.bench.devices import SynchronousRecording
from torquebench.campaign.reducers.kinds.hysteresis import WORK as HYSTERESIS
from torquebench.campaign.reducers.uncertainty import Bench
from torquebench.chain import Inertia, MeasuringChain, TorqueParts
from torquebench.compensation import make_model
from torquebench.procedures.reducers.loop import Loop, LoopRecording, _flange
from torquebench.reducers import FlangeInertia, load_reducer

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


def test_the_flange_that_empty_runs_have_identified_is_taken_before_the_described_one():
    bench = Bench(described(0.1), {}, {})
    measured = loops(0.02 * RATED_NM)
    identified = replace(measured, flange=FlangeInertia(0.25, 2.0))
    found = HYSTERESIS.evaluate(bench, REDUCER, identified)
    same = HYSTERESIS.evaluate(Bench(described(0.25), {}, {}), REDUCER, measured)
    assert found.result.backlash.value == same.result.backlash.value
    assert any("0.25 kg·m² ± 2 %" in each for each in found.remarks)


def test_the_loops_record_the_flange_of_the_model_in_use():
    model = make_model("polynomial", range_nm=50.0)
    model.fit(np.linspace(-50.0, 50.0, 11)[:, None], np.linspace(-50.0, 50.0, 11))
    chain = MeasuringChain(model, (Inertia("empty runs", 0.25, 0.0025, 30.0),))
    assert _flange(ActiveChain(chain, "1", "polynomial")) == FlangeInertia(0.25, 2.0)
    assert _flange(ActiveChain(MeasuringChain(model), "1", "polynomial")) is None
    assert _flange(None) is None


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
        nightly("mounting_nm", "mounting", "stiffness"),
        ("zero_nm", "torque zero", "lost_motion"),
        nightly("shift_nm", "torque zero", "lost_motion"),
        ("curve_nm", "torque branch", "backlash"),
        ("loading_nm", "loading effects", "backlash"),
        nightly("scatter_nm", "loading effects", "backlash"),
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
