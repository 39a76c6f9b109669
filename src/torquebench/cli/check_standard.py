"""`torquebench check`: the daily check of a module against the check standard."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from torquebench.cli.answers import CHECK
from torquebench.cli.chain_words import tell_missing
from torquebench.cli.failure import CHECK_FAILED
from torquebench.cli.options import BenchOptions, ModuleArgument
from torquebench.cli.recovered import tell_doubts
from torquebench.cli.terminal.confirming import confirm_start
from torquebench.cli.terminal.console import answer, narrow_table, out, say

if TYPE_CHECKING:
    from torquebench.campaign.checking import CheckResult

__all__ = ["check"]


def check(
    side: ModuleArgument,
    tolerance: Annotated[
        float, typer.Option(min=1e-6, max=100, help="Largest error allowed, % of full scale.")
    ] = 0.1,
    profile: Annotated[
        str, typer.Option(help="Steps to check: a profile's name, or the path of a .toml.")
    ] = "check",
    *,
    options: BenchOptions,
) -> None:
    """Check a module against the check standard: zero, a few steps, verdict with guard band.

    The verdict is registered and enters the control chart of `torquebench records drift`. Exit code
    1 if an error exceeds the tolerance.
    """
    from torquebench.calibration import load_profile

    chosen = load_profile(profile)
    description = options.description()
    confirm_start(description, side.value, chosen, options.yes)

    from torquebench.campaign.checking import check_module
    from torquebench.campaign.doubts import VERIFICATION_STANDARD

    with options.open(description) as session:
        tell_doubts(session.station, VERIFICATION_STANDARD)
        with session.measuring() as (progress, ask):
            result = check_module(
                session.station, side.value, chosen, tolerance, progress=progress, on_pause=ask
            )
    _report(result, tolerance)


def _report(result: CheckResult, tolerance: float) -> None:
    data = result.data
    simulated = " - simulated" if data.simulated else ""
    say(
        f"[bold]{data.side.capitalize()} module, {data.range_nm:g} N·m, "
        f"transducer {data.transducer_serial}{simulated}[/bold]"
    )
    model = result.model
    say("without compensation" if model is None else f"compensated by model-{model.model_id}")
    table = narrow_table(columns=(">standard N·m", ">error N·m", ">% FS", ">U N·m", "|verdict"))
    points = []
    for standard, error, expanded, decision in zip(
        data.standard_nm,
        result.error_nm,
        result.expanded_uncertainty_nm,
        result.judged.decisions,
        strict=True,
    ):
        table.add_row(
            f"{standard:.2f}",
            f"{error:+.4f}",
            f"{100 * error / data.range_nm:+.4f}",
            f"{expanded:.4f}",
            decision.verdict.label,
        )
        point = {
            "standard_nm": standard,
            "error_nm": error,
            "expanded_uncertainty_nm": expanded,
            "verdict": decision.verdict,
        }
        points.append(point)
    out().print(table)
    inside = not result.verdict.failed
    colour = "green" if inside else "red"
    say(
        f"[{colour}]{result.verdict.label}[/{colour}]: worst {result.worst_percent_fs:+.3g} % FS, "
        f"tolerance ±{tolerance:g} % FS, guard band w = U"
    )
    say("U of an error: U of the torque by its measuring chain, and the check standard")
    tell_missing(result.judged.missing)
    say(f"Run: {result.run_id}")
    answer(
        **CHECK.of(
            result,
            model=None if model is None else f"model-{model.model_id}",
            points=points,
            tolerance_percent_fs=tolerance,
        )
    )
    if not inside:
        raise typer.Exit(CHECK_FAILED)
