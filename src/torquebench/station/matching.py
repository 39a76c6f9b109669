"""Choose the model that compensates a side: it must match transducer and counter.

The error of the counter's timebase is part of the calibration, so a model made with another counter
is refused unless that counter is accepted explicitly, with a larger uncertainty.
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


def compensation_for(
    registry: Registry,
    description: BenchDescription,
    counter: str,
    side: Side,
    accepted: Timebase | None = None,
    fitted: CompensationModel | None = None,
) -> ActiveChain:
    """Return the compensation by the registry's active model for a side's transducer and counter.

    For an influence that wasn't recorded, the limit in the bench description enters U.

    Parameters
    ----------
    counter : str
        Identity of the counter that measures.
    side : {"input", "output"}
    accepted : Timebase, optional
        Another counter whose model is accepted if there is none of the measuring counter.
    fitted : CompensationModel, optional
        A model whose table is already compiled; used if it is the active one.

    Raises
    ------
    ModelMismatchError
        There is no active model for this transducer serial and this counter.
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
            "a model made with both",
            Message("calibrate the {side} module or activate one of its models", side),
        )
    stored = load_model(entry.check_file())
    stored.check_fits(transducer.serial, counter, module.range_nm)
    if fitted is not None and fitted.get_state() == stored.model.get_state():
        stored = replace(stored, model=fitted)
    if accepted is not None and transducer.signal != "frequency":
        raise ModelMismatchError(
            Message("a model made with {counter}", counter),
            Message("one made with {own}, because the amplifier is part of the chain", own),
            Message("calibrate the {side} module with this amplifier", side),
        )
    zero_nm = transducer.zero_hz / transducer.nominal_sensitivity_hz_per_nm
    chain = with_stated_limits(MeasuringChain.of(stored), description, side)
    if accepted is not None:
        chain = chain.with_effects((replace(accepted, zero_nm=zero_nm),))
    today = datetime.now(UTC).date()
    return ActiveChain(chain, str(entry.model_id), entry.kind, chain.age_h(today))
