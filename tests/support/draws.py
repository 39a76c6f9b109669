"""Cases that are drawn at random: a few of them by day, all by `make nightly`."""

from typing import Any

import pytest

__all__ = ["drawn", "nightly"]


def nightly(*values: Any) -> Any:
    """Return a test's parameters that only `make nightly` takes."""
    return pytest.param(*values, marks=pytest.mark.nightly)


def drawn(count: int, by_day: int) -> list[Any]:
    """Return the seeds 0 to `count` - 1 as a test's parameter; the first `by_day` run by day."""
    return [*range(by_day), *(nightly(seed) for seed in range(by_day, count))]
