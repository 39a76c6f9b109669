"""Formats of tables, by the ending of the file's name."""

from pathlib import Path

from torquebench.errors import InputError

__all__ = ["check_formats", "is_parquet"]

_CSV_ENDINGS = ("", ".csv", ".txt", ".tsv")
_PARQUET_ENDINGS = (".parquet", ".pq")


def is_parquet(path: Path) -> bool:
    """Return whether a file is Parquet by its name."""
    return path.suffix.lower() in _PARQUET_ENDINGS


def check_formats(*paths: Path) -> None:
    """Refuse a file whose ending names no format, before any work is done for it.

    Raises
    ------
    InputError
        Naming the formats that can be read and written.

    Examples
    --------
    >>> check_formats(Path("readings.csv"), Path("torque.xls"))
    Traceback (most recent call last):
    torquebench.errors.InputError: torque.xls; allowed: CSV (.csv, .txt, .tsv) or Parquet ...
    """
    for path in paths:
        if path.suffix.lower() not in (*_CSV_ENDINGS, *_PARQUET_ENDINGS):
            raise InputError(
                path.name,
                "CSV (.csv, .txt, .tsv) or Parquet (.parquet)",
                "choose one of these endings",
            )
