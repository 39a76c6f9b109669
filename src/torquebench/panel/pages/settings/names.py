"""Labels of settings, and the units of their keys."""

from __future__ import annotations

from torquebench.panel.text import Text

__all__ = ["group_title", "setting_title", "unit_of"]

UNITS = {
    "_percent_per_1000rpm": "%/(1000 rpm)",
    "_percent_per_10k": "%/(10 K)",
    "_percent_per_year": "%/a",
    "_percent_per_h": "%/h",
    "_nm_per_arcmin": "N·m/arcmin",
    "_nm_per_s": "N·m/s",
    "_rpm_per_s": "rpm/s",
    "_hz_per_nm": "Hz/(N·m)",
    "_arcmin": "arcmin",
    "_arcsec": "arcsec",
    "_kgm2": "kg·m²",
    "_percent": "%",
    "_days": "d",
    "_rpm": "rpm",
    "_deg": "°",
    "_khz": "kHz",
    "_mm": "mm",
    "_kw": "kW",
    "_hz": "Hz",
    "_nm": "N·m",
    "_s": "s",
    "_v": "V",
    "_h": "h",
    "_c": "°C",
    "_k": "K",
    "_j": "J",
}
"""By the end of a key, the longest first."""


def unit_of(key: str) -> str:
    """Return the unit that a key ends in; empty where it has none.

    Examples
    --------
    >>> unit_of("output.limits.torque_nm"), unit_of("input.drive.torque_rate_nm_per_s")
    ('N·m', 'N·m/s')
    >>> unit_of("counter.clock")
    ''
    """
    return next((unit for end, unit in UNITS.items() if key.endswith(end)), "")


def setting_title(text: Text, key: str) -> str:
    """Return the label of a setting; without one, the last word of its key.

    Examples
    --------
    >>> setting_title(Text("en"), "output.limits.torque_nm")
    'Torque limit'
    >>> setting_title(Text("en"), "input.drive.torque_rate_nm_per_s")
    'Torque ramp'
    """
    group, _, last = key.rpartition(".")
    parent = group.rpartition(".")[2]
    return text.maybe(f"setting.{parent}_{last}", text.maybe(f"setting.{last}", last))


def group_title(text: Text, group: str) -> str:
    """Return the title of a group of settings.

    Examples
    --------
    >>> group_title(Text("en"), "output.limits"), group_title(Text("en"), "")
    ('Output module: Limits', 'General')
    """
    if not group:
        return text("settings.general")
    return ": ".join(text.maybe(f"setting_group.{part}", part) for part in group.split("."))
