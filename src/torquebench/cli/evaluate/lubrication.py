"""`torquebench evaluate lubrication`: factor of the present lubricant on the bearings' drag."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import typer

from torquebench.cli.evaluate.dynamics import EstimatedValue
from torquebench.cli.options import ColumnOption, check_output
from torquebench.message import Message
from torquebench.operations.result import Result


@dataclass(frozen=True, kw_only=True)
class EvaluatedLubrication(Result):
    """Factor on the drag of the bearings by the present lubricant."""

    record: str
    factor: EstimatedValue


def lubrication(
    run: Annotated[Path, typer.Argument(help="Table of an empty run with the present lubricant.")],
    model: Annotated[Path, typer.Option(help="The chain, fitted with empty runs.")],
    result: Annotated[Path, typer.Option("--out", help="The chain's new file.")],
    lubricant: Annotated[
        str, typer.Option(help="Type, amount and hours of the lubricant, for the record.")
    ] = "",
    column: ColumnOption = None,
) -> EvaluatedLubrication:
    """Determine the factor of the present lubricant on the bearings' drag.

    The empty run goes over the working speeds in both directions. The new file is the same chain
    with that factor, whose U contains the deviations of single speeds. A run that doesn't determine
    the factor is refused.
    """
    check_output(result, run, model, endings=(".json",))
    from torquebench.chain import MeasuringChain, identify_lubrication
    from torquebench.compensation import load_model, save_model
    from torquebench.tables import read_empty_run

    stored = load_model(model)
    chain = MeasuringChain.of(stored)
    found = identify_lubrication(chain.stored, read_empty_run(run, column or (), stored), lubricant)
    renewed = chain.with_effects([found])
    save_model(
        result,
        replace(stored, provenance=replace(stored.provenance, effects=renewed.specification())),
    )
    value, u = found.lubrication, 2.0 * found.lubrication_uncertainty
    return EvaluatedLubrication(
        headline=Message(
            "Drag of the bearings: {value:.3g} times that of the chain's empty runs, U = {u:.2g}",
            value,
            u,
        ),
        files=(str(result),),
        record=found.record,
        factor=EstimatedValue(value, u, ""),
    )
