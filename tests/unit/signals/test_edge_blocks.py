import numpy as np
import pytest

from torquebench.errors import InputError
from torquebench.signals import EdgeBlock


def test_a_block_takes_any_integers():
    block = EdgeBlock([1, 2, 5], 0, 10, 80e6)
    assert block.ticks.dtype == np.int64
    assert len(block) == 3


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([1.5, 2.0], 0, 10, 1e8), "float64"),
        (([[1, 2]], 0, 10, 1e8), "dimensions"),
        (([1, 12], 0, 10, 1e8), r"inside \[0, 10\)"),
        (([-1, 2], 0, 10, 1e8), "inside"),
        (([1], 10, 0, 1e8), "stop at or after start"),
        (([1], 0, 10, 0.0), "timebase"),
        (([1], 0, 10, np.nan), "timebase"),
    ],
)
def test_what_is_no_block_is_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        EdgeBlock(*arguments)


def test_blocks_that_follow_each_other_join() -> None:
    joined = EdgeBlock.join([EdgeBlock([1, 4], 0, 10, 1e8), EdgeBlock([12], 10, 20, 1e8)])
    assert (joined.ticks.tolist(), joined.start_tick, joined.stop_tick) == ([1, 4, 12], 0, 20)
    with pytest.raises(InputError, match="10 and then from 11"):
        EdgeBlock.join([EdgeBlock([1, 4], 0, 10, 1e8), EdgeBlock([12], 11, 20, 1e8)])
