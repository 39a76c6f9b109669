"""Limits that the bench's description states, for chains that weren't calibrated on the bench."""

from __future__ import annotations

from torquebench.bench.chain_effects import chain_effects
from torquebench.bench.description import BenchDescription
from torquebench.bench.roles import Side
from torquebench.chain import MeasuringChain, Reference

__all__ = ["with_stated_limits"]


def with_stated_limits(
    chain: MeasuringChain, description: BenchDescription, side: Side
) -> MeasuringChain:
    """Return a chain in use on a bench, with the bench's limits where its model has no record.

    A model that was fitted to a table knows nothing of the bench that it measures on. One that was
    calibrated on the bench has these effects already. The bench's reference standard is left out:
    the chain wasn't calibrated against it.

    Parameters
    ----------
    chain : MeasuringChain
    description : BenchDescription
    side : {"input", "output"}
    """
    effects = chain_effects(description, side)
    return chain.with_limits(each for each in effects if not isinstance(each, Reference))
