"""Uncertainty of a torque standard over the torque, from its certificate."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.elementwise import Values, functions_for, located, on_lines
from torquebench.errors import InputError
from torquebench.message import Message

FloatArray = NDArray[np.float64]

FROM_SHARE = 0.02
"""Smallest certified torque, as a share of the range, of a standard whose certificate isn't known
as a table: the first of 50 steps."""


@dataclass(frozen=True)
class CertifiedUncertainty:
    """Expanded uncertainty (k = 2) of a torque standard at its certified torques.

    U is interpolated linearly between them. Because the standard is zeroed where it is used, the
    uncertainty is a constant share of the torque below the smallest certified torque, and also
    above the largest one. Values that are stated for one direction only are used for both.

    Parameters
    ----------
    torque_nm : tuple of float
        Certified torques, strictly increasing, without 0, N·m.
    expanded_nm : tuple of float
        U (k = 2) at these, N·m.
    record : str, optional
        Source of the values, such as a certificate's number.

    Raises
    ------
    InputError
        No point, unlike lengths, torques that don't increase, a torque of 0, a negative U, NaN.

    Examples
    --------
    >>> CertifiedUncertainty.flat(0.4, 40.0, 2000.0).at([20.0, 40.0, -1500.0]).tolist()
    [0.2, 0.4, 0.4]
    >>> CertifiedUncertainty.of_torque(5e-4).at([-100.0, 2000.0]).tolist()
    [0.05, 1.0]
    >>> CertifiedUncertainty.of_table([0.0, 40.0, 2000.0], [0.0, 0.02, 0.2]).at([1020.0]).round(3)
    array([0.11])
    >>> CertifiedUncertainty.of_text("0.02", 2000.0).text
    '40.0: 0.4, 2000.0: 0.4'
    """

    torque_nm: tuple[float, ...]
    expanded_nm: tuple[float, ...]
    record: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        torque, expanded = np.array(self.torque_nm), np.array(self.expanded_nm)
        valid = torque.size == expanded.size > 0 and np.isfinite([*torque, *expanded]).all()
        if not (valid and (np.diff(torque) > 0).all() and (torque != 0).all()):
            raise InputError(
                Message(
                    "U {expanded_nm} N·m at torques {torque_nm} N·m",
                    _listed(self.expanded_nm),
                    _listed(self.torque_nm),
                ),
                "one U for each torque; torques increasing, other than 0",
                "enter the table as the standard's certificate has it",
            )
        if (expanded < 0).any():
            raise InputError(
                Message("U of a standard of {expanded:g} N·m", expanded.min()), "0 or more"
            )

    @classmethod
    def flat(cls, expanded_nm: float, from_nm: float, to_nm: float) -> CertifiedUncertainty:
        """Return a constant U in N·m from the smallest to the largest certified torque."""
        return cls((from_nm, to_nm), (expanded_nm, expanded_nm))

    @classmethod
    def of_range(cls, share: float, range_nm: float) -> CertifiedUncertainty:
        """Return a U that is a constant share of a range."""
        return cls.flat(share * range_nm, FROM_SHARE * range_nm, range_nm)

    @classmethod
    def of_text(cls, text: str, range_nm: float) -> CertifiedUncertainty:
        """Return the U in a text that a person or a table states.

        Parameters
        ----------
        text : str
            % of range such as ``0.02``, % of the torque such as ``0.02 of torque``, or certified
            torques with their U in N·m such as ``40: 0.4, 2000: 0.4``.

        Raises
        ------
        InputError
            The text has none of these forms.
        """
        number, _, of = text.strip().partition(" of ")
        try:
            if ":" in text:
                pairs = [[float(each) for each in pair.split(":")] for pair in text.split(",")]
                torque, expanded = zip(*pairs, strict=True)
                return cls(torque, expanded)
            share = 1e-2 * float(number.rstrip("% "))
        except ValueError:
            share = -1.0
        if not (0.0 <= share <= 1.0 and of in ("", "range", "torque")):
            raise InputError(
                Message("U of a standard {text!r}", text),
                "% of range such as 0.02, % of the torque such as '0.02 of torque', or torques "
                "with their U in N·m such as '40: 0.4, 2000: 0.4'",
            )
        return cls.of_torque(share) if of == "torque" else cls.of_range(share, range_nm)

    @classmethod
    def of_words(cls, text: str, range_nm: float) -> CertifiedUncertainty:
        """Return U from a text as in `of_text`, but with the reference of a percentage stated.

        Raises
        ------
        InputError
            The text is a bare number, or has none of the forms.

        Examples
        --------
        >>> CertifiedUncertainty.of_words("0.02 of torque", 2000.0).largest_nm(100.0)
        0.02
        >>> CertifiedUncertainty.of_words("0.02", 2000.0)
        Traceback (most recent call last):
        torquebench.errors.InputError: U of a standard '0.02': % of what isn't stated; ...
        """
        try:
            number = float(text.strip().rstrip("% "))
        except ValueError:
            return cls.of_text(text, range_nm)
        raise InputError(
            Message("U of a standard {text!r}: % of what isn't stated", text),
            Message("'{number:g} of torque' or '{number:g} of range'", number),
            "look into the standard's certificate which one it states",
        )

    @classmethod
    def of_torque(cls, share: float) -> CertifiedUncertainty:
        """Return a U that is a share of every torque."""
        return cls((1.0,), (share,))

    @classmethod
    def of_table(cls, torque_nm: ArrayLike, expanded_nm: ArrayLike) -> CertifiedUncertainty:
        """Return the U of a certificate's table.

        A row at torque 0 is ignored, because the standard is zeroed. Points on a straight line
        between their neighbours are left out.
        """
        torque, expanded = np.asarray(torque_nm, np.float64), np.asarray(expanded_nm, np.float64)
        if torque.shape == expanded.shape and torque.ndim == 1:
            down, up = torque < 0, ~(torque <= 0)
            sides = [_thinned(torque[here], expanded[here]) for here in (down, up)]
            torque, expanded = np.concatenate(sides, axis=1)
        return cls(tuple(torque.ravel().tolist()), tuple(expanded.ravel().tolist()))

    @property
    def text(self) -> str:
        """Torques with their U as a text for `of_text`."""
        pairs = zip(self.torque_nm, self.expanded_nm, strict=True)
        return ", ".join(f"{torque!r}: {expanded!r}" for torque, expanded in pairs)

    def larger(self, other: CertifiedUncertainty) -> CertifiedUncertainty:
        """Return a U that is nowhere smaller than either: the larger at each certified torque."""
        torque = np.array([*self.torque_nm, *other.torque_nm])
        sizes = np.unique(np.abs(torque))
        if (torque < 0).any():
            sizes = np.concatenate([-sizes[::-1], sizes])
        return CertifiedUncertainty.of_table(sizes, np.maximum(self.at(sizes), other.at(sizes)))

    @cached_property
    def directions(self) -> tuple[FloatArray, FloatArray]:
        """Magnitudes of the certified torques, and U, for negative and for positive torques."""
        points = np.array([self.torque_nm, self.expanded_nm])
        up = points[0] > 0
        down, upward = np.abs(points[:, ~up][:, ::-1]), points[:, up]
        return (down if down.size else upward), (upward if upward.size else down)

    def at(self, torque_nm: ArrayLike | float) -> Any:
        """Return U (k = 2) at torques, N·m; a float for a float."""
        down, up = self.directions
        if isinstance(torque_nm, float):
            return _in_direction(down if torque_nm < 0.0 else up, torque_nm)
        values = np.asarray(torque_nm, dtype=np.float64)
        return np.where(values < 0.0, _in_direction(down, values), _in_direction(up, values))

    def largest_nm(self, range_nm: float) -> float:
        """Return the largest U up to a torque, N·m."""
        inside = [certified_nm for certified_nm in self.torque_nm if abs(certified_nm) <= range_nm]
        return float(np.max(self.at([-range_nm, range_nm, *inside])))


def _in_direction(certified: FloatArray, torque_nm: Values) -> Values:
    """Return U at torques by the magnitudes and the U that are certified in their direction."""
    number, (sizes, expanded) = functions_for(torque_nm), certified
    size = abs(torque_nm)
    within = number.minimum(number.maximum(size, sizes.item(0)), sizes.item(-1))
    (u,) = on_lines(expanded[None], located(sizes, within))
    expanded_nm: Values = u * (size / within)
    return expanded_nm


def _thinned(torque: FloatArray, expanded: FloatArray) -> FloatArray:
    """Return both ends and every point off the line between its neighbours, shape (2, n)."""
    points = np.stack([torque, expanded])
    if torque.size < 3:
        return points
    before, after = torque[1:-1] - torque[:-2], torque[2:] - torque[1:-1]
    rise = expanded[1:-1] - expanded[:-2], expanded[2:] - expanded[1:-1]
    bent = np.abs(rise[0] * after - rise[1] * before) > 1e-9 * np.max(np.abs(expanded)) * after
    return points[:, np.concatenate([[True], bent, [True]])]


def _listed(values: tuple[float, ...]) -> str:
    return ", ".join(f"{value:g}" for value in values[:5]) + (", …" if len(values) > 5 else "")
