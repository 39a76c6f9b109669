"""`torquebench test`: test a mounted reducer and compare the results with its data sheet."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from torquebench.campaign.reducers.catalogue import TESTS
from torquebench.cli.answers import TEST_PLAN
from torquebench.cli.chain_words import tell_compensation
from torquebench.cli.failure import CHECK_FAILED
from torquebench.cli.mounting import MountingOption, mounting_record, recorded
from torquebench.cli.options import HELP_MARKUP, BenchOptions, CounterOptions
from torquebench.cli.reducers.compare import compare
from torquebench.cli.reducers.standard import standard_reducer
from torquebench.cli.reports import ReportOption, check_reports, write_reports
from torquebench.cli.terminal.confirming import confirm_test
from torquebench.cli.terminal.console import answer, out
from torquebench.errors import InputError
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription
    from torquebench.campaign.reducers.results import ReducerTestRecord
    from torquebench.campaign.reducers.settings import ReducerTestSettings
    from torquebench.chain import Timebase
    from torquebench.reducers import ReducerDescription

MORE = """

    Torques are compensated by the active models; without one, the result says so. Every part is
    a separate run; its results.json contains all numbers. Exit code 1 if a limit of the data
    sheet is exceeded, data forbid a verdict or a part failed; 2 if the input is invalid.
"""

ReducerOption = Annotated[
    str | None,
    typer.Option(
        help="The mounted reducer: a packaged type (standard, rv-40e, "
        "harmonic-20) or a .toml file; "
        "by default that of the simulated bench.",
        show_default=False,
    ),
]
SerialOption = Annotated[str, typer.Option(help="Serial number of the specimen.")]
ShortOption = Annotated[
    bool, typer.Option("--short", help="Short test: few points, no warming up.")
]
TwistOption = Annotated[
    float | None,
    typer.Option(min=0, help="The bench's own twist, arcmin/(N·m); then it isn't measured."),
]
NoTwistOption = Annotated[
    bool, typer.Option("--no-twist", help="Don't subtract the bench's own twist from the loops.")
]
DryRunOption = Annotated[
    bool, typer.Option("--dry-run", help="Check limits and durations; nothing moves.")
]
TareOption = Annotated[
    bool | None,
    typer.Option(
        "--tare/--no-tare",
        help="Measure an empty run (nothing mounted) before no-load torque and efficiency, and "
        "subtract it. By default only if the measuring chains don't correct rotation; not with "
        "--short.",
        show_default=False,
    ),
]


def _count(most: int, text: str) -> Any:
    return typer.Option(min=1, max=most, help=text, show_default=False)


LoopsOption = Annotated[
    int | None,
    _count(100, "Torque-angle loops at each output position; without it 3, with --short 2."),
]
PositionsOption = Annotated[
    int | None,
    _count(100, "Output positions of the loops, over one turn; without it 5, with --short 1."),
]
RepeatsOption = Annotated[
    int | None,
    _count(
        1000,
        "Largest number of repeats of no-load torque and efficiency, and of the empty run; by "
        "default 12 and 8. Repeating ends when the means are known well enough.",
    ),
]


class _Tests(TyperGroup):
    """Lists the tests if the requested one doesn't exist."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        if args and not args[0].startswith("-") and args[0] not in self.commands:
            raise InputError(
                Message("a reducer test {name!r}", args[0]),
                Message("one of {list}", ", ".join(self.commands)),
                "name one",
            )
        return super().resolve_command(ctx, args)


app = typer.Typer(
    cls=_Tests,
    name="test",
    no_args_is_help=True,
    rich_markup_mode=HELP_MARKUP,
    help="Test a mounted reducer, with uncertainties and a verdict against its data sheet.",
)


def _command(name: str) -> Callable[..., None]:
    def command(
        reducer: ReducerOption = None,
        serial: SerialOption = "",
        short: ShortOption = False,
        twist: TwistOption = None,
        no_twist: NoTwistOption = False,
        tare: TareOption = None,
        repeats: RepeatsOption = None,
        loops: LoopsOption = None,
        positions: PositionsOption = None,
        dry_run: DryRunOption = False,
        report: ReportOption = None,
        mounting: MountingOption = None,
        *,
        options: BenchOptions,
        counter: CounterOptions,
    ) -> None:
        kind, described = _mounted(options.description(), reducer, serial)
        settings = _settings(short, twist, no_twist, tare, repeats)
        settings = settings.with_loops(loops, positions)
        wanted = _Wanted(name, kind, settings, serial, counter.accepted())
        entered = mounting_record(mounting)
        check_reports(report)
        if dry_run:
            _dry_run(described, wanted)
            return
        confirm_test(described, kind, options.yes)
        with recorded(entered):
            record = _run(described, wanted, options)
        _finish(record, report or [])

    return command


