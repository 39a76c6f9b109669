"""Tables and files of an evaluated reducer test."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich.markup import escape

from torquebench.cli.answers import EVALUATED_QUANTITY
from torquebench.cli.failure import CHECK_FAILED
from torquebench.cli.options import check_kept, check_output_folder
from torquebench.cli.terminal.console import answer, say_file, stderr_console
from torquebench.units import ARCSEC, DEG_PER_RAD

if TYPE_CHECKING:
    from torquebench.reducers import Finding, QuantityVerdict, ResultQuantity


def present(
    test: str,
    files: Sequence[Path],
    result: Any,
    judged: Sequence[QuantityVerdict],
    output: Path | None,
    settings: dict[str, Any],
) -> None:
    """Print a result within 80 columns, write it into a folder if one is named.

    Raises
    ------
    typer.Exit
        With 1 where a limit isn't kept or a finding forbids a verdict.
    """
    source = ", ".join(file.name for file in files)
    quantities = result.quantities()
    findings: tuple[Finding, ...] = getattr(result, "findings", ())
    if output is not None:
        _write(test, files, result, quantities, judged, findings, output, settings)
    from torquebench.campaign.reducers.quantities import result_quantities
    from torquebench.cli.reducers.evaluating import print_quantities

    factors = {each.key: each.estimate.coverage_factor() for each in (*quantities, *judged)}
    rows = result_quantities(result, judged)
    print_quantities(f"{test}: {source}", result, rows, factors)
    for finding in findings:
        style = "red" if finding.severe else "yellow"
        stderr_console().print(
            f"[{style}]{escape(finding.name)}[/{style}]  {escape(finding.message)}"
        )
        stderr_console().print(f"  {escape(finding.remedy)}", style="dim")
    if output is not None:
        say_file("Every number", output / "result.json")
    answer(
        test=test,
        data=source,
        quantities=_plain_quantities(quantities, judged),
        findings=list(findings),
    )
    failed = any(each.decision.verdict.failed for each in judged)
    if failed or any(finding.severe for finding in findings):
        raise typer.Exit(CHECK_FAILED)


def _plain_quantities(
    quantities: Sequence[ResultQuantity], judged: Sequence[QuantityVerdict]
) -> list[dict[str, Any]]:
    verdicts = {
        each.key: {"limit": each.limit, "verdict": each.decision.verdict} for each in judged
    }
    return [EVALUATED_QUANTITY.of(each, **verdicts.get(each.key, {})) for each in quantities]


def _write(
    test: str,
    files: Sequence[Path],
    result: Any,
    quantities: Sequence[ResultQuantity],
    judged: Sequence[QuantityVerdict],
    findings: Sequence[Finding],
    output: Path,
    settings: dict[str, Any],
) -> None:
    import hashlib

    from torquebench import __version__
    from torquebench.atomic_write import atomic_write
    from torquebench.campaign.reducers.results import plain_budget
    from torquebench.records import json_text

    check_output_folder(output)
    for file in files:
        check_kept(file)
    output.mkdir(parents=True, exist_ok=True)
    content = {
        "test": test,
        "software_version": __version__,
        "data": ", ".join(file.name for file in files),
        "data_sha256": ", ".join(hashlib.sha256(each.read_bytes()).hexdigest() for each in files),
        "settings": settings,
        "quantities": [
            {"key": each.key, "title": each.title, "rule": each.rule, **plain_budget(each.estimate)}
            for each in quantities
        ],
        "verdicts": [
            {
                "key": each.key,
                "limit": each.limit,
                "verdict": str(each.decision.verdict),
                "conformance_probability": each.decision.conformance_probability,
                "rule": each.decision.rule(),
            }
            for each in judged
        ],
        "findings": list(findings),
    }
    atomic_write(output / "result.json", json_text(content, indent=2) + "\n")
    _write_curves(output, result)


def _write_curves(output: Path, result: Any) -> None:
    """Write the data of figures as CSV: loops, error curves, strokes."""
    from torquebench.atomic_write import atomic_write

    rows: list[str] = []
    if hasattr(result, "loops"):
        rows.append("position,loop,torque_nm,rising_rad,falling_rad")
        for loop in result.loops:
            curve = loop.curve
            rows += [
                f"{loop.position:g},{loop.loop},{t:.8g},{up:.9g},{down:.9g}"
                for t, up, down in zip(
                    curve.torque_nm, curve.rising_rad, curve.falling_rad, strict=True
                )
            ]
    elif hasattr(result, "directions"):
        rows.append("direction,angle_deg,error_arcsec")
        for each in result.directions:
            rows += [
                f"{each.direction},{angle:.8g},{error:.6g}"
                for angle, error in zip(
                    each.angle_rad * DEG_PER_RAD, each.error_arcsec, strict=True
                )
            ]
    elif hasattr(result, "swings"):
        rows.append("stroke,angle_deg,error_arcsec")
        for number, stroke in enumerate(result.swings, 1):
            rows += [
                f"{number},{angle:.8g},{error:.6g}"
                for angle, error in zip(
                    stroke.angle_rad * DEG_PER_RAD, stroke.error_rad / ARCSEC, strict=True
                )
            ]
    if rows:
        atomic_write(output / "curves.csv", "\n".join(rows) + "\n")
