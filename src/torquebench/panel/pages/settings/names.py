"""Labels of settings, and the units of their keys."""

from __future__ import annotations

from torquebench.panel.text import Text

__all__ = ["group_title", "setting_title"]


def setting_title(text: Text, key: str) -> str:
    """Return the label of a setting; without one, the last word of its key.

    Examples
    --------
    >>> setting_title(Text("en"), "output.limits.torque_nm")
    'Maximum torque'
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
    return ": ".join(
        text.title(text.maybe(f"setting_group.{part}", part)) for part in group.split(".")
    )
