"""A reducer of another ratio than the one that a real bench states is refused."""

from types import SimpleNamespace
from typing import cast

import pytest

from torquebench.bench.description import BenchDescription, default_bench
from torquebench.errors import InputError
from torquebench.operations import PackagedLibrary, Place, find_operation
from torquebench.station import Station


def place(ratio: float, driver: str) -> Place:
    described = default_bench()
    bench = described.bench.model_copy(update={"reducer_ratio": ratio, "driver": driver})
    real: BenchDescription = described.model_copy(update={"bench": bench, "driver": {}})
    station = SimpleNamespace(description=real)  # only its description is asked for
    return Place("Ana", PackagedLibrary(), station=cast("Station", station))


def test_a_real_bench_is_asked_for_the_ratio_and_for_the_reducer() -> None:
    test = find_operation("test")
    request = test.request(test="hysteresis", reducer="rv-40e")
    assert test.doubts(place(121.0, "modular"), request) == ()
    with pytest.raises(InputError, match="a ratio of 121") as refused:
        test.doubts(place(80.5, "modular"), request)
    assert refused.value.allowed.startswith("80.5, the ratio of what is mounted")
    with pytest.raises(InputError, match="no reducer for"):
        test.doubts(place(121.0, "modular"), test.request(test="hysteresis"))
    assert test.doubts(place(80.5, "simulated"), request) == (), "it mounts what is asked for"
