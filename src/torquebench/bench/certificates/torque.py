"""The certificate of a reference transducer, and the correction that follows from it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.bench.certificates.table import check_columns, read_rows
from torquebench.bench.roles import SIDES, Side
from torquebench.errors import InputError
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.uncertainty import CertifiedUncertainty

__all__ = ["ReferenceCertificate", "read_certificate", "read_uncertainty"]

_COLUMNS = ("side", "torque_nm", "error_nm", "expanded_uncertainty_nm")


@dataclass(frozen=True, eq=False)
class ReferenceCertificate:
    """Errors of a reference transducer at its certified points.

    Parameters
    ----------
    torque_nm : ndarray of float64, shape (n,)
        Certified torques, strictly increasing, N·m.
    error_nm : ndarray of float64, shape (n,)
        Indication minus torque there, N·m.
    expanded_uncertainty_nm : ndarray of float64, shape (n,)
        Expanded uncertainty (k = 2) of the errors, N·m.

    Raises
    ------
    InputError
        Fewer than two points, different lengths, torques that don't increase, NaN.

    Examples
    --------
    >>> certificate = ReferenceCertificate(
    ...     np.array([-100.0, 0.0, 100.0]), np.array([0.0, 0.0, 0.02]), np.full(3, 0.02)
    ... )
    >>> certificate.correct([100.02, 50.01]).round(4).tolist()
    [100.0, 50.0]
    """

    torque_nm: NDArray[np.float64]
    error_nm: NDArray[np.float64]
    expanded_uncertainty_nm: NDArray[np.float64]

    def __post_init__(self) -> None:
        columns = (self.torque_nm, self.error_nm, self.expanded_uncertainty_nm)
        check_columns("certificate", 2, *columns)
        indicated = self.torque_nm + self.error_nm
        if (np.diff(self.torque_nm) <= 0).any() or (np.diff(indicated) <= 0).any():
            raise InputError(
                "certificate whose torques or indications don't increase",
                "strictly increasing torque",
                "sort the points and remove duplicates",
            )

    def correct(self, indication_nm: ArrayLike) -> NDArray[np.float64]:
        """Torque from the indication, errors interpolated linearly between certified points.

        Beyond the last certified point the error of that point is taken.
        """
        indication = np.asarray(indication_nm, dtype=np.float64)
        error = np.interp(indication, self.torque_nm + self.error_nm, self.error_nm)
        return np.asarray(indication - error)

    @property
    def certified(self) -> CertifiedUncertainty:
        """U (k = 2) over the torque."""
        from torquebench.uncertainty import CertifiedUncertainty  # heavy

        return CertifiedUncertainty.of_table(self.torque_nm, self.expanded_uncertainty_nm)


def read_certificate(path: Path | str) -> dict[Side, ReferenceCertificate]:
    """Read the certificate of a standard from a CSV file.

    Parameters
    ----------
    path : path
        Columns `side` (input or output), `torque_nm`, `error_nm` (indication minus torque) and
        `expanded_uncertainty_nm` (k = 2).

    Raises
    ------
    InputError
        With file, line and column.
    """
    points: dict[str, list[tuple[float, ...]]] = {"input": [], "output": []}
    remedy = "correct `certificate` in the bench description"
    for row in read_rows(path, _COLUMNS, "certificate", remedy):
        side = row.cells["side"]
        if side not in points:
            raise InputError(Message("{place}: side {side!r}", row.place, side), "input, output")
        points[side].append(tuple(row.number(column) for column in _COLUMNS[1:]))
    found: dict[Side, ReferenceCertificate] = {}
    for side in SIDES:
        if points[side]:
            columns = np.array(sorted(points[side]), dtype=np.float64).T
            found[side] = ReferenceCertificate(columns[0], columns[1], columns[2])
    return found


def read_uncertainty(path: Path | str, side: str = "") -> CertifiedUncertainty:
    """Read U (k = 2) of one reference transducer over the torque from a CSV file.

    Parameters
    ----------
    path : path
        Columns `torque_nm` and `expanded_uncertainty_nm`; a certificate of a bench's standard, with
        `side`, may be given too.
    side : {"input", "output", ""}
        Whose lines are read where the file has both.

    Raises
    ------
    InputError
        With file, line and column.
    """
    from torquebench.uncertainty import CertifiedUncertainty

    rows = read_rows(
        path,
        ("torque_nm", "expanded_uncertainty_nm"),
        "certificate",
        "give the standard's U in %, or the path of its certificate's table",
    )
    if side:
        rows = [row for row in rows if row.cells.get("side", side) == side]
    points = [
        [row.number(name) for name in ("torque_nm", "expanded_uncertainty_nm")] for row in rows
    ]
    torque, expanded = np.array(sorted(points), dtype=np.float64).reshape(-1, 2).T
    try:
        return CertifiedUncertainty.of_table(torque, expanded)
    except InputError as error:
        raise InputError(
            Message("certificate {path}: {found}", path, error.found), error.allowed, error.remedy
        ) from error
