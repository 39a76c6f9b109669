"""A twin with drawn constants, and the steps that bring it into a mode."""

import numpy as np

from torquebench.twin import SIDES, BenchTwin, TwinParameters

RPM = 2.0 * np.pi / 60.0
NOMINAL = TwinParameters.draw("nominal", 11)
RANGE = {"input": 50.0, "output": 2000.0}


def make(*, seed=1, channels=(), parameters=NOMINAL, mounting="calibrator"):
    twin = BenchTwin(parameters, seed, active_channels=channels)
    twin.mount(mounting)
    twin.set_clamped(True)
    return twin


def driven(twin, *sides):
    for side in sides or SIDES:
        twin.set_mode(side, "driven")
        twin.enable(side, True)
    return twin
