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
        (([1], 0, 10, 1e8, [11]), "falling_ticks"),
    ],
)
def test_what_is_no_block_is_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        EdgeBlock(*arguments)


def test_validate_names_the_edge_out_of_order():
    with pytest.raises(InputError, match=r"ticks\[2\] = 4 after 4"):
        EdgeBlock([1, 4, 4, 6], 0, 10, 1e8).validate()
    with pytest.raises(InputError, match=r"falling_ticks\[1\]"):
        EdgeBlock([1, 4, 6], 0, 10, 1e8, [5, 3]).validate()


def test_validate_returns_the_block():
    block = EdgeBlock([1, 4, 6], 0, 10, 1e8, [2, 5])
    assert block.validate() is block
