"""The static evaluation as texts in one language, for the PDF and the digital certificate."""

from collections.abc import Collection, Sequence
from typing import Any

from torquebench.reports.certificate.labels import Labels
from torquebench.reports.certificate.record import CertificateRecord, StaticRow, StaticTable

MOST_ROWS = 20
"""Largest number of steps in the PDF's text; the annex has the complete table."""

LISTED_SHARES = (0.0, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0)
"""Steps listed from a longer table, as shares of the range, as usual in torque calibrations."""

STATIC_QUANTITIES = {
    "indication": "f_q",
    "repeatability": "b′",
    "reproducibility": "b",
    "interpolation": "f_a",
    "reversibility": "h",
    "expanded": "W",
    "interval": "W′",
}
"""Symbol of each quantity of a row, in the table's order."""


def listed_steps(steps: Collection[float], range_nm: float) -> set[float]:
    """Return the steps of both directions that are nearest to `LISTED_SHARES` of the range.

    Examples
    --------
    >>> sorted(listed_steps(range(0, 101, 5), 100.0))
    [0, 10, 20, 40, 60, 80, 100]
    """
    by_direction = [[step for step in steps if step * sign >= 0.0] for sign in (1.0, -1.0)]
    return {
        min(side, key=lambda step: abs(abs(step) - share * range_nm))
        for side in by_direction
        if side
        for share in LISTED_SHARES
    }


def static_content(record: CertificateRecord, words: Labels) -> dict[str, Any] | None:
    """Return the section of the static evaluation; None without an evaluation."""
    if not record.static:
        return None
    first = record.static[0]
    resolution = words.short(first.resolution_nm, 2) if first.resolution_nm else "–"
    return {
        "title": words["static"],
        "text": words["static_text"].format(degree=first.degree, resolution=resolution),
        "header": ["N·m", *STATIC_QUANTITIES.values()],
        "tables": [_table(table, record, words) for table in record.static],
        "zero": zero_hysteresis_words(record, words),
    }


def _table(table: StaticTable, record: CertificateRecord, words: Labels) -> dict[str, Any]:
    side = words["after" if table.compensated else "before"] if record.compensation else ""
    direction = words["clockwise" if table.direction > 0 else "counter-clockwise"]
    listed = {row.torque_nm for row in table.rows}
    every = [_row(row, words) for row in table.rows]
    many = len(table.rows) > MOST_ROWS
    if many:
        listed = listed_steps(listed, record.item.range_nm)
    rows = [cells for cells, row in zip(every, table.rows, strict=True) if row.torque_nm in listed]
    return {
        "title": ", ".join(part for part in (direction, side) if part),
        "rows": [*rows, *_largest(table, words)] if many else rows,
        "all": every if many else None,
        "notes": " ".join((_zero_residual(table, words), class_words(table, words))),
    }


def _values(row: StaticRow) -> tuple[float | None, ...]:
    return tuple(getattr(row, name) for name in STATIC_QUANTITIES)


def _row(row: StaticRow, words: Labels) -> list[str]:
    return [words.short(row.torque_nm), *_cells(_values(row), words)]


def _largest(table: StaticTable, words: Labels) -> list[list[str]]:
    """Return two rows: the largest magnitude of each quantity, and the step where it occurs."""
    largest: list[str] = []
    steps: list[str] = []
    for name in STATIC_QUANTITIES:
        values = [
            (abs(v), row.torque_nm) for row in table.rows if (v := getattr(row, name)) is not None
        ]
        value, step = max(values, default=(None, None))
        largest += _cells([value], words)
        steps.append("–" if step is None else words.short(step))
    title = words["static_largest"].format(count=len(table.rows))
    return [[title, *largest], [words["static_largest_at"], *steps]]


def _cells(values: Sequence[float | None], words: Labels) -> list[str]:
    return ["–" if value is None else words.number(value, 3) for value in values]


def _zero_residual(table: StaticTable, words: Labels) -> str:
    if table.zero_residual is None:
        return words["static_zero_unknown"]
    return words["static_zero"].format(value=words.number(table.zero_residual, 3))


def class_words(table: StaticTable, words: Labels) -> str:
    """Name the classes whose limits are met, with their ranges, or why there are none."""
    if table.missing:
        return words["static_unclassified"].format(missing=", ".join(table.missing))
    if not table.classes:
        return words["static_no_class"]
    mark, stop = ("；", "。") if words.language == "zh" else ("; ", ".")
    kept = [
        words["static_class"].format(
            name=words.short(each.accuracy_class), torque=words.short(each.from_nm)
        )
        for each in table.classes
    ]
    return mark.join(kept) + stop


def zero_hysteresis_words(record: CertificateRecord, words: Labels) -> str | None:
    """Return the zero hysteresis of reversing cycles; None for other calibrations."""
    found = record.zero_hysteresis
    if found is None:
        return None
    text = words["zero_hysteresis"].format(
        cycles=found.cycles,
        before=words.short(found.before_nm, 3),
        percent=words.short(found.before_percent_fs, 3),
    )
    if found.after_nm is None or found.after_percent_fs is None:
        return text
    return text + words["zero_hysteresis_after"].format(
        after=words.short(found.after_nm, 3), percent=words.short(found.after_percent_fs, 3)
    )
