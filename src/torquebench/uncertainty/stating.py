"""A value and its expanded uncertainty as digits, as in GUM 7.2.6."""

from __future__ import annotations

from math import isfinite


def rounded(uncertainty: float) -> tuple[float, int]:
    """Round an uncertainty to two significant digits; return it with its number of decimals.

    Parameters
    ----------
    uncertainty : float
        Above 0, in any unit; any other value is returned unchanged, with three decimals.

    Returns
    -------
    tuple of float and int
        The rounded uncertainty, and the number of decimals for it and its value.

    Examples
    --------
    >>> rounded(0.8212), rounded(0.0996), rounded(12.6)
    ((0.82, 2), (0.1, 2), (13.0, 0))
    """
    if not isfinite(uncertainty) or uncertainty <= 0.0:
        return uncertainty, 3
    places = _places(uncertainty)
    return round(uncertainty, places), max(places, 0)


def stated(value: float, expanded: float) -> tuple[str, str]:
    """Return a value and its expanded uncertainty, both to two digits of the uncertainty.

    Parameters
    ----------
    value, expanded : float
        Value and U in the same unit; a U that isn't finite is unknown.

    Returns
    -------
    tuple of str
        Both as text, without unit; a value has five digits if its uncertainty doesn't determine
        their number.

    Examples
    --------
    >>> stated(112.34567, 0.456), stated(-0.51322, 0.00688)
    (('112.35', '0.46'), ('-0.5132', '0.0069'))
    >>> stated(1234.0, 346.0), stated(0.95, 0.0)
    (('1230', '350'), ('0.95', '0'))
    """
    if not (isfinite(value) and isfinite(expanded) and expanded > 0.0):
        return f"{value:.5g}", "0" if expanded == 0.0 else "unknown"
    if expanded < 1e-9 * abs(value):  # removes rounding noise
        return f"{value:.6g}", f"{expanded:.1g}"
    places = _places(expanded)
    decimals = max(places, 0)
    return f"{round(value, places):.{decimals}f}", f"{round(expanded, places):.{decimals}f}"


def _places(uncertainty: float) -> int:
    """Return the decimals for two significant digits; 0.0996 has two, as 0.10."""
    return 1 - int(f"{uncertainty:.1e}".partition("e")[2])
