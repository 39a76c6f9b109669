"""`torquebench verification`: one module in groups against the verification standard."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from torquebench.cli.answers import VERIFIED
from torquebench.cli.chain_words import tell_missing
from torquebench.cli.failure import CHECK_FAILED
from torquebench.cli.models.commands import write_verification
from torquebench.cli.mounting import MountingOption, mounting_record, recorded
from torquebench.cli.options import BenchOptions, ModuleArgument, data_directory
from torquebench.cli.recovered import tell_doubts
from torquebench.cli.reports import ReportOption, check_reports
from torquebench.cli.terminal.confirming import confirm_start
from torquebench.cli.terminal.console import answer, say
from torquebench.errors import InputError
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.bench.roles import Side
    from torquebench.records import ModelEntry
    from torquebench.station import Station

__all__ = ["verification"]


def verification(
    module: ModuleArgument,
    models: Annotated[
        list[str] | None,
        typer.Option(
            "--model",
            metavar="model-N",
            help="A model of the records; without it the one in use. "
            "May be repeated; the verdict is "
            "that of the first.",
        ),
    ] = None,
    groups: Annotated[int, typer.Option(min=1, max=1000, help="How many groups.")] = 10,
    points: Annotated[int, typer.Option(min=4, max=10000, help="Points of each group.")] = 50,
    same_points: Annotated[
        bool, typer.Option("--same-points", help="The same torques in every group.")
    ] = False,
    seed: Annotated[
        int | None,
        typer.Option(min=0, help="Seed of the random points; without it, new points each time."),
    ] = None,
    tolerance: Annotated[
        float,
        typer.Option(min=0, help="Largest error of a reading, and repeatability, % of full scale."),
    ] = 0.1,
    report: ReportOption = None,
    mounting: MountingOption = None,
    *,
    options: BenchOptions,
) -> None:
    """Verify a module at fresh points against the verification standard, in groups.

    Every group loads up and down in both directions, between the steps of the calibration. Several
    models are compared on the same readings. Exit code 1 if error or repeatability of the first
    model exceeds the tolerance.
    """
    check_reports(report)
    entered = mounting_record(mounting)
    description = options.description()
    data_directory(options.data)
    side: Side = module.value
    from torquebench.calibration import load_profile
    from torquebench.campaign.doubts import VERIFICATION_STANDARD
    from torquebench.campaign.fitting import model_title
    from torquebench.campaign.verifying import verify_on_bench
    from torquebench.cli.tables import print_kept, print_verification

    profile = load_profile("verification").with_options(
        groups=groups, points=points, same_points=same_points or None
    )
    confirm_start(description, side, profile, options.yes)
    with recorded(entered), options.open(description) as session:
        tell_doubts(session.station, VERIFICATION_STANDARD)
        entries = _entries(session.station, side, models)
        with session.measuring() as (progress, ask):
            verified = verify_on_bench(
                session.station,
                side,
                profile,
                entries,
                seed,
                progress=progress,
                on_pause=ask,
            )
    result, run_id = verified.result, verified.measured.record.run_id
    titles = {
        name: f"{name}: {model_title(chain.model.kind, chain.model.kind_parameters)}"
        for name, chain in verified.chains.items()
    }
    _, first, *_ = result.models
    print_verification(result, [titles[each.name] for each in result.models[1:]])
    kept = print_kept("worst error", first.against_standard.worst_percent_fs, tolerance)
    if first.repeatability is not None:
        kept &= print_kept("repeatability", first.repeatability.worst_percent_fs, tolerance)
    missing = next(iter(verified.chains.values())).missing()
    tell_missing(missing)
    say(f"Run: {run_id}")
    answer(
        **VERIFIED.of(
            result,
            tolerance_percent_fs=tolerance,
            passed=kept,
            not_in_u=list(missing),
            run=run_id,
        )
    )
    if report:
        from torquebench.bench.mounting_record import mounting_facts

        data = verified.measured.result.data
        facts = (
            ("Record", run_id),
            ("Transducer", data.transducer_serial),
            ("Groups", "the same torques" if same_points else "each its own torques"),
            *mounting_facts(entered),
        )
        torques = {
            titles[name]: chain.torque(data.readings()) for name, chain in verified.chains.items()
        }
        write_verification(data, torques, facts, tolerance, report)
    if not kept:
        raise typer.Exit(CHECK_FAILED)


def _entries(station: Station, side: Side, named: list[str] | None) -> dict[str, ModelEntry]:
    """Return the models to be verified by name; each must belong to this module."""
    transducer = station.description.module(side).transducer.serial
    registry = station.registry
    if not named:
        counter = station.description.counter.identity
        active = registry.active_model(transducer, counter)
        if active is None:
            raise InputError(
                Message(
                    "no model in use of transducer {transducer} with counter {counter}",
                    transducer,
                    counter,
                ),
                "a calibrated module",
                Message("torquebench calibrate {side}, or name a model with --model", side),
            )
        return {f"model-{active.model_id}": active}
    known = {f"model-{each.model_id}": each for each in registry.models(transducer)}
    for name in named:
        if name not in known:
            raise InputError(
                Message("{name!r} of transducer {transducer}", name, transducer),
                ", ".join(known) or "a model of this transducer",
                Message(
                    "torquebench calibrate {side}, or look it up: torquebench records list", side
                ),
            )
    return {name: known[name] for name in named}