for test_name, test in TESTS.items():
    app.command(test_name, help=test.about + MORE)(_command(test_name))
app.command()(standard_reducer)
app.command()(compare)


@dataclass(frozen=True)
class _Wanted:
    name: str
    reducer: ReducerDescription
    settings: ReducerTestSettings
    serial: str
    accepted: Timebase | None = None


def _settings(
    short: bool, twist: float | None, no_twist: bool, tare: bool | None, repeats: int | None
) -> ReducerTestSettings:
    from torquebench.campaign.reducers.settings import ReducerTestSettings

    settings = ReducerTestSettings.short() if short else ReducerTestSettings()
    if repeats is not None:
        if short:
            raise InputError("--repeats and --short", "one of them: a short test has no repeats")
        settings = settings.with_repeats(repeats)
    if tare is False:
        settings = replace(settings, empty_run=None)
    elif tare:
        settings = replace(settings, tare_always=True)
    if twist is not None and no_twist:
        raise InputError("--twist and --no-twist", "one of both")
    if no_twist:
        return replace(settings, bench_twist=None)
    return settings if twist is None else replace(settings, twist_arcmin_per_nm=twist)


def _mounted(
    described: BenchDescription, named: str | None, serial: str
) -> tuple[ReducerDescription, BenchDescription]:
    """Return the tested type, and the bench; a simulated bench gets that reducer mounted.

    A simulated bench mounts the named packaged type; another serial number is another specimen.

    Raises
    ------
    InputError
        No type is named on a real bench, or its ratio isn't that of the bench's description.
    """
    from torquebench.reducers import available_reducers, load_reducer

    if named is None and not described.simulated:
        raise InputError(
            Message("no reducer for {name}", described.name),
            "a packaged type or a description (.toml)",
            "name the mounted reducer with --reducer",
        )
    held = str(described.driver.get("reducer", "standard")) if described.simulated else ""
    kind = load_reducer(named or held)
    if described.simulated:
        driver = dict(described.driver)
        if named in available_reducers():
            driver["reducer"] = held = str(named)
        if serial:
            driver.setdefault("reducer_seed", zlib.crc32(serial.encode()))
        ratio = load_reducer(held).ratio
        settings = described.bench.model_copy(update={"reducer_ratio": ratio})
        described = described.model_copy(update={"driver": driver, "bench": settings})
    expected = described.bench.reducer_ratio
    if abs(kind.ratio / expected - 1.0) > 1e-6:
        raise InputError(
            Message("{name}: a ratio of {ratio:g}", named, kind.ratio),
            Message(
                "{expected:g}, the ratio of what is mounted on {name}", expected, described.name
            ),
            "correct the reducer's description, or reducer_ratio of the bench",
        )
    return kind, described


def _dry_run(described: BenchDescription, wanted: _Wanted) -> None:
    from torquebench.campaign.reducers.tests import rehearse_reducer_test
    from torquebench.cli.bench_session import rehearsing
    from torquebench.cli.reducers.evaluating import rehearsal_table

    with rehearsing(described) as station:
        parts = rehearse_reducer_test(station, wanted.name, wanted.reducer, wanted.settings)
        out().print(rehearsal_table(wanted.reducer, parts, simulated=described.simulated))
    answer(
        reducer=wanted.reducer.name,
        serial=wanted.serial,
        simulated=described.simulated,
        plans=[TEST_PLAN.of(part) for part in parts],
    )


def _run(described: BenchDescription, wanted: _Wanted, options: BenchOptions) -> ReducerTestRecord:
    from torquebench.bench.roles import SIDES
    from torquebench.campaign.reducers.tests import run_reducer_test

    with options.open(described) as session:
        _, missing = tell_compensation(session.station, SIDES, wanted.accepted)
        answer(not_in_u=missing)
        with session.measuring() as (progress, ask):
            return run_reducer_test(
                session.station,
                wanted.name,
                wanted.reducer,
                wanted.settings,
                serial=wanted.serial,
                progress=progress,
                on_pause=ask,
            )


def _finish(record: ReducerTestRecord, reports: list[Path]) -> None:
    from torquebench.cli.reducers.evaluating import print_record

    print_record(record)
    if reports:
        from torquebench.reports.reducers.report import reducer_page

        page = reducer_page(record)
        write_reports(page, reports)
    if record.failed:
        raise typer.Exit(CHECK_FAILED)
