"""The model that compensates a side: it must match the transducer and the counter.

A timebase's error is part of the calibration, so a model of another counter is refused unless that
counter is accepted by name, with a larger uncertainty.
"""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime

from torquebench.bench.active_chain import ActiveChain
from torquebench.bench.chain_effects import with_stated_limits
from torquebench.bench.description import BenchDescription
from torquebench.bench.roles import Side
from torquebench.chain import MeasuringChain, Timebase
from torquebench.compensation import CompensationModel, load_model
from torquebench.errors import ModelMismatchError
from torquebench.message import Message
from torquebench.records import Registry

__all__ = ["compensation_for"]


def compensation_for(
    registry: Registry,
    description: BenchDescription,
    counter: str,
    side: Side,
    accepted: Timebase | None = None,
    fitted: CompensationModel | None = None,
) -> ActiveChain:
    """Return the compensation by the registry's active model of a transducer and a counter.

    Where nothing is recorded of an influence, the bench's limit of it enters U.

    Parameters
    ----------
    registry : Registry
    description : BenchDescription
    counter : str
        Counter and clock that measure.
    side : {"input", "output"}
    accepted : Timebase, optional
        Where there is no model of the counter that measures, one of that counter is used.
    fitted : CompensationModel, optional
        It is used if it is the active one: its table is compiled already.

    Raises
    ------
    ModelMismatchError
        There is none for exactly this transducer serial and this counter.
    RecordError
        The model's file is missing or was changed.
    """
    module = description.module(side)
    transducer = module.transducer
    entry, own = None, counter
    try:
        entry = registry.active_model(transducer.serial, counter)
    except ModelMismatchError:
        if accepted is None:
            raise
    if entry is None and accepted is not None:
        counter = accepted.identity
        entry = registry.active_model(transducer.serial, counter)
    if counter == own:
        accepted = None
    if entry is None:
        raise ModelMismatchError(
            Message(
                "no active model of transducer {serial} with counter {counter}",
                transducer.serial,
                counter,
            ),
            "a model that was made with both",
            Message("calibrate the {side} module or activate one of its models", side),
        )
    stored = load_model(entry.check_file())
    stored.check_fits(transducer.serial, counter, module.range_nm)
    if fitted is not None and fitted.get_state() == stored.model.get_state():
        stored = replace(stored, model=fitted)
    if accepted is not None and transducer.signal != "frequency":
        raise ModelMismatchError(
            Message("a model made with {counter}", counter),
            Message("one that was made with {own}: an amplifier is a part of the chain", own),
            Message("calibrate the {side} module with this amplifier", side),
        )
    zero_nm = transducer.zero_hz / transducer.nominal_sensitivity_hz_per_nm
    chain = with_stated_limits(MeasuringChain.of(stored), description, side)
    if accepted is not None:
        chain = chain.with_effects((replace(accepted, zero_nm=zero_nm),))
    today = datetime.now(UTC).date()
    return ActiveChain(chain, str(entry.model_id), entry.kind, chain.age_h(today))
