"""The certificate of an angle encoder over a turn, and the correction by it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.bench.certificates.table import check_columns, read_columns
from torquebench.bench.roles import SIDES, Side
from torquebench.errors import InputError
from torquebench.units import TURN

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription

LEAST_POINTS = 8
_QUANTITIES = ("angle", "error", "expanded_uncertainty")


@dataclass(frozen=True, eq=False)
class EncoderCertificate:
    """Errors of an encoder at certified angles of one turn.

    Parameters
    ----------
    angle_rad : ndarray of float64, shape (n,)
        Indicated angles from the encoder's own zero, increasing, within one turn.
    error_rad : ndarray of float64, shape (n,)
        Indication minus angle there.
    expanded_uncertainty_rad : ndarray of float64, shape (n,)
        Expanded uncertainty (k = 2) of the errors.

    Raises
    ------
    InputError
        Fewer than 8 points, different lengths, angles that don't increase or exceed a turn, NaN.

    Examples
    --------
    >>> angle = np.radians(np.arange(0.0, 360.0, 45.0))
    >>> certificate = EncoderCertificate(angle, 5e-6 * np.sin(angle), np.full(8, 1e-7))
    >>> certificate.correct(np.radians([90.0, 450.0])).round(6).tolist()
    [1.570791, 7.853977]
    """

    angle_rad: NDArray[np.float64]
    error_rad: NDArray[np.float64]
    expanded_uncertainty_rad: NDArray[np.float64]

    def __post_init__(self) -> None:
        columns = (self.angle_rad, self.error_rad, self.expanded_uncertainty_rad)
        check_columns("encoder certificate", LEAST_POINTS, *columns)
        if (np.diff(self.angle_rad) <= 0).any() or np.ptp(self.angle_rad) >= TURN * (1 - 1e-9):
            raise InputError(
                "encoder certificate whose angles don't increase within one turn",
                "strictly increasing angles of one turn, the first one not repeated at 360°",
                "sort the points and remove duplicates",
            )

    @property
    def standard_uncertainty_rad(self) -> float:
        """Standard uncertainty of a corrected angle, the root mean square of all points."""
        return float(np.sqrt(np.mean((0.5 * self.expanded_uncertainty_rad) ** 2)))

    def correct(self, indicated_rad: ArrayLike) -> NDArray[np.float64]:
        """Return the angle from the indication over any number of turns, linear between errors."""
        indicated = np.asarray(indicated_rad, dtype=np.float64)
        error = np.interp(indicated, self.angle_rad, self.error_rad, period=TURN)
        return np.asarray(indicated - error)


def read_encoder_certificate(path: Path | str) -> EncoderCertificate:
    """Read the certificate of an encoder from a table.

    Parameters
    ----------
    path : path
        Columns `angle_deg`, `error_arcsec` (indication minus angle) and
        `expanded_uncertainty_arcsec` (k = 2), or in another unit of an angle.

    Raises
    ------
    InputError
        With file, line and column.
    """
    table, columns = read_columns(
        path,
        dict.fromkeys(_QUANTITIES, "angle"),
        _QUANTITIES,
        "encoder certificate",
        "correct `certificate` of the encoder in the bench description",
    )
    points = np.array([columns.numbers(table, name) for name in _QUANTITIES])
    return EncoderCertificate(*points[:, np.argsort(points[0], kind="stable")])


def encoder_certificates(
    description: BenchDescription, brought: Mapping[Side, EncoderCertificate]
) -> dict[Side, EncoderCertificate]:
    """Return the encoders' certificates, from the description's files, else from the drivers."""
    certificates = dict(brought)
    for side in SIDES:
        encoder = description.module(side).encoder
        if encoder is not None and encoder.certificate is not None:
            certificates[side] = read_encoder_certificate(encoder.certificate)
    return certificates
