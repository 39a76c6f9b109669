"""Formats of tables, by file name ending."""

from pathlib import Path

from torquebench.errors import InputError

__all__ = [
    "ENDINGS",
    "READ",
    "WRITTEN",
    "check_read",
    "check_written",
    "is_csv",
    "is_parquet",
    "split_part",
]

_CSV = ("", ".csv", ".txt", ".tsv")
_ENDINGS = {
    **dict.fromkeys(_CSV, "csv"),
    **dict.fromkeys((".parquet", ".pq"), "parquet"),
    **dict.fromkeys((".xlsx", ".xlsm", ".xlsb", ".xls", ".ods"), "excel"),
    ".tdms": "tdms",
    **dict.fromkeys((".mf4", ".mdf"), "mdf4"),
    **dict.fromkeys((".h5", ".hdf5", ".hdf"), "hdf5"),
}
ENDINGS = tuple(_ENDINGS)[1:]
"""All formats that can be read."""
WRITTEN = "CSV (.csv, .txt, .tsv) or Parquet (.parquet)"
READ = (
    "CSV (.csv, .txt, .tsv), Parquet (.parquet), Excel (.xlsx, .xls, .ods), TDMS (.tdms), "
    "MDF4 (.mf4) or HDF5 (.h5)"
)


def format_of(path: Path) -> str:
    """Return the format of a file by its name, ``""`` where that names none.

    Examples
    --------
    >>> format_of(Path("readings.MF4")), format_of(Path("readings.xlsx#Sheet 2"))
    ('mdf4', 'excel')
    """
    return _ENDINGS.get(split_part(path)[0].suffix.lower(), "")


def split_part(path: Path) -> tuple[Path, str]:
    """Return a file, and which sheet or group of it is meant by ``FILE#PART``.

    Examples
    --------
    >>> split_part(Path("bench.tdms#Torque"))[1], split_part(Path("bench #2.csv"))[1]
    ('Torque', '')
    """
    file, mark, part = str(path).rpartition("#")
    parted = mark and Path(file).suffix.lower() in _ENDINGS and not path.exists()
    if parted and _ENDINGS[Path(file).suffix.lower()] not in ("csv", "parquet"):
        return Path(file), part
    return path, ""


def is_parquet(path: Path) -> bool:
    """Return whether a file is Parquet by its name."""
    return format_of(path) == "parquet"


def is_csv(path: Path) -> bool:
    """Return whether a file's name has none of the other formats' endings."""
    return format_of(path) in ("csv", "")


def check_read(path: Path) -> None:
    """Refuse a file whose ending names no format that is read.

    Raises
    ------
    InputError
        Naming the formats.
    """
    if not format_of(path):
        raise InputError(path.name, READ, "choose one of these endings")


def check_written(path: Path) -> None:
    """Refuse a file whose ending names no format that is written, before any work is done for it.

    Raises
    ------
    InputError
        Naming the formats.

    Examples
    --------
    >>> check_written(Path("torque.xls"))
    Traceback (most recent call last):
    torquebench.errors.InputError: torque.xls; allowed: CSV (.csv, .txt, .tsv) or Parquet ...
    """
    if format_of(path) not in ("csv", "parquet"):
        raise InputError(path.name, WRITTEN, "choose one of these endings")
