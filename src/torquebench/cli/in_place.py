"""`torquebench in-place`: a stand-alone calibration compared with the calibration in place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field as data_field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from torquebench.cli.options import (
    DEFAULT_DATA,
    BenchOption,
    Module,
    ModuleArgument,
    RealTimeOption,
    RecordsOption,
    YesOption,
    bench_description,
)
from torquebench.cli.terminal.confirming import confirm_start
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations.result import HIDDEN, Result
from torquebench.reports.page import Page

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription
    from torquebench.bench.roles import Side
    from torquebench.calibration import CalibrationData
    from torquebench.papers.tables import ModuleTables

__all__ = ["in_place"]


@dataclass(frozen=True, kw_only=True)
class InPlace(Result):
    """Worst error of fresh readings in the chain, for each calibration."""

    side: str
    range_nm: float
    worst_percent_fs: Mapping[str, float | None]
    described: Any = data_field(metadata=HIDDEN)

    def page(self) -> Page:
        """Return its description."""
        page: Page = self.described()
        return page


def in_place(
    module: ModuleArgument = Module.output,
    alone: Annotated[
        Path | None,
        typer.Option(
            help="A calibration of the transducer alone (a table: reading_nm, standard_nm); "
            "needed on a real bench."
        ),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer points: takes a few seconds.")
    ] = False,
    bench: BenchOption = None,
    records: RecordsOption = None,
    yes: YesOption = False,
    real_time: RealTimeOption = False,
) -> InPlace:
    """Compare the calibration of a transducer alone with that of its chain in place.

    The chain is calibrated in place and verified at fresh points. Both calibrations are applied to
    the same readings: the transducer's own calibration doesn't contain the chain's additional
    torque. No model is put into use.
    """
    import dataclasses

    description = bench_description(bench)
    side: Side = module.value
    table = None if alone is None else _alone(alone, side, description)
    if table is None and not description.simulated:
        raise InputError(
            Message("no calibration of the transducer alone for {name}", description.name),
            "a table with reading_nm and standard_nm",
            "give --alone FILE.csv",
        )
    from torquebench.calibration import load_profile

    confirm_start(description, side, load_profile("rapid-in-situ"), yes)
    measured = _measured(description, side, quick, bench, records, real_time=real_time, yes=yes)
    if table is not None:
        measured = dataclasses.replace(measured, alone=table)
    from torquebench.papers.models import BP_RESIDUAL, RECOMMENDED_NAME, fit_module
    from torquebench.papers.page import alone_row, in_place_page

    fitted = fit_module(measured, (BP_RESIDUAL, RECOMMENDED_NAME))
    found = alone_row(fitted)
    assert found is not None
    names = ("none: raw reading", "transducer alone", "in place", "in place, rising only (BP)")
    return InPlace(
        headline="Worst error of fresh readings in the chain, by calibration.",
        simulated=description.simulated,
        side=side,
        range_nm=measured.calibration.range_nm,
        worst_percent_fs=dict(zip(names, found, strict=True)),
        described=lambda: in_place_page(description.name, side, fitted),
    )


def _alone(path: Path, side: Side, description: BenchDescription) -> CalibrationData:
    from torquebench.tables import read_calibration

    return read_calibration(path, range_nm=description.module(side).range_nm, side=side)


def _measured(
    description: BenchDescription,
    side: Side,
    quick: bool,
    bench: Path | None,
    records: Path | None,
    *,
    real_time: bool,
    yes: bool,
) -> ModuleTables:
    import tempfile

    from torquebench.cli.bench_session import open_bench
    from torquebench.papers.tables import PapersSettings, measure_module

    settings = PapersSettings.quick() if quick else PapersSettings()
    with tempfile.TemporaryDirectory(prefix="torquebench-in-place-") as scratch:
        kept = records or (Path(scratch) if bench is None else DEFAULT_DATA)
        with (
            open_bench(description, kept, real_time=real_time, yes=yes) as session,
            session.measuring(may_pause=False) as (progress, _),
        ):
            return measure_module(session.station, side, settings, progress)
