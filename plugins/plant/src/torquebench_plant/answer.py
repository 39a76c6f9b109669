"""An answer of the plant: a table and conclusions, for display or export."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from torquebench.atomic_write import atomic_file
from torquebench.tables.formats import check_written, format_of, formats

__all__ = ["Answer"]


@dataclass(frozen=True)
class Answer:
    """A table and its conclusions.

    Parameters
    ----------
    title : str
        The question, in words.
    columns : mapping of str to sequence
        Columns of one length; a name ends with its unit.
    facts : mapping of str to value
        Single values that follow, by their names with units.
    notes : tuple of str
        Remarks, in sentences.
    simulated : bool
        Whether any of it comes from a simulated bench.

    Examples
    --------
    >>> answer = Answer("Two", {"name": ["a", "b"], "value_nm": [1.0, None]})
    >>> len(answer), answer.rows()[1]
    (2, {'name': 'b', 'value_nm': None})
    """

    title: str
    columns: Mapping[str, Sequence[Any]]
    facts: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    simulated: bool = False

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def shown(self, most: int) -> list[dict[str, Any]]:
        """Return the rows to be shown where not all fit.

        These are the last ones of values over time, otherwise the first: of what is due, the most
        urgent.
        """
        return self.rows()[-most:] if self.in_time else self.rows()[:most]

    @property
    def in_time(self) -> bool:
        """Whether the rows are values over time, the oldest first."""
        return "when" in self.columns

    def rows(self) -> list[dict[str, Any]]:
        """Return the table row by row."""
        names = tuple(self.columns)
        return [
            dict(zip(names, row, strict=True)) for row in zip(*self.columns.values(), strict=True)
        ]

    def write(self, path: Path) -> None:
        """Write the table in the format that the ending of the file's name states.

        Raises
        ------
        InputError
            The ending names no format, or the file can't be written.
        """
        check_written(path)
        import pyarrow as pa

        table = pa.table({name: list(values) for name, values in self.columns.items()})
        chosen = format_of(path) or formats()[0]
        assert chosen.writer is not None
        with atomic_file(path) as file:
            writer = chosen.writer(file, table.schema, {})
            writer.write(table)
            writer.close()
