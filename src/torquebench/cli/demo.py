"""`torquebench demo`: a complete run on the simulated bench."""

from __future__ import annotations

import webbrowser
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from torquebench import calibration
from torquebench.cli.options import (
    DEFAULT_DATA,
    BenchOption,
    DataOption,
    RealTimeOption,
    bench_description,
)
from torquebench.cli.reports import Told
from torquebench.cli.simulate import described, simulators_running
from torquebench.cli.terminal.console import note, say, say_file
from torquebench.errors import InputError
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription
    from torquebench.campaign.demo import DemoSettings
    from torquebench.campaign.results import DemoResult, ModuleResult
    from torquebench.reports.page import Page, Section

FAST_BLOCK_S = 0.1
"""Length of blocks of simulated time, twice the usual one, for a faster demo."""


class Preset(StrEnum):
    """Quality of the simulated bench."""

    nominal = "nominal"
    worn = "worn"


@dataclass(frozen=True)
class DemonstratedModule:
    """One module of the demo."""

    side: str
    range_nm: float
    transducer: str
    recommended: str
    runs: Sequence[str]
    models: Sequence[calibration.ModelVerification]


@dataclass(frozen=True, kw_only=True)
class Demonstrated(Told):
    """Both modules, raw and by each model."""

    bench_seconds: float
    modules: Sequence[DemonstratedModule]


def demo(
    seed: Annotated[
        int | None, typer.Option(min=0, help="Redraws every constant of the simulated bench.")
    ] = None,
    preset: Annotated[Preset | None, typer.Option(help="How good the simulated bench is.")] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer points and groups: takes a few seconds.")
    ] = False,
    groups: Annotated[
        int | None,
        typer.Option(min=1, max=100, help="Groups of fresh points that verify a module (3)."),
    ] = None,
    report: Annotated[Path, typer.Option("--out", help="The report (.html, .pdf).")] = Path(
        "torquebench-demo.html"
    ),
    bench: BenchOption = None,
    data: DataOption = DEFAULT_DATA,
    real_time: RealTimeOption = False,
    show: Annotated[bool, typer.Option("--open", help="Show the report in the browser.")] = False,
) -> Demonstrated:
    """Zero, calibrate, compensate and verify both modules and test a reducer, simulated.

    Both modules are calibrated in both directions, up and down. Four models are fitted and verified
    in groups of 50 fresh points against the standard and the simulation's true torque. The
    no-load friction of the simulated standard reducer is measured in three sweeps.
    """
    from torquebench.cli.reports import check_reports

    check_reports([report])
    description = _description(bench, seed, preset, real_time=real_time)
    with simulators_running(description, bench) as started:
        if started:
            note("simulators started for this demo; they end with it")
        settings = _settings(description, quick, groups)
        result, page = _measured(description, settings, data, real_time)
    _write_report(report, page)
    _print(result)
    say_file("Report", report)
    if show and not webbrowser.open(report.resolve().as_uri()):
        note("no browser was found: open the report yourself")
    return Demonstrated(
        headline=Message("{count} modules calibrated and verified.", len(result.modules)),
        simulated=result.simulated,
        bench_seconds=result.bench_seconds,
        modules=[
            DemonstratedModule(
                module.side,
                module.range_nm,
                module.transducer_serial,
                module.recommended.name,
                module.run_ids,
                [each.verification for each in (module.raw, *module.models)],
            )
            for module in result.modules
        ],
    )


def _description(
    bench: Path | None, seed: int | None, preset: Preset | None, *, real_time: bool
) -> BenchDescription:
    """Return the simulated bench's description with the command line's options."""
    description = bench_description(bench)
    if not description.simulated:
        raise InputError(
            Message("{bench} describes a real bench", bench),
            'a bench with driver = "simulated", or with a section [driver.simulation]',
            "use `torquebench calibrate` on a real bench",
        )
    description = described(description, seed=seed, preset=None if preset is None else preset.value)
    counter = description.counter
    if real_time or counter.block_s >= FAST_BLOCK_S:
        return description
    return description.model_copy(update={"counter": counter.with_blocks(FAST_BLOCK_S)})


def _settings(description: BenchDescription, quick: bool, groups: int | None) -> DemoSettings:
    from torquebench.calibration import load_profile
    from torquebench.campaign.demo import DemoSettings
    from torquebench.procedures import FrictionSettings

    settings = DemoSettings(seed=int(description.simulation.get("seed", 1)))
    if quick:
        settings = replace(
            settings,
            calibration=load_profile("rapid-in-situ").with_options(step_percent=10.0),
            verification=load_profile("verification").with_options(groups=2, points=8),
            friction=FrictionSettings(speeds_rpm=(100.0, 400.0, 1200.0), repeats=1),
        )
    if groups is not None:
        verification = settings.verification.with_options(groups=groups)
        settings = replace(settings, verification=verification)
    return settings


def _measured(
    description: BenchDescription, settings: DemoSettings, data: Path, real_time: bool
) -> tuple[DemoResult, Page]:
    """Run the demo; return its result, and the report, whose figures a second process draws."""
    from torquebench.campaign.demo import run_demo
    from torquebench.cli.bench_session import open_bench
    from torquebench.cli.second_process import second_process
    from torquebench.reports.demo_report import demo_page
    from torquebench.reports.module_report import module_sections

    note(f"simulated bench: preset {description.simulation.get('preset')}, seed {settings.seed}")
    drawings: list[Callable[[], list[Section]]] = []
    with second_process() as second:

        def draw(module: ModuleResult) -> None:
            drawings.append(second.begin(partial(module_sections, module)))

        with (
            open_bench(description, data, real_time=real_time, yes=True, announce=False) as session,
            session.measuring(may_pause=False) as (progress, _),
        ):
            result = run_demo(
                session.station, settings, progress, begin=second.begin, verified=draw
            )
        page = second.begin(partial(demo_page, result, [each() for each in drawings]))
        return result, page()


def _write_report(path: Path, page: Page) -> None:
    from torquebench.cli.terminal.progress import TerminalProgress

    with TerminalProgress() as progress:
        progress.start("Writing the report", 1)
        from torquebench.reports.page_pdf import write_report

        write_report(page, path)
        progress.reach(1)


def _print(result: DemoResult) -> None:
    from torquebench.reports.demo_report import friction_range
    from torquebench.reports.module_report import conclusion

    simulated = " (simulated)" if result.simulated else ""
    for module in result.modules:
        say(f"{conclusion(module)}{simulated}")
    if result.friction is not None:
        say(f"{friction_range(result.friction)}{simulated}")
