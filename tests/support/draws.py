"""Cases that are drawn at random: a few of them by day, all by `make nightly`."""

from collections.abc import Iterable
from typing import Any

import pytest

__all__ = ["drawn", "nightly", "some"]


def nightly(*values: Any) -> Any:
    """Return a test's parameters that only `make nightly` takes."""
    return pytest.param(*values, marks=pytest.mark.nightly)


def drawn(count: int, by_day: int) -> list[Any]:
    """Return the seeds 0 to `count` - 1 as a test's parameter; the first `by_day` run by day."""
    return some(range(count), by_day)


def some(values: Iterable[Any], by_day: int) -> list[Any]:
    """Return a test's parameter: the first `by_day` values run by day, the others nightly."""
    chosen = list(values)
    return [*chosen[:by_day], *map(nightly, chosen[by_day:])]
