from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

PulseTrain = Callable[..., NDArray[np.int64]]


@pytest.fixture
def pulse_train() -> PulseTrain:
    """Rising edges of a pulse train in ticks, with jitter and quantisation."""

    def make(
        frequency_hz: float,
        duration_s: float,
        *,
        timebase_hz: float = 100e6,
        jitter_s: float = 5e-9,
        seed: int = 1,
        phase: float = 0.37,
    ) -> NDArray[np.int64]:
        generator = np.random.default_rng(seed)
        count = int(duration_s * frequency_hz) + 2
        times = (np.arange(count) + phase) / frequency_hz
        times += generator.normal(0.0, jitter_s, count) if jitter_s else 0.0
        ticks = np.floor(times * timebase_hz).astype(np.int64)
        return ticks[(ticks >= 0) & (ticks < duration_s * timebase_hz)]

    return make
