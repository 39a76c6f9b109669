"""Limits that the bench's description states, for chains that weren't calibrated on the bench."""

from __future__ import annotations

from torquebench.bench.chain_effects import chain_effects
from torquebench.bench.description import BenchDescription
from torquebench.bench.roles import SIDES, Side
from torquebench.chain import MeasuringChain, Reference
from torquebench.compensation import StoredModel
from torquebench.errors import ModelMismatchError
from torquebench.message import Message

__all__ = ["chain_on_bench", "with_stated_limits"]


def chain_on_bench(stored: StoredModel, description: BenchDescription) -> MeasuringChain:
    """Return a stored chain as it is in use on the bench that has its transducer.

    Raises
    ------
    ModelMismatchError
        The bench has another transducer, or the file doesn't name one.
    """
    modules = {side: description.module(side) for side in SIDES}
    serial = stored.provenance.transducer_serial
    for side, module in modules.items():
        if serial and serial == module.transducer.serial:
            return with_stated_limits(MeasuringChain.of(stored), description, side)
    raise ModelMismatchError(
        Message("a model of transducer {serial!r}", serial),
        Message.joined(module.transducer.serial for module in modules.values()),
        "fit the model with --serial, or take the description of the bench that it is used on",
    )


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
