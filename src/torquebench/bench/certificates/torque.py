"""The certificate of a reference transducer, and the correction by it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.bench.certificates.table import check_columns, read_columns
from torquebench.bench.roles import SIDES, Side
from torquebench.errors import InputError
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.uncertainty import CertifiedUncertainty

_QUANTITIES = ("torque", "error", "expanded_uncertainty")


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
        """Return the torque from the indication; errors are linear between certified points.

        Beyond the last certified point, the error of that point is used.
        """
        indication = np.asarray(indication_nm, dtype=np.float64)
        error = np.interp(indication, self.torque_nm + self.error_nm, self.error_nm)
        return np.asarray(indication - error)

    @property
    def certified(self) -> CertifiedUncertainty:
        """U (k = 2) over the torque."""
        from torquebench.uncertainty import CertifiedUncertainty  # imported late: it is heavy

        return CertifiedUncertainty.of_table(self.torque_nm, self.expanded_uncertainty_nm)


def read_certificate(path: Path | str) -> dict[Side, ReferenceCertificate]:
    """Read the certificate of a standard from a table.

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
    table, columns = read_columns(
        path,
        {"side": "word", **dict.fromkeys(_QUANTITIES, "torque")},
        ("side", *_QUANTITIES),
        "certificate",
        "correct `certificate` in the bench description",
    )
    sides = {str(side): number for number, side in enumerate(SIDES)}
    side_of = table.meanings(columns.columns["side"].index, sides, "input, output")
    points = np.array([columns.numbers(table, name) for name in _QUANTITIES])
    certificates: dict[Side, ReferenceCertificate] = {}
    for number, side in enumerate(SIDES):
        here = points[:, side_of == number]
        if here.size:
            certificates[side] = ReferenceCertificate(*here[:, np.argsort(here[0], kind="stable")])
    return certificates


def read_uncertainty(path: Path | str, side: str = "") -> CertifiedUncertainty:
    """Read U (k = 2) of one reference transducer over the torque from its certificate.

    Parameters
    ----------
    path : path
        A digital calibration certificate (XML) of any institute, or a table with `torque_nm` and
        `expanded_uncertainty_nm`; a certificate of a bench's standard, with `side`, may be given
        too.
    side : {"input", "output", ""}
        Side whose rows are read if the file has both.

    Raises
    ------
    InputError
        With file, line and column.
    """
    from torquebench.tables import is_dcc, read_dcc
    from torquebench.uncertainty import CertifiedUncertainty

    if is_dcc(Path(path)):
        return read_dcc(Path(path)).uncertainty()
    quantities = ("torque", "expanded_uncertainty")
    table, columns = read_columns(
        path,
        {"side": "word", **dict.fromkeys(quantities, "torque")},
        quantities,
        "certificate",
        "give the standard's U in %, or the path of its certificate: a table or its DCC (XML)",
    )
    points = np.array([columns.numbers(table, name) for name in quantities])
    if side and "side" in columns:
        here = np.array([text.strip().lower() for text in table.texts(columns.name("side"))])
        points = points[:, here == side]
    torque, expanded = points[:, np.argsort(points[0], kind="stable")]
    try:
        return replace(CertifiedUncertainty.of_table(torque, expanded), record=Path(path).name)
    except InputError as error:
        raise InputError(
            Message("certificate {path}: {found}", path, error.found), error.allowed, error.remedy
        ) from error
