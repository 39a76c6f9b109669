"""What a bench's description says of its flange comes to the loops that are evaluated."""

import numpy as np
import pytest
from tests.swinging_flange import RATED_NM, swinging_loop

from torquebench.bench.description import default_bench
from torquebench.bench.devices import SynchronousRecording
from torquebench.campaign.reducers.kinds.hysteresis import WORK as HYSTERESIS
from torquebench.campaign.reducers.uncertainty import Bench
from torquebench.procedures.reducers.loop import Loop, LoopRecording
from torquebench.reducers import load_reducer

REDUCER = load_reducer("harmonic-20")


def described(inertia):
    bench = default_bench()
    output = bench.output.model_copy(update={"flange_inertia_kgm2": inertia})
    return bench.model_copy(update={"output": output})


def loops(ripple_nm):
    time, torque, angle = swinging_loop(0.25, ripple_nm)
    nothing = np.zeros(time.size)
    little = np.full(time.size, 0.01)
    recording = SynchronousRecording(time, nothing, torque, *[little] * 4, nothing, angle)
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
