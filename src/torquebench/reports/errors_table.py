"""Tables of errors in N·m, % of full scale and % of reading."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from torquebench.message import Message
from torquebench.reports.page import Table

if TYPE_CHECKING:
    from torquebench.calibration import ErrorSummary
    from torquebench.campaign.results import CompensationResult, ModuleResult

_HEADER = (
    "",
    "worst, N·m",
    "RMS, N·m",
    "worst, % FS",
    "RMS, % FS",
    "worst, % of reading",
    "RMS, % of reading",
)


def number(value: float | None, digits: int = 3) -> str:
    """Return a value with a number of significant digits, without an exponent.

    Parameters
    ----------
    value : float or None
        The value; None is shown as a dash.
    digits : int
        Significant digits.

    Returns
    -------
    str
        Its text.

    Examples
    --------
    >>> number(0.0123456), number(1234.5), number(None), number(0.0)
    ('0.0123', '1230', '–', '0')
    """
    if value is None:
        return "–"
    if value == 0.0:
        return "0"
    rounded = float(f"{value:.{digits}g}")
    places = max(0, digits - 1 - int(f"{rounded:e}".split("e")[1]))
    return f"{rounded:.{places}f}"


def errors_table(
    rows: Sequence[tuple[str, ErrorSummary]], caption: str, emphasised: int | None = None
) -> Table:
    """Return a table of error summaries, one row each.

    Parameters
    ----------
    rows : sequence of (str, ErrorSummary)
        Name of the row and its errors.
    caption : str
        Reference and points.
    emphasised : int, optional
        Row to mark.

    Returns
    -------
    Table
        Ready for a page.
    """
    cells = [
        (
            name,
            number(summary.worst_nm),
            number(summary.rms_nm),
            number(summary.worst_percent_fs),
            number(summary.rms_percent_fs),
            number(summary.worst_percent_reading),
            number(summary.rms_percent_reading),
        )
        for name, summary in rows
    ]
    if rows:
        caption = Message("{caption} % of reading: {rule}.", caption, rows[0][1].reading_rule)
    return Table(_HEADER, cells, caption, emphasised)


def reference_name(module: ModuleResult) -> str:
    """Name the reference with which the readings of a verification are compared."""
    return "true torque" if module.verification.simulated else "standard"


def module_errors(
    module: ModuleResult,
) -> list[tuple[str, list[tuple[CompensationResult, ErrorSummary]]]]:
    """Return a module's errors without and with each model, grouped by their reference."""
    results = (module.raw, *module.models)
    groups = len(module.raw.verification.groups)
    count = f"{len(module.verification)} readings in {groups} groups"
    parts = (
        (f"{count}, against the standard", [r.verification.against_standard for r in results]),
        (f"{count}, against the true torque", [r.verification.against_truth for r in results]),
        (
            f"averaged over the groups, against the {reference_name(module)}",
            [r.verification.averaged for r in results],
        ),
        ("dense noise-free sweep, against the true torque", [r.dense for r in results]),
    )
    known = [
        (words, [(r, each) for r, each in zip(results, errors, strict=True) if each is not None])
        for words, errors in parts
    ]
    return [(words, rows) for words, rows in known if rows]
